"""`ohmward fleet` by hand."""

import csv
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet
import pytest

from fleet.examples import BATTERY, day, write
from ohmward.battery.chemistries import generic_battery
from ohmward.battery.file import save_battery
from ohmward.cli.fleet import make_page
from ohmward.cli.main import main
from ohmward.fleet import RobotRecord
from ohmward.logs import Log, read_log, write_log


@pytest.fixture
def folder(tmp_path):
    save_battery(generic_battery("nmc", 2.0), tmp_path / "cell.toml")
    (tmp_path / "logs").mkdir()
    for k in range(3):
        current = np.repeat([-1.0, 0.0, -2.0, 0.5], 30)
        log = Log(f"robot{k}", np.arange(current.size) * 1.0, current, 3.8 + 0.05 * current)
        write_log(log, tmp_path / "logs" / f"robot{k}.csv")
    return tmp_path


def test_a_pattern_becomes_a_summary_and_the_second_run_is_done_at_once(folder, capsys):
    command = ["fleet", str(folder / "logs" / "*.csv"), "--battery", str(folder / "cell.toml")]
    command += ["-o", str(folder / "out"), "--filter", "coulomb", "--processes", "1", "--json"]
    assert main(command) == 0
    first = json.loads(capsys.readouterr().out)
    assert (first["logs"], first["failed"], first["resumed"]) == (3, 0, 0)
    assert first["samples"] == 360 and first["soc_final_min"] < 1.0
    assert main(command) == 0
    assert json.loads(capsys.readouterr().out)["resumed"] == 3


@pytest.mark.parametrize("command", ["fleet", "learn"])
def test_a_log_comes_through_standard_input(folder, monkeypatch, capsys, command):
    save_battery(generic_battery("nmc", 12.0), folder / "cell.toml")
    with (folder / "logs" / "robot0.csv").open() as stream:
        monkeypatch.setattr("sys.stdin", stream)
        output = {"fleet": "out", "learn": "learnt.toml"}[command]
        main([command, "-", "--battery", str(folder / "cell.toml"), "-o", str(folder / output), "--json"])
    found = json.loads(capsys.readouterr().out)
    assert found["samples"] == 120 if command == "fleet" else found["logs"][0]["log"] == "standard input"


def test_a_folder_is_all_of_its_logs(folder, capsys):
    command = ["fleet", str(folder / "logs"), "--battery", str(folder / "cell.toml"), "--json"]
    assert main([*command, "-o", str(folder / "out"), "--filter", "coulomb", "--processes", "1"]) == 0
    assert json.loads(capsys.readouterr().out)["logs"] == 3


