import numpy as np
import pytest

from filters.examples import PENDULUM, largest_difference, random_linear, two_outputs
from ohmward.errors import InputError
from ohmward.filters import extended, kalman, nis, unscented, update_sequentially


@pytest.mark.parametrize("update", [extended.update, unscented.update])
def test_on_a_linear_model_one_by_one_is_all_at_once(update):
    rng = np.random.default_rng(1)
    *_, H, _, belief = random_linear(rng, 4, 3)
    y, variances = rng.normal(size=3), np.array([0.1, 0.5, 2.0])
    joint, joint_innovation = kalman.update(belief, y, H, np.diag(variances))
    one_by_one, innovations = update_sequentially(belief, y, lambda x: H @ x, variances, update)
    assert largest_difference(one_by_one, joint) < 1e-12
    assert sum(map(nis, innovations)) == pytest.approx(nis(joint_innovation), rel=1e-11)


def test_on_a_nonlinear_model_the_second_output_is_linearised_where_the_first_ended():
    y, variances = np.array([0.3, 0.9]), np.array([0.01, 0.02])
    first, _ = extended.update(PENDULUM, y[:1], lambda x: two_outputs(x)[:1], np.array([[0.01]]))
    second, _ = extended.update(first, y[1:], lambda x: two_outputs(x)[1:], np.array([[0.02]]))
    both, innovations = update_sequentially(PENDULUM, y, two_outputs, variances, extended.update)
    assert largest_difference(both, second) == 0
    assert len(innovations) == 2


def test_wrong_shapes_are_refused():
    with pytest.raises(InputError, match=r"variances must have shape \(2,\) but has \(2, 2\)"):
        update_sequentially(PENDULUM, np.zeros(2), two_outputs, np.eye(2), extended.update)
