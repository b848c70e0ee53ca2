"""The closed loop: sensors, observer, controller, battery, robot and ground, step by step.

readings = sensors(truth)                 at their rates, late, noisy, some lost
estimate = observer(readings)
torque   = controller(command, estimate)  every millisecond, within what the battery can feed
truth    = plant(torque)
battery gives what the motors took, and what the electronics draw
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from ohmward.errors import InputError
from ohmward.simulate.closed_loop.control import Wanted, make_controller, wanted
from ohmward.simulate.closed_loop.mujoco_robot import MujocoRobot
from ohmward.simulate.closed_loop.observing import Observation, make_observer
from ohmward.simulate.closed_loop.pack_sensors import PackSensors
from ohmward.simulate.closed_loop.power_limit import available_torque
from ohmward.simulate.closed_loop.records import Records
from ohmward.simulate.closed_loop.run import ClosedLoopRun, Instant, RunRow
from ohmward.simulate.closed_loop.scenario import Scenario
from ohmward.simulate.closed_loop.sensing import SensorSuite
from ohmward.simulate.closed_loop.supply import Supplied, Supply
from ohmward.simulate.closed_loop.traction_plant import TractionPlant
from ohmward.simulate.closed_loop.watch import Watch
from ohmward.simulate.robot_truth import RobotTruth
from ohmward.trace import Kernel
from ohmward.traction.control import Measurement, Report
from ohmward.traction.dynamics.energy_balance import EnergyBalance
from ohmward.traction.speed_observer.speed_observer import SpeedObserver

#: Instants of the history, at most, and the shortest time between them.
_INSTANTS, _SHORTEST_S = 25_000, 0.002
_PROGRESS_STEPS = 200

Plant = TractionPlant | MujocoRobot


def run(scenario: Scenario, progress: Callable[[int, int], None] | None = None) -> ClosedLoopRun:
    """Simulate the whole drive; it ends early where the battery is empty.

    progress: called now and then with (steps done, steps).

    Raises:
        InputError: the plant cannot be made so, MuJoCo is not installed, or no sample of the sensors arrives.
    """
    begun = time.perf_counter()
    drive = ClosedLoopDrive(scenario)
    steps = round(scenario.duration_s / scenario.controller.interval_s)
    for k in range(steps):
        drive.step()
        if drive.empty:
            drive.watch.battery_empty()
            break
        if progress and k % _PROGRESS_STEPS == 0:
            progress(k, steps)
    drive.look()
    if not len(drive.rows):
        raise InputError(
            f"no sample of the sensors arrived in {drive.truth.time_s:.3g} s; lower sensors.drop_share or "
            "sensors.delay_s, or drive for longer"
        )
    return ClosedLoopRun(
        scenario,
        drive.history.stacked(),
        drive.rows.stacked(),
        drive.watch.sentences(),
        time.perf_counter() - begun,
    )


def make_plant(scenario: Scenario) -> Plant:
    """The plant of a scenario."""
    kind = {"own": TractionPlant, "mujoco": MujocoRobot}[scenario.plant]
    return kind(scenario.model, scenario.ground, scenario.grade)


class ClosedLoopDrive:
    """A drive under way.

    Args:
        scenario: which.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.scenario, self.robot = scenario, scenario.model
        sensors_rng, pack_rng = np.random.default_rng(scenario.seed).spawn(2)
        self.plant = make_plant(scenario)
        self.truth: RobotTruth = self.plant.reset()
        self.supply = Supply(scenario.battery)
        self.sensors = SensorSuite(scenario.sensors, self.robot, sensors_rng)
        self.observation = Observation(_observer(scenario), self.robot)
        self.pack = PackSensors(self.supply.now, pack_rng)
        self.watch = Watch(scenario)
        self.energy = EnergyBalance()
        self._wanted = [wanted(command, self.robot) for command in scenario.commands]
        self._command = -1
        self._state, self._control = _controller(scenario, self._wanted[0])
        self._keep_s = max(scenario.controller.interval_s, _SHORTEST_S, scenario.duration_s / _INSTANTS)
        self._under_way: dict[float, tuple[RobotTruth, float, float, float]] = {}
        self.history: Records[Instant] = Records()
        self.rows: Records[RunRow] = Records()

    @property
    def empty(self) -> bool:
        """Whether the battery can no longer feed the electronics."""
        return self.supply.now.most_W < self.robot.idle_W or self.supply.now.soc <= 0.0

    def look(self) -> None:
        """Let the sensors sample, and the observer use what has arrived."""
        arrivals = self.sensors.see(self.truth)
        if self.sensors.sampled:
            self._under_way[self.truth.time_s] = self.truth, *self.pack.read(), float(self.supply.now.soc)
        for arrival in arrivals:
            truth, current_A, voltage_V, soc = self._under_way.pop(arrival.taken_s)
            estimate = self.observation.take(arrival)
            row = RunRow(arrival.taken_s, arrival.sample, estimate, truth, current_A, voltage_V, soc)
            self.rows.add(row)
            self._under_way = {t: known for t, known in self._under_way.items() if t > arrival.taken_s}

    def step(self) -> None:
        """One step of the controller."""
        dt_s, n = self.scenario.controller.interval_s, self.robot.driven
        self.look()
        wheel_speed, travel = self.sensors.drive_speeds(self.truth), self.truth.wheel_centre_speed_m_s[:n]
        measurement = self.observation.measurement(wheel_speed, travel, self.truth.time_s)
        self._state, asked, report = self._control(self._state, self._now(), measurement, dt_s)
        torque = available_torque(asked, self.truth.wheel_speed_rad_s[:n], self.robot, self.supply.now)
        self.truth = self.plant.step(torque, dt_s)
        supplied = self.supply.draw(self.plant.energy.electrical / dt_s + self.robot.idle_W, dt_s)
        self.energy = self.energy.accumulate(self._energy_step(supplied, dt_s))
        self.pack.feel(supplied)
        self.watch.see(report, asked, torque, dt_s)
        self._keep(report, supplied)

    def _energy_step(self, supplied: Supplied, dt_s: float) -> EnergyBalance:
        """Balance [J] of the step with battery and electronics; a resistor burns what the battery does not take."""
        motors = self.plant.energy
        idle_J = self.robot.idle_W * dt_s
        battery_J = supplied.power_W * dt_s
        return motors._replace(battery=battery_J, idle=idle_J, resistor=battery_J - motors.electrical - idle_J)

    def _now(self) -> Wanted:
        """The command that holds now, for the wheels."""
        commands = self.scenario.commands
        while self._command + 1 < len(commands) and self.truth.time_s > commands[self._command + 1].from_s - 1e-9:
            self._command += 1
        return self._wanted[self._command]

    def _keep(self, report: Report, supplied: Supplied) -> None:
        if self.truth.time_s > (len(self.history) + 1) * self._keep_s - 1e-9 or self.empty:
            battery = supplied.current_A, supplied.voltage_V, supplied.soc, supplied.temperature_degC
            self.history.add(Instant(self.truth, report, *battery, self.energy))


def _controller(scenario: Scenario, first: Wanted) -> tuple[Any, Kernel]:
    """State of the controller before the first step of a robot at rest, and its compiled step."""
    zero = np.zeros(scenario.model.driven)
    at_rest = Measurement(zero, zero, 0.0, zero)
    controller = make_controller(scenario.controller, scenario.model)
    state = controller.init(at_rest)
    return state, Kernel(controller.step, state, first, at_rest, 0.0)


def _observer(scenario: Scenario) -> SpeedObserver | None:
    if scenario.observer.method == "true":
        return None
    return make_observer(scenario.observer, scenario.sensors, scenario.model, scenario.surface.patches[-1])
