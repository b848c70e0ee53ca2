"""Arrow reads and writes what the standard library does, to the bit and to the letter, or stands back."""

import csv
import gzip
import io
import math

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from ohmward.errors import InputError
from ohmward.logs import csv_file, read_log, write, write_table
from ohmward.logs.csv_file import open_csv
from ohmward.logs.csv_layout import find_layout

pytest.importorskip("pyarrow")


@pytest.fixture(autouse=True)
def always(monkeypatch):
    """However short the table is."""
    monkeypatch.setattr(csv_file, "WORTH_BYTES", 0)
    monkeypatch.setattr(write, "WORTH_ROWS", 0)


def by_the_standard_library(columns):
    stream = io.StringIO()
    cells = [[None if value != value else value for value in values.tolist()] for values in columns]
    csv.writer(stream, lineterminator="\n").writerows(zip(*cells, strict=True))
    return stream.getvalue()


def by_both(monkeypatch, path):
    """What a file holds, or why it is refused, with Arrow and without."""
    with_arrow = outcome(path)
    monkeypatch.setattr(csv_file, "WORTH_BYTES", math.inf)
    return with_arrow, outcome(path)


def outcome(path):
    try:
        file = open_csv(path)
        table = file.load([name for name in file.names if name != "note"])
    except InputError as error:
        return str(error)
    return {name: values.tolist() for name, values in table.columns.items()}, table.line.tolist(), table.notes


