"""State of charge told from outside: exact updates, once, live and in logs, through snapshots."""

import json
from dataclasses import replace

import numpy as np
import pytest

from battery.anchor_examples import HOUR, day, label
from ohmward.battery.soc.anchor_rule import SocNormal
from ohmward.battery.soc.augmented_thevenin import SOC
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.battery.soc.given_soc import with_given_soc
from ohmward.battery.soc.sample import SocFlag
from ohmward.errors import InputError
from ohmward.filters.belief import Belief, unpack

FILTERS = pytest.mark.parametrize("name", ("gsf", "ekf", "ukf"))
GATE = 25.0


def belief(soc=0.9, std=0.05):
    """SoC and a state that goes with it."""
    return Belief(np.array([soc, 2.0]), np.array([[std**2, 0.5 * std], [0.5 * std, 1.0]]))


def a_charge():
    """Log and truth of a flat cell that is charged for an hour and then driven."""
    return day("lfp", 0.4, [(0.2, 0.0), (1.2, 0.49), (0.3, -0.2)])


def test_the_soc_is_as_told_and_all_else_follows_its_covariance():
    before = belief()
    after = with_given_soc(before, SocNormal(1.0, 0.01), GATE)
    assert after.mean[SOC] == pytest.approx(0.9 + (1 - 0.01**2 / 0.05**2) * 0.1)
    assert after.cov[SOC, SOC] == pytest.approx(0.01**2)
    slope = before.cov[1, SOC] / before.cov[SOC, SOC]
    assert after.mean[1] - before.mean[1] == pytest.approx(slope * (after.mean[SOC] - before.mean[SOC]))
    assert np.linalg.eigvalsh(after.cov).min() > 0.0


def test_an_unknown_soc_takes_the_kalman_update():
    after = with_given_soc(belief(0.5, 0.3), SocNormal(1.0, 0.01), GATE)
    assert after.mean[SOC] == pytest.approx(1.0, abs=1e-3)


def test_what_is_known_better_stays():
    sure = belief(0.99, 0.005)
    assert with_given_soc(sure, SocNormal(1.0, 0.01), GATE) is sure


def test_a_contradicted_belief_forgets():
    after = with_given_soc(belief(0.5, 0.005), SocNormal(1.0, 0.01), GATE)
    assert after.mean[SOC] == pytest.approx(1.0, abs=2e-3)
    assert after.cov[SOC, SOC] == pytest.approx(0.01**2)


@FILTERS
def test_to_tell_it_again_changes_nothing(name):
    log, _ = a_charge()
    estimator = SocEstimator(label("lfp"), filter=name)
    estimator.run(log.select(slice(0, 480)))
    once = estimator.correct_soc()
    assert once.soc == pytest.approx(1.0, abs=0.01) and once.soc_std <= 0.0101
    assert once.flags & SocFlag.ANCHORED
    for _ in range(20):
        again = estimator.correct_soc()
    assert again.soc == pytest.approx(once.soc, abs=1e-3) and again.soc_std == pytest.approx(once.soc_std, rel=0.05)


@FILTERS
def test_a_column_of_a_log_is_the_live_call(name):
    log, truth = a_charge()
    k = int(np.argmax(truth))
    says = replace(log, extra={"charger_full": (np.arange(len(log)) >= k).astype(float)})
    run = SocEstimator(label("lfp"), filter=name).run(says)
    assert np.flatnonzero(run.flags & SocFlag.ANCHORED).tolist() == [k]
    estimator = SocEstimator(label("lfp"), filter=name)
    estimator.run(log.select(slice(0, k + 1)))
    told = estimator.correct_soc()
    assert (run.soc[k], run.soc_std[k]) == (told.soc, told.soc_std)
    rest = estimator.run(log.select(slice(k + 1, len(log))))
    np.testing.assert_array_equal(run.soc[k + 1 :], rest.soc)
    unflagged = SocEstimator(label("lfp"), filter=name).run(log)
    np.testing.assert_array_equal(run.soc[:k], unflagged.soc[:k])
    assert abs(run.soc[-1] - truth[-1]) < 2.5 * run.soc_std[-1] < abs(2.5 * unflagged.soc_std[-1])


@FILTERS
def test_a_snapshot_keeps_what_was_told(name):
    log, truth = a_charge()
    k = int(np.argmax(truth))
    estimator = SocEstimator(label("lfp"), filter=name)
    estimator.run(log.select(slice(0, k + 1)))
    estimator.correct_soc(1.0, 0.005)
    other = SocEstimator.restore(label("lfp"), json.loads(json.dumps(estimator.snapshot())), filter=name)
    rest = log.select(slice(k + 1, len(log)))
    np.testing.assert_array_equal(other.run(rest).soc, estimator.run(rest).soc)


def test_the_battery_has_been_full_since_it_was_told():
    log, _ = a_charge()
    estimator = SocEstimator(label("lfp"))
    estimator.run(log.select(slice(0, 400)))
    estimator.correct_soc()
    later_s = estimator.time_s + HOUR
    estimator.update(later_s, 0.0, 13.3, 25.0)
    assert estimator.memory.history(later_s).since_full_s == pytest.approx(HOUR)


def test_the_state_stays_positive_definite():
    log, _ = a_charge()
    estimator = SocEstimator(label("lfp"), filter="ekf")
    estimator.run(log)
    estimator.correct_soc(0.2, 1e-4)
    assert np.linalg.eigvalsh(unpack(estimator.state.belief).cov).min() > -1e-12


def test_what_cannot_be_told_is_refused():
    log, _ = a_charge()
    with pytest.raises(InputError, match="give update"):
        SocEstimator(label("lfp")).correct_soc()
    counting = SocEstimator(label("lfp"), filter="coulomb")
    counting.run(log)
    with pytest.raises(InputError, match="choose the filter gsf"):
        counting.correct_soc()
    estimator = SocEstimator(label("lfp"))
    estimator.run(log)
    with pytest.raises(InputError, match="soc must be between 0 and 1"):
        estimator.correct_soc(80.0)
    with pytest.raises(InputError, match="soc_std must be > 0"):
        estimator.correct_soc(0.8, 0.0)


@pytest.mark.parametrize("column", ["full", "power_supply_status"])
def test_estimators_without_it_run_over_such_a_column(column):
    log, _ = a_charge()
    says = replace(log, extra={column: np.where(np.arange(len(log)) > 400, 4.0, 0.0)})
    run = SocEstimator(label("lfp"), filter="coulomb").run(says)
    assert not np.any(run.flags & SocFlag.ANCHORED)
