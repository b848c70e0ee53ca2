"""Databases of SQLite: recordings of rosbag2, and the tables of a logger.

Of a recording that is damaged or cut off everything before the damage is read.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from urllib.parse import quote

from ohmward.errors import InputError
from ohmward.logs.bags.recording import Recorded, Recording, Topic, full_type
from ohmward.logs.battery_columns import has_log
from ohmward.logs.columns import argument, listed
from ohmward.logs.frame import plain_array
from ohmward.logs.hints import TOPIC, FileHints
from ohmward.logs.long_table import as_wide, long_columns
from ohmward.logs.table import BATTERY, Note, Progress, Table, TableFile, parsing, row_numbers

MAGIC = b"SQLite format 3\x00"

_CUT = "the file is damaged or cut off, as by a loss of power: everything before that was read"


def open_sqlite(path: Path) -> Recording:
    """The messages of a file of rosbag2; InputError for any other database."""
    with closing(connect(path)) as database:
        topics = _topics(path, database)

    def read(recording: Recording, names: Collection[str] | None) -> Iterator[Recorded]:
        with closing(connect(path)) as database:
            wanted = {key: topic for key, topic in topics.items() if names is None or topic.name in names}
            try:
                for key, received_ns, payload in database.execute("SELECT topic_id, timestamp, data FROM messages"):
                    if key in wanted and isinstance(payload, bytes) and isinstance(received_ns, int):
                        yield Recorded(wanted[key], received_ns, payload)
            except sqlite3.DatabaseError:
                recording.warn(_CUT)

    return Recording(path.name, read, {topic.name: topic for topic in topics.values()}, all_known=True)


def is_bag(path: Path) -> bool:
    """True for the database of a recording, and for one whose tables cannot be read."""
    try:
        with closing(connect(path)) as database:
            names = {name for (name,) in database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
    except sqlite3.DatabaseError:
        return True
    return {"topics", "messages"} <= names or not names


def connect(path: Path) -> sqlite3.Connection:
    """Open the database for reading only; a write-ahead log beside it is read if there is one."""
    mode = "mode=ro" if path.with_name(path.name + "-wal").exists() else "immutable=1"
    database = sqlite3.connect(f"file:{quote(str(path.resolve()))}?{mode}", uri=True)
    database.text_factory = lambda text: text.decode(errors="replace")
    with suppress(sqlite3.DatabaseError):
        database.execute("PRAGMA writable_schema = ON")  # without it a truncated file is refused as a whole
    return database


def _topics(path: Path, database: sqlite3.Connection) -> dict[int, Topic]:
    """The topics by their keys, with definitions where the recorder has written them."""
    try:
        rows = list(database.execute("SELECT id, name, type, serialization_format FROM topics"))
    except sqlite3.DatabaseError as error:
        raise InputError(
            f"{path}: no bag of ROS 2 ({error}); name a .db3 or .mcap file of `ros2 bag record`, or its folder"
        ) from error
    try:
        found = database.execute("SELECT topic_type, encoded_message_definition FROM message_definitions")
        definitions = {full_type(type_): text for type_, text in found if isinstance(type_, str)}
    except sqlite3.DatabaseError:  # written by Humble or before
        definitions = {}
    return {
        key: Topic(name, full_type(type_), form, str(definitions.get(full_type(type_)) or ""))
        for key, name, type_, form in rows
        if all(isinstance(text, str) for text in (name, type_, form))
    }


def open_sqlite_table(path: Path, hints: FileHints) -> TableFile:
    """The columns of the table that holds a log, or else of the one with the most rows; `--topic` names another."""
    with _database(path) as database:
        tables = {name: (columns, rows) for name, columns, rows in _tables(database) if len(columns) > 1 and rows}
    if not tables:
        raise InputError(f"{path.name}: no table of this database has rows of two columns; export its log as CSV")
    best = max(tables, key=lambda name: (_rank(tables[name][0]), tables[name][1]))
    return _table_file(path, best, {name: columns for name, (columns, _) in tables.items()}, hints)


def _rank(columns: Sequence[str]) -> int:
    """2 for the columns of a log, 1 for those of a long table, which may hold one, 0 for others."""
    return 2 * has_log(columns) or int(long_columns(columns) is not None)


@contextmanager
def _database(path: Path) -> Iterator[sqlite3.Connection]:
    with parsing(path, "no readable database of SQLite", "export its log as CSV"), closing(connect(path)) as database:
        yield database


def _tables(database: sqlite3.Connection) -> Iterator[tuple[str, tuple[str, ...], int]]:
    """Name, columns and number of rows of each table and view, but views of tables that are not there."""
    names = [name for (name,) in database.execute("SELECT name FROM sqlite_master WHERE type IN ('table', 'view')")]
    for name in names:
        with suppress(sqlite3.OperationalError):
            columns = tuple(row[1] for row in database.execute(f"PRAGMA table_info({quoted(name)})"))
            (rows,) = database.execute(f"SELECT count(*) FROM {quoted(name)}").fetchone()
            yield name, columns, rows


def _table_file(path: Path, table: str, tables: Mapping[str, tuple[str, ...]], hints: FileHints) -> TableFile:
    """The columns of one table."""

    def part(kind: str, where: Mapping[str, float | str]) -> TableFile:
        wanted = str(where.get(TOPIC, table))
        if wanted not in tables:
            raise InputError(f"{path.name}: there is no table {wanted!r}; it has: {listed(list(tables))}")
        best = max(map(_rank, tables.values()))
        logs = [name for name, columns in tables.items() if best and _rank(columns) == best]
        if kind == BATTERY and TOPIC not in where and len(logs) > 1:
            options = " or ".join(f"--topic {argument(name)}" for name in logs)
            raise InputError(
                f"{path.name}: {len(logs)} of its tables hold a log of a battery; choose one with {options} "
                f"(where={{{TOPIC!r}: {logs[0]!r}}})"
            )
        if wanted != table:
            return _table_file(path, wanted, tables, hints).part(kind, where)
        return here.part(kind, where)._replace(choose=part)

    def load(names: Collection[str], progress: Progress | None = None) -> Table:
        chosen = [name for name in tables[table] if name in names] or list(tables[table])
        with _database(path) as database:
            query = f"SELECT {', '.join(map(quoted, chosen))} FROM {quoted(table)}"
            columns = list(zip(*database.execute(query), strict=True)) or [()] * len(chosen)
        arrays = {name: plain_array(list(values)) for name, values in zip(chosen, columns, strict=True)}
        note = Note(f"table {table!r} of {listed(list(tables))}")
        return Table(path.name, arrays, row_numbers(1, len(columns[0])), "row", (note,))

    with _database(path) as database:
        rows = database.execute(f"SELECT * FROM {quoted(table)} LIMIT 100").fetchall()
    first = dict(zip(tables[table], zip(*rows, strict=True), strict=False))
    head = {name: tuple(map(str, cells)) for name, cells in first.items() if any(isinstance(c, str) for c in cells)}
    here = as_wide(TableFile(path.name, tables[table], load, head=head, hints=hints))
    return here._replace(choose=part)


def quoted(name: str) -> str:
    """A name as SQL writes it, whatever characters it has."""
    return '"' + name.replace('"', '""') + '"'
