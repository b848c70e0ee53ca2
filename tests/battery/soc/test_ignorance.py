"""Doubts that no test removed: the band opens where the battery leaves the test's conditions, and holds the truth."""

from dataclasses import replace

import numpy as np
import pytest

from battery.examples import GRID, LFP, NMC, drive, samples, scan, simulate, simulate_lives
from ohmward.battery.models.noise import BatteryNoise
from ohmward.battery.models.ocv import OcvCurve, slip_shape
from ohmward.battery.models.temperature import coldness_per_K
from ohmward.battery.models.thevenin import CircuitInput, voltage
from ohmward.battery.soc.initial_soc import VoltageStart
from ohmward.battery.soc.sample import SocSample
from ohmward.battery.soc.thevenin_filter import TheveninFilter
from ohmward.filters.belief import unpack
from ohmward.trace import Kernel

LIVES, STEPS, COLD_DEGC = 60, 3600, -10.0
TESTED = BatteryNoise(resistance_std=0.1, activation_std_K=0.0)
DOUBTED = replace(TESTED, activation_std_K=1500.0)


def cold_lives(rng, temperature_degC=COLD_DEGC):
    """Current (T,), SoC and voltage (T, LIVES) of cells whose activations differ from the file's by 1500 K each."""
    current_A = drive(rng, STEPS, -0.3)
    errors = 0.1 * rng.standard_normal((2, LIVES)) + 1500.0 * coldness_per_K(
        temperature_degC, NMC.reference_degC
    ) * rng.standard_normal((2, LIVES))
    ohmic, pairs = np.exp(errors)
    return current_A, *simulate_lives(NMC, current_A, np.ones(LIVES), ohmic, pairs, temperature_degC)


AGED = replace(TESTED, resistance_std=0.3, capacity_std=0.1, ageing_correlation=0.95)


def aged_lives(rng):
    """Current (T,), SoC and voltage (T, LIVES) of cells that have aged as the noise says, and their capacity (LIVES,).

    The capacity and the two resistances are drawn from the density that the filter begins with.
    """
    current_A = drive(rng, STEPS, -0.5)
    system = TheveninFilter(NMC, AGED).system
    names = [system.state_names.index(n) for n in ("charge_gain", "ohmic_log_ratio", "pair_log_ratio")]
    cov = system.start(0.8, 0.0, CircuitInput(0.0, 25.0)).cov[np.ix_(names, names)]
    loss, ohmic, pairs = rng.multivariate_normal(np.zeros(3), cov, LIVES).T
    capacity = 1.0 / (1.0 + loss)
    return (current_A, *simulate_lives(NMC, current_A, capacity, np.exp(ohmic), np.exp(pairs))), capacity


def test_resistance_tells_what_ageing_has_taken():
    lives, capacity = aged_lives(np.random.default_rng(3))
    tied, free = (estimates_of(n, "ekf", lives, 25.0) for n in (AGED, replace(AGED, ageing_correlation=0.0)))
    error, free_error = (np.sqrt(np.mean((e.soh_capacity[-1] - capacity) ** 2)) for e in (tied, free))
    assert error < 0.6 * free_error
    z = (tied.soh_capacity[-1] - capacity) / tied.soh_capacity_std[-1]
    assert 0.7 < np.sqrt(np.mean(z**2)) < 1.2
    assert np.mean(np.abs(tied.soc - lives[1]) < 1.96 * tied.soc_std) > 0.95
    assert np.mean((tied.soc - lives[1]) ** 2) < np.mean((free.soc - lives[1]) ** 2)


def estimates_of(noise, method, lives, temperature_degC=COLD_DEGC):
    current_A, _, voltage_V = lives
    settings = TheveninFilter(NMC, noise, method=method)
    first = SocSample(0.0, 0.0, np.nan, temperature_degC)
    start = settings.init(first, 0.8)
    rng = np.random.default_rng(7)
    columns = SocSample(
        np.r_[0.0, np.ones(STEPS - 1)],
        current_A[:, None] + 0.05 * rng.standard_normal(voltage_V.shape),
        voltage_V + noise.voltage_std_V * rng.standard_normal(voltage_V.shape),
        np.full(STEPS, temperature_degC),
    )
    return Kernel(settings.step, start, first, lowering="machine").scan_lanes(start, columns)[1]


@pytest.mark.parametrize("method", ["ekf", "ukf"])
def test_cold_lives_are_covered_where_the_activation_is_in_doubt(method):
    lives = cold_lives(np.random.default_rng(1))
    sure, doubting = (estimates_of(noise, method, lives) for noise in (TESTED, DOUBTED))
    z = (doubting.soc - lives[1])[1800:] / doubting.soc_std[1800:]
    assert np.mean(np.abs(z) < 1.96) > 0.95
    assert np.mean(np.abs(z) > 4.0) < 1e-3
    assert np.mean((sure.soc - lives[1]) ** 2) > np.mean((doubting.soc - lives[1]) ** 2)


