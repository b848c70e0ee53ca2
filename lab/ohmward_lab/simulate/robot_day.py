"""Logs of a robot's battery on the bench and through a working day, for `ohmward demo` and tests."""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ohmward.checks import require_each_not_negative, require_one_of, require_positive
from ohmward.logs import Log, Note, write_log
from ohmward.quantities import SECONDS_PER_HOUR
from ohmward_lab.simulate import mission
from ohmward_lab.simulate.cells import BATTERIES, SimulatedBattery
from ohmward_lab.simulate.plant import Simulation, resting_state, simulate
from ohmward_lab.simulate.profile import Profile, bench_times, pulse_test
from ohmward_lab.simulate.sensors import BatterySensors, low_cost_sensors, on_the_bench


@dataclass(frozen=True)
class Telemetry:
    """A logger with jitter and dropouts.

    Raises:
        InputError: a value out of its range.
    """

    interval_s: float = 1.0  #: nominal interval
    jitter_std_s: float = 0.05  #: of each sample about its nominal time, limited to 0.4 intervals
    dropouts_per_hour: float = 1.0  #: mean number of dropouts (Poisson)
    dropout_mean_s: float = 25.0  #: mean duration of a dropout (exponential)

    def __post_init__(self) -> None:
        require_positive("telemetry.interval_s", self.interval_s)
        require_each_not_negative("telemetry.", self, "jitter_std_s", "dropouts_per_hour", "dropout_mean_s")

    def times(self, duration_s: float, rng: np.random.Generator) -> np.ndarray:
        """(T,) strictly increasing sample times [s] in [0, duration_s]; the first sample always arrives."""
        nominal = np.arange(0.0, duration_s, self.interval_s)
        most = 0.4 * self.interval_s
        jitter = np.clip(self.jitter_std_s * rng.standard_normal(nominal.size), -most, most)
        times = np.clip(nominal + jitter, 0.0, duration_s)
        arrives = ~self._dropped(times, duration_s, rng)
        arrives[0] = True
        return times[arrives]

    def _dropped(self, times: np.ndarray, duration_s: float, rng: np.random.Generator) -> np.ndarray:
        """(T,) True for samples during a dropout."""
        count = rng.poisson(self.dropouts_per_hour * duration_s / SECONDS_PER_HOUR)
        start = rng.uniform(0.0, duration_s, count)[:, None]
        stop = start + rng.exponential(self.dropout_mean_s, count)[:, None]
        return np.any((times >= start) & (times < stop), axis=0)


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
    return run_on_bench(battery, pulse_test(battery, _WORKSHOP_DEGC))


def run_on_bench(battery: SimulatedBattery, profile: Profile) -> Simulation:
    """The truth of a test from full, at its first temperature, at the times of the bench's logger."""
    start = resting_state(battery, 1.0, float(profile.ambient_degC[0]), hysteresis=1.0)
    return simulate(battery, profile, bench_times(profile), start)


def run_mission(battery: SimulatedBattery, rng: np.random.Generator) -> Simulation:
    """The truth of the day at the times of its telemetry, from full and at the temperature of the morning."""
    profile = mission.robot_day(rng, battery.charge_current_A)
    times = Telemetry().times(profile.time_s[-1], rng)
    morning_degC = float(profile.ambient_degC[0])
    return simulate(battery, profile, times, resting_state(battery, 1.0, morning_degC, hysteresis=1.0))


def record(
    battery: SimulatedBattery, name: str, simulation: Simulation, sensors: BatterySensors, rng: np.random.Generator
) -> Log:
    """Log of the simulation as measured by the sensors, with the true SoC as the extra column `soc_true`."""
    offset_A, gain = sensors.current.offset, sensors.current.gain_error
    return sensors.log(name, simulation.time_s, simulation.truth, rng).with_notes(
        Note(f"simulated, not measured: {battery.name}, capacity {battery.circuit.capacity_Ah:g} Ah"),
        Note(f"simulated current sensor: offset {1e3 * offset_A:+.0f} mA, gain error {100 * gain:+.2f} %"),
    )


def write_robot_day(day: RobotDay, folder: str | PathLike[str], suffix: str = ".csv") -> RobotDayFiles:
    """Write both logs into an existing folder, named after them; `suffix`: one that `write_log` supports.

    Raises:
        InputError, OhmwardError: as `write_log`.
    """
    paths = [Path(folder) / f"{log.name.replace(' ', '-')}{suffix}" for log in day]
    for log, path in zip(day, paths, strict=True):
        write_log(log, path)
    return RobotDayFiles(*paths)
