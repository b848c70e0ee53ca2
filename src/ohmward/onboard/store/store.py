"""Store of one robot: rows in SQLite, older days in Parquet, in one folder.

store.sqlite                                    the newest days; write-ahead log, every commit is on the disk
archive/battery-2026-11-22-00000001-00050000.parquet    rows of a day; the numbers are the ids of its first and last row

A row is in exactly one of the two: an archive file is complete on the disk before one transaction enters it in the
database and deletes its rows. A file that is not entered is removed if its rows are still in the database, and entered
if not: the database was lost, and the archive continues with a new one.
"""

from __future__ import annotations

import math
import os
import re
import sqlite3
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from datetime import UTC, datetime
from functools import lru_cache, partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ohmward.errors import InputError, OhmwardError
from ohmward.logs.sqlite_file import quoted
from ohmward.logs.write import write_table
from ohmward.onboard.part import LOG
from ohmward.onboard.robot_state import TOTALS_GAP_S, Totals
from ohmward.onboard.store.rows import KINDS, ConditionRow, Row
from ohmward.optional import require
from ohmward.quantities import DAY_S, SECONDS_PER_HOUR


def read_archive(path: Path, names: Sequence[str] | None) -> dict[str, np.ndarray]:
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


def joined(pieces: Sequence[dict[str, np.ndarray]], names: Sequence[str] | None) -> dict[str, np.ndarray]:
    """Pieces joined one after the other; a column missing from a piece is nan there."""
    found = dict.fromkeys(name for piece in pieces for name in piece if name != "unix_ns")
    wanted = list(found) if names is None else [name for name in names if name in found]
    whole = {"unix_ns": np.concatenate([piece["unix_ns"] for piece in pieces])}
    for name in wanted:
        columns = [piece.get(name, np.full(len(piece["unix_ns"]), np.nan)) for piece in pieces]
        whole[name] = np.concatenate(columns)
    return whole


def between(columns: dict[str, np.ndarray], first_ns: int, last_ns: int) -> dict[str, np.ndarray]:
    """Rows of a span of time, both ends included, in the order of time."""
    time_ns = columns["unix_ns"]
    inside = (time_ns >= first_ns) & (time_ns <= last_ns)
    order = np.argsort(time_ns[inside], kind="stable")
    return {name: column[inside][order] for name, column in columns.items()}


