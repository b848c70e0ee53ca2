import re
from dataclasses import replace

import pytest

from cli.examples import drive, pulse_test
from ohmward.cli.main import main
from ohmward.logs import Log
from ohmward_lab.cli import demo
from ohmward_lab.cli.demo import CHAPTERS
from ohmward_lab.simulate import RobotDay
from ohmward_lab.simulate.closed_loop import Scenario
from ohmward_lab.simulate.robot_drive import robot_drive


@pytest.fixture
def small(monkeypatch, tmp_path):
    """The demo on logs that take a second instead of a minute, one battery, one filter, one second of driving."""

    def make_robot_day(chemistry: str, seed: int) -> RobotDay:
        def named(log: Log, name: str) -> Log:
            extra = {"soc_true": log.extra["soc_true"]}
            return Log(name, log.time_s, log.current_A, log.voltage_V, log.temperature_degC, extra)

        return RobotDay(
            named(pulse_test(), f"simulated {chemistry} test"), named(drive(), f"simulated {chemistry} day")
        )

    def short_drive(*args, **how) -> Scenario:
        (command, *_) = (drive := robot_drive(*args, **how)).commands
        return replace(drive, plant="own", duration_s=1.0, commands=(command,))

    monkeypatch.setattr("ohmward_lab.cli.demo.make_robot_day", make_robot_day)
    monkeypatch.setattr("ohmward_lab.cli.demo.robot_drive", short_drive)
    monkeypatch.setattr("ohmward.battery.soc.comparison.available", lambda battery: ("ekf",))
    monkeypatch.setattr(demo, "N_SERIES", {"lfp": 4})
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_it_does_what_it_prints(small, capsys):
    assert main(["demo", "--out", "out"]) == 0
    out = capsys.readouterr().out
    lines = [line[2:] for line in out.splitlines() if line.startswith("$ ")]
    names = [line.split()[1] for line in lines]
    assert names == ["doctor", "identify", "soc", "compare", "simulate", "slip", "mission"]
    assert all((small / "out" / f"lfp-{name}.html").is_file() for name in names[:4])
    assert all((small / "out" / f"drive-{name}.html").is_file() for name in names[4:])
    assert "simulated robot day" in out and "the drive home" in out
    page = (small / "out" / "report.html").read_text(encoding="utf-8")
    titles = re.findall(r"<h2[^>]*>([^<]*)</h2>", page)
    assert titles == [title for title, _ in CHAPTERS.values()]
    assert "<h3>Plan</h3>" in page
    assert "Slip, front left" in page and "State of charge" in page
    before = (small / "out" / "lfp.toml").read_bytes()
    assert main(lines[1].split()[1:]) == 0
    assert (small / "out" / "lfp.toml").read_bytes() == before


def test_a_demo_may_be_made_again(tmp_path):
    assert demo._prepare(tmp_path / "out") == demo._prepare(tmp_path / "out")


def test_a_foreign_folder_is_left_alone(small, refused):
    (small / "thesis").mkdir()
    (small / "thesis" / "chapter.txt").write_text("years of work")
    assert "not empty and not from a demo" in refused("demo", "--out", "thesis")
    assert [p.name for p in (small / "thesis").iterdir()] == ["chapter.txt"]


def test_a_file_is_no_folder(small, refused):
    (small / "out").write_text("")
    assert "name a folder" in refused("demo", "--out", "out")


@pytest.mark.slow
def test_the_whole_demo(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["demo"]) == 0
    out = capsys.readouterr().out
    assert all(f"ohmward-demo/{name}-soc.html" in out for name in ("lfp", "lead-acid"))
    assert "gets home" in out
    assert main(["soc", "ohmward-demo/drive.csv", "--battery", "ohmward-demo/lfp.toml"]) == 0
    plan = ["--plan", "ohmward-demo/home.toml", "--consumption", "ohmward-demo/consumption.toml", "--soc", "0.35"]
    assert main(["mission", *plan, "--battery", "ohmward-demo/lfp.toml"]) == 0
