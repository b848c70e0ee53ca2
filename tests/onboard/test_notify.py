"""Signs of life for a service manager, heard at a socket of its kind."""

import asyncio
import os
import socket
import sys

import pytest

from ohmward.onboard.estimation import Estimation
from ohmward.onboard.message import Message
from ohmward.onboard.notify import MOST_FAULTS, is_alive, notifying, service_manager, status
from ohmward.onboard.process import Process
from ohmward.onboard.robot_state import Diagnostic, Level
from ohmward.traction.robot.packaged import load_robot


@pytest.fixture
def manager(tmp_path):
    """A service manager's end, and the environment that it gives."""
    path = str(tmp_path / "notify.socket")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(path)
        listener.setblocking(False)
        yield listener, {"NOTIFY_SOCKET": path, "WATCHDOG_USEC": "60000"}


def heard(listener):
    """What came, line by line."""
    lines: list[str] = []
    while True:
        try:
            lines += listener.recv(4096).decode().splitlines()
        except BlockingIOError:
            return lines


class Waiting:
    """A source that never says anything."""

    name = "waiting"

    async def run(self, put):
        await asyncio.Event().wait()


def process(*sinks):
    return Process(Estimation(robot=load_robot("rlma")), [Waiting()], sinks)


def run(process, environment, at_work):
    """Run a process with its service manager while a function works."""
    found = service_manager(environment)
    assert found is not None
    process.companions.append(notifying(process, found))

    async def work():
        running = asyncio.ensure_future(process.run())
        await at_work()
        process.stop()
        await asyncio.wait_for(running, 60)

    asyncio.run(work())


def test_it_says_that_it_is_ready_that_it_lives_and_that_it_stops(manager):
    listener, environment = manager
    said: list[str] = []

    async def listen():
        for _ in range(8):
            await asyncio.sleep(0.03)
            said.extend(heard(listener))

    run(process(), environment, listen)
    lines = [line for line in said + heard(listener) if not line.startswith("STATUS")]
    assert lines[0] == "READY=1" and lines[-1] == "STOPPING=1"
    assert lines.count("READY=1") == lines.count("STOPPING=1") == 1
    assert set(lines[1:-1]) == {"WATCHDOG=1"} and len(lines) >= 5


def test_it_gives_no_sign_of_life_while_the_estimators_fail(manager, monkeypatch):
    listener, environment = manager
    failing = process()

    def fail(*_):
        raise ZeroDivisionError("broken")

    async def feed():
        await asyncio.sleep(0.1)
        monkeypatch.setattr(failing.estimation, "put", fail)
        for k in range(MOST_FAULTS):
            failing.put(Message(float(k), float(k), "waiting", {"yaw_rate_rad_s": 0.0}))
        assert not is_alive(failing)
        await asyncio.sleep(0.03)
        heard(listener)
        await asyncio.sleep(0.15)
        assert "WATCHDOG=1" not in heard(listener)
        monkeypatch.undo()
        failing.put(Message(1e3, 1e3, "waiting", {"yaw_rate_rad_s": 0.0}))
        await asyncio.sleep(0.1)
        assert "WATCHDOG=1" in heard(listener)

    run(failing, environment, feed)


def test_nobody_is_told_where_there_is_no_manager():
    assert service_manager({}) is None


def test_a_manager_that_has_gone_is_not_waited_for(manager):
    listener, environment = manager
    found = service_manager(environment)
    assert found is not None and found.watchdog_s == pytest.approx(0.06)
    listener.close()
    found.send(READY="1")


def test_the_watchdog_of_another_process_is_not_ours(manager):
    _, environment = manager
    other = service_manager({**environment, "WATCHDOG_PID": str(os.getpid() + 1)})
    assert other is not None and other.watchdog_s is None


@pytest.mark.skipif(sys.platform != "linux", reason="the abstract namespace is Linux's")
def test_a_socket_of_the_abstract_namespace_is_found():
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(f"\0ohmward-{os.getpid()}")
        found = service_manager({"NOTIFY_SOCKET": f"@ohmward-{os.getpid()}"})
        assert found is not None
        found.send(STATUS="two\nlines")
        assert listener.recv(100) == b"STATUS=two lines"


def test_the_status_names_what_is_not_in_order():
    told = process()
    assert status(told) == "in order"
    told.report(Diagnostic("source can0", Level.ERROR, "no such bus"))
    told.report(Diagnostic("yaw_rate_rad_s", Level.STALE, "silent"))
    assert status(told) == "source can0: no such bus, and 1 more"


def test_the_stop_is_said_before_sinks_deliver(manager):
    listener, environment = manager

    class Slow:
        name, interval_s = "slow", 0.0

        async def run(self, feed):
            while await feed.batch():
                pass
            said.extend(heard(listener))

    said: list[str] = []
    told = process(Slow())

    async def wait():
        await asyncio.sleep(0.05)
        heard(listener)

    run(told, environment, wait)
    assert "STOPPING=1" in said
    assert "STOPPING=1" not in heard(listener)
