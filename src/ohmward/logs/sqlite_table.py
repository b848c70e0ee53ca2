"""Databases of SQLite that are no recording of ROS: the tables of a logger."""

from __future__ import annotations

import sqlite3
from collections.abc import Collection, Iterator, Mapping
from contextlib import closing, contextmanager
from pathlib import Path

from ohmward.errors import InputError
from ohmward.logs.arrays import plain_array
from ohmward.logs.bags.sqlite_file import connect
from ohmward.logs.columns import has_log, listed
from ohmward.logs.hints import TOPIC, FileHints
from ohmward.logs.long_table import as_wide
from ohmward.logs.table import Note, Progress, Table, TableFile, parsing, row_numbers


def open_sqlite_table(path: Path, hints: FileHints) -> TableFile:
    """The columns of the table that holds a log, or else of the one with the most rows; `--topic` names another."""
    with _database(path) as database:
        tables = {name: (columns, rows) for name, columns, rows in _tables(database) if len(columns) > 1 and rows}
    if not tables:
        raise InputError(f"{path.name}: no table of this database has rows of two columns; export its log as CSV")
    best = max(tables, key=lambda name: (has_log(tables[name][0]), tables[name][1]))
    return _table_file(path, best, {name: columns for name, (columns, _) in tables.items()}, hints)


@contextmanager
def _database(path: Path) -> Iterator[sqlite3.Connection]:
    with parsing(path, "no readable database of SQLite", "export its log as CSV"), closing(connect(path)) as database:
        yield database


def _tables(database: sqlite3.Connection) -> Iterator[tuple[str, tuple[str, ...], int]]:
    """Name, columns and number of rows of each table and view."""
    names = [name for (name,) in database.execute("SELECT name FROM sqlite_master WHERE type IN ('table', 'view')")]
    for name in names:
        columns = tuple(row[1] for row in database.execute(f"PRAGMA table_info({_quoted(name)})"))
        (rows,) = database.execute(f"SELECT count(*) FROM {_quoted(name)}").fetchone()
        yield name, columns, rows


def _table_file(path: Path, table: str, tables: Mapping[str, tuple[str, ...]], hints: FileHints) -> TableFile:
    """The columns of one table."""

    def part(kind: str, where: Mapping[str, float | str]) -> TableFile:
        wanted = str(where.get(TOPIC, table))
        if wanted not in tables:
            raise InputError(f"{path.name}: there is no table {wanted!r}; it has: {listed(list(tables))}")
        return _table_file(path, wanted, tables, hints) if wanted != table else here

    def load(names: Collection[str], progress: Progress | None = None) -> Table:
        chosen = [name for name in tables[table] if name in names] or list(tables[table])
        with _database(path) as database:
            query = f"SELECT {', '.join(map(_quoted, chosen))} FROM {_quoted(table)}"
            columns = list(zip(*database.execute(query), strict=True)) or [()] * len(chosen)
        arrays = {name: plain_array(list(values)) for name, values in zip(chosen, columns, strict=True)}
        note = Note(f"table {table!r} of {listed(list(tables))}")
        return Table(path.name, arrays, row_numbers(1, len(columns[0])), "row", (note,))

    with _database(path) as database:
        rows = database.execute(f"SELECT * FROM {_quoted(table)} LIMIT 100").fetchall()
    first = dict(zip(tables[table], zip(*rows, strict=True), strict=False))
    head = {name: tuple(map(str, cells)) for name, cells in first.items() if any(isinstance(c, str) for c in cells)}
    here = as_wide(TableFile(path.name, tables[table], load, head=head, hints=hints))._replace(choose=part)
    return here


def _quoted(name: str) -> str:
    """A name as SQL writes it."""
    return '"' + name.replace('"', '""') + '"'
