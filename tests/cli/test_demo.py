import pytest

from cli.examples import drive, pulse_test
from ohmward.cli import demo
from ohmward.cli.main import main
from ohmward.logs import Log
from ohmward.simulate import RobotDay


@pytest.fixture
def small(monkeypatch, tmp_path):
    """The demo on logs that take a second instead of a minute, one battery, one filter."""

    def make_robot_day(chemistry: str, seed: int) -> RobotDay:
        def named(log: Log, name: str) -> Log:
            extra = {"soc_true": log.extra["soc_true"]}
            return Log(name, log.time_s, log.current_A, log.voltage_V, log.temperature_degC, extra)

        return RobotDay(
            named(pulse_test(), f"simulated {chemistry} test"), named(drive(), f"simulated {chemistry} day")
        )

    monkeypatch.setattr("ohmward.simulate.make_robot_day", make_robot_day)
    monkeypatch.setattr("ohmward.battery.estimators.available", lambda battery: ("ekf",))
    monkeypatch.setattr(demo, "N_SERIES", {"lfp": 4})
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_it_does_what_it_prints(small, capsys):
    assert main(["demo", "--out", "out"]) == 0
    out = capsys.readouterr().out
    lines = [line[2:] for line in out.splitlines() if line.startswith("$ ")]
    assert [line.split()[1] for line in lines] == ["doctor", "identify", "soc", "compare"]
    assert all((small / "out" / f"lfp-{line.split()[1]}.html").is_file() for line in lines)
    assert "simulated robot day" in out
    before = (small / "out" / "lfp.toml").read_bytes()
    assert main(lines[1].split()[1:]) == 0
    assert (small / "out" / "lfp.toml").read_bytes() == before


def test_a_demo_may_be_made_again(small):
    assert main(["demo", "--out", "out"]) == 0
    assert main(["demo", "--out", "out"]) == 0


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
