"""Study of SoC estimators on simulated shifts of eight hours: conditions, truth, methods, figures.

The conditions are a base case, and variations that break one of its assumptions, a little or a lot. Each run is another
shift: three hours of driving, a quarter of an hour idle, a charge, three hours of driving, a rest, begun between 80 and
100 %. The battery file comes from a pulse test of the same battery in the workshop; each method is made from it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from functools import cache, lru_cache
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.identification.identify import identify
from ohmward.battery.soc.registry import DEFAULT, chosen_name, make_estimator, title_of
from ohmward.battery.soc.sample import INITIAL_SOC_STD, NO_SAMPLE, Estimator, SocSample
from ohmward.filters.consistency import BAND_95
from ohmward.quantities import SECONDS_PER_HOUR
from ohmward.trace import Kernel
from ohmward.trace.structure import side_by_side
from ohmward_lab.assess.draws import generator, signs
from ohmward_lab.assess.recommendation import Improvement, Processor, Situation, as_in_the_base_case
from ohmward_lab.published.rc import rc_of_thevenin
from ohmward_lab.published.rc_three_states import RcThreeState, RcThreeStates
from ohmward_lab.published.registry import GivenStart
from ohmward_lab.published.scheme_by_method import SchemeByMethod, SchemeSoc
from ohmward_lab.simulate import plant
from ohmward_lab.simulate.cells import BATTERIES, SimulatedBattery
from ohmward_lab.simulate.mission import drive
from ohmward_lab.simulate.profile import pulse_profile
from ohmward_lab.simulate.robot_day import record, run_on_bench
from ohmward_lab.simulate.sensors import BatterySensors, Sensor


class TrueBattery(NamedTuple):
    """State of the battery and of its surroundings, where they may differ from its test."""

    temperature_degC: float = 25.0  #: of the air
    #: of the battery, relative to its test
    capacity_ratio: float = 1.0
    resistance_ratio: float = 1.0
    step_s: float = 1.0  #: between the instants of the simulation


class Condition(NamedTuple):
    """One condition. Currents are multiples of 1 C (0.01 is 0.01 C), voltages are of one cell."""

    #: in words
    factor: str
    level: str
    truth: TrueBattery = TrueBattery()  #: of the battery
    start_error: float | None = 0.05  #: of the initial SoC; None where it is unknown
    #: of the current sensor; their signs and that of `start_error` alternate from run to run
    offset_C: float = 0.005
    gain: float = 0.002
    #: standard deviations
    current_noise_C: float = 0.002
    voltage_noise_V: float = 0.001
    voltage_step_V: float = 0.0005  #: of the converter
    interval_s: float = 1.0  #: between samples
    missing: float = 0.0  #: share of the currents and of the voltages that are lost
    delay_s: float = 0.0  #: delay of the voltage relative to the current of the same row

    @property
    def name(self) -> str:
        """Name in tables and files."""
        return f"{self.factor}: {self.level}"


#: The base case: the battery as tested, a start a few points off, and an everyday sensor at 1 Hz.
BASE = Condition("base", "everyday sensors")

CONDITIONS: tuple[Condition, ...] = (
    BASE,
    Condition("laboratory", "right start, no offset", start_error=0.0, offset_C=0.0, gain=0.0),
    *(Condition("start", f"{100 * error:g} points off", start_error=error) for error in (0.1, 0.3)),
    Condition("start", "unknown", start_error=None),
    *(Condition("current offset", f"{100 * share:g} % of C", offset_C=share) for share in (0.02, 0.05)),
    *(Condition("current gain", f"{100 * share:g} %", gain=share) for share in (0.01, 0.03)),
    *(Condition("current noise", f"{100 * share:g} % of C", current_noise_C=share) for share in (0.02, 0.1)),
    *(Condition("voltage noise", f"{1e3 * volt:g} mV a cell", voltage_noise_V=volt) for volt in (0.005, 0.02)),
    *(Condition("voltage converter", f"{1e3 * volt:g} mV a cell", voltage_step_V=volt) for volt in (0.005, 0.02)),
    Condition("interval", "0.1 s", TrueBattery(step_s=0.1), interval_s=0.1),
    *(Condition("interval", f"{seconds:g} s", interval_s=seconds) for seconds in (10.0, 60.0)),
    *(Condition("temperature", f"{degC:g} degC", TrueBattery(degC)) for degC in (40.0, 5.0, -10.0)),
    *(Condition("capacity less", f"{100 * (1 - r):g} %", TrueBattery(capacity_ratio=r)) for r in (0.95, 0.9)),
    Condition("age", "80 %, resistance x 1.5", TrueBattery(capacity_ratio=0.8, resistance_ratio=1.5)),
    *(Condition("lost samples", f"{100 * share:g} %", missing=share) for share in (0.05, 0.3)),
    *(Condition("voltage late", f"{seconds:g} s", delay_s=seconds) for seconds in (1.0, 5.0)),
)

_SENSOR = ("base", "current noise", "voltage noise", "voltage converter", "lost samples")


SITUATIONS = (
    Situation("laboratory", ("laboratory",)),
    Situation(
        "everyday sensors, noisy or coarse",
        _SENSOR,
        (Improvement("sensor and start of the laboratory", ("laboratory",)),),
    ),
    Situation("the start is wrong or not known", ("start",), as_in_the_base_case("a start that is right to 5 points")),
    Situation(
        "current sensor with offset and gain",
        ("current offset", "current gain"),
        as_in_the_base_case("a better current sensor"),
    ),
    Situation(
        "samples seldom or out of step", ("interval", "voltage late"), as_in_the_base_case("samples every second")
    ),
    Situation("cold or hot", ("temperature",), as_in_the_base_case("a battery at 25 degC")),
    Situation(
        "less capacity than told, aged", ("capacity less", "age"), as_in_the_base_case("a file of the aged battery")
    ),
)


CHEMISTRIES = tuple(BATTERIES)
SHIFT_S = 8 * SECONDS_PER_HOUR
#: Range of the state of charge at which a shift begins.
_START_SOC = (0.8, 1.0)
_DRIVING_S, _IDLING_S, _CHARGING_S = 3 * SECONDS_PER_HOUR, 900.0, 4500.0
#: Currents of the idle robot and of the charger, as multiples of 1 C.
_IDLE_C, _RECHARGE_C = 0.06, 0.5
#: Capacity for which the currents of the robot's drives are defined [Ah].
_MISSION_AH = BATTERIES["lfp"].circuit.capacity_Ah
#: Range of the sensors: current as a multiple of 1 C, voltage over the battery's largest.
_RANGE_C, _RANGE_V = 4.0, 1.5


@cache
def identified(chemistry: str) -> Battery:
    """The battery file, from a pulse test in the workshop with a good sensor."""
    simulated = BATTERIES[chemistry]
    capacity_Ah = simulated.circuit.capacity_Ah
    bench = run_on_bench(simulated, pulse_profile(capacity_Ah))
    log = record(simulated, "pulse test", bench, _bench_sensors(simulated), generator("test", chemistry))
    return identify(log, capacity_Ah=capacity_Ah, chemistry=chemistry, n_series=simulated.n_series)


def _bench_sensors(battery: SimulatedBattery) -> BatterySensors:
    capacity_A, cells = battery.circuit.capacity_Ah, battery.n_series
    current = Sensor(-_RANGE_C * capacity_A, _RANGE_C * capacity_A, 2e-4 * capacity_A, 5e-4 * capacity_A)
    voltage = Sensor(0.0, _RANGE_V * battery.voltage_max_V, 5e-4 * cells, 5e-4 * cells)
    return BatterySensors(current, voltage, Sensor(-55.0, 125.0, 0.1, 0.1))


@lru_cache(maxsize=2)
def shifts(chemistry: str, truth: TrueBattery, runs: int, seed: int) -> plant.BatteryTruth:
    """Shifts (T, B) of a battery in this state, one for each run."""
    battery = in_state(BATTERIES[chemistry], truth)
    time_s = _times_s(truth)
    rngs = [generator("shift", chemistry, seed, run) for run in range(runs)]
    demand_A = np.stack([_load_A(rng, BATTERIES[chemistry], time_s) for rng in rngs], axis=1)
    starts = [rng.uniform(*_START_SOC) for rng in rngs]
    states = [plant.resting_state(battery, soc, truth.temperature_degC, hysteresis=1.0) for soc in starts]
    interval_s = np.diff(time_s, prepend=time_s[0])
    demand = plant.Demand(interval_s, demand_A, truth.temperature_degC)
    kernel = Kernel(plant.step, states[0], plant.Demand(0.0, 0.0, 0.0), constants=(battery,))
    _, found = kernel.scan_lanes(side_by_side(states), demand)
    return found


def _times_s(truth: TrueBattery) -> np.ndarray:
    return np.arange(0.0, SHIFT_S, truth.step_s)


def in_state(battery: SimulatedBattery, truth: TrueBattery) -> SimulatedBattery:
    """The battery with another capacity and resistance than when it was tested."""
    return replace(battery, circuit=battery.circuit.worn(truth.capacity_ratio, truth.resistance_ratio))


def _load_A(rng: np.random.Generator, battery: SimulatedBattery, time_s: np.ndarray) -> np.ndarray:
    """Demanded current (T,) [A] of a shift; the charger keeps to the battery's limits."""
    capacity_A = battery.circuit.capacity_Ah
    grid_s = np.arange(0.0, SHIFT_S + 1.0)
    current_A = np.full(grid_s.size, -_IDLE_C * capacity_A)
    charge_s = _DRIVING_S + _IDLING_S
    for begin_s in (0.0, charge_s + _CHARGING_S):
        driven = drive(rng, _DRIVING_S).current_A * capacity_A / _MISSION_AH
        current_A[int(begin_s) : int(begin_s) + driven.size] = driven
    current_A[int(charge_s) : int(charge_s + _CHARGING_S)] = _RECHARGE_C * capacity_A
    return np.interp(time_s, grid_s, current_A)


