"""Voltage of a Thevenin model under the current of a log: no filter, no feedback from the voltage."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.models.temperature import ROOM_DEGC
from ohmward.battery.models.thevenin import CircuitInput, Thevenin, next_state, voltage
from ohmward.battery.soc.clean_sample import SampleLimits, sanitize
from ohmward.battery.soc.estimator import samples_of
from ohmward.battery.soc.sample import SocSample
from ohmward.checks import require_between
from ohmward.logs.log import Log
from ohmward.trace import Kernel

#: Longest interval [s] that is simulated: any, because nothing here could correct the charge after a gap.
NO_GAP_S = 1e9


class Simulated(NamedTuple):
    """Output of the model, (T,) each: state of charge and terminal voltage [V]."""

    soc: np.ndarray
    voltage_V: np.ndarray


class SimulationState(NamedTuple):
    """State of the circuit (n + 2,), and the last current [A] and temperature [degC]."""

    circuit: np.ndarray
    current_A: Any
    temperature_degC: Any


def simulate_voltage(model: Thevenin, log: Log, initial_soc: float, hysteresis: float = 0.0) -> Simulated:
    """Voltage that the model expects for the current of a log, from rest at `initial_soc`.

    Between two samples the current is linear: its mean moves charge and RC pairs, the sample itself the ohmic drop. A
    missing current or temperature is replaced by the last one.

    Raises:
        InputError: initial_soc or hysteresis outside its range.
    """
    require_between("initial_soc", initial_soc, 0.0, 1.0)
    require_between("hysteresis", hysteresis, -1.0, 1.0)

    def step(state: SimulationState, sample: SocSample) -> tuple[SimulationState, Simulated]:
        clean = sanitize(sample, CircuitInput(state.current_A, state.temperature_degC), SampleLimits(NO_GAP_S))
        circuit = next_state(state.circuit, clean.mean, model, clean.dt_s)
        after = SimulationState(circuit, clean.now.current_A, clean.now.temperature_degC)
        return after, Simulated(circuit[0], voltage(circuit, clean.now, model)[0])

    samples = samples_of(log)
    first = _finite_or(samples.current_A[0], 0.0), _finite_or(samples.temperature_degC[0], ROOM_DEGC)
    start = np.array([initial_soc, *(0.0 for _ in range(model.pairs)), hysteresis])
    kernel = Kernel(step, SimulationState(start, 0.0, 0.0), SocSample(0.0, 0.0, 0.0, 0.0))
    return kernel.scan(SimulationState(start, *first), samples)[1]


def _finite_or(value: float, otherwise: float) -> float:
    return float(value) if math.isfinite(value) else otherwise