def test_the_doubt_opens_in_the_cold_and_closes_on_the_way_back():
    system = TheveninFilter(NMC, DOUBTED).system
    warm, cold = (float(system.overpotential_share(0.6, CircuitInput(-0.5, degC))) for degC in (25.0, -15.0))
    assert warm == pytest.approx(TESTED.overpotential_share)
    assert 4 * warm < cold


def test_the_doubt_of_the_pairs_near_empty_opens_there_in_the_cold_only():
    noise = replace(TESTED, empty_activation_std_K=8000.0)
    share = TheveninFilter(NMC, noise).system.overpotential_share
    for soc, degC in ((0.05, 25.0), (0.05, 40.0), (0.4, -15.0)):
        assert float(share(soc, CircuitInput(-0.5, degC))) == pytest.approx(noise.overpotential_share)
    cold = 8000.0 * (1 / 258.15 - 1 / 298.15) * (1 - 0.05 / 0.35)
    expected = np.hypot(noise.overpotential_share, cold)
    assert float(share(0.05, CircuitInput(-0.5, -15.0))) == pytest.approx(expected, rel=1e-9)


def test_the_level_of_the_curve_stays_ten_times_as_long_and_takes_half_of_the_temperature():
    noise = replace(TESTED, level_std_V=0.008, ocv_std_V_per_K=2e-4, soc_axis_std=0.0)
    cold = SocSample(36.0, -NMC.capacity_Ah, 3.7, NMC.ocv.reference_degC - 20.0)
    errors = {}
    for level_V in (0.008, 0.0):
        settings = TheveninFilter(NMC, replace(noise, level_std_V=level_V))
        state = settings.start(cold, 0.8, 0.03)
        clean = settings.sanitize(state, cold)
        errors[level_V] = settings.voltage_error(unpack(state.belief), clean)
        decays = settings.system.error_decays(clean.mean.current_A, clean)
        assert decays == pytest.approx((np.exp(-0.01 / noise.model_soc_length), np.exp(-0.01)))
    assert float(errors[0.008].level_std_V) == pytest.approx(np.hypot(0.008, 0.004 / np.sqrt(2.0)))
    variances = {level_V: float(error.model_std_V) ** 2 for level_V, error in errors.items()}
    assert variances[0.0] - variances[0.008] == pytest.approx(0.004**2 / 2.0)


@pytest.mark.parametrize("soc", [0.03, 0.8])
def test_an_error_of_the_soc_axis_is_a_shift_of_the_curve(soc):
    """The same shift where the curve is steep and where it is flat, and no noise of single samples."""
    settings, exact = (TheveninFilter(NMC, replace(TESTED, level_std_V=0.008, soc_axis_std=std)) for std in (0.02, 0.0))
    sample = SocSample(36.0, 0.0, 3.7, NMC.ocv.reference_degC)
    state = settings.start(sample, soc, 0.03)
    belief, clean = unpack(state.belief), settings.sanitize(state, sample)
    error, one = settings.voltage_error(belief, clean), np.eye(len(belief.mean))
    by_axis = belief.mean + one[settings.state_names.index("axis_error")]
    by_soc = belief.mean + 0.02 * one[0]
    expected_V = float(settings.system.voltage(by_soc, clean, error)[0])
    assert float(settings.system.voltage(by_axis, clean, error)[0]) == pytest.approx(expected_V, rel=1e-12)
    assert float(error.variance) == pytest.approx(float(exact.voltage_error(belief, clean).variance), rel=1e-12)


@pytest.mark.parametrize("degC", [25.0, -10.0])
def test_the_first_voltage_is_shared_between_the_errors_of_the_curve(degC):
    """Their sum has the moments that the voltage gave it, and the same voltage once more is no news."""
    noise = replace(TESTED, level_std_V=0.008, ocv_std_V_per_K=2e-4, voltage_gain_std=0.005)
    settings = TheveninFilter(NMC, noise)
    first = SocSample(0.0, 0.0, 3.7, degC)
    (part,) = settings.voltage_start.hypotheses(first, None)
    belief = unpack(settings.start_from(first, part).belief)
    shares = settings.system.error_shares(part.start.soc, CircuitInput(0.0, degC))
    assert sum(share**2 for share in shares.values()) == pytest.approx(1.0)
    total = np.zeros(len(belief.mean))
    total[[settings.state_names.index(name) for name in shares]] = list(shares.values())
    assert total @ belief.mean == pytest.approx(part.start.model_error)
    assert total @ belief.cov @ total == pytest.approx(part.start.model_error_std**2)
    assert (belief.cov @ total)[0] == pytest.approx(part.start.covariance)
    assert np.linalg.eigvalsh(belief.cov).min() > -1e-9


