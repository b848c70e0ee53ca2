import numpy as np
import pytest
from scipy.stats import multivariate_normal

from filters.examples import PENDULUM, random_covariance
from ohmward.errors import InputError
from ohmward.filters import Belief, Innovation, PackedBelief, is_healthy, log_likelihood, nis, pack, unpack


@pytest.mark.parametrize("n", [1, 2, 7])
def test_unpack_undoes_pack(n):
    rng = np.random.default_rng(n)
    belief = Belief(rng.normal(size=n), random_covariance(rng, n))
    packed = pack(belief)
    assert packed.lower.shape == (n * (n + 1) // 2,)
    np.testing.assert_array_equal(unpack(packed).cov, belief.cov)
    np.testing.assert_array_equal(unpack(packed).mean, belief.mean)


def test_unpacked_halves_are_the_very_same_elements():
    lower = np.array([object() for _ in range(10)])
    cov = unpack(PackedBelief(np.zeros(4), lower)).cov
    assert all(cov[i, j] is cov[j, i] for i in range(4) for j in range(4))
    assert len({id(element) for element in cov.ravel()}) == 10


@pytest.mark.parametrize("m", [1, 3])
def test_log_likelihood_and_nis_are_those_of_the_normal_density(m):
    rng = np.random.default_rng(m)
    innovation = Innovation(rng.normal(size=m), random_covariance(rng, m))
    density = multivariate_normal(np.zeros(m), innovation.cov)
    assert log_likelihood(innovation) == pytest.approx(density.logpdf(innovation.value), rel=1e-12)
    expected = innovation.value @ np.linalg.inv(innovation.cov) @ innovation.value
    assert nis(innovation) == pytest.approx(expected, rel=1e-12)


def test_health():
    assert is_healthy(PENDULUM) == 1
    assert is_healthy(PENDULUM._replace(mean=np.array([0.0, np.nan, 0.0]))) == 0
    assert is_healthy(PENDULUM._replace(cov=-PENDULUM.cov)) == 0


def test_wrong_shapes_are_refused():
    with pytest.raises(InputError, match=r"packed.lower must have shape \(3,\) but has \(4,\)"):
        unpack(PackedBelief(np.zeros(2), np.zeros(4)))
    with pytest.raises(
        InputError, match=r"belief.cov must have shape \(2, 2\) but has \(2,\); a covariance is a matrix"
    ):
        pack(Belief(np.zeros(2), np.ones(2)))
