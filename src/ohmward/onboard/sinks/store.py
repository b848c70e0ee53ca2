"""The store on board: everything that was measured and estimated, in SQLite, older days in Parquet."""

from __future__ import annotations

import asyncio
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from ohmward.atomic import held_folder, require_writable
from ohmward.checks import require_between, require_positive
from ohmward.errors import OhmwardError
from ohmward.onboard.feed import Feed
from ohmward.onboard.part import LOG
from ohmward.onboard.store.delivery import done_in_thread, until_taken
from ohmward.onboard.store.rows import RowMaker
from ohmward.onboard.store.store import DATABASE, Store
from ohmward.quantities import DAY_S

#: Time between two searches for past days and excess files.
HOUSEKEEPING_S = 600.0

#: Share of the store that the database may take; a row in the archive takes a seventh of one in the database.
DATABASE_SHARE = 0.5


@dataclass(frozen=True)
class StoreSink:
    """Rows in a folder."""

    folder: str = "ohmward-store"  #: created if missing
    commit_s: float = 1.0  #: time between two commits, the most that a loss of power costs, >= 0
    #: whole days in the database before they move to the archive, > 0; the database holds at most half of `most_MB`
    keep_days: float = 2.0
    most_MB: float = 4000.0  #: size of database and archive beyond which the oldest archive files are removed, > 0
    interval_s: float = 0.0  #: least time between two states stored, >= 0; 0 stores all
    name: str = "store"  #: in diagnostics

    def __post_init__(self) -> None:
        require_between("commit_s", self.commit_s, 0.0, 60.0)
        require_positive("keep_days", self.keep_days)
        require_positive("most_MB", self.most_MB)

    async def run(self, feed: Feed) -> None:
        """Store states until the feed ends; states refused by a full disk go back to the feed."""
        with await asyncio.to_thread(held_folder, Path(self.folder), "folder"):
            store, maker = await asyncio.to_thread(Store, Path(self.folder)), RowMaker()
            cleaned_s = -HOUSEKEEPING_S
            try:
                while states := await feed.batch():
                    rows = [row for state in states for row in maker.rows(state)]
                    conditions = [condition for state in states for condition in maker.conditions(state)]
                    await until_taken(partial(store.add, rows, conditions), feed, states)
                    if time.monotonic() - cleaned_s > HOUSEKEEPING_S:
                        cleaned_s = time.monotonic()
                        await self._clean(store, states[-1].unix_s, feed)
                    await asyncio.sleep(0.0 if feed.ended else self.commit_s)
            finally:
                await asyncio.to_thread(store.close)

    async def try_out(self) -> None:
        """Look whether the store can be read, if there is one, and written."""
        database = Path(self.folder) / DATABASE
        if database.exists():
            Store(Path(self.folder), read_only=True).close()
        require_writable(database)

    async def _clean(self, store: Store, unix_s: float, feed: Feed) -> None:
        """Clean the store; if that fails, name the reason and go on storing rows."""
        try:
            await done_in_thread(partial(self.clean, store, unix_s))
            feed.trouble = ""
        except (OhmwardError, OSError) as error:
            feed.trouble = f"rows are stored, older ones cannot be archived: {error}"

    def clean(self, store: Store, unix_s: float) -> None:
        """Archive past days and excess rows of the database, and remove the oldest files of a store that is too large.

        Raises:
            OhmwardError: a file cannot be written.
        """
        most_bytes = int(1e6 * self.most_MB)
        self._prune(store, most_bytes)  # first, a full disk needs room for what follows
        done = store.archive_days(unix_s - DAY_S * self.keep_days)
        for entry in done + store.archive_excess(int(DATABASE_SHARE * most_bytes)):
            LOG.info("store: %d rows of %s are in %s", entry.rows, entry.kind, entry.name)
        self._prune(store, most_bytes)

    def _prune(self, store: Store, most_bytes: int) -> None:
        for name in store.prune(most_bytes):
            LOG.warning("store: %s was removed, the store had grown beyond %g MB", name, self.most_MB)
