"""The store on board: everything that was measured and estimated, in SQLite, older days in Parquet."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ohmward.checks import require_between, require_positive
from ohmward.errors import OhmwardError
from ohmward.onboard.feed import Feed
from ohmward.onboard.part import LOG
from ohmward.onboard.robot_state import RobotState
from ohmward.onboard.store.rows import RowMaker
from ohmward.onboard.store.store import Store

#: Time between two looks for days that are over and files that are too many.
HOUSEKEEPING_S = 600.0


@dataclass(frozen=True)
class StoreSink:
    """Rows in a folder.

    Attributes:
        folder: made where there is none.
        commit_s: between two commits [s]: what a loss of power may cost, >= 0.
        keep_days: whole days in the database; older ones go to the archive, > 0.
        most_MB: size of database and archive; beyond it the oldest files of the archive are removed, > 0.
        interval_s: least time between two states that are stored, >= 0; 0 stores every one.
        name: in diagnostics.
    """

    folder: str = "ohmward-store"
    commit_s: float = 1.0
    keep_days: float = 2.0
    most_MB: float = 4000.0
    interval_s: float = 0.0
    name: str = "store"

    def __post_init__(self) -> None:
        require_between("commit_s", self.commit_s, 0.0, 60.0)
        require_positive("keep_days", self.keep_days)
        require_positive("most_MB", self.most_MB)
        require_between("interval_s", self.interval_s, 0.0, 1e9)

    async def run(self, feed: Feed) -> None:
        """Store states until the feed ends; those that a full disk refuses go back to it."""
        store, maker = await asyncio.to_thread(Store, Path(self.folder)), RowMaker()
        cleaned_s = -HOUSEKEEPING_S
        try:
            while states := await feed.batch():
                try:
                    await asyncio.to_thread(self._add, store, maker, states)
                except OhmwardError:
                    feed.put_back(states)
                    raise
                if time.monotonic() - cleaned_s > HOUSEKEEPING_S:
                    cleaned_s = time.monotonic()
                    await asyncio.to_thread(self.clean, store, states[-1].unix_s)
                await asyncio.sleep(0.0 if feed.ended else self.commit_s)
        finally:
            await asyncio.to_thread(store.close)

    def _add(self, store: Store, maker: RowMaker, states: Sequence[RobotState]) -> None:
        rows = [row for state in states for row in maker.rows(state)]
        store.add(rows, [condition for state in states for condition in maker.conditions(state)])

    def clean(self, store: Store, unix_s: float) -> None:
        """Archive days that are over, and remove the oldest files of an archive that is too large."""
        for entry in store.archive_days(unix_s - 86_400.0 * self.keep_days):
            LOG.info("store: %d rows of %s are in %s", entry.rows, entry.kind, entry.name)
        for name in store.prune(int(1e6 * self.most_MB)):
            LOG.warning("store: %s was removed, the store had grown beyond %g MB", name, self.most_MB)
