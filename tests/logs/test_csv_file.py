import gzip
from time import process_time

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.logs import read_log
from ohmward.logs.columns import unique_names
from ohmward.logs.csv_file import open_csv


def load(path):
    file = open_csv(path)
    return file.load(file.names)


PLAIN = "time_s,current_A,voltage_V\n0,1.5,12.25\n1,-2,12.5\n2,,12\n"


@pytest.mark.parametrize(
    ("text", "encoding"),
    [
        (PLAIN, "utf-8"),
        (PLAIN, "utf-8-sig"),
        (PLAIN, "utf-16"),
        (PLAIN.replace("\n", "\r\n"), "utf-8"),
        (PLAIN.replace(",", ";"), "utf-8"),
        (PLAIN.replace(",", "\t"), "utf-8"),
        (PLAIN.replace(",", ";").replace(".", ","), "utf-8"),
        (PLAIN.replace(",", "\t").replace(".", ","), "utf-8"),
        (PLAIN.replace(",", " , "), "utf-8"),
        ("# made by hand\n# at 20 °C\n\n" + PLAIN, "utf-8"),
        ("# 20 °C\n" + PLAIN, "cp1252"),
        ("% " + PLAIN, "utf-8"),
        ("#" + PLAIN, "utf-8"),
        (PLAIN.replace("time_s,", '"time_s",').replace("2,,", '"2","",'), "utf-8"),
        (PLAIN.replace("2,,", "2,NaN,"), "utf-8"),
        (PLAIN.replace("2,,", "2, null ,"), "utf-8"),
        (PLAIN.rstrip("\n"), "utf-8"),
        (PLAIN.replace("\n", "\n\n"), "utf-8"),
        (PLAIN.replace("12.25\n", "12.25,\n"), "utf-8"),
    ],
)
def test_every_dialect_gives_the_same_numbers(write_text, text, encoding):
    table = load(write_text(text, encoding=encoding))
    assert list(table.columns) == ["time_s", "current_A", "voltage_V"]
    np.testing.assert_array_equal(table.columns["time_s"], [0.0, 1.0, 2.0])
    np.testing.assert_array_equal(table.columns["current_A"], [1.5, -2.0, np.nan])
    np.testing.assert_array_equal(table.columns["voltage_V"], [12.25, 12.5, 12.0])


def test_gzip(tmp_path):
    path = tmp_path / "log.csv.gz"
    path.write_bytes(gzip.compress(PLAIN.encode()))
    np.testing.assert_array_equal(load(path).columns["voltage_V"], [12.25, 12.5, 12.0])


def test_a_gzip_file_in_another_is_unpacked_and_a_third_refused(tmp_path):
    path = tmp_path / "log.csv.gz"
    packed = gzip.compress(gzip.compress(PLAIN.encode()))
    path.write_bytes(packed)
    np.testing.assert_array_equal(read_log(path, current_sign="charge").time_s, [0.0, 1.0, 2.0])
    path.write_bytes(gzip.compress(packed))
    with pytest.raises(InputError, match="packed with gzip more than twice"):
        read_log(path)


def test_groups_above_equal_names_tell_them_apart(write_text):
    text = ",Battery,,Motor,\nElapsed,Voltage,Current,Voltage,Current\ns,V,A,V,A\n0,12,1,5,2\n1,12.1,2,5,3\n"
    log = read_log(write_text(text), current_sign="charge")
    np.testing.assert_array_equal(log.voltage_V, [12.0, 12.1])
    np.testing.assert_array_equal(log.current_A, [1.0, 2.0])


@pytest.mark.parametrize("names", ["Reading,Unit,Value,Unit", "Measured Value,Measured Unit,Source Value,Source Unit"])
def test_units_in_a_column_behind_the_values_are_theirs(write_text, names):
    """A buffer of Keithley; the time to the fraction of a second is another column than that of the day."""
    rows = [f"{3.9 + 0.1 * k},Volt DC,{k},Amp DC,05/14/2026,09:00:0{k // 2},{k / 2}" for k in range(6)]
    log = read_log(write_text("\n".join([f"{names},Date,Time,Relative Time", *rows])), current_sign="charge")
    np.testing.assert_allclose(log.voltage_V, 3.9 + 0.1 * np.arange(6))
    np.testing.assert_array_equal(log.current_A, np.arange(6.0))
    np.testing.assert_array_equal(log.time_s, np.arange(6) / 2)


