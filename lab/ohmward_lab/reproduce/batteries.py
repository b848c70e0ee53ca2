"""Simulated batteries of the sizes in [T] and [P], and the logs that their results come from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ohmward.battery.models.temperature import ROOM_DEGC
from ohmward.logs.log import Log
from ohmward.quantities import SECONDS_PER_HOUR
from ohmward_lab.simulate.cells import BATTERIES, SimulatedBattery, scaled
from ohmward_lab.simulate.mission import drive
from ohmward_lab.simulate.plant import resting_state, simulate
from ohmward_lab.simulate.profile import EDGE_S, Profile, pulse_profile
from ohmward_lab.simulate.robot_day import record, run_on_bench
from ohmward_lab.simulate.sensors import BatterySensors, Sensor, low_cost_sensors, on_the_bench

#: Current steps of a joystick drive of a few minutes: durations [s], largest and idle current [C], share of stops.
_HOLD_S = (2.0, 12.0)
_LARGEST_RATE = 1.0
_IDLE_RATE = 0.05
_STOP_SHARE = 0.3
#: Share of the commands that brake or go downhill and charge, at no more than this rate [C].
_CHARGE_SHARE = 0.15
_LARGEST_CHARGE_RATE = 0.4
#: [P] 2.1: length of a pulse and of the rest after it [s].
_TEST_PULSE_S, _TEST_REST_S = 1800.0, 3600.0
#: [P] 4: largest error of its current sensor [A], 0.8 % of 25 A, and its range [A].
CAS_ERROR_A, _CAS_RANGE_A = 0.2, 85.0
#: Time [s] in which a joystick's command becomes a current.
_RAMP_S = 1.0


class TestedBattery(NamedTuple):
    """A battery, the log of its test and the log to estimate along."""

    battery: SimulatedBattery  #: that was simulated
    bench: Log  #: pulse test; its extra column `soc_true` is the truth
    drive: Log  #: the robot's discharge, likewise

    @property
    def truth(self) -> np.ndarray:
        """True state of charge (T,) along the drive."""
        return self.drive.extra["soc_true"]


def sealed_lead_acid() -> SimulatedBattery:
    """[P] 4.1: sealed lead-acid, 12 V 5 Ah."""
    return scaled("simulated sealed lead-acid 12 V 5 Ah", BATTERIES["lead-acid"], 5.0 / 12.0)


def lithium_iron_phosphate() -> SimulatedBattery:
    """[P] 4.2: lithium iron phosphate, 12 V 6 Ah."""
    return scaled("simulated LFP 12.8 V 6 Ah", BATTERIES["lfp"], 6.0 / 12.0)


def robot_discharge(
    battery: SimulatedBattery, bench: Profile, end_soc: float, seed: int, mean_A: float
) -> TestedBattery:
    """[P] 4: a pulse test and the robot's discharge from full to `end_soc`, by the sensors of its table 2, at 1 Hz."""
    rng = np.random.default_rng(seed)
    sensors = farm_sensors(rng)
    profile = drive(rng, 12 * SECONDS_PER_HOUR)
    profile = profile._replace(
        current_A=profile.current_A * (mean_A / -profile.current_A.mean()),
        ambient_degC=np.full(profile.time_s.size, ROOM_DEGC),
    )
    down = _down_to(profile, battery.circuit.capacity_Ah, end_soc)
    return _recording(battery, bench, down, (1.0, end_soc), sensors, rng)


def farm_sensors(rng: np.random.Generator) -> BatterySensors:
    """Low-cost sensors with [P]'s current sensor, CAS 25-NP: 0.8 % of 25 A, 25 mV/A on a 3.3 V converter of 12 bit."""
    sensors = low_cost_sensors(rng)
    current = replace(
        sensors.current,
        low=-_CAS_RANGE_A,
        high=_CAS_RANGE_A,
        resolution=3.3 / 4096 / 0.025,
        offset=float(rng.uniform(-1.0, 1.0)) * CAS_ERROR_A,
        offset_walk_std=0.0,
        gain_error=0.0,
    )
    return sensors._replace(current=current)


