"""Coverage of the speed observer's own 95 % bands, in closed loop: every packaged scenario, and harder.

The harder ones have fewer sensors or noisier currents than the packaged ones. The observer drives the robot, so what it
is wrong about comes back to it. Means over the seeds; widths and errors beside the shares, because a band that is wide
enough covers everything.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from figure import Figure, at_least, at_most, rms
from ohmward_lab.simulate import closed_loop
from ohmward_lab.simulate.closed_loop import Scenario
from ohmward_lab.simulate.closed_loop.run import score

SEEDS = range(1, 4)
COVERED = 0.9


class Covered(NamedTuple):
    """Shares of the speeds and slips in their bands, RMSE and RMS standard deviation of the speed [m/s]."""

    speed: float
    slip: float
    rmse_m_s: float
    std_m_s: float


def rows() -> Iterator[Figure]:
    """Every figure of this page."""
    for name, scenario in {**packaged(), **harder()}.items():
        yield from figures(name, np.mean([covered(replace(scenario, seed=seed)) for seed in SEEDS], axis=0))


def packaged() -> dict[str, Scenario]:
    """The scenarios that come with the package."""
    return {name: closed_loop.find_scenario(name) for name in closed_loop.packaged()}


def harder() -> Mapping[str, Scenario]:
    """The same with sensors that show less."""
    found = packaged()
    return {
        "robotino, currents to 0.1 A": with_sensors(found["robotino"], current_noise_A=0.1),
        "example, driven encoders": with_sensors(found["example"], encoders="driven"),
        "onto-ice, driven encoders": with_sensors(found["onto-ice"], encoders="driven"),
        "slip-steps, driven encoders": with_sensors(found["slip-steps"], encoders="driven"),
        "slip-steps in MuJoCo": replace(found["slip-steps"], plant="mujoco"),
        "slip-steps in MuJoCo, driven encoders": with_sensors(
            replace(found["slip-steps"], plant="mujoco"), encoders="driven"
        ),
    }


def with_sensors(scenario: Scenario, **sensors: object) -> Scenario:
    """The scenario with other sensors."""
    return replace(scenario, sensors=replace(scenario.sensors, **sensors))


def covered(scenario: Scenario) -> Covered:
    """One drive."""
    run = closed_loop.run(scenario)
    found, std = score(run), run.rows.estimate.speed_std_m_s
    return Covered(found.speed_coverage_95, found.coverage_95, found.speed_rmse_m_s, rms(std))


def figures(name: str, mean: np.ndarray) -> Iterator[Figure]:
    """The rows of one scenario."""
    data, found = f"closed loop, {name}", Covered(*mean)
    method = "UKF of the scenario"
    yield at_least(data, method, "speed in its 95 % band", found.speed, COVERED, ".1%")
    yield at_least(data, method, "slip in its 95 % band", found.slip, COVERED, ".1%")
    yield at_most(data, method, "speed RMSE [mm/s]", 1e3 * found.rmse_m_s)
    yield at_most(data, method, "standard deviation of the speed, RMS [mm/s]", 1e3 * found.std_m_s)
