"""Standard deviations of offset, capacity and resistance: against samples of the state, and against lives they hold."""

import math
from dataclasses import replace

import numpy as np
import pytest

from battery.examples import LFP, NMC, drive, samples, scan, simulate, simulate_lives
from kernels import kernel_of
from ohmward.battery.chemistries import generic_battery
from ohmward.battery.models.noise import BatteryNoise, CurrentSensor
from ohmward.battery.models.thevenin import CircuitInput, ohmic_resistance
from ohmward.battery.models.thevenin import pair_resistances as pair_ohms
from ohmward.battery.soc.anchor_rule import SocNormal
from ohmward.battery.soc.gaussian_sum import GaussianSumFilter
from ohmward.battery.soc.given_soc import correct_soc
from ohmward.battery.soc.registry import available, make_estimator
from ohmward.battery.soc.sample import STD_OF, SocSample
from ohmward.battery.soc.thevenin_filter import TheveninFilter
from ohmward.filters.belief import Belief, pack, unpack
from ohmward.filters.consistency import BAND_95

NOISE = BatteryNoise(capacity_std=0.1, resistance_std=0.25)
SENSOR = CurrentSensor(offset_std_A=0.05, gain_std=0.02)
#: Resistances that change with SoC, so that it counts which of them has grown.
STEEP = replace(NMC, r0_discharge_ohm=(0.09, 0.05, 0.03), r_ohm=((0.01, 0.02, 0.03), (0.02, 0.03, 0.06)))


def belief_of(settings, scale, seed=1):
    """A belief of an aged battery with a full covariance, its standard deviations those of the start times `scale`."""
    start = settings.system.start(0.35, 0.03, CircuitInput(-1.0, 25.0))
    n = len(start.mean)
    A = np.random.default_rng(seed).standard_normal((n, 2 * n))
    A /= np.linalg.norm(A, axis=1)[:, None]
    std = scale * np.sqrt(np.diag(start.cov))
    mean = start.mean.copy()
    for name, value in (("charge_gain", 1.2), ("ohmic_log_ratio", 0.5), ("pair_log_ratio", -0.3), ("offset_A", 0.04)):
        mean[settings.state_names.index(name)] = value
    return Belief(mean, np.outer(std, std) * (A @ A.T))


def drawn(settings, belief, gain_std, count=400_000, seed=2):
    """Offset, capacity and resistance (count,) of states from the belief, with formulas of their own."""
    rng = np.random.default_rng(seed)
    x = dict(zip(settings.state_names, rng.multivariate_normal(belief.mean, belief.cov, count).T, strict=True))
    at = np.linspace(0.0, 1.0, 3)
    ohmic, *pairs = (np.interp(x["soc"], at, r) for r in (settings.model.r0_discharge_ohm, *settings.model.r_ohm))
    grown = ohmic * np.exp(x["ohmic_log_ratio"]) + sum(pairs) * np.exp(x["pair_log_ratio"])
    sensor_gain = 1.0 + gain_std * rng.standard_normal(count)
    return x["offset_A"], sensor_gain / x["charge_gain"], grown / (ohmic + sum(pairs))


NAMES = ("current_offset_A", "soh_capacity", "resistance_ratio")


def test_standard_deviations_are_those_of_states_drawn_from_the_covariance():
    small = replace(SENSOR, gain_std=0.001)
    settings = TheveninFilter(STEEP, NOISE, small)
    belief = belief_of(settings, 0.03)
    known = settings.system.known(belief)
    for name, values in zip(NAMES, drawn(settings, belief, 0.001), strict=True):
        assert known[name] == pytest.approx(values.mean(), rel=1e-3)
        assert known[STD_OF[name]] == pytest.approx(values.std(), rel=5e-3)


