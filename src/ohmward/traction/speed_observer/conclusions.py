"""What a belief means for people: slip with its sigma, forces, and whether anything shows the speed."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ohmward.trace import linearize, maximum, sqrt, where
from ohmward.traction.dynamics.slip import slip_ratio
from ohmward.traction.speed_observer.clean_sample import CleanSlipSample, every, some
from ohmward.traction.speed_observer.estimate import SlipEstimate, SlipFlag
from ohmward.traction.speed_observer.fusion import Fused
from ohmward.traction.speed_observer.model import Model
from ohmward.traction.speed_observer.slip_alarm import SlipAlarm

#: A wheel shows the speed of the body where its grip is at least this.
LEAST_GRIP = 0.2

#: So long [s] without anything that shows it, and the speed counts as unobserved.
UNOBSERVED_S = 0.5


class Known(NamedTuple):
    """How long [s] nothing has shown the speed, and how long the wheels have turned and the robot has not."""

    unobserved_s: Any
    stuck_s: Any


def conclude(
    fused: Fused, agrees: np.ndarray, before: Known, reading: CleanSlipSample, model: Model, test: SlipAlarm
) -> tuple[SlipEstimate, Known]:
    """What is known after a sample; agrees: (driven,) whether the encoder of a wheel was used."""
    x, P = fused.belief
    parts, n = model.layout.split(x), model.driven
    slip, H = linearize(model.slip, x)
    slip_std = np.array([std(H[k] @ P @ H[k]) for k in range(n)])
    grip = model.grip(x, np.array([where(s >= 0, s + e, s - e) for s, e in zip(slip, slip_std, strict=True)]))
    travel = model.scene.robot.rolling[:n] @ parts.motion
    rim = slip + travel

    shown = some([*(used & (g > LEAST_GRIP) for used, g in zip(agrees, grip, strict=True)), fused.shown > 0.5])
    unobserved_s = where(shown, 0.0, before.unobserved_s + reading.dt_s)
    stands = every(test.stands(v, s, w) for v, s, w in zip(travel, travel_std(P, model), rim, strict=True))
    stuck_s = test.standing_s(stands, before.stuck_s, reading.dt_s)
    yaw = model.layout.index("yaw_rate_rad_s")
    estimate = SlipEstimate(
        speed_m_s=x[0],
        speed_std_m_s=std(P[0, 0]),
        yaw_rate_rad_s=x[yaw],
        yaw_rate_std_rad_s=std(P[yaw, yaw]),
        wheel_speed_rad_s=parts.omega,
        slip_speed_m_s=slip,
        slip_speed_std_m_s=slip_std,
        slip_ratio=np.array([slip_ratio(a, b) for a, b in zip(rim, travel, strict=True)]),
        traction_N=model.traction_N(x),
        friction_ratio=parts.friction,
        friction_std=np.array([std_of(model.layout.friction_name(k), P, model) for k in range(n)]),
        grade_rad=model.input(x, reading).grade_rad,
        grade_std_rad=std_of("grade_rad", P, model),
        radius_ratio=parts.radius_ratio,
        radius_std=std_of("radius_ratio", P, model),
        grip=grip,
        unobserved_s=unobserved_s,
        slipping=np.array([where(test.slips(s, e, v), 1.0, 0.0) for s, e, v in zip(slip, slip_std, rim, strict=True)]),
        immobilised=where(stuck_s > test.stuck_s, 1.0, 0.0),
        flags=fused.flags + where(unobserved_s > UNOBSERVED_S, float(SlipFlag.SPEED_UNOBSERVED), 0.0),
    )
    return estimate, Known(unobserved_s, stuck_s)


def travel_std(P: np.ndarray, model: Model) -> np.ndarray:
    """Standard deviation (driven,) [m/s] of the speed of each wheel's centre along its rolling direction."""
    free, rows = model.scene.robot.freedoms, model.scene.robot.rolling[: model.driven]
    return np.array([std(row @ P[:free, :free] @ row) for row in rows])


def std_of(name: str, P: np.ndarray, model: Model) -> Any:
    """Standard deviation of a lasting state; 0 for one that is assumed."""
    if name not in model.layout.names:
        return 0.0
    i = model.layout.index(name)
    return std(P[i, i])


def std(variance: Any) -> Any:
    """The root of a variance that rounding may have made negative."""
    return sqrt(maximum(variance, 0.0))
