"""Rows to PostgreSQL, from a spool on the disk."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ohmward.checks import require_between
from ohmward.errors import InputError
from ohmward.onboard.feed import Feed
from ohmward.onboard.secrets import check_secret_name, secret
from ohmward.onboard.store.delivery import deliver
from ohmward.onboard.store.postgresql import write
from ohmward.onboard.store.rows import Row


@dataclass(frozen=True)
class PostgresqlSink:
    """Rows in the tables `ohmward_battery` and `ohmward_drive`, which are made where there are none.

    Attributes:
        address: `host=db.local port=5432 dbname=robots user=rover` or `postgresql://rover@db.local/robots`.
        robot: in the column of that name.
        password: where the password is, see `secrets`; None for none.
        spool: file of rows that wait for the server.
        interval_s: least time between two states, >= 0.
        name: in diagnostics.
    """

    address: str
    robot: str = "robot"
    password: str | None = None
    spool: str = "ohmward-state/postgresql.spool"
    interval_s: float = 1.0
    name: str = "postgresql"

    def __post_init__(self) -> None:
        require_between("interval_s", self.interval_s, 0.0, 1e9)
        if "password=" in self.address or (
            "://" in self.address and ":" in self.address.partition("://")[2].partition("@")[0]
        ):
            raise InputError("address must not hold a password; give password = the name of an environment variable")
        if self.password is not None:
            check_secret_name("password", self.password)

    async def run(self, feed: Feed) -> None:
        """Deliver rows until the feed ends."""
        password = secret("password", self.password) if self.password else ""

        def send(rows: Sequence[Row]) -> None:
            write(rows, self.robot, self.address, password)

        await deliver(feed, send, Path(self.spool))
