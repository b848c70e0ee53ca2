"""The simulated robot as a source, on a machine that does not keep up."""

import asyncio
import time
from types import SimpleNamespace

import pytest

from ohmward.onboard.part import EndedError
from ohmward.onboard.sources.simulation import SimulationSource
from ohmward_lab.onboard import simulated_robot


def drive_with(monkeypatch, delays_s):
    """Times of the robot and of the machine for each sample; the machine needs so long for each tenth of a second."""
    waits, put_s = iter([0.0, *delays_s]), []

    def advance(drive, ahead_s):
        time.sleep(next(waits))
        drive.truth.time_s += ahead_s
        return [(drive.truth.time_s + k * ahead_s / 5, {"battery_current_A": 1.0}) for k in range(5)]

    def drive(scenario):
        duration_s = 0.1 * (len(delays_s) + 1) - 1e-6
        pack = SimpleNamespace(start_soc=0.5)
        return SimpleNamespace(
            truth=SimpleNamespace(time_s=0.0),
            scenario=SimpleNamespace(duration_s=duration_s, battery=pack),
            empty=False,
        )

    monkeypatch.setattr(simulated_robot, "_advance", advance)
    monkeypatch.setattr(simulated_robot, "ClosedLoopDrive", drive)
    with pytest.raises(EndedError):
        asyncio.run(SimulationSource().run(lambda message: put_s.append((message.stamp_s, time.monotonic()))))
    return put_s


def test_a_machine_that_was_held_up_goes_on_from_now_and_says_so_once(monkeypatch, caplog):
    monkeypatch.setattr(simulated_robot, "_MOST_LATE_S", 0.1)
    found = drive_with(monkeypatch, [0.5, 0.5, 0.0, 0.0])
    robot_s, machine_s = (after - before for before, after in zip(found[10], found[-1], strict=True))
    assert robot_s == pytest.approx(0.28)
    assert machine_s > 0.2  # it does not rush through what it missed
    assert [r.message for r in caplog.records] == [
        "source simulation: the simulation is slower than rate = 1; this machine is busy"
    ]


def test_a_machine_that_keeps_up_on_the_whole_loses_no_time(monkeypatch, caplog):
    found = drive_with(monkeypatch, [0.15, 0.0, 0.0, 0.0])
    robot_s, machine_s = (after - before for before, after in zip(found[0], found[-1], strict=True))
    assert machine_s == pytest.approx(robot_s, abs=0.1)
    assert not caplog.records
