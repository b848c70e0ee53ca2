import asyncio
import json

import numpy as np
import pytest

from ohmward import generic_battery, load_robot, read_drive, read_log, save_battery
from ohmward.cli.main import main
from ohmward.onboard.feed import Feed
from ohmward.onboard.sinks.store import StoreSink
from onboard.page_server import drive


@pytest.fixture(autouse=True)
def stored(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    feed = Feed()
    for state in drive():
        feed.put(state)
    feed.end()
    asyncio.run(StoreSink("store").run(feed))


def test_list_says_what_is_there(capsys, as_json):
    assert main(["store", "list", "store"]) == 0
    said = capsys.readouterr().out
    assert "battery: 40 rows, " in said and "soc_std" in said and "WARN  battery_voltage_V: reads 99" in said
    found = as_json("store", "list", "store")
    assert found["kinds"]["drive"]["rows"] == 40 and found["conditions"][0]["name"] == "source can0"


def test_query_gives_rows_as_csv_and_json(capsys, as_json):
    assert main(["store", "query", "store", "--names", "soc,soc_std", "--every", "10"]) == 0
    head, *rows = capsys.readouterr().out.splitlines()
    assert head == "time_s,unix_time_s,soc,soc_std" and len(rows) == 4
    assert rows[0].startswith("0.0,1800000000.0,0.")
    found = as_json("store", "query", "store", "--kind", "drive", "--from", "2027-01-15 00:00:02+00:00")
    assert json.dumps(found) and "estimated_speed_m_s" in found


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".mcap"])
def test_an_export_is_a_log_that_every_command_reads(suffix, capsys):
    assert main(["store", "export", "store", "-o", f"day{suffix}"]) == 0
    log = read_log(f"day{suffix}", current_sign="charge")
    assert len(log) == 40
    assert log.voltage_V[0] == 13.2 and log.current_A[0] == -3.0


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".mcap"])
def test_an_export_of_the_drive_has_every_sensor_of_the_drive(suffix, capsys):
    assert main(["store", "export", "store", "--kind", "drive", "-o", f"drive{suffix}"]) == 0
    log = read_drive(f"drive{suffix}", load_robot("rlma"))
    assert len(log) == 40 and np.all(log.wheel_speed_rad_s == 5.0) and np.all(log.motor_current_A == 0.8)
    assert log.channels == ("yaw_rate_rad_s",) and np.all(log.yaw_rate_rad_s == 0.1)


@pytest.mark.parametrize("command", ["slip", "doctor", "mission"])
def test_an_export_of_both_is_read_by_the_commands_for_a_drive(command, capsys):
    assert main(["store", "export", "store", "--kind", "both", "-o", "both.csv"]) == 0
    save_battery(generic_battery("lfp", 12.0, 4), "battery.toml")
    battery = ["--battery", "battery.toml", "--current-sign", "charge"] if command == "mission" else []
    assert main([command, "both.csv", "--robot", "rlma", *battery]) in (0, 1)  # 1: something is wrong with the drive


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("list", "nowhere"), "there is no store"),
        (("export", "store"), "export needs -o FILE"),
        (("list", "store", "-o", "x.csv"), "only export takes it"),
        (("query", "store", "--names", "charge"), "there is no column 'charge'; there are: "),
        (("query", "store", "--to", "2000-01-01"), "there are no rows of battery in that time"),
        (("query", "store", "--from", "yesterday"), "must be like '2026-11-22 08:00'"),
    ],
)
def test_refusals(words, message, refused):
    assert message in refused("store", *words)


def test_a_time_may_be_counted_back_from_now(refused):
    assert "no rows" in refused("store", "query", "store", "--from", "10min", "--to", "5min")
