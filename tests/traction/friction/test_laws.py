"""What every law of traction has to be: odd, passive, continuous, differentiable, limited; in and out of a trace."""

import casadi
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ohmward.trace import Kernel, linearize
from ohmward.traction.friction.law import contact
from traction.examples import LAWS, LOAD_N

every_law = pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
SPEEDS = np.linspace(-2.0, 2.0, 401)


def force(law, rim, travel, load=LOAD_N):
    return law.force_N(contact(rim, travel, load))


@every_law
def test_no_slip_no_force(law):
    np.testing.assert_array_equal(force(law, SPEEDS, SPEEDS), 0.0)


@every_law
@given(rim=st.floats(-5, 5), travel=st.floats(-5, 5), load=st.floats(0, 1e3))
def test_the_ground_never_gives_energy(law, rim, travel, load):
    assert force(law, rim, travel, load) * (rim - travel) >= 0.0


@every_law
@given(rim=st.floats(-5, 5), travel=st.floats(-5, 5))
def test_reverse_is_the_mirror_image(law, rim, travel):
    assert force(law, -rim, -travel) == pytest.approx(-force(law, rim, travel), rel=1e-12, abs=1e-12)


@every_law
@pytest.mark.parametrize("travel", [0.0, 0.03, 0.5, -0.5])
def test_continuous_everywhere(law, travel):
    rim = np.linspace(-2.0, 2.0, 400_001)
    steepest = LOAD_N * 600  # [N s/m] the steepest law at the speed floor
    assert abs(np.diff(force(law, rim, travel))).max() <= steepest * (rim[1] - rim[0])


@every_law
def test_a_lifted_wheel_has_no_grip(law):
    assert abs(force(law, 1.0, 0.2, 0.0)) < 1e-4


@every_law
@pytest.mark.parametrize("rim, travel", [(0.5, 0.5), (0.0, 0.0), (-0.3, -0.3)])
def test_the_slope_at_no_slip_is_that_of_both_sides(law, rim, travel):
    step = 1e-7
    _, J = linearize(lambda x: np.array([force(law, x[0], travel)]), np.array([rim]))
    both = (force(law, rim + step, travel) - force(law, rim - step, travel)) / (2 * step)
    assert J[0, 0] == pytest.approx(both, rel=1e-4)
    assert J[0, 0] > 1.0


@every_law
@pytest.mark.parametrize("rim, travel", [(0.51, 0.5), (0.7, 0.5), (0.3, 0.5), (3.0, 0.2), (-0.4, -0.5), (0.06, 0.03)])
def test_derivatives_are_those_of_finite_differences(law, rim, travel):
    def f(x):
        return np.array([force(law, x[0], x[1], x[2])])

    at = np.array([rim, travel, LOAD_N])
    _, J = linearize(f, at)
    steps = np.diag([1e-6, 1e-6, 1e-3])
    central = [(f(at + h)[0] - f(at - h)[0]) / (2 * h.sum()) for h in steps]
    np.testing.assert_allclose(J[0], central, rtol=2e-5, atol=1e-5)


def casadi_ward_iagnemma(x):
    s = x[0] - x[1]
    return x[2] * casadi.sign(s) * 0.7 * (1 - casadi.exp(-20.0 * casadi.fabs(s)))


def casadi_burckhardt(x):
    law = LAWS["burckhardt"]
    slip = (x[0] - x[1]) / casadi.fmax(casadi.fmax(casadi.fabs(x[0]), casadi.fabs(x[1])), 0.05)
    size = casadi.fabs(slip)
    return x[2] * casadi.sign(slip) * (law.c1 * (1 - casadi.exp(-law.c2 * size)) - law.c3 * size)


@pytest.mark.parametrize("name, oracle", [("ward-iagnemma", casadi_ward_iagnemma), ("burckhardt", casadi_burckhardt)])
@given(rim=st.floats(0.1, 3), share=st.floats(0.1, 3).filter(lambda x: abs(x - 1) > 1e-3))
def test_value_and_derivatives_are_those_of_casadi(name, oracle, rim, share):
    at = np.array([rim, share * rim, LOAD_N])
    x = casadi.SX.sym("x", 3)
    f = casadi.Function("f", [x], [oracle(x), casadi.jacobian(oracle(x), x)])
    value, J = linearize(lambda x: np.array([force(LAWS[name], x[0], x[1], x[2])]), at)
    expected_value, expected_J = f(at)
    np.testing.assert_allclose(value, np.array(expected_value).ravel(), rtol=1e-12)
    np.testing.assert_allclose(J, np.array(expected_J), rtol=1e-9, atol=1e-9)


@every_law
def test_traced_it_is_the_same(law):
    kernel = Kernel(lambda rim, travel, load: force(law, rim, travel, load), 0.0, 0.0, 0.0)
    for rim, travel, load in [(0.5, 0.4, 80.0), (0.4, 0.5, 80.0), (0.0, 0.0, 80.0), (-2.0, 1.0, 10.0), (1.0, 0.1, 0.0)]:
        assert kernel(rim, travel, load) == pytest.approx(force(law, rim, travel, load), rel=1e-12, abs=1e-15)


@every_law
def test_nan_stays_nan(law):
    assert np.isnan(force(law, np.nan, 0.5))
    assert np.isnan(force(law, 0.5, np.nan))
