"""The unit of systemd: that systemd takes it, what is refused, and that nothing is overwritten unsaid."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from ohmward import generic_battery, save_battery
from ohmward.cli import service
from ohmward.cli.main import main
from ohmward.cli.service import obstacles, unit
from ohmward.errors import InputError

ANALYZE = shutil.which("systemd-analyze")


@pytest.fixture
def setup(tmp_path):
    """A setup that a service can run, but for the place of Python."""
    save_battery(generic_battery("lfp", 12.0, 4), tmp_path / "battery.toml")
    path = tmp_path / "robot.toml"
    path.write_text(
        f'format = "ohmward-setup/1"\nbattery = "{tmp_path}/battery.toml"\nrobot = "rlma"\n'
        '[[source]]\nkind = "simulation"\n[[sink]]\nkind = "page"\ntoken = "ROBOT_TOKEN"\n',
        encoding="utf-8",
    )
    path.chmod(0o644)
    return path


@pytest.fixture
def machine(tmp_path, monkeypatch):
    """A folder of units, and root."""
    units = tmp_path / "units"
    units.mkdir()
    monkeypatch.setattr(service, "UNITS", units)
    monkeypatch.setattr("os.geteuid", lambda: 0)
    monkeypatch.setattr("ohmward.cli.service._HIDDEN", (Path("/nobody"),))
    return units


def sections(text):
    """Lines of a unit by section."""
    found: dict[str, list[str]] = {}
    for line in text.splitlines():
        if line.startswith("["):
            found[line] = []
        elif line and not line.startswith("#"):
            found[list(found)[-1]].append(line)
    return found


@pytest.mark.skipif(ANALYZE is None, reason="needs systemd-analyze")
def test_systemd_takes_the_unit(setup, tmp_path):
    path = tmp_path / "ohmward.service"
    path.write_text(unit(setup), encoding="utf-8")
    done = subprocess.run([str(ANALYZE), "verify", str(path)], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    path.write_text(unit(setup).replace("WatchdogSec=10", "WatchdogSec=soon"), encoding="utf-8")
    assert "Failed to parse" in " ".join(service.verify(path))


@pytest.mark.skipif(ANALYZE is None, reason="needs systemd-analyze")
def test_the_unit_is_exposed_little(setup, tmp_path):
    path = tmp_path / "ohmward.service"
    path.write_text(unit(setup), encoding="utf-8")
    words = [str(ANALYZE), "security", "--offline=true", "--no-pager", str(path)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=60, check=False)
    if not (level := re.search(r"Overall exposure level for ohmward.service: ([0-9.]+)", done.stdout)):
        pytest.skip("this systemd-analyze rates no files")
    assert float(level[1]) <= 2.5


def test_the_unit_says_what_it_should(setup):
    found = sections(unit(setup))
    assert "StartLimitIntervalSec=0" in found["[Unit]"]
    service = found["[Service]"]
    for line in ("Type=notify", "WatchdogSec=10", "Restart=on-failure", "DynamicUser=yes", "CacheDirectoryMode=0700"):
        assert line in service
    (start,) = (line for line in service if line.startswith("ExecStart="))
    assert start.endswith(f" run {setup}")
    assert Path(start.removeprefix("ExecStart=").split()[0]).exists()


def test_odd_paths_are_quoted(tmp_path):
    assert f'"{tmp_path}/a 100%% $$robot.toml"' in unit(tmp_path / "a 100% $robot.toml")


def test_it_is_printed_without_root(setup, capsys, monkeypatch):
    monkeypatch.setattr("os.geteuid", lambda: 1000)
    assert main(["service", "install", str(setup), "--print"]) == 0
    assert capsys.readouterr().out == unit(setup)


def test_without_root_it_is_refused_with_the_fix(setup, machine, capsys, monkeypatch):
    monkeypatch.setattr("os.geteuid", lambda: 1000)
    assert main(["service", "install", str(setup)]) == 2
    assert "sudo ohmward service install, or `ohmward service install --print > " in capsys.readouterr().err
    assert not list(machine.iterdir())


def test_it_is_installed_and_never_overwritten_unsaid(setup, machine, capsys):
    assert main(["service", "install", str(setup)]) == 0
    path = machine / "ohmward.service"
    assert path.read_text(encoding="utf-8") == unit(setup)
    assert path.stat().st_mode & 0o777 == 0o644
    assert "sudo systemctl enable --now ohmward" in capsys.readouterr().out
    assert main(["service", "install", str(setup)]) == 0  # the same again
    path.write_text("[Unit]\n", encoding="utf-8")
    assert main(["service", "install", str(setup)]) == 2
    assert "is there already and differs; --replace" in capsys.readouterr().err
    assert path.read_text(encoding="utf-8") == "[Unit]\n"
    assert main(["service", "install", str(setup), "--replace"]) == 0
    assert "was there and differed" in capsys.readouterr().out
    assert (machine / "ohmward.service.before").read_text(encoding="utf-8") == "[Unit]\n"


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ('robot = "rlma"', 'robot = "rlma"\nstate = "/data"', 'writes in /var/lib/ohmward alone; write state = "data"'),
        ('"ROBOT_TOKEN"', '"file:/etc/token"', "write NAME=SECRET into /etc/ohmward/environment"),
        ('format = "ohmward-setup/1"', 'format = "other/1"', "other/1"),
    ],
)
def test_a_setup_that_a_service_cannot_run_is_refused(setup, machine, capsys, before, after, message):
    setup.write_text(setup.read_text(encoding="utf-8").replace(before, after), encoding="utf-8")
    assert main(["service", "install", str(setup)]) == 2
    assert message in capsys.readouterr().err
    assert not list(machine.iterdir())


def test_paths_that_mean_another_place_are_refused(setup, machine):
    text = setup.read_text(encoding="utf-8")
    setup.write_text(text.replace(f"{setup.parent}/battery", "battery"), encoding="utf-8")
    (found,) = obstacles(setup)
    assert found.endswith(f'write battery = "{setup.parent}/battery.toml"')
    setup.chmod(0o600)
    assert "may not read" in obstacles(setup)[0]
    setup.unlink()
    assert "`ohmward run --example` prints one" in obstacles(setup)[-1]


def test_a_folder_that_the_service_does_not_see_is_refused(setup, monkeypatch):
    monkeypatch.setattr("ohmward.cli.service._HIDDEN", (Path(sys.executable).parent, setup.parent))
    found = " ".join(obstacles(setup))
    assert f"a service does not see {sys.executable}, which runs this" in found
    assert f"a service does not see {setup}, nor anything" in found


@pytest.mark.parametrize("character", ["\n", "\r", "\x1b", "\x85"])
def test_a_control_character_in_a_path_writes_no_line_of_its_own(character):
    with pytest.raises(InputError, match="holds a control character, which no unit of systemd can; rename it"):
        unit(Path(f"/etc/ohmward/a{character}ExecStartPre=x/robot.toml"))