def test_a_name_that_begins_like_a_duration_is_a_name(write_text):
    table = load(write_text("Time(s),P1 V,P1 A\n0,12,1\n1,12.1,2\n"))
    assert list(table.columns) == ["Time(s)", "P1 V", "P1 A"]


def test_the_error_of_a_package_in_place_of_zlib_is_a_damaged_gzip_file(tmp_path, monkeypatch):
    """isal, which a package for cyclers puts in the place of zlib, has an error of its own."""

    def fail(*args):
        raise type("IsalError", (Exception,), {})("Invalid deflate block found")

    path = tmp_path / "log.csv.gz"
    path.write_bytes(gzip.compress(PLAIN.encode()))
    monkeypatch.setattr("gzip._GzipReader.read", fail)
    with pytest.raises(InputError, match=r"log.csv.gz: the gzip file is damaged .Invalid deflate block"):
        read_log(path)


def test_a_damaged_gzip_file_is_named(tmp_path):
    path = tmp_path / "log.csv.gz"
    packed = bytearray(gzip.compress(PLAIN.encode()))
    packed[-6] ^= 1
    path.write_bytes(packed)
    with pytest.raises(InputError, match=r"log.csv.gz: the gzip file is damaged"):
        load(path)


def test_a_gzip_file_is_read_up_to_where_it_was_cut_off(tmp_path):
    path = tmp_path / "log.csv.gz"
    path.write_bytes(gzip.compress(PLAIN.encode())[:-9])
    table = load(path)
    np.testing.assert_array_equal(table.columns["voltage_V"], [12.25, 12.5, 12.0])
    assert "the gzip file is cut off" in str(table.notes[-1])


def test_lines_may_be_quoted_as_a_whole(write_text):
    table = load(write_text('"time_s,note,a"\n"0,""x, y"",1.5"\n"1,""z"",2.5"\n'))
    np.testing.assert_array_equal(table.columns["a"], [1.5, 2.5])


def test_quoted_names_may_contain_the_delimiter(write_text):
    table = load(write_text('"time, s","current, A"\n0,1\n1,2\n'))
    assert list(table.columns) == ["time, s", "current, A"]


def test_commas_in_names_are_not_delimiters_when_the_rows_have_none(write_text):
    table = load(write_text("time;voltage (V, mean, raw, x);current\n0;12;1\n"))
    assert list(table.columns) == ["time", "voltage (V, mean, raw, x)", "current"]


def test_a_column_without_a_name_is_passed_over(write_text):
    """The index that pandas writes."""
    table = load(write_text(",time_s,current_A\n0,5,1\n1,6,2\n"))
    assert list(table.columns) == ["time_s", "current_A"]
    np.testing.assert_array_equal(table.columns["time_s"], [5.0, 6.0])


def test_lines_are_counted_as_an_editor_counts_them(write_text):
    table = load(write_text("# one\n# two\n" + PLAIN))
    np.testing.assert_array_equal(table.line, [4, 5, 6])


def test_blocks_join(write_text, monkeypatch):
    monkeypatch.setattr("ohmward.logs.csv_file._PARSED_ROWS", 7)
    rows = [f"{i},{i % 5},{'x1' if i == 20 else i}" for i in range(40)]
    table = load(write_text("time_s,a,b\n" + "\n".join(rows)))
    np.testing.assert_array_equal(table.columns["time_s"], np.arange(40.0))
    np.testing.assert_array_equal(table.line, np.arange(2, 42))
    assert table.columns["b"][20] == "x1"
    assert float(table.columns["b"][39]) == 39.0


def test_a_few_words_among_numbers_are_missing_and_counted(write_text):
    rows = [f"{k},{'OL' if k in (3, 9) else k},{'1..2' if k == 9 else k}" for k in range(30)]
    table = load(write_text("time_s,a,b\n" + "\n".join(rows)))
    expected = np.where(np.isin(np.arange(30), (3, 9)), np.nan, np.arange(30.0))
    np.testing.assert_array_equal(table.columns["a"], expected)
    assert table.columns["b"].dtype == object, "a cell with digits may be a number in another notation"
    (note,) = table.notes
    assert str(note) == "warning: 2 cells of 'a' treated as missing: no number ('OL')"


