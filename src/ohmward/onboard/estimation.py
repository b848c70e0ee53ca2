"""The estimators of a robot behind one interface: messages in, states of the robot out; no clock, no files, no threads.

Inbox of a battery: current, voltages and temperature that arrive separately, each at its own rate, become samples.

A sample is complete once every signal that usually reports has done so, and holds the mean of each over the step. Means
over the same step are consistent: no charge is lost, and the voltage drop belongs to the mean current.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from copy import copy
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.cells.pack_estimator import PackEstimator
from ohmward.battery.soc.anchor_rule import SocNormal
from ohmward.battery.soc.cell_loss import CellLoss
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.battery.soc.exchange_watch import ExchangeWatch
from ohmward.battery.soc.gaussian_sum import carries_errors
from ohmward.battery.soc.given_soc import after_first_voltage
from ohmward.battery.soc.sample import INITIAL_SOC_STD, MOST_SOC_STD, SocFlag, SocSample
from ohmward.battery.soc.voltage_faults import JUMP_SHARE
from ohmward.energy.consumption import Consumption
from ohmward.energy.cut_drive import DriveSample
from ohmward.energy.leg import Leg
from ohmward.energy.range import MissionForecast
from ohmward.energy.range_estimator import RangeEstimator
from ohmward.energy.range_step import RangeEstimate, RangeSample
from ohmward.errors import InputError
from ohmward.onboard.evidence import EVIDENCE
from ohmward.onboard.message import MessageSorter
from ohmward.onboard.robot_state import RobotState, Totals
from ohmward.quantities import GROUPS
from ohmward.traction.inbox import HEADING, SensorInbox
from ohmward.traction.odometry.estimator import Odometry
from ohmward.traction.robot.robot import Robot
from ohmward.traction.speed_observer.estimator import SlipEstimator, motion_of
from ohmward.traction.terrain.floor import travel_speed

#: Time without a report after which a sample no longer waits for a signal.
USUAL_S = 10.0

#: Longest time that a sample waits for a signal; the first sample waits this long for signals that have never reported.
LONGEST_S = 1.0

#: Longest lateness that a delay would mend; later messages have another clock [s].
LONGEST_DELAY_S = 10.0

CURRENT, VOLTAGE, TEMPERATURE = "battery_current_A", "battery_voltage_V", "battery_temperature_degC"
FULL, CELL = "battery_full", "cell_voltage_V"
#: Events reported by a person at the robot.
CHANGED, RESET = "battery_changed", "pose_reset"
#: Length of the way home.
HOME = "home_distance_m"
#: Time after which a length of the way home is no longer used.
HOME_S = 60.0

#: Fields of a drive sample that the odometry does not use: they are in the speed observer's estimate.
NOT_OF_ODOMETRY = ("current_A", "acceleration_m_s2", "pitch_rad")

#: Time after which a charger that keeps reporting a full battery is heard again [s].
FULL_AGAIN_S = 60.0

_NO_DRIVE = DriveSample(math.nan, math.nan, math.nan, 0.0, "")


class Estimation:
    """Charge, cells, speed and slip, pose and range of one robot.

    Args:
        battery: gives estimates of its charge, and of its cells if their voltages are measured; None gives neither.
        robot: gives estimates of speed, slip and pose; None gives none.
        consumption: for the range; default: as expected of the robot. The range needs battery and robot.
        delay_s: time that drive messages wait for others with an earlier time stamp.
        counts_per_turn: of the encoders, if they send counts; without it counts are ignored.
        days: time since the last drive in the consumption.
        unix_s: Unix time at which the estimators start [s], see `SocEstimator`.
        cutoff_V: voltage of the battery at which the robot stops; 0 if nothing monitors it.
        label: what is known of another battery of the same kind when it is put in; default: `battery`.
        lowering: of the estimators, see `ohmward.trace.Kernel`.

    Attributes:
        swaps: number of times that another battery was put in, as reported or as its voltage shows.
    """

    def __init__(
        self,
        battery: Battery | None = None,
        robot: Robot | None = None,
        consumption: Consumption | None = None,
        delay_s: float = 0.0,
        counts_per_turn: float | None = None,
        days: float = 0.0,
        unix_s: float | None = None,
        cutoff_V: float = 0.0,
        label: Battery | None = None,
        lowering: str | None = None,
    ):
        self.battery, self.robot, self.counts_per_turn, self.lowering = battery, robot, counts_per_turn, lowering
        #: Makes the estimator of the charge of a battery.
        self.soc_of = partial(SocEstimator, unix_s=unix_s, lowering=lowering)
        self._consumption, self._delay_s, self._days, self._cutoff_V = consumption, delay_s, days, cutoff_V
        self._label = label or battery
        self.swaps = 0
        #: Totals over the robot's life, as far as known; continued from a snapshot.
        self.totals = Totals()
        self.restart()

    def restart(self) -> None:
        """Forget every sample, as when a simulation is reset or a bag restarts; the robot's totals go on."""
        battery, robot = self.battery, self.robot
        self.soc = self.soc_of(battery) if battery else None
        self.cells: PackEstimator | None = None
        self.slip = SlipEstimator(robot, self.lowering) if robot else None
        self.odometry = Odometry(robot, self.lowering) if robot else None
        self.range = None
        if battery and robot:
            self.range = RangeEstimator(battery, self._consumption or robot, self._days, cutoff_V=self._cutoff_V)
        #: Estimator of the range that a forecast was begun for.
        self._forecast_for: RangeEstimator | None = None
        self.inbox = None
        if robot:
            self.inbox = SensorInbox(robot, self._delay_s, counts_per_turn=self.counts_per_turn, prompt=True)
        #: Time of the newest drive message.
        self._newest_drive_s = -math.inf
        #: Number of drive messages that came too late, and the largest lateness that a delay mends [s].
        self.late, self.late_s = 0, 0.0
        #: Time of the battery estimators minus time of the messages: the estimators continue across a restart.
        self.shift_s = 0.0
        self._exchange = ExchangeWatch()
        self.cell_loss = CellLoss(battery) if battery else None
        #: Time at which the voltage last showed another battery.
        self.exchanged_s = -math.inf
        #: Duration of a long absence [s] and the charge before it, which the first voltage after it may contradict.
        self.absence: tuple[float, SocNormal] | None = None
        #: That voltage, until the next one is like it, nan without one: one alone may not be the battery's.
        self._first_V = math.nan
        #: Last current of the battery, nan before the first.
        self.last_current_A = math.nan
        self._distance_m = 0.0
        self._sorter = MessageSorter(robot, counted=self.counts_per_turn is not None)
        places = tuple(place.name for place in robot.places) if robot else ()
        self.state = RobotState(math.nan, math.nan, wheels=places[: robot.driven] if robot else ())
        self._wheel_signals = {
            argument: tuple(f"{name}.{place}" for place in places)
            for argument, name in (("wheel_speed_rad_s", "wheel_speed_rad_s"), ("current_A", "motor_current_A"))
        }
        self._battery_inbox = MeanInbox((CURRENT, VOLTAGE))
        self._temperature_degC = math.nan
        #: Length of the way home [m], and when it was given.
        self._home_m = self._home_time_s = math.nan
        #: Values measured since the last sample of the "battery" and of the "drive", but not in such a sample.
        self._beside: dict[str, dict[str, float]] = {group: {} for group in GROUPS}
        self._cell_names = tuple(f"{CELL}.{k}" for k in range(int(battery.n_series))) if battery else ()
        self._cell_inbox = MeanInbox((CURRENT, *self._cell_names))
        self._measured_s = -math.inf
        #: Time of the last drive sample with a speed; -inf before the first.
        self._speed_s = -math.inf
        self._events: frozenset[str] = frozenset()
        self._full_s, self._full_pending = -math.inf, False

    def compile(self) -> None:
        """Answer once on copies, so that the first samples need not wait: a second, or hundredths from the disk."""
        if self.soc and self.battery:
            middle_V = 0.5 * (self.battery.voltage_min_V + self.battery.voltage_max_V)
            copy(self.soc).update(0.0, 0.0, middle_V)
        if self.slip and self.odometry and self.robot:
            slip = copy(self.slip).update(0.0, [0.0] * len(self.robot.places))
            copy(self.odometry).update(0.0, [0.0] * self.robot.driven, observed=slip)

    def forecast(self) -> Callable[[], RangeEstimate] | None:
        """Function that computes the range from the current state; None while there is nothing to compute.

        It takes long beside a sample and changes nothing, so that it can run in another thread; `take_forecast` takes
        its result.
        """
        if self.range is None or not math.isfinite(self.range.state.soc.soc):
            return None
        self._forecast_for = self.range
        settings, state = self.range.settings, self.range.state
        is_known = abs(self.state.time_s - self._home_time_s) <= HOME_S
        sample = RangeSample(_NO_DRIVE, state.soc, self._home_m if is_known else None)
        return lambda: settings.forecast(state, sample)

    def mission(self, way: float | Sequence[Leg], task_J: float, reserve_soc: float | None) -> MissionForecast:
        """Forecast of a mission that would begin now, see `RangeSettings.mission`; it changes nothing.

        Raises:
            InputError: the robot has no battery or no wheels here, or as `RangeSettings.mission`.
        """
        if self.range is None:
            raise InputError("a mission needs battery and robot in the setup")
        return self.range.settings.mission(self.range.state, way, task_J, reserve_soc)

    def take_forecast(self, found: RangeEstimate) -> None:
        """Store a forecast of the range, valid until the next one; ignored if another battery was put in meanwhile."""
        if self.range and self.range is self._forecast_for:
            self.range.state = self.range.state._replace(forecast=found)

    def put(self, time_s: float, values: Mapping[str, float]) -> list[RobotState]:
        """States after the values of a message, in the order of their times.

        time_s: of the measurement, on one clock for all messages.
        values: signal -> value, nan if it was not measured.
        """
        states: list[RobotState] = []
        self._take_events(values)
        if math.isfinite(home_m := values.get(HOME, math.nan)):
            self._home_m, self._home_time_s = home_m, time_s
        parts = self._sorter.parts(values)
        for group, signals in parts.beside.items():
            measured = {name: values[signal] for signal, name in signals.items() if math.isfinite(values[signal])}
            self._beside[group] |= measured
        if self.soc and parts.battery:
            states += self._put_battery(time_s, values)
        if self.inbox and parts.drive:
            left_out = self.inbox.left_out
            self.inbox.put(time_s, **parts.drive_message(values))
            late_s = self._newest_drive_s - time_s
            if self.inbox.left_out > left_out and late_s > 0.0:  # not the first message after a long silence
                self.late += 1
                self.late_s = late_s if self.late_s < late_s < LONGEST_DELAY_S else self.late_s
            self._newest_drive_s = max(self._newest_drive_s, time_s)
            states += [self._drive_state(sample) for sample in self.inbox.take()]
        if parts.reported:
            states.append(self._after(time_s, {name: values[name] for name in parts.reported}))
        return states

    def _take_events(self, values: Mapping[str, float]) -> None:
        """Restart the charge for another battery, or the pose, when such an event is reported; once until it clears."""
        for event, act in ((CHANGED, self._change_battery), (RESET, self._reset_pose)):
            if event in values:
                happened = values[event] >= 0.5
                if happened and event not in self._events:
                    act()
                self._events = self._events | {event} if happened else self._events - {event}

    def _change_battery(self) -> None:
        """Restart charge and cells from the next voltage, and capacity from the label: another battery is in."""
        self.battery = self._label
        self.swaps += 1
        if self.battery and self.soc:
            self.soc, self.cells, self.absence = self.soc_of(self.battery), None, None
            self._exchange, self.cell_loss = ExchangeWatch(), CellLoss(self.battery)
            self._battery_inbox, self._full_s, self._full_pending = MeanInbox((CURRENT, VOLTAGE)), -math.inf, False
            self.state = self.state._replace(
                battery=None, cells=None, range=None, battery_time_s=math.nan, cells_time_s=math.nan
            )
        if self.battery and self.range:
            before = self.range
            self.range = RangeEstimator(self.battery, before.consumption, cutoff_V=self._cutoff_V)
            self.range.state = before.state
            self.range.change_battery()

    def _reset_pose(self) -> None:
        if self.robot:
            self.odometry = Odometry(self.robot, self.lowering)
            self.state = self.state._replace(pose=None)

    def flush(self) -> list[RobotState]:
        """States of the samples that still wait for other messages, at the end."""
        states = []
        if self.soc and (sample := self._battery_inbox.flush()):
            states.append(self._battery_state(sample))
        if self.inbox:
            states += [self._drive_state(sample) for sample in self.inbox.flush()]
        return states

    def _put_battery(self, time_s: float, values: Mapping[str, float]) -> list[RobotState]:
        temperature_degC = values.get(TEMPERATURE, math.nan)
        if math.isfinite(temperature_degC):
            self._temperature_degC = temperature_degC
        beside = {name: values.get(name, math.nan) for name in (TEMPERATURE, *self._cell_names)}
        self._beside["battery"] |= {name: value for name, value in beside.items() if math.isfinite(value)}
        if math.isfinite(values.get(VOLTAGE, math.nan)):
            self._measured_s = time_s
        if len(self._cell_names) > 1 and (cells := self._cell_inbox.put(time_s, values)):
            self._update_cells(cells)
            if time_s - self._measured_s > USUAL_S:
                whole_V = sum(cells.values.get(name, math.nan) for name in self._cell_names)
                values = {**values, VOLTAGE: whole_V}
        sample = self._battery_inbox.put(time_s, values)
        states = [self._battery_state(sample)] if sample else []
        if values.get(FULL, 0.0) >= 0.5 and not time_s - self._full_s < FULL_AGAIN_S:
            self._full_s, self._full_pending = time_s, True
        if self._full_pending and self.soc and self.soc.last:
            self._full_pending = False
            states += self._full_declared(time_s)
        return states

    def _battery_state(self, sample: MeanSample) -> RobotState:
        assert self.soc is not None
        time_s = sample.time_s + self.shift_s
        current_A, voltage_V = sample.values.get(CURRENT, math.nan), sample.values.get(VOLTAGE, math.nan)
        if self.cell_loss:
            voltage_V = self.cell_loss.take(sample.time_s, current_A, voltage_V)
        if self.absence and self.soc.state is None:
            self._start_from(self.absence[1], SocSample(time_s, current_A, voltage_V, self._temperature_degC))
            self.absence = None
        if self.absence and self._is_like_the_first(voltage_V):
            away_s, before = self.absence
            first = SocSample(away_s, current_A, voltage_V, self._temperature_degC)
            self.soc.state = after_first_voltage(self.soc.settings, self.soc.state, first, before)
            self.absence = None
        measured = current_A, voltage_V, self._temperature_degC
        charge = self.soc.update(time_s, *measured)
        if self._is_of_another_battery(sample.time_s - self.state.battery_time_s, *measured):
            self._change_battery()
            self.exchanged_s = sample.time_s
            charge = self.soc.update(time_s, *measured)
            charge = charge._replace(flags=charge.flags | SocFlag.EXCHANGED)
        if math.isfinite(current_A):
            self.last_current_A = current_A
        if self.battery:
            dt_s = sample.time_s - self.state.battery_time_s
            self.totals = self.totals.after_battery(dt_s, current_A, voltage_V, self.battery.capacity_Ah)
        reach = None
        if self.range:
            speed_m_s = self._travel_speed_m_s(sample.time_s)
            self.range.state = self.range.state._replace(forecast_s=time_s)  # made by `forecast` instead
            reach = self.range.update(
                time_s, charge, speed_m_s, current_A, voltage_V, temperature_degC=self._temperature_degC
            )
        values = {**sample.values, **self._taken_beside("battery")}
        return self._after(sample.time_s, values, battery=charge, range=reach, battery_time_s=sample.time_s)

    def _start_from(self, before: SocNormal, first: SocSample) -> None:
        """Start the filter from a charge and the first voltage, whose errors may be one: as certain as the better one.

        With the variance a of the charge, and b after the voltage if nothing else is known, the charge counts with the
        variance 1 / (1/a - 1/b), so that both together have a; not at all where b is smaller.
        """
        assert self.battery is not None
        start = partial(self.soc_of, self.battery, min(max(before.soc, 0.0), 1.0))
        by_voltage = start(initial_soc_std=MOST_SOC_STD).update(*first)
        left = 1.0 - (before.std / by_voltage.soc_std) ** 2 if math.isfinite(first.voltage_V) else 1.0
        if left > 0.0:
            self.soc = start(initial_soc_std=min(before.std / math.sqrt(left), MOST_SOC_STD))

    def _is_of_another_battery(self, dt_s: float, current_A: float, voltage_V: float, temperature_degC: float) -> bool:
        """True if the voltage has stepped as that of another battery does."""
        if self.battery is None or self.soc is None or self.soc.last is None or not carries_errors(self.soc.settings):
            return False
        seen = dt_s, current_A, temperature_degC, voltage_V, self.soc.last, self.battery.thevenin
        self._exchange, exchanged = self._exchange.after(*seen)
        return exchanged

    def _is_like_the_first(self, voltage_V: float) -> bool:
        """True for a voltage like the one before, the first or second after an absence."""
        if self.battery is None or not math.isfinite(voltage_V):
            return False
        before_V, self._first_V = self._first_V, voltage_V
        return abs(voltage_V - before_V) <= JUMP_SHARE * self.battery.thevenin.ocv.voltage_V[-1]

    def _travel_speed_m_s(self, time_s: float) -> float | None:
        """Speed for the range: forward, or in any direction for an omni-directional robot; None if none is recent."""
        is_recent = abs(time_s - self._speed_s) <= USUAL_S + self._delay_s
        if self.state.slip is None or self.robot is None or not is_recent:
            return None
        if self.robot.freedoms < 3:
            return self.state.slip.speed_m_s
        return float(travel_speed(motion_of(self.robot, self.state.slip)))

    def _update_cells(self, sample: MeanSample) -> None:
        """Update the estimate of every cell, which starts from that of the pack."""
        assert self.battery is not None and self.soc is not None
        if not any(name in sample.values for name in self._cell_names):
            return
        if self.cells is None:
            known = self.soc.last
            soc, soc_std = (None, INITIAL_SOC_STD) if known is None else (min(max(known.soc, 0.0), 1.0), known.soc_std)
            self.cells = PackEstimator(self.battery, soc, soc_std, self.lowering)
        cells_V = [sample.values.get(name, math.nan) for name in self._cell_names]
        current_A = sample.values.get(CURRENT, math.nan)
        found = self.cells.update(sample.time_s + self.shift_s, current_A, cells_V, self._temperature_degC)
        self.state = self.state._replace(cells=found, cells_time_s=sample.time_s)

    def _full_declared(self, time_s: float) -> list[RobotState]:
        """The state after a charger has reported a full battery."""
        assert self.soc is not None
        if not carries_errors(self.soc.settings):
            return []
        if self.cells and self.cells.typical.last:
            self.cells.typical.correct_soc()
        return [self._after(time_s, {FULL: 1.0}, battery=self.soc.correct_soc(), battery_time_s=time_s)]

    def _drive_state(self, sample: dict[str, Any]) -> RobotState:
        assert self.slip is not None and self.odometry is not None
        measured = {**self._signals(sample), **self._taken_beside("drive")}
        found = {name for name, value in sample.items() if np.isfinite(value).any()} & EVIDENCE["drive"]
        self._speed_s = sample["time_s"] if found else self._speed_s
        if self._speed_s == -math.inf:
            return self._after(sample["time_s"], measured, drive_time_s=sample["time_s"])
        slip = self.slip.update(**{name: value for name, value in sample.items() if name not in HEADING})
        seen = {name: value for name, value in sample.items() if name not in NOT_OF_ODOMETRY}
        pose = self.odometry.update(**seen, observed=slip)
        self.totals = self.totals.after_drive(self._distance_m, float(pose.distance_m))
        self._distance_m = float(pose.distance_m)
        return self._after(sample["time_s"], measured, slip=slip, pose=pose, drive_time_s=sample["time_s"])

    def _taken_beside(self, group: str) -> dict[str, float]:
        """Take the values measured since the last sample of the battery or the drive, but not in such a sample."""
        measured, self._beside[group] = self._beside[group], {}
        return measured

    def _signals(self, sample: Mapping[str, Any]) -> dict[str, float]:
        """Values of a sample of the drive by signal, wheels by name; those that were not measured left out."""
        signals: dict[str, float] = {}
        for argument, value in sample.items():
            if argument in self._wheel_signals:
                pairs = zip(self._wheel_signals[argument], value.tolist(), strict=False)
                signals |= {signal: number for signal, number in pairs if number == number}
            elif argument != "time_s":
                signals[argument] = value
        return signals

    def _after(self, time_s: float, sample: Mapping[str, float], **estimates: Any) -> RobotState:
        """The state with new estimates; all others are unchanged."""
        self.state = self.state._replace(time_s=time_s, sample=sample, totals=self.totals, **estimates)
        return self.state