@settings(max_examples=300, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(arrays(float, st.integers(1, 50), elements=st.floats()))
def test_every_number_is_written_as_python_writes_it(values):
    with np.errstate(invalid="ignore"):
        assert write.rows_as_text([values, values]) == by_the_standard_library([values, values])


def test_numbers_of_every_size_are_written_as_python_writes_them():
    rng = np.random.default_rng(0)
    spread = rng.choice([-1.0, 1.0], 50_000) * 10.0 ** rng.uniform(-20, 25, 50_000)
    special = [0.0, -0.0, 1e-4, 1e10, 1e16, 5e-324, math.inf, -math.inf, math.nan, 9_007_199_254_740_993.0]
    values = np.concatenate([spread, np.rint(spread), spread.astype(np.float32), special])
    assert write.rows_as_text([values, values]) == by_the_standard_library([values, values])


@pytest.mark.parametrize("kind", ["i8", "u8", "i2", "f4"])
def test_other_kinds_of_numbers(kind):
    values = np.arange(20).astype(kind)
    assert write.rows_as_text([values, values]) == by_the_standard_library([values, values])


def test_an_empty_cell_alone_on_its_line_is_in_quotes(tmp_path):
    write_table({"x": np.array([1.0, np.nan])}, tmp_path / "t.csv")
    assert (tmp_path / "t.csv").read_text() == 'x\n1.0\n""\n'


def test_text_and_conditions_are_left_to_the_standard_library(tmp_path):
    for values in (np.array(["a", "b,c"]), np.array([True, False])):
        assert write.rows_as_text([np.arange(2), values]) is None
    write_table({"n": np.arange(2), "word": np.array(["a", "b,c"])}, tmp_path / "t.csv")
    assert (tmp_path / "t.csv").read_text() == 'n,word\n0,a\n1,"b,c"\n'


@settings(max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(arrays(float, st.tuples(st.integers(1, 20), st.just(3)), elements=st.floats()))
def test_numbers_are_read_back_to_the_bit(tmp_path, table):
    path = tmp_path / "t.csv"
    path.write_text("a,b,c\n" + "".join(",".join(map(repr, row)) + "\n" for row in table.tolist()))
    columns = csv_file.read_numbers(path, find_layout(path), ["c", "a"])
    assert columns is not None
    for name, values in (("c", table[:, 2]), ("a", table[:, 0])):
        np.testing.assert_array_equal(columns[name], values)
        np.testing.assert_array_equal(np.signbit(columns[name]), np.signbit(np.where(np.isnan(values), 1.0, values)))


HEADER = "time_s,current_A,note\n"
ODD = {
    "words": "0,1,a\n1,2,b\n",
    "a word in a number": "0,1,a\n1,high,b\n2,3,c\n",
    "missing": "0,,a\n1,nan,b\n2,NaN,c\n3,NULL,d\n4,n/a,e\n5,-,f\n6,--,g\n7,None,h\n",
    "unusual spellings": "0,+1.5,a\n1,1_000,b\n2, 3 ,c\n3,.5,d\n4,5.,e\n5,1e3,f\n6,Infinity,g\n7,1E400,h\n",
    "text with the delimiter": '0,1,"a,b"\n1,2,c\n',
    "numbers in quotes": '"0","1","a"\n"1","2","b"\n',
    "a text of several lines": '0,1,"a\nb"\n1,2,c\n',
    "an open quote": '0,1,"a\n1,2,b\n',
    "an empty line": "0,1,a\n\n1,2,b\n",
    "a comment": "0,1,a\n# stopped\n1,2,b\n",
    "surplus cells": "0,1,a,\n1,2,b,\n",
    "too few cells": "0,1,a\n1,2\n2,3,c\n",
    "too many cells": "0,1,a\n1,2,b,c\n2,3,d\n",
    "a last line that is cut off": "0,1,a\n1,2,b\n2,3",
    "a last word that is cut off": "0,1,a\n1,2,b\n2,3,",
    "no end of line": "0,1,a\n1,2,b",
    "zeros of a power failure": "0,1,a\n1,2,b\n2,3,c\0\0\0\0",
    "zeros on a line of their own": "0,1,a\n1,2,b\n\0\0\0\0",
    "no rows": "",
    "dates": "2026-01-31T12:00:00Z,1,a\n2026-01-31T12:00:01Z,2,b\n",
    "lines of Windows": "0,1,a\r\n1,2,b\r\n",
    "letters of Windows": "0,1,\xe4\n1,2,\xf6\n",
}


@pytest.mark.parametrize("rows", ODD.values(), ids=ODD.keys())
def test_an_odd_file_gives_the_same_or_is_refused_for_the_same_reason(rows, tmp_path, monkeypatch):
    path = tmp_path / "t.csv"
    path.write_bytes((HEADER + rows).encode("cp1252"))
    with_arrow, without = by_both(monkeypatch, path)
    np.testing.assert_equal(with_arrow, without)


@pytest.mark.parametrize(
    "text",
    [
        "# 20 degC\n\ntime_s;current_A\n0;1,5\n1;2,5\n",
        "time_s\tcurrent_A\n0\t1.5\n1\t2.5\n",
        ",time_s,current_A,\n7,0,1.5,\n8,1,2.5,\n",
        "\ufefftime_s,current_A\n0,1.5\n1,2.5\n",
    ],
)
def test_every_dialect_gives_the_same_numbers_and_lines(text, tmp_path, monkeypatch):
    path = tmp_path / "t.csv"
    path.write_text(text, encoding="utf-8")
    assert csv_file.read_numbers(path, find_layout(path), ["time_s"]) is not None
    with_arrow, without = by_both(monkeypatch, path)
    assert with_arrow == without
    assert with_arrow[0] == {"time_s": [0.0, 1.0], "current_A": [1.5, 2.5]}


@pytest.mark.parametrize("encode", [gzip.compress, lambda text: text.decode().encode("utf-16")])
def test_packed_files_and_wide_letters_are_left_to_the_standard_library(encode, tmp_path, monkeypatch):
    path = tmp_path / "t.csv"
    path.write_bytes(encode(b"time_s,current_A\n0,1.5\n1,2.5\n"))
    with_arrow, without = by_both(monkeypatch, path)
    assert with_arrow == without
    assert with_arrow[0] == {"time_s": [0.0, 1.0], "current_A": [1.5, 2.5]}


def test_without_arrow_the_standard_library_does_it_alone(tmp_path, monkeypatch):
    for module in (csv_file, write):
        monkeypatch.setattr(module, "import_arrow", lambda: None)
    columns = {"time_s": np.arange(3.0), "current_A": np.ones(3), "voltage_V": np.full(3, 12.0)}
    write_table(columns, tmp_path / "t.csv")
    np.testing.assert_array_equal(read_log(tmp_path / "t.csv", current_sign="charge").time_s, columns["time_s"])


def test_short_tables_do_not_wait_for_arrow(tmp_path, monkeypatch):
    monkeypatch.undo()
    for module in (csv_file, write):
        monkeypatch.setattr(module, "import_arrow", lambda: pytest.fail("not for three rows"))
    write_table({"time_s": np.arange(3.0), "x": np.ones(3)}, tmp_path / "t.csv")
    open_csv(tmp_path / "t.csv").load(["time_s"])


def test_progress_ends_at_the_size_of_the_file(tmp_path, monkeypatch):
    path, told = tmp_path / "t.csv", []
    write_table({"a": np.arange(5000.0), "b": np.ones(5000)}, path)
    for _ in range(2):
        open_csv(path).load(["a"], lambda done, total: told.append((done, total)))
        assert told[-1] == (path.stat().st_size,) * 2
        monkeypatch.setattr(csv_file, "WORTH_BYTES", math.inf)
