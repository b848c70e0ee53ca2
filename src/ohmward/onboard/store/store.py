"""Store of one robot: rows in SQLite, older days in Parquet, in one folder.

store.sqlite                                    the newest days; write-ahead log, every commit is on the disk
archive/battery-2026-11-22-00000001-00086400.parquet    a finished day; the numbers are those of its first and last row

A row is in exactly one of both: the archive of a day is whole on the disk before one transaction enters it and deletes
its rows. A file that is not entered was begun before a loss of power and is removed.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ohmward.errors import InputError, OhmwardError
from ohmward.logs.write import write_table
from ohmward.onboard.store.rows import KINDS, ConditionRow, Row
from ohmward.optional import require

DATABASE, ARCHIVE = "store.sqlite", "archive"

#: Version of the tables, in SQLite's `user_version`.
VERSION = 1

_SCHEMA = f"""
CREATE TABLE battery (id INTEGER PRIMARY KEY AUTOINCREMENT, unix_ns INTEGER NOT NULL);
CREATE TABLE drive (id INTEGER PRIMARY KEY AUTOINCREMENT, unix_ns INTEGER NOT NULL);
CREATE TABLE condition (unix_ns INTEGER NOT NULL, name TEXT NOT NULL, level TEXT NOT NULL, message TEXT NOT NULL);
CREATE TABLE archive (name TEXT PRIMARY KEY, kind TEXT NOT NULL, rows INTEGER NOT NULL,
                      first_ns INTEGER NOT NULL, last_ns INTEGER NOT NULL);
