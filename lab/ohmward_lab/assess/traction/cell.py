"""Figures of an observer under a condition, over many drives."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from ohmward.trace import Kernel
from ohmward.trace.lower import llvm_machine_code
from ohmward.trace.structure import pick_lanes, side_by_side
from ohmward.traction.score import DriveScore, DriveTruth, score_drive
from ohmward.traction.speed_observer.estimate import SlipEstimate, SlipSample
from ohmward_lab.assess.traction.conditions import DriveCondition
from ohmward_lab.assess.traction.drives import ROBOTS, Drives
from ohmward_lab.assess.traction.methods import SLIP_METHODS, SlipMethod
from ohmward_lab.assess.traction.sensors import measured


class SlipFigures(NamedTuple):
    """Figures of one observer of one robot under one condition."""

    robot: str
    condition: str
    method: str
    #: of the speed [m/s], over all drives; nan where it was no number once
    rmse: float
    largest: float
    #: share of the samples with the true speed, and slip speed of each driven wheel, in the 95 % band; nan without a
    #: band
    speed_covered: float
    slip_covered: float
    slip_rmse: float  #: of the slip ratio
    way: float  #: error of the distance driven, over it; the mean of the drives
    #: share of the samples with far more than the allowed slip, and with no more, that are told
    detected: float
    false_alarms: float
    operations: int  #: in a step
    ns: float  #: time of a sample, with many drives side by side; of this machine, and no part of the results' equality

    @property
    def subject(self) -> str:
        """The robot."""
        return self.robot

    @property
    def covered(self) -> float:
        """The lesser of the two."""
        return min(self.speed_covered, self.slip_covered)


def slip_cell(name: str, condition: DriveCondition, method: SlipMethod, runs: int, seed: int) -> SlipFigures:
    """Run the method along every drive of this condition."""
    samples, truth = measured(name, condition, runs, seed)
    kernel, observer = _compiled(name, condition.told, method.name)
    firsts = [SlipSample(0.0, *(values[0, ..., run] for values in samples[1:])) for run in range(runs)]
    states = side_by_side([observer.init(first) for first in firsts])
    began = time.perf_counter()
    _, found = kernel.scan_lanes(states, samples)
    ns = 1e9 * (time.perf_counter() - began) / truth.speed_m_s.size
    scores = [_score(name, pick_lanes(found, run), pick_lanes(truth, run)) for run in range(runs)]
    has_band = bool(np.isfinite(found.speed_std_m_s).any())
    ways = _way_errors(found.speed_m_s, truth.speed_m_s)
    return SlipFigures(
        name,
        condition.name,
        method.name,
        **figures(scores, has_band),
        way=ways,
        operations=len(kernel.program.nodes),
        ns=ns,
    )


@lru_cache(maxsize=2 * len(SLIP_METHODS))
def _compiled(name: str, ground: str, method: str) -> tuple[Kernel, Any]:
    """The step in machine code where it can be, since it serves many conditions; and the observer."""
    observer = next(m for m in SLIP_METHODS if m.name == method).make(ROBOTS[name], ground)
    robot = ROBOTS[name]
    example = SlipSample(0.0, np.zeros(len(robot.places)), np.zeros(robot.driven))
    lowering = "python" if llvm_machine_code.reason_for_none() else "machine"
    return Kernel(observer.step, observer.init(example), example, lowering=lowering), observer


def _score(name: str, found: SlipEstimate, truth: Drives) -> DriveScore:
    motion = DriveTruth(truth.speed_m_s, truth.yaw_rate_rad_s, truth.lateral_speed_m_s, truth.slip_ratio)
    return score_drive(ROBOTS[name], found, motion)


def _way_errors(speed_m_s: np.ndarray, true_m_s: np.ndarray) -> float:
    """Mean error of the distance, of speeds (T, B)."""
    driven = np.abs(true_m_s).sum(axis=0)
    return float(np.mean(np.abs(np.abs(speed_m_s).sum(axis=0) / driven - 1.0)))


def figures(scores: Sequence[DriveScore], has_band: bool) -> dict[str, float]:
    """The figures of all drives, which are equally long; has_band: the observer says how sure it is."""
    by_name = {name: np.array([getattr(score, name) for score in scores]) for name in DriveScore._fields}
    return {
        "rmse": _rms(by_name["speed_rmse_m_s"]),
        "largest": float(by_name["speed_max_error_m_s"].max()),
        "speed_covered": _mean(by_name["speed_coverage_95"]) if has_band else math.nan,
        "slip_covered": _mean(by_name["coverage_95"]) if has_band else math.nan,
        "slip_rmse": _rms(by_name["slip_rmse"]),
        "detected": _mean(by_name["detection_rate"]),
        "false_alarms": _mean(by_name["false_alarm_rate"]),
    }


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _mean(values: np.ndarray) -> float:
    """Mean of those that are numbers: a drive on which no wheel slips shows no detection."""
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else math.nan
