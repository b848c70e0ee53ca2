"""`ohmward simulate` from the outside: files, JSON, refusals."""

import csv
import json

import numpy as np
import pytest

from cli.examples import SLIP
from ohmward.cli.main import main
from ohmward.logs import read_drive, read_log
from ohmward.traction import RLMA
from ohmward_lab.cli.simulate import ENERGY
from ohmward_lab.simulate import closed_loop
from ohmward_lab.simulate.closed_loop import drive_log, parse_scenario

SPEED = """\
format = "ohmward-scenario/1"
duration_s = 0.5
observer = { method = "ekf" }
sensors = { encoders = "all", pitch = true, compass = true, speed = { interval_s = 0.1, delay_s = 0.02 } }
commands = [{ speed_m_s = 0.4 }]
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "slip.toml").write_text(SLIP)
    (tmp_path / "speed.toml").write_text(SPEED)
    return tmp_path


def test_the_figures_of_slip_control(folder, as_json):
    found = as_json("simulate", "slip.toml")
    assert found["slip_settle_s"] < 0.4
    assert found["slip_rms_error"] < 0.01
    assert found["speed_rmse_m_s"] is None
    assert found["energy_J_per_m"] == pytest.approx(found["energy_J"] / found["distance_m"])
    assert found["energy_J"] == pytest.approx(sum(found["energy_split_J"].values()), rel=1e-9)
    assert found["energy_split_J"].keys() == ENERGY.keys()
    assert found["soc_final"] < found["soc_initial"] == 0.8


def test_the_figures_of_the_observer(folder, as_json):
    found = as_json("simulate", "speed.toml")
    assert found["slip_settle_s"] is None
    assert found["slip_rms_error"] is None
    assert 0 < found["speed_rmse_m_s"] < 0.02
    assert found["false_alarm_rate"] < 0.1
    assert found["steps"] == 51


@pytest.fixture(scope="module")
def recorded():
    return drive_log(closed_loop.run(parse_scenario(SPEED)))


@pytest.mark.parametrize("name", ["drive.csv", pytest.param("drive.parquet", marks=pytest.mark.slow)])
def test_the_log_reads_back_as_it_was_recorded(folder, recorded, name):
    assert main(["simulate", "speed.toml", "-o", name]) == 0
    read = read_drive(name, [p.name for p in RLMA.places], RLMA.driven)
    for field in ("time_s", "wheel_speed_rad_s", "motor_current_A", "yaw_rate_rad_s", "pitch_rad", "speed_m_s"):
        np.testing.assert_array_equal(getattr(read, field), getattr(recorded, field), err_msg=field)
    for field in ("acceleration_m_s2", "speed_std_m_s", "speed_age_s", "heading_rad"):
        np.testing.assert_array_equal(getattr(read, field), getattr(recorded, field), err_msg=field)
    for truth in ("speed_true_m_s", "front_left_slip_true", "soc_true"):
        np.testing.assert_array_equal(read.extra[truth], recorded.extra[truth], err_msg=truth)


@pytest.mark.slow
def test_the_log_reads_as_one_of_a_battery(folder):
    main(["simulate", "speed.toml", "-o", "drive.csv"])
    log = read_log("drive.csv", current_sign="charge")
    assert len(log) == 51
    assert log.current_A[20:].max() < 0.0
    assert 12.0 < log.voltage_V.min() < log.voltage_V.max() < 14.0


def test_the_report_has_its_plots(folder):
    assert main(["simulate", "speed.toml", "--report", "drive.html"]) == 0
    page = (folder / "drive.html").read_text()
    for title in ("Speed", "Slip, front left", "Torque of the motors", "Friction under", "Where the power goes"):
        assert title in page


def test_the_example_is_a_scenario(folder, capsys):
    assert main(["simulate", "--example"]) == 0
    assert parse_scenario(capsys.readouterr().out).duration_s == 20.0


def test_the_list_names_the_scenarios(folder, as_json, capsys):
    assert "onto-ice" in as_json("simulate", "--list")["scenarios"]
    assert main(["simulate", "--list"]) == 0
    assert "first-drive" in capsys.readouterr().out


@pytest.mark.slow
def test_another_seed_is_another_noise(folder):
    main(["simulate", "speed.toml", "-o", "one.csv"])
    main(["simulate", "speed.toml", "-o", "two.csv", "--seed", "2"])
    one, two = (list(csv.DictReader((folder / name).open())) for name in ("one.csv", "two.csv"))
    assert one[40]["current_A"] != two[40]["current_A"]


def test_an_interrupt_leaves_nothing_half_written(folder, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("ohmward_lab.simulate.closed_loop.loop.ClosedLoopDrive.step", interrupted)
    assert main(["simulate", "speed.toml", "-o", "drive.csv", "--report", "drive.html"]) == 130
    assert sorted(p.name for p in folder.iterdir()) == ["slip.toml", "speed.toml"]


@pytest.mark.parametrize(
    "words, message",
    [
        ((), "name a scenario file, or one of `ohmward simulate --list`"),
        (("nothing",), "nothing: no such file, and no scenario of that name; there are: example"),
        (("nothing.toml",), "nothing.toml: cannot be read"),
        (("speed.toml", "-o", "speed.toml"), "the name must end in .csv, .parquet or .mcap"),
        (("speed.toml", "-o", "none/x.csv"), "there is no folder 'none'"),
        (("bad.toml",), "ground.friction must be > 0 and at most 3, got -0.1"),
    ],
)
def test_what_cannot_be_is_refused(folder, refused, words, message):
    (folder / "bad.toml").write_text(SLIP.replace("0.2", "-0.1"))
    assert message in refused("simulate", *words)


def test_mujoco_that_is_missing_is_said(folder, refused, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "mujoco", None)
    (folder / "mj.toml").write_text(SLIP.replace("duration_s", 'plant = "mujoco"\nduration_s'))
    assert "needs mujoco, which is not installed: pip install mujoco" in refused("simulate", "mj.toml")


@pytest.mark.slow
def test_text_and_json_say_the_same(folder, capsys):
    main(["simulate", "slip.toml"])
    text = capsys.readouterr().out
    main(["simulate", "slip.toml", "--json"])
    found = json.loads(capsys.readouterr().out)
    assert f"{found['slip_settle_s']:.3g} s" in text
    assert "where the energy went" in text


def test_a_battery_file_drives_the_robot(folder, as_json):
    as_json("generic", "--chemistry", "lipo", "--capacity-ah", "8", "--n-series", "10", "-o", "b.toml")
    (folder / "mine.toml").write_text(SLIP + "battery = { file = 'b.toml', start_soc = 0.9 }\n")
    found = as_json("simulate", "mine.toml")
    assert 39.0 < found["voltage_min_V"] < found["voltage_max_V"] < 42.0
    drawn_As = 3600 * 8.0 * (found["soc_initial"] - found["soc_final"])
    assert drawn_As == pytest.approx(found["energy_J"] / found["voltage_max_V"], rel=0.01)


@pytest.mark.slow
def test_the_joystick_duty_is_a_log_of_a_battery_and_of_a_drive(folder):
    assert main(["simulate", "joystick-duty", "-o", "duty.csv"]) == 0
    battery, drive = (
        read_log("duty.csv", current_sign="charge"),
        read_drive("duty.csv", [p.name for p in RLMA.places], 2),
    )
    uphill = (battery.time_s > 5.0) & (battery.time_s < 9.0)
    downhill = (battery.time_s > 15.0) & (battery.time_s < 18.0)
    assert drive.extra["speed_true_m_s"][uphill].min() > 0.5
    assert battery.current_A[uphill].max() < -1.0
    assert drive.extra["speed_true_m_s"][downhill].max() < -0.5
    assert battery.current_A[downhill].min() > 0.3
    assert np.abs(drive.extra["yaw_rate_true_rad_s"][battery.time_s > 25.0]).max() > 0.5
