"""Parquet in blocks: the same columns whatever their length."""

import subprocess
import sys

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.logs import FileHints, frame, write_table
from ohmward.logs.frame import open_parquet
from ohmward.logs.read import open_table
from ohmward.logs.table import numbers

pyarrow = pytest.importorskip("pyarrow")
parquet = pytest.importorskip("pyarrow.parquet")


def load(path, *names, progress=None):
    file = open_parquet(path, FileHints())
    return file.load(names or file.names, progress)


def test_blocks_make_the_whole(tmp_path, monkeypatch):
    path, rng = tmp_path / "t.parquet", np.random.default_rng(0)
    columns = {
        "x": pyarrow.array(rng.standard_normal(1000), mask=rng.random(1000) < 0.1),
        "single": pyarrow.array(rng.standard_normal(1000).astype(np.float32)),
        "ns": pyarrow.array(17 * 10**17 + np.arange(1000)),
        "day": pyarrow.array(np.arange(1000).astype("M8[D]")),
        "word": pyarrow.array([f"w{k}" for k in range(1000)]),
        "took": pyarrow.array(np.arange(1000).astype("m8[ms]")),
    }
    parquet.write_table(pyarrow.table(columns), path, row_group_size=300)
    whole = load(path)
    monkeypatch.setattr(frame, "_DECODED_ROWS", 70)
    told = []
    blocks = load(path, progress=lambda done, total: told.append((done, total)))
    for name, values in whole.columns.items():
        assert blocks.columns[name].dtype == values.dtype
        np.testing.assert_array_equal(blocks.columns[name], values)
    np.testing.assert_array_equal(blocks.columns["x"], columns["x"].to_numpy(zero_copy_only=False))
    np.testing.assert_array_equal(blocks.columns["ns"], columns["ns"].to_numpy())
    np.testing.assert_array_equal(blocks.columns["took"], np.arange(1000).astype("m8[ms]"))
    np.testing.assert_array_equal(numbers(blocks, "took"), np.arange(1000) / 1000)
    np.testing.assert_array_equal(blocks.line, np.arange(1, 1001))
    assert told[0] == (70, 1000) and told[-1] == (1000, 1000)


def test_whole_numbers_of_which_a_late_one_is_missing(tmp_path, monkeypatch):
    monkeypatch.setattr(frame, "_DECODED_ROWS", 2)
    path = tmp_path / "t.parquet"
    parquet.write_table(pyarrow.table({"n": [1, 2, 3, None, 5, 6]}), path)
    np.testing.assert_array_equal(load(path).columns["n"], [1, 2, 3, np.nan, 5, 6])


def test_only_the_columns_asked_for_are_read(tmp_path):
    path = tmp_path / "t.parquet"
    write_table({"a": np.ones(3), "pack.b": np.ones(3), "pack": np.ones(3)}, path)
    assert list(load(path, "pack", "other").columns) == ["pack"]
    assert list(load(path, "pack.b").columns) == ["pack.b"]


def test_texts_with_decimal_commas_are_numbers(tmp_path):
    parquet.write_table(pyarrow.table({"a": ["1,5", "-2,25", ""]}), tmp_path / "a.parquet")
    np.testing.assert_array_equal(load(tmp_path / "a.parquet").columns["a"], [1.5, -2.25, np.nan])


def test_a_name_twice_is_refused(tmp_path):
    path = tmp_path / "t.parquet"
    parquet.write_table(pyarrow.table([pyarrow.array([1.0])] * 2, names=["a", "a"]), path)
    with pytest.raises(InputError, match=r"t\.parquet: more than one column is named 'a'; rename them"):
        open_parquet(path, FileHints())


def test_a_file_without_rows_is_refused(tmp_path):
    path = tmp_path / "t.parquet"
    write_table({"a": np.empty(0)}, path)
    with pytest.raises(InputError, match=r"t\.parquet: the file has columns but no rows; a log needs samples"):
        load(path)


@pytest.mark.parametrize("keep", [100, -1])
def test_a_file_that_was_cut_off_is_refused(tmp_path, keep):
    path = tmp_path / "t.parquet"
    write_table({"a": np.arange(1000.0)}, path)
    path.write_bytes(path.read_bytes()[:keep])
    with pytest.raises(InputError, match=r"t\.parquet: not a readable Parquet file .*write it again"):
        load(path)


