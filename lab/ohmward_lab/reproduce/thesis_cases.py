"""Cases I and II of [T], figures 5.6 to 5.9: a slip held on the slippery floor, after 0.12 on the normal one in II."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np

from ohmward.report import TIME, Figure, Series
from ohmward.traction import RLMA, RollingResistance
from ohmward.traction.friction.law import Contact, CoulombCreep
from ohmward.traction.robot.robot import GRAVITY
from ohmward_lab.reproduce.row import Result, ResultRow
from ohmward_lab.simulate.closed_loop import ClosedLoopRun, find_scenario, run
from ohmward_lab.simulate.closed_loop.run import figures, true_slip
from ohmward_lab.simulate.ground import SLIP_STIFFNESS_S_PER_M

#: The faster of [T]'s wheel speeds, the slip of both cases, and the friction of ice, the lowest of table 4.1; and for
#: how long (case I) and how far (case II) the slip is held.
_FAST_WHEEL_M_S, _SLIP, _ICE_FRICTION = 0.2, -0.18, 0.1
_PRINTED_S, _PRINTED_M = 6.0, 1.5
#: Speed [m/s] below which the robot has stopped.
_STOPPED_M_S = 0.005
_EULER_STEP_S = 1e-3

_STOPS = (
    "a slip below zero brakes. [T] prints no friction of its slippery floor; even on ice, the lowest of its table 4.1, "
    "a robot that is as fast as its wheels (0.1 and 0.2 m/s) has stopped long before"
)
_WHY = {
    "slip-case-1": (
        "[T] shows pictures that follow the wanted slip, without a number. Starts at 1 m/s, because at 0.2 m/s the "
        "drive is over before an observer has seen it; `default` is the observer of this package in place of [T]'s AUKF"
    ),
    "slip-case-2": (
        "from rest, with a drag of 32 v^2 that ends the acceleration: a robot that holds a slip holds a thrust; the "
        "friction of both floors is ours, [T] gives none"
    ),
}


class Stop(NamedTuple):
    """Time [s] and distance [m] until the robot has stopped."""

    time_s: float
    way_m: float


@cache
def stop_on_ice() -> Stop:
    """Both driven wheels hold -0.18 on ice, from 0.2 m/s; Euler steps of 1 ms."""
    law, rolling = CoulombCreep(_ICE_FRICTION, SLIP_STIFFNESS_S_PER_M), RollingResistance()
    weight_N = RLMA.mass_kg * GRAVITY
    driven_N = weight_N * float(RLMA.loads[: RLMA.driven, 0].sum())
    v, way_m, steps = _FAST_WHEEL_M_S, 0.0, 0
    while v > _STOPPED_M_S:
        rim_m_s = v * (1 + _SLIP)
        force_N = float(law.force_N(Contact(rim_m_s - v, rim_m_s, v, driven_N)) + rolling.force_N(v, weight_N))
        way_m += v * _EULER_STEP_S
        v += force_N / RLMA.mass_kg * _EULER_STEP_S
        steps += 1
    return Stop(steps * _EULER_STEP_S, way_m)


def case_1() -> Result:
    """Figures 5.6 and 5.7: braking at -0.18 on the slippery floor; and how long it can be held from [T]'s speed."""
    time_s = stop_on_ice().time_s
    row = ResultRow("Case I, from 0.2 m/s on ice: time at -0.18", "s", _PRINTED_S, time_s, time_s, None, _STOPS)
    return _case("slip-case-1", "Case I", row)


def case_2() -> Result:
    """Figures 5.8 and 5.9: 0.12 on the normal floor, from 6 s on -0.18 on the slippery one."""
    way_m = stop_on_ice().way_m
    row = ResultRow("Case II, from 0.2 m/s on ice: way at -0.18", "m", _PRINTED_M, way_m, way_m, None, _STOPS)
    return _case("slip-case-2", "Case II", row)


def _case(scenario: str, name: str, stop: ResultRow) -> Result:
    published, default = drive(scenario, "aukf"), drive(scenario, "ukf")
    rows = [stop]
    for k, (ours, theirs) in enumerate(zip(figures(published).slip, figures(default).slip, strict=True)):
        what = f"{name}, slip of {ours.slip_ratio:g}"
        why = _WHY[scenario] if k == 0 else ""
        rows.append(ResultRow(f"{what}: RMS error once settled", "", None, None, ours.rms_error, theirs.rms_error, why))
        rows.append(ResultRow(f"{what}: time until within 0.02", "s", None, None, ours.settle_s, theirs.settle_s))
    speeds = [_speed_error_mm_s(r) for r in (published, default)]
    rows.append(ResultRow(f"{name}, speed of the observer: RMS error", "mm/s", None, None, speeds[0], speeds[1]))
    return Result(tuple(rows), _figures(name, published))


@cache
def drive(scenario: str, method: str) -> ClosedLoopRun:
    """The case with slip and speed from this observer."""
    packaged = find_scenario(scenario)
    return run(replace(packaged, observer=replace(packaged.observer, method=method)))


def _speed_error_mm_s(found: ClosedLoopRun) -> float:
    score = figures(found).score
    return float("nan") if score is None else 1e3 * score.speed_rmse_m_s


def _figures(name: str, found: ClosedLoopRun) -> tuple[Figure, ...]:
    """Speeds, slip of a front wheel with its set-point, torque of its motor."""
    truth, rows = found.history.truth, found.rows
    t = truth.time_s
    commands = found.scenario.commands
    wanted = np.full(t.size, np.nan)
    for command in commands:
        wanted[t >= command.from_s] = np.nan if command.slip_ratio is None else command.slip_ratio
    rim = found.scenario.model.wheel.radius_m * truth.wheel_speed_rad_s[:, 0]
    speeds = [
        Series(t, truth.speed_m_s, "robot", "dashed", "reference"),
        Series(t, rim, "rim of a front wheel", role="comparison"),
    ]
    if rows.estimate is not None:
        speeds.append(Series(rows.time_s, rows.estimate.speed_m_s, "observer", role="estimate"))
    slip = [
        Series(t, wanted, "wanted", "dashed", "reference"),
        Series(t, true_slip(found.history, found.scenario.model)[:, 0], "true", role="estimate"),
    ]
    return (
        Figure(f"{name}: speed", TIME, "Speed [m/s]", speeds),
        Figure("Slip of a front wheel", TIME, "Slip ratio", slip),
        Figure("Torque of its motor", TIME, "Torque [N m]", [Series(t, truth.torque_N_m[:, 0], "motor")]),
    )
