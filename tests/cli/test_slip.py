"""`ohmward slip` from the outside: figures, files, refusals."""

import csv
import math

import numpy as np
import pytest

from cli.drives import WHEELS, drive, write_drive
from ohmward.cli.main import main
from ohmward.cli.slip import _friction, _turn
from ohmward.logs import read_drive
from ohmward.traction import RLMA, ROBOTINO, save_robot

SLIP = ("slip", "drive.csv", "--robot", "rlma", "--filter", "ekf")
TRUTH = ("--truth", "speed_true_m_s,yaw_rate_true_rad_s")

KEYS = {
    "command", "log", "robot", "terrain", "filter", "steps", "seconds", "duration_s", "distance_m", "speed_min_m_s",
    "speed_max_m_s", "speed_final_m_s", "speed_std_final_m_s", "slip_episodes", "immobilised_episodes",
    "unobserved_share", "friction_ratio", "friction_std", "grade_rad", "grade_std_rad", "radius_ratio", "radius_std",
    "fits", "flags", "truth", "notes", "output", "report", "travel_slip_mean", "travel_slip_std", "floor_share",
    "floor_crossings", "pose",
}  # fmt: skip
SCORES = {
    "speed_rmse_m_s", "speed_max_error_m_s", "speed_coverage_95", "slip_rmse", "coverage_95", "false_alarm_rate",
    "detection_rate",
}  # fmt: skip


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_drive(tmp_path / "drive.csv")
    return tmp_path


def test_keys_are_always_the_same(folder, as_json):
    assert set(as_json(*SLIP)) == KEYS | SCORES
    assert set(as_json(*SLIP, *TRUTH)) == KEYS | SCORES


def test_the_ice_is_found_and_the_bands_hold(folder, as_json):
    found = as_json(*SLIP[:-1], "ukf", *TRUTH)
    assert found["speed_rmse_m_s"] < 0.02
    assert found["slip_rmse"] < 0.05
    assert found["coverage_95"] > 0.9
    assert found["false_alarm_rate"] < 0.02
    assert found["detection_rate"] > 0.8
    assert {episode["wheel"] for episode in found["slip_episodes"]} == set(WHEELS)
    assert all(1.9 < episode["start_s"] < 2.3 for episode in found["slip_episodes"])
    assert found["immobilised_episodes"] == []


def test_without_a_truth_there_are_no_errors(folder, as_json):
    found = as_json(*SLIP)
    assert all(found[name] is None for name in SCORES | {"truth"})
    assert found["speed_final_m_s"] == pytest.approx(drive()["speed_true_m_s"][-1], abs=0.03)


@pytest.mark.parametrize("name", ["ekf", "aekf", "ukf", "aukf"])
def test_every_filter_runs(folder, as_json, name):
    assert as_json(*SLIP[:-1], name, *TRUTH)["speed_rmse_m_s"] < 0.05


def test_errors_are_those_of_the_estimates_file(folder, as_json):
    found = as_json(*SLIP, *TRUTH, "-o", "estimates.csv")
    with (folder / "estimates.csv").open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    speed = np.array([float(row["speed_m_s"]) for row in rows])
    assert np.sqrt(np.mean((speed - drive()["speed_true_m_s"]) ** 2)) == pytest.approx(
        found["speed_rmse_m_s"], rel=1e-6
    )
    alarms = [row["time_s"] for row in rows if row["front_left_slipping"] == "1"]
    assert float(alarms[0]) == found["slip_episodes"][0]["start_s"]


def test_a_robot_file_is_the_robot(folder, as_json):
    save_robot(RLMA, "robot.toml")
    own, built_in = (as_json(*SLIP, "--robot", robot) for robot in ("robot.toml", "rlma"))
    assert own["speed_final_m_s"] == built_in["speed_final_m_s"]


def test_names_and_units_of_users(folder, as_json):
    columns = drive()
    turning = {
        f"wheel {side}": 60 / (2 * np.pi) * columns[f"front_{side}_wheel_speed_rad_s"] for side in ("left", "right")
    }
    write_drive(folder / "theirs.csv", **{name: None for name in columns if "wheel_speed" in name}, **turning)
    given = [f"--column=front_{side}_wheel_speed=wheel {side}" for side in ("left", "right")]
    theirs = as_json("slip", "theirs.csv", *SLIP[2:], *given, "--unit", "wheel_speed=rpm")
    assert theirs["speed_final_m_s"] == pytest.approx(as_json(*SLIP)["speed_final_m_s"], rel=1e-6)


