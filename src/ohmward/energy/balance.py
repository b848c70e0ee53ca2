"""Energy balance of a recorded drive: power of each term over time, and the energies of the whole drive.

battery = idle + copper + drive + slip + rolling + climb + kinetic + residual

Losses are >= 0. `climb` and `kinetic` are useful energy, at least partly recovered: they are < 0 downhill and when
braking, and so is `battery` where the motors charge it. The residual holds what the models do not explain: the error of
the assumed rolling resistance, the efficiency of the electronics, and an unknown idle power.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.drive_log import DriveLog
from ohmward.traction.dynamics.forces import EnergyBalance, RobotInput, Scene, kinetic_energy, normal_loads
from ohmward.traction.robot.motor import copper_loss, friction_torque, ideal_torque
from ohmward.traction.robot.robot import GRAVITY, Robot
from ohmward.traction.speed_observer.estimate import SlipEstimate
from ohmward.traction.speed_observer.estimator import motion_of

#: Terms that add up to the battery's power on a recorded drive: no load is towed, and no motion is integrated.
DRIVE_TERMS = ("idle", "copper", "drive", "slip", "rolling", "climb", "kinetic", "residual")


class DriveEnergy(NamedTuple):
    """Energy of a whole drive."""

    balance: EnergyBalance  #: energy [J]
    #: standard deviation of each term that has one, for an error that lasts from start to end: an upper bound
    std_J: dict[str, float]
    regenerated_J: float  #: that flowed into the battery, >= 0; the rest of the braking energy is in the losses


def drive_balance(
    log: DriveLog,
    observed: SlipEstimate,
    p: Scene,
    battery_W: np.ndarray | None = None,
    idle_W: float | None = None,
) -> EnergyBalance:
    """Energy balance (T,) [W] of a recorded drive; nan where it was not measured.

    Where the traction is not known, the loss to slip is in the residual.

    log: with motor currents.
    observed: estimates of an observer along the log.
    p: robot and the ground assumed under it.
    battery_W: (T,) power out of the battery; by default that of the motors plus the idle power.
    idle_W: power of the electronics; by default the robot's.

    Raises:
        InputError: no motor currents, or shapes that differ.
    """
    robot, current_A = p.robot, log.motor_current_A
    if current_A.shape[1] != robot.driven or not np.isfinite(current_A).any():
        raise InputError(
            f"log {log.name!r}: the energy balance needs the currents of all {robot.driven} motors; without them only "
            "the battery's power is known"
        )
    for name, values in (("observed.speed_m_s", observed.speed_m_s), ("battery_W", battery_W)):
        if values is not None and np.shape(values) != (len(log),):
            raise InputError(f"{name} must have shape ({len(log)},) as the log, got {np.shape(values)}")
    omega = np.asarray(observed.wheel_speed_rad_s)
    copper = copper_loss(robot.motor, current_A).sum(axis=1)
    electrical = copper + (ideal_torque(robot.motor, current_A) * omega).sum(axis=1)
    idle = robot.idle_W if idle_W is None else idle_W
    motion = _motion(observed, robot)
    load_N = normal_loads(RobotInput(np.zeros(robot.driven)), robot, np.zeros(2))
    wheels = zip(p.terrains, (motion @ robot.rolling.T).T, load_N, strict=True)
    kinetic_J = kinetic_energy(np.column_stack([motion, observed.wheel_speed_rad_s]), robot.inertia)
    return EnergyBalance(
        battery=electrical + idle if battery_W is None else np.asarray(battery_W, dtype=float),
        electrical=electrical,
        idle=np.full(len(log), idle),
        copper=copper,
        drive=(friction_torque(robot.motor, current_A, omega) * omega).sum(axis=1),
        slip=np.nansum(observed.traction_N * observed.slip_speed_m_s, axis=1),
        rolling=-sum(t.rolling.force_N(v, np.full_like(v, N)) * v for t, v, N in wheels),
        climb=robot.mass_kg * GRAVITY * np.sin(observed.grade_rad) * np.asarray(observed.speed_m_s),
        kinetic=np.gradient(kinetic_J, log.time_s) if len(log) > 1 else np.zeros(len(log)),
    )


def integrate_drive(log: DriveLog, power: EnergyBalance, observed: SlipEstimate, robot: Robot) -> DriveEnergy:
    """Energies [J] of a drive by trapezoids over the samples where all terms are known; gaps are left out.

    power: (T,) [W] as `drive_balance` gives it.
    """
    known = np.isfinite(power.residual)
    half_s = 0.5 * np.diff(log.time_s) * (known[1:] & known[:-1])
    weight_s = np.concatenate([half_s, [0.0]]) + np.concatenate([[0.0], half_s])

    def energy_J(term_W: np.ndarray) -> float:
        return float(np.sum(weight_s * np.where(weight_s > 0, term_W, 0.0)))

    slip_std_W = np.nansum(np.abs(observed.traction_N) * observed.slip_speed_std_m_s, axis=1)
    climb_std_W = robot.mass_kg * GRAVITY * np.abs(observed.speed_m_s) * observed.grade_std_rad
    return DriveEnergy(
        EnergyBalance(*map(energy_J, power)),
        {"slip": energy_J(slip_std_W), "climb": energy_J(climb_std_W)},
        energy_J(np.maximum(-power.battery, 0.0)),
    )


def _motion(observed: SlipEstimate, robot: Robot) -> np.ndarray:
    """(T, freedoms) speeds of the body; for an omni-directional robot from its wheels, sideways speed included."""
    if robot.freedoms == 3:
        return motion_of(robot, observed)
    motion = np.zeros((len(observed.speed_m_s), robot.freedoms))
    motion[:, 0] = observed.speed_m_s
    motion[:, -1] = observed.yaw_rate_rad_s
    return motion


def running_integral(x: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Integral from the first sample to each sample, 0 at the first; x: (T,) or as values, values: (T,) or (T, N)."""
    widths = np.diff(x, axis=0)
    widths = widths.reshape(*widths.shape, *[1] * (values.ndim - x.ndim))
    areas = 0.5 * widths * (values[1:] + values[:-1])
    return np.concatenate([np.zeros_like(values[:1]), np.cumsum(areas, axis=0)])
