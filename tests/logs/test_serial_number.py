"""The serial number of the battery in a log."""

import pytest

from ohmward.battery.chemistries import generic_battery
from ohmward.fleet.learning import BatteryFiles, by_battery
from ohmward.logs.battery_columns import serial_column
from ohmward.logs.log import ReadOptions
from ohmward.logs.read import open_table
from ohmward.logs.selection import labels_in


@pytest.mark.parametrize(
    "name", ["serial", "Serial No.", "battery_serial", "pack_serial_number", "batterySerialNumber"]
)
def test_its_column_is_known_by_name(name):
    assert serial_column(("time_s", name, "current_A")) == name


@pytest.mark.parametrize("name", ["serial_port", "robot_serial", "cell", "series"])
def test_other_columns_are_not(name):
    assert serial_column((name,)) is None


@pytest.mark.parametrize(
    "cells, found",
    [
        (["A7", "A7", "A7"], ["A7"]),
        (["A7", "", "B8"], ["A7", "B8"]),
        (["1204", "1204", "1204"], ["1204"]),
        (["12.0", "", "13.0"], ["12", "13"]),
        (["", "", ""], []),
    ],
)
def test_the_values_are_texts_in_order(tmp_path, cells, found):
    rows = "".join(f"{t},-1.0,{3.7 - 0.1 * t},{cell}\n" for t, cell in enumerate(cells))
    path = tmp_path / "log.csv"
    path.write_text(f"time_s,current_A,voltage_V,serial\n{rows}")
    assert labels_in(open_table(path), "serial") == found


def test_rows_that_are_selected_have_the_number_that_selects_them(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("time_s,current_A,voltage_V,serial\n0,-1,3.7,A\n1,-1,3.7,B\n")
    text = f"{path}:serial=B"
    assert by_battery(text, ReadOptions(), BatteryFiles(generic_battery("nmc", 12.0), None)) == [(text, "B")]


def test_a_file_without_the_column_has_none(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("time_s,current_A,voltage_V\n0,-1,3.7\n1,-2,3.6\n")
    assert by_battery(str(path), ReadOptions(), BatteryFiles(generic_battery("nmc", 12.0), None)) == [(str(path), "")]
