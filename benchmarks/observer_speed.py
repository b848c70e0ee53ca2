"""Time of a step of the speed observer."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

import numpy as np

from ohmward.trace import Kernel
from ohmward.traction import RLMA, RollingResistance, Terrain, scene
from ohmward.traction.friction.law import WardIagnemma
from ohmward.traction.motion.sample import RobotSample
from ohmward.traction.speed_observer.speed_observer import SpeedObserver
from ohmward.traction.speed_observer.states import KNOWN_GROUND, States

STEPS, REPEATS = 5_000, 7
FLOOR = scene(RLMA, Terrain("rubber", WardIagnemma(0.7, 20.0), RollingResistance(), "[T] 4.3"))
OBSERVERS = {
    "four-state AUKF of [T], faults handled": SpeedObserver(FLOOR, KNOWN_GROUND, matching=True),
    "four-state AEKF": SpeedObserver(FLOOR, KNOWN_GROUND, method="ekf", matching=True),
    "default UKF, friction, grade, rolling and radius estimated": SpeedObserver(FLOOR, States()),
    "default EKF": SpeedObserver(FLOOR, States(), method="ekf"),
}


class StepTime(NamedTuple):
    """Seconds of one step in a log, and its operations."""

    name: str
    seconds: float
    operations: int


def step_times(repeats: int = REPEATS) -> Iterator[StepTime]:
    """Of every observer."""
    for name, observer in OBSERVERS.items():
        samples = drive(observer)
        first = RobotSample(*(np.asarray(c)[0] for c in samples))
        state = observer.init(first)
        kernel = Kernel(observer.step, state, first, lowering="python")
        kernel.scan(state, samples)
        log = partial(kernel.scan, state, samples)
        step_s = statistics.median(seconds(log) for _ in range(repeats)) / STEPS
        yield StepTime(name, step_s, len(kernel.program.nodes))


def drive(observer: SpeedObserver) -> RobotSample:
    """Encoders and currents of a robot between 2 and 4 rad/s."""
    rng, t = np.random.default_rng(0), 0.01 * np.arange(STEPS)
    speeds = np.full((STEPS, 4), np.nan)
    speeds[:, :2] = (3 + np.sin(t))[:, None] + 0.05 * rng.standard_normal((STEPS, 2))
    current = np.column_stack([0.36 + 2.3 * np.cos(t)] * 2)
    nothing = np.full(STEPS, np.nan)
    blank = observer.no_sample()
    columns = dict.fromkeys(blank._fields, nothing) | {"speed_age_s": np.zeros(STEPS)}
    return RobotSample(**(columns | {"dt_s": np.full(STEPS, 0.01), "wheel_speed_rad_s": speeds, "current_A": current}))


def seconds(run: Callable[[], object]) -> float:
    """Time of the processor, so that what else runs on the machine counts little."""
    began = time.process_time()
    run()
    return time.process_time() - began