def test_a_file_with_a_damaged_page_is_refused(tmp_path):
    path = tmp_path / "t.parquet"
    write_table({"a": np.arange(10_000.0)}, path)
    content = bytearray(path.read_bytes())
    content[40:400] = bytes(360)
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"t\.parquet: the Parquet file is damaged .*write it again"):
        load(path)


def test_numbers_of_measurements_are_written_without_a_dictionary(tmp_path):
    path = tmp_path / "t.parquet"
    write_table({"x": np.arange(1000.0), "flags": np.zeros(1000, dtype=int), "word": np.array(["a"] * 1000)}, path)
    group = parquet.ParquetFile(path).metadata.row_group(0)
    assert [group.column(k).has_dictionary_page for k in range(3)] == [False, True, True]


@pytest.mark.parametrize(
    "kind", ["int8", "uint8", "int16", "uint32", "int64", "uint64", "halffloat", "float", "double"]
)
@pytest.mark.parametrize("missing", [0.0, 0.3, 1.0])
def test_numbers_of_every_kind_and_length(tmp_path, monkeypatch, kind, missing):
    rng = np.random.default_rng(1)
    column = pyarrow.array(rng.integers(0, 100, 1000).astype(float), mask=rng.random(1000) < missing).cast(kind)
    parquet.write_table(pyarrow.table({"x": column}), tmp_path / "t.parquet", row_group_size=97)
    monkeypatch.setattr(frame, "_DECODED_ROWS", 31)
    found = load(tmp_path / "t.parquet").columns["x"]
    assert found.dtype == (float if missing or "in" not in kind else np.int64)
    np.testing.assert_array_equal(found, column.cast("double").to_numpy(zero_copy_only=False))


def test_fields_of_structures_are_columns(tmp_path):
    """As Spark writes messages; a missing structure has missing fields."""
    packs = [{"bms": {"voltage": 13.0 + k, "current": k}, "on": True} for k in range(5)]
    table = pyarrow.table({"t": [0.0, 1.0, 2.0, 3.0, 4.0, 5.0], "pack": [*packs, None]})
    parquet.write_table(table, tmp_path / "t.parquet")
    with (
        (tmp_path / "t.feather").open("wb") as stream,
        pytest.importorskip("pyarrow.ipc").new_file(stream, table.schema) as writer,
    ):
        writer.write_table(table)
    for source in (tmp_path / "t.parquet", tmp_path / "t.feather", table):
        file = open_table(source)
        voltage = next(name for name in file.names if name.endswith("voltage"))
        np.testing.assert_array_equal(file.load([voltage]).columns[voltage], [13, 14, 15, 16, 17, np.nan])
        assert len(file.names) == 4


def test_reading_and_writing_do_not_wait_for_pandas(tmp_path):
    write_table({"a": np.array([1.0, np.nan]), "n": np.arange(2)}, tmp_path / "t.parquet")
    code = (
        "import sys; from ohmward.logs import write_table; from ohmward.logs.read import open_table\n"
        f"table = open_table({str(tmp_path / 't.parquet')!r}).load(['a', 'n'])\n"
        f"write_table(table.columns, {str(tmp_path / 'u.parquet')!r}); print('pandas' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "False\n"


def test_arrays_of_every_layout_are_written(tmp_path):
    columns = {
        "strided": np.arange(20.0)[::2],
        "swapped": np.arange(10.0).astype(">f8"),
        "single": np.arange(10, dtype=np.float32),
        "small": np.arange(10, dtype=np.uint8),
        "word": np.array(list("abcdefghij")),
        "flag": np.arange(10) % 2 == 0,
        "list": list(range(10)),
    }
    write_table(columns, tmp_path / "t.parquet")
    found = load(tmp_path / "t.parquet").columns
    for name, values in columns.items():
        np.testing.assert_array_equal(found[name], values)


def test_a_lack_of_memory_is_no_damage(tmp_path, monkeypatch):
    write_table({"a": np.ones(3)}, tmp_path / "t.parquet")

    def full(*_):
        raise pyarrow.ArrowMemoryError("malloc of size 80 GB failed")

    monkeypatch.setattr(frame, "_columns", full)
    with pytest.raises(MemoryError, match="80 GB"):
        load(tmp_path / "t.parquet")
