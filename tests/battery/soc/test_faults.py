"""What sensors do when they fail: every sample is survived and flagged, and afterwards the estimate returns."""

import math
from collections import Counter
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from battery.examples import LFP, NMC, drive, samples, scan, simulate
from ohmward import SocEstimator, generic_battery, make_robot_day
from ohmward.battery.models.noise import BatteryNoise
from ohmward.battery.soc.coulomb import CoulombCounting, RestOcv
from ohmward.battery.soc.sample import Estimator, SocFlag, SocSample
from ohmward.battery.soc.thevenin_filter import TheveninFilter
from ohmward.battery.soc.voltage_faults import JUMP_SHARE, LevelJudgement, LevelLimits, VoltageLevel
from ohmward.filters.belief import unpack

NOISE = BatteryNoise()
NAN, INF = math.nan, math.inf
LENGTH, FIRST, LAST = 5400, 1800, 3600
OUTAGE, ONE = slice(FIRST, LAST), slice(FIRST, FIRST + 1)
TRUTH = simulate(NMC, drive(np.random.default_rng(1), LENGTH, -0.3), 0.9)
ESTIMATORS: dict[str, Estimator] = {
    "ekf": TheveninFilter(NMC, NOISE, idle_current_A=0.0),
    "ukf": TheveninFilter(NMC, NOISE, method="ukf", idle_current_A=0.0),
    "aekf": TheveninFilter(NMC, NOISE, method="ekf", matching=True, idle_current_A=0.0),
    "coulomb": CoulombCounting(NMC, NOISE),
    "ocv": RestOcv(NMC, NOISE),
}


def run(name, columns):
    """Estimates (T,) of the estimator of this name over columns (T,)."""
    return scan(ESTIMATORS[name], columns, 0.9, lowering="machine")


def broken(where, **changes):
    """Samples of a good run in which some values are replaced, or changed by a function."""
    columns = samples(TRUTH, 0.02, NOISE)
    for name, new in changes.items():
        column = getattr(columns, name)
        column[where] = new(column[where]) if callable(new) else new
    return columns


def flagged(estimates, flag):
    """Indices of the samples that carry the flag."""
    return np.flatnonzero(estimates.flags.astype(int) & flag)


def assert_sane(estimates):
    assert np.all((estimates.soc >= 0.0) & (estimates.soc <= 1.0))
    assert np.all(np.isfinite(estimates.soc_std) & (estimates.soc_std > 0.0))


SINGLE: dict[str, tuple[dict[str, Any], SocFlag]] = {
    "voltage nan": ({"voltage_V": NAN}, SocFlag.NO_VOLTAGE),
    "voltage inf": ({"voltage_V": INF}, SocFlag.NO_VOLTAGE),
    "voltage 0": ({"voltage_V": 0.0}, SocFlag.NO_VOLTAGE),
    "voltage +5 V": ({"voltage_V": lambda v: v + 5.0}, SocFlag.NO_VOLTAGE),
    "voltage -5 V": ({"voltage_V": lambda v: v - 5.0}, SocFlag.NO_VOLTAGE),
    "voltage +1.5 V": ({"voltage_V": lambda v: v + 1.5}, SocFlag.VOLTAGE_REJECTED),
    "voltage -2 V": ({"voltage_V": lambda v: v - 2.0}, SocFlag.VOLTAGE_REJECTED),
    "current nan": ({"current_A": NAN}, SocFlag.NO_CURRENT),
    "current inf": ({"current_A": -INF}, SocFlag.NO_CURRENT),
    "current 1000 A": ({"current_A": 1000.0}, SocFlag.NO_CURRENT),
    "current -1000 A": ({"current_A": -1000.0}, SocFlag.NO_CURRENT),
    "everything nan": ({"current_A": NAN, "voltage_V": NAN}, SocFlag.NO_CURRENT | SocFlag.NO_VOLTAGE),
    "time backwards": ({"dt_s": -5.0}, SocFlag.BAD_TIME),
    "time nan": ({"dt_s": NAN}, SocFlag.BAD_TIME),
    "time 50 years on": ({"dt_s": 1.6e9}, SocFlag.BAD_TIME),
    "temperature nan": ({"temperature_degC": NAN}, SocFlag(0)),
    "temperature -127": ({"temperature_degC": -127.0}, SocFlag(0)),
    "time stands": ({"dt_s": 0.0}, SocFlag(0)),
}


