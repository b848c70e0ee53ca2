"""Slip on floors sample by sample, as a robot has it, and what looking ahead would add; part of `robotino.py`.

Looking ahead is smoothing of what is believed of the floors over the whole run. With P(t) the belief (C,) at a sample
and A the shares of it that pass to each combination of floors until the next,

    P_s(t) = P(t) * A [P_s(t+1) / (A' P(t))]
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from ohmward.filters.belief import unpack
from ohmward.logs.drive_log import DriveLog
from ohmward.trace import Kernel
from ohmward.traction.terrain.estimate import FloorEstimate
from ohmward.traction.terrain.slip_on_floors import (
    FloorRun,
    FloorState,
    SlipOnFloors,
    first_of,
    knows_motion,
    wheel_samples,
    with_friction,
)
from ohmward.traction.terrain.wheel_filter import WheelBelief, WheelSample


class Seen(NamedTuple):
    """Beliefs after a sample: of the wheels, and of the combinations of floors (C,)."""

    wheels: WheelBelief
    combinations: np.ndarray


def live(estimator: SlipOnFloors, logs: Mapping[int, DriveLog]) -> dict[int, FloorRun]:
    """The track of each log from samples that come one by one."""
    stepper = estimator.kernel.live(estimator.init(estimator.no_sample()))
    found = {}
    for number, log in logs.items():
        samples = wheel_samples(log, estimator.wheels.robot.driven)
        stepper.state = estimator.init(first_of(samples))
        estimates = [stepper.step(WheelSample(*row)) for row in zip(*samples, strict=True)]
        columns = (np.array(values) for values in zip(*estimates, strict=True))
        found[number] = FloorRun(log.time_s, FloorEstimate(*columns), 0.0)
    return found


def looking_ahead(estimator: SlipOnFloors, logs: Mapping[int, DriveLog]) -> dict[int, FloorRun]:
    """The track of each log with the floors smoothed over all of it."""
    blank = estimator.no_sample()
    state = estimator.init(blank)
    seeing = Kernel(partial(_seen, estimator), state, blank)
    _, (example, _) = _seen(estimator, state, blank)
    concluding = Kernel(partial(_concluded, estimator), 0.0, example)
    found = {}
    for number, log in logs.items():
        samples = wheel_samples(log, estimator.wheels.robot.driven)
        _, (seen, filtered) = seeing.scan(estimator.init(first_of(samples)), samples)
        belief = smoothed(estimator, seen.combinations, samples.dt_s)
        _, ahead = concluding.scan(0.0, seen._replace(combinations=belief))
        crossings = {name: getattr(filtered, name) for name in ("crossing", "drag_before", "drag_after")}
        found[number] = FloorRun(log.time_s, ahead._replace(**crossings), 0.0)
    return found


def smoothed(estimator: SlipOnFloors, belief: np.ndarray, dt_s: np.ndarray) -> np.ndarray:
    """Belief (T, C) in the combinations of floors, given the whole run, from that after each sample (T, C)."""
    r, after = estimator.recognition, belief.copy()
    for t in range(len(belief) - 2, -1, -1):
        change = 1.0 - np.exp(-r.crossing_rate * dt_s[t + 1])
        A = (1.0 - change) * np.eye(len(r.changes)) + change * r.changes
        after[t] = belief[t] * (A @ (after[t + 1] / np.maximum(belief[t] @ A, 1e-300)))
        after[t] /= after[t].sum()
    return after


def _seen(estimator: SlipOnFloors, state: FloorState, sample: WheelSample) -> tuple[FloorState, Any]:
    after, estimate = estimator.step(state, sample)
    free, (x, P) = estimator.wheels.robot.freedoms, unpack(after.wheels.belief)
    std = np.sqrt(np.diag(P))
    wheels = WheelBelief(x[:free], std[:free], x[free:], std[free:])
    return after, (Seen(with_friction(estimator.wheels.robot, wheels), after.combinations), estimate)


def _concluded(estimator: SlipOnFloors, nothing: float, seen: Seen) -> tuple[float, FloorEstimate]:
    probability = estimator.recognition.by_wheel(seen.combinations)
    return nothing, estimator.conclude(seen.wheels, probability, knows_motion(seen.wheels))
