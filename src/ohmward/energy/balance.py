"""Where the power of a drive goes: every part by itself, and the sum is the whole exactly.

battery = idle + copper + drive + slip + rolling + climb + acceleration + unexplained

Losses are >= 0. `climb` and `acceleration` are useful and come back, or part of them: downhill and braking they are
< 0, and so is `battery` where the motors feed it. `unexplained` is what the models do not account for: 0 for a
simulated robot; in a recorded drive the error of the assumed rolling resistance and of the efficiency of the
electronics.
"""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.drive_log import DriveLog
from ohmward.traction.dynamics.forces import Forces, RobotInput, Scene, momentum_rates, normal_loads
from ohmward.traction.dynamics.power import power
from ohmward.traction.robot.motor import copper_loss, friction_torque, ideal_torque
from ohmward.traction.robot.robot import GRAVITY, Robot


class PowerSplit(NamedTuple):
    """Watts (T,), or joules where added up over time.

    battery: the whole, > 0 out of the battery.
    idle: electronics.
    copper: heats the windings.
    drive: lost in gears and bearings.
    slip: lost between wheel and ground.
    rolling: lost to rolling resistance.
    climb: lifts the robot.
    acceleration: kinetic energy of body and wheels.
    unexplained: the rest.
    """

    battery: Any
    idle: Any
    copper: Any
    drive: Any
    slip: Any
    rolling: Any
    climb: Any
    acceleration: Any
    unexplained: Any


#: The parts, in the order in which they add up to the whole.
PARTS = PowerSplit._fields[1:]


class DriveEnergy(NamedTuple):
    """A drive added up.

    parts: energy [J].
    std_J: of each part of which an uncertainty is known, as if its error lasted from start to end: an upper bound.
    regenerated_J: that flowed into the battery, >= 0; the rest of the braking is in the losses.
    """

    parts: PowerSplit
    std_J: dict[str, float]
    regenerated_J: float


class ObservedMotion(Protocol):
    """What the split needs of an observer's estimates along a drive, (T,) and (T, driven)."""

    @property
    def speed_m_s(self) -> np.ndarray: ...  # noqa: D102
    @property
    def yaw_rate_rad_s(self) -> np.ndarray: ...  # noqa: D102
    @property
    def wheel_speed_rad_s(self) -> np.ndarray: ...  # noqa: D102
    @property
    def slip_speed_m_s(self) -> np.ndarray: ...  # noqa: D102
    @property
    def slip_speed_std_m_s(self) -> np.ndarray: ...  # noqa: D102
    @property
    def traction_N(self) -> np.ndarray: ...  # noqa: D102
    @property
    def grade_rad(self) -> np.ndarray: ...  # noqa: D102
    @property
    def grade_std_rad(self) -> np.ndarray: ...  # noqa: D102


def model_split(x: np.ndarray, u: RobotInput, p: Scene, f: Forces) -> PowerSplit:
    """The split [W] of a simulated robot in state x with the forces `f`; a pull behind it counts as climbing."""
    w = power(x, u, p, f)
    return _closed(
        p.robot.idle_W + w.electrical,
        idle=p.robot.idle_W,
        copper=w.copper,
        drive=w.drive,
        slip=w.slip,
        rolling=w.rolling,
        climb=w.climb + w.drawbar,
        acceleration=momentum_rates(x, u, p, f) @ x,
    )


def drive_split(
    log: DriveLog, seen: ObservedMotion, p: Scene, battery_W: np.ndarray | None = None, idle_W: float | None = None
) -> PowerSplit:
    """The split (T,) [W] of a recorded drive; nan where it was not measured.

    log: with motor currents.  seen: what an observer made of it.  p: robot and the ground that it is believed to be on.
    battery_W: (T,) power out of the battery; without it the whole is that of the motors and the idle draw.
    idle_W: of the electronics; by default the robot's.

    Raises:
        InputError: no motor currents, or shapes that differ.
    """
    robot, current_A = p.robot, log.motor_current_A
    _check(log, seen, battery_W, robot)
    omega, v = np.asarray(seen.wheel_speed_rad_s), np.asarray(seen.speed_m_s)
    copper = copper_loss(robot.motor, current_A).sum(axis=1)
    electrical = copper + (ideal_torque(robot.motor, current_A) * omega).sum(axis=1)
    idle = robot.idle_W if idle_W is None else idle_W
    return _closed(
        electrical + idle if battery_W is None else np.asarray(battery_W, dtype=float),
        idle=np.full(len(log), idle),
        copper=copper,
        drive=(friction_torque(robot.motor, current_A, omega) * omega).sum(axis=1),
        slip=(np.asarray(seen.traction_N) * seen.slip_speed_m_s).sum(axis=1),
        rolling=_rolling_W(seen, p),
        climb=robot.mass_kg * GRAVITY * np.sin(seen.grade_rad) * v,
        acceleration=_kinetic_rate_W(log.time_s, seen, robot),
    )