@pytest.mark.parametrize("fault", SINGLE)
@pytest.mark.parametrize("name", ["ekf", "ukf"])
def test_one_bad_sample_is_flagged_and_changes_next_to_nothing(name, fault):
    changes, expected = SINGLE[fault]
    _, good = run(name, broken(ONE))
    _, estimates = run(name, broken(ONE, **changes))
    assert_sane(estimates)
    added = int(estimates.flags[FIRST]) & ~int(good.flags[FIRST]) & ~int(SocFlag.REST)
    assert SocFlag(added) == expected
    assert np.max(np.abs(estimates.soc - good.soc)) < 0.002


@pytest.mark.parametrize("name", ["coulomb", "ocv"])
@pytest.mark.parametrize("current_A", [1000.0, NAN, INF])
def test_one_bad_current_costs_counting_no_charge(name, current_A):
    _, good = run(name, broken(ONE))
    _, estimates = run(name, broken(ONE, current_A=current_A))
    assert flagged(estimates, SocFlag.NO_CURRENT).tolist() == [FIRST]
    assert np.max(np.abs(estimates.soc - good.soc)) < 0.001


def test_flags_are_counted_sample_by_sample():
    columns = broken(OUTAGE, voltage_V=NAN)
    columns.current_A[10:15] = NAN
    columns.dt_s[20] = -1.0
    _, estimates = run("ekf", columns)
    counts = Counter({flag: len(flagged(estimates, flag)) for flag in SocFlag})
    assert counts[SocFlag.NO_VOLTAGE] == LAST - FIRST
    assert counts[SocFlag.NO_CURRENT] == 5
    assert counts[SocFlag.BAD_TIME] == 1


LASTING: dict[str, dict[str, Any]] = {
    "voltage nan": {"voltage_V": NAN},
    "current nan": {"current_A": NAN},
    "everything nan": {"voltage_V": NAN, "current_A": NAN},
    "voltage stuck": {"voltage_V": float(TRUTH.voltage_V[FIRST])},
    "voltage +0.2 V": {"voltage_V": lambda v: v + 0.2},
    "voltage -0.2 V": {"voltage_V": lambda v: v - 0.2},
    "voltage of another battery": {"voltage_V": 5.5},
    "current stuck": {"current_A": 1.0},
    "current with the wrong sign": {"current_A": lambda i: -i},
}


@pytest.mark.parametrize("fault", LASTING)
@pytest.mark.parametrize("name", ["ekf", "ukf"])
def test_half_an_hour_of_a_fault_is_survived_and_the_estimate_returns(name, fault):
    _, estimates = run(name, broken(OUTAGE, **LASTING[fault]))
    error = estimates.soc - TRUTH.soc
    assert_sane(estimates)
    assert abs(error[-1]) < max(0.05, (3 if name == "ekf" else 4) * estimates.soc_std[-1])
    assert abs(error[-1]) < 0.1


@pytest.mark.parametrize("fault", ["voltage +0.2 V", "voltage -0.2 V", "current stuck"])
def test_a_lasting_contradiction_is_noticed_in_time(fault):
    """A voltage that jumped is not used for as long as it had kept its level before."""
    _, estimates = run("ekf", broken(slice(FIRST, LENGTH), **LASTING[fault]))
    lost = flagged(estimates, SocFlag.DIVERGED)
    assert lost.size
    assert FIRST + 60 <= lost[0] <= 2 * FIRST + 120
    assert estimates.soc_std[lost[0] :].max() > 0.1


