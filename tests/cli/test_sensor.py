"""Options of the sensors: into a new file; for one run before the file's, and named where they differ."""

import json

import pytest

from ohmward.battery.file import load_battery
from ohmward.cli.main import main

GIVEN = ("--sensor-offset", "0.02", "--sensor-gain", "0.03", "--voltage-gain", "0.005")
SAID = (
    "warning: --sensor-offset 0.02 A was used; the battery file says 0.05 A",
    "warning: --sensor-gain 0.03 was used; the battery file says 0.01",
    "warning: --voltage-gain 0.005 was used; the battery file says 0",
)
SOC = ("soc", "day.csv", "--battery", "battery.toml")


@pytest.mark.parametrize(
    "words",
    [
        ("identify", "test.csv", "--capacity-ah", "12", "--model", "thevenin-1rc"),
        ("generic", "--chemistry", "nmc", "--capacity-ah", "12"),
    ],
    ids=["identify", "generic"],
)
def test_into_a_new_file(words, here, as_json):
    as_given = as_json(*words, *GIVEN, "-o", "new.toml")
    battery = load_battery("new.toml")
    assert (battery.sensor.offset_std_A, battery.sensor.gain_std) == (0.02, 0.03)
    assert battery.noise.voltage_gain_std == 0.005
    assert as_given["sensor"]["offset_std_A"] == 0.02
    assert as_json(*words, "-o", "other.toml")["sensor"]["offset_std_A"] == pytest.approx(0.025 * 12)


def test_for_one_run_and_named(here, as_json):
    usual, given = as_json(*SOC), as_json(*SOC, *GIVEN)
    assert all(text in given["notes"] for text in SAID)
    assert not [note for note in usual["notes"] if "was used" in note]
    assert given["soc_std_final"] != usual["soc_std_final"]
    assert load_battery("battery.toml").sensor.offset_std_A == 0.05


def test_what_the_file_says_contradicts_nothing(here, as_json):
    same = as_json(*SOC, "--sensor-offset", "0.05", "--sensor-gain", "0.01", "--voltage-gain", "0")
    assert not [note for note in same["notes"] if "was used" in note]
    again = as_json(*SOC)["soc_final"]  # perhaps in machine code by now, which rounds as it likes
    assert same["soc_final"] == pytest.approx(again, rel=1e-12)


def test_a_poor_sensor_makes_a_wide_band(here, as_json):
    """Coulomb counting has nothing else to go by."""
    poor, good = (
        as_json(*SOC, "--filter", "coulomb", "--initial-soc", "0.9", "--sensor-offset", a)["soc_std_final"]
        for a in ("0.5", "0.001")
    )
    assert poor > 2 * good


def test_compare_export_fleet_and_twin_take_it(here, as_json, capsys):
    battery = ("--battery", "battery.toml")
    assert all(
        text in as_json("compare", "day.csv", *battery, "--filters", "coulomb", *GIVEN)["notes"] for text in SAID
    )
    assert as_json("export", "battery.toml", "--filter", "coulomb", *GIVEN, "-o", "c")["notes"] == list(SAID)
    fleet = ("fleet", "day.csv", *battery, *GIVEN, "--filter", "coulomb", "--processes", "1", "-o", "out")
    assert [note for note in as_json(*fleet)["notes"] if "each log alone" not in note] == list(SAID)
    capsys.readouterr()
    assert main([*fleet]) == 0
    assert "--sensor-gain 0.03 was used" in capsys.readouterr().out


def test_a_fleet_with_another_sensor_is_another_job(here, capsys):
    fleet = ["fleet", "day.csv", "--battery", "battery.toml", "--filter", "coulomb", "--processes", "1", "-o", "out"]
    assert main([*fleet, "--json"]) == 0
    assert all("each log alone" in note for note in json.loads(capsys.readouterr().out)["notes"])
    assert main([*fleet, *GIVEN]) == 2
    assert "another battery file" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "messages"),
    [
        (("--sensor-offset", "-0.1"), ("--sensor-offset", "standard deviation, >= 0, got -0.1")),
        (("--sensor-offset", "50"), ("--sensor-offset must be below 1 C, 12 A", "for milliamperes write 0.05")),
        (("--rest-current", "50"), ("--rest-current must be below 1 C, 12 A", "for milliamperes write 0.05")),
        (("--sensor-offset", "small"), ("--sensor-offset", "finite number")),
        (("--sensor-gain", "2"), ("--sensor-gain", "is a share", "0.02 for 2 %")),
        (("--sensor-gain", "1"), ("is a share", "0.01 for 1 %")),
        (("--voltage-gain", "1"), ("--voltage-gain", "is a share", "0.01 for 1 %")),
        (("--sensor-gain", "-0.01"), ("is a share between 0 and 0.5, got -0.01",)),
    ],
)
def test_refusals(words, messages, here, refused):
    text = refused(*SOC, *words)
    for message in messages:
        assert message in text


@pytest.mark.parametrize("option", ["--sensor-offset", "--sensor-gain", "--voltage-gain"])
def test_a_robot_has_no_sensors_of_a_battery(option, here, refused):
    assert f"leave out {option}" in refused("export", "rlma", "--filter", "ekf", option, "0.01", "-o", "c")