def measured(chemistry: str, condition: Condition, runs: int, seed: int) -> tuple[SocSample, np.ndarray]:
    """Samples (T, B) as the sensors of this condition give them, and the true state of charge (T, B)."""
    truth, battery = shifts(chemistry, condition.truth, runs, seed), BATTERIES[chemistry]
    rng = generator("sensors", chemistry, condition.name, seed)
    every = round(condition.interval_s / condition.truth.step_s)
    capacity_A, cells = battery.circuit.capacity_Ah, battery.n_series
    time_s = _times_s(condition.truth)[::every]
    current_A, voltage_V, soc, temperature_degC = (values[::every] for values in truth[:4])
    sign = signs(runs)
    late = round(condition.delay_s / condition.interval_s)
    voltage_V = voltage_V[np.maximum(np.arange(len(voltage_V)) - late, 0)]
    noise_A, noise_V = (rng.standard_normal(current_A.shape) for _ in range(2))
    current_A = (1.0 + sign * condition.gain) * current_A + capacity_A * (
        sign * condition.offset_C + condition.current_noise_C * noise_A
    )
    step_V = cells * condition.voltage_step_V
    voltage_V = step_V * np.round((voltage_V + cells * condition.voltage_noise_V * noise_V) / step_V)
    if condition.missing:
        current_A, voltage_V = (
            np.where(rng.random(values.shape) < condition.missing, np.nan, values) for values in (current_A, voltage_V)
        )
    temperature_degC = np.round(temperature_degC, 1)
    return SocSample(np.diff(time_s, prepend=time_s[0]), current_A, voltage_V, temperature_degC), soc