def test_text_for_people(folder, capsys):
    assert main([*SLIP, *TRUTH]) == 0
    text = capsys.readouterr().out
    for part in ("front left slips from 2.", "true slip inside the 95 % band", "speed at the end", "Assumed:"):
        assert part in text


def test_a_fault_of_the_log_is_told_first(folder, as_json):
    write_drive(folder / "drive.csv", front_left_motor_current_A=-drive()["front_left_motor_current_A"])
    assert "warning: the motor of front left brakes all the way" in as_json(*SLIP)["notes"][0]


def test_the_report(folder):
    assert main([*SLIP, *TRUTH, "--report", "slip.html"]) == 0
    page = (folder / "slip.html").read_text(encoding="utf-8")
    for part in ("Slip, front left", "Friction over the assumed", "Slip episodes", "Against the truth", "Grade"):
        assert part in page


def test_a_report_without_motor_currents(folder):
    write_drive(folder / "drive.csv", **{f"{wheel}_motor_current_A": None for wheel in WHEELS})
    assert main([*SLIP, "--report", "slip.html"]) == 0
    page = (folder / "slip.html").read_text(encoding="utf-8")
    assert "Friction over the assumed" not in page and "no motor currents" in page


def test_the_estimates_are_a_drive_again(folder):
    main([*SLIP, "-o", "estimates.parquet"])
    log = read_drive("estimates.parquet", [place.name for place in RLMA.places], RLMA.driven)
    assert len(log) == drive()["time_s"].size


def test_a_robot_with_other_wheels_is_another_robot(folder, refused):
    assert "no column for the speed of a wheel" in refused("slip", "drive.csv", "--robot", "robotino")
    save_robot(ROBOTINO, "robotino.toml")
    assert "no column for the speed of a wheel" in refused("slip", "drive.csv", "--robot", "robotino.toml")


@pytest.mark.parametrize(
    "words, message",
    [
        (("slip", "none.csv", "--robot", "rlma"), "none.csv: there is no such file"),
        (("slip", "drive.csv", "--robot", "none.toml"), "none.toml: cannot be read"),
        (("slip", "drive.csv"), "the following arguments are required: --robot"),
        ((*SLIP, "--terrain", "lava"), "terrain must be one of dry asphalt"),
        ((*SLIP, "--filter", "kf"), "filter must be one of ekf, aekf, ukf, aukf"),
        ((*SLIP, "--truth", "speed_tru_m_s"), "did you mean 'speed_true_m_s'"),
        ((*SLIP, "--truth", ",yaw_rate_true_rad_s"), "--truth takes the columns of speed, yaw rate, lateral speed"),
        ((*SLIP, "--column", "front_left_wheel=x"), "unknown quantity 'front_left_wheel'"),
        ((*SLIP, "--unit", "wheel_speed=V"), "unit 'V' of the wheel_speed is not known"),
        ((*SLIP, "-o", "drive.csv"), "this file is an input"),
        ((*SLIP, "--report", "slip.pdf"), "the name must end in .html"),
    ],
)
def test_refusals(folder, refused, words, message):
    assert message in refused(*words)


def test_not_a_table_at_all(folder, refused):
    (folder / "noise.csv").write_bytes(bytes(range(256)) * 40)
    refused("slip", "noise.csv", "--robot", "rlma")
    (folder / "empty.csv").write_text("")
    refused("slip", "empty.csv", "--robot", "rlma")
    (folder / "header.csv").write_text("time_s,wl,wr\n")
    refused("slip", "header.csv", "--robot", "rlma")


def test_a_friction_that_the_drive_does_not_tell_has_no_number():
    """83 % known within a factor of four says nothing, whatever its 83."""
    assert _friction(0.83, 0.7) == "not known from this drive (within a factor of 3.9): no wheel pushed hard enough"
    assert _friction(0.83, 0.1) == "83.0 % (68.2 % to 101.0 %) of the ground's"
    assert _friction(None, math.nan) == ""


def test_a_turn_that_can_be_any_has_no_number():
    assert _turn(0.1, 0.01) == "turned by 5.7 ± 1.1 degrees"
    assert _turn(4.2, 20.0) == "turn not known"
