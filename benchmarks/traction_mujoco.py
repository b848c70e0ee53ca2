"""Speed observer on the robot in MuJoCo, and the energy balance of our own plant.

The drives are those of tests/lab/observed_drives with other seeds: radius off by 0.5 %, grade by one degree, the
creep of the ground 1.5 times the assumed one, each as the observer's sigma says.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from figure import Figure, at_least, at_most
from ohmward.filters import Belief, kalman
from ohmward.filters.consistency import mean_bounds
from ohmward.trace import Kernel
from ohmward.traction import RLMA, RobotInput, RollingResistance, hard_terrain, scene
from ohmward.traction.friction.law import WardIagnemma
from ohmward.traction.robot.robot import GRAVITY
from ohmward.traction.speed_observer.noise import ObserverNoise
from ohmward_lab.simulate.implicit_step import step

sys.path.extend(str(Path(__file__).resolve().parents[1] / folder) for folder in ("tests", "tests/lab"))

from observed_drives import mujoco_runs as runs

SEEDS = range(500, 512)
NEES_LOWER, NEES_UPPER = mean_bounds(1, len(SEEDS), 0.999)
FIRST_SECOND, FIRST_HALF = 100, 50


def rows() -> Iterator[Figure]:
    """Every figure of this page."""
    yield from gripping()
    yield from spinning_with_speed()
    yield from spinning_otherwise()
    yield from wrong_ground()
    yield from energy_balance()


def gripping() -> Iterator[Figure]:
    """Between 0.1 and 0.5 m/s on a floor of 0.8; the first second shows how much the ground creeps."""
    for method in ("ukf", "ekf"):
        found = drives(0.8, runs.cruising, method=method)
        yield from judged("wheels grip", f"{method.upper()}, encoders and currents", found, FIRST_SECOND, 5.0)


def spinning_with_speed() -> Iterator[Figure]:
    """Full spin on a floor of 0.2 from the start, with a speed from outside at 10 Hz."""
    for std, bar in ((0.03, 20.0), (0.05, None)):
        sensors = {"speed_every": 10, "speed_std": std}
        found = drives(0.2, runs.spinning, ObserverNoise(speed_std_m_s=std), **sensors)
        yield from judged("full spin", f"UKF, external speed of {std} m/s at 10 Hz", found, FIRST_HALF, bar)
        noise = ObserverNoise(speed_std_m_s=std, pitch_std_rad=0.005)
        found = drives(0.2, runs.spinning, noise, pitch_std=0.005, **sensors)
        yield from judged("full spin", f"UKF, external speed of {std} m/s and pitch", found, FIRST_HALF, bar)
        least = 1e3 * least_rmse_m_s(std)
        yield at_most(
            "MuJoCo, full spin",
            f"bound of any filter, external speed of {std} m/s at 10 Hz",
            "speed RMSE [mm/s]",
            least,
        )


def least_rmse_m_s(speed_std_m_s: float) -> float:
    """RMSE from half a second on of a filter to which all but a constant push is known: that of one degree of grade.

    Covariance of the Kalman filter for v' = v + a dt, a' = a, with v_0 known to 3 mm/s, over the 4 s of a drive.
    """
    F, H, R = np.array([[1.0, 0.01], [0.0, 1.0]]), np.array([[1.0, 0.0]]), np.array([[speed_std_m_s**2]])
    belief = Belief(np.zeros(2), np.diag([0.003, GRAVITY * np.radians(1.0)]) ** 2)
    variances = []
    for k in range(400):
        belief = kalman.predict(belief, F, np.zeros((2, 2)))
        if k % 10 == 0:
            belief, _ = kalman.update(belief, np.zeros(1), H, R)
        variances.append(belief.cov[0, 0])
    return float(np.sqrt(np.mean(variances[FIRST_HALF:])))


def spinning_otherwise() -> Iterator[Figure]:
    """Full spin with encoders and currents only, and with a passive wheel."""
    alone = drives(0.2, runs.spinning)
    yield from consistent("full spin", "UKF, encoders and currents", alone)
    growth = (alone.estimate.speed_std_m_s[-1] - alone.estimate.speed_std_m_s[99]) / (4.0 - 1.0)
    yield at_most("MuJoCo, full spin", "UKF, encoders and currents", "growth of sigma [m/s per s]", growth)
    passive = drives(0.2, runs.spinning, ObserverNoise(passive_std_rad_s=0.07), passive=True)
    yield from judged("full spin", "UKF, one axle of passive wheels", passive, FIRST_HALF, None)


def wrong_ground() -> Iterator[Figure]:
    """Ground that creeps 2.2 times as much as believed; rolling resistance believed to grow with speed."""
    stiff = runs.FLOOR._replace(traction=WardIagnemma(0.7, 20.0))
    found = drives(0.8, runs.cruising, terrain=stiff)
    yield from judged("wheels grip, creep 2.2 times", "UKF, encoders and currents", found, FIRST_SECOND, None)
    growing = runs.FLOOR._replace(rolling=RollingResistance())
    found = drives(0.8, runs.cruising, terrain=growing)
    yield from judged("wheels grip, wrong rolling resistance", "UKF, encoders and currents", found, FIRST_SECOND, None)
    found = drives(0.2, runs.spinning, terrain=growing)
    yield from consistent("full spin, wrong rolling resistance", "UKF, encoders and currents", found)


def drives(friction: float, torque, noise: ObserverNoise | None = None, **others) -> runs.Runs:
    return runs.drives(friction, torque, 4.0, noise, seeds=SEEDS, **others)


def judged(data: str, method: str, found: runs.Runs, first: int, bar_mm_s: float | None) -> Iterator[Figure]:
    """RMSE of the speed from sample `first` on, and whether its sigma holds."""
    yield at_most(f"MuJoCo, {data}", method, "speed RMSE [mm/s]", 1e3 * runs.rmse(found.error[:, first:]), bar_mm_s)
    yield from consistent(data, method, found)


def consistent(data: str, method: str, found: runs.Runs) -> Iterator[Figure]:
    """Mean NEES over the runs, the largest of four times and the mean of them, against its 99.9 % bounds."""
    means = runs.mean_nees(found.normalised)
    bars = (NEES_UPPER, NEES_LOWER) if method.startswith("UKF") else (None, None)
    yield at_most(f"MuJoCo, {data}", method, "NEES of the speed, largest", float(means.max()), bars[0], ".2f")
    yield at_least(f"MuJoCo, {data}", method, "NEES of the speed, mean", float(means.mean()), bars[1], ".2f")


def energy_balance() -> Iterator[Figure]:
    """Electrical = losses + climb + drawbar + kinetic + numerical in every step of a drive with spin and braking."""
    place = scene(RLMA, hard_terrain("dry asphalt"))

    def one(x: np.ndarray, current_A: np.ndarray):
        result = step(x, RobotInput(current_A, grade_rad=0.02), place, 0.005)
        return result.state, result.energy

    time_s = 0.005 * np.arange(2000)
    current = 25.0 * np.sin(time_s)[:, None] * np.array([1.0, 0.7])
    _, energy = Kernel(one, np.zeros(4), np.zeros(2)).scan(np.zeros(4), current)
    throughput = np.sum(abs(energy.electrical) + energy.losses + abs(energy.kinetic))
    defect = float(np.sum(abs(energy.residual)) / throughput)
    yield at_most("own plant, 10 s", "ALEXANDER", "defect of the energy balance over the throughput", defect, 1e-9)