def first_of_each(columns: dict[str, np.ndarray], step_ns: int) -> dict[str, np.ndarray]:
    """First row of each step of time, of rows in the order of time; steps begin at multiples of `step_ns`."""
    first = np.unique(columns["unix_ns"] // step_ns, return_index=True)[1]
    return {name: column[first] for name, column in columns.items()}


@lru_cache(maxsize=4096)
def thinned_archive(path: Path, names: tuple[str, ...], step_ns: int) -> dict[str, np.ndarray]:
    """First row of each step of a file of the archive; a file never changes, so it is read once.

    Raises:
        OhmwardError: see `read_archive`.
    """
    columns = read_archive(path, names)
    return first_of_each(between(columns, 0, int(columns["unix_ns"].max(initial=0))), step_ns)


DATABASE, ARCHIVE = "store.sqlite", "archive"

#: Version of the tables, in SQLite's `user_version`.
TABLES_VERSION = 1

_SCHEMA = f"""
CREATE TABLE battery (id INTEGER PRIMARY KEY AUTOINCREMENT, unix_ns INTEGER NOT NULL);
CREATE TABLE drive (id INTEGER PRIMARY KEY AUTOINCREMENT, unix_ns INTEGER NOT NULL);
CREATE TABLE condition (unix_ns INTEGER NOT NULL, name TEXT NOT NULL, level TEXT NOT NULL, message TEXT NOT NULL);
CREATE TABLE archive (name TEXT PRIMARY KEY, kind TEXT NOT NULL, rows INTEGER NOT NULL,
                      first_ns INTEGER NOT NULL, last_ns INTEGER NOT NULL);
CREATE INDEX battery_time ON battery (unix_ns);
CREATE INDEX drive_time ON drive (unix_ns);
PRAGMA user_version = {TABLES_VERSION};
"""

_DAY_NS = int(DAY_S) * 10**9

#: Most conditions kept: some 20 MB, years of a healthy robot or a week of a loose contact that opens every 6 s.
MOST_CONDITIONS = 100_000

#: Most rows in an archive file: some 20 MB in memory with 40 columns, whatever the rate of the robot.
ARCHIVE_ROWS = 50_000

#: Rows held as Python numbers at a time; each takes four times its memory in an array.
_ROWS_OF_NUMBERS = 2_000

#: Time later than all rows: the largest integer of SQLite.
_LAST_NS = 2**63 - 1

_ARCHIVE_NAME = re.compile(rf"(?P<kind>{'|'.join(KINDS)})-\d{{4}}-\d\d-\d\d-(?P<first>\d+)-(?P<last>\d+)\.parquet")

#: `unix_ns` and columns of numbers (T,).
Columns = dict[str, np.ndarray]


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
        folder: created if missing.
        read_only: open an existing store for reading.

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
            mode = "rwc"
            if read_only:  # without locks if nobody writes or may write, as on a read-only disk
                written = path.with_name(f"{path.name}-wal").exists() or os.access(folder, os.W_OK)
                mode = "ro" if written else "ro&immutable=1"
            self._database = sqlite3.connect(
                f"{path.absolute().as_uri()}?mode={mode}", uri=True, check_same_thread=False
            )
            self._prepare(read_only)
        except (OSError, sqlite3.Error) as error:
            raise self._refusal("opened", error) from error
        self._columns = {kind: self.names(kind) for kind in KINDS}

    def _prepare(self, read_only: bool) -> None:
        if not read_only:
            self._database.execute("PRAGMA journal_mode = WAL")
            self._database.execute("PRAGMA synchronous = FULL")
        (version,) = self._database.execute("PRAGMA user_version").fetchone()
        if version == 0 and not read_only:
            self._database.executescript(f"BEGIN; {_SCHEMA} COMMIT;")
        elif version == 0:
            raise OhmwardError(f"{self.folder}: the database is empty; the sink `store` of a robot fills it")
        elif version != TABLES_VERSION:
            raise OhmwardError(
                f"{self.folder}: is a store of version {version}, this is {TABLES_VERSION}; update ohmward"
            )
        if not read_only:
            for path in self.archive.glob(".*.part"):
                path.unlink()
            entered = {entry.name for entry in self.archived()}
            for path in sorted(self.archive.glob("*.parquet")):
                if path.name not in entered:
                    self._settle(path)

    def _settle(self, path: Path) -> None:
        """Remove a file that is not entered if its rows are in the database; otherwise enter it."""
        if (match := _ARCHIVE_NAME.fullmatch(path.name)) is None:
            return
        kind, last = match["kind"], int(match["last"])
        if self._database.execute(f"SELECT 1 FROM {kind} WHERE id = ?", (last,)).fetchone():
            path.unlink()
            return
        try:
            time_ns = read_archive(path, [])["unix_ns"]
        except OhmwardError as error:
            LOG.warning("store: %s is left alone: %s", path.name, error)
            return
        with self._database as database:
            entry = Archived(path.name, kind, len(time_ns), int(time_ns.min()), int(time_ns.max()))
            database.execute("INSERT INTO archive VALUES (?, ?, ?, ?, ?)", entry)
            database.execute("DELETE FROM sqlite_sequence WHERE name = ? AND seq < ?", (kind, last))
            database.execute(
                "INSERT INTO sqlite_sequence SELECT ?, ? WHERE NOT EXISTS "
                "(SELECT 1 FROM sqlite_sequence WHERE name = ?)",
                (kind, last, kind),
            )
        LOG.warning("store: %s was not entered and is now; the database it belonged to is gone", path.name)

    def close(self) -> None:
        """Close the database, merging its write-ahead log into it."""
        self._database.close()

    # ---- writing

    def add(self, rows: Iterable[Row], conditions: Iterable[ConditionRow] = ()) -> None:
        """Store rows; they are on the disk when it returns, or none of them is.

        Raises:
            OhmwardError: the disk is full, or refuses.
        """
        whole = list(rows)
        with self._transaction() as database:
            for kind in KINDS:
                group = [row for row in whole if row.kind == kind]
                names = list(dict.fromkeys(name for row in group for name in row.values))
                for name in names:
                    if name not in self._columns[kind]:
                        database.execute(f"ALTER TABLE {kind} ADD COLUMN {quoted(name)} REAL")
                        self._columns[kind].append(name)
                places = ", ".join("?" * (len(names) + 1))
                columns = ", ".join(["unix_ns", *map(quoted, names)])
                values = ((row.unix_ns, *map(row.values.get, names)) for row in group)
                database.executemany(f"INSERT INTO {kind} ({columns}) VALUES ({places})", values)
            database.executemany("INSERT INTO condition VALUES (?, ?, ?, ?)", conditions)

    def archive_days(self, before_unix_s: float) -> list[Archived]:
        """Move whole days (UTC) that ended before a time to files of the archive.

        Raises:
            OhmwardError: a file cannot be written; its rows stay.
        """
        end_ns = int(before_unix_s * 1e9) // _DAY_NS * _DAY_NS
        return [
            done
            for kind in KINDS
            for day in self._days(kind, end_ns)
            for done in iter(partial(self._archive_piece, kind, day), None)
        ]

    def _days(self, kind: str, end_ns: int) -> list[int]:
        query = f"SELECT DISTINCT unix_ns / {_DAY_NS} FROM {kind} WHERE unix_ns < ? ORDER BY 1"
        return [day for (day,) in self._database.execute(query, (end_ns,))]

    def archive_excess(self, most_bytes: int) -> list[Archived]:
        """Move the oldest rows to the archive, whatever their day, until the database has at most `most_bytes`.

        Raises:
            OhmwardError: a file cannot be written; its rows stay.
        """
        done: list[Archived] = []
        while self._database_bytes() > most_bytes:
            first = {kind: self._database.execute(f"SELECT MIN(unix_ns) FROM {kind}").fetchone()[0] for kind in KINDS}
            kind = min(KINDS, key=lambda kind: _LAST_NS if first[kind] is None else first[kind])
            if first[kind] is None or (piece := self._archive_piece(kind, first[kind] // _DAY_NS)) is None:
                break
            done.append(piece)
        return done

    def _archive_piece(self, kind: str, day: int) -> Archived | None:
        """Move the first rows of a day to a file; None if it has none."""
        where = "WHERE unix_ns >= ? AND unix_ns < ?"
        span = day * _DAY_NS, (day + 1) * _DAY_NS
        first, last, rows = self._database.execute(
            f"SELECT MIN(id), MAX(id), COUNT(*) FROM (SELECT id FROM {kind} {where} ORDER BY id LIMIT ?)",
            (*span, ARCHIVE_ROWS),
        ).fetchone()
        if not rows:
            return None
        columns = self._select(kind, self.names(kind), f"{where} AND id <= ?", (*span, last))
        date = datetime.fromtimestamp(day * DAY_S, UTC).strftime("%Y-%m-%d")
        name = f"{kind}-{date}-{first:08d}-{last:08d}.parquet"
        write_table(columns, self.archive / name)
        entry = Archived(name, kind, rows, int(columns["unix_ns"][0]), int(columns["unix_ns"][-1]))
        with self._transaction() as database:
            database.execute("INSERT INTO archive VALUES (?, ?, ?, ?, ?)", entry)
            database.execute(f"DELETE FROM {kind} {where} AND id <= ?", (*span, last))
        return entry

    def prune(self, most_bytes: int) -> list[str]:
        """Remove old conditions, and the oldest archive files while the store exceeds `most_bytes`; names of these."""
        removed = []
        with self._transaction() as database:
            too_old = "rowid <= (SELECT MAX(rowid) - ? FROM condition)"
            database.execute(f"DELETE FROM condition WHERE {too_old}", (MOST_CONDITIONS,))
        for entry in self.archived():
            if self.size_bytes() <= most_bytes:
                break
            with self._transaction() as database:
                database.execute("DELETE FROM archive WHERE name = ?", (entry.name,))
            (self.archive / entry.name).unlink(missing_ok=True)
            removed.append(entry.name)
        return removed

    def _database_bytes(self) -> int:
        """Size of the database without its free pages."""
        words = ("page_count", "freelist_count", "page_size")
        pages, free, page_bytes = (self._database.execute(f"PRAGMA {word}").fetchone()[0] for word in words)
        return int((pages - free) * page_bytes)

    @contextmanager
    def _transaction(self) -> Iterator[sqlite3.Connection]:
        try:
            with self._database:
                yield self._database
        except sqlite3.Error as error:
            self._columns = {kind: self.names(kind) for kind in KINDS}
            raise self._refusal("written", error) from error

    @contextmanager
    def reading(self) -> Iterator[None]:
        """Turn errors of reading the database into ones with a fix.

        Raises:
            OhmwardError: it is damaged.
        """
        try:
            yield
        except sqlite3.Error as error:
            raise self._refusal("read", error) from error

    def _refusal(self, done: str, error: Exception) -> OhmwardError:
        """Error of a database that cannot be opened, read or written."""
        path = self.folder / DATABASE
        damaged = isinstance(error, sqlite3.DatabaseError) and not isinstance(error, sqlite3.OperationalError)
        advice = (
            "it is damaged or no store: move it away, a new one takes the archive over"
            if damaged
            else {"written": "is the disk full?"}.get(done, "may it be read, and the folder be written?")
        )
        return OhmwardError(f"{path}: cannot be {done} ({error}); {advice}")

    # ---- reading

    def names(self, kind: str) -> list[str]:
        """Columns of a kind of rows in the database."""
        return [row[1] for row in self._database.execute(f"PRAGMA table_info({kind})")][2:]

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
        """Size of the database, without its free pages, and of the archive."""
        return self._database_bytes() + sum(path.stat().st_size for path in self.archive.glob("*.parquet"))

    def read(
        self, kind: str, names: Sequence[str] | None = None, since_s: float = -1e10, until_s: float = 1e10
    ) -> Columns:
        """Columns (T,) in the order of time, `unix_ns` first; nan where a row has no value.

        A file of the archive that cannot be read is left out and logged.

        names: columns wanted, None for all; since_s, until_s: on the wall clock, both included.

        Raises:
            InputError: unknown kind.
        """
        if kind not in KINDS:
            raise InputError(f"there are rows of {' and '.join(KINDS)}, not {kind!r}")
        span = int(max(since_s, -9e9) * 1e9), int(min(until_s, 9e9) * 1e9)
        pieces = []
        for entry in self._archived_between(kind, *span):
            with _leaving_out_damage():
                pieces.append(read_archive(self.archive / entry.name, names))
        wanted = [name for name in self.names(kind) if names is None or name in names]
        pieces.append(self._select(kind, wanted, "WHERE unix_ns >= ? AND unix_ns <= ?", span))
        return between(joined(pieces, names), *span)

    def conditions(self, since_s: float = 0.0) -> list[ConditionRow]:
        """Conditions since a time, in order."""
        query = "SELECT unix_ns, name, level, message FROM condition WHERE unix_ns >= ? ORDER BY unix_ns, rowid"
        return [ConditionRow(*row) for row in self._database.execute(query, (int(since_s * 1e9),))]

    def thinned(self, kind: str, names: Sequence[str], since_ns: int, until_ns: int, step_ns: int) -> Columns:
        """The first row of each step of time, as `read`; the cost grows with the steps, not with the rows.

        As in `read`, a file of the archive that cannot be read is left out.
        """
        wanted = tuple(name for name in self.names(kind) if name in names)
        pieces, seen = [], -1
        for entry in self._archived_between(kind, since_ns, until_ns):
            if entry.last_ns // step_ns == seen:  # its only step already has a row
                continue
            with _leaving_out_damage():
                pieces.append(thinned_archive(self.archive / entry.name, wanted, step_ns))
                seen = entry.last_ns // step_ns
        pieces.append(self._first_of_each(kind, wanted, since_ns, until_ns, step_ns))
        return first_of_each(between(joined(pieces, names), since_ns, until_ns), step_ns)

    def _first_of_each(self, kind: str, names: Sequence[str], since_ns: int, until_ns: int, step_ns: int) -> Columns:
        """First row of each step in the database, with one index lookup per step."""
        columns = ", ".join(["unix_ns", *map(quoted, names)])
        query = f"SELECT {columns} FROM {kind} WHERE unix_ns BETWEEN ? AND ? ORDER BY unix_ns LIMIT 1"
        rows: list[tuple] = []
        while row := self._database.execute(query, (since_ns, until_ns)).fetchone():
            rows.append(row)
            since_ns = (row[0] // step_ns + 1) * step_ns
        times = {"unix_ns": np.array([row[0] for row in rows], dtype=np.int64)}
        return times | {name: np.array([row[k] for row in rows], dtype=float) for k, name in enumerate(names, 1)}

    def _archived_between(self, kind: str, first_ns: int, last_ns: int) -> list[Archived]:
        return [a for a in self.archived() if a.kind == kind and a.first_ns <= last_ns and a.last_ns >= first_ns]

    def _select(self, kind: str, names: Sequence[str], where: str, span: Sequence[int]) -> Columns:
        columns = ", ".join(["unix_ns", *map(quoted, names)])
        cursor = self._database.execute(f"SELECT {columns} FROM {kind} {where} ORDER BY unix_ns, id", span)
        times, values = [np.empty(0, np.int64)], [np.empty((0, len(names)))]
        while rows := cursor.fetchmany(_ROWS_OF_NUMBERS):
            times.append(np.array([row[0] for row in rows], dtype=np.int64))
            values.append(np.array([row[1:] for row in rows], dtype=float))
        table = np.concatenate(values)
        return {"unix_ns": np.concatenate(times)} | {name: table[:, k] for k, name in enumerate(names)}


@contextmanager
def _leaving_out_damage() -> Iterator[None]:
    """Log an archive file that cannot be read, and go on."""
    try:
        yield
    except OhmwardError as error:
        LOG.warning("store: rows are left out: %s", error)


def totals_of_store(folder: Path, capacity_Ah: float) -> Totals:
    """The totals of everything in a store, read a day at a time.

    capacity_Ah: of the battery; inf without one, which counts no cycles.

    Raises:
        OhmwardError: there is no store, or it cannot be read.
    """
    totals = Totals()
    with closing(Store(folder, read_only=True)) as store:
        for columns in _by_day(store, "battery", ("battery_current_A", "battery_voltage_V")):
            totals = _with_battery(totals, columns, capacity_Ah)
        for columns in _by_day(store, "drive", ("distance_m",)):
            length_m = columns.get("distance_m", np.empty(0))
            known_m = length_m[np.isfinite(length_m)]
            grown_m = np.diff(known_m)  # the path restarts at each start of the process
            totals = totals.after_drive(0.0, float(np.sum(np.where(grown_m >= 0.0, grown_m, known_m[1:]))))
    return totals


def _by_day(store: Store, kind: str, names: Sequence[str]) -> Iterator[Columns]:
    """Rows of a day at a time, after the last row of the previous day: the first step of the day begins there."""
    rows, first_ns, last_ns = store.span_ns(kind)
    last_row: Columns = {}
    begin_s, end_s = 1e-9 * first_ns - 1.0, 1e-9 * last_ns + 1.0  # whole nanoseconds do not fit into a float
    for day_s in np.arange(begin_s, end_s, DAY_S) if rows else ():
        columns = store.read(kind, names, day_s, day_s + DAY_S)
        if last_row:
            columns = joined([last_row, columns], names)
        if len(columns["unix_ns"]):
            last_row = {name: column[-1:] for name, column in columns.items()}
        yield columns


def _with_battery(totals: Totals, columns: Columns, capacity_Ah: float) -> Totals:
    """The totals with the rows of a day added; the charge in each direction counts at its mean voltage."""
    nothing = np.full(len(columns["unix_ns"]), math.nan)
    dt_s = np.diff(1e-9 * columns["unix_ns"], prepend=math.nan)
    charge_Ah = np.where((dt_s > 0.0) & (dt_s <= TOTALS_GAP_S), dt_s / SECONDS_PER_HOUR, math.nan)
    charge_Ah = charge_Ah * columns.get("battery_current_A", nothing)
    voltage_V = columns.get("battery_voltage_V", nothing)
    for way in (charge_Ah > 0.0, charge_Ah < 0.0):
        known = way & np.isfinite(voltage_V)
        whole_Ah, known_Ah = float(np.sum(charge_Ah[way])), float(np.sum(charge_Ah[known]))
        mean_V = float(np.sum(charge_Ah[known] * voltage_V[known])) / known_Ah if known_Ah else math.nan
        totals = totals.plus_charge(whole_Ah, mean_V, capacity_Ah) if whole_Ah else totals
    return totals
