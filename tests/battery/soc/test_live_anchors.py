"""Full charges and cut-offs in the filter: exact updates, live and compiled alike, each used once."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from battery.anchor_examples import HOUR, day, drained, label
from battery.examples import NMC
from ohmward.battery.models.noise import BatteryNoise
from ohmward.battery.soc.anchor_rule import NO_EVENT, AnchorEvent
from ohmward.battery.soc.anchors import find_anchors
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.battery.soc.gaussian_sum import Widths, log_likelihood
from ohmward.battery.soc.registry import EstimatorSettings, make_estimator
from ohmward.battery.soc.sample import SocFlag, SocSample
from ohmward.battery.soc.thevenin_filter import TheveninFilter
from ohmward.filters.belief import unpack
from ohmward.filters.kalman import correct_state

METHODS = pytest.mark.parametrize("method", ("ekf", "ukf"))


def anchored_filter(chemistry, name="gsf"):
    return make_estimator(name, label(chemistry), EstimatorSettings(anchors=True))


def corrected(settings, state, prior, clean, event):
    foresight = settings.compare(state, prior, clean, event)
    return settings.correct(state, foresight, clean, foresight.judgement)


def anchored(run):
    return np.flatnonzero(run.flags.astype(int) & SocFlag.ANCHORED)


@METHODS
def test_an_event_is_the_kalman_update_by_soc_itself(method):
    settings = TheveninFilter(NMC, BatteryNoise(), method=method)
    state = settings.init(SocSample(0.0, -1.0, 3.7, 25.0), 0.6)
    clean = settings.sanitize(state, SocSample(1.0, -1.0, 3.7, 25.0))
    prior = settings.predict(state, clean)
    told = prior.mean[0] + 0.05
    update = corrected(settings, state, prior, clean, AnchorEvent(np.True_, np.False_, told, 0.02))
    expected = correct_state(prior, 0, told, 0.02**2)
    np.testing.assert_allclose(update.belief.mean, expected.mean, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(update.belief.cov, expected.cov, rtol=1e-9, atol=1e-12)
    density = norm.logpdf(told, prior.mean[0], np.sqrt(prior.cov[0, 0] + 0.02**2))
    for moved_on in (0.0, 1.0):  # no part of it is an error that stays with SoC
        widths = Widths(0.0, update.error.model_std_V**2, moved_on)
        found = log_likelihood(update.correction.innovation, update.R, update.error, widths, settings.gate)
        assert found == pytest.approx(density + 0.5 * np.log(2 * np.pi), abs=1e-9)
    assert update.voltage_V == pytest.approx(
        settings.system.voltage(prior.mean, clean, settings.voltage_error(prior, clean))[0]
    )
    assert np.isnan(float(update.voltage_std_V)) and bool(update.accepted) and not bool(update.contradicts)


def test_an_event_far_from_the_belief_passes_every_gate():
    settings = TheveninFilter(NMC, BatteryNoise())
    state = settings.init(SocSample(0.0, 0.0, 3.7, 25.0), 0.3, 0.01)
    clean = settings.sanitize(state, SocSample(1.0, 0.0, 3.7, 25.0))
    event = AnchorEvent(np.True_, np.False_, 1.0, 0.01)
    update = corrected(settings, state, settings.predict(state, clean), clean, event)
    assert update.belief.mean[0] > 0.6


def test_no_event_is_the_filter_without_anchors():
    settings = TheveninFilter(NMC, BatteryNoise())
    state = settings.init(SocSample(0.0, 0.0, 3.7, 25.0), 0.5)
    clean = settings.sanitize(state, SocSample(1.0, -1.0, 3.65, 25.0))
    prior = settings.predict(state, clean)
    with_rule = corrected(settings, state, prior, clean, AnchorEvent(np.False_, np.False_, 0.9, 0.01))
    without = corrected(settings, state, prior, clean, NO_EVENT)
    np.testing.assert_array_equal(with_rule.belief.mean, without.belief.mean)
    np.testing.assert_array_equal(with_rule.belief.cov, without.belief.cov)


@pytest.mark.parametrize("filter_name", ("gsf", "ekf", "ukf"))
def test_a_full_charge_after_a_wrong_count_is_found_live_and_in_the_log_alike(filter_name):
    log, truth = day("lfp", 0.3, [(0.2, 0.0), (7.0, 0.3), (0.3, 0.0), (0.5, -0.5)], interval_s=30.0)
    battery, settings = label("lfp"), anchored_filter("lfp", filter_name)
    run = SocEstimator(settings, initial_soc=0.5).run(log)
    (at,) = anchored(run)
    (full,) = (anchor for anchor in find_anchors(log, battery) if anchor.kind == "full charge")
    assert at <= full.sample
    assert abs(run.soc[at] - truth[at]) < 0.03
    live = SocEstimator(settings, initial_soc=0.5)
    seen = [
        live.update(*row) for row in zip(log.time_s, log.current_A, log.voltage_V, log.temperature_degC, strict=True)
    ]
    np.testing.assert_allclose([e.soc for e in seen], run.soc, atol=1e-7)
    np.testing.assert_allclose([e.soc_std for e in seen], run.soc_std, atol=1e-7)
    assert [int(e.flags) for e in seen] == run.flags.astype(int).tolist()


def test_a_cut_off_tells_that_the_battery_is_empty():
    log, truth = drained("nca", 0.2, rest_hours=0.3)
    run = SocEstimator(anchored_filter("nca", "ekf"), initial_soc=0.6).run(log)
    (at,) = anchored(run)
    assert abs(run.soc[at] - truth[at]) < 2 * run.soc_std[at]
    assert np.isnan(run.innovation_V[at]) and np.isnan(run.voltage_std_V[at]) and np.isfinite(run.voltage_V[at])


def test_three_charges_are_three_events_and_a_broken_off_one_is_none():
    charge, drive = (8.0, 0.3), (1.0, -0.4)
    log, _ = day("nca", 0.5, [charge, drive, charge, drive, charge, drive, (0.5, 0.3), drive], interval_s=30.0)
    assert len(anchored(SocEstimator(anchored_filter("nca")).run(log))) == 3


def test_by_default_they_correct_batteries_that_gas():
    log, _ = day("nca", 0.5, [(8.0, 0.3), (1.0, -0.4)], interval_s=30.0)
    assert not anchored(SocEstimator(label("nca")).run(log)).size
    for anchors, used in ((None, True), (False, False)):
        settings = make_estimator("ekf", label("lead-acid"), EstimatorSettings(anchors=anchors))
        assert isinstance(settings, TheveninFilter) and settings.anchors is used


def test_a_snapshot_in_the_middle_of_the_taper_goes_on_to_the_same_event():
    log, _ = day("lfp", 0.5, [(6.0, 0.3), (0.5, -0.4)], interval_s=30.0)
    settings = anchored_filter("lfp")
    whole = SocEstimator(settings)
    run = whole.run(log)
    (at,) = anchored(run)
    rows = list(zip(log.time_s, log.current_A, log.voltage_V, log.temperature_degC, strict=True))
    first = SocEstimator(settings)
    for row in rows[: at - 3]:
        first.update(*row)
    later = SocEstimator.restore(settings, json.loads(json.dumps(first.snapshot())))
    seen = [later.update(*row) for row in rows[at - 3 :]]
    assert [k for k, e in enumerate(seen) if e.flags & SocFlag.ANCHORED] == [3]
    assert seen[-1].soc == pytest.approx(run.soc[-1], abs=1e-7)


def test_an_overcharge_of_lead_acid_changes_neither_soc_nor_the_offset():
    log, _ = day("lead-acid", 0.5, [(0.2, 0.0), (24.0, 0.15)], interval_s=60.0)
    run = SocEstimator(label("lead-acid"), filter="ekf").run(log)
    at, *others = anchored(run)
    assert not others and log.time_s[-1] - log.time_s[at] > 4 * HOUR
    assert np.ptp(run.soc[at + 1 :]) < 0.01
    assert np.ptp(run.current_offset_A[at + 1 :]) < 0.01 * label("lead-acid").capacity_Ah


def test_offset_and_capacity_are_learnt_from_full_to_full():
    """Two days from full to full with an offset of 1 % of C: counted alone, the second would end 20 points off."""
    phases = [(8.0, 0.3), (1.0, 0.0), (2.0, -0.3), (1.0, 0.0)]
    log, truth = day("lfp", 0.5, phases * 3, interval_s=30.0, offset_C=0.01)
    run = SocEstimator(anchored_filter("lfp")).run(log)
    offset_A = 0.01 * label("lfp").capacity_Ah
    assert len(anchored(run)) == 3
    assert run.current_offset_A[-1] == pytest.approx(offset_A, abs=0.5 * offset_A)
    assert abs(run.soc[-1] - truth[-1]) < 2 * run.soc_std[-1]


def test_a_log_of_nothing_and_a_log_of_noise_are_survived():
    rng = np.random.default_rng(4)
    log, _ = day("nca", 0.5, [(2.0, 0.3)], interval_s=30.0)
    n = len(log)
    noise = replace(log, current_A=rng.normal(0.0, 20.0, n), voltage_V=rng.normal(3.7, 2.0, n))
    nothing = replace(log, current_A=np.full(n, np.nan), voltage_V=np.full(n, np.nan))
    for bad in (noise, nothing):
        run = SocEstimator(anchored_filter("nca")).run(bad)
        assert np.isfinite(run.soc).all() and np.isfinite(run.soc_std).all()
    last = unpack(SocEstimator(anchored_filter("nca", "ekf")).run(noise).end.belief)
    assert np.linalg.eigvalsh(last.cov).min() > -1e-9
