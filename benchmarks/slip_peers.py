"""The slip law beside a plain PI that was tuned at one friction, and the claim of the observer that both are given.

From rest to slip 0.12, and out of a spin of 0.6 s at the limit of the torque, on MuJoCo's ground and on a tyre whose
traction falls beyond a slip of 0.13. `slip_control.py` puts the tables on its page.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from figure import Figure, at_least, at_most, rms
from ohmward.filters.consistency import BAND_95
from ohmward.traction import RLMA, Terrain
from ohmward.traction.control import Measurement, SlipCommand, SlipController
from ohmward.traction.friction.law import Burckhardt
from ohmward.traction.robot.robot import GRAVITY, Robot
from ohmward_lab.simulate.closed_loop.traction_plant import TractionPlant
from ohmward_lab.simulate.ground import Grade, Patch
from ohmward_lab.simulate.mujoco_plant import RlmaParameters, RlmaPlant
from ohmward_lab.simulate.robot_sensors import RobotTruth
from ohmward_lab.traction.compared_slip_laws import SlipPid
from slip_loops import (
    COASTED_DOWN,
    DT,
    LIMITS,
    WHEEL,
    WIDER,
    Sensors,
    Stepper,
    observed_run,
    tracking,
)

TARGET, SPIN_S, DRIVE_S = 0.12, 0.6, 0.9
FRICTIONS, TUNED_AT = (0.15, 0.35, 0.65, 1.0), 0.5
SEEDS = (1, 2)
#: Burckhardt's wet asphalt: the peak is at a slip of 0.13, and a spinning wheel has 60 % of it.
WET = Burckhardt(0.857, 33.822, 0.347)
TYRES = ("MuJoCo's ground", "falling tyre")
SENSORS = {"time of edges": Sensors(edges=True), "counts": Sensors()}
#: To settle within [s], by sensors.
BARS = {"time of edges": 0.35, "counts": 0.5}
#: Gains [N m, N m/s] that the tuning of the PI tries.
GAINS = tuple((kp, ki) for kp in (10.0, 15.0, 20.0) for ki in (200.0, 600.0, 1000.0))


class FallingPatch(Patch):
    """Ground with the shape of wet asphalt and `friction` at its peak."""

    def ground(self, robot: Robot) -> Terrain:
        """The terrain under this robot's wheels."""
        share = (self.friction or 1.0) / WET.peak_adhesion
        return Terrain("falling", Burckhardt(share * WET.c1, WET.c2, share * WET.c3), COASTED_DOWN, "benchmark")


@cache
def plant_of(tyre: str, friction: float) -> Any:
    """The plant; it is reset before each run."""
    if tyre == TYRES[0]:
        return RlmaPlant(RlmaParameters(), [Patch(friction=friction)])
    return TractionPlant(RLMA, (FallingPatch(friction=friction),))


class Held(NamedTuple):
    """Time after which the slip stays within 0.02, RMS of the torque's change per step, and the least time [s] in which
    the full torque ends the spin."""

    settled_s: float
    step_Nm: float
    least_s: float


def held(law: Any, launch: float, tyre: str, friction: float, sensors: Sensors, seed: int, spin_s: float) -> Held:
    """One run on the observer's estimate."""
    control = Stepper(SlipController(WHEEL, law, LIMITS, launch=launch), lambda _: SlipCommand(TARGET))
    spinning = round(spin_s / DT)

    def step(time_s: float, m: Measurement) -> np.ndarray:
        k = round(time_s / DT)
        return np.full(2, LIMITS.torque_Nm) if k < spinning else control((k - spinning) * DT, m)

    truth = observed_run(step, plant_of(tyre, friction), spin_s + DRIVE_S, sensors, seed).truth
    driven = RobotTruth(*(column[spinning + 1 :] for column in truth))
    driven = driven._replace(time_s=driven.time_s - spin_s)
    change = np.diff(driven.torque_N_m[:, 0])
    settled_s = tracking(driven, TARGET, SPIN_S).settled_s
    return Held(settled_s, rms(change), least_s(driven) if spinning else 0.0)


def least_s(driven: RobotTruth) -> float:
    """Time in which the full torque and the ground's force end the spin at the start."""
    grip_Nm = WHEEL.radius_m * float(driven.traction_N[0, 0])
    slowing_rad_s2 = (LIMITS.torque_Nm + grip_Nm) / WHEEL.inertia_kg_m2
    return float(driven.slip_speed_m_s[0, 0]) / WHEEL.radius_m / slowing_rad_s2


@cache
def tuned_pi(tyre: str, name: str) -> SlipPid:
    """The PI of least settling time times change of torque, from rest at the one friction."""

    def cost(gains: tuple[float, float]) -> float:
        found = held(SlipPid(*gains), 1.0, tyre, TUNED_AT, SENSORS[name], SEEDS[0], 0.0)
        return min(found.settled_s, DRIVE_S) * found.step_Nm

    return SlipPid(*min(GAINS, key=cost))


def worst(law: Any, launch: float, tyre: str, friction: float, name: str, spin_s: float) -> Held:
    """The worst of the seeds, each figure on its own."""
    runs = [held(law, launch, tyre, friction, SENSORS[name], seed, spin_s) for seed in SEEDS]
    return Held(*(max(values) for values in zip(*runs, strict=True)))


