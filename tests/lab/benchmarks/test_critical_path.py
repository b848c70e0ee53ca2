"""The latency bound of a log, against programs small enough to see it."""

from itertools import permutations

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.trace import floor, sqrt, trace, where
from ohmward.trace.expression import apply
from scripts import script

critical_path = script("critical_path")
least_step_s = critical_path.least_step_s
maximum_cycle_mean = critical_path.maximum_cycle_mean
state_paths = critical_path.state_paths

LATENCIES = {"add": 2.0, "subtract": 2.0, "multiply": 3.0, "divide": 13.0, "sqrt": 20.0}
NONE = -np.inf


def least(step, state, latencies=LATENCIES):
    return least_step_s(trace(lambda s, u: (step(s, u), 0.0), state, 0.0), len(np.ravel(state)), latencies)


def test_a_sum_waits_for_one_addition():
    assert least(lambda x, u: x + u, 0.0) == 2.0


def test_what_needs_no_state_counts_nothing():
    assert least(lambda x, u: x + sqrt(sqrt(u)), 0.0) == 2.0


def test_of_two_ways_the_longer_counts():
    assert least(lambda x, u: sqrt(x) + x * u, 0.0) == 22.0


def test_a_state_that_forgets_or_stays_waits_for_nothing():
    assert least(lambda x, u: sqrt(u), 0.0) == 0.0
    assert least(lambda x, u: x, 0.0) == 0.0


def test_a_circle_of_two_states_takes_two_steps():
    assert least(lambda x, u: (x[1] + u, sqrt(x[0])), (0.0, 0.0)) == 11.0


def test_a_state_that_only_listens_counts_nothing():
    assert least(lambda x, u: (x[0] + u, sqrt(x[0])), (0.0, 0.0)) == 2.0


@pytest.mark.parametrize(
    "step, plain, fused",
    [
        (lambda x, u: x * u + 1.0, 5.0, 4.0),  # through the product
        (lambda x, u: u * u + x, 2.0, 2.0),  # through the sum: not fused, it waits for less
        (lambda x, u: 1.0 - x * u, 5.0, 4.0),
        (lambda x, u: x * u + sqrt(x), 22.0, 22.0),
        (lambda x, u: x * u + x * 2.0, 5.0, 5.0),  # only one of two products can be fused
    ],
)
def test_products_and_sums_may_be_fused(step, plain, fused):
    assert least(step, 0.0) == plain
    assert least(step, 0.0, LATENCIES | {"fma": 4.0}) == fused


@pytest.mark.parametrize(
    "step, expected",
    [
        (lambda x, u: where(x < u, x, u), 2.0),
        (lambda x, u: where(x < u, u, x), 2.0),
        (lambda x, u: where(x > 0.5, x, 0.25 + 0.25), 2.0),
        (lambda x, u: where(x < u, x, 1.0), 4.0),  # a comparison with one, a choice of another
        (lambda x, u: apply("gather", floor(x), (1.0, 0.0)), 10.0),
        (lambda x, u: 2.0 * x, 2.0),
        (lambda x, u: x * -2.0, 2.0),
        (lambda x, u: 3.0 * x, 3.0),
        (lambda x, u: x / 8.0, 3.0),
        (lambda x, u: x / 9.0, 13.0),
        (lambda x, u: 8.0 / x, 13.0),
    ],
)
def test_what_one_instruction_does_counts_as_one(step, expected):
    assert (
        least(step, 0.0, LATENCIES | {"less": 3.0, "where": 1.0, "minimum": 2.0, "floor": 4.0, "gather": 10.0})
        == expected
    )


def test_paths_are_those_from_state_to_state():
    program = trace(lambda x, u: ((x[0] + u, sqrt(x[0]) * x[1], u), 0.0), (0.0, 0.0, 0.0), 0.0)
    expected = [[2.0, 23.0, NONE], [NONE, 3.0, NONE], [NONE, NONE, NONE]]
    np.testing.assert_array_equal(state_paths(program, 3, LATENCIES), expected)


def heaviest_cycle(weights):
    """By trying every one."""
    n = len(weights)
    cycles = (c for length in range(1, n + 1) for c in permutations(range(n), length))
    return max(float(np.mean([weights[a, b] for a, b in zip(c, c[1:] + c[:1], strict=True)])) for c in cycles)


@pytest.mark.parametrize("seed", range(20))
def test_the_largest_mean_is_that_of_the_heaviest_cycle(seed):
    rng = np.random.default_rng(seed)
    weights = np.where(rng.random((5, 5)) < 0.5, rng.integers(0, 9, (5, 5)), NONE)
    expected = heaviest_cycle(weights)
    assert maximum_cycle_mean(weights) == pytest.approx(expected if np.isfinite(expected) else 0.0)


def test_an_operation_without_latency_is_named():
    with pytest.raises(InputError, match="none of exp"):
        least(lambda x, u: np.exp(x), 0.0)
