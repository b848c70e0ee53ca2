"""Rows to a server from a spool on the disk: InfluxDB and others with its line protocol, PostgreSQL."""

from __future__ import annotations

import json
import re
import urllib.parse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from ohmward.errors import InputError, OhmwardError
from ohmward.onboard.feed import Feed
from ohmward.onboard.http_post import post
from ohmward.onboard.part import LOG
from ohmward.onboard.secrets import check_secret_name, secret
from ohmward.onboard.store.delivery import Send, deliver
from ohmward.onboard.store.rows import KINDS, Row
from ohmward.optional import require


def _check_address(key: str, holds_secret: bool, secret_key: str, where: str | None) -> None:
    """Raise InputError for an address with a secret in it, or a secret instead of its place."""
    if holds_secret:
        raise InputError(f"{key} must not hold a password; give {secret_key} = the name of an environment variable")
    check_secret_name(secret_key, where)


async def _deliver(feed: Feed, send: Send, sink: InfluxSink | PostgresqlSink) -> None:
    """Deliver rows until the feed ends."""
    await deliver(feed, send, Path(sink.spool or f"ohmward-state/{sink.name}.spool"))


@dataclass(frozen=True)
class InfluxSink:
    """Line protocol over HTTP, with `robot` as a tag: InfluxDB 1, 2 and 3, VictoriaMetrics, QuestDB and Telegraf."""

    identity: ClassVar[str] = "robot"  #: setting by which receivers tell robots apart
    #: write API: `http://HOST:8086/write?db=robots` or `http://HOST:8086/api/v2/write?org=ORG&bucket=robots`
    url: str
    token: str | None = None  #: secret, if the server requires one
    robot: str = "robot"  #: name of the robot in each row
    #: file of rows that wait for the server; default: one with the name of the sink in `ohmward-state`
    spool: str | None = None
    interval_s: float = 1.0  #: least time between two states, >= 0
    name: str = "influxdb"  #: in diagnostics

    def __post_init__(self) -> None:
        parts = urllib.parse.urlsplit(self.url)
        if parts.scheme not in ("http", "https") or not parts.netloc:
            raise InputError(
                f"url must be http://HOST:PORT/write?db=NAME or that of another write API, got {self.url!r}"
            )
        holds_secret = bool(parts.username or parts.password or "p" in urllib.parse.parse_qs(parts.query))
        _check_address("url", holds_secret, "token", self.token)

    async def run(self, feed: Feed) -> None:
        """Deliver rows until the feed ends."""
        token = secret("token", self.token)
        await _deliver(feed, lambda rows: write_lines(self.url, lines(rows, self.robot), token), self)

    async def try_out(self) -> None:
        """Look for the secret; rows that wait in the spool stay there."""
        secret("token", self.token)


#: Status of a server that has stored the rows: 204. A page with status 200 is from a proxy or another server.
_STORED = 204

#: InfluxDB's words for: stored, except for rows that it will never accept because they exceed its retention time.
_STORED_IN_PART = "partial write"
_TAG = str.maketrans({",": r"\,", "=": r"\=", " ": r"\ ", "\\": r"\\", "\n": r"\ "})


def lines(rows: Sequence[Row], robot: str) -> str:
    """Rows as lines: `drive,robot=rover estimated_speed_m_s=0.8 1700000000000000000`; rows without values give none."""
    tag = robot.translate(_TAG)
    found = []
    for row in rows:
        if fields := ",".join(f"{name.translate(_TAG)}={value!r}" for name, value in row.values.items()):
            found.append(f"{row.kind},robot={tag} {fields} {row.unix_ns}\n")
    return "".join(found)


def write_lines(url: str, text: str, token: str = "") -> None:
    """Write lines to a server; a line written again replaces the earlier one.

    url: of its write API, see `InfluxSink`.

    Raises:
        OhmwardError: it cannot be reached or refuses.
    """
    headers = {"Content-Type": "text/plain; charset=utf-8"} | ({"Authorization": f"Token {token}"} if token else {})
    status, answer = post(url, text, headers)
    place = urllib.parse.urlsplit(url).netloc
    if _STORED_IN_PART in answer:
        LOG.warning("%s: %s", place, answer)
    elif 200 <= status < 300 and status != _STORED:
        raise OhmwardError(f"{place} does not say that it stored the rows ({status}); check url")
    elif status != _STORED:
        raise OhmwardError(f"{place} refuses the rows ({status} {answer}); check url and token")


@dataclass(frozen=True)
class PostgresqlSink:
    """A table for each kind of rows, created if missing; one row for each robot and time, its values as JSON."""

    identity: ClassVar[str] = "robot"  #: setting by which receivers tell robots apart
    address: str  #: `host=db.local port=5432 dbname=robots user=rover` or `postgresql://rover@db.local/robots`
    password: str | None = None  #: secret, if the server requires one
    robot: str = "robot"  #: name of the robot in each row
    #: file of rows that wait for the server; default: one with the name of the sink in `ohmward-state`
    spool: str | None = None
    interval_s: float = 1.0  #: least time between two states, >= 0
    name: str = "postgresql"  #: in diagnostics

    def __post_init__(self) -> None:
        in_url = urllib.parse.urlsplit(self.address).password is not None
        holds_secret = in_url or re.search(r"password\s*=", self.address) is not None
        _check_address("address", holds_secret, "password", self.password)

    async def run(self, feed: Feed) -> None:
        """Deliver rows until the feed ends."""
        password = secret("password", self.password)
        await _deliver(feed, lambda rows: write_rows(rows, self.robot, self.address, password), self)

    async def try_out(self) -> None:
        """Look for the secret; rows that wait in the spool stay there."""
        secret("password", self.password)


#: A server that does not answer within this is away [s].
_TIMEOUT_S = 20

_TABLES = "; ".join(
    f"CREATE TABLE IF NOT EXISTS ohmward_{kind} (robot text NOT NULL, unix_ns bigint NOT NULL, "
    "at timestamptz NOT NULL, values jsonb NOT NULL, PRIMARY KEY (robot, unix_ns)); "
    f"CREATE INDEX IF NOT EXISTS ohmward_{kind}_at ON ohmward_{kind} (at)"
    for kind in KINDS
)


def write_rows(rows: Sequence[Row], robot: str, address: str, password: str = "") -> None:
    """Write rows in one transaction; a row written again changes nothing.

    address: see `PostgresqlSink`.

    Raises:
        OhmwardError: the server cannot be reached or refuses.
    """
    psycopg = require("psycopg", "the sink postgresql")
    options: dict[str, Any] = {"connect_timeout": _TIMEOUT_S} | ({"password": password} if password else {})
    try:
        with psycopg.connect(address, **options) as connection, connection.cursor() as cursor:
            cursor.execute(f"SET statement_timeout = {_TIMEOUT_S * 1000}")
            cursor.execute("SELECT " + " AND ".join(f"to_regclass('ohmward_{kind}') IS NOT NULL" for kind in KINDS))
            if cursor.fetchone() != (True,):  # each takes a lock on which robots would wait for each other
                cursor.execute(_TABLES)
            for kind in KINDS:
                values = [
                    (robot, row.unix_ns, row.unix_ns / 1e9, json.dumps(row.values)) for row in rows if row.kind == kind
                ]
                insert = f"INSERT INTO ohmward_{kind} VALUES (%s, %s, to_timestamp(%s), %s) ON CONFLICT DO NOTHING"
                cursor.executemany(insert, values)
    except psycopg.Error as error:
        reason = " ".join(str(error).split())
        raise OhmwardError(f"PostgreSQL takes no rows ({reason}); is the server running, and address right?") from error