OTHER_SENSOR = replace(TESTED, voltage_gain_std=0.005)


def other_sensors(rng):
    """Current (T,), SoC and voltage (T, LIVES) of the file's cell, measured by sensors of another gain each."""
    current_A = drive(rng, STEPS, -0.3)
    cell = simulate(NMC, current_A, 0.8)
    gain = 1.0 + OTHER_SENSOR.voltage_gain_std * rng.standard_normal(LIVES)
    return current_A, np.repeat(cell.soc[:, None], LIVES, axis=1), cell.voltage_V[:, None] * gain


@pytest.mark.parametrize("method", ["ekf", "ukf"])
def test_the_gain_of_another_voltage_sensor_is_covered(method):
    lives = other_sensors(np.random.default_rng(2))
    same, other = (estimates_of(noise, method, lives, 25.0) for noise in (TESTED, OTHER_SENSOR))
    covered = [np.mean((np.abs(e.soc - lives[1]) < 1.96 * e.soc_std)[1800:]) for e in (same, other)]
    assert covered[0] < 0.8 and covered[1] > 0.93
    assert np.mean((other.soc - lives[1]) ** 2) < np.mean((same.soc - lives[1]) ** 2)


def test_the_gain_of_the_voltage_is_an_error_that_stays_in_proportion_to_the_voltage():
    settings = TheveninFilter(NMC, OTHER_SENSOR)
    system, first = settings.system, SocSample(36.0, 0.0, 3.7, NMC.ocv.reference_degC)
    k = system.state_names.index("voltage_gain_error")
    state = settings.start(first, 0.8, 0.03)
    belief, clean = unpack(state.belief), settings.sanitize(state, first)
    error = settings.voltage_error(belief, clean)
    one_std = belief.mean + np.eye(len(belief.mean))[k]
    more_V = system.voltage(one_std, clean, error) - system.voltage(belief.mean, clean, error)
    assert float(more_V[0]) == pytest.approx(0.005 * float(NMC.ocv.mean_V(0.8, NMC.ocv.reference_degC)))
    assert float(system.next_state(one_std, clean)[k]) == 1.0
    assert float(system.process_noise(belief.mean, clean)[k, k]) == 0.0


def test_states_without_a_doubt_are_not_there():
    assert TheveninFilter(NMC, TESTED).state_names[-1] == "model_error"
    assert TheveninFilter(NMC, OTHER_SENSOR).state_names[-1] == "voltage_gain_error"
    assert "hysteresis_log_ratio" not in TheveninFilter(NMC, replace(TESTED, hysteresis_std=0.5)).state_names
    assert TheveninFilter(LFP, replace(TESTED, hysteresis_std=0.5)).state_names[-1] == "hysteresis_log_ratio"


def test_the_size_of_the_hysteresis_is_learnt_from_both_directions():
    """A cell with twice the hysteresis of the file, charged and discharged over its plateaus."""
    curve = LFP.ocv
    wide = replace(LFP, ocv=replace(curve, hysteresis_V=tuple(2 * h for h in curve.hysteresis_V)))
    truth = simulate(wide, np.tile(np.repeat([-0.8, 0.8], 3600), 3), 0.9)
    columns = samples(truth, 0.0, TESTED)
    doubting = TheveninFilter(LFP, replace(TESTED, hysteresis_std=0.6), idle_current_A=0.0)
    state = doubting.init(SocSample(0.0, 0.0, np.nan, 25.0), 0.9)
    last, estimates = scan(doubting, columns, state=state)
    ratio = np.exp(last.belief.mean[doubting.state_names.index("hysteresis_log_ratio")])
    assert 1.4 < ratio < 2.6
    assert np.mean(np.abs(estimates.soc - truth.soc) < 1.96 * estimates.soc_std) > 0.95


def test_the_voltage_lies_in_its_band():
    """The standardised residual of the voltage has about unit spread, whatever the sampling rate."""
    rng = np.random.default_rng(4)
    settings = TheveninFilter(NMC, BatteryNoise())
    spread = []
    for seed in range(12):
        error_V = 0.008 * np.sin(20 * np.linspace(0, 1, STEPS) + rng.uniform(0, 6.3)) * np.sqrt(2)
        columns = samples(simulate(NMC, drive(rng, STEPS), 0.7), 0.0, BatteryNoise(), seed)
        columns = columns._replace(voltage_V=columns.voltage_V + error_V)
        state = settings.init(SocSample(0.0, 0.0, np.nan, 25.0), 0.7)
        _, estimates = scan(settings, columns, state=state)
        spread.append(np.mean((estimates.innovation_V[600:] / estimates.voltage_std_V[600:]) ** 2))
    assert 0.3 < np.sqrt(np.mean(spread)) < 1.3
    assert np.all(estimates.voltage_std_V < 0.1)


