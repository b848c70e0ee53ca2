"""The sum against its one member, against weights and posteriors computed otherwise, and where one Gaussian fails."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import norm

from battery.examples import LFP, NMC, PLAIN, STRAIGHT, drive, row, samples, scan, simulate
from ohmward.battery.models.noise import BatteryNoise, CurrentSensor
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.battery.soc.gaussian_sum import (
    LEAST_LOG_WEIGHT,
    GaussianSumFilter,
    normalised,
)
from ohmward.battery.soc.sample import SocFlag, SocSample
from ohmward.battery.soc.start_density import Hypothesis, InitialSoc
from ohmward.battery.soc.thevenin_filter import TheveninFilter
from ohmward.errors import InputError
from ohmward.filters.belief import unpack
from ohmward.logs.log import Log

NOISE = BatteryNoise(hysteresis_std=0.3, activation_std_K=500.0)
#: Samples that are independent, and no error but that of the voltage.
WHITE = replace(PLAIN, voltage_std_V=0.05, ocv_slip_std=0.0)
EXACT = CurrentSensor(noise_std_A=0.0, offset_std_A=0.0, offset_walk_A=0.0, gain_std=0.0)


def drive_of(model, soc, steps=1500, seed=1, offset_A=0.03, noise=NOISE):
    """Truth, and what the sensors show of it."""
    truth = simulate(model, drive(np.random.default_rng(seed), steps), soc)
    return truth, samples(truth, offset_A, noise, seed)


@pytest.mark.parametrize("soc", [None, 0.7, 0.3])
def test_one_hypothesis_is_the_filter_to_the_bit(soc):
    _, columns = drive_of(LFP, 0.7)
    member = TheveninFilter(LFP, NOISE, idle_current_A=0.0)
    _, found = scan(GaussianSumFilter(member, 1), columns, soc)
    _, expected = scan(member, columns, soc)
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("log_weights", [(0.0, 0.0), (0.0, -3.0)])
def test_equal_members_are_the_filter_whatever_their_weights(log_weights):
    _, columns = drive_of(LFP, 0.7)
    settings = GaussianSumFilter(TheveninFilter(LFP, NOISE), 2)
    one = settings.member.init(row(columns, 0), 0.6)
    end, found = scan(settings, columns, state=settings.begun((one, one), log_weights))
    _, expected = scan(settings.member, columns, 0.6)
    for a, b in zip(found, expected, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-12)
    evidence = math.exp(-np.abs(columns.current_A - 0.03).sum() / LFP.capacity_As)  # is all that fades
    assert end.log_weights == pytest.approx(np.multiply(log_weights, evidence), rel=0.01)


def test_weights_are_the_products_of_the_likelihoods():
    """SciPy's densities of the members' innovations, each member run on its own; no error stays with SoC.

    What they add up to fades with the charge of each step.
    """
    truth = simulate(STRAIGHT, drive(np.random.default_rng(2), 60), 0.6)
    columns = samples(truth, noise=WHITE)
    settings = GaussianSumFilter(TheveninFilter(STRAIGHT, WHITE))
    state = settings.init(row(columns, 0))
    log_weights, members = np.array(state.log_weights), list(state.members)
    for k in range(60):
        sample = row(columns, k)
        log_weights -= logsumexp(log_weights)
        moved_As = abs(columns.current_A[max(k - 1, 0) : k + 1].mean()) * sample.dt_s
        log_weights *= math.exp(-moved_As / STRAIGHT.capacity_As)
        for j, member in enumerate(members):
            taken = settings.member.take_in(member, sample)
            foresight = settings.member.foresee(member, taken, False)
            done = settings.member.advance(member, taken, False, foresight, foresight.judgement)
            innovation = done.update.correction.innovation
            log_weights[j] += norm.logpdf(innovation.value[0], scale=np.sqrt(innovation.cov[0, 0]))
            members[j] = done.state
        state, estimate = settings.step(state, sample)
        weights = np.exp(log_weights - logsumexp(log_weights))
        assert weights.min() > math.exp(LEAST_LOG_WEIGHT)
        assert normalised(state.log_weights) == pytest.approx(weights, abs=1e-9)
        soc = [unpack(member.belief).mean[0] for member in members]
        assert estimate.soc == pytest.approx(weights @ soc, abs=1e-9)


def test_on_a_straight_cell_it_is_the_exact_posterior():
    """Known current, straight curve: SoC at the start decides all voltages, and Bayes on a grid of it is exact."""
    model = replace(STRAIGHT, r_ohm=((1e-9, 1e-9),), tau_s=(1e-3,))  # relaxed at once
    truth = simulate(model, drive(np.random.default_rng(3), 40), 0.55)
    columns = samples(truth, noise=WHITE)._replace(current_A=truth.current_A)
    settings = GaussianSumFilter(TheveninFilter(model, WHITE, EXACT, gate=1e9), 3)
    starts, stds, weights = (0.25, 0.45, 0.8), (0.05, 0.1, 0.03), (0.6, 0.1, 0.3)
    parts = [Hypothesis(w, InitialSoc(m, s)) for w, m, s in zip(weights, starts, stds, strict=True)]
    _, found = scan(settings, columns, state=settings.start_from(row(columns, 0), *parts))

    grid = np.linspace(-0.2, 1.2, 20001)
    log_density = np.log(sum(w * norm.pdf(grid, m, s) for m, s, w in zip(starts, stds, weights, strict=True)))
    moved = truth.soc - truth.soc[0]
    for k, (i, v) in enumerate(zip(columns.current_A, columns.voltage_V, strict=True)):
        log_density += norm.logpdf(v, 3.0 + grid + moved[k] + 0.02 * i, WHITE.voltage_std_V)
        density = np.exp(log_density - logsumexp(log_density))
        mean = density @ grid
        assert found.soc[k] == pytest.approx(mean + moved[k], abs=2e-4)
        assert found.soc_std[k] == pytest.approx(math.sqrt(density @ (grid - mean) ** 2), rel=0.01)


def test_a_start_without_a_voltage_has_the_moments_of_the_prior():
    """Told 60 +- 3 %, with a share of 2 % for anything else."""
    settings = GaussianSumFilter(TheveninFilter(LFP, NOISE))
    first = SocSample(0.0, 0.0, math.nan, 25.0)
    blind = unpack(settings.merged(settings.init(first, 0.6)).belief)
    taken = unpack(settings.merged(settings.start(first, 0.6, 0.03)).belief)
    assert taken.mean[0] == pytest.approx(0.98 * 0.6 + 0.02 * 0.5, abs=1e-9)
    assert taken.mean[0] == pytest.approx(blind.mean[0], abs=1e-4)
    assert taken.cov[0, 0] == pytest.approx(blind.cov[0, 0], rel=0.02)


def test_the_merged_state_has_the_moments_of_the_estimate():
    _, columns = drive_of(LFP, 0.5, 100)
    settings = GaussianSumFilter(TheveninFilter(LFP, NOISE))
    state, estimates = scan(settings, columns)
    belief = unpack(settings.merged(state).belief)
    assert belief.mean[0] == pytest.approx(estimates.soc[-1], abs=1e-12)
    assert math.sqrt(belief.cov[0, 0]) == pytest.approx(estimates.soc_std[-1], rel=1e-9)
    assert np.linalg.eigvalsh(belief.cov).min() > -1e-12


def test_a_start_told_wrong_on_a_flat_curve_is_covered():
    """Thirty points too low, nine drives of 90 minutes: most of the time is covered, by one Gaussian next to none."""
    member = TheveninFilter(LFP, NOISE)
    covered = {}
    for settings in (member, GaussianSumFilter(member)):
        inside = []
        for seed, soc in enumerate(np.linspace(0.65, 0.95, 9)):
            truth, columns = drive_of(LFP, soc, 5400, seed)
            _, found = scan(settings, columns, soc - 0.3)
            inside.append(np.abs(found.soc - truth.soc)[1800:] < 1.96 * found.soc_std[1800:])
        covered[type(settings)] = np.mean(inside)
    assert covered[GaussianSumFilter] > 0.8
    assert covered[TheveninFilter] < 0.2


def test_a_right_start_stays_that_of_one_filter():
    truth, columns = drive_of(LFP, 0.8, 3000)
    member = TheveninFilter(LFP, NOISE)
    _, one = scan(member, columns, 0.8)
    _, found = scan(GaussianSumFilter(member), columns, 0.8)
    assert np.abs(found.soc - truth.soc).max() < np.abs(one.soc - truth.soc).max() + 0.01
    assert (found.soc_std[60:] < 1.3 * one.soc_std[60:]).all()


@pytest.mark.parametrize("voltage_V", [math.nan, math.inf, -1.0, 1e6])
def test_a_voltage_that_is_none_weighs_no_hypothesis(voltage_V):
    _, columns = drive_of(LFP, 0.5, 30)
    settings = GaussianSumFilter(TheveninFilter(LFP, NOISE))
    state, _ = scan(settings, columns)
    after, estimate = settings.step(state, row(columns, 29)._replace(voltage_V=voltage_V))
    assert after.log_weights == pytest.approx(state.log_weights, rel=1e-3)  # what fades in a step is less
    assert int(estimate.flags) & SocFlag.NO_VOLTAGE


def test_an_outlier_that_nothing_explains_weighs_no_hypothesis():
    _, columns = drive_of(NMC, 0.5, 600)
    settings = GaussianSumFilter(TheveninFilter(NMC, WHITE))
    state, _ = scan(settings, columns, 0.5)
    after, estimate = settings.step(state, row(columns, 599)._replace(voltage_V=5.5))
    assert after.log_weights == pytest.approx(state.log_weights, rel=1e-3)  # what fades in a step is less
    assert int(estimate.flags) & SocFlag.VOLTAGE_REJECTED


def test_no_weight_underflows_and_every_state_stays_finite():
    truth, columns = drive_of(NMC, 0.8, 6000)
    rng = np.random.default_rng(5)
    for column in columns[1:3]:
        column[rng.random(len(column)) < 0.1] = math.nan
        column[rng.random(len(column)) < 0.02] = 1e9
    settings = GaussianSumFilter(TheveninFilter(NMC, NOISE))
    state, found = scan(settings, columns, 0.2)
    assert all(np.isfinite(column).all() for column in (found.soc, found.soc_std, state.log_weights))
    assert state.log_weights.min() >= LEAST_LOG_WEIGHT and state.log_weights.max() == 0.0
    assert abs(found.soc - truth.soc)[-1] < 0.05


def test_the_voltage_of_another_battery_makes_it_diverge_and_restart():
    truth, columns = drive_of(NMC, 0.6, 3000)
    faulty = columns._replace(voltage_V=np.where(np.arange(3000) < 400, columns.voltage_V, columns.voltage_V - 0.35))
    _, found = scan(GaussianSumFilter(TheveninFilter(NMC, NOISE)), faulty, 0.6)
    assert (found.flags.astype(int) & SocFlag.DIVERGED).any()
    assert found.soc[-1] < truth.soc[-1] - 0.1  # it believes the voltage again


def test_explains_its_band_and_rehearses_a_remedy():
    _, columns = drive_of(LFP, 0.5, 900)
    estimator = SocEstimator(GaussianSumFilter(TheveninFilter(LFP, NOISE)))
    run = estimator.run(Log("drive", np.cumsum(columns.dt_s), columns.current_A, columns.voltage_V))
    soc, std = float(run.estimates.soc[-1]), float(run.estimates.soc_std[-1])
    said = estimator.explain()
    assert said.soc == pytest.approx(soc, abs=1e-9)
    assert said.causes
    assert bool(said.remedies) == (not said.known)
    total = math.sqrt(sum(cause.points**2 for cause in said.causes))
    assert total == pytest.approx(196 * std, rel=0.05)


@pytest.mark.parametrize("count", [0, -1])
def test_needs_a_hypothesis(count):
    with pytest.raises(InputError, match="count must be"):
        GaussianSumFilter(TheveninFilter(LFP), count)
