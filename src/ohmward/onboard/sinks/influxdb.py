"""Rows to InfluxDB, VictoriaMetrics or whatever takes line protocol, from a spool on the disk."""

from __future__ import annotations

import urllib.parse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ohmward.checks import require_between
from ohmward.errors import InputError
from ohmward.onboard.feed import Feed
from ohmward.onboard.secrets import check_secret_name, secret
from ohmward.onboard.store.delivery import deliver
from ohmward.onboard.store.influx import lines, post
from ohmward.onboard.store.rows import Row


@dataclass(frozen=True)
class InfluxSink:
    """Lines over HTTP.

    Attributes:
        url: of the write API, `http://HOST:8086/write?db=robots` or
            `http://HOST:8086/api/v2/write?org=ORG&bucket=robots`.
        robot: tag of the rows.
        token: where the token is, see `secrets`; None for none.
        spool: file of rows that wait for the server.
        interval_s: least time between two states, >= 0.
        name: in diagnostics.
    """

    url: str
    robot: str = "robot"
    token: str | None = None
    spool: str = "ohmward-state/influxdb.spool"
    interval_s: float = 1.0
    name: str = "influxdb"

    def __post_init__(self) -> None:
        require_between("interval_s", self.interval_s, 0.0, 1e9)
        parts = urllib.parse.urlsplit(self.url)
        if parts.scheme not in ("http", "https") or not parts.netloc:
            raise InputError(
                f"url must be http://HOST:PORT/write?db=NAME or that of another write API, got {self.url!r}"
            )
        if parts.username or parts.password:
            raise InputError("url must not hold a password; give token = the name of an environment variable")
        if self.token is not None:
            check_secret_name("token", self.token)

    async def run(self, feed: Feed) -> None:
        """Deliver rows until the feed ends."""
        token = secret("token", self.token) if self.token else ""

        def send(rows: Sequence[Row]) -> None:
            post(self.url, lines(rows, self.robot), token)

        await deliver(feed, send, Path(self.spool))
