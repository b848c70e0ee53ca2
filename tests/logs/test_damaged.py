"""Damaged logs of all formats: refused, or a log that can be; benchmarks/log_fuzz.py takes as many as one likes."""

import gzip
import struct
import warnings
import zipfile
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.io import savemat

from logs.formats.containers import old_workbook
from logs.formats.mutation import damaged, written
from ohmward.errors import InputError, OhmwardError
from ohmward.logs import read_log
from ohmward.logs.battery_columns import find_cells
from ohmward.logs.read import open_table


@pytest.mark.parametrize("seed", [1, 2])
def test_a_damaged_file_is_read_or_refused(seed, tmp_path):
    read = 0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for path in damaged(written(tmp_path).values(), np.random.default_rng(seed), 250):
            try:
                log = read_log(path)
            except OhmwardError:
                continue
            read += 1
            assert (np.diff(log.time_s) > 0).all()
            assert not np.isinf(log.current_A).any() and not np.isinf(log.voltage_V).any()
    assert read > 10


def test_a_damaged_frame_is_read_or_refused():
    pytest.importorskip("polars")
    from logs.formats.frames import damaged_frame

    rng, read = np.random.default_rng(1), 0
    for _ in range(100):
        frame = damaged_frame(rng)
        try:
            log = read_log(frame)
        except OhmwardError:
            continue
        read += 1
        assert (np.diff(log.time_s) > 0).all()
        assert not np.isinf(log.current_A).any() and not np.isinf(log.voltage_V).any()
    assert read > 5


_CELLS = {
    "a cell far away": '<row r="1"><c r="A1"><v>1</v></c></row><row r="1048576"><c r="XFD1048576"><v>2</v></c></row>',
    "with a prefix": '<x:c r="A1"/><x:c r="XFD1048576"/>',
    "rows far away, cells without a place": '<row r="1"><c/></row><row r="1048576">'
    + "<c><v>1</v></c>" * 20
    + "</row>",
    "other quotes": "<c r='A1'/><c s='1'\nr = 'XFD1048576'/>",
}
_SHEET = "xl/worksheets/sheet1.xml"