def test_bands_hold_ninety_five_per_cent_of_the_states_of_a_wide_belief():
    """Normal for offset and capacity, log-normal for the resistance, as they are drawn."""
    settings = TheveninFilter(STEEP, NOISE, SENSOR)
    belief = belief_of(settings, 1.0)
    known = settings.system.known(belief)
    offset, capacity, resistance = drawn(settings, belief, SENSOR.gain_std)
    scales = {
        "current_offset_A": np.abs(offset - known["current_offset_A"]) / known["current_offset_std_A"],
        "soh_capacity": np.abs(capacity - known["soh_capacity"]) / known["soh_capacity_std"],
        "resistance_ratio": np.abs(np.log(resistance / known["resistance_ratio"]))
        * (known["resistance_ratio"] / known["resistance_ratio_std"]),
    }
    for name, z in scales.items():
        assert np.mean(z < BAND_95) == pytest.approx(0.95, abs=0.01), name


def test_before_the_first_sample_they_are_those_of_the_file():
    settings = TheveninFilter(NMC, NOISE, SENSOR)
    known = settings.system.known(settings.system.start(0.5, 0.03, CircuitInput(-1.0, 25.0)))
    ohmic, pairs = (
        ohmic_resistance(0.5, CircuitInput(-1.0, 25.0), NMC),
        sum(pair_ohms(0.5, CircuitInput(-1.0, 25.0), NMC)),
    )
    share = ohmic / (ohmic + pairs)
    assert known["current_offset_std_A"] == pytest.approx(0.05)
    assert known["soh_capacity_std"] == pytest.approx(math.sqrt(0.1**2 + 2 * 0.02**2))
    correlated = share**2 + (1 - share) ** 2 + 2 * 0.7 * share * (1 - share)
    assert known["resistance_ratio_std"] == pytest.approx(0.25 * math.sqrt(correlated), rel=1e-6)


def sum_after(settings, beliefs, log_weights):
    """The estimate after a sample without any measurement, with these beliefs before it."""
    nothing = SocSample(0.0, math.nan, math.nan, math.nan)
    one = settings.member.init(SocSample(0.0, -1.0, 3.7, 25.0), 0.5)
    members = tuple(one._replace(belief=pack(belief)) for belief in beliefs)
    return settings.step(settings.begun(members, log_weights), nothing)[1]


def test_a_sum_has_the_standard_deviation_of_its_mixture():
    """Moments of values drawn from each hypothesis in proportion to its weight: their spread counts too."""
    settings = GaussianSumFilter(TheveninFilter(STEEP, NOISE, replace(SENSOR, gain_std=0.0)), 3)
    beliefs, weights = [], (0.5, 0.3, 0.2)
    for k, shift in enumerate((0.0, 0.03, -0.05)):
        mean, cov = belief_of(settings.member, 0.1, seed=k)
        mean[2:] += shift * np.isin(settings.state_names, ("offset_A", "charge_gain", "ohmic_log_ratio"))[2:]
        beliefs.append(Belief(mean, cov))
    found = sum_after(settings, beliefs, list(np.log(weights)))
    parts = [
        drawn(settings.member, belief, 0.0, round(1e6 * weight), k)
        for k, (belief, weight) in enumerate(zip(beliefs, weights, strict=True))
    ]
    for name, *each in zip(NAMES, *parts, strict=True):
        values = np.concatenate(each)
        assert getattr(found, name) == pytest.approx(values.mean(), rel=2e-3)
        assert getattr(found, STD_OF[name]) == pytest.approx(values.std(), rel=0.01)


def test_hypotheses_that_are_sure_and_contradict_each_other_are_not_sure_together():
    settings = GaussianSumFilter(TheveninFilter(NMC, NOISE, replace(SENSOR, gain_std=0.0)), 2)
    sure = belief_of(settings.member, 1e-6)
    offset = settings.state_names.index("offset_A")
    other = sure._replace(mean=sure.mean + 0.2 * (np.arange(len(sure.mean)) == offset))
    found = sum_after(settings, [sure, other], [0.0, 0.0])
    assert found.current_offset_A == pytest.approx(0.14, abs=1e-6)
    assert found.current_offset_std_A == pytest.approx(0.1, rel=1e-4)
    assert found.soh_capacity_std < 1e-5