def test_lines_of_text_among_the_rows_are_left_out_and_counted(write_text):
    rows = [f"{k},{k}" for k in range(9)]
    rows[2:2] = ["[W][wifi] reconnect"]
    table = load(write_text("time_s,a\n" + "\n".join([*rows, "end of log"])))
    np.testing.assert_array_equal(table.columns["a"], np.arange(9.0))
    expected = "warning: 2 lines of text left out, the first in line 4: '[W][wifi] reconnect'"
    assert [str(note) for note in table.notes] == [expected]


def test_a_row_with_a_date_is_no_header(write_text):
    rows = [f"sensor.u,{'unavailable' if k == 0 else 13.0},2026-05-03 07:15:{k:02d}" for k in range(20)]
    assert open_csv(write_text("\n".join(["entity_id,state,last_changed", *rows]))).names[:2] == ("entity_id", "state")


def test_words_in_many_cells_stay_text(write_text):
    rows = [f"{k},{'idle' if k % 4 == 0 else k}" for k in range(30)]
    assert load(write_text("time_s,state\n" + "\n".join(rows))).columns["state"].dtype == object


@pytest.mark.parametrize("tail", ["3,1.0", "3", "3,\0\0\0\0"])
def test_a_last_line_cut_by_a_power_failure_is_dropped_and_noted(write_text, tail):
    table = load(write_text(PLAIN + tail))
    assert table.line.size == 3
    assert [str(note) for note in table.notes] == ["warning: the last line (5) is cut off: dropped"]


@pytest.mark.parametrize(("last", "rows"), [("7,13.", 7), ("7,1", 7), ("7,13.25", 8), ("7,13.2\n", 8), ("7", 7)])
@pytest.mark.parametrize("worth", [0, 1 << 20])
def test_a_last_number_with_fewer_decimals_than_all_others_is_cut_off(write_text, monkeypatch, last, rows, worth):
    monkeypatch.setattr("ohmward.logs.csv_file.WORTH_BYTES", worth)
    text = "time_s,voltage_V\n" + "".join(f"{k},13.{k}5\n" for k in range(7)) + last
    assert load(write_text(text)).line.size == rows
    assert load(write_text(text.replace(".", ".0"))).line.size == rows


def test_zeros_that_a_power_failure_left_in_a_line_cost_that_line(write_text):
    """The end of the line before them and the beginning of the line after them stand in one line."""
    rows = [f"{k},1.0,{12 + 0.1 * k:.1f}" for k in range(5)]
    table = load(
        write_text("\n".join(["time_s,current_A,voltage_V", *rows[:2], f"{rows[2][:3]}{64 * chr(0)}.0", *rows[3:]]))
    )
    np.testing.assert_array_equal(table.columns["time_s"], [0.0, 1.0, 3.0, 4.0])
    assert [note.text for note in table.notes] == ["zeros of a power failure in 1 line (first in line 4): left out"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "the file is empty"),
        ("\n\n# nothing\n", "the file is empty"),
        ("time_s,current_A,voltage_V\n", "no rows below it"),
        ("0,1,12\n1,1,12\n", r"no header line: the first row is numbers \('0,1,12'\)"),
        ("time_s\n1\n2\n", "only one column found"),
        ("t," + "1," * 40 + "\nu," + "2," * 40 + "\ni," + "3," * 40, "a quantity in each line .*exchange its rows"),
        ("a,b\n1,2\n1,2,3\n4,5\n", r"line 3: 3 cells where the header has 2"),
        ("a,b\n1,2\n1\n4,5\n", r"line 3: 1 cells where the header has 2"),
        ("a,b,c\n" + "1,2,3\n" * 29 + "b,a,c\n" + "1,2,3\n" * 9, r"another header \(b, a, c\) stands below 29 rows"),
        ("a,b,c\n" + "1,2,3\n" * 9 + "b,a,c\n" + "1,2,3\n" * 20, r"another header \(b, a, c\) stands below 9 rows"),
        ("a,b\0\0\0\n1,2\n", "not a text table"),
        ("a,b\n1,2\n3,4\n" + "\0\x01\xff\n" * 9, "damaged from line 4 on.*head -n 3"),
    ],
)
def test_malformed_files_are_refused(write_text, text, message):
    with pytest.raises(InputError, match=message):
        load(write_text(text))


