"""Shifts of eight hours of simulated batteries, many side by side: the truth that the methods are judged by.

Each run is another shift: three hours of driving, a quarter of an hour idle, a charge, three hours of driving, a rest,
begun between 80 and 100 %. The battery file comes from a pulse test of the same battery, in the workshop.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache, lru_cache
from typing import NamedTuple

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.identification.identify import identify
from ohmward.battery.soc.sample import SocSample
from ohmward.trace import Kernel
from ohmward.trace.structure import side_by_side
from ohmward_lab.assess.battery.conditions import Condition, Truth
from ohmward_lab.assess.draws import generator, signs
from ohmward_lab.simulate import plant
from ohmward_lab.simulate.cells import BATTERIES, SimulatedBattery
from ohmward_lab.simulate.mission import MissionRobot, drive
from ohmward_lab.simulate.profile import bench_times, pulse_test
from ohmward_lab.simulate.robot_day import record
from ohmward_lab.simulate.sensors import BatterySensors, Sensor

CHEMISTRIES = tuple(BATTERIES)
DURATION_S = 8 * 3600.0
#: State of charge at which a shift begins.
_START_SOC = (0.8, 1.0)
_DRIVE_S, _IDLE_S, _CHARGE_S = 3 * 3600.0, 900.0, 4500.0
#: Idle draw, and the charger, over the capacity in an hour.
_IDLE_C, _CHARGE_C = 0.06, 0.5
#: Capacity for which the robot's drives are written [Ah].
_MISSION_AH = BATTERIES["lfp"].circuit.capacity_Ah
#: Range of the sensors over what the battery has.
_RANGE_C, _RANGE_V = 4.0, 1.5


class Shifts(NamedTuple):
    """The truth of many shifts."""

    time_s: np.ndarray  #: (T,)
    #: (T, B)
    current_A: np.ndarray
    voltage_V: np.ndarray
    temperature_degC: np.ndarray
    soc: np.ndarray


@cache
def identified(chemistry: str) -> Battery:
    """The battery file, from a pulse test in the workshop by a good sensor."""
    simulated = BATTERIES[chemistry]
    profile = pulse_test(simulated)
    start = plant.resting_state(simulated, 1.0, hysteresis=1.0)
    bench = plant.simulate(simulated, profile, bench_times(profile), start)
    log = record(simulated, "pulse test", bench, _bench_sensors(simulated), generator("test", chemistry))
    capacity_Ah = simulated.circuit.capacity_Ah
    return identify(log, capacity_Ah=capacity_Ah, chemistry=chemistry, n_series=simulated.n_series)


def _bench_sensors(battery: SimulatedBattery) -> BatterySensors:
    capacity_A, cells = battery.circuit.capacity_Ah, battery.n_series
    current = Sensor(-_RANGE_C * capacity_A, _RANGE_C * capacity_A, 2e-4 * capacity_A, 5e-4 * capacity_A)
    voltage = Sensor(0.0, _RANGE_V * battery.voltage_max_V, 5e-4 * cells, 5e-4 * cells)
    return BatterySensors(current, voltage, Sensor(-55.0, 125.0, 0.1, 0.1))


@lru_cache(maxsize=2)
def shifts(chemistry: str, truth: Truth, runs: int, seed: int) -> Shifts:
    """Shifts of a battery in this state, one for each run."""
    battery = in_state(BATTERIES[chemistry], truth)
    time_s = np.arange(0.0, DURATION_S, truth.step_s)
    rngs = [generator("shift", chemistry, seed, run) for run in range(runs)]
    demand_A = np.stack([_load_A(rng, BATTERIES[chemistry], time_s) for rng in rngs], axis=1)
    starts = [rng.uniform(*_START_SOC) for rng in rngs]
    states = [plant.resting_state(battery, soc, truth.temperature_degC, hysteresis=1.0) for soc in starts]
    interval_s = np.diff(time_s, prepend=time_s[0])
    demand = plant.Demand(interval_s, demand_A, truth.temperature_degC)
    kernel = Kernel(plant.step, states[0], plant.Demand(0.0, 0.0, 0.0), constants=(battery,))
    _, found = kernel.scan_lanes(side_by_side(states), demand)
    return Shifts(time_s, found.current_A, found.voltage_V, found.temperature_degC, found.soc)


def in_state(battery: SimulatedBattery, truth: Truth) -> SimulatedBattery:
    """The battery with another capacity and resistance than when it was tested."""
    circuit, k = battery.circuit, truth.resistance_ratio
    return replace(
        battery,
        circuit=replace(
            circuit,
            capacity_Ah=truth.capacity_ratio * circuit.capacity_Ah,
            r0_discharge_ohm=tuple(k * r for r in circuit.r0_discharge_ohm),
            r0_charge_ohm=tuple(k * r for r in circuit.r0_charge_ohm),
            r_ohm=tuple(tuple(k * r for r in row) for row in circuit.r_ohm),
        ),
    )


def _load_A(rng: np.random.Generator, battery: SimulatedBattery, time_s: np.ndarray) -> np.ndarray:
    """Demanded current (T,) [A] of a shift; the charger keeps to the battery's limits."""
    capacity_A = battery.circuit.capacity_Ah
    robot = MissionRobot()
    grid_s = np.arange(0.0, DURATION_S + 1.0)
    current_A = np.full(grid_s.size, -_IDLE_C * capacity_A)
    charge_s = _DRIVE_S + _IDLE_S
    for begin_s in (0.0, charge_s + _CHARGE_S):
        driven = drive(rng, robot, _DRIVE_S).current_A * capacity_A / _MISSION_AH
        current_A[int(begin_s) : int(begin_s) + driven.size] = driven
    current_A[int(charge_s) : int(charge_s + _CHARGE_S)] = _CHARGE_C * capacity_A
    return np.interp(time_s, grid_s, current_A)


def measured(chemistry: str, condition: Condition, runs: int, seed: int) -> tuple[SocSample, np.ndarray]:
    """Samples (T, B) as the sensors of this condition give them, and the true state of charge (T, B)."""
    truth, battery = shifts(chemistry, condition.truth, runs, seed), BATTERIES[chemistry]
    rng = generator("sensors", chemistry, condition.name, seed)
    every = round(condition.interval_s / condition.truth.step_s)
    capacity_A, cells = battery.circuit.capacity_Ah, battery.n_series
    time_s, current_A, voltage_V, temperature_degC, soc = (values[::every] for values in truth)
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