class SocMethod(NamedTuple):
    """A method by its name, in words, and the function that makes its estimator."""

    name: str
    title: str
    make: Callable[[Battery], Estimator]


def _of_registry(name: str) -> SocMethod:
    return SocMethod(name, title_of(name), lambda battery: make_estimator(name, battery))


class _FullStart(RcThreeStates):
    """[P] 3.1: the filter starts at the OCV of a full battery, whatever start is given."""

    def init(self, first: SocSample, soc: float | None = None, soc_std: float = INITIAL_SOC_STD) -> RcThreeState:
        return super().init(first, 1.0, soc_std)


METHODS: tuple[SocMethod, ...] = (
    _of_registry("coulomb"),
    _of_registry("ocv"),
    SocMethod(
        "[P] RC + KF",
        "RC model, Q and R of [P] (25), full at the start",
        lambda battery: _FullStart(rc_of_thevenin(battery.thevenin)),
    ),
    SocMethod(
        "[P] T2RC + UKF",
        "Thevenin model, unscented filter, start taken as given",
        lambda battery: GivenStart(battery.thevenin, battery.noise, battery.sensor),
    ),
    SocMethod("[P] hybrid", title_of("published.hybrid"), lambda battery: make_estimator("published.hybrid", battery)),
    SocMethod(
        "[T] AUKF",
        "RC model, joint adaptive unscented filter, P0, Q0 and R0 of [T] (3.51)",
        lambda battery: SchemeSoc(SchemeByMethod(rc_of_thevenin(battery.thevenin))),
    ),
    *map(_of_registry, ("textbook-ekf", "rc", "ekf", "ukf", "published.aukf")),
    SocMethod(DEFAULT, title_of("gsf"), lambda battery: make_estimator(chosen_name(DEFAULT), battery)),
)

