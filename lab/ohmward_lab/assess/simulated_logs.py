"""Logs drawn from the noise model itself: their noise is known, as is their true state of charge."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.models.thevenin import CircuitInput
from ohmward.battery.soc.clean_sample import sanitize
from ohmward.battery.soc.sample import SocSample
from ohmward.battery.tuning.noise_model import NoiseModel
from ohmward.filters.belief import Belief, unpack
from ohmward.logs.log import Log
from ohmward.trace import Kernel, exp, maximum, sqrt


class SimulatedState(NamedTuple):
    """True state (n + 1,) as the belief of `TuningState`, and the last current and temperature."""

    x: np.ndarray
    current_A: Any
    temperature_degC: Any


class Draws(NamedTuple):
    """Standard normal draws of a sample: (n + 1,) of the states, and of the voltage."""

    states: np.ndarray
    voltage: Any


def simulated_log(
    model: NoiseModel, name: str, samples: SocSample, soc: float, rng: np.random.Generator
) -> tuple[Log, np.ndarray]:
    """A log along these currents and temperatures (T,), and its true state of charge (T,).

    samples: whose voltages are not looked at.  soc: true one at the start.
    """
    system, steps = model.system, len(samples.current_A)
    first = SocSample(0.0, float(samples.current_A[0]), np.nan, float(np.ravel(samples.temperature_degC)[0]))
    start = model.filter.start(first, soc, 0.0)
    belief = unpack(start.belief)
    size = len(belief.mean) + 1
    x = np.append(belief.mean + np.sqrt(np.diag(belief.cov)) * rng.standard_normal(size - 1), rng.standard_normal())
    x[system.hysteresis_index] = np.clip(x[system.hysteresis_index], -1.0, 1.0)
    x[0] = soc
    state = SimulatedState(x, start.current_A, start.temperature_degC)
    kernel = Kernel(lambda now, given: _step(model, now, *given), state, (first, Draws(np.zeros(size), 0.0)))
    draws = Draws(rng.standard_normal((steps, size)), rng.standard_normal(steps))
    _, (voltage_V, truth) = kernel.scan(state, (samples, draws))
    time_s = np.cumsum(samples.dt_s)
    temperature_degC = np.broadcast_to(samples.temperature_degC, time_s.shape)
    return Log(name, time_s, samples.current_A, voltage_V, temperature_degC), truth


def _step(model: NoiseModel, state: SimulatedState, sample: SocSample, draws: Draws) -> tuple[SimulatedState, Any]:
    system, noise = model.system, model.battery.noise
    clean = sanitize(sample, CircuitInput(state.current_A, state.temperature_degC), model.filter.limits, 0.0)
    n = len(state.x) - 1
    decay = exp(-clean.dt_s / noise.correlation_s)
    Q = system.process_noise(state.x[:n], clean)
    moved = np.array([*system.next_state(state.x[:n], clean), decay * state.x[n]])
    spread = [*(sqrt(maximum(Q[i, i], 0.0)) for i in range(n)), sqrt(1.0 - decay * decay)]
    x = moved + np.array([std * w for std, w in zip(spread, draws.states, strict=True)])
    error = system.voltage_error(Belief(x[:n], np.zeros((n, n))), clean)
    voltage_V = system.voltage(x[:n], clean, error)[0] + sqrt(error.uncertain_V2) * x[n]
    after = SimulatedState(x, clean.now.current_A, clean.now.temperature_degC)
    return after, (voltage_V + noise.voltage_std_V * draws.voltage, x[0])
