"""Rows to a server from a spool on the disk: InfluxDB and what takes its lines, PostgreSQL."""

from __future__ import annotations

import asyncio
import re
import urllib.parse
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

from ohmward.checks import require_between
from ohmward.errors import InputError
from ohmward.onboard.feed import Feed
from ohmward.onboard.secrets import check_secret_name, secret
from ohmward.onboard.store.delivery import deliver
from ohmward.onboard.store.influx import lines, write_lines
from ohmward.onboard.store.postgresql import write
from ohmward.onboard.store.rows import Row


@dataclass(frozen=True, kw_only=True)
class ServerSink:
    """Delivery to a server; a subclass has its address, its secret, and writes rows to it."""

    #: Name of the attribute that says where the secret is, see `secrets`.
    secret_key: ClassVar[str]

    robot: str = "robot"  #: by which the server knows the rows
    #: file of rows that wait for the server; by default one in `ohmward-state` that is called as the sink
    spool: str | None = None
    interval_s: float = 1.0  #: least time between two states, >= 0
    name: str  #: in diagnostics

    def __post_init__(self) -> None:
        require_between("interval_s", self.interval_s, 0.0, 1e9)
        address, holds_secret = self._address()
        if holds_secret:
            raise InputError(
                f"{address} must not hold a password; give {self.secret_key} = the name of an environment variable"
            )
        if (name := self._secret_name()) is not None:
            check_secret_name(self.secret_key, name)

    def _address(self) -> tuple[str, bool]:
        """Name of the attribute with the address, and True where a secret stands in it."""
        raise NotImplementedError

    def _write(self, rows: Sequence[Row], password: str) -> None:
        """Write rows to the server.

        Raises:
            OhmwardError: it has not confirmed them.
        """
        raise NotImplementedError

    def _secret_name(self) -> str | None:
        name: str | None = getattr(self, self.secret_key)
        return name

    async def try_out(self) -> None:
        """Look for the secret; rows that wait in the spool stay there."""
        self._password()
        await asyncio.Event().wait()

    def _password(self) -> str:
        name = self._secret_name()
        return secret(self.secret_key, name) if name else ""

    async def run(self, feed: Feed) -> None:
        """Deliver rows until the feed ends."""
        password = self._password()

        def send(rows: Sequence[Row]) -> None:
            self._write(rows, password)

        await deliver(feed, send, Path(self.spool or f"ohmward-state/{self.name}.spool"))


@dataclass(frozen=True)
class InfluxSink(ServerSink):
    """Lines over HTTP; `robot` is a tag of the rows."""

    secret_key: ClassVar[str] = "token"

    #: of the write API, `http://HOST:8086/write?db=robots` or `http://HOST:8086/api/v2/write?org=ORG&bucket=robots`
    url: str
    token: str | None = None  #: where the token is, see `secrets`; None for none
    name: str = field(default="influxdb", kw_only=True)

    def _address(self) -> tuple[str, bool]:
        parts = urllib.parse.urlsplit(self.url)
        if parts.scheme not in ("http", "https") or not parts.netloc:
            raise InputError(
                f"url must be http://HOST:PORT/write?db=NAME or that of another write API, got {self.url!r}"
            )
        return "url", bool(parts.username or parts.password or "p" in urllib.parse.parse_qs(parts.query))

    def _write(self, rows: Sequence[Row], password: str) -> None:
        write_lines(self.url, lines(rows, self.robot), password)


@dataclass(frozen=True)
class PostgresqlSink(ServerSink):
    """Rows in the tables `ohmward_battery` and `ohmward_drive`, which are made where there are none."""

    secret_key: ClassVar[str] = "password"

    address: str  #: `host=db.local port=5432 dbname=robots user=rover` or `postgresql://rover@db.local/robots`
    password: str | None = None  #: where the password is, see `secrets`; None for none
    name: str = field(default="postgresql", kw_only=True)

    def _address(self) -> tuple[str, bool]:
        in_url = urllib.parse.urlsplit(self.address).password is not None
        return "address", in_url or re.search(r"password\s*=", self.address) is not None

    def _write(self, rows: Sequence[Row], password: str) -> None:
        write(rows, self.robot, self.address, password)
