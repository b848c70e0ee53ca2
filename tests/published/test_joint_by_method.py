"""Four filters of the joint model on the circuit itself, with noise of the voltage sensor."""

import math

import numpy as np
import pytest

from ohmward.battery.models import rc
from ohmward.battery.models.ocv import OcvCurve
from ohmward.battery.soc.sample import SocSample
from ohmward.errors import InputError
from ohmward.trace import Kernel
from ohmward_lab.published.joint_by_method import METHODS, JointByMethod
from ohmward_lab.published.rc_joint import Nominal, nominal_of

TRUE = rc.RcModel(3000.0, 300.0, 0.08, 0.08, 0.06, OcvCurve((11.5, 13.5)), 3300.0 * 2.0 / 3600.0)


def samples():
    rng = np.random.default_rng(2)
    current_A = np.repeat(rng.uniform(-4.0, 4.0, 200), 10)
    x, voltage_V = TRUE.at_rest(0.6), []
    for k, now_A in enumerate(current_A):
        if k:
            x = rc.next_state(x, 0.5 * (now_A + current_A[k - 1]), TRUE, 1.0)
        voltage_V.append(rc.voltage(x, now_A, TRUE)[0] + 0.001 * rng.standard_normal())
    n = current_A.size
    return SocSample(np.ones(n), current_A, np.array(voltage_V), np.full(n, math.nan))


@pytest.mark.parametrize("method", METHODS)
def test_every_method_finds_the_instant_resistance(method):
    nominal = nominal_of(TRUE)._replace(r_ohm=0.10, r_terminal_ohm=0.08)
    joint, column = JointByMethod(nominal, method), samples()
    first = SocSample(0.0, *(float(c[0]) for c in column[1:]))
    start = joint.init(first)
    found = Kernel(joint.step, start, first).scan(start, column)[1]
    instant = found.found.r_terminal_ohm[-1] + 0.5 * found.found.r_ohm[-1]
    assert instant == pytest.approx(rc.instant_resistance(TRUE), rel=0.05)
    assert np.abs(found.found.innovation_V[-500:]).mean() < 0.003
    assert (found.voltage_variance_V2 > 0).all()


def test_a_missing_voltage_is_predicted_over():
    joint = JointByMethod(nominal_of(TRUE))
    start = joint.init(SocSample(0.0, 0.0, 12.5, math.nan))
    after, found = joint.step(start, SocSample(1.0, -1.0, math.nan, math.nan))
    assert np.isfinite(after.adaptive.mean).all() and math.isnan(float(found.residual_V))
    assert float(joint.step(after, SocSample(1.0, -1.0, 12.4, math.nan))[1].found.innovation_V) == pytest.approx(
        0, abs=0.1
    )


def test_only_the_adaptive_ones_match_their_noise():
    assert [JointByMethod(nominal_of(TRUE), m).adapts for m in METHODS] == [False, True, False, True]


def test_mistakes_are_refused():
    with pytest.raises(InputError, match="method must be one of"):
        JointByMethod(Nominal(1.0, 1.0, 1.0, 1.0), "kf")
    with pytest.raises(InputError, match="window"):
        JointByMethod(Nominal(1.0, 1.0, 1.0, 1.0), window=0.5)
