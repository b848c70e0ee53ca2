"""Is the claimed sigma the true one? Many runs whose truth is drawn from what the filter itself assumes."""

import math
from typing import NamedTuple

import numpy as np
import pytest

from battery.examples import LFP, NMC, drive, row, samples, simulate
from ohmward.battery.models.noise import BatteryNoise, CurrentSensor
from ohmward.battery.models.thevenin import CircuitInput, next_state, voltage
from ohmward.battery.soc import voltage_faults
from ohmward.battery.soc.sample import SocSample
from ohmward.battery.soc.thevenin_filter import TheveninFilter
from ohmward.filters.belief import Belief, PackedBelief, unpack
from ohmward.filters.consistency import mean_bounds, nees
from ohmward.trace import Kernel

RUNS, STEPS = 200, 300
NOISE = BatteryNoise()
SENSOR = CurrentSensor()


@pytest.mark.parametrize("method", ["ekf", "ukf"])
def test_nees_of_the_whole_state_lies_within_its_bounds(method, monkeypatch):
    """x+ = f(x) + w, y = h(x) + v with the filter's own f, h, Q and R, from starts drawn from its own belief."""
    monkeypatch.setattr(voltage_faults, "JUMP_SHARE", math.inf)  # R as white noise jumps as no voltage does
    settings = TheveninFilter(NMC, NOISE, method=method)
    columns = samples(simulate(NMC, drive(np.random.default_rng(1), STEPS, -0.4), 0.7))
    start = settings.init(row(columns, 0), 0.7)
    truth, voltage_V = draw_runs(settings, start, columns, np.random.default_rng(2))

    def step(state, sample):
        state, _ = settings.step(state, sample)
        return state, state.belief

    _, beliefs = Kernel(step, start, row(columns, 0)).scan_lanes(start, columns._replace(voltage_V=voltage_V))
    lower, upper = mean_bounds(truth.shape[1], RUNS, 0.998)
    for k in (30, 120, STEPS - 1):
        runs = (PackedBelief(beliefs.mean[k, :, lane], beliefs.lower[k, :, lane]) for lane in range(RUNS))
        errors = [nees(unpack(belief), truth[k, :, lane]) for lane, belief in enumerate(runs)]
        assert lower <= np.mean(errors) <= upper


def draw_runs(settings, start, columns, rng):
    """True states (T, n, RUNS) and measured voltages (T, RUNS)."""
    belief, system = unpack(start.belief), settings.system
    n, cov = len(belief.mean), belief.cov
    before_A = np.concatenate([columns.current_A[:1], columns.current_A[:-1]])

    def step(x, sample):
        measured, before, normal = sample
        clean = settings.sanitize(start._replace(current_A=before), measured)
        x = system.next_state(x, clean) + np.sqrt(np.diag(system.process_noise(x, clean))) * normal
        error = system.voltage_error(Belief(x, cov / 1e4), clean)
        return x, (x, system.voltage(x, clean, error)[0], np.sqrt(error.variance * error.weight))

    x = (belief.mean + rng.standard_normal((RUNS, n)) @ np.linalg.cholesky(cov).T).T
    inputs = (columns, before_A, rng.standard_normal((STEPS, n, RUNS)))
    kernel = Kernel(step, belief.mean, (row(columns, 0), 0.0, np.zeros(n)))
    _, (states, clean_V, std_V) = kernel.scan_lanes(x, inputs)
    return states, clean_V + std_V * rng.standard_normal((STEPS, RUNS))


class Errors(NamedTuple):
    """What is wrong in each of many robots, (RUNS,) each."""

    soc: np.ndarray
    offset_A: np.ndarray
    gain: np.ndarray
    resistance: np.ndarray
    axis: np.ndarray
    overpotential: np.ndarray


@pytest.mark.parametrize(("model", "soc"), [(NMC, 0.8), (LFP, 0.8)], ids=["nmc", "lfp"])
@pytest.mark.parametrize("method", ["ekf", "ukf"])
def test_the_band_covers_robots_whose_sensors_and_models_are_wrong(method, model, soc):
    """The physics, with errors drawn as `BatteryNoise` says: of curve and axis along SoC, the others constant.

    95 % must be at least 90.
    """
    rng, steps = np.random.default_rng(3), 3600
    current_A = drive(rng, steps, -0.4)
    errors = Errors(*(std * rng.standard_normal(RUNS) for std in (0.03, 0.05, 0.01, 0.05, 0.01, 0.05)))
    socs, clean_V = simulate_robots(model, current_A, soc + errors.soc, errors, rng)
    measured_A = current_A[:, None] + errors.offset_A + SENSOR.noise_std_A * rng.standard_normal((steps, RUNS))
    shown_V = clean_V + NOISE.voltage_std_V * rng.standard_normal((steps, RUNS))
    settings = TheveninFilter(model, NOISE, method=method, idle_current_A=0.0)
    first = SocSample(0.0, 0.0, np.nan, 25.0)
    start = settings.init(first, soc)
    columns = SocSample(np.r_[0.0, np.ones(steps - 1)], measured_A, shown_V, np.full(steps, 25.0))
    _, estimates = Kernel(settings.step, start, first).scan_lanes(start, columns)
    z = (estimates.soc - socs) / estimates.soc_std
    assert np.mean(np.abs(z) < 1.96) > 0.9
    assert np.mean(np.abs(z[-1]) < 1.96) > 0.85
    assert np.mean(z[-1] ** 2) < 2.0
    assert np.sqrt(np.mean((estimates.soc[-1] - socs[-1]) ** 2)) < 0.03


def simulate_robots(model, current_A, soc, errors, rng):
    """SoC and voltage (T, RUNS) of robots whose circuit deviates from the model's by `errors`."""
    phase, model_V = rng.uniform(0, 2 * np.pi, RUNS), np.sqrt(2) * NOISE.model_std_V[0]
    mean_A = np.concatenate([current_A[:1], 0.5 * (current_A[1:] + current_A[:-1])])
    dt_s = np.r_[0.0, np.ones(len(current_A) - 1)]

    def step(x, sample):
        mean, now, dt, gain, resistance, axis, over, lag = sample
        moved = next_state(x, CircuitInput(mean, 25.0), model, dt)
        x = np.array([x[0] + (1.0 + gain) * (moved[0] - x[0]), *moved[1:]])
        along = x[0] / NOISE.model_soc_length + lag
        u, seen = CircuitInput(now, 25.0), np.array([x[0] + np.sqrt(2) * axis * np.cos(2 * along), *x[1:]])
        rested = np.array([seen[0], *(0.0 * v for v in x[1:-1]), x[-1]])
        open_V = voltage(rested, CircuitInput(0.0 * now, 25.0), model)[0]
        added_V = (voltage(seen, u, model)[0] - open_V) * (1.0 + resistance + over)
        return x, (x[0], open_V + added_V + model_V * np.sin(along))

    n = len(model.state_names)
    x = np.vstack([soc, np.zeros((n - 1, RUNS))])
    inputs = (mean_A, current_A, dt_s, errors.gain, errors.resistance, errors.axis, errors.overpotential, phase)
    steps = len(mean_A)
    lanes = [np.broadcast_to(i[:, None] if len(i) == steps else i[None, :], (steps, RUNS)) for i in inputs]
    _, (socs, voltages) = Kernel(step, x[:, 0], (0.0,) * 8).scan_lanes(x, tuple(lanes))
    return socs, voltages
