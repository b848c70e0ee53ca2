"""`ohmward export` by hand: files, figures, refusals."""

import json
import re
import zipfile

import numpy as np
import pytest

from ohmward.battery.chemistries import generic_battery
from ohmward.battery.file import save_battery
from ohmward.cli.main import main
from ohmward.traction import ROBOTINO, save_robot
from ohmward.traction.robot.packaged import generic_robot


@pytest.fixture
def battery(tmp_path):
    save_battery(generic_battery("nmc", 2.0), tmp_path / "cell.toml")
    return tmp_path / "cell.toml"


def test_it_writes_a_library_and_says_what_it_takes(battery, tmp_path, capsys):
    out = tmp_path / "made" / "soc"
    assert main(["export", str(battery), "--filter", "textbook-ekf", "--name", "cell", "-o", str(out), "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert sorted(p.name for p in out.iterdir()) == sorted(figures["files"])
    parts = {f"cell{part}.{kind}" for part in ("", "_frame", "_saved") for kind in "ch"}
    code = parts | {"cell_vectors.h", "test_cell.c"}
    assert code | {"Makefile", "CMakeLists.txt", "README.md"} == set(figures["files"])
    assert figures["state_bytes"] == 4 * (3 + 6 + 1) and 2000 < figures["flash_bytes_estimated"] < 10_000
    assert "cell_start" in (out / "cell.h").read_text()
    assert "@" not in (out / "README.md").read_text()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--filter", "kalman"], "filter must be one of"),
        (["--name", "My Filter"], "name must be small letters"),
        (["--flash-kb", "2"], "more than the 2048 there are"),
        (["--style", "loops"], "ekf has no loops, only textbook-ekf, textbook-ukf, textbook-joint have"),
        (["--terrain", "ice"], "is the ground under a robot, and .* is a battery"),
        (["--truth", "soc"], "no logs are scored without --score; leave out --truth"),
        (["--curve-error", "1"], "a curve error is for textbook-ekf, textbook-ukf"),
        (["--initial-soc", "80"], "0 to 1|between 0 and 1"),
    ],
)
def test_refusals_write_nothing(battery, tmp_path, capsys, options, message):
    assert main(["export", str(battery), "-o", str(tmp_path / "out"), *options]) == 2
    assert re.search(message, capsys.readouterr().err)
    assert not (tmp_path / "out").exists()


def test_a_small_filter_of_loops_and_lines(battery, tmp_path, capsys):
    options = ["--filter", "textbook-ukf", "--style", "loops", "--sample-time", "1", "--curve-error", "1"]
    assert main(["export", str(battery), *options, "--flash-kb", "2.2", "-o", str(tmp_path), "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert (figures["style"], figures["curve_error_mV"]) == ("loops", 1.0) and "curve within" in figures["title"]


@pytest.mark.parametrize("options", [["--style", "loops"], ["--curve-error", "1"], ["--initial-soc", "0.5"]])
def test_a_robot_has_neither_loops_nor_a_curve_nor_a_charge(options, tmp_path, capsys):
    assert main(["export", "rlma", *options, "-o", str(tmp_path / "out")]) == 2
    assert f"leave out {options[0]}" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("folder", "name"), [("soc", "soc"), ("My Cell-2", "my_cell_2"), ("18650", "filter_18650"), ("Ö", "filter")]
)
def test_the_name_is_that_of_the_folder(battery, folder, name, tmp_path, monkeypatch):
    """The README's command writes soc.h, which the documentation includes."""
    monkeypatch.chdir(tmp_path)
    assert main(["export", str(battery), "--filter", "coulomb", "-o", folder]) == 0
    assert f"{name}_state" in (tmp_path / folder / f"{name}.h").read_text()


@pytest.mark.parametrize("what", ["ekf", "slip-controller"])
def test_a_robot_has_filters_and_controllers(what, tmp_path, capsys):
    assert main(["export", "rlma", "--filter", what, "--name", "robot", "-o", str(tmp_path), "--json"]) == 0
    assert "RLMA" in json.loads(capsys.readouterr().out)["title"]
    assert "robot_step" in (tmp_path / "robot.h").read_text()


@pytest.mark.parametrize("robot", ["husky", "TurtleBot4"])
def test_every_robot_of_the_package_has_a_controller(robot, tmp_path):
    assert main(["export", robot, "--filter", "speed-controller", "--name", "wheel", "-o", str(tmp_path)]) == 0


def test_a_robot_whose_currents_do_not_show_its_speed_has_no_observer_of_them(tmp_path, capsys):
    save_robot(generic_robot(300.0, 0.12, 0.6, wheelbase_m=1.2, layout="tricycle"), tmp_path / "tricycle.toml")
    for robot in ("husky", str(tmp_path / "tricycle.toml")):
        assert main(["export", robot, "-o", str(tmp_path / "out")]) == 2
        assert "--filter odometry" in capsys.readouterr().err


def test_a_robot_file_is_known_by_its_format(tmp_path, capsys):
    save_robot(ROBOTINO, tmp_path / "mine.toml")
    options = ["--filter", "speed-controller", "--name", "wheel", "-o", str(tmp_path / "out")]
    assert main(["export", str(tmp_path / "mine.toml"), *options]) == 0
    assert "Robotino" in capsys.readouterr().out


def test_a_robot_has_no_battery_filter(tmp_path, capsys):
    assert main(["export", "rlma", "--filter", "coulomb", "-o", str(tmp_path / "out")]) == 2
    assert (
        "filter must be one of ekf, aekf, ukf, aukf, odometry, slip-controller, speed-controller"
        in capsys.readouterr().err
    )


def test_the_archive_of_a_blind_benchmark_is_written_and_rehearsed(battery, tmp_path, capsys):
    time_s = np.arange(0.0, 1200.0, 1.0)
    rows = ["time_s,current_A,voltage_V,temperature_degC,soc"]
    rows += [f"{t:.0f},{-2.0 + 0.5 * np.sin(t)},{4.1 - 2e-4 * t},25,{1.0 - t / 3600:.6f}" for t in time_s]
    (tmp_path / "drive.csv").write_text("\n".join(rows))
    out = tmp_path / "submission.zip"
    line = ["export", str(battery), "--for", "mcmaster", "-o", str(out), "--filter", "coulomb"]
    line += ["--score", str(tmp_path / "drive.csv"), "--truth", "soc"]
    assert main([*line, "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert zipfile.ZipFile(out).namelist() == ["Model.py"]
    assert [run["case"] for run in figures["runs"]] == ["drives", "restarts", "offset", "offset"]
    assert figures["rmse"]["charges"] is None and 0.0 < figures["rmse_weighted"] < 0.5
    assert main(line) == 0
    said = capsys.readouterr().out
    assert "restarts" in said and "weighted" in said and "charges" not in said


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--for", "mcmaster", "-o", "folder"], r"-o .*\.zip"),
        (["--for", "mcmaster", "-o", "a.zip", "--name", "cell"], "leave out --name"),
        (["--for", "mcmaster", "-o", "a.zip", "--score", "a.csv"], "name its column with --truth"),
        (["-o", "folder", "--score", "a.csv"], "name it with --for mcmaster"),
    ],
)
def test_what_a_blind_benchmark_does_not_take_is_refused(battery, options, message, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["export", str(battery), *options]) == 2
    assert re.search(message, capsys.readouterr().err)
    assert [path.name for path in tmp_path.iterdir()] == ["cell.toml"]
