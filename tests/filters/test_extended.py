import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter
from scipy.optimize import minimize

from filters.examples import DT_S, PENDULUM, PENDULUM_Q, PENDULUM_R, height, largest_difference, pendulum
from ohmward.errors import InputError
from ohmward.filters import extended


def pendulum_jacobian(x):
    return np.array([[1, DT_S, 0], [-DT_S * x[2] * np.cos(x[0]), 1, -DT_S * np.sin(x[0])], [0, 0, 1]])


def height_jacobian(x):
    return np.array([[np.sin(x[0]), 0.2, 0.0]])


def test_equals_filterpy_with_jacobians_by_hand():
    rng = np.random.default_rng(1)
    belief = PENDULUM
    peer = ExtendedKalmanFilter(dim_x=3, dim_z=1)
    peer.x, peer.P, peer.Q, peer.R = belief.mean, belief.cov, PENDULUM_Q, PENDULUM_R
    for y in 0.2 + 0.1 * rng.normal(size=(100, 1)):
        belief, _ = extended.update(extended.predict(belief, pendulum, PENDULUM_Q), y, height, PENDULUM_R)
        peer.F = pendulum_jacobian(peer.x)
        peer.x, peer.P = pendulum(peer.x), peer.F @ peer.P @ peer.F.T + peer.Q
        peer.update(y, height_jacobian, height)
    assert largest_difference(belief, (peer.x, peer.P)) < 1e-10


def test_iterations_end_at_the_most_probable_state():
    y = np.array([0.9])

    def cost(x):
        e, nu = x - PENDULUM.mean, y - height(x)
        return e @ np.linalg.solve(PENDULUM.cov, e) + nu @ nu / PENDULUM_R[0, 0]

    found = minimize(cost, PENDULUM.mean, method="BFGS", options={"gtol": 1e-10}).x
    once, innovation = extended.update(PENDULUM, y, height, PENDULUM_R)
    often, same_innovation = extended.update(PENDULUM, y, height, PENDULUM_R, iterations=30)
    np.testing.assert_allclose(often.mean, found, atol=1e-6)
    assert cost(often.mean) < cost(once.mean) - 0.1
    assert largest_difference(innovation, same_innovation) == 0


def test_wrong_shapes_are_refused():
    with pytest.raises(InputError, match=r"f\(x\) must have shape \(3,\) but has \(1,\)"):
        extended.predict(PENDULUM, height, PENDULUM_Q)
    with pytest.raises(InputError, match=r"h\(x\) must have shape \(2,\) but has \(1,\)"):
        extended.update(PENDULUM, np.zeros(2), height, PENDULUM_R)
    with pytest.raises(InputError, match="iterations must be at least 1 but is 0"):
        extended.update(PENDULUM, np.zeros(1), height, PENDULUM_R, iterations=0)
