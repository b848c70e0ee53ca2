"""Inference against its rules."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ohmward_lab.traction.compared_slip_laws import GAIN_RULES, LAYER_RULES, FuzzySlidingMode, infer
from traction.control.examples import SLIDING, WHEEL, motion

ONES = ((1.0, 1.0, 1.0),) * 3


def test_at_the_centres_of_the_sets_the_rules_hold_exactly():
    for i, size in enumerate((0.0, 0.5, 1.0)):
        for j, rate in enumerate((-1.0, 0.0, 1.0)):
            assert infer(GAIN_RULES, size, rate) == GAIN_RULES[i][j]


@given(st.floats(0, 1), st.floats(-1, 1))
def test_in_between_it_stays_between_the_rules(size, rate):
    assert infer(ONES, size, rate) == pytest.approx(1.0)
    assert np.min(LAYER_RULES) - 1e-12 <= infer(LAYER_RULES, size, rate) <= np.max(LAYER_RULES) + 1e-12


def test_outside_the_layer_no_rule_has_a_gain_below_the_plain_law():
    assert min(GAIN_RULES[2]) >= 1.0


def test_rules_of_one_leave_the_plain_law():
    law = FuzzySlidingMode(SLIDING, ONES, ONES)
    m = motion(rim_m_s=1.3)
    assert law.torque_Nm(law.init(0.0), m, WHEEL) == pytest.approx(SLIDING.torque_Nm(SLIDING.init(0.0), m, WHEEL))


def test_the_rate_of_sigma_comes_through_its_lag():
    law, memory = FuzzySlidingMode(SLIDING), FuzzySlidingMode(SLIDING).init(0.0)
    for k in range(200):
        memory = law.remember(memory, motion(rim_m_s=1.0 + 0.001 * k), 0.0, 0.0)
    assert memory.rate_m_s2 == pytest.approx(0.88 * 1.0, rel=1e-6)
