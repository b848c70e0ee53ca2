"""Logs in workbooks: elapsed times, summaries below the rows, and two tables side by side."""

from collections.abc import Iterable
from datetime import timedelta
from pathlib import Path

import numpy as np
import openpyxl
import pytest

from ohmward.errors import InputError
from ohmward.logs import Log, read_log

NAMES = ("time", "I", "U")
ROWS = [(float(k), -1.0 - 0.1 * (k % 7), 12.5 - 0.01 * (k % 7)) for k in range(20)]


def saved(folder: Path, rows: Iterable[Iterable]) -> Path:
    book = openpyxl.Workbook()
    for row in rows:
        book.active.append(row)
    book.save(folder / "log.xlsx")
    return folder / "log.xlsx"


def assert_read(log: Log) -> None:
    np.testing.assert_array_equal(np.column_stack([log.time_s, log.current_A, log.voltage_V]), ROWS)


def test_elapsed_times_are_seconds_also_beyond_a_day(tmp_path):
    beyond_s = 90_000.25
    rows = [(timedelta(seconds=beyond_s + t), i, u) for t, i, u in ROWS]
    log = read_log(saved(tmp_path, [("elapsed", "I", "U"), *rows]), current_sign="charge")
    np.testing.assert_allclose(log.time_s - log.time_s[0], [row[0] for row in ROWS])
    assert log.time_s[0] in (0.0, beyond_s)


def test_units_may_stand_in_the_cells(tmp_path):
    rows = [(t, f"{i} A", f"{u} V") for t, i, u in ROWS]
    assert_read(read_log(saved(tmp_path, [NAMES, *rows]), current_sign="charge"))


def test_a_summary_below_the_rows_is_left_out_with_a_warning(tmp_path):
    rows = [NAMES, *ROWS, [], ("mean", "", 12.4)]
    log = read_log(saved(tmp_path, rows), current_sign="charge")
    assert_read(log)
    assert any("treated as missing: no number ('mean')" in note.text for note in log.notes)


def test_two_tables_side_by_side_are_a_question(tmp_path):
    path = saved(tmp_path, [(*NAMES, "", *NAMES), *((*row, None, *(2 * x for x in row)) for row in ROWS)])
    with pytest.raises(InputError, match=r"tables side by side.* --column 'voltage=U 2'"):
        read_log(path)
    assert_read(read_log(path, current_sign="charge", columns={"time": "time", "current": "I", "voltage": "U"}))
    other = read_log(path, current_sign="charge", columns={"time": "time 2", "current": "I 2", "voltage": "U 2"})
    np.testing.assert_array_equal(other.current_A, [2 * row[1] for row in ROWS])


def test_a_second_time_is_no_temperature(tmp_path):
    path = saved(tmp_path, [("t", "I", "U", "t"), *((*row, row[0]) for row in ROWS)])
    assert read_log(path, current_sign="charge").temperature_degC is None
