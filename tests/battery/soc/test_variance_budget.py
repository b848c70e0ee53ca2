"""The uncertainty budget against closed forms and against conditioning of the joint Gaussian."""

from itertools import permutations

import numpy as np
import pytest

from ohmward.battery.soc.causes import explained_variance, variance_budget


def joint(loadings, stds, rest_std):
    """Covariance of (y, x_1 ... x_n) for y = sum a_j x_j + rest with independent x_j."""
    a, variances = np.array(loadings), np.square(stds)
    cov = np.diag([a @ (variances * a) + rest_std**2, *variances])
    cov[0, 1:] = cov[1:, 0] = a * variances
    return cov


def random_cov(rng, n):
    A = rng.standard_normal((n, n))
    return A @ A.T


def test_independent_causes_have_the_variances_that_they_bring():
    cov = joint([2.0, -1.0, 0.5], [1.0, 3.0, 4.0], rest_std=0.7)
    budget = variance_budget(cov, 0, {"a": [1], "b": [2], "c": [3]})
    assert [part.variance for part in budget.parts.values()] == pytest.approx([4.0, 9.0, 4.0])
    assert [part.removable for part in budget.parts.values()] == pytest.approx([4.0, 9.0, 4.0])
    assert budget.rest == pytest.approx(0.49)


@pytest.mark.parametrize("seed", range(5))
def test_the_parts_are_shapley_values_and_add_up(seed):
    """By the definition: what each adds, averaged over all orders."""
    cov = random_cov(np.random.default_rng(seed), 6)
    causes = {"a": [1, 2], "b": [3], "c": [4], "d": [5]}
    budget = variance_budget(cov, 0, causes)
    assert sum(part.variance for part in budget.parts.values()) + budget.rest == pytest.approx(cov[0, 0])
    for name in causes:
        added = []
        for order in permutations(causes):
            before = [i for n in order[: order.index(name)] for i in causes[n]]
            with_it = explained_variance(cov, 0, before + causes[name])
            added.append(with_it - explained_variance(cov, 0, before))
        assert budget.parts[name].variance == pytest.approx(np.mean(added))


@pytest.mark.parametrize("seed", range(5))
def test_a_cause_that_becomes_known_takes_its_removable_variance_away(seed):
    """Conditioning the joint Gaussian by the information form, which shares no code with the budget."""
    cov = random_cov(np.random.default_rng(seed), 5)
    budget = variance_budget(cov, 0, {"a": [1, 2], "b": [3], "c": [4]})
    information = np.linalg.inv(cov)
    others = [0, 3, 4]
    without_a = np.linalg.inv(information[np.ix_(others, others)])
    assert cov[0, 0] - budget.parts["a"].removable == pytest.approx(without_a[0, 0])


def test_two_causes_that_are_the_same_share_their_part():
    cov = joint([1.0], [2.0], rest_std=1.0)
    cov = cov[np.ix_([0, 1, 1], [0, 1, 1])]
    budget = variance_budget(cov, 0, {"a": [1], "b": [2]})
    assert budget.parts["a"].variance == pytest.approx(2.0)
    assert budget.parts["b"].variance == pytest.approx(2.0)
    assert budget.parts["a"].removable == pytest.approx(4.0)
    assert budget.rest == pytest.approx(1.0)


def test_a_state_that_is_known_already_explains_nothing():
    cov = joint([1.0, 1.0], [2.0, 0.0], rest_std=0.0)
    budget = variance_budget(cov, 0, {"a": [1], "b": [2]})
    assert budget.parts["b"] == (0.0, 0.0)
    assert budget.parts["a"].variance == pytest.approx(4.0)