@pytest.mark.parametrize("settings", [TheveninFilter(NMC, NOISE), GaussianSumFilter(TheveninFilter(NMC, NOISE))])
def test_a_charge_that_is_told_changes_them_as_it_changes_the_state(settings):
    columns = samples(simulate(NMC, drive(np.random.default_rng(3), 900), 0.7), 0.03, NOISE)
    state, estimates = scan(settings, columns, 0.6, 0.1)
    last = type(estimates)(*(float(column[-1]) for column in estimates))
    after, told = correct_soc(settings, state, last, SocNormal(0.68, 0.01))
    belief = unpack(settings.merged(after).belief)
    k = settings.state_names.index("offset_A")
    assert told.current_offset_A == pytest.approx(belief.mean[k], rel=1e-9)
    assert told.current_offset_std_A == pytest.approx(math.sqrt(belief.cov[k, k]), rel=1e-9)
    g = settings.state_names.index("charge_gain")
    relative = math.hypot(math.sqrt(belief.cov[g, g]) / belief.mean[g], settings.sensor.gain_std)
    assert told.soh_capacity_std == pytest.approx(relative / belief.mean[g], rel=1e-3)
    assert told.resistance_ratio_std != last.resistance_ratio_std


@pytest.mark.parametrize("name", available(generic_battery("nmc", 2.0)))
def test_what_an_estimator_does_not_estimate_has_no_standard_deviation(name):
    settings = make_estimator(name, generic_battery("nmc", 2.0))
    first = SocSample(0.0, -0.5, 3.7, 25.0)
    _, estimate = settings.step(settings.init(first, 0.5), first)
    for quantity, std in STD_OF.items():
        assert math.isnan(getattr(estimate, quantity)) == math.isnan(getattr(estimate, std)), quantity
        assert not getattr(estimate, std) <= 0.0


LIVES, STEPS = 80, 4 * 3600


def lives(model, rng):
    """Measured current and voltage (T, LIVES) of cells with an offset, capacity and resistances each, and these."""
    offset_A = SENSOR.offset_std_A * rng.standard_normal(LIVES)
    gain = 1.0 + SENSOR.gain_std * rng.standard_normal(LIVES)
    capacity = 1.0 + NOISE.capacity_std * rng.standard_normal(LIVES)
    common, own = rng.standard_normal((2, LIVES))
    logs = NOISE.resistance_std * np.array([common, 0.7 * common + math.sqrt(1 - 0.7**2) * own])
    true_A = np.where(np.arange(STEPS) % 7200 < 3600, -0.6, 0.55) + drive(rng, STEPS, 0.0)
    soc, voltage_V = simulate_lives(model, true_A, capacity, *np.exp(logs))
    noise_A, noise_V = rng.standard_normal((2, STEPS, LIVES))
    measured_A = gain * true_A[:, None] + offset_A + SENSOR.noise_std_A * noise_A
    measured_V = voltage_V + NOISE.voltage_std_V * noise_V
    ohm = np.interp(soc, np.linspace(0, 1, 3), model.r0_discharge_ohm) * np.exp(logs[0])
    pair_ohm = sum(np.interp(soc, np.linspace(0, 1, 3), r) for r in model.r_ohm)
    resistance = (ohm + pair_ohm * np.exp(logs[1])) / (ohm * np.exp(-logs[0]) + pair_ohm)
    return measured_A, measured_V, offset_A, capacity, resistance


@pytest.mark.parametrize("model", [NMC, LFP], ids=["nmc", "lfp"])
def test_lives_are_covered(model):
    """Cells with an offset, a gain, a capacity and resistances as the file doubts them, over two cycles."""
    current_A, voltage_V, *truths = lives(model, np.random.default_rng(5))
    settings = GaussianSumFilter(TheveninFilter(model, NOISE, SENSOR))
    first = SocSample(0.0, float(current_A[0, 0]), math.nan, 25.0)
    start = settings.init(first, 0.8)
    columns = SocSample(np.r_[0.0, np.ones(STEPS - 1)], current_A, voltage_V, np.full(STEPS, 25.0))
    found = kernel_of(settings, start, first).scan_lanes(start, columns)[1]
    for name, truth in zip(NAMES, truths, strict=True):
        mean, std = getattr(found, name), getattr(found, STD_OF[name])
        inside = np.abs(truth - mean) < BAND_95 * std
        assert np.mean(inside[600:]) > 0.9, name
        assert np.mean(std[-1]) < (0.97 if name == "soh_capacity" and model is LFP else 0.8) * np.mean(std[0]), name
