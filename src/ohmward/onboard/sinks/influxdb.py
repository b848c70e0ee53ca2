"""Rows to InfluxDB, VictoriaMetrics or whatever takes line protocol, from a spool on the disk."""

from __future__ import annotations

import urllib.parse
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar

from ohmward.errors import InputError
from ohmward.onboard.sinks.server import ServerSink
from ohmward.onboard.store.influx import lines, post
from ohmward.onboard.store.rows import Row


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
        post(self.url, lines(rows, self.robot), password)