CREATE INDEX battery_time ON battery (unix_ns);
CREATE INDEX drive_time ON drive (unix_ns);
PRAGMA user_version = {VERSION};
"""

_DAY_NS = 86_400 * 10**9


class Archived(NamedTuple):
    """A file of the archive: name, kind, number of rows, and the times of the first and the last."""

    name: str
    kind: str
    rows: int
    first_ns: int
    last_ns: int


class Store:
    """The store in a folder; one process writes, any number may read.

    Args:
        folder: made where there is none.
        read_only: open what is there.

    Raises:
        OhmwardError: it cannot be opened, is not a store, or is of a newer version.
    """

    def __init__(self, folder: Path, read_only: bool = False):
        self.folder, self.archive = folder, folder / ARCHIVE
        path = folder / DATABASE
        if read_only and not path.is_file():
            raise InputError(f"{folder}: there is no store; give the folder that the sink `store` of the setup names")
        try:
            if not read_only:
                self.archive.mkdir(parents=True, exist_ok=True)
            mode = "ro" if read_only else "rwc"
            self._database = sqlite3.connect(
                f"{path.absolute().as_uri()}?mode={mode}", uri=True, check_same_thread=False
            )
            self._prepare(read_only)
        except (OSError, sqlite3.Error) as error:
            raise OhmwardError(
                f"{path}: cannot be opened ({error}); is the folder writable, and the file a store?"
            ) from error
        self._columns = {kind: self._known_columns(kind) for kind in KINDS}

    def _prepare(self, read_only: bool) -> None:
        if not read_only:
            self._database.execute("PRAGMA journal_mode = WAL")
            self._database.execute("PRAGMA synchronous = FULL")
        (version,) = self._database.execute("PRAGMA user_version").fetchone()
        if version == 0 and not read_only:
            self._database.executescript(f"BEGIN; {_SCHEMA} COMMIT;")
        elif version != VERSION:
            raise OhmwardError(f"{self.folder}: is a store of version {version}, this is {VERSION}; update ohmward")
        if not read_only:
            entered = {name for (name,) in self._database.execute("SELECT name FROM archive")}
            for path in self.archive.glob("*.parquet"):
                if path.name not in entered:
                    path.unlink()

    def close(self) -> None:
        """Close the database; its write-ahead log goes into it."""
        self._database.close()

    # ---- writing

    def add(self, rows: Iterable[Row], conditions: Iterable[ConditionRow] = ()) -> None:
        """Store rows; they are on the disk when it returns, or none of them is.

        Raises:
            OhmwardError: the disk is full, or refuses.
        """
        with self._transaction() as database:
            for kind, group in _grouped(rows).items():
                names = list(dict.fromkeys(name for row in group for name in row.values))
                self._add_columns(kind, names)
                places = ", ".join("?" * (len(names) + 1))
                columns = ", ".join(["unix_ns", *map(_quoted, names)])
                values = ((row.unix_ns, *map(row.values.get, names)) for row in group)
                database.executemany(f"INSERT INTO {kind} ({columns}) VALUES ({places})", values)
            database.executemany("INSERT INTO condition VALUES (?, ?, ?, ?)", conditions)

    def archive_days(self, before_unix_s: float) -> list[Archived]:
        """Move whole days (UTC) that ended before a time to files of the archive.

        Raises:
            OhmwardError: a file cannot be written; its rows stay.
        """
        end_ns = int(before_unix_s * 1e9) // _DAY_NS * _DAY_NS
        return [done for kind in KINDS for day in self._days(kind, end_ns) if (done := self._archive_day(kind, day))]

    def _days(self, kind: str, end_ns: int) -> list[int]:
        query = f"SELECT DISTINCT unix_ns / {_DAY_NS} FROM {kind} WHERE unix_ns < ? ORDER BY 1"
        return [day for (day,) in self._database.execute(query, (end_ns,))]

    def _archive_day(self, kind: str, day: int) -> Archived | None:
        where = "WHERE unix_ns >= ? AND unix_ns < ?"
        span = day * _DAY_NS, (day + 1) * _DAY_NS
        first, last, rows = self._database.execute(
            f"SELECT MIN(id), MAX(id), COUNT(*) FROM {kind} {where}", span
        ).fetchone()
        if not rows:
            return None
        columns = self._select(kind, self.names(kind), where, span)
        date = datetime.fromtimestamp(day * 86_400, UTC).strftime("%Y-%m-%d")
        name = f"{kind}-{date}-{first:08d}-{last:08d}.parquet"
        write_table(columns, self.archive / name)
        entry = Archived(name, kind, rows, int(columns["unix_ns"][0]), int(columns["unix_ns"][-1]))
        with self._transaction() as database:
            database.execute("INSERT INTO archive VALUES (?, ?, ?, ?, ?)", entry)
            database.execute(f"DELETE FROM {kind} {where} AND id <= ?", (*span, last))
        return entry

    def prune(self, most_bytes: int) -> list[str]:
        """Remove the oldest files of the archive until the store is no larger; their names."""
        removed = []
        for entry in self.archived():
            if self.size_bytes() <= most_bytes:
                break
            with self._transaction() as database:
                database.execute("DELETE FROM archive WHERE name = ?", (entry.name,))
            (self.archive / entry.name).unlink(missing_ok=True)
            removed.append(entry.name)
        return removed

    @contextmanager
    def _transaction(self) -> Iterator[sqlite3.Connection]:
        try:
            with self._database:
                yield self._database
        except sqlite3.Error as error:
            self._columns = {kind: self._known_columns(kind) for kind in KINDS}
            raise OhmwardError(f"{self.folder}: the store cannot be written ({error}); is the disk full?") from error

    def _add_columns(self, kind: str, names: Sequence[str]) -> None:
        for name in names:
            if name not in self._columns[kind]:
                self._database.execute(f"ALTER TABLE {kind} ADD COLUMN {_quoted(name)} REAL")
                self._columns[kind].append(name)

    # ---- reading

    def names(self, kind: str) -> list[str]:
        """Columns of a kind of rows that are in the database."""
        return list(self._known_columns(kind))

    def archived(self) -> list[Archived]:
        """The files of the archive, oldest first."""
        return [Archived(*row) for row in self._database.execute("SELECT * FROM archive ORDER BY last_ns, name")]

    def span_ns(self, kind: str) -> tuple[int, int, int]:
        """Number of rows, and times of the first and the last; 0, 0, 0 without rows."""
        rows, first, last = self._database.execute(
            f"SELECT COUNT(*), MIN(unix_ns), MAX(unix_ns) FROM {kind}"
        ).fetchone()
        old = [entry for entry in self.archived() if entry.kind == kind]
        times = [time for time in (first, last) if time is not None]
        times += [time for entry in old for time in (entry.first_ns, entry.last_ns)]
        whole = rows + sum(entry.rows for entry in old)
        return (whole, min(times), max(times)) if times else (0, 0, 0)

    def size_bytes(self) -> int:
        """Size of the database, without what is free in it, and of the archive."""
        (pages,), (free,) = (
            self._database.execute(f"PRAGMA {word}").fetchone() for word in ("page_count", "freelist_count")
        )
        (page_bytes,) = self._database.execute("PRAGMA page_size").fetchone()
        return (pages - free) * page_bytes + sum(path.stat().st_size for path in self.archive.glob("*.parquet"))

    def read(
        self, kind: str, names: Sequence[str] | None = None, since_s: float = -1e10, until_s: float = 1e10
    ) -> dict[str, np.ndarray]:
        """Columns (T,) in the order of time, `unix_ns` first; nan where a row has no value.

        names: columns wanted, None for all; since_s, until_s: on the wall clock, both ends belong to it.

        Raises:
            InputError: another kind.
        """
        if kind not in KINDS:
            raise InputError(f"there are rows of {' and '.join(KINDS)}, not {kind!r}")
        span = int(max(since_s, -9e9) * 1e9), int(min(until_s, 9e9) * 1e9)
        pieces = [
            _read_archive(self.archive / entry.name, names)
            for entry in self.archived()
            if entry.kind == kind and entry.first_ns <= span[1] and entry.last_ns >= span[0]
        ]
        wanted = [name for name in self.names(kind) if names is None or name in names]
        pieces.append(self._select(kind, wanted, "WHERE unix_ns >= ? AND unix_ns <= ?", span))
        return _between(_joined(pieces, names), *span)

    def conditions(self, since_s: float = 0.0) -> list[ConditionRow]:
        """Conditions since a time, in order."""
        query = "SELECT unix_ns, name, level, message FROM condition WHERE unix_ns >= ? ORDER BY unix_ns, rowid"
        return [ConditionRow(*row) for row in self._database.execute(query, (int(since_s * 1e9),))]

    def history(
        self, kind: str, names: Sequence[str], since_s: float, until_s: float, most_points: int = 2000
    ) -> dict[str, np.ndarray]:
        """As `read`, thinned to at most so many points: every n-th row."""
        found = self.read(kind, names, since_s, until_s)
        step = max(-(-len(found["unix_ns"]) // most_points), 1)
        return {name: column[::step] for name, column in found.items()}

    def _known_columns(self, kind: str) -> list[str]:
        return [row[1] for row in self._database.execute(f"PRAGMA table_info({kind})")][2:]

    def _select(self, kind: str, names: Sequence[str], where: str, span: tuple[int, int]) -> dict[str, np.ndarray]:
        columns = ", ".join(["unix_ns", *map(_quoted, names)])
        rows = self._database.execute(f"SELECT {columns} FROM {kind} {where} ORDER BY unix_ns, id", span).fetchall()
        table = list(zip(*rows, strict=True)) or [()] * (len(names) + 1)
        found = {"unix_ns": np.array(table[0], dtype=np.int64)}
        return found | {name: np.array(column, dtype=float) for name, column in zip(names, table[1:], strict=True)}


def _grouped(rows: Iterable[Row]) -> dict[str, list[Row]]:
    groups: dict[str, list[Row]] = {}
    for row in rows:
        groups.setdefault(row.kind, []).append(row)
    return groups


def _quoted(name: str) -> str:
    """A name as SQL takes it, whatever it holds."""
    return '"' + name.replace('"', '""') + '"'


def _read_archive(path: Path, names: Sequence[str] | None) -> dict[str, np.ndarray]:
    """Columns of a file of the archive.

    Raises:
        OhmwardError: it is missing or damaged.
    """
    parquet = require("pyarrow.parquet", "the archive of the store")
    try:
        file = parquet.ParquetFile(path)
        wanted = [n for n in file.schema_arrow.names if names is None or n in names or n == "unix_ns"]
        table = file.read(columns=wanted)
    except (OSError, ValueError) as error:
        raise OhmwardError(f"{path}: cannot be read ({error})") from error
    return {name: table.column(name).to_numpy() for name in wanted}


def _joined(pieces: Sequence[dict[str, np.ndarray]], names: Sequence[str] | None) -> dict[str, np.ndarray]:
    """Pieces one after the other; a column that a piece lacks is nan there."""
    found = dict.fromkeys(name for piece in pieces for name in piece if name != "unix_ns")
    wanted = list(found) if names is None else [name for name in names if name in found]
    joined = {"unix_ns": np.concatenate([piece["unix_ns"] for piece in pieces])}
    for name in wanted:
        columns = [piece.get(name, np.full(len(piece["unix_ns"]), np.nan)) for piece in pieces]
        joined[name] = np.concatenate(columns)
    return joined


def _between(columns: dict[str, np.ndarray], first_ns: int, last_ns: int) -> dict[str, np.ndarray]:
    time_ns = columns["unix_ns"]
    inside = (time_ns >= first_ns) & (time_ns <= last_ns)
    order = np.argsort(time_ns[inside], kind="stable")
    return {name: column[inside][order] for name, column in columns.items()}
