"""Logs of a robot's battery on the bench and through a working day, for `ohmward demo` and tests."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ohmward.checks import require_one_of
from ohmward.logs import Log, Note, write_log
from ohmward.quantities import SECONDS_PER_HOUR
from ohmward_lab.simulate import mission
from ohmward_lab.simulate.cells import BATTERIES, SimulatedBattery
from ohmward_lab.simulate.plant import Simulation, resting_state, simulate
from ohmward_lab.simulate.profile import Profile, bench_times, pulse_profile
from ohmward_lab.simulate.sensors import BatterySensors, low_cost_sensors, on_the_bench

#: Nominal interval of the logger [s]; standard deviation of each sample about its nominal time and its limit [s].
_INTERVAL_S, _JITTER_STD_S, _MOST_JITTER_S = 1.0, 0.05, 0.4
#: Mean number of dropouts in an hour (Poisson) and their mean duration [s] (exponential).
_DROPOUTS_PER_HOUR, _DROPOUT_MEAN_S = 1.0, 25.0

CHEMISTRIES = ("lfp", "lead-acid")
_WORKSHOP_DEGC = 20.0


class RobotDay(NamedTuple):
    """Simulated logs of the same battery by the same sensors; both start fully charged and carry `soc_true`."""

    pulse_test: Log
    mission: Log


class RobotDayFiles(NamedTuple):
    """Paths of the logs of a `RobotDay`."""

    pulse_test: Path
    mission: Path


def make_robot_day(chemistry: str = "lfp", seed: int = 1) -> RobotDay:
    """A pulse test on the bench and a working day, of a 12 V, 12 Ah battery on the robot of [P]'s kind.

    >>> day = ow.make_robot_day("lead-acid", seed=3)
    >>> day.pulse_test.name
    'simulated lead-acid pulse test'

    chemistry: "lfp" or "lead-acid". seed: draws the sensors' errors, the day's work and the noise; same seed, same day.

    Raises:
        InputError: an unknown chemistry.
    """
    require_one_of("chemistry", chemistry, CHEMISTRIES)
    battery = BATTERIES[chemistry]
    rng = np.random.default_rng(seed)
    sensors = low_cost_sensors(rng)
    bench = on_the_bench(sensors)
    return RobotDay(
        record(battery, f"simulated {chemistry} pulse test", run_pulse_test(battery), bench, rng),
        record(battery, f"simulated {chemistry} robot day", run_mission(battery, rng), sensors, rng),
    )


def run_pulse_test(battery: SimulatedBattery) -> Simulation:
    """The truth of the pulse test in the workshop, from full."""
    return run_on_bench(battery, pulse_profile(battery.circuit.capacity_Ah, _WORKSHOP_DEGC))


def run_on_bench(battery: SimulatedBattery, profile: Profile) -> Simulation:
    """The truth of a test from full, at its first temperature, at the times of the bench's logger."""
    start = resting_state(battery, 1.0, float(profile.ambient_degC[0]), hysteresis=1.0)
    return simulate(battery, profile, bench_times(profile), start)


def run_mission(battery: SimulatedBattery, rng: np.random.Generator) -> Simulation:
    """The truth of the day at the times of its telemetry, from full and at the temperature of the morning."""
    profile = mission.robot_day(rng, battery.charge_current_A)
    times = telemetry_times(profile.time_s[-1], rng)
    morning_degC = float(profile.ambient_degC[0])
    return simulate(battery, profile, times, resting_state(battery, 1.0, morning_degC, hysteresis=1.0))


def telemetry_times(duration_s: float, rng: np.random.Generator) -> np.ndarray:
    """Times (T,) [s] of a logger with jitter and dropouts; the first sample always arrives."""
    nominal = np.arange(0.0, duration_s, _INTERVAL_S)
    jitter = np.clip(_JITTER_STD_S * rng.standard_normal(nominal.size), -_MOST_JITTER_S, _MOST_JITTER_S)
    times = np.clip(nominal + jitter, 0.0, duration_s)
    count = rng.poisson(_DROPOUTS_PER_HOUR * duration_s / SECONDS_PER_HOUR)
    start = rng.uniform(0.0, duration_s, count)[:, None]
    stop = start + rng.exponential(_DROPOUT_MEAN_S, count)[:, None]
    arrives = ~np.any((times >= start) & (times < stop), axis=0)
    arrives[0] = True
    return times[arrives]


def record(
    battery: SimulatedBattery, name: str, simulation: Simulation, sensors: BatterySensors, rng: np.random.Generator
) -> Log:
    """Log of the simulation as measured by the sensors, with the true SoC as the extra column `soc_true`."""
    offset_A, gain = sensors.current.offset, sensors.current.gain_error
    return sensors.log(name, simulation.time_s, simulation.truth, rng).with_notes(
        Note(f"simulated, not measured: {battery.name}, capacity {battery.circuit.capacity_Ah:g} Ah"),
        Note(f"simulated current sensor: offset {1e3 * offset_A:+.0f} mA, gain error {100 * gain:+.2f} %"),
    )


def write_robot_day(day: RobotDay, folder: str | PathLike[str]) -> RobotDayFiles:
    """Write both logs as CSV into an existing folder, named after them.

    Raises:
        InputError, OhmwardError: as `write_log`.
    """
    paths = [Path(folder) / f"{log.name.replace(' ', '-')}.csv" for log in day]
    for log, path in zip(day, paths, strict=True):
        write_log(log, path)
    return RobotDayFiles(*paths)
