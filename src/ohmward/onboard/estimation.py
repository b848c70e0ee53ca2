"""The estimators of a robot behind one door: messages in, states of the robot out; no clock, no files, no threads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ohmward.battery.battery import Battery
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.battery.soc.sample import SocEstimate
from ohmward.energy.consumption import Consumption
from ohmward.energy.range_estimator import RangeEstimator
from ohmward.energy.range_step import RangeEstimate
from ohmward.onboard.quantities import BATTERY, DRIVE
from ohmward.onboard.robot_state import RobotState
from ohmward.traction.inbox import SensorInbox
from ohmward.traction.odometry.estimator import Odometry
from ohmward.traction.odometry.sample import OdometryEstimate
from ohmward.traction.robot.robot import Robot
from ohmward.traction.speed_observer.estimate import SlipEstimate
from ohmward.traction.speed_observer.estimator import SlipEstimator

_BATTERY, _DRIVE = ({quantity.name for quantity in group} for group in (BATTERY, DRIVE))
_PER_WHEEL = tuple(quantity.name for quantity in DRIVE if quantity.each)


class Estimation:
    """Charge, speed and slip, pose and range of one robot.

    Args:
        battery: estimates charge; None does without.
        robot: estimates speed, slip and pose; None does without.
        consumption: of the range; by default that expected of the robot. The range needs battery and robot.
        delay_s: messages of the drive wait so long for others with an earlier time.
        counts_per_turn: of the encoders, where they send counts.
    """

    def __init__(
        self,
        battery: Battery | None = None,
        robot: Robot | None = None,
        consumption: Consumption | None = None,
        delay_s: float = 0.0,
        counts_per_turn: float | None = None,
    ):
        self.battery, self.robot = battery, robot
        self.soc = SocEstimator(battery) if battery else None
        self.slip = SlipEstimator(robot) if robot else None
        self.odometry = Odometry(robot) if robot else None
        self.range = RangeEstimator(battery, consumption or robot) if battery and robot else None
        self.inbox = SensorInbox(robot, delay_s, counts_per_turn=counts_per_turn) if robot else None
        self._charge: SocEstimate | None = None
        self._slip: SlipEstimate | None = None
        self._pose: OdometryEstimate | None = None
        self._reach: RangeEstimate | None = None

    def put(self, time_s: float, values: Mapping[str, float]) -> list[RobotState]:
        """States after the values of a message, in the order of their times.

        time_s: of the measurement, on one clock for all messages.
        values: signal -> value, nan where it was not measured.
        """
        states = []
        if self.soc and any(name.partition(".")[0] in _BATTERY for name in values):
            states.append(self._battery_state(time_s, values))
        if self.inbox and any(name.partition(".")[0] in _DRIVE for name in values):
            self.inbox.put(time_s, **self._drive_message(values))
            states += [self._drive_state(sample) for sample in self.inbox.take()]
        return states

    def _battery_state(self, time_s: float, values: Mapping[str, float]) -> RobotState:
        assert self.soc is not None
        current_A, voltage_V = values.get("battery_current_A"), values.get("battery_voltage_V")
        temperature_degC = values.get("battery_temperature_degC")
        self._charge = self.soc.update(time_s, current_A, voltage_V, temperature_degC)
        if self.range:
            speed_m_s = self._slip.speed_m_s if self._slip else None
            self._reach = self.range.update(time_s, self._charge, speed_m_s, current_A, voltage_V)
        return self._state(time_s, values)

    def _drive_state(self, sample: dict[str, Any]) -> RobotState:
        assert self.slip is not None and self.odometry is not None
        self._slip = self.slip.update(**sample)
        self._pose = self.odometry.update(
            sample["time_s"], sample["wheel_speed_rad_s"], sample.get("yaw_rate_rad_s"), observed=self._slip
        )
        return self._state(sample["time_s"], sample)

    def _drive_message(self, values: Mapping[str, float]) -> dict[str, Any]:
        """Keyword arguments of `SensorInbox.put`."""
        assert self.robot is not None
        message: dict[str, Any] = {}
        for signal, value in values.items():
            name, _, part = signal.partition(".")
            if name in _PER_WHEEL:
                places = [place.name for place in self.robot.places]
                if name == "motor_current_A":
                    places = places[: self.robot.driven]
                row: list[float] = message.setdefault(name.removeprefix("motor_"), [float("nan")] * len(places))
                if (k := _number(part, places)) is not None:
                    row[k] = value
            elif name in _DRIVE:
                message[name] = value
        return message

    def _state(self, time_s: float, sample: Mapping[str, Any]) -> RobotState:
        return RobotState(time_s, float("nan"), sample, self._charge, None, self._slip, self._pose, self._reach)


def _number(part: str, places: Sequence[str]) -> int | None:
    """Number of a wheel by its name or number; None where the robot has none such."""
    if part in places:
        return places.index(part)
    return int(part) if part.isdecimal() and int(part) < len(places) else None