@pytest.mark.parametrize("by_shell", [True, False])
def test_a_link_that_leads_nowhere_stops_no_other_log(folder, capsys, by_shell):
    (folder / "logs" / "nowhere.csv").symlink_to("gone.csv")
    (folder / "logs" / "loop.csv").symlink_to("loop.csv")
    logs = map(str, sorted((folder / "logs").iterdir())) if by_shell else [str(folder / "logs")]
    command = ["fleet", *logs, "--battery", str(folder / "cell.toml"), "-o", str(folder / "out")]
    assert main([*command, "--filter", "coulomb", "--processes", "1", "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert (figures["logs"], figures["failed"]) == (5, 2)


def test_people_read_which_logs_were_not_used(folder, capsys):
    (folder / "logs" / "broken.csv").write_text("nothing\n")
    command = ["fleet", str(folder / "logs" / "*.csv"), "--battery", str(folder / "cell.toml")]
    assert main([*command, "-o", str(folder / "out"), "--filter", "coulomb", "--processes", "1"]) == 0
    text = capsys.readouterr().out
    assert "broken.csv" in text and "summary.csv" in text


def test_a_battery_file_that_does_not_fit_is_named_for_each_log(folder, capsys):
    """Logs of four cells, a file of five: only the drive of two hours tells, the short ones do not contradict it."""
    write_log(pack_drive(4), folder / "logs" / "pack.csv")
    write_log(pack_drive(5), folder / "logs" / "right.csv")
    save_battery(generic_battery("nmc", 2.0, 5), folder / "five.toml")
    command = ["fleet", str(folder / "logs" / "*[kt].csv"), "--battery", str(folder / "five.toml"), "--current-sign"]
    command += ["charge", "-o", str(folder / "out"), "--filter", "coulomb", "--processes", "1"]
    assert main([*command, "--json"]) == 1
    figures = json.loads(capsys.readouterr().out)
    assert (figures["logs"], figures["failed"]) == (2, 0)
    (wrong,) = figures["misfits"]
    assert (
        wrong["path"].endswith("pack.csv") and "4 cells in series explain its voltage better than 5" in wrong["misfit"]
    )
    rows = list(csv.DictReader((folder / "out" / "summary.csv").open()))
    assert {Path(row["path"]).stem: row["fits"] for row in rows} == {"pack": "False", "right": "True"}
    (right,) = (row for row in rows if row["fits"] == "True")
    assert figures["soc_final_min"] == float(right["soc_final"])
    assert main(command) == 1
    assert "Not to be trusted" in capsys.readouterr().out


def test_the_robots_of_a_fleet_are_on_one_page(folder, capsys):
    """Told by the names of the files; one log is none."""
    for k in range(3):
        for date in ("2026-01-05", "2026-01-06"):
            log = read_log(folder / "logs" / f"robot{k}.csv", current_sign="charge")
            start_s = datetime.fromisoformat(f"{date}T08:00:00+00:00").timestamp()
            log = replace(log, start_unix_s=start_s, voltage_V=log.voltage_V + 1e-4 * k)
            write_log(log, folder / "logs" / f"amr-{k}_{date}.csv")
    (folder / "logs" / "amr-1_2026-01-07.csv").write_text("nothing\n")
    command = ["fleet", str(folder / "logs" / "amr*.csv"), "--battery", str(folder / "cell.toml"), "--filter", "ekf"]
    command += ["-o", str(folder / "out"), "--processes", "1"]
    assert main([*command, "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert (figures["logs"], figures["failed"], len(figures["robots"])) == (7, 1, 3)
    assert {(robot["robot"], robot["logs"], robot["refused"]) for robot in figures["robots"]} == {
        ("amr-0", 2, 0),
        ("amr-1", 2, 1),
        ("amr-2", 2, 0),
    }
    page = (folder / "out" / "report.html").read_text()
    assert all(
        word in page for word in ("amr-0", "Logs that were refused", "amr-1_2026-01-07.csv", "Resistance over time")
    )
    assert sorted(path.name for path in (folder / "out" / "batteries").iterdir()) == [f"amr-{k}.toml" for k in range(3)]
    table = pyarrow.parquet.read_table(folder / "out" / "summary.parquet")
    assert table.num_rows == 7 and "robot" in table.column_names
    assert main(command) == 0
    assert "3 robots done before" in capsys.readouterr().out


def test_the_page_begins_with_the_alarms_of_ten_robots_and_lists_the_others_below():
    nothing: dict[str, Any] = dict.fromkeys(RobotRecord._fields)
    state = RobotRecord(**nothing | {"logs": 1, "refused": 0, "hours": 1.0})
    states = [state._replace(robot=f"r{k}", alarms=("worn out", "bad contact")) for k in range(12)]
    html = make_page({"logs": 12, "failed": 0, "hours": 1.0, "notes": []}, states, []).html()
    assert html.count("worn out; bad contact") == 12
    before, after = html.split("The other robots with alarms")
    assert "r9: worn out" in before and "r10" in after and "r11: worn out" not in html


def test_fleet_and_health_say_the_same_of_the_same_logs(tmp_path, as_json):
    """Deep discharges of a battery of three fourths of a capacity that nobody knew, on a curve of a label."""
    unknown = replace(BATTERY, noise=replace(BATTERY.noise, capacity_std=0.2))
    save_battery(unknown, tmp_path / "new.toml")
    for k in range(3):
        write(tmp_path / f"r_{k}.csv", day(7 * k, 1.0 - 0.04 * k, hours=3.0, capacity=0.75))
    words = (str(tmp_path / "*.csv"), "--battery", str(tmp_path / "new.toml"), "--current-sign", "charge")
    (robot,) = as_json("fleet", *words, "-o", str(tmp_path / "out"), "--processes", "1")["robots"]
    health = as_json("health", *words)
    assert health["capacity_by"] == "filter"
    assert health["soh_capacity"]["mean"] == pytest.approx(robot["soh_capacity"], abs=1e-9)
    assert health["soh_capacity"]["std"] == pytest.approx(robot["soh_capacity_std"], abs=1e-9)


def test_a_fleet_whose_logs_are_all_refused_exits_as_soc_does(folder, capsys):
    save_battery(generic_battery("nmc", 2.0, 7), folder / "seven.toml")
    command = ["fleet", str(folder / "logs" / "*.csv"), "--battery", str(folder / "seven.toml"), "--processes", "1"]
    assert main([*command, "-o", str(folder / "out"), "--filter", "coulomb"]) == 2
    assert "is it a log of another battery" in " ".join(capsys.readouterr().out.split())


def pack_drive(cells: int) -> Log:
    """Two hours of changing load and rests of cells with the curve of the label, from 95 to 40 %."""
    time_s = 10.0 * np.arange(720.0)
    current_A = -0.55 * (1.0 + np.sign(np.sin(time_s / 150.0)))
    soc = 0.95 + np.cumsum(current_A) * 10.0 / 3600.0 / 2.0
    model = generic_battery("nmc", 2.0).thevenin
    assert model is not None
    ocv_V = np.interp(soc, np.linspace(0.0, 1.0, len(model.ocv.voltage_V)), model.ocv.voltage_V)
    return Log("drive", time_s, current_A, cells * (ocv_V + 0.05 * current_A))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["nowhere/*.csv"], "no file matches"),
        (["LOGS", "--filter", "best"], "filter must be one of"),
        (["LOGS", "--where", "run=1"], "hold one recording each"),
    ],
)
def test_refusals_write_nothing(folder, capsys, options, message):
    options = [str(folder / "logs" / "*.csv") if o == "LOGS" else o for o in options]
    command = ["fleet", *options, "--battery", str(folder / "cell.toml"), "-o", str(folder / "out")]
    assert main(command) == 2
    assert message in capsys.readouterr().err
    assert not (folder / "out").exists()


@pytest.mark.skipif(os.name == "nt", reason="no signal to a group of processes")
def test_an_interrupt_ends_all_processes_without_a_traceback(folder):
    """As a terminal sends it: to the program and its processes, while these begin."""
    for k in range(500):  # so many that no machine is through before the interrupt
        os.link(folder / "logs" / "robot0.csv", folder / "logs" / f"more{k}.csv")
    words = ["fleet", str(folder / "logs" / "*.csv"), "--battery", str(folder / "cell.toml"), "--processes", "2"]
    command = [sys.executable, "-m", "ohmward", *words, "-o", str(folder / "out")]
    # a suite that a script has started in the background ignores interrupts, and its processes would inherit that
    heed = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
    run = subprocess.Popen(
        command,
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=heed,
    )
    while not (folder / "out" / "progress.jsonl").exists():
        assert run.poll() is None
        time.sleep(0.01)
    time.sleep(0.3)
    os.killpg(run.pid, signal.SIGINT)
    _, said = run.communicate(timeout=300)
    assert run.returncode == 130 and "Traceback" not in said