def add_up(log: DriveLog, split: PowerSplit, seen: ObservedMotion, robot: Robot) -> DriveEnergy:
    """Energies [J] of a drive by trapezoids over the samples where all parts are known; gaps are left out."""
    known = np.isfinite(np.sum(split, axis=0))
    weight_s = _weights(log.time_s, known)
    slip_std_W = (np.abs(seen.traction_N) * seen.slip_speed_std_m_s).sum(axis=1)
    climb_std_W = robot.mass_kg * GRAVITY * np.abs(seen.speed_m_s) * seen.grade_std_rad
    std_W = {"slip": slip_std_W, "climb": climb_std_W}
    return DriveEnergy(
        PowerSplit(*(_sum(weight_s, part) for part in split)),
        {name: _sum(weight_s, value) for name, value in std_W.items()},
        _sum(weight_s, np.maximum(-split.battery, 0.0)),
    )


def _closed(battery: Any, **parts: Any) -> PowerSplit:
    """The parts with the rest, so that they add up."""
    return PowerSplit(battery=battery, **parts, unexplained=battery - sum(parts.values()))


def _rolling_W(seen: ObservedMotion, p: Scene) -> np.ndarray:
    """(T,) loss to rolling resistance on the ground that is assumed."""
    robot = p.robot
    motion = np.zeros((len(seen.speed_m_s), robot.freedoms))
    motion[:, 0], motion[:, -1] = seen.speed_m_s, seen.yaw_rate_rad_s
    travel = motion @ robot.rolling.T
    load_N = normal_loads(RobotInput(np.zeros(robot.driven)), robot, np.zeros(2))
    wheels = zip(p.terrains, travel.T, load_N, strict=True)
    return -sum(t.rolling.force_N(v, np.full_like(v, N)) * v for t, v, N in wheels)


def _kinetic_rate_W(time_s: np.ndarray, seen: ObservedMotion, robot: Robot) -> np.ndarray:
    """(T,) rate of change of the kinetic energy of body and driven wheels."""
    inertia = robot.inertia
    energy_J = 0.5 * (
        inertia[0] * np.square(seen.speed_m_s) + inertia[robot.freedoms - 1] * np.square(seen.yaw_rate_rad_s)
    )
    energy_J = energy_J + 0.5 * np.square(seen.wheel_speed_rad_s) @ inertia[robot.freedoms :]
    return np.gradient(energy_J, time_s) if len(time_s) > 1 else np.zeros(len(time_s))


def _weights(time_s: np.ndarray, known: np.ndarray) -> np.ndarray:
    """(T,) weights [s] of trapezoids between neighbouring samples that are both known."""
    half_s = 0.5 * np.diff(time_s) * (known[1:] & known[:-1])
    return np.concatenate([half_s, [0.0]]) + np.concatenate([[0.0], half_s])


def _sum(weight_s: np.ndarray, values: np.ndarray) -> float:
    return float(np.sum(weight_s * np.where(weight_s > 0, values, 0.0)))


def _check(log: DriveLog, seen: ObservedMotion, battery_W: np.ndarray | None, robot: Robot) -> None:
    if log.motor_current_A.shape[1] != robot.driven or not np.isfinite(log.motor_current_A).any():
        raise InputError(
            f"log {log.name!r}: the split of the power needs the currents of all {robot.driven} motors; without them "
            "only the whole is known"
        )
    for name, values in (("seen.speed_m_s", seen.speed_m_s), ("battery_W", battery_W)):
        if values is not None and np.shape(values) != (len(log),):
            raise InputError(f"{name} must have shape ({len(log)},) as the log, got {np.shape(values)}")
