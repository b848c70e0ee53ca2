"""`ohmward drive`: keys, sticks, and a robot at the other end of the line."""

import asyncio
import json
import os
import subprocess
import sys
import threading
import time
from typing import Any

import pytest

from ohmward.cli.drive import EVENT, keys_of, line, moved_stick, pressed
from ohmward.cli.main import main
from ohmward.onboard.control.drive_control import DriveControl
from ohmward.onboard.control.loop import ControlLoop
from ohmward.onboard.control.operator_command import DriveLimits, OperatorCommand
from ohmward.onboard.control.operator_link import OperatorServer
from ohmward.traction.robot.packaged import RLMA
from onboard.control.test_drive_control import state
from onboard.servers import free_port

LIMITS = {"speed_m_s": 0.5, "yaw_rate_rad_s": 1.0, "slip": 0.3}


def after(keys, given=None):
    given = given or OperatorCommand()
    for key in keys_of(keys):
        given = pressed(key, given, LIMITS)
    return given


def test_keys_set_speed_turn_and_slip():
    assert after("a") == OperatorCommand(armed=True)
    assert after("aww").speed_m_s == pytest.approx(0.1)
    assert after("a\x1b[A\x1b[A\x1b[B").speed_m_s == pytest.approx(0.05)
    assert after("a" + 50 * "w").speed_m_s == 0.5
    assert after("awwwsss").speed_m_s == 0.0
    assert (
        after("s", OperatorCommand(armed=True, speed_m_s=0.03)).speed_m_s == 0.0
    )  # of a stick; never backwards at once
    assert after("ajj").yaw_rate_rad_s == pytest.approx(0.2) and after("al").yaw_rate_rad_s == pytest.approx(-0.1)
    assert after("awj0") == OperatorCommand(armed=True)
    assert after("awj ") == OperatorCommand()
    assert after("awwa").speed_m_s == 0.0
    assert after("a+++").slip_bound == pytest.approx(0.15) and after("a" + 90 * "+").slip_bound == 0.3
    assert after("am").slip_ratio == after("am").slip_bound and after("amm").slip_ratio == 0.0
    assert after("xyz?") == OperatorCommand()


def test_a_stick_drives_and_springs_back():
    def moved(kind, number, value, given):
        return moved_stick(EVENT.pack(1, value, kind, number), given, LIMITS)

    armed = moved(1, 0, 1, OperatorCommand())
    assert armed.armed
    assert moved(2, 1, -32767, armed).speed_m_s == pytest.approx(0.5)
    assert moved(2, 0, 16384, armed).yaw_rate_rad_s == pytest.approx(-0.5, abs=0.01)
    assert moved(2, 1, 1000, armed).speed_m_s == 0.0  # play
    assert not moved(1, 3, 1, armed).armed
    assert moved(1, 0, 0, OperatorCommand()) == OperatorCommand()  # a button let go


def test_the_line_says_state_goal_and_reason():
    beat = {
        "phase": "stopped",
        "reason": "the operator is gone",
        "speed_m_s": 0.2,
        "slip_ratio": [0.03, None],
        "soc": 0.78,
    }
    text = line(beat, OperatorCommand(speed_m_s=0.3))
    assert text.split() == [
        "stopped",
        "speed",
        "+0.20",
        "(+0.30)",
        "m/s",
        "turn",
        "-",
        "(+0.00)",
        "rad/s",
        "slip",
        "3",
        "%",
        "(at",
        "most",
        "12)",
        "battery",
        "78",
        "%",
        "the",
        "operator",
        "is",
        "gone;",
        "space,",
        "then",
        "a",
    ]


@pytest.fixture
def robot():
    """A controller that listens, with fresh estimates; its loop."""
    port, ready, end = free_port(), threading.Event(), threading.Event()
    sent: list[dict[str, float]] = []
    loop = ControlLoop(DriveControl(RLMA, DriveLimits()), 0.01)

    async def serve() -> None:
        async with OperatorServer(loop, "rlma", "").listening("127.0.0.1", port):
            ready.set()
            while not end.is_set():
                loop.state = state(time.monotonic())
                await asyncio.sleep(0.01)

    loop.drive(lambda numbers: sent.append(dict(numbers)))
    thread = threading.Thread(target=lambda: asyncio.run(serve()))
    thread.start()
    ready.wait(10.0)
    yield port, sent
    end.set()
    thread.join()
    loop.end()


def drive(port, *options, **more):
    words = [sys.executable, "-m", "ohmward", "drive", f"127.0.0.1:{port}", *options]
    return subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, **more)


def wait_until(condition, within_s=60.0):
    end_s = time.monotonic() + within_s
    while not condition():
        assert time.monotonic() < end_s, "in vain"
        time.sleep(0.01)


def test_an_operator_drives_with_keys_and_the_robot_stops_when_he_is_gone(robot):
    port, sent = robot
    process: Any = drive(port, "--json")
    os.write(process.stdin.fileno(), b"a")
    wait_until(lambda: sent[-1]["enable"] == 1.0)
    os.write(process.stdin.fileno(), b"www")
    wait_until(lambda: sent[-1]["torque_Nm.front_left"] > 0.1)
    os.write(process.stdin.fileno(), b"q")
    out, _ = process.communicate(timeout=300)
    assert json.loads(out)["phase"] == "disarmed" and process.returncode == 0
    assert sent[-1]["enable"] == 0.0 and sent[-1]["torque_Nm.front_left"] == 0.0


def test_a_killed_program_and_a_closed_terminal_stop_the_robot(robot):
    port, sent = robot
    for leave in ("kill", "close"):
        process: Any = drive(port)
        wait_until(lambda: sent[-1]["enable"] == 0.0)
        os.write(process.stdin.fileno(), b" ")
        time.sleep(0.1)
        os.write(process.stdin.fileno(), b"a")
        wait_until(lambda: sent[-1]["enable"] == 1.0)
        if leave == "kill":
            process.kill()
        else:
            process.stdin.close()
        wait_until(lambda: sent[-1]["enable"] == 0.0, 2.0)
        process.stdin.close()
        process.wait(20)


def test_stop_stops_whoever_drives(robot, capsys):
    port, _ = robot
    assert main(["drive", f"127.0.0.1:{port}", "--stop", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["reason"] == "stopped by an operator"


def test_a_robot_that_does_not_stop_is_named_with_the_emergency_stop(robot, monkeypatch, capsys):
    port, _ = robot
    monkeypatch.setattr(DriveControl, "request_stop", lambda *_: None)
    monkeypatch.setattr("ohmward.cli.drive._STOP_S", 0.3)
    assert main(["drive", f"127.0.0.1:{port}", "--stop"]) == 2
    assert "the robot does not stop; press its emergency stop" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["nowhere"], "HOST:PORT must be HOST:PORT, as 127.0.0.1:4710, got 'nowhere'"),
        ([f"127.0.0.1:{free_port()}", "--stop"], "no robot at 127.0.0.1"),
        (["--token", "pa55 word"], "says where the secret is, not the secret"),
        (["--joystick", "/dev/nothing"], "--joystick: /dev/nothing cannot be opened"),
    ],
)
def test_what_is_wrong_is_one_line(words, message, capfd):
    result = subprocess.run(
        [sys.executable, "-m", "ohmward", "drive", *words], capture_output=True, text=True, check=False
    )
    assert result.returncode == 2
    assert message in result.stderr and len(result.stderr.splitlines()) == 1
