"""Databases of SQLite of loggers: the table that holds a log, rows for each value, and what is damaged."""

import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from logs.formats.known import LOG
from ohmward.errors import InputError
from ohmward.logs import read_log

DATES = [at.strftime("%Y-%m-%d %H:%M:%S") for at in LOG.moments]


def database(folder: Path, *statements: tuple[str, list]) -> Path:
    path = folder / "logger.db"
    with closing(sqlite3.connect(path)) as found, found:
        for statement, rows in statements:
            found.executemany(statement, rows) if rows else found.execute(statement)
    return path


def with_log(folder: Path, name: str = "battery log") -> Path:
    rows = [(k, date, i, u) for k, (date, (_, i, u, _)) in enumerate(zip(DATES, LOG.rows(), strict=True))]
    return database(
        folder,
        ("CREATE TABLE settings (name TEXT, value TEXT)", []),
        ("INSERT INTO settings VALUES (?, ?)", [(f"setting {k}", "on") for k in range(2 * len(rows))]),
        (f'CREATE TABLE "{name}" (id INTEGER PRIMARY KEY, timestamp TEXT, current REAL, voltage REAL)', []),
        (f'INSERT INTO "{name}" VALUES (?, ?, ?, ?)', rows),
    )


def test_a_view_of_a_table_that_is_gone_is_left_out(tmp_path):
    path = with_log(tmp_path)
    database(tmp_path, ("CREATE VIEW broken AS SELECT * FROM gone", []))
    assert len(read_log(path)) == len(LOG.time_s)


@pytest.mark.parametrize("name", ["battery log", 'a "quoted" one', "log; DROP TABLE settings"])
def test_the_table_that_holds_a_log_is_read_whatever_its_name(tmp_path, name):
    path = with_log(tmp_path, name.replace('"', '""'))
    log = read_log(path)
    np.testing.assert_array_equal(log.current_A, LOG.current_A)
    np.testing.assert_array_equal(log.voltage_V, LOG.voltage_V)
    assert log.start_unix_s == LOG.start.timestamp()


def test_a_table_can_be_named(tmp_path):
    path = with_log(tmp_path)
    with pytest.raises(InputError, match="no column for the time"):
        read_log(path, where={"topic": "settings"})
    with pytest.raises(InputError, match=r"there is no table 'other'; it has: 'settings', 'battery log'"):
        read_log(path, where={"topic": "other"})


@pytest.mark.parametrize(
    "columns",
    ["id, timestamp, current / 2 AS current, voltage", "timestamp, voltage, current / 2 * voltage AS power_W"],
)
def test_of_the_logs_of_two_batteries_one_is_named(tmp_path, columns):
    path = with_log(tmp_path)
    with closing(sqlite3.connect(path)) as found, found:
        found.execute(f'CREATE TABLE left AS SELECT {columns} FROM "battery log"')
    with pytest.raises(
        InputError, match="2 of its tables hold a log of a battery; choose one with --topic 'battery log' or"
    ):
        read_log(path)
    half = read_log(path, where={"topic": "left"}, current_sign="charge").current_A
    np.testing.assert_allclose(half, LOG.current_A / 2, rtol=1e-12)


def test_of_two_long_tables_one_is_named(tmp_path):
    rows = [(date, "current", 1.0) for date in DATES]
    for robot in ("robot_a", "robot_b"):
        path = database(tmp_path, (f"CREATE TABLE {robot} (timestamp TEXT, name TEXT, value REAL)", []))
        database(tmp_path, (f"INSERT INTO {robot} VALUES (?, ?, ?)", rows))
    with pytest.raises(InputError, match="choose one with --topic robot_a or --topic robot_b"):
        read_log(path)


def test_a_row_for_each_value_becomes_a_column_for_each_name(tmp_path):
    rows = [(date, name, value) for date, (_, i, u, _) in zip(DATES, LOG.rows(), strict=True)
            for name, value in (("current", i), ("voltage", u))]  # fmt: skip
    path = database(
        tmp_path,
        ("CREATE TABLE measurements (timestamp TEXT, name TEXT, value REAL)", []),
        ("INSERT INTO measurements VALUES (?, ?, ?)", rows),
    )
    np.testing.assert_array_equal(read_log(path).voltage_V, LOG.voltage_V)


@pytest.mark.parametrize("share", [0.02, 0.4, 0.9])
def test_a_database_that_was_cut_off_is_read_or_refused(tmp_path, share):
    content = with_log(tmp_path).read_bytes()
    path = tmp_path / "cut.db"
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(InputError, match=r"cut.db.*(SQLite|database|bag|table)"):
        read_log(path)


def test_text_that_is_no_utf_8_is_read(tmp_path):
    path = database(tmp_path, ("CREATE TABLE log (time REAL, current REAL, voltage REAL, note TEXT)", []))
    rows = [(t, i, u) for t, i, u, _ in LOG.rows()]
    with closing(sqlite3.connect(path)) as found, found:
        found.executemany("INSERT INTO log VALUES (?, ?, ?, CAST(x'61CB62' AS TEXT))", rows)
    np.testing.assert_array_equal(read_log(path).voltage_V, LOG.voltage_V)