class MeanSample(NamedTuple):
    """Mean of each signal over a step, without signals that have not reported; time_s: time of the newest value."""

    time_s: float
    values: dict[str, float]


class MeanInbox:
    """Messages in, samples out.

    Args:
        signals: those that belong together; others are ignored.
    """

    def __init__(self, signals: Iterable[str]):
        self.signals = frozenset(signals)
        self._sums: dict[str, float] = {}
        self._counts: dict[str, int] = {}
        self._reported_s: dict[str, float] = {}
        self._began_s = self._newest_s = math.nan
        self._awaited = self.signals

    def put(self, time_s: float, values: Mapping[str, float]) -> MeanSample | None:
        """The sample that the message completes, None if it completes none; nan is not measured."""
        for signal, value in values.items():
            if signal in self.signals and math.isfinite(value):
                self._add(time_s, signal, value)
        is_complete = self._awaited <= self._sums.keys() or not self._newest_s - self._began_s < LONGEST_S
        return self._close() if self._sums and is_complete else None

    def flush(self) -> MeanSample | None:
        """The incomplete sample, at the end."""
        return self._close() if self._sums else None

    def _add(self, time_s: float, signal: str, value: float) -> None:
        if not self._sums:
            self._began_s = time_s
        self._newest_s = time_s if not time_s < self._newest_s else self._newest_s
        self._sums[signal] = self._sums.get(signal, 0.0) + value
        self._counts[signal] = self._counts.get(signal, 0) + 1
        self._reported_s[signal] = self._newest_s

    def _close(self) -> MeanSample:
        sample = MeanSample(self._newest_s, {s: self._sums[s] / self._counts[s] for s in self._sums})
        self._sums.clear()
        self._counts.clear()
        for signal in [s for s, at_s in self._reported_s.items() if self._newest_s - at_s > USUAL_S]:
            del self._reported_s[signal]
        self._awaited = frozenset(self._reported_s)
        return sample
