"""`ohmward health` by hand: months of logs in, a trend and the time left out."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cli.examples import MODEL, NOISE
from fleet.examples import BATTERY, day, write
from ohmward.battery.battery import Battery
from ohmward.battery.file import save_battery
from ohmward.cli.main import main
from ohmward.logs import Log, write_log
from ohmward_lab.simulate.voltage import simulate_voltage

KEYS = {"command", "battery", "logs", "days", "cycles", "capacity_new_Ah", "resistance_new_ohm", "capacity_Ah"}
KEYS |= {"discharge_Ah", "emptied", "soh_capacity", "resistance_ratio", "worn_share", "worn_in_days", "worn_within"}
KEYS |= {"capacity_by", "sudden_changes", "off_trend", "notes", "report"}
LOG_KEYS = {"log", "begins", "days", "hours", "cycles", "temperature_degC", "verdict", "reason", "soc_min", "soc_max"}
LOG_KEYS |= {"capacity_Ah", "discharge_Ah", "resistance_ohm", "own_soh_capacity", "own_resistance_ratio", "remark"}
#: Share of the capacity that is left in the months of the logs.
LEFT = {0: 1.0, 9: 0.97, 18: 0.94, 27: 0.91}
_BEGIN_UNIX_S = 1_700_000_000.0


def cycle(month: int, left: float) -> Log:
    """From full down to 10 % with half of 1 C, an hour of rest, and up again; sensors without noise."""
    capacity_Ah = left * MODEL.capacity_Ah
    moved_h = 0.9 * capacity_Ah / 6.0
    time_s = np.arange(0.0, 3600.0 * (2 * moved_h + 3.0), 30.0)
    down, up = (time_s / 3600 > 0.5) & (time_s / 3600 < 0.5 + moved_h), time_s / 3600 > 1.5 + moved_h
    current_A = np.where(down, -6.0, np.where(up & (time_s / 3600 < 1.5 + 2 * moved_h), 6.0, 0.0))
    log = Log(f"month-{month}", time_s, current_A, np.zeros(time_s.size), np.full(time_s.size, 25.0))
    voltage_V = simulate_voltage(replace(MODEL, capacity_Ah=capacity_Ah), log, 1.0).voltage_V
    return replace(log, voltage_V=voltage_V, start_unix_s=_BEGIN_UNIX_S + 30.4 * 86400.0 * month)


@pytest.fixture(scope="module")
def life(tmp_path_factory) -> Path:
    """A folder `logs` of two years, and the file of the new battery; nobody writes into it."""
    folder = tmp_path_factory.mktemp("life")
    (folder / "logs").mkdir()
    for month, left in LEFT.items():
        write_log(cycle(month, left), folder / "logs" / f"month-{month}.csv")
    noise = replace(NOISE, capacity_std=0.06, resistance_std=0.2)
    save_battery(Battery("robot", 12.0, "nmc", 3, 9.0, 12.6, thevenin=MODEL, noise=noise), folder / "new.toml")
    return folder


def test_a_battery_that_ages_is_followed_over_months_and_has_a_page(life, tmp_path, as_json, monkeypatch):
    monkeypatch.chdir(tmp_path)
    found = as_json("health", str(life / "logs"), "--battery", str(life / "new.toml"), "--report", "health.html")
    assert set(found) == KEYS
    assert [set(log) for log in found["logs"]] == [LOG_KEYS] * 4
    assert [log["log"] for log in found["logs"]] == [f"month-{month}" for month in LEFT]
    assert found["days"] == pytest.approx(27 * 30.4, abs=1.0)
    left = found["worn_in_days"]
    assert 30.0 < left["p05"] < left["p50"] < left["p95"]
    assert left["p05"] < 27 * 30.4 * 11 / 9 < left["p95"]
    assert abs(found["soh_capacity"]["mean"] - 0.91) < 2 * found["soh_capacity"]["std"]
    assert found["soh_capacity"]["mean"] == pytest.approx(0.91, abs=0.03)
    own = [log["own_soh_capacity"]["mean"] for log in found["logs"]]
    np.testing.assert_allclose(own, list(LEFT.values()), atol=0.03)
    assert found["sudden_changes"] == []
    page = (tmp_path / "health.html").read_text(encoding="utf-8")
    assert "Capacity over that when new" in page
    assert "month-18" in page


def test_the_text_says_what_the_numbers_mean(life, capsys):
    logs = [str(life / "logs" / f"month-{month}.csv") for month in (9, 0)]
    assert main(["health", *logs, "--battery", str(life / "new.toml"), "--new-capacity-ah", "11.64"]) == 0
    out = capsys.readouterr().out
    assert "health of battery 'robot' over 2 logs, 274 days" in out
    assert "of that when new" in out
    assert "nine in ten" in out
    assert "capacity when new: 11.64 Ah, as given" in out


def test_a_capacity_that_no_log_shows_is_not_known(tmp_path, as_json, capsys):
    """A twentieth of the charge, twice."""
    save_battery(BATTERY, tmp_path / "new.toml")
    logs = [write(tmp_path / f"r_{k}.csv", day(7 * k, 0.65, hours=0.25)) for k in range(2)]
    words = ("health", *logs, "--battery", str(tmp_path / "new.toml"), "--current-sign", "charge")
    found = as_json(*words)
    names = ("soh_capacity", "capacity_by", "worn_in_days", "worn_within")
    assert [found[name] for name in names] == [None] * 4
    assert [log["own_soh_capacity"] for log in found["logs"]] == [None] * 2
    assert main([*words, "--report", str(tmp_path / "health.html")]) == 0
    assert "not known: no log shows it" in capsys.readouterr().out
    assert "Capacity over that when new" not in (tmp_path / "health.html").read_text(encoding="utf-8")


def test_the_battery_file_stays_as_it_is(life, capsys):
    before = (life / "new.toml").read_bytes()
    assert main(["health", str(life / "logs" / "month-0.csv"), "--battery", str(life / "new.toml")]) == 0
    assert (life / "new.toml").read_bytes() == before


def test_a_share_of_nothing_is_refused(life, refused):
    message = refused("health", str(life / "logs"), "--battery", str(life / "new.toml"), "--worn", "0")
    assert "--worn must be above 0" in message


def test_a_folder_without_logs_is_refused(life, tmp_path, refused):
    assert "holds no log" in refused("health", str(tmp_path), "--battery", str(life / "new.toml"))


def test_logs_that_teach_nothing_are_refused_with_the_reason(life, tmp_path, refused):
    write_log(stuck(), tmp_path / "stuck.csv")
    words = ("--battery", str(life / "new.toml"), "--current-sign", "charge")
    message = refused("health", str(tmp_path / "stuck.csv"), *words)
    assert "no log shows the health of this battery (1 given); stuck:" in message


def test_a_file_that_is_no_log_is_left_out_and_named(life, tmp_path, as_json):
    (tmp_path / "readme.csv").write_text("hello\n")
    logs = [str(life / "logs" / "month-0.csv"), str(tmp_path / "readme.csv")]
    found = as_json("health", *logs, "--battery", str(life / "new.toml"))
    assert len(found["logs"]) == 1
    assert any(note.startswith("warning: left out: readme") for note in found["notes"])


def stuck() -> Log:
    """A cycle whose voltage never changes."""
    log = cycle(0, 1.0)
    return replace(log, name="stuck", voltage_V=np.full(len(log), 11.4))
