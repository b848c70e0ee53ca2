"""Simulated robot in closed loop, in real time, as `ohmward run --demo` shows it without hardware."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ohmward.onboard.message import Message, Put
from ohmward.onboard.part import LOG, EndedError
from ohmward.onboard.sources.simulation import SimulationSource
from ohmward_lab.simulate.closed_loop import Command, Control, Grade, Pack, Patch, Scenario, Sensing, find_scenario
from ohmward_lab.simulate.closed_loop.loop import ClosedLoopDrive
from ohmward_lab.simulate.closed_loop.run import RunRow, body_signals
from ohmward_lab.simulate.robot_sensors import stack

#: Time that is simulated in one go [s]; messages are sent on time all the same.
_CHUNK_S = 0.1

#: Lag [s] of the simulation beyond which the clock of a robot driven by an operator is reset to now: a controller
#: accepts no estimates that are .08 s old.
_TOO_SLOW_S = 0.03

#: Largest lag [s] that a robot driving by itself catches up; beyond it its clock is reset to now.
_MOST_LATE_S = 0.5

#: Times that differ by less are equal: sums of steps are rounded.
_TIME_EPS_S = 1e-9

#: A round of the demonstration, as start time [s], speed [m/s] and yaw rate [rad/s]: along, turn, back, turn, rest.
_ROUND = ((0.0, 0.8, 0.0), (8.0, 0.5, 0.5), (14.3, 0.8, 0.0), (22.3, 0.5, 0.5), (28.6, 0.0, 0.0))
_ROUND_S, _ROUNDS = 34.0, 400


def demonstration(seed: int = 1) -> Scenario:
    """RLMA driving rounds for some hours on a floor with a wet patch and a gentle slope, from a full battery."""
    starts = [(k * _ROUND_S + from_s, speed, turn) for k in range(_ROUNDS) for from_s, speed, turn in _ROUND]
    return Scenario(
        name="demonstration",
        duration_s=_ROUNDS * _ROUND_S,
        commands=tuple(Command(from_s, speed_m_s=speed, yaw_rate_rad_s=turn) for from_s, speed, turn in starts),
        robot="rlma",
        battery=Pack("lfp", 1.0),
        ground=(Patch(friction=0.8, rolling=0.02), Patch(friction=0.08, rolling=0.02, from_m=2.5, to_m=4.0)),
        grade=Grade((4.0, 4.5, 6.0, 6.5), (0.0, 0.04, 0.04, 0.0)),
        sensors=Sensing(interval_s=0.02, encoders="all", pitch=True),
        controller=Control(slip_bound=0.3, acceleration_m_s2=0.8, interval_s=0.002),
        seed=seed,
    )


def scenario_of(settings: SimulationSource) -> Scenario:
    """The scenario that the settings name, with their seed."""
    scenario = find_scenario(settings.scenario) if settings.scenario else demonstration(settings.seed)
    return replace(scenario, seed=settings.seed)


async def run(settings: SimulationSource, put: Put) -> None:
    """Drive to the end of the scenario, or until the battery is empty; sensors use the clock of the drive.

    A battery that starts full comes from a charger, which reports it. On a machine that is too slow the drive takes
    longer than it should, and its clock runs slow accordingly.
    """
    drive = await asyncio.to_thread(ClosedLoopDrive, scenario_of(settings))
    rows = await asyncio.to_thread(_advance, drive, _CHUNK_S)  # compiles the rest, before the clock begins
    began_s = _begin(settings, drive, put, 0.0)
    lost_s = 0.0
    while True:
        for at_s, values in rows:
            late_s = time.monotonic() - began_s - lost_s - at_s / settings.rate
            if late_s > _MOST_LATE_S:
                if not lost_s:
                    message = "source %s: the simulation is slower than rate = %g; this machine is busy"
                    LOG.warning(message, settings.name, settings.rate)
                lost_s, late_s = lost_s + late_s, 0.0
            await asyncio.sleep(max(-late_s, 0.0))
            put(Message(at_s, began_s + at_s, settings.name, values))
        if drive.truth.time_s >= drive.scenario.duration_s or drive.empty:
            break
        rows = await asyncio.to_thread(_advance, drive, _CHUNK_S)
    raise EndedError("the battery is empty" if drive.empty else "the drive has come to its end")


async def drive(settings: SimulationSource, put: Put, torque_Nm: Callable[[Sequence[str]], np.ndarray]) -> None:
    """Start at rest on the scenario's ground and drive with these torques, in real time, until the battery is empty.

    torque_Nm: present torques of the driven wheels, by name.  A torque acts from the next sample on, as on a bus.
    """
    still = (Command(torque_Nm=0.0, mode="torque"),)
    scenario = replace(scenario_of(settings), commands=still, duration_s=_ROUNDS * _ROUND_S, start_speed_m_s=0.0)
    drive = await asyncio.to_thread(ClosedLoopDrive, scenario)
    wheels = drive.robot.driven_wheels
    interval_s = scenario.sensors.interval_s
    await asyncio.to_thread(_advance, drive, interval_s)  # compiles the rest, before the clock begins
    began_s = _begin(settings, drive, put, time.monotonic()) - drive.truth.time_s
    while not drive.empty:
        drive.hold(torque_Nm(wheels))
        rows = await asyncio.to_thread(_advance, drive, interval_s)
        behind_s = time.monotonic() - began_s - drive.truth.time_s
        began_s += behind_s if behind_s > _TOO_SLOW_S else 0.0
        await asyncio.sleep(max(-behind_s, 0.0))
        for at_s, values in rows:
            put(Message(began_s + at_s, began_s + at_s, settings.name, values))
    raise EndedError("the battery is empty")


def _begin(settings: SimulationSource, drive: ClosedLoopDrive, put: Put, stamp_s: float) -> float:
    """Monotonic time at which the drive begins; where the battery starts full, the charger's message is sent."""
    began_s = time.monotonic()
    if drive.scenario.battery.start_soc == 1.0:
        put(Message(stamp_s, began_s, settings.name, {"battery_full": 1.0}))
    return began_s


def _advance(drive: ClosedLoopDrive, ahead_s: float) -> list[tuple[float, dict[str, float]]]:
    """Simulate `ahead_s` further; return times and values of the samples that have arrived."""
    until_s = drive.truth.time_s + ahead_s - _TIME_EPS_S
    while drive.truth.time_s < until_s and not drive.empty:
        drive.step()
    if not drive.rows:
        return []
    columns = signals_of(stack(drive.rows), [place.name for place in drive.robot.places])
    times_s = columns.pop("time_s").tolist()
    drive.rows = []
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    values = [{s: v for s, v in zip(columns, row, strict=True) if math.isfinite(v)} for row in rows]
    return list(zip(times_s, values, strict=True))


def signals_of(rows: RunRow, places: list[str]) -> dict[str, np.ndarray]:
    """Time and measurements (T,) of a drive by signal, nan where nothing was measured."""
    sample = rows.sample
    found = {"time_s": rows.time_s, "battery_current_A": rows.current_A, "battery_voltage_V": rows.voltage_V}
    found |= {f"wheel_speed_rad_s.{name}": sample.wheel_speed_rad_s[:, k] for k, name in enumerate(places)}
    driven = places[: sample.current_A.shape[1]]
    found |= {f"motor_current_A.{name}": sample.current_A[:, k] for k, name in enumerate(driven)}
    return found | body_signals(rows)
