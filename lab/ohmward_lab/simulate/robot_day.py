"""Logs of a robot's battery on the bench and through a working day, for `ohmward demo` and tests."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ohmward.checks import require_one_of
from ohmward.logs import Log, Note, write_log
from ohmward_lab.simulate import mission
from ohmward_lab.simulate.bench_profiles import bench_times, pulse_test
from ohmward_lab.simulate.cells import BATTERIES, SimulatedBattery
from ohmward_lab.simulate.plant import Simulation, resting_state, simulate
from ohmward_lab.simulate.sensors import BatterySensors, low_cost_sensors, on_the_bench
from ohmward_lab.simulate.telemetry import Telemetry

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

    chemistry: "lfp" or "lead-acid". seed: draws the sensors' errors, the day's work and the noise; same seed, same day.

    Raises:
        InputError: another chemistry.
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
    profile = pulse_test(battery, _WORKSHOP_DEGC)
    start = resting_state(battery, 1.0, _WORKSHOP_DEGC, hysteresis=1.0)
    return simulate(battery, profile, bench_times(profile), start)


def run_mission(battery: SimulatedBattery, rng: np.random.Generator) -> Simulation:
    """The truth of the day at the times at which its telemetry arrives, from full and as cold as the morning."""
    profile = mission.robot_day(rng, battery.charge_current_A)
    times = Telemetry().times(profile.time_s[-1], rng)
    morning_degC = float(profile.ambient_degC[0])
    return simulate(battery, profile, times, resting_state(battery, 1.0, morning_degC, hysteresis=1.0))


def record(
    battery: SimulatedBattery, name: str, simulation: Simulation, sensors: BatterySensors, rng: np.random.Generator
) -> Log:
    """Log of the simulation by the sensors, with the true SoC as the extra column `soc_true`."""
    time_s, truth = simulation.time_s, simulation.truth
    offset_A, gain = sensors.current.offset, sensors.current.gain_error
    return Log(
        name=name,
        time_s=time_s,
        current_A=sensors.current.measure(truth.current_A, time_s, rng),
        voltage_V=sensors.voltage.measure(truth.voltage_V, time_s, rng),
        temperature_degC=sensors.temperature.measure(truth.temperature_degC, time_s, rng),
        extra={"soc_true": truth.soc},
        notes=(
            Note(f"simulated, not measured: {battery.name}, capacity {battery.circuit.capacity_Ah:g} Ah"),
            Note(f"simulated current sensor: offset {1e3 * offset_A:+.0f} mA, gain error {100 * gain:+.2f} %"),
        ),
    )


def write_robot_day(day: RobotDay, folder: str | PathLike[str], suffix: str = ".csv") -> RobotDayFiles:
    """Write both logs into an existing folder, named after them; `suffix` as `write_log` knows them.

    Raises:
        InputError, OhmwardError: as `write_log`.
    """
    paths = [Path(folder) / f"{log.name.replace(' ', '-')}{suffix}" for log in day]
    for log, path in zip(day, paths, strict=True):
        write_log(log, path)
    return RobotDayFiles(*paths)
