"""`ohmward tune` by hand: days in, a battery file with their noise out."""

import json

import numpy as np
import pytest

from battery.tuning.test_tune import KNOWN, battery, driven
from ohmward.battery.file import load_battery, save_battery
from ohmward.battery.tuning.noise_model import NoiseModel, with_factors
from ohmward.cli.main import main
from ohmward.logs import write_log
from ohmward_lab.assess.simulated_logs import simulated_log

KEYS = {"command", "battery", "logs", "voltages", "noise", "innovations_before", "innovations", "log_likelihood_gain"}
KEYS |= {"innovations_over_steps", "explains", "output", "backup", "report"}


@pytest.fixture(scope="module")
def days(tmp_path_factory):
    """A folder with two days, and the battery file, whose voltage is not as noisy as it says."""
    folder, rng = tmp_path_factory.mktemp("days"), np.random.default_rng(4)
    for k in range(2):
        log, _ = simulated_log(NoiseModel(battery()), f"day-{k}", driven(k, 3 * 3600 + 600), 0.95, rng)
        write_log(log, folder / f"day-{k}.csv")
    save_battery(battery(noise=with_factors(KNOWN, np.array([5.0, 1.0, 1.0]))), folder / "battery.toml")
    return folder


def test_it_writes_the_file_that_estimators_then_use(days, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(days)
    words = ["tune", "day-*.csv", "--battery", "battery.toml", "-o", str(tmp_path / "tuned.toml")]
    assert main([*words, "--json", "--report", str(tmp_path / "tune.html")]) == 0
    found = json.loads(capsys.readouterr().out)
    assert set(found) == KEYS and found["logs"] == ["day-0", "day-1"]
    voltage = found["noise"]["voltage"]
    assert voltage["before"] == pytest.approx(0.015) and voltage["after"] == pytest.approx(0.003, rel=0.05)
    assert voltage["low"] < voltage["after"] < voltage["high"] and voltage["refused"] is None
    assert load_battery(tmp_path / "tuned.toml").noise.voltage_std_V == pytest.approx(0.003, rel=0.05)
    assert "With the tuned noise" in (tmp_path / "tune.html").read_text()


def test_it_says_what_it_does_not_tell(days, monkeypatch, capsys):
    monkeypatch.chdir(days)
    assert main(["tune", "day-0.csv", "--battery", "battery.toml"]) == 0
    text = capsys.readouterr().out
    assert "not told: the logs are too short to tell its interval; six hours are needed" in text
    assert "leave no trace in the voltage" in text and "No battery file written; name one with -o." in text


def test_the_battery_file_may_be_overwritten_and_is_kept(days, monkeypatch, capsys):
    monkeypatch.chdir(days)
    before = (days / "battery.toml").read_text()
    assert main(["tune", "day-0.csv", "--battery", "battery.toml", "-o", "battery.toml"]) == 0
    assert (days / "battery.toml.bak").read_text() == before
    assert "before: battery.toml.bak" in capsys.readouterr().out


def test_a_wrong_ending_is_refused_before_the_work(days, monkeypatch, capsys):
    monkeypatch.chdir(days)
    assert main(["tune", "day-0.csv", "--battery", "battery.toml", "-o", "tuned.csv"]) == 2
    assert "--output tuned.csv: the name must end in .toml" in capsys.readouterr().err
