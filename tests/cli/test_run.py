import asyncio
import json
import os
import re
import shlex
import signal
import socket
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest

from markdown_pages import redirected
from ohmward import generic_battery, save_battery
from ohmward.cli.main import main
from ohmward.cli.run import summary, watch_setup
from ohmward.onboard.robot_setup import SETUP_FILE
from ohmward.onboard.robot_state import Diagnostic, Level
from ohmward.onboard.sinks.page import PageSink
from ohmward.onboard.trial import Trial
from ohmward.onboard.wiring_check import Recorder
from ohmward_lab.onboard import demonstration


def ohmward(*words, cwd, **options):
    command = [sys.executable, "-m", "ohmward", "run", *words]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=300, **options)


@pytest.fixture
def example(tmp_path, capsys):
    assert main(["run", "--example"]) == 0
    (tmp_path / "robot.toml").write_text(capsys.readouterr().out, encoding="utf-8")
    save_battery(generic_battery("lfp", 12.0, 4), tmp_path / "battery.toml")
    return tmp_path


def test_the_commands_of_the_page_can_be_pasted(tmp_path):
    page = (Path(__file__).parents[2] / "docs" / "on-board.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```bash\n(.*?)```", page, flags=re.DOTALL)
    for line in block.splitlines():
        (program, *words), file = redirected(shlex.split(line))
        assert program == "ohmward"
        command = [sys.executable, "-m", "ohmward", *words]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300)
        assert done.returncode == 0, (line, done.stdout, done.stderr)
        if file:
            text = done.stdout.replace('kind = "page"', 'kind = "page"\nport = 0')  # 8080 may be another test's
            (tmp_path / file).write_text(text, encoding="utf-8")


def test_keys_of_the_check_are_all_listed(example):
    page = (Path(__file__).parents[2] / "docs" / "command-line.md").read_text(encoding="utf-8")
    section = page.split("## JSON of `run`")[1].split("## ")[0]
    recorder = Recorder()
    recorder.put("imu", 0.0, {"yaw_rate_rad_s": 1.0})
    trial = Trial(recorder.signals(), [Diagnostic("imu", Level.OK, "running")])
    found = summary(trial)
    keys = {*found, *found["findings"][0], *found["signals"]["yaw_rate_rad_s"]}
    assert set(re.findall(r"`(\w+)`", section)) >= keys


def setup(folder, body):
    text = f'format = "ohmward-setup/1"\nbattery = "{folder}/battery.toml"\nstate = "{folder}/state"\n{body}'
    (folder / "other.toml").write_text(text, encoding="utf-8")
    return "other.toml"


def test_the_example_is_a_setup(example):
    found = SETUP_FILE.load(example / "robot.toml")
    assert [source.name for source in found.source] == ["simulation"]


def test_every_part_of_the_example_that_is_commented_out_is_one_too(example):
    """The comments become settings; parts that exclude each other are checked one by one by their classes."""
    text = (example / "robot.toml").read_text(encoding="utf-8")
    lines = [
        line.removeprefix("# ")
        if line.startswith(("# [[", "# kind", "# path", "# rate", "# interval_s", "# address", "# name"))
        else line
        for line in text.splitlines()
    ]
    found = SETUP_FILE.parse("\n".join(lines))
    assert len(found.source) >= 3
    assert len(found.sink) >= 3


def test_lines_go_in_and_states_come_out(example):
    body = '[[source]]\nkind = "json-lines"\n[[sink]]\nkind = "json-lines"\n'
    rows = [{"time_s": 0.1 * k, "battery_current_A": -2.0, "battery_voltage_V": 13.1} for k in range(50)]
    done = ohmward(setup(example, body), cwd=example, input="\n".join(map(json.dumps, rows)) + "\n")
    assert done.returncode == 0, done.stderr
    states = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
    assert len([state for state in states if state["sample"]]) == 50
    assert 0.0 <= states[-1]["battery"]["soc"] <= 1.0
    again = ohmward(setup(example, body), cwd=example, input=json.dumps(rows[0]) + "\n")
    first = json.loads(again.stdout.splitlines()[0])
    # of what is carried over, the part that does not depend on how long a busy machine takes in between
    assert first["totals"]["charge_out_Ah"] >= states[-1]["totals"]["charge_out_Ah"] > 0.0


