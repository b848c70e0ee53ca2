import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.logs.selection import explain_recordings, find_separators, select_rows
from ohmward.logs.table import Table


def table(**columns):
    arrays = {name: np.asarray(values) for name, values in columns.items()}
    return Table("f.csv", arrays, np.arange(2, 2 + len(next(iter(arrays.values())))), "line")


TIME_S = np.array([0.0, 1.0, 0.0, 1.0, 0.0, 1.0, 5.0, 6.0])
RESTARTS = np.array([2, 4])


def explain(rows):
    return explain_recordings(rows, "time", RESTARTS, find_separators(rows, "time", RESTARTS))


def test_numbers_and_text_select():
    rows = table(
        run=[1, 2, 2, 3], mode=np.array(["REST", "DCHG", "REST", "REST"], dtype=object), x=[0.0, 1.0, 2.0, 3.0]
    )
    np.testing.assert_array_equal(select_rows(rows, {"run": "2"}).columns["x"], [1.0, 2.0])
    picked = select_rows(rows, {"run": 2.0, "mode": "REST"})
    np.testing.assert_array_equal(picked.columns["x"], [2.0])
    np.testing.assert_array_equal(picked.line, [4])
    assert [note.text for note in picked.notes] == ["rows with run = 2.0: 2 of 4", "rows with mode = REST: 1 of 2"]


@pytest.mark.parametrize(
    ("where", "message"),
    [
        ({"run": 7}, "no row has run = 7; the values are 1, 2, 3"),
        ({"run": "x"}, "no row has run = x"),
        ({"rum": 1}, r"no such column \(did you mean 'run'\?\); it has: 'run'"),
    ],
)
def test_selecting_nothing_raises(where, message):
    with pytest.raises(InputError, match=message):
        select_rows(table(run=[1, 2, 3]), where)


def test_one_column_separates():
    rows = table(time=TIME_S, run=[1, 1, 2, 2, 3, 3, 3, 3], step=[1, 2, 1, 2, 1, 2, 2, 2])
    assert find_separators(rows, "time", RESTARTS) == ("run",)


def test_two_columns_separate_together():
    """Temperature 5 holds scripts 1 and 2, temperature 25 script 1 again; neither column is enough."""
    rows = table(time=TIME_S, temp=[5, 5, 5, 5, 25, 25, 25, 25], script=[1, 1, 2, 2, 1, 1, 1, 1])
    assert find_separators(rows, "time", RESTARTS) == ("temp", "script")
    text = explain(rows)
    assert "the time falls from 1 s to 0 s at line 4" in text
    assert "'temp' (5, 25) and 'script' (1, 2)" in text
    assert "--where temp=5 --where script=1 (where={'temp': 5, 'script': 1})" in text


def test_without_a_separating_column_the_number_of_the_recording_chooses():
    rows = table(time=TIME_S, step=[1, 2, 1, 2, 1, 2, 2, 2])
    assert find_separators(rows, "time", RESTARTS) == ()
    assert "--where recording=1 (where={'recording': 1}; there are 3)" in explain(rows)


def test_arguments_are_quoted_for_the_shell():
    rows = table(time=TIME_S, **{"floor name": np.array(["a b"] * 2 + ["c"] * 2 + ["d"] * 4, dtype=object)})
    assert "--where 'floor name=a b'" in explain(rows)


def test_dates_tell_recordings_apart():
    days = np.array(["2026-01-01"] * 2 + ["2026-01-02"] * 2 + ["2026-01-03"] * 4, dtype="M8[D]")
    assert "--where day=2026-01-01" in explain(table(time=TIME_S, day=days))
    picked = select_rows(table(time=TIME_S, day=days), {"day": "2026-01-02"})
    np.testing.assert_array_equal(picked.columns["time"], [0.0, 1.0])