#: 2 KB of code hold about 350 operations in single precision, 16 KB about 2,500; see docs/export.md.
PROCESSORS = (
    Processor("2 KB of flash", 350.0),
    Processor("16 KB of flash", 2500.0),
    Processor("computer", math.inf),
)


#: Errors count from here on [s]; the recovery from a wrong start before it is measured by `found_min`.
SCORED_FROM_S = 3600.0
#: An estimator has recovered from its start when the error stays within this for good.
FOUND = 0.05
#: Standard deviation given with a right start, which the first voltage then moves by no more than the probability that
#: an estimator reserves for a wrong start.
_RIGHT_START_STD = 1e-4
#: Samples of all lanes that are processed at once: some hundred megabytes with all intermediate values.
_BATCH_SAMPLES = 1 << 20


class SocFigures(NamedTuple):
    """Figures of one method under one condition."""

    chemistry: str
    condition: str
    method: str
    #: error of the state of charge after the first hour, over all runs; nan if one estimate is nan
    rmse: float
    largest: float
    covered: float  #: share of these samples with the truth in the 95 % band; nan without a band
    found_min: float  #: minutes until the error stays within 5 points, the median of the runs; inf where it never does
    lost: float  #: share of the runs that end more than 5 points off
    operations: int  #: in a step
    ns: float  #: time per sample with many runs side by side; depends on the machine and is not reproducible

    @property
    def subject(self) -> str:
        """The chemistry."""
        return self.chemistry


def soc_cell(chemistry: str, condition: Condition, method: SocMethod, runs: int, seed: int) -> SocFigures:
    """Run the method along every shift of this condition."""
    samples, truth = measured(chemistry, condition, runs, seed)
    kernel, estimator = _compiled(chemistry, method.name)
    assumed = np.clip(truth[0] + signs(runs) * (condition.start_error or 0.0), 0.0, 1.0)
    start_std = _RIGHT_START_STD if condition.start_error == 0.0 else INITIAL_SOC_STD
    length = len(truth)
    width = max(1, _BATCH_SAMPLES // length)
    soc, std, spent_s = np.empty_like(truth), np.empty_like(truth), 0.0
    for first in range(0, runs, width):
        lanes = slice(first, min(first + width, runs))
        part = SocSample(samples.dt_s, *(values[:, lanes] for values in samples[1:]))
        states = []
        for run in range(lanes.start, lanes.stop):
            beginning = SocSample(0.0, *(float(values[0, run]) for values in samples[1:]))
            start = None if condition.start_error is None else float(assumed[run])
            states.append(estimator.init(beginning, start, start_std))
        began = time.perf_counter()
        _, (soc[:, lanes], std[:, lanes]) = kernel.scan_lanes(side_by_side(states), part)
        spent_s += time.perf_counter() - began
    found = figures(np.cumsum(samples.dt_s), soc - truth, std)
    operations = len(kernel.program.nodes)
    return SocFigures(chemistry, condition.name, method.name, *found, operations, 1e9 * spent_s / truth.size)


@lru_cache(maxsize=len(METHODS))
def _compiled(chemistry: str, name: str) -> tuple[Kernel, Any]:
    """Compiled step that outputs only the SoC and its standard deviation, and the estimator."""
    estimator: Any = next(method for method in METHODS if method.name == name).make(identified(chemistry))

    def step(state: Any, sample: SocSample) -> Any:
        after, found = estimator.step(state, sample)
        return after, (found.soc, found.soc_std)

    return Kernel(step, estimator.init(NO_SAMPLE, 0.5), SocSample(0.0, 0.0, 0.0, 0.0)), estimator


def figures(time_s: np.ndarray, error: np.ndarray, std: np.ndarray) -> tuple[float, float, float, float, float]:
    """rmse, largest, covered, found_min and lost of errors and their standard deviations (T, B)."""
    late = time_s >= SCORED_FROM_S
    size = np.abs(error)
    inside = np.where(np.isfinite(std), size <= BAND_95 * std, np.nan)[late]
    far = ~(size <= FOUND)
    last = np.where(far.any(axis=0), len(far) - 1 - np.argmax(far[::-1], axis=0), -1)
    minutes = np.where(last < 0, 0.0, time_s[np.minimum(last + 1, len(far) - 1)] / 60.0)
    minutes = np.where(far[-1], np.inf, minutes)
    covered = float(np.nanmean(inside)) if np.isfinite(inside).any() else math.nan
    return (
        float(np.sqrt(np.mean(error[late] ** 2))),
        float(size[late].max()),
        covered,
        float(np.median(minutes)),
        float(np.mean(far[-1])),
    )
