"""`ohmward twin` by hand: a log through the exported C, compared with double precision, written, refused."""

import csv
import shutil
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from cli.drives import write_drive
from ohmward.battery.chemistries import generic_battery
from ohmward.battery.file import save_battery
from ohmward.cli.main import main
from ohmward.embedded.twin import FLAGS

pytestmark = pytest.mark.skipif(
    not (shutil.which("gcc") and find_spec("cffi")), reason="no twin here: gcc or cffi is not installed"
)
KEYS = {
    "command", "name", "log", "steps", "seconds", "final", "flags", "compared_with", "differences", "notes", "library",
    "output",
}  # fmt: skip


@pytest.fixture
def library(here, capsys):
    """A folder with the textbook filter of the battery."""
    assert main(["export", "battery.toml", "--filter", "textbook-ekf", "--name", "soc", "-o", "firmware"]) == 0
    capsys.readouterr()
    return here / "firmware"


def test_it_replays_a_log_and_says_how_far_double_precision_is(library, as_json):
    words = ("twin", "firmware", "day.csv", "--battery", "battery.toml", "--filter", "textbook-ekf")
    found = as_json(*words, "--initial-soc", "0.9", "-o", "twin.csv")
    assert set(found) == KEYS and found["steps"] == 3600 and found["name"] == "soc"
    assert 0.0 < found["differences"]["soc"] < 1e-3 and found["differences"]["flags"] == 0.0
    rows = list(csv.DictReader(Path("twin.csv").read_text(encoding="utf-8").splitlines()))
    assert len(rows) == 3600 and float(rows[-1]["soc"]) == found["final"]["soc"]
    assert all(np.float32(row["soc"]) == float(row["soc"]) for row in rows[:50])


def test_it_is_near_the_estimator_of_soc(library, as_json):
    firmware = as_json("twin", "firmware", "day.csv", "--initial-soc", "0.9", "--initial-soc-std", "0.03")
    desk = as_json("soc", "day.csv", "--battery", "battery.toml", "--filter", "textbook-ekf", "--initial-soc", "0.9")
    assert firmware["final"]["soc"] == pytest.approx(desk["soc_final"], abs=1e-3)
    assert firmware["compared_with"] is None and firmware["differences"] is None


def test_the_comparison_is_with_what_was_exported(here, as_json, capsys):
    options = ("--filter", "textbook-ukf", "--sample-time", "2", "--curve-error", "5")
    assert main(["export", "battery.toml", *options, "--name", "soc", "-o", "firmware"]) == 0
    capsys.readouterr()
    words = ("twin", "firmware", "day.csv", "--battery", "battery.toml")
    found = as_json(*words, *options)
    assert found["differences"]["soc"] < 1e-4
    for other in (options[:4], options[:2] + options[4:]):
        assert as_json(*words, *other)["differences"]["soc"] > 10 * found["differences"]["soc"]


def test_a_battery_file_of_another_capacity_is_told(library, as_json):
    save_battery(generic_battery("nmc", 5.0, 3), "other.toml")
    notes = as_json("twin", "firmware", "day.csv", "--battery", "other.toml", "--filter", "textbook-ekf")["notes"]
    assert "warning: 2 times the file's capacity explains its voltage better" in str(notes)


def test_people_see_the_end_the_differences_and_what_was_assumed(library, capsys):
    assert main(["twin", "firmware", "day.csv", "--battery", "battery.toml", "--filter", "textbook-ekf"]) == 0
    text = capsys.readouterr().out
    for words in ("'soc' of firmware", "largest difference", "ns each", "flagged samples", "Assumed"):
        assert words in text


@pytest.mark.parametrize(
    ("scale", "fault"),
    [
        ((1.0, 1.0), ""),
        ((1e3, 1.0), "half of the voltages are missed by more than"),
        ((1.0, 3.0), "its battery shows no voltage like the"),
    ],
)
def test_a_log_that_the_library_does_not_fit_is_named(library, as_json, scale, fault):
    rows = np.genfromtxt("day.csv", delimiter=",", names=True)
    header = "time_s,current_A,voltage_V"
    columns = (rows["time_s"], scale[0] * rows["current_A"], scale[1] * rows["voltage_V"])
    np.savetxt("other.csv", np.transpose(columns), delimiter=",", header=header, comments="")
    notes = as_json("twin", "firmware", "other.csv", "--current-sign", "charge")["notes"]
    found = [note for note in notes if "the library does not fit the log" in note]
    assert len(found) == bool(fault) and fault in "".join(found)


def test_a_drive_needs_its_robot(here, as_json, capsys, monkeypatch):
    flags = tuple(flag.replace("-O2", "-O0") for flag in FLAGS)  # which compiles in a tenth of the time
    monkeypatch.setattr("ohmward.embedded.twin.FLAGS", flags)
    assert main(["export", "rlma", "--filter", "ekf", "--name", "speed", "-o", "speed"]) == 0
    write_drive(Path("drive.csv"))
    capsys.readouterr()
    found = as_json("twin", "speed", "drive.csv", "--robot", "rlma", "--filter", "ekf")
    assert set(found) == KEYS and found["differences"]["speed_m_s"] < 1e-4
    assert {"wheel_speed_rad_s_0", "wheel_speed_rad_s_1"} <= set(found["final"])
    assert main(["twin", "speed", "drive.csv"]) == 2
    assert "needs --robot" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["nothing", "day.csv"], "there is no exported library"),
        (["firmware", "day.csv", "--name", "cell"], "no exported library 'cell'"),
        (["firmware", "day.csv", "--battery", "battery.toml"], "--battery and --filter go together"),
        (["firmware", "day.csv", "--filter", "ekf"], "--battery and --filter go together"),
        (
            ["firmware", "day.csv", "--battery", "battery.toml", "--filter", "ekf"],
            "name with --filter what was exported",
        ),
        (["firmware", "day.csv", "-o", "out.txt"], "must end in .csv, .parquet or .mcap"),
        (["firmware", "none.csv"], "none.csv"),
    ],
)
def test_refusals(library, refused, words, message):
    assert message in refused("twin", *words)


def test_it_starts_as_it_was_exported_unless_told(here, as_json, refused, capsys):
    for start in ("0.2", "0.8"):
        words = ["--initial-soc", start, "--initial-soc-std", "0.01", "--filter", "textbook-ekf"]
        assert main(["export", "battery.toml", *words, "-o", start]) == 0
    assert main(["export", "battery.toml", "--filter", "coulomb", "-o", "counter"]) == 0
    capsys.readouterr()
    low, high = (as_json("twin", start, "day.csv")["final"]["soc"] for start in ("0.2", "0.8"))
    assert low < high - 0.02
    assert as_json("twin", "0.2", "day.csv", "--initial-soc", "0.8")["final"]["soc"] == high
    assert "takes no soc: it always starts as it was exported" in refused(
        "twin", "counter", "day.csv", "--initial-soc", "0.8"
    )
    (here / "0.2" / "test_filter_0_2.c").unlink()
    assert "needs soc, soc_std to start" in refused("twin", "0.2", "day.csv")


def test_a_controller_has_no_log(here, refused, capsys):
    assert main(["export", "rlma", "--filter", "slip-controller", "--name", "wheel", "-o", "wheel"]) == 0
    capsys.readouterr()
    assert "use ohmward.embedded.Twin" in refused("twin", "wheel", "day.csv")