@cache
def compared() -> tuple[tuple[str, str, str, float, Held, Held, SlipPid], ...]:
    """Start, sensors, tyre, friction, the slip law's runs, the PI's, and that PI."""
    default = SlipController(WHEEL, WIDER, LIMITS).launch
    found = []
    for name in SENSORS:
        for tyre in TYRES:
            pi = tuned_pi(tyre, name)
            for start, spin_s in (("rest", 0.0), ("spin", SPIN_S)):
                for mu in FRICTIONS:
                    ours = worst(WIDER, default, tyre, mu, name, spin_s)
                    found.append((start, name, tyre, mu, ours, worst(pi, 1.0, tyre, mu, name, spin_s), pi))
    return tuple(found)


def compared_rows() -> Iterator[str]:
    """Lines of the table."""
    for start, name, tyre, mu, ours, pi, gains in compared():
        tuned = f"{gains.proportional_Nm:g}, {gains.integral_Nm_per_s:g}"
        least = f"{ours.least_s:.2f}" if ours.least_s else ""
        cells = " | ".join(f"{seconds(h.settled_s)} | {1e3 * h.step_Nm:.0f}" for h in (ours, pi))
        yield f"| {start} | {name} | {tyre} | {mu} | {least} | {cells} | {tuned} |"


def seconds(settled_s: float) -> str:
    """A time to settle in words."""
    return f"{settled_s:.2f}" if math.isfinite(settled_s) else "never"


def compared_figures() -> Iterator[Figure]:
    """The worst over the frictions, with the bars; out of a spin beyond the time that the full torque needs."""
    for name, bar in BARS.items():
        for tyre in TYRES:
            for start in ("rest", "spin"):
                runs = [(ours, pi) for s, n, t, _, ours, pi, _ in compared() if (s, n, t) == (start, name, tyre)]
                case = f"{tyre}, friction {FRICTIONS[0]} to {FRICTIONS[-1]}"
                beyond = max(ours.settled_s - ours.least_s for ours, _ in runs)
                what = (
                    "to slip 0.12 from rest [s]" if start == "rest" else "to slip 0.12 beyond the spin's least time [s]"
                )
                yield at_most(case, f"slip law, {name}", what, beyond, bar)
                share = max(ours.step_Nm / pi.step_Nm for ours, pi in runs)
                yield at_most(case, f"slip law, {name}", f"torque step RMS over a tuned PI's, {start}", share, 1.0)


class Claim(NamedTuple):
    """Mean NEES of the speed, share of the samples in its 95 % band, RMSE [m/s]."""

    nees: float
    covered: float
    rmse_m_s: float


@cache
def claim(passive: bool) -> Claim:
    """The momentum observer while mass, grade and turning are drawn and the torque jumps."""
    sensors = Sensors(passive=passive)
    rng = np.random.default_rng(8)
    runs = [jumping(sensors, mu, rng, seed) for mu in FRICTIONS for seed in range(6)]
    error, std = np.concatenate(runs).T
    z = error / std
    return Claim(float(np.mean(z**2)), float(np.mean(np.abs(z) <= BAND_95)), rms(error))


def jumping(sensors: Sensors, friction: float, rng: np.random.Generator, seed: int) -> np.ndarray:
    """(T, 2) error and standard deviation of the speed under torques that jump four times a second."""
    grade = rng.uniform(-0.1, 0.1)
    parameters = replace(RlmaParameters(), mass_kg=rng.uniform(0.7, 1.3) * RLMA.mass_kg)
    plant = RlmaPlant(parameters, [Patch(friction=friction)], Grade(grade_rad=(grade,)))
    turning = rng.choice([0.0, 0.4]) * np.array([-1.0, 1.0])
    torques = rng.uniform(-3.0, 8.0, 8)
    feels = np.array([GRAVITY * math.sin(grade), 0.0, GRAVITY * math.cos(grade)])
    truth, e = observed_run(
        lambda time_s, _: torques[round(time_s / DT) // 250] * (1.0 + turning),
        plant,
        2.0,
        sensors,
        seed,
        resting=plant.reset()._replace(specific_force_m_s2=feels),
    )
    return np.column_stack([e.speed_m_s - truth.speed_m_s, e.speed_std_m_s])[50::50]


CLAIMS: dict[str, Callable[[], Claim]] = {
    "driven encoders, currents, IMU": lambda: claim(False),
    "and encoders on the passive wheels": lambda: claim(True),
}


def claim_rows() -> Iterator[str]:
    """Lines of the table."""
    for name, find in CLAIMS.items():
        c = find()
        yield f"| {name} | {c.nees:.2f} | {100 * c.covered:.0f} % | {1e3 * c.rmse_m_s:.1f} |"


def claim_figures() -> Iterator[Figure]:
    """The same with their bars."""
    case = "MuJoCo, friction 0.15 to 1.0, mass +-30 %, grade +-0.1, turning"
    for name, find in CLAIMS.items():
        c = find()
        yield at_most(case, f"MomentumObserver; {name}", "NEES of the speed", c.nees, 2.0)
        yield at_least(case, f"MomentumObserver; {name}", "speed in its 95 % band [%]", 100 * c.covered, 90.0)
