"""Rows to PostgreSQL, from a spool on the disk."""

from __future__ import annotations

import re
import urllib.parse
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar

from ohmward.onboard.sinks.server import ServerSink
from ohmward.onboard.store.postgresql import write
from ohmward.onboard.store.rows import Row


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
