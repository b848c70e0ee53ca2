"""Cells, missions and sensors that several tests of the battery share."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from kernels import kernel_of
from ohmward.battery.models.noise import BatteryNoise, CurrentSensor
from ohmward.battery.models.ocv import OcvCurve
from ohmward.battery.models.thevenin import CircuitInput, StateOfHealth, Thevenin, next_state, voltage
from ohmward.battery.soc.sample import INITIAL_SOC_STD, SocSample
from ohmward.logs import Log
from ohmward.trace import Kernel
from ohmward_lab.simulate.voltage import simulate_voltage

GRID = np.linspace(0.0, 1.0, 101)

#: A straight OCV and constant resistances: closed forms hold.
STRAIGHT = Thevenin(
    capacity_Ah=2.0,
    ocv=OcvCurve((3.0, 4.0)),
    r0_discharge_ohm=(0.02, 0.02),
    r0_charge_ohm=(0.02, 0.02),
    r_ohm=((0.01, 0.01), (0.02, 0.02)),
    tau_s=(10.0, 200.0),
)

#: The shape of a nickel-manganese-cobalt cell: the voltage tells SoC everywhere.
NMC = Thevenin(
    capacity_Ah=2.0,
    ocv=OcvCurve(tuple(3.4 + 0.75 * GRID - 0.35 * np.exp(-20 * GRID) + 0.05 * np.sin(5 * GRID))),
    r0_discharge_ohm=(0.06, 0.05, 0.05),
    r0_charge_ohm=(0.055, 0.05, 0.05),
    r_ohm=((0.015, 0.01, 0.01), (0.03, 0.02, 0.02)),
    tau_s=(15.0, 300.0),
    coulombic_efficiency=0.99,
    activation_K=2500.0,
)

#: The shape of a lithium-iron-phosphate cell: a plateau with hysteresis, on which the voltage tells next to nothing.
LFP = replace(
    NMC,
    ocv=OcvCurve(
        tuple(
            3.26
            + 0.02 * GRID
            + 0.035 / (1 + np.exp((0.27 - GRID) / 0.03))
            + 0.04 / (1 + np.exp((0.68 - GRID) / 0.02))
            - 0.5 * np.exp(-30 * GRID)
            + 0.1 * np.exp(-100 * (1 - GRID))
        ),
        tuple(0.012 * np.minimum(1.0, 10 * np.minimum(GRID, 1 - GRID))),
    ),
    hysteresis_rate=40.0,
    coulombic_efficiency=1.0,
)


class Truth(NamedTuple):
    """What a simulation knows: time [s], true current [A], SoC and voltage [V] at each sample, (T,) each."""

    time_s: np.ndarray
    current_A: np.ndarray
    soc: np.ndarray
    voltage_V: np.ndarray


#: Only white voltage noise, current noise and what the circuit itself has: the filter is then a plain textbook one.
PLAIN = BatteryNoise(
    model_std_V=(0.0, 0.0),
    overpotential_share=0.0,
    soc_axis_std=0.0,
    correlation_s=0.0,
    capacity_std=0.0,
    capacity_walk=0.0,
    resistance_std=0.0,
    resistance_walk=0.0,
)


def drive(rng: np.random.Generator, steps: int, mean_A: float = -0.5, rest_every: int = 6) -> np.ndarray:
    """Current (steps,) that is new every 40 samples and at least 0.3 A, with a rest of 200 samples now and then."""
    blocks = mean_A + 1.5 * rng.standard_normal(steps // 40 + 1)
    blocks = np.sign(blocks) * np.maximum(np.abs(blocks), 0.3)
    blocks[np.arange(len(blocks)) // 5 % rest_every == rest_every - 1] = 0.0
    return np.repeat(blocks, 40)[:steps]


def simulate(model: Thevenin, current_A: np.ndarray, soc: float, dt_s: float = 1.0, hysteresis: float = 0.0) -> Truth:
    """The model itself, with a current that is linear between the samples as every estimator assumes."""
    time_s = dt_s * np.arange(len(current_A))
    log = Log("truth", time_s, current_A, np.zeros(len(current_A)))
    return Truth(time_s, current_A, *simulate_voltage(model, log, soc, hysteresis))


def simulate_lives(
    model: Thevenin,
    current_A: np.ndarray,
    capacity: np.ndarray,
    ohmic: np.ndarray,
    pairs: np.ndarray,
    temperature_degC: float = 25.0,
) -> tuple[np.ndarray, np.ndarray]:
    """SoC and voltage (T, B) of cells under one current, 1 s apart, from 80 % after a discharge.

    capacity, ohmic, pairs: (B,) ratios to the model's capacity, ohmic resistance and resistances of the pairs.
    """
    mean_A = np.concatenate([current_A[:1], 0.5 * (current_A[1:] + current_A[:-1])])

    def step(x, sample):
        mean, now, capacity, ohmic, pairs = sample
        x = next_state(x, CircuitInput(mean, temperature_degC), model, 1.0, StateOfHealth(capacity, pairs))
        u = CircuitInput(now, temperature_degC)
        return x, (x[0], voltage(x, u, model, StateOfHealth(resistance_ratio=ohmic))[0])

    T, B = len(current_A), len(pairs)
    lanes = [np.broadcast_to(c[:, None], (T, B)) for c in (mean_A, current_A)]
    lanes += [np.broadcast_to(c, (T, B)) for c in (capacity, ohmic, pairs)]
    x = np.tile(np.array([0.8, *np.zeros(model.pairs), -1.0])[:, None], B)
    return Kernel(step, x[:, 0], (0.0, 0.0, 1.0, 1.0, 1.0)).scan_lanes(x, tuple(lanes))[1]


def samples(truth: Truth, offset_A: float = 0.0, noise: BatteryNoise | None = None, seed: int = 1) -> SocSample:
    """What sensors with this offset, and with white noise where `noise` is given, show of the truth, (T,) each."""
    rng = np.random.default_rng(seed)
    current_std_A, voltage_std_V = (CurrentSensor().noise_std_A, noise.voltage_std_V) if noise else (0.0, 1e-12)
    count = len(truth.time_s)
    return SocSample(
        np.diff(truth.time_s, prepend=truth.time_s[0]),
        truth.current_A + offset_A + current_std_A * rng.standard_normal(count),
        truth.voltage_V + voltage_std_V * rng.standard_normal(count),
        np.full(count, 25.0),
    )


def scan(
    settings: Any,
    columns: SocSample,
    soc: float | None = None,
    soc_std: float = INITIAL_SOC_STD,
    state: Any = None,
    lowering: str | None = None,
) -> tuple[Any, Any]:
    """Last state, and estimates (T,), of an estimator over columns (T,), from `state` or from its start at this SoC."""
    first = row(columns, 0)
    start = settings.init(first, soc, soc_std) if state is None else state
    return kernel_of(settings, start, first, lowering=lowering).scan(start, columns)


def row(columns: SocSample, k: int) -> SocSample:
    """The sample k of columns (T,)."""
    return SocSample(*(float(c[k]) for c in columns))
