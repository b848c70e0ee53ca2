"""A gap in which nothing is known of the current is a new start: the charge of before, or any other."""

from dataclasses import replace

import numpy as np
import pytest

from battery.anchor_examples import HOUR, day, label
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.battery.soc.given_soc import NOTHING_KNOWN_AFTER_S
from ohmward.battery.soc.sample import SocFlag
from ohmward.battery.soc.score import score
from ohmward.fleet.lanes import estimate_logs

FILTERS = pytest.mark.parametrize("name", ("gsf", "ekf", "ukf"))
#: Hours and multiples of the capacity: a drive, a charge that nobody records, a drive.
PHASES = [(0.2, 0.0), (1.0, -0.3), (0.5, 0.0), (4.0, 0.08), (0.2, 0.0), (1.5, -0.2)]
GONE_HOURS = (1.6, 5.8)


def with_gap(log, truth, gone=GONE_HOURS):
    """The log without these hours, and the row that follows them."""
    kept = (log.time_s < gone[0] * HOUR) | (log.time_s >= gone[1] * HOUR)
    return log.select(np.flatnonzero(kept)), truth[kept], int(np.count_nonzero(log.time_s < gone[0] * HOUR))


def charged_unseen(chemistry):
    return with_gap(*day(chemistry, 0.8, PHASES))


@pytest.mark.parametrize("chemistry", ("lfp", "nca"))
def test_a_charge_that_nobody_saw_is_covered(chemistry):
    log, truth, after = charged_unseen(chemistry)
    assert truth[after] - truth[after - 1] > 0.3
    run = SocEstimator(label(chemistry), initial_soc=0.8).run(log)
    assert run.flags[after] == SocFlag.GAP
    band = score(run.soc[after:], truth[after:], run.soc_std[after:])
    assert band is not None and band.coverage_95 > 0.95 and band.rmse < 0.2


@pytest.mark.parametrize("chemistry", ("lfp", "nca"))
def test_a_robot_that_was_off_goes_on_where_it_was(chemistry):
    log, truth = day(chemistry, 0.8, [(0.2, 0.0), (1.0, -0.3), (0.5, 0.0), (1.0, -0.2)])
    after = int(np.searchsorted(log.time_s, 1.7 * HOUR))
    off = replace(log, time_s=log.time_s + np.where(np.arange(len(log)) >= after, 10 * HOUR, 0.0))
    run = SocEstimator(label(chemistry), initial_soc=0.8).run(off)
    assert abs(run.soc[after] - truth[after]) < 0.05
    assert np.all(np.abs(run.soc[after:] - truth[after:]) < 2.0 * run.soc_std[after:])


@FILTERS
def test_live_and_along_a_log_it_is_the_same_start(name):
    log, _, after = charged_unseen("lfp")
    log = log.select(slice(0, after + 30))
    run = SocEstimator(label("lfp"), filter=name).run(log)
    live = SocEstimator(label("lfp"), filter=name)
    found = [
        live.update(*row) for row in zip(log.time_s, log.current_A, log.voltage_V, log.temperature_degC, strict=True)
    ]
    np.testing.assert_allclose([e.soc for e in found], run.soc, atol=1e-9)
    np.testing.assert_allclose([e.soc_std for e in found], run.soc_std, atol=1e-9)
    assert [int(e.flags) for e in found] == run.flags.tolist()
    assert live.memory.history(live.time_s).since_start_s == run.history.since_start_s == 290.0


def test_a_second_log_hours_later_begins_likewise():
    log, _, after = charged_unseen("lfp")
    one, two = log.select(slice(0, after)), log.select(slice(after, len(log)))
    estimator = SocEstimator(label("lfp"))
    pieces = [estimator.run(one).soc, estimator.run(two).soc]
    np.testing.assert_array_equal(np.concatenate(pieces), SocEstimator(label("lfp")).run(log).soc)


def test_side_by_side_it_is_the_log_alone():
    log, _, _ = charged_unseen("lfp")
    settings = SocEstimator(label("lfp")).settings
    short = log.select(slice(0, 50))
    alone = SocEstimator(settings).run(log)
    _, found = estimate_logs(settings, [short, log])
    np.testing.assert_allclose(found.soc, alone.soc, atol=1e-7)


def test_what_was_learnt_of_the_battery_goes_on_and_the_charge_does_not():
    log, _, after = charged_unseen("nca")
    estimator = SocEstimator(label("nca"), initial_soc=0.8, initial_soc_std=0.01)
    estimator.run(log.select(slice(0, after)))
    before = estimator.last
    assert before is not None
    row = log.select(slice(after, after + 1))
    now = estimator.update(row.time_s[0], row.current_A[0], row.voltage_V[0], row.temperature_degC[0])
    assert now.soh_capacity == pytest.approx(before.soh_capacity, abs=0.01)
    assert now.resistance_ratio_std == pytest.approx(before.resistance_ratio_std, rel=0.1)
    assert now.current_offset_std_A > before.current_offset_std_A
    assert now.soc - before.soc > 2.0 * before.soc_std
    assert estimator.memory.history(estimator.time_s).since_start_s == 0.0


def test_without_a_voltage_after_it_both_remain():
    log, _, after = charged_unseen("lfp")
    estimator = SocEstimator(label("lfp"))
    before = estimator.run(log.select(slice(0, after)))
    now = estimator.update(estimator.time_s + 8 * HOUR, 0.0, None, 25.0)
    assert 0.5 * (before.soc[-1] + 0.5) == pytest.approx(now.soc, abs=0.02)
    assert now.soc_std > 0.2
    assert now.flags == SocFlag.GAP | SocFlag.NO_VOLTAGE


@FILTERS
def test_a_shorter_gap_is_a_step(name):
    log, _, after = charged_unseen("lfp")
    estimator = SocEstimator(label("lfp"), filter=name)
    run = estimator.run(log.select(slice(0, after)))
    now = estimator.update(estimator.time_s + 0.9 * NOTHING_KNOWN_AFTER_S, 0.0, None, 25.0)
    assert now.soc == pytest.approx(run.soc[-1], abs=0.02)
    assert estimator.time_s - estimator.memory.start_s > NOTHING_KNOWN_AFTER_S


def test_samples_that_are_further_apart_by_choice_are_no_gaps():
    log, _, _ = charged_unseen("lfp")
    settings = SocEstimator(label("lfp"), filter="ekf").settings
    patient = replace(settings, gap_s=10 * HOUR)
    run = SocEstimator(patient).run(log)
    assert not np.any(run.flags & SocFlag.GAP)


def test_what_is_stored_at_the_end_only_is_one_value_also_after_a_gap():
    log, _, _ = charged_unseen("lfp")
    along, at_end = (SocEstimator(label("lfp"), 0.8).run(log, learnt_along=given) for given in (True, False))
    assert at_end.soh_capacity.shape == (1,)
    # the second run may be the one with which the filter's logs have become worth machine code
    assert at_end.soh_capacity[0] == pytest.approx(along.soh_capacity[-1], rel=1e-9)
    pytest.importorskip("pandas")
    frame = at_end.to_pandas()
    assert len(frame) == len(log) and "soc" in frame and "soh_capacity" not in frame
