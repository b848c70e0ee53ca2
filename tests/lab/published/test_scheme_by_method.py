"""The scheme of [T] by four filters on the circuit itself, with noise of the voltage sensor."""

import math

import numpy as np
import pytest

from ohmward.battery.models.ocv import OcvCurve
from ohmward.battery.soc.sample import SocSample
from ohmward.errors import InputError
from ohmward.trace import Kernel
from ohmward_lab.published import rc, rc_circuit
from ohmward_lab.published.scheme_by_method import METHODS, SchemeByMethod, SchemeSoc, unpack

TRUE = rc.RcModel(3000.0, 300.0, 0.08, 0.08, 0.06, OcvCurve((11.5, 13.5)), 3300.0 * 2.0 / 3600.0)


def samples():
    rng = np.random.default_rng(2)
    current_A = np.repeat(rng.uniform(-4.0, 4.0, 200), 10)
    x, voltage_V = rc_circuit.at_rest(TRUE, 0.6), []
    for k, now_A in enumerate(current_A):
        if k:
            x = rc_circuit.next_state(x, 0.5 * (now_A + current_A[k - 1]), TRUE, 1.0)
        voltage_V.append(rc_circuit.voltage(x, now_A, TRUE)[0] + 0.001 * rng.standard_normal())
    n = current_A.size
    return SocSample(np.ones(n), current_A, np.array(voltage_V), np.full(n, math.nan))


def along(method, column=None, corrected=True):
    column = samples() if column is None else column
    scheme = SchemeByMethod(TRUE, method, corrected)
    first = SocSample(0.0, *(float(c[0]) for c in column[1:]))
    start = scheme.init(first, 0.6, 0.005)
    return Kernel(scheme.step, start, first).scan(start, column)[1]


@pytest.mark.parametrize("method", METHODS)
def test_every_method_follows_the_voltage_and_keeps_the_parameters_within_a_decade(method):
    found = along(method)
    assert np.abs(found.residual_V).mean() < 0.01
    assert (found.voltage_variance_V2 > 0).all()
    for name, value in found.circuit._asdict().items():
        ratio = value / getattr(TRUE, name)
        assert ratio.min() > 0.099 and ratio.max() < 10.01


@pytest.mark.parametrize("corrected", [True, False])
def test_a_missing_voltage_is_predicted_over(corrected):
    column = samples()
    column.voltage_V[1000] = np.nan
    found = along("ekf", column, corrected)
    there = np.delete(found.innovation_V, 1000)
    assert math.isnan(found.innovation_V[1000]) and np.isfinite(there).all()
    assert np.isfinite(found.soc).all() or not corrected


def test_mistakes_are_refused():
    with pytest.raises(InputError, match="method must be one of"):
        SchemeByMethod(TRUE, "kf")
    with pytest.raises(InputError, match="window"):
        SchemeByMethod(TRUE, window=0.5)


def test_as_an_estimator_of_charge_the_scheme_is_the_same_and_finds_its_start_by_the_first_voltage():
    column, scheme = samples(), SchemeByMethod(TRUE, "ekf")
    estimator = SchemeSoc(scheme)
    first = SocSample(0.0, *(float(c[0]) for c in column[1:]))
    start = estimator.init(first, 0.6, 0.005)
    found = Kernel(estimator.step, start, first).scan(start, column)[1]
    np.testing.assert_array_equal(found.soc, along("ekf", column).soc)
    np.testing.assert_allclose(found.soc_std**2, along("ekf", column).soc_variance)
    rest = SocSample(0.0, 0.0, float(rc_circuit.at_rest(TRUE, 0.6)[0]), math.nan)
    assert unpack(estimator.init(rest).soc).belief.mean[2] == pytest.approx(0.6, abs=1e-3)
    silent = rest._replace(voltage_V=math.nan)
    assert unpack(estimator.init(silent, 0.6).joint).belief.mean[2] == pytest.approx(rest.voltage_V)
    with pytest.raises(InputError, match="first sample has no voltage: give soc"):
        estimator.init(silent)
