"""Operations of the compiled steps: what a step costs shows here, before a clock can tell.

A change that makes a step larger or smaller says so by changing its number.
"""

import pytest

from ohmward.battery.chemistries import generic_battery
from ohmward.battery.soc.registry import make_estimator
from ohmward.battery.soc.sample import SocSample
from ohmward.trace import trace
from ohmward.trace.elementary import F64, expand
from ohmward.trace.lower.packs import Packs

BATTERY = generic_battery("nmc", 2.0)

#: Operations of the program as it was traced, and those that machine code does one after the other: exp and log written
#: out, and what a bank's members do alike in one vector counted once.
OPERATIONS = {
    "textbook-ekf": (149, 241),
    "ekf": (1736, 2380),
    "gsf": (4575, 3055),
    "ukf": (5144, 8640),
}


@pytest.mark.parametrize(("name", "operations"), OPERATIONS.items())
def test_the_operations_of_a_step_are_these(name, operations):
    estimator = make_estimator(name, BATTERY)
    nothing = SocSample(0.0, 0.0, 0.0, 0.0)
    program = trace(estimator.step, estimator.init(nothing), nothing)
    order = Packs(expand(program, F64)).order
    assert order is not None
    assert (len(program.nodes), len(order)) == operations
