"""The likelihood against FilterPy, noise that was drawn found again, and what is refused."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from battery.examples import NMC, PLAIN, STRAIGHT, drive
from ohmward.battery.battery import Battery
from ohmward.battery.models.noise import BatteryNoise
from ohmward.battery.models.sensor import CurrentSensor
from ohmward.battery.soc.estimator import samples_of
from ohmward.battery.soc.sample import SocSample
from ohmward.battery.tuning.noise_model import NoiseModel, with_factors
from ohmward.battery.tuning.search import Likelihood
from ohmward.battery.tuning.tune import tune_noise, voltage_step_V
from ohmward.errors import InputError
from ohmward.filters.belief import Belief, unpack
from ohmward.trace import linearize
from ohmward_lab.assess.simulated_logs import simulated_log

HOURS = 3600
SENSOR = CurrentSensor(noise_std_A=0.0, offset_std_A=0.01, offset_walk_A=0.0, gain_std=0.0)
KNOWN = BatteryNoise(voltage_std_V=0.003, model_std_V=(0.01, 0.01), soc_axis_std=0.01, capacity_std=0.01)


def battery(model=NMC, noise=KNOWN):
    return Battery("cell", 2.0, thevenin=model, noise=noise, sensor=SENSOR)


def driven(seed, steps=3 * HOURS, mean_A=-0.3):
    current_A = drive(np.random.default_rng(seed), steps, mean_A)
    return SocSample(np.r_[0.0, np.ones(steps - 1)], current_A, np.full(steps, 3.7), np.full(steps, 25.0))


@pytest.fixture(scope="module")
def days():
    """Four drawn drives."""
    rng = np.random.default_rng(4)
    return [simulated_log(NoiseModel(battery()), f"day {k}", driven(k), 0.95, rng)[0] for k in range(4)]


def test_of_a_linear_battery_it_is_that_of_a_kalman_filter():
    noise = replace(PLAIN, voltage_std_V=0.004, soc_axis_std=0.02, correlation_s=60.0)
    model = NoiseModel(battery(STRAIGHT, noise))
    log, _ = simulated_log(model, "linear", driven(1, 200), 0.6, np.random.default_rng(1))
    log_factors = np.log([1.5, 0.7, 2.0])
    found = Likelihood(model, [log], {"linear": 0.6}).scored(log, log_factors[None]).log_density[:, 0]
    np.testing.assert_allclose(found, by_filterpy(model, log, log_factors), rtol=1e-7, atol=1e-9)


def by_filterpy(model, log, log_factors):
    """ln of the density of each voltage, but for a constant: matrices by differentiation, algebra by FilterPy."""
    noisier, wronger, longer = np.exp(log_factors)
    samples = samples_of(log)
    rows = [SocSample(*(float(column[k]) for column in samples)) for k in range(len(log))]
    state, system = model.init(rows[0], log_factors, 0.6), model.system
    belief = unpack(state.belief)
    n = len(belief.mean) - 1
    other = KalmanFilter(n + 1, 1)
    other.x, other.P = belief.mean.reshape(-1, 1), belief.cov
    decay = np.exp(-1.0 / (longer * model.battery.noise.correlation_s))
    densities, before = [], model.filter.init(rows[0], 0.6)
    for row in rows:
        clean = model.filter.sanitize(before, row)
        before = before._replace(current_A=row.current_A)
        a = decay ** float(clean.dt_s)
        other.Q = np.diag([*np.diag(np.asarray(system.process_noise(other.x[:n, 0], clean), dtype=float)), 1 - a * a])
        moved, F = linearize(partial(next_state, system, clean, a), other.x[:, 0])
        other.P = F @ other.P @ F.T + other.Q
        other.x = np.asarray(moved, dtype=float).reshape(-1, 1)
        held_V = wronger * model.battery.noise.soc_axis_std  # the curve rises by 1 V
        error = system.voltage_error(Belief(other.x[:n, 0], other.P[:n, :n]), clean)
        assert float(error.uncertain_V2) == pytest.approx((held_V / wronger) ** 2)
        scaled = error._replace(model_std_V=wronger * error.model_std_V)
        expected, H = linearize(partial(voltage, system, clean, scaled, held_V), other.x[:, 0])
        H = np.asarray(H, dtype=float)
        other.R = np.array([[(noisier * 0.004) ** 2]])
        residual = row.voltage_V - float(expected[0])
        other.update(np.array([[residual + (H @ other.x).item()]]), H=H)
        densities.append(other.log_likelihood + 0.5 * np.log(2 * np.pi))
    return np.array(densities)


def next_state(system, clean, decay, x):
    return np.array([*system.next_state(x[:-1], clean), decay * x[-1]])


def voltage(system, clean, error, held_V, x):
    return system.voltage(x[:-1], clean, error) + held_V * x[-1]


@pytest.mark.parametrize("wrong", [10.0, 0.1])
def test_noise_that_was_drawn_is_found_again(days, wrong):
    file = battery(noise=with_factors(KNOWN, np.array([wrong, wrong, 1.0])))
    tuning = tune_noise(file, days)
    voltage, model, _ = tuning.factors
    assert wrong * voltage.factor == pytest.approx(1.0, abs=0.05) and not voltage.refused
    assert 1 / 1.5 < wrong * model.factor < 1.5 and not model.refused
    assert tuning.explains and tuning.over_last < 0.7 and tuning.excess == pytest.approx(1.0, abs=0.05)
    assert abs(tuning.excess_before - 1.0) > 0.5 and tuning.gain > 1000.0
    assert tuning.battery.noise.voltage_std_V == pytest.approx(0.003, rel=0.05)
    assert tuning.battery.noise.ocv_std_V_per_K == file.noise.ocv_std_V_per_K


def test_beyond_the_charges_of_the_logs_the_error_of_the_model_does_not_shrink(days):
    file = battery(noise=with_factors(KNOWN, np.array([1.0, 10.0, 1.0])))
    noise = tune_noise(file, days).battery.noise
    assert noise.model_std_V[0] == pytest.approx(0.1)
    assert noise.model_std_V[-2] < 0.02


def test_the_same_logs_give_the_same_noise_and_short_ones_none(days):
    one, same = (tune_noise(battery(), days[:1]) for _ in range(2))
    assert [f.factor for f in one.factors] == [f.factor for f in same.factors]
    assert all("six hours are needed" in f.refused for f in one.factors)
    assert one.battery.noise.voltage_std_V == KNOWN.voltage_std_V


def test_steps_of_the_converter_hide_smaller_noise(days):
    coarse = [replace(log, voltage_V=np.round(log.voltage_V / 0.02) * 0.02) for log in days]
    assert voltage_step_V(coarse[0].voltage_V) == pytest.approx(0.02) and voltage_step_V(days[0].voltage_V) == 0.0
    voltage = tune_noise(battery(), coarse[:2]).factors[0]
    assert voltage.factor * 0.003 >= 0.02 / np.sqrt(12) or "steps of 20 mV" in voltage.refused


def test_a_rest_tells_nothing_of_the_errors_that_come_with_current():
    still = driven(1)._replace(current_A=np.zeros(3 * HOURS))
    rng = np.random.default_rng(1)
    logs = [simulated_log(NoiseModel(battery()), f"rest {k}", still, 0.6, rng)[0] for k in range(2)]
    tuning = tune_noise(battery(), logs)
    _, model, correlation = tuning.factors
    assert "the charge moves by 0.0 % only" in model.refused and correlation.refused
    assert tuning.battery.noise.correlation_s == KNOWN.correlation_s


def test_too_few_voltages_are_refused(days):
    with pytest.raises(
        InputError, match=r"only 500 samples of the logs have a current and a voltage .* 1000 are needed"
    ):
        tune_noise(battery(), [days[0].select(slice(0, 500))])


def test_another_battery_is_not_explained_by_noise(days):
    other = [replace(log, current_A=-log.current_A) for log in days]
    tuning = tune_noise(battery(), other)
    assert not tuning.explains and tuning.over_last > 1.1
