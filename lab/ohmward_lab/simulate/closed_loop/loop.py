"""The closed loop: sensors, observer, controller, battery, robot and ground, step by step.

samples  = sensors(truth)                 at their rates, late, noisy, some of them dropped
estimate = observer(samples)
torque   = controller(command, estimate)  every millisecond, within what the battery can feed
truth    = plant(torque)
battery feeds the motors and the electronics
"""

from __future__ import annotations

import time
from bisect import bisect_left
from collections.abc import Callable
from dataclasses import replace
from enum import IntFlag

import numpy as np

from ohmward.errors import InputError
from ohmward.trace import Kernel
from ohmward.traction.control import ControlFlag, Measurement, Report
from ohmward.traction.control.signals import SAME_TORQUE
from ohmward.traction.dynamics.forces import EnergyBalance
from ohmward.traction.speed_observer.speed_observer import SpeedObserver
from ohmward_lab.simulate.closed_loop.control import Controller, WheelCommand, make_controller, wheel_command
from ohmward_lab.simulate.closed_loop.mujoco_robot import MujocoRobot
from ohmward_lab.simulate.closed_loop.observing import Observation, make_momentum_observer, make_observer
from ohmward_lab.simulate.closed_loop.run import ClosedLoopRun, Instant, RunRow
from ohmward_lab.simulate.closed_loop.scenario import Scenario
from ohmward_lab.simulate.closed_loop.sensing import SensorSuite
from ohmward_lab.simulate.closed_loop.supply import PackSensors, Supplied, Supply, available_torque
from ohmward_lab.simulate.closed_loop.traction_plant import TractionPlant
from ohmward_lab.simulate.robot_sensors import RobotTruth, stack
from ohmward_lab.traction.momentum_observer import MomentumObserver

_SENTENCES: dict[IntFlag, str] = {
    ControlFlag.STALE: "the speed was too old or too uncertain to act on, and the torque went to zero; give the robot "
    "another sensor (sensors.speed, sensors.encoders, sensors.pitch) or a faster link",
    ControlFlag.UNREACHABLE: "the slip asked for did not come about although the torque was at its limit: friction or "
    "torque cannot give it; ask for another slip or raise controller.torque_limit_Nm",
    ControlFlag.BAD_COMMAND: "the command was not understood, and the torque went to zero",
}


class DriveWarnings:
    """Time spent under each deviation, wheel by wheel."""

    def __init__(self, scenario: Scenario) -> None:
        self._places = [p.name for p in scenario.model.places]
        self._duration_s = 0.0
        self._flagged_s = {flag: np.zeros(scenario.model.driven) for flag in _SENTENCES}
        self._short_s = 0.0

    def add_step(self, report: Report, demanded_Nm: np.ndarray, torque_Nm: np.ndarray, dt_s: float) -> None:
        """Count one step of the controller; torque_Nm: the demanded torque as limited by the battery."""
        self._duration_s += dt_s
        flags = np.asarray(report.flags).astype(int)
        if flags.any():
            for flag, seconds in self._flagged_s.items():
                seconds += np.where(flags & flag, dt_s, 0.0)
        if np.abs(demanded_Nm - torque_Nm).max() > SAME_TORQUE:
            self._short_s += dt_s

    def sentences(self, empty: bool) -> tuple[str, ...]:
        """One sentence for each kind of deviation; empty: the battery can no longer feed the electronics."""
        found = [
            f"{self._shares(seconds)} of the time: {_SENTENCES[flag]}"
            for flag, seconds in self._flagged_s.items()
            if seconds.any()
        ]
        if self._short_s:
            share = 100 * self._short_s / self._duration_s
            found.append(f"{share:.1f} % of the time: the battery's voltage or power limited the torque")
        if empty:
            found.append(
                f"the battery is empty after {self._duration_s:.3g} s and the drive ends there; raise battery.start_soc"
            )
        return tuple(found)

    def _shares(self, seconds: np.ndarray) -> str:
        shares = 100 * seconds / self._duration_s
        return ", ".join(f"{self._places[k]} {shares[k]:.1f} %" for k in np.flatnonzero(seconds))