def resistor_pulses(battery: SimulatedBattery, load_ohm: float, pulses: int) -> Profile:
    """[P] 2.1: from full, pulses of half an hour into a resistor, an hour of rest after each.

    The current is that of the open-circuit voltage into the resistor; the reduction by the battery's own resistance,
    1 %, is left out.
    """
    ocv, soc = battery.circuit.ocv, 1.0
    time_s, current_A = [0.0, _TEST_PULSE_S / 3], [0.0, 0.0]
    for _ in range(pulses):
        begin = time_s[-1] + EDGE_S
        first_A = float(ocv.mean_V(soc, ROOM_DEGC)) / load_ohm
        soc -= first_A * _TEST_PULSE_S / SECONDS_PER_HOUR / battery.circuit.capacity_Ah
        last_A = float(ocv.mean_V(soc, ROOM_DEGC)) / load_ohm
        end = begin + _TEST_PULSE_S
        time_s += [begin, end, end + EDGE_S, end + EDGE_S + _TEST_REST_S]
        current_A += [-first_A, -last_A, 0.0, 0.0]
    return Profile(np.array(time_s), np.array(current_A), np.full(len(time_s), ROOM_DEGC))


def joystick_drive(battery: SimulatedBattery, soc: tuple[float, float], seed: int) -> TestedBattery:
    """Pulse test and a drive by joystick between two states of charge, at 1 Hz, by laboratory sensors ([T] 3.4)."""
    rng = np.random.default_rng(seed)
    profile = joystick(rng, battery.circuit.capacity_Ah, 12 * SECONDS_PER_HOUR)
    down = _down_to(profile, battery.circuit.capacity_Ah, soc[1], soc[0])
    return _recording(battery, pulse_profile(battery.circuit.capacity_Ah), down, soc, _laboratory(), rng)


def joystick(rng: np.random.Generator, capacity_Ah: float, duration_s: float) -> Profile:
    """Commands of random size held for some seconds, with stops between them; some of them charge ([T] 3.3.5)."""
    time, rate = [0.0], [_IDLE_RATE]
    while time[-1] < duration_s:
        kind, size = rng.random(2)
        level = _IDLE_RATE
        if kind < _CHARGE_SHARE:
            level -= _LARGEST_CHARGE_RATE * size
        elif kind < 1.0 - _STOP_SHARE:
            level += (_LARGEST_RATE - _IDLE_RATE) * size
        time += [time[-1] + _RAMP_S, time[-1] + _RAMP_S + rng.uniform(*_HOLD_S)]
        rate += [level, level]
    return Profile(np.array(time), -capacity_Ah * np.array(rate), np.full(len(time), ROOM_DEGC))


def _laboratory() -> BatterySensors:
    """Sensors without offset and gain error: [T] uses its coulomb count as the truth."""
    current = Sensor(-30.0, 30.0, resolution=0.005, noise_std=0.01)
    voltage = Sensor(0.0, 60.0, resolution=0.001, noise_std=0.002)
    return BatterySensors(current, voltage, Sensor(-55.0, 125.0, resolution=0.1, noise_std=0.1))


def _down_to(profile: Profile, capacity_Ah: float, end_soc: float, start_soc: float = 1.0) -> Profile:
    """The profile, cut where its charge has taken the battery from one state of charge to the other."""
    mean_A = 0.5 * (profile.current_A[1:] + profile.current_A[:-1])
    moved_Ah = np.concatenate([[0.0], np.cumsum(mean_A * np.diff(profile.time_s)) / SECONDS_PER_HOUR])
    last = int(np.argmax(moved_Ah <= -(start_soc - end_soc) * capacity_Ah)) + 1
    return Profile(*(values[:last] for values in profile))


def _recording(
    battery: SimulatedBattery,
    bench_profile: Profile,
    profile: Profile,
    soc: Sequence[float],
    sensors: BatterySensors,
    rng: np.random.Generator,
) -> TestedBattery:
    bench = run_on_bench(battery, bench_profile)
    hysteresis = 1.0 if soc[0] == 1.0 else -1.0
    times = np.arange(0.0, profile.time_s[-1], 1.0)
    driven = simulate(battery, profile, times, resting_state(battery, soc[0], ROOM_DEGC, hysteresis))
    return TestedBattery(
        battery,
        record(battery, "pulse test", bench, on_the_bench(sensors), rng),
        record(battery, f"drive from {100 * soc[0]:g} to {100 * soc[1]:g} %", driven, sensors, rng),
    )