def test_the_first_voltage_says_less_where_the_resistance_is_in_doubt():
    u = CircuitInput(-2.0, COLD_DEGC)
    settings = TheveninFilter(NMC)
    expected_V = float(voltage(np.array([0.5, 0.0, 0.0, 0.0]), u, NMC)[0])
    first = SocSample(0.0, u.current_A, expected_V, COLD_DEGC)
    starts = (VoltageStart(NMC, noise, settings.sensor) for noise in (TESTED, DOUBTED))
    (sure,), (doubting,) = (start.hypotheses(first) for start in starts)
    assert doubting.start.std > 1.5 * sure.start.std


def test_five_cycles_show_capacity_and_resistance_of_an_aged_battery():
    """80 % of the capacity and 1.5 times the resistance, charged and discharged over nearly all of it, with rests."""
    worn = NMC.worn(0.8, 1.5)
    cycle = np.concatenate([np.full(6400, -0.8), np.zeros(600), np.full(6400, 0.8), np.zeros(600)])
    truth = simulate(worn, np.tile(cycle, 5), 0.95)
    noise = BatteryNoise(capacity_std=0.1, resistance_std=0.3)
    columns = samples(truth, 0.0, noise)
    settings = TheveninFilter(NMC, noise)
    state = settings.init(SocSample(0.0, 0.0, np.nan, 25.0), 0.95)
    _, estimates = scan(settings, columns, state=state)
    assert estimates.soh_capacity[-1] == pytest.approx(0.8, abs=2.0 * estimates.soh_capacity_std[-1])
    assert estimates.soh_capacity_std[-1] < 0.025
    assert estimates.resistance_ratio[-1] == pytest.approx(1.5, rel=0.1)
    error = estimates.soc - truth.soc
    assert np.sqrt(np.mean(error[-cycle.size :] ** 2)) < 0.015
    assert np.mean(np.abs(error) < 1.96 * estimates.soc_std) > 0.9


def test_capacity_is_found_where_the_electrodes_have_slipped():
    """80 % of the capacity, and a curve that has slipped by as much as the file's `ocv_slip` says."""
    file = replace(NMC, ocv_slip=0.45)
    grid = np.linspace(0.0, 1.0, 201)
    slipped_V = NMC.ocv.mean_V(grid + 0.45 * 0.25 * np.asarray(slip_shape(grid, 0.45)), 25.0)
    aged = replace(NMC, capacity_Ah=1.6, ocv=OcvCurve(tuple(slipped_V.tolist())))
    cycle = np.concatenate([np.full(6400, -0.8), np.zeros(600), np.full(6400, 0.8), np.zeros(600)])
    truth = simulate(aged, np.tile(cycle, 5), 0.95)
    noise = BatteryNoise(capacity_std=0.12, ocv_slip_std=0.35)
    found = {}
    for model in (file, NMC):
        settings = TheveninFilter(model, noise)
        state = settings.init(SocSample(0.0, 0.0, np.nan, 25.0), 0.95)
        found[model.ocv_slip] = scan(settings, samples(truth, 0.0, noise), state=state)[1]
    last = slice(-cycle.size, None)
    assert found[0.45].soh_capacity[-1] == pytest.approx(0.8, rel=0.03)
    errors = {slip: found[slip].soc[last] - truth.soc[last] for slip in found}
    assert np.sqrt(np.mean(errors[0.45] ** 2)) < 0.01 < np.sqrt(np.mean(errors[0.0] ** 2))
    assert np.mean(np.abs(errors[0.45]) < 1.96 * found[0.45].soc_std[last]) > 0.9


def test_an_unknown_state_is_found_where_the_curve_bends():
    """Full at rest, SoC declared unknown 14 points below: the bend of the curve does not shut the voltage out."""
    slope_V = np.interp(GRID, [0.0, 0.84, 0.88, 0.92, 0.96, 1.0], [0.7, 0.7, 0.05, 0.05, 0.9, 0.9])
    bent = OcvCurve(tuple((3.6 + np.cumsum(slope_V) / GRID.size).tolist()))
    model = replace(NMC, ocv=bent)
    truth = simulate(model, np.zeros(3600), 1.0)
    settings = TheveninFilter(model, BatteryNoise())
    state = settings.start(SocSample(0.0, 0.0, np.nan, 25.0), 0.86, 0.5)
    assert scan(settings, samples(truth), state=state)[1].soc[-1] > 0.97
