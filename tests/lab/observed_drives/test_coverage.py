"""Drives in closed loop whose observer has been too sure of itself; benchmarks/observer_coverage.py has all of them."""

from dataclasses import replace
from typing import Any

import pytest

from ohmward_lab.simulate import closed_loop
from ohmward_lab.simulate.closed_loop.run import score

CASES: dict[str, tuple[str, dict[str, Any]]] = {
    "passive wheels under a robot that accelerates": ("slip-steps", {}),
    "a corner in the ground's law": ("slip-steps", {"encoders": "driven"}),
    "currents that are mostly noise": ("robotino", {"current_noise_A": 0.1}),
    "stiffness learnt on ice, then a floor": ("example", {"encoders": "driven"}),
    "a stop on ice without passive wheels": ("onto-ice", {"encoders": "driven"}),
    "a drag that the model lacks": ("slip-case-2", {}),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_nine_of_ten_speeds_and_slips_are_in_their_band(case):
    name, sensors = CASES[case]
    scenario = closed_loop.find_scenario(name)
    found = score(closed_loop.run(replace(scenario, sensors=replace(scenario.sensors, **sensors))))
    assert found is not None
    assert found.speed_coverage_95 > 0.9
    assert found.coverage_95 > 0.9