#: Largest number of instants of the history.
_INSTANTS = 25_000
#: Shortest time between two instants of the history.
_SHORTEST_INSTANT_S = 0.002
#: Steps of the controller between two reports of progress.
_PROGRESS_STEPS = 200
#: Times that differ by less are equal: sums of steps are rounded.
_TIME_EPS_S = 1e-9

Plant = TractionPlant | MujocoRobot


def run(scenario: Scenario, progress: Callable[[int, int], None] | None = None) -> ClosedLoopRun:
    """Simulate the whole drive; it ends early where the battery is empty.

    progress: called every 200 steps with (steps done, steps).

    Raises:
        InputError: the plant cannot be built, MuJoCo is not installed, or no sample of the sensors arrives.
    """
    begun = time.perf_counter()
    drive = ClosedLoopDrive(scenario)
    steps = round(scenario.duration_s / scenario.controller.interval_s)
    for k in range(steps):
        drive.step()
        if drive.empty:
            break
        if progress and k % _PROGRESS_STEPS == 0:
            progress(k, steps)
    drive.sample()
    if not drive.rows:
        raise InputError(
            f"no sample of the sensors arrived in {drive.truth.time_s:.3g} s; lower sensors.drop_share or "
            "sensors.delay_s, or drive for longer"
        )
    return ClosedLoopRun(
        scenario,
        stack(drive.history),
        stack(drive.rows),
        drive.warnings.sentences(drive.empty),
        time.perf_counter() - begun,
    )


def make_plant(scenario: Scenario) -> Plant:
    """The plant of a scenario."""
    kind = {"own": TractionPlant, "mujoco": MujocoRobot}[scenario.plant]
    return kind(scenario.model, scenario.ground, scenario.grade, scenario.drag_N_s2_per_m2)