def workbook(path, part, content):
    """A workbook with a part that its size is told from."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as book:
        book.writestr(part, content)
    return path


@pytest.mark.parametrize("kind", _CELLS)
def test_a_workbook_with_a_cell_far_away_is_refused(tmp_path, kind):
    """Its parser would ask for the memory of all cells between, and end the process."""
    sheet = f'<worksheet xmlns:x="x"><sheetData>{_CELLS[kind]}</sheetData></worksheet>'
    with pytest.raises(InputError, match=r"span [\d,]+ cells, more than 524,288; delete the cells far from the log"):
        read_log(workbook(tmp_path / "log.xlsx", _SHEET, sheet))


def test_a_table_of_open_document_with_a_cell_far_away_is_refused(tmp_path):
    table = (
        "<table:table><table:table-row><table:table-cell office:value-type='float'/></table:table-row>"
        "<table:table-row table:number-rows-repeated='1048575'><table:table-cell table:number-columns-repeated='9000'/>"
        "<table:table-cell office:value-type='float'/></table:table-row></table:table>"
    )
    content = f"<content xmlns:table='t' xmlns:office='o'>{table}</content>"
    with pytest.raises(InputError, match="span 9,438,232,576 cells"):
        read_log(workbook(tmp_path / "log.ods", "content.xml", content))


def test_a_binary_workbook_with_a_cell_far_away_is_refused(tmp_path):
    """Records: their kind, their size, the number of the row or column."""
    first = b"\0\x04" + (0).to_bytes(4, "little") + b"\x05\x04" + (0).to_bytes(4, "little")
    other = b"\x93\x01\x84\0" + b"\0" * 4
    last = b"\0\x04" + (1048575).to_bytes(4, "little") + b"\x05\x04" + (16383).to_bytes(4, "little")
    with pytest.raises(InputError, match="span 17,179,869,184 cells"):
        read_log(workbook(tmp_path / "log.xlsb", "xl/worksheets/sheet1.bin", first + other + last))


def test_a_workbook_of_excel_97_with_a_cell_far_away_is_refused(tmp_path):
    path = old_workbook(tmp_path)
    content = bytearray(path.read_bytes())
    first_number = content.index(b"\x03\x02\x0e\x00")
    content[first_number + 4 : first_number + 8] = struct.pack("<HH", 65535, 255)
    path.write_bytes(content)
    with pytest.raises(InputError, match="span 16,777,216 cells, more than 524,288"):
        read_log(path)


def test_a_panic_of_a_parser_is_a_refusal(tmp_path, monkeypatch):
    """That of a package in Rust is no Exception."""
    panic = type("PanicException", (BaseException,), {})

    def from_path(path):
        raise panic("assertion failed")

    monkeypatch.setattr("python_calamine.CalamineWorkbook", SimpleNamespace(from_path=from_path))
    with pytest.raises(InputError, match=r"no readable workbook \(assertion failed\); save it again"):
        read_log(old_workbook(tmp_path))


def test_a_workbook_that_unpacks_to_gigabytes_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("ohmward.logs.workbook_file.MOST_BYTES", 1 << 20)
    with pytest.raises(InputError, match="unpacks to more than"):
        read_log(workbook(tmp_path / "log.xlsx", "xl/sharedStrings.xml", "a" * (2 << 20)))


@pytest.mark.parametrize("line", ["1,1,1\n", "1"])
def test_a_gzip_file_that_unpacks_to_far_more_than_a_log_is_refused(tmp_path, monkeypatch, line):
    """Of rows, or of one line without an end."""
    monkeypatch.setattr("ohmward.logs.csv_layout.UNPACKED_BYTES", 1 << 18)
    path = tmp_path / "log.csv.gz"
    path.write_bytes(gzip.compress(f"time_s,current_A,voltage_V\n0,1,1\n1,1,1\n{line * (1 << 22)}".encode()))
    with pytest.raises(
        InputError, match=r"log.csv.gz: the gzip file unpacks to more than .* unpack it with gunzip first"
    ):
        read_log(path)


@pytest.mark.parametrize("compressed", [False, True])
def test_the_arrays_of_matlab_are_those_that_scipy_reads(tmp_path, compressed):
    t = np.arange(30.0)
    arrays = {"t": t, "small": t.astype("i1"), "count": t.astype("u2"), "single": t.astype("f4"), "on": t > 5}
    fields = {"meas": {"t": t + 1, "name": "4S", "count": 3.0}, "z": t + 1j}
    path = tmp_path / "log.mat"
    savemat(path, {**arrays, "log": fields, "note": "4S"}, do_compression=compressed)
    table = open_table(path).load(("t", "small", "count", "single", "on", "log.meas.t"))
    assert {*table.columns} == {*arrays, "log.meas.t"}
    np.testing.assert_array_equal(table.columns["log.meas.t"], t + 1)
    for name, values in arrays.items():
        np.testing.assert_array_equal(table.columns[name], values)


def test_a_matlab_file_with_an_element_of_no_type_is_refused(tmp_path):
    """The reader of scipy ends the process."""
    path = tmp_path / "log.mat"
    savemat(path, {"time_s": np.arange(30.0), "current_A": np.ones(30)})
    content = bytearray(path.read_bytes())
    at = content.index(struct.pack("<II", 9, 240))
    content[at] = 66
    path.write_bytes(content)
    with pytest.raises(InputError, match="no readable MATLAB file"):
        read_log(path)


def test_cells_that_were_never_measured_are_none(tmp_path):
    """Neither a warning of NumPy nor a sentence about NaN."""
    rows = [f"{k},{-1 - k % 2},{12 - 0.05 * (k % 2)},," for k in range(40)]
    path = tmp_path / "log.csv"
    path.write_text("\n".join(["time_s,current_A,voltage_V,cell_voltage_1_V,cell_voltage_2_V", *rows]))
    log = read_log(path, current_sign="charge")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert find_cells(log.extra, log.voltage_V, 2) == (None, ())


def test_a_stamp_of_many_digits_in_line_protocol_is_no_time(tmp_path):
    stamps = ["1" + "0" * 400, *(str(1_770_000_000_000_000_000 + k * 10**9) for k in range(1, 20))]
    path = tmp_path / "log.txt"
    path.write_text("\n".join(f"bat current={k % 3},voltage=12.{k % 3} {stamp}" for k, stamp in enumerate(stamps)))
    assert len(read_log(path, current_sign="charge")) == 19


def test_a_number_of_many_digits_in_json_is_no_measurement(tmp_path):
    """A whole number has as many digits as it likes there; beyond the largest float it is infinite."""
    rows = [f'{{"time_s": {k}, "current_A": -1, "voltage_V": {"9" * 400 if k == 3 else 12}}}' for k in range(20)]
    path = tmp_path / "log.jsonl"
    path.write_text("\n".join(rows), encoding="utf-8")
    log = read_log(path, current_sign="charge")
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(log.voltage_V)), [3])