def test_the_check_names_what_is_wrong(example):
    body = '[[source]]\nkind = "json-lines"\nsignals = { battery_current_A = "I", battery_voltage_V = "U" }\n'
    rows = [{"time_s": 0.1 * k, "I": -2.0 - (k // 10 % 2), "V": 13.1} for k in range(200)]
    done = ohmward("--check", setup(example, body), cwd=example, input="\n".join(map(json.dumps, rows)) + "\n")
    assert done.returncode == 1
    assert "battery_voltage_V: never came from json-lines" in done.stdout
    assert done.stderr == ""


def test_the_check_of_a_robot_that_is_in_order_says_so_and_leaves_nothing(example):
    text = (example / "robot.toml").read_text(encoding="utf-8")
    sinks = 'kind = "json-lines"\npath = "new/x"\n[[sink]]\nkind = "store"\nfolder = "new/rows"'
    (example / "robot.toml").write_text(text.replace('kind = "page"', sinks), encoding="utf-8")
    before = sorted(example.rglob("*"))
    done = ohmward("--check", "robot.toml", "--seconds", "3", "--json", cwd=example)
    assert done.returncode == 0, done.stdout
    assert json.loads(done.stdout)["passed"] is True
    assert sorted(example.rglob("*")) == before


def test_the_check_names_what_cannot_be_written(example):
    (example / "taken").write_text("")
    text = (example / "robot.toml").read_text(encoding="utf-8")
    sinks = 'kind = "json-lines"\npath = "taken/x"\n[[sink]]\nkind = "store"\nfolder = "taken"'
    (example / "robot.toml").write_text(text.replace('kind = "page"', sinks), encoding="utf-8")
    done = ohmward("--check", "robot.toml", "--seconds", "1", cwd=example)
    assert done.returncode == 1
    for path in (Path("taken/x"), Path("taken/store.sqlite")):
        assert f"{path}: cannot be written (Not a directory)" in done.stdout


def test_strict_refuses_what_cannot_begin(example):
    body = 'strict = true\n[[source]]\nkind = "json-lines"\naddress = "nobody.socket"\n'
    body = f"{body.replace('strict = true', '')}"
    name = setup(example, "strict = true\n" + body)
    done = ohmward(name, cwd=example)
    assert done.returncode == 2
    assert "ohmward: error: source json-lines: no connection to nobody.socket" in done.stderr


def test_a_signal_ends_it_cleanly(example):
    text = (
        (example / "robot.toml").read_text(encoding="utf-8").replace('kind = "page"', 'kind = "json-lines"\npath = "x"')
    )
    (example / "robot.toml").write_text(text, encoding="utf-8")
    command = [sys.executable, "-m", "ohmward", "run", "robot.toml"]
    with subprocess.Popen(command, cwd=example, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        while not (example / "x").exists() or "soc_std" not in (example / "x").read_text():
            assert process.poll() is None
            time.sleep(0.05)
        process.send_signal(signal.SIGTERM)
        _, errors = process.communicate(timeout=300)
    assert process.returncode == 0, errors
    assert (example / "ohmward-state" / "snapshot.json").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([], "give a SETUP.toml"),
        (["--demo", "robot.toml"], "--demo needs no setup"),
        (["--demo", "--seconds", "-1"], "--seconds must be > 0"),
        (["--demo", "--json"], "--json goes with --check"),
        (["nothing.toml"], "nothing.toml: cannot be read"),
    ],
)
def test_bad_input_is_refused_with_the_fix(words, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["run", *words]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.skipif(os.name == "nt", reason="POSIX")
def test_the_demonstration_moves(tmp_path):
    """The newcomer's first minute; the page itself is tested in tests/onboard/test_page.py."""
    command = [sys.executable, "-m", "ohmward", "run", "--demo", "--seconds", "60"]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout
        moved: set[str] = set()
        while len(moved) < 2 and (line := process.stdout.readline()):
            moved |= {line} if "speed" in line else set()
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=300)
    assert process.returncode == 0, errors
    assert len(moved) == 2
    assert not list(tmp_path.iterdir())


def test_the_demonstration_takes_another_port_where_its_own_is_taken(monkeypatch, caplog):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        monkeypatch.setattr(demonstration, "PageSink", partial(PageSink, port=port))
        with caplog.at_level("INFO"):
            (page,) = (sink for sink in demonstration.demo_sinks() if isinstance(sink, PageSink))
    assert page.port == 0
    assert f"port {port} is taken: the page takes another one" in caplog.text
    (page,) = (sink for sink in demonstration.demo_sinks() if isinstance(sink, PageSink))
    assert page.port == port


def test_a_setup_that_is_edited_meanwhile_is_named(tmp_path, monkeypatch, caplog):
    monkeypatch.setattr("ohmward.cli.run.EDITED_S", 0.01)
    setup = tmp_path / "robot.toml"
    setup.write_text("before")

    async def edit():
        watching = asyncio.create_task(watch_setup(setup))
        await asyncio.sleep(0.05)
        setup.unlink()
        await asyncio.sleep(0.05)
        setup.write_text("after")
        while not caplog.records:
            await asyncio.sleep(0.01)
        watching.cancel()

    asyncio.run(asyncio.wait_for(edit(), 20.0))
    assert "robot.toml has changed; it is read at the start" in caplog.records[0].getMessage()


def test_the_log_can_be_json(example):
    body = '[[source]]\nkind = "json-lines"\naddress = "nobody.socket"\n'
    name = setup(example, "strict = true\n" + body)
    done = ohmward(name, "--log-format", "json", cwd=example)
    assert done.returncode == 2
    records = [json.loads(line) for line in done.stderr.splitlines()]
    assert all(set(record) == {"time", "level", "logger", "message"} for record in records)
    assert records[-1]["level"] == "error" and "no connection to nobody.socket" in records[-1]["message"]


def test_a_service_manager_hears_of_it(example):
    path = str(example / "notify.socket")
    name = setup(example, '[[source]]\nkind = "json-lines"\n')
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(path)
        environment = {**os.environ, "NOTIFY_SOCKET": path, "WATCHDOG_USEC": "10000000"}
        done = ohmward(name, cwd=example, input="", env=environment)
        assert done.returncode == 0, done.stderr
        assert listener.recv(4096).startswith(b"READY=1")
