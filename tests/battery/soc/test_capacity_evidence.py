"""Evidence about the capacity that repeats itself counts once, against sums of information by hand."""

from dataclasses import replace

import numpy as np
import pytest

from battery.anchor_examples import day, label
from ohmward.battery.models.noise import PASS_SOC
from ohmward.battery.soc.capacity_evidence import CapacityEvidence, count_once
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.filters.belief import Belief

#: Index of the capacity in the belief of two states.
GAIN = 1
PRIOR = Belief(np.array([0.5, 1.0]), np.array([[0.01, 0.002], [0.002, 0.01]]))


def measured(belief, y, R=0.02):
    """The Kalman update by a measurement of the sum of both states."""
    H = np.array([1.0, 1.0])
    S = H @ belief.cov @ H + R
    K = belief.cov @ H / S
    return Belief(belief.mean + K * (y - H @ belief.mean), belief.cov - np.outer(K, K) * S)


def test_new_evidence_counts_in_full():
    full = measured(PRIOR, 1.6)
    after, evidence = count_once(CapacityEvidence(), PRIOR, full, GAIN)
    assert after.mean == pytest.approx(full.mean)
    assert after.cov == pytest.approx(full.cov)
    shown = 1.0 / full.cov[GAIN, GAIN] - 1.0 / PRIOR.cov[GAIN, GAIN]
    assert (evidence.recent, evidence.used) == pytest.approx((shown, shown))


def test_evidence_that_an_earlier_pass_has_shown_leaves_the_capacity_alone():
    full = measured(PRIOR, 1.6)
    after, evidence = count_once(CapacityEvidence(used=1e6), PRIOR, full, GAIN)
    assert after.mean == pytest.approx([full.mean[0], PRIOR.mean[GAIN]])
    assert after.cov[GAIN, GAIN] == pytest.approx(PRIOR.cov[GAIN, GAIN])
    assert after.cov[0] == pytest.approx(full.cov[0])
    assert evidence.used == 1e6


def test_a_part_that_is_new_is_the_update_with_a_smaller_gain():
    """The covariance is Joseph's for the gain that was used, so that it is exact."""
    full = measured(PRIOR, 1.6)
    shown = 1.0 / full.cov[GAIN, GAIN] - 1.0 / PRIOR.cov[GAIN, GAIN]
    after, evidence = count_once(CapacityEvidence(used=0.7 * shown), PRIOR, full, GAIN)
    assert 1.0 / after.cov[GAIN, GAIN] == pytest.approx(1.0 / PRIOR.cov[GAIN, GAIN] + 0.3 * shown)
    assert evidence.used == pytest.approx(shown)
    K = (after.mean - PRIOR.mean) / (1.6 - PRIOR.mean.sum())
    A = np.eye(2) - np.outer(K, [1.0, 1.0])
    assert after.cov == pytest.approx(A @ PRIOR.cov @ A.T + 0.02 * np.outer(K, K))


def test_passes_that_repeat_themselves_show_no_more_than_the_best_two_of_them():
    belief, evidence = PRIOR, CapacityEvidence()
    passes = []
    for _ in range(20):
        evidence = evidence.after_step(1.1 * PASS_SOC, 1.0, 1.0)
        belief, evidence = count_once(evidence, belief, measured(belief, 1.6), GAIN)
        belief = Belief(belief.mean, np.diag([0.01, belief.cov[GAIN, GAIN]]))  # the next pass starts anew
        belief.cov[0, 1] = belief.cov[1, 0] = 0.0
        passes.append(evidence.recent + evidence.before)
    assert 1.0 / belief.cov[GAIN, GAIN] == pytest.approx(1.0 / PRIOR.cov[GAIN, GAIN] + max(passes))


def test_a_pass_ends_where_its_charge_has_flowed():
    assert CapacityEvidence(3.0, 1.0, 3.0, 0.5).after_step(0.4, 1.0, 1.0) == (3.0, 1.0, 3.0, 0.9)
    assert CapacityEvidence(3.0, 1.0, 3.0, 0.9).after_step(0.4, 1.0, 1.0) == (0.0, 3.0, 3.0, 0.0)


def test_a_walk_of_the_capacity_makes_room_for_new_evidence():
    assert CapacityEvidence(used=8.0).after_step(0.0, 0.01, 0.04).used == 2.0


def days_apart(chemistry, count):
    """Equal days between 80 and 30 %, with a night of unknown current between them, and the last one alone."""
    log, _ = day(chemistry, 0.8, [(0.2, 0.0), (1.7, -0.3), (0.3, 0.0), (1.7, 0.3)])
    return [replace(log, time_s=log.time_s + 86400.0 * k) for k in range(count)]


@pytest.mark.parametrize("chemistry", ("lfp", "nca"))
def test_a_fortnight_of_equal_days_is_no_surer_of_the_capacity_than_four_of_them(chemistry):
    """Four of them move the charge of two passes; as independent ones, the other ten would halve the error."""
    estimator = SocEstimator(label(chemistry))
    stds = [estimator.run(log).soh_capacity_std[-1] for log in days_apart(chemistry, 14)]
    assert stds[-1] > 0.85 * stds[3]


def test_a_capacity_that_is_exact_stays_so():
    exact = Belief(np.array([0.5, 1.0]), np.diag([0.01, 0.0]))
    after, evidence = count_once(CapacityEvidence().after_step(0.1, 0.0, 0.0), exact, measured(exact, 1.6), GAIN)
    assert (after.mean[GAIN], after.cov[GAIN, GAIN], evidence.used) == (1.0, 0.0, 0.0)
