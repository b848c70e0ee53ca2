"""Delivery to a server through a spool: states in, batches out, retried while the server is away.

Nothing is lost: a row is on the disk before it is sent, and is deleted once the server has confirmed it. Nothing is
stored twice: a row sent again, after a loss of power or a missing answer, has the same key on the server.
"""

from __future__ import annotations

import asyncio
import json
import sqlite3
import threading
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from ohmward.errors import OhmwardError
from ohmward.onboard.feed import Feed
from ohmward.onboard.part import FIRST_WAIT_S, LOG, LONGEST_WAIT_S
from ohmward.onboard.robot_state import RobotState
from ohmward.onboard.store.rows import Row, RowMaker


class Spool:
    """Rows that wait on the disk for one server, first in, first out.

    Args:
        path: of its database.
        most_rows: beyond this many the oldest are dropped: a robot's disk is finite, a server may be away for months.

    Attributes:
        waiting: number of rows.  lost: number of rows dropped since the caller last set it to 0.
        sending: lock held while a batch is being sent.

    Raises:
        OhmwardError: it cannot be opened.
    """

    def __init__(self, path: Path, most_rows: int):
        self.most_rows, self.lost = most_rows, 0
        self.sending = threading.Lock()
        self._lock = threading.Lock()
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._database = sqlite3.connect(path, check_same_thread=False)
            self._database.execute("PRAGMA journal_mode = WAL")
            self._database.execute("PRAGMA synchronous = FULL")
            self._database.execute("CREATE TABLE IF NOT EXISTS spool (id INTEGER PRIMARY KEY AUTOINCREMENT, row TEXT)")
            (self.waiting,) = self._database.execute("SELECT COUNT(*) FROM spool").fetchone()
        except (OSError, sqlite3.Error) as error:
            raise OhmwardError(f"{path}: the spool cannot be opened ({error}); is the folder writable?") from error

    def put(self, rows: Sequence[Row]) -> None:
        """Add rows; they are on the disk when it returns.

        Raises:
            OhmwardError: the disk refuses; none of them is added.
        """
        texts = [(json.dumps([row.kind, row.unix_ns, dict(row.values)]),) for row in rows]
        with self._lock:
            excess = max(self.waiting + len(texts) - self.most_rows, 0)
            try:
                with self._database as database:
                    database.executemany("INSERT INTO spool (row) VALUES (?)", texts)
                    database.execute(
                        "DELETE FROM spool WHERE id IN (SELECT id FROM spool ORDER BY id LIMIT ?)", [excess]
                    )
            except sqlite3.Error as error:
                raise OhmwardError(f"the spool cannot be written ({error}); is the disk full?") from error
            self.lost += excess
            self.waiting += len(texts) - excess

    def oldest(self, most: int) -> tuple[int, list[Row]]:
        """A number to confirm the oldest rows by, and the rows."""
        with self._lock:
            found = self._database.execute("SELECT id, row FROM spool ORDER BY id LIMIT ?", (most,)).fetchall()
        rows = [Row(kind, unix_ns, values) for kind, unix_ns, values in (json.loads(text) for _, text in found)]
        return (found[-1][0] if found else 0), rows

    def confirm(self, number: int) -> None:
        """Delete the rows up to a number, which the server has confirmed."""
        with self._lock:
            with self._database as database:
                gone = database.execute("DELETE FROM spool WHERE id <= ?", (number,)).rowcount
            self.waiting -= gone

    def close(self) -> None:
        """Close the database; a thread that still sends finds it closed."""
        with self._lock:  # SQLite crashes the process if another thread is inside
            self._database.close()


#: Most rows sent at once.
ROWS_AT_ONCE = 5000

#: Most rows that wait: a day at 10 Hz, some 300 MB.
MOST_WAITING = 1_000_000

#: Time between two looks into the feed, so that commits are few.
GATHER_S = 0.5

#: Sends rows to the server and returns once it has confirmed them; raises OhmwardError if it has not.
Send = Callable[[Sequence[Row]], None]


async def deliver(feed: Feed, send: Send, path: Path, most_waiting: int = MOST_WAITING) -> None:
    """Deliver the states of a feed until it ends; undelivered rows stay on the disk.

    send: called in a thread.  path: of the spool.
    """
    spool, maker = await asyncio.to_thread(Spool, path, most_waiting), RowMaker()
    sender = asyncio.create_task(_send_all(spool, send, feed))
    try:
        while states := await feed.batch():
            rows = [row for state in states for row in maker.rows(state)]
            await until_taken(partial(spool.put, rows), feed, states)
            feed.lost, spool.lost = feed.lost + spool.lost, 0
            await asyncio.sleep(0.0 if feed.ended else GATHER_S)
        await asyncio.to_thread(_send_rest, spool, send)
    finally:
        sender.cancel()
        await asyncio.gather(sender, return_exceptions=True)
        spool.close()


async def until_taken(take: Callable[[], None], feed: Feed, states: list[RobotState]) -> None:
    """Retry `take` in a thread until the disk no longer refuses; new states wait in the feed meanwhile.

    states: returned to the feed if it has ended.

    Raises:
        OhmwardError: the disk refuses and the feed has ended.
    """
    refused = False
    while True:
        try:
            await done_in_thread(take)
            feed.trouble = "" if refused else feed.trouble
            return
        except OhmwardError as error:
            if feed.ended:
                feed.put_back(states)
                raise
            refused, feed.trouble = True, str(error)
            await asyncio.sleep(FIRST_WAIT_S)


async def done_in_thread(work: Callable[[], None]) -> None:
    """Do work in a thread; a cancellation waits until it is done, so that its resources may then be closed."""
    task = asyncio.ensure_future(asyncio.to_thread(work))
    try:
        await asyncio.shield(task)
    except asyncio.CancelledError:
        await asyncio.wait([task])
        raise


async def _send_all(spool: Spool, send: Send, feed: Feed) -> None:
    """Send waiting rows, for ever; a server that is away is retried after a pause."""
    pause_s = FIRST_WAIT_S
    while True:
        if not spool.waiting:
            await asyncio.sleep(GATHER_S)
            continue
        try:
            await asyncio.to_thread(send_batch, spool, send)
            pause_s, feed.trouble = FIRST_WAIT_S, ""
        except Exception as error:
            feed.trouble = f"rows wait on the disk: {error}"
            await asyncio.sleep(pause_s)
            pause_s = min(2.0 * pause_s, LONGEST_WAIT_S)


def _send_rest(spool: Spool, send: Send) -> None:
    """Send the rows that wait at the end, as far as the server accepts them."""
    try:
        while spool.waiting:
            send_batch(spool, send)
    except Exception as error:
        LOG.warning("%d rows stay on the disk for the next start: %s", spool.waiting, error)


def send_batch(spool: Spool, send: Send) -> None:
    """Send the oldest rows and forget them once they are confirmed."""
    with spool.sending:
        number, rows = spool.oldest(ROWS_AT_ONCE)
        if rows:
            send(rows)
            spool.confirm(number)