def test_a_million_rows_take_seconds(tmp_path):
    path = tmp_path / "long.csv"
    path.write_text("time_s,current_A,voltage_V\n" + "".join(f"{i},-1.25,12.5\n" for i in range(100_000)))
    table = load(path)
    assert table.line.size == 100_000


def test_a_name_that_stands_twice_is_in_nobody_s_way(write_text):
    """A second temperature or note is kept under a number; the first temperature counts, and a note says so."""
    rows = "".join(f"{k},12.1,-1.5,{20 + k},{30 + k},n\n" for k in range(4))
    log = read_log(write_text(f"time_s,Voltage (V),Current (A),Temp,Temp,Units\n{rows}"), current_sign="charge")
    np.testing.assert_array_equal(log.temperature_degC, [20.0, 21.0, 22.0, 23.0])
    np.testing.assert_array_equal(log.extra["Temp 2"], [30.0, 31.0, 32.0, 33.0])
    assert any("temperature from 'Temp'" in note.text for note in log.notes)


def test_of_two_voltages_of_one_name_one_is_chosen_by_the_user(write_text):
    path = write_text("time_s,U (V),U (V),I (A)\n0,12,24,1\n1,12,24,2\n")
    with pytest.raises(InputError, match=r"both 'U \(V\)' and 'U 2 \[V\]' may be the voltage"):
        read_log(path, current_sign="charge")
    chosen = read_log(path, current_sign="charge", columns={"voltage": "U 2 [V]"})
    np.testing.assert_array_equal(chosen.voltage_V, [24.0, 24.0])


def test_a_decimal_after_points_between_thousands_is_refused(write_text):
    rows = [f"{k};{-1.2 * (k % 9 < 4) or 0:.3f};13.{k % 1000:03d}" for k in range(3000)]
    text = "\n".join(["time_s;current_mA;voltage_mV", *rows, "3000;0;12.5"]).replace(";0.000", ";0")
    with pytest.raises(InputError, match=r"log.csv, column 'voltage_mV': the point in '12\.5' stands before decimals"):
        read_log(write_text(text))


@pytest.mark.parametrize("place", range(4))
@pytest.mark.parametrize("row", [7, 4999])
def test_a_quoted_cell_may_have_line_breaks(write_text, place, row):
    """Also where a block of lines ends in it; the cell has as many commas as make a row of its last line."""
    rows = [[f"{k}", f"{-1.5 - k % 3}", f"{12.1 - 0.1 * (k % 3):.1f}"] for k in range(5003)]
    for k, cells in enumerate(rows):
        cells.insert(place, '"he said ""stop""\nand, 5, 7"' if k == row else "none")
    names = ["time_s", "current_A", "voltage_V"]
    names.insert(place, "remark")
    log = read_log(write_text("".join(",".join(cells) + "\n" for cells in (names, *rows))), current_sign="charge")
    np.testing.assert_array_equal(log.time_s, np.arange(5003.0))
    np.testing.assert_allclose(log.current_A, -1.5 - np.arange(5003) % 3)
    assert not [note for note in log.notes if note.level == "warning"]


def test_zeros_behind_the_last_line_are_a_line_that_was_cut_off(write_text):
    rows = "".join(f"{k},-1.5,12.{k}\n" for k in range(9))
    log = read_log(write_text(f"time_s,current_A,voltage_V\n{rows}{chr(0) * 500}"), current_sign="charge")
    assert len(log) == 9
    assert [note.text for note in log.notes if note.level == "warning"] == ["the last line (11) is cut off: dropped"]


def test_the_time_to_name_columns_grows_with_their_number():
    names = [f"x{k}" for k in range(30_000)]
    start_s = process_time()
    assert unique_names(names) == tuple(names)
    assert process_time() - start_s < 3.0


def test_a_log_of_a_logger_without_its_sensor_is_refused(write_text):
    rows = "".join(f"{k},0,0\n" for k in range(50))
    with pytest.raises(InputError, match=r"no measured voltage is left \(50 rows of 0 A and 0 V left out"):
        read_log(write_text(f"time_s,current_A,voltage_V\n{rows}"), current_sign="charge")