class ClosedLoopDrive:
    """A drive in progress."""

    def __init__(self, scenario: Scenario) -> None:
        self.scenario, self.robot = scenario, scenario.model
        sensors_rng, pack_rng = np.random.default_rng(scenario.seed).spawn(2)
        self.plant = make_plant(scenario)
        self.truth: RobotTruth = self.plant.reset(scenario.start_speed_m_s)
        self.supply = Supply(scenario.battery)
        self.sensors = SensorSuite(scenario.sensors, self.robot, sensors_rng, self.truth)
        self.observation = Observation(_observer(scenario), self.robot, self.truth)
        self.pack = PackSensors(self.supply.now, pack_rng)
        self.warnings = DriveWarnings(scenario)
        self.energy_J = EnergyBalance()
        self._commands = [wheel_command(command, self.robot) for command in scenario.commands]
        self._starts_s = [command.from_s for command in scenario.commands]
        self._controllers = _controllers(scenario, self._commands[0])
        self._mode, self._state = "", None
        self._torque_Nm = np.zeros(self.robot.driven)
        self._history_s = max(scenario.controller.interval_s, _SHORTEST_INSTANT_S, scenario.duration_s / _INSTANTS)
        #: truth of the robot, current, voltage and SoC of the battery at each sample that has not arrived, by its time
        self._on_the_way: dict[float, tuple[RobotTruth, float, float, float]] = {}
        self.history: list[Instant] = []
        self.rows: list[RunRow] = []

    @property
    def empty(self) -> bool:
        """True where the battery can no longer feed the electronics."""
        return self.supply.now.available_W < self.robot.idle_W or self.supply.now.soc <= 0.0

    def hold(self, torque_Nm: np.ndarray) -> None:
        """Command these torques (driven,) from now on, in mode "torque"."""
        self._commands = [command._replace(torque_Nm=torque_Nm) for command in self._commands]

    def sample(self) -> None:
        """Let the sensors sample, and the observer use the samples that have arrived."""
        arrivals = self.sensors.sample(self.truth)
        if self.sensors.sampled:
            soc = float(self.supply.now.soc)
            self._on_the_way[self.truth.time_s] = (self.truth, *self.pack.sample(), soc)
        for arrival in arrivals:
            estimate = self.observation.update(arrival)
            at = self._on_the_way[arrival.taken_s]
            self.rows.append(RunRow(arrival.taken_s, arrival.sample, arrival.heading_rad, estimate, *at))
            self._on_the_way = {t: later for t, later in self._on_the_way.items() if t > arrival.taken_s}

    def step(self) -> None:
        """One step of the controller."""
        dt_s, n = self.scenario.controller.interval_s, self.robot.driven
        self.sample()
        wheel_speed, travel = self.sensors.drive_speeds(self.truth), self.truth.wheel_centre_speed_m_s[:n]
        measurement = self.observation.measurement(wheel_speed, travel, self.truth.time_s)
        demanded, report = self._control(measurement)
        torque = available_torque(demanded, self.truth.wheel_speed_rad_s[:n], self.robot, self.supply.now)
        self.truth = self.plant.step(torque, dt_s)
        supplied = self.supply.draw(self.plant.energy.electrical / dt_s + self.robot.idle_W, dt_s)
        self.energy_J = self.energy_J.accumulate(self._energy_step(supplied, dt_s))
        self.pack.add_step(supplied)
        self.warnings.add_step(report, demanded, torque, dt_s)
        self._torque_Nm = np.asarray(demanded)
        self._record(report, supplied)

    def _control(self, measurement: Measurement) -> tuple[np.ndarray, Report]:
        """Torque [N m] of the controller of the present command; a new mode takes over from the present torque."""
        now = bisect_left(self._starts_s, self.truth.time_s + _TIME_EPS_S) - 1
        settings = self.scenario.controller
        mode = settings.mode_of(self.scenario.commands[now])
        controller, step = self._controllers[mode]
        if mode != self._mode:
            self._mode, self._state = mode, controller.init(measurement, self._torque_Nm)
        self._state, demanded, report = step(self._state, self._commands[now], measurement, settings.interval_s)
        return demanded, report

    def _energy_step(self, supplied: Supplied, dt_s: float) -> EnergyBalance:
        """Balance [J] of the step with battery and electronics; a resistor burns what the battery does not take."""
        motors = self.plant.energy
        idle_J = self.robot.idle_W * dt_s
        battery_J = supplied.power_W * dt_s
        return motors._replace(battery=battery_J, idle=idle_J, resistor=battery_J - motors.electrical - idle_J)

    def _record(self, report: Report, supplied: Supplied) -> None:
        """Add an instant to the history where one is due."""
        if self.truth.time_s > (len(self.history) + 1) * self._history_s - _TIME_EPS_S or self.empty:
            battery = supplied.current_A, supplied.voltage_V, supplied.soc, supplied.temperature_degC
            self.history.append(Instant(self.truth, report, *battery, self.energy_J))


def _controllers(scenario: Scenario, example: WheelCommand) -> dict[str, tuple[Controller, Kernel]]:
    """The controller of each mode of the commands, with its compiled step."""
    zero = np.zeros(scenario.model.driven)
    at_rest = Measurement(zero, zero, 0.0, zero, zero)
    found = {}
    for mode in {scenario.controller.mode_of(command) for command in scenario.commands}:
        controller = make_controller(replace(scenario.controller, mode=mode), scenario.model)
        found[mode] = controller, Kernel(controller.step, controller.init(at_rest, zero), example, at_rest, 0.0)
    return found


def _observer(scenario: Scenario) -> SpeedObserver | MomentumObserver | None:
    """The scenario's observer; None where the controller gets the true speed."""
    if scenario.observer.method == "true":
        return None
    make = make_momentum_observer if scenario.observer.method == "momentum" else make_observer
    return make(scenario.observer, scenario.sensors, scenario.model, scenario.surface.patches[-1])