def test_a_voltage_that_stands_still_under_changing_loads_is_flagged_and_covered():
    columns = samples(TRUTH, 0.02, NOISE)
    columns.voltage_V[OUTAGE] = columns.voltage_V[FIRST]
    _, estimates = run("ekf", columns)
    inside = np.abs(estimates.soc - TRUTH.soc) < 1.96 * estimates.soc_std
    assert inside[FIRST:].all()
    assert flagged(estimates, SocFlag.NO_VOLTAGE).size > 0.8 * (LAST - FIRST)
    assert not flagged(estimates, SocFlag.DIVERGED).size


@pytest.mark.parametrize(("late", "diverged"), [(0, False), (1, False), (1800, True)])
def test_a_rest_with_the_voltage_of_a_load_has_told_nothing(late, diverged):
    """Half an hour of rest and a load: its voltage comes with the current, a sample later, or never was the rest's."""
    current_A = np.concatenate([np.zeros(LENGTH // 3), np.full(LENGTH // 3, -2.0)])
    truth = simulate(NMC, current_A, 0.6)
    begin = LENGTH // 3
    voltage_V = np.round(truth.voltage_V, 3)
    voltage_V[begin - late : begin + 1] = voltage_V[begin if late > 1 else begin - late]
    _, estimates = run("ekf", samples(truth)._replace(voltage_V=voltage_V))
    assert bool(flagged(estimates, SocFlag.DIVERGED).size) == diverged
    covered = np.abs(estimates.soc - truth.soc) < 1.96 * estimates.soc_std
    assert covered[begin + 60 :].all()


@pytest.mark.parametrize(("spike_V", "in_a_row"), [(8.0, 1), (10.5, 1), (16.0, 1), (10.5, 2), (10.5, 3)])
def test_rare_spikes_of_the_voltage_hardly_change_an_estimate_from_the_label(spike_V, in_a_row):
    """Of unknown hypotheses one accepts nearly any voltage: it must not win by those that nothing explains."""
    day = make_robot_day("lfp").mission
    if in_a_row > 1:
        day = day.between(0.0, 4.5 * 3600.0)  # up to the charge, whose end two spikes in a row may hide
    voltage_V = day.voltage_V.copy()
    first = np.random.default_rng(1).choice(len(day) - in_a_row, len(day) // 300, replace=False)
    spiked_at = np.unique(first[:, None] + np.arange(in_a_row))
    voltage_V[spiked_at] = spike_V
    label = generic_battery("lfp", 12.0, 4)
    good, spiked = (SocEstimator(label).run(replace(day, voltage_V=v)) for v in (day.voltage_V, voltage_V))
    assert np.abs(spiked.soc - good.soc).max() < 0.01
    rejected = flagged(spiked, SocFlag.VOLTAGE_REJECTED)
    assert set(spiked_at) <= set(rejected) and len(rejected) < 1.05 * len(spiked_at)


def test_a_jump_is_used_once_it_has_lasted_as_long_as_the_level_before():
    begin = 600
    columns = samples(TRUTH)
    columns.voltage_V[begin:] -= 0.5
    _, estimates = run("ekf", columns)
    rejected = flagged(estimates, SocFlag.VOLTAGE_REJECTED)
    lasted = begin + begin
    assert rejected[: lasted - begin - 10].tolist() == list(range(begin, lasted - 10))
    assert flagged(estimates, SocFlag.DIVERGED)[0] >= lasted - 10


@pytest.mark.parametrize("offset_V", [0.08, -0.08, 0.15, -0.15])
@pytest.mark.parametrize("name", ["ekf", "ukf"])
def test_a_false_voltage_of_minutes_hardly_changes_an_estimate(name, offset_V):
    """As of a sense wire that comes loose under changing loads."""
    _, good = run(name, broken(OUTAGE))
    _, estimates = run(name, broken(slice(FIRST, FIRST + 1200), voltage_V=lambda v: v + offset_V))
    assert np.abs(estimates.soc - good.soc).max() < 0.005
    assert flagged(estimates, SocFlag.VOLTAGE_REJECTED).tolist() == list(range(FIRST, FIRST + 1200))


@pytest.mark.parametrize("offset_V", [0.4, -0.4])
def test_hypotheses_hold_the_same_voltages_to_be_false(offset_V):
    day = make_robot_day("lfp").mission.between(0.0, 3 * 3600.0)
    voltage_V = day.voltage_V.copy()
    voltage_V[(day.time_s >= 5400.0) & (day.time_s < 6300.0)] += offset_V
    label = generic_battery("lfp", 12.0, 4)
    good, false = (SocEstimator(label).run(replace(day, voltage_V=v)) for v in (day.voltage_V, voltage_V))
    assert np.abs(false.soc - good.soc).max() < 0.02


def test_a_noise_that_the_file_does_not_expect_decides_between_no_hypotheses():
    day = make_robot_day("lfp").mission.between(0.0, 3 * 3600.0)
    noise_V = np.random.default_rng(4).normal(0.0, 0.1, len(day.time_s))
    noise_V[0] = 0.0
    label = generic_battery("lfp", 12.0, 4)
    good, noisy = (SocEstimator(label).run(replace(day, voltage_V=day.voltage_V + k * noise_V)) for k in (0, 1))
    assert np.abs(noisy.soc - good.soc).max() < 0.05


def test_a_given_state_of_charge_is_no_jump_of_the_voltage():
    estimator = SocEstimator(generic_battery("nmc", 2.0), 0.5)
    columns = samples(TRUTH)
    for k in range(200):
        estimator.update(float(k), columns.current_A[k], columns.voltage_V[k], 25.0)
    estimator.correct_soc(0.05)
    estimate = estimator.update(200.0, columns.current_A[200], columns.voltage_V[200], 25.0)
    assert abs(estimate.innovation_V) > 0.2 and not estimate.flags & SocFlag.VOLTAGE_REJECTED


def test_a_level_is_left_at_once_and_found_again():
    level, limits = VoltageLevel(0.01, 0.0, 100.0, 1e-4), LevelLimits(5e-5, 0.2**2)
    assert not bool(level.judge(0.06, 0.0, 0.01, limits).leaves) and bool(level.judge(0.07, 0.0, 0.01, limits).leaves)
    away = level.after(0.07, 0.07, 2.0, np.True_, LevelJudgement(np.True_, np.False_), limits)
    assert (float(away.mean_V), float(away.trusted_s)) == (0.01, 98.0)
    assert float(away.away_V) == pytest.approx(0.06)
    assert bool(away.judge(0.045, 1.0, 1.0, limits).leaves) and not bool(away.judge(0.035, 0.0, 0.0, limits).leaves)
    assert not bool(away._replace(trusted_s=0.0).judge(0.07, 0.0, 0.0, limits).leaves)


@pytest.mark.parametrize(("off_V", "leaves", "returns"), [(-0.1, False, True), (0.1, True, False), (0.0, False, False)])
def test_a_voltage_comes_back_from_a_jump_that_was_used(off_V, leaves, returns):
    limits, used = LevelLimits(5e-5, 0.2**2), LevelJudgement(np.False_, np.False_)
    away = VoltageLevel(0.0, 0.1, 0.0, 1e-4, away_s=61.0)
    assert float(away._replace(away_s=59.0).after(0.1, 0.0, 1.0, np.True_, used, limits).used_V) == 0.0
    level = away.after(0.1, 0.0, 1.0, np.True_, used, limits)
    assert float(level.used_V) == 0.1
    now = level.judge(off_V, 0.0, 0.0, limits)
    assert (bool(now.leaves), bool(now.returns)) == (leaves, returns)
    assert not bool(level.judge(off_V, 0.0, 0.04, limits).returns)  # the load of a worn battery that ends


def test_the_charge_is_forgotten_when_a_false_voltage_ends_that_was_used():
    _, estimates = run("ekf", broken(slice(600, 2100), voltage_V=lambda v: v + 0.15))
    assert 2101 in flagged(estimates, SocFlag.DIVERGED)
    assert not set(flagged(estimates, SocFlag.VOLTAGE_REJECTED)) & set(range(2100, LENGTH))


def test_a_large_jump_leaves_even_an_uncertain_level():
    level, limits = VoltageLevel(0.01, 0.0, 100.0, 1.0), LevelLimits(5e-5, 0.2**2)
    assert not bool(level.judge(0.2, 1.0, 0.0, limits).leaves) and bool(level.judge(0.22, 1.0, 0.0, limits).leaves)


@pytest.mark.parametrize("lag", [0, 1])
def test_a_voltage_that_lags_behind_a_heavy_load_is_used(lag):
    """Pulses of 4 C drop this cell by a tenth of its voltage."""
    current_A = np.repeat(np.tile([0.0, -8.0], 30), 20)
    truth = simulate(NMC, current_A, 0.9)
    voltage_V = np.concatenate([truth.voltage_V[:1].repeat(lag), truth.voltage_V[: len(current_A) - lag]])
    assert np.ptp(np.diff(voltage_V)) > 2 * JUMP_SHARE * NMC.ocv.voltage_V[-1]
    _, estimates = run("ekf", samples(truth)._replace(voltage_V=voltage_V))
    assert not flagged(estimates, SocFlag.VOLTAGE_REJECTED).size


def test_a_charger_that_holds_the_voltage_is_no_fault():
    current_A = np.concatenate([np.full(60, 0.0), 2.0 * np.exp(-np.arange(1800) / 600.0)])
    truth = simulate(NMC, current_A, 0.9)
    columns = samples(truth)._replace(voltage_V=np.full(len(current_A), 4.05))
    assert not flagged(run("ekf", columns)[1], SocFlag.NO_VOLTAGE).size


def test_nothing_is_lost_without_a_fault():
    _, estimates = run("ekf", broken(ONE))
    assert not flagged(estimates, SocFlag.DIVERGED | SocFlag.VOLTAGE_REJECTED).size


@pytest.mark.parametrize("name", ["ekf", "ukf", "coulomb"])
def test_without_a_current_sigma_grows_as_without_samples(name):
    """An hour without a current is the same doubt, whether it comes as one step or as 3600."""
    columns = broken(OUTAGE, current_A=NAN, voltage_V=NAN)
    _, dark = run(name, columns)
    keep = np.r_[0:FIRST, LAST - 1 : LENGTH]
    short = SocSample(*(column[keep] for column in columns))._replace(dt_s=np.diff(TRUTH.time_s[keep], prepend=0.0))
    _, gap = run(name, short)
    assert gap.soc_std[FIRST] == pytest.approx(dark.soc_std[LAST - 1], rel=0.02)
    assert gap.soc_std[FIRST] > 0.14
    assert int(gap.flags[FIRST]) & SocFlag.GAP


@pytest.mark.parametrize("model", [NMC, LFP], ids=["nmc", "lfp"])
@pytest.mark.parametrize("inside_A", [-1.0, 0.0, 0.3])
def test_after_an_hour_off_sigma_covers_what_may_have_happened(model, inside_A):
    current = np.concatenate([drive(np.random.default_rng(3), 1200), np.full(3600, inside_A), np.full(1200, -0.5)])
    truth = simulate(model, current, 0.8)
    keep = np.r_[0:1200, 4800:6000]
    columns = SocSample(*(column[keep] for column in samples(truth, 0.02, NOISE)))
    columns = columns._replace(dt_s=np.diff(truth.time_s[keep], prepend=0.0))
    _, estimates = scan(TheveninFilter(model, NOISE), columns, 0.8)
    error = estimates.soc - truth.soc[keep]
    assert np.all(np.abs(error) < 3 * estimates.soc_std)


@pytest.mark.parametrize("name", ESTIMATORS)
@pytest.mark.parametrize(
    "first", [SocSample(NAN, NAN, NAN, NAN), SocSample(0.0, 1e300, 1e300, 1e300), SocSample(-1.0, INF, 0.0, -INF)]
)
def test_a_first_sample_of_garbage_is_a_start_from_nothing(name, first):
    estimator, sample = ESTIMATORS[name], SocSample(*first)
    _, estimate = estimator.step(estimator.init(sample), sample)
    assert estimate.soc == pytest.approx(0.5, abs=0.01)
    assert estimate.soc_std == pytest.approx(0.289, abs=0.01)


anything = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True),
    st.floats(-10.0, 10.0),
    st.sampled_from([0.0, -0.0, 1e-300, 1e308, -1e308, NAN, INF, -INF, 3.7, 600.0, 601.0, 3e7]),
)


@pytest.mark.parametrize("name", ESTIMATORS)
@settings(max_examples=60)
@given(st.lists(st.builds(SocSample, anything, anything, anything, anything), min_size=1, max_size=60))
def test_whatever_the_samples_hold_the_estimate_is_one(name, garbage):
    columns = SocSample(*(np.array(column) for column in zip(*garbage, strict=True)))
    state, estimates = run(name, columns)
    assert_sane(estimates)
    if hasattr(state, "belief"):
        assert_covariance(unpack(state.belief).cov)


def assert_covariance(P):
    """Finite and positive semidefinite, each state in its own unit.

    A hysteresis that was driven to its end again and again is known there: its variance falls below the smallest
    numbers, where a correlation has no digits left.
    """
    assert np.all(np.isfinite(P))
    assert np.all(np.diag(P) >= 0.0)
    std = np.sqrt(np.diag(P))
    known = np.flatnonzero(std > 1e-100)
    assert len(known) >= len(std) - 1
    P, std = P[np.ix_(known, known)], std[known]
    assert np.linalg.eigvalsh(P / np.outer(std, std)).min() > -1e-9


@pytest.mark.slow
@pytest.mark.parametrize("name", ESTIMATORS)
def test_a_hundred_thousand_samples_of_garbage(name):
    rng = np.random.default_rng(1)
    wild = np.array([NAN, INF, -INF, 0.0, 1e308, -1e308, 1e-308, -5.0, 700.0, 1e7])

    def column(low, high):
        plausible = rng.uniform(low, high, 100_000)
        absurd = rng.choice(wild, 100_000) * rng.choice([1.0, 1.0, 1e-3, 1e3], 100_000)
        return np.where(rng.random(100_000) < 0.3, absurd, plausible)

    with np.errstate(all="ignore"):
        columns = SocSample(column(0.0, 3.0), column(-20.0, 20.0), column(2.0, 5.0), column(-20.0, 60.0))
    state, estimates = run(name, columns)
    assert_sane(estimates)
    if hasattr(state, "belief"):
        assert_covariance(unpack(state.belief).cov)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ekf", "ukf"])
def test_a_million_steps(name):
    """Eleven days at 1 Hz, a gentle cycle between 40 and 60 %."""
    repeats = 185
    swing = np.repeat([-0.4, 0.4], 2700)
    current = np.concatenate([swing[1350:], swing[:1350]])
    truth = simulate(NMC, current, 0.5)
    one = samples(truth, 0.02, NOISE)
    columns = SocSample(*(np.tile(column, repeats) for column in one))
    columns.dt_s[:] = 1.0
    state, estimates = run(name, columns)
    assert_sane(estimates)
    assert_covariance(unpack(state.belief).cov)
    assert np.abs(estimates.soc[-5400:] - truth.soc).max() < 0.03
