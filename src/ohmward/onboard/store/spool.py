"""Spool: rows for a server wait on the disk until it has confirmed them, in the order in which they came.

Nothing is lost: a row is on the disk before it is sent, and goes once the server has taken it. Nothing stands twice: a
row that is sent again, after a loss of power or an answer that never came, has the same key there.
"""

from __future__ import annotations

import json
import sqlite3
import threading
from collections.abc import Sequence
from pathlib import Path

from ohmward.errors import OhmwardError
from ohmward.onboard.store.rows import Row


class Spool:
    """Rows of one server, first in, first out.

    Args:
        path: of its database.
        most_rows: beyond this many the oldest are left out: the disk of a robot ends, a server may be away for months.

    Attributes:
        waiting: number of rows.  lost: number of those left out that `left_out` has not told yet.
        sending: held while a batch is on its way.

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
        """Keep rows; they are on the disk when it returns.

        Raises:
            OhmwardError: the disk refuses; none of them is kept.
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

    def left_out(self) -> int:
        """Number of rows that were left out since the last call."""
        lost, self.lost = self.lost, 0
        return lost

    def oldest(self, most: int) -> tuple[int, list[Row]]:
        """The oldest rows, and a number by which `confirm` knows them."""
        with self._lock:
            found = self._database.execute("SELECT id, row FROM spool ORDER BY id LIMIT ?", (most,)).fetchall()
        rows = [Row(kind, unix_ns, values) for kind, unix_ns, values in (json.loads(text) for _, text in found)]
        return (found[-1][0] if found else 0), rows

    def confirm(self, number: int) -> None:
        """Forget rows that the server has taken."""
        with self._lock:
            with self._database as database:
                gone = database.execute("DELETE FROM spool WHERE id <= ?", (number,)).rowcount
            self.waiting -= gone

    def close(self) -> None:
        """Close the database; a thread that still sends finds it closed."""
        with self._lock:  # SQLite takes the process with it where another thread is inside
            self._database.close()
