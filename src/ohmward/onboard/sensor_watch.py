"""Watch over the sensors: names those that are silent, stuck, doubled or not numeric, and keeps their values out.

A fault costs an estimator the information of that sensor and nothing else: its values become nan, as if not measured,
until it reports again. A sensor is stuck if its value stays the same to the last bit while related values move: current
and voltage of a battery are compared with each other, wheels with the motion measured by the other wheels and the gyro.
It is also stuck if its source repeats its last message, as a driver or a bridge does from its memory, or all encoders
in it: all values that normally have noise stay the same together, although the robot is not at rest by them. Signs and
units are compared all the time as in a trial of the setup, see `wiring_check`; a current that the voltage contradicts
is not used.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from ohmward.battery.battery import Battery
from ohmward.battery.models.temperature import ROOM_DEGC
from ohmward.battery.models.thevenin import CircuitInput, ohmic_resistance
from ohmward.onboard.evidence import EVIDENCE, Age
from ohmward.onboard.message import no_such_part, sender
from ohmward.onboard.robot_state import Diagnostic, Level
from ohmward.onboard.wiring_check import CurrentCheck, Recorder, check_wheels
from ohmward.quantities import EVENTS, QUANTITIES, ValueLimits, limits_of, quantity_of
from ohmward.signals.checks import NOT_COUNTED, NOTHING_CAME, beyond_limits, doubled, missing, no_number, stuck
from ohmward.traction.motion.sample import STOPPED
from ohmward.traction.motion_check import MotionCheck
from ohmward.traction.robot.robot import Robot

#: A sensor is silent after this many usual intervals without a value, but no earlier than this time.
SILENT_INTERVALS, SILENT_S = 5.0, 1.0

#: A link delivers in bursts if values of later times wait for longer than a sensor may be silent, and no longer than
#: this [s]; it is then silent after twice that wait.
LONGEST_BURST_S = 5.0

#: A value is overdue after this many usual intervals, but no earlier than this time.
DUE_INTERVALS, DUE_S = 2.0, 0.25

#: Reversals of the related value for which a constant sensor counts as stuck; a voltage that relaxes at a constant
#: current makes none.
TURNS = 2

#: Change of the battery's current that moves its voltage [multiples of the capacity per hour]; the drop over the ohmic
#: resistance of a cell is then some millivolts, the last digit of a common converter.
MOVE_C = 0.1

#: A value has noise after this many changes, this share of which reverse the one before, and if it is never repeated
#: more often than this, but for 0. Coarse and simulated values, and those of a sensor at rest, have none.
NOISE_CHANGES, NOISE_REVERSALS, NOISE_REPEATS = 100, 0.25, 20

#: Time for which all values with noise are the same when their source repeats its last message, multiple of the most
#: repetitions before, and least number of such values.
REPEATED_S, REPEATED_MORE, FEWEST_WITH_NOISE = 5.0, 10, 2

#: Quantities that show that a robot is not at rest, at this share of their usual size.
_MOVES, _NOT_AT_REST = ("battery_current_A", "wheel_speed_rad_s", "motor_current_A", "yaw_rate_rad_s"), 0.5

#: Time after which something is missed: messages of a source after the start, a value that came only once after it.
PROMISED_S = 5.0

#: Time after a source's first message at which a declared signal is missed: slow sensors need a while.
MISSED_S = 30.0

#: Values are late if they are older than this when they arrive, or if their stamps are always further behind our clock
#: than two clocks set by the network differ; those of other publishers count for so long [s].
LATE_S, BEHIND_S, COUNTED_FOR_S = 0.5, 1.0, 10.0

#: Most signals watched: enough for a pack of hundreds of cells; a source that invents names must not fill the memory.
MOST_SENSORS = 1000

#: Quantities that are compared with each other in the running process, and how often [s].
_BATTERY = ("battery_current_A", "battery_voltage_V", "battery_temperature_degC")
_COMPARED, _COMPARE_S = (*_BATTERY, "wheel_speed_rad_s", "yaw_rate_rad_s"), 5.0

#: Weight of the newest interval in the usual one.
_NEWEST_WEIGHT = 0.05

#: Signal whose moves show that another one is stuck.
_PARTNER = {
    "battery_voltage_V": "battery_current_A",
    "battery_current_A": "battery_voltage_V",
    "cell_voltage_V": "battery_current_A",
}

_ANY = ValueLimits(-math.inf, math.inf)


@dataclass(slots=True)
class WatchedSensor:
    """Record of one signal so far."""

    signal: str
    source: str  #: source that sends it, and its publisher there, if the source hears several
    publisher: str
    lowest: float  #: a working sensor reads from this to `highest`
    highest: float
    move: float = math.inf  #: smallest change that counts as a move
    last_s: float = -math.inf  #: time of its last value
    received_s: float = -math.inf  #: time of its receipt, which may be later
    interval_s: float = 0.0  #: usual time between two values
    burst_s: float = 0.0  #: time between the bursts in which its values come, 0 if they come one by one
    true_s: float = -math.inf  #: receipt of the last value that may be true
    pauses: int = 0  #: silences in a row
    value: float = math.nan  #: last value within the limits
    same: int = 0  #: number of times in a row that it was repeated
    same_s: float = -math.inf  #: time since which it has been the same
    stuck: bool = False  #: True once it is found to be stuck
    changes: int = 0  #: number of times that the value has changed
    reversals: int = 0  #: number of changes against the direction of the one before
    rises: bool = False  #: direction of the last change
    longest: int = 0  #: most repetitions of a value other than 0, faults excluded
    usual: float = 0.0  #: usual size of the value
    turns: int = 0  #: number of times that its moves have reversed
    moved_to: float = math.nan  #: value after the last move
    upwards: bool = True  #: direction of the last move
    partner_turns: int = 0  #: turns of the partner at `same_s`
    partner: WatchedSensor | None = None
    bad: int = 0  #: values outside the limits since the last look
    bad_value: float = math.nan  #: the last of them
    good: int = 0  #: other values since the last look
    absent: str = ""  #: sentence if it cannot be used: the robot has no such wheel or motor, counts are in no unit
    plausible: ValueLimits = _ANY  #: lowest and highest value on this robot
    doubled_by: str = ""  #: who else sends it
    doubled_s: float = -math.inf  #: when it last came from there
    repeated: int = 0  #: values that came twice since the last look
    looked_at: float = math.nan  #: value at the last look
    looked_s: float = math.nan  #: time of that value
    looked: bool = False  #: True if no value has come since the last look
    wrong: str = ""  #: sentence if related signals contradict its sign or unit
    compared: bool = False  #: True if it is compared with related signals

    @property
    def silent_after_s(self) -> float:
        """Time without a value after which it is silent; inf for an event, or a signal that has come only once."""
        if self.interval_s == 0.0 or self.signal in EVENTS:
            return math.inf
        return max(SILENT_INTERVALS * self.interval_s, SILENT_S, 2.0 * self.burst_s)

    def is_silent(self, now_s: float) -> bool:
        """True if no value has arrived for long; values that a slow link delivers late count."""
        return now_s - self.received_s > self.silent_after_s

    def is_due(self, now_s: float) -> bool:
        """True if its last value that may be true is no older than an occasional gap of a working sensor."""
        wait_s = max(DUE_INTERVALS * self.interval_s, DUE_S) if self.interval_s else PROMISED_S
        return now_s - self.true_s <= wait_s

    def has_reported(self, now_s: float) -> bool:
        """True if its last value that may be true came within the time that a working sensor may be silent."""
        return now_s - self.true_s <= (self.silent_after_s if self.interval_s else PROMISED_S)

    def take(self, time_s: float, received_s: float, value: float) -> float:
        """The value; nan if it is outside the limits, stuck or repeated."""
        waited_s = received_s - self.received_s
        if SILENT_S < waited_s < LONGEST_BURST_S and 0.0 < time_s - self.last_s < SILENT_S:
            self.burst_s = waited_s
        self.received_s = received_s
        if self.looked:
            self.bad, self.good, self.repeated, self.looked = 0, 0, 0, False
        if not self.lowest <= value <= self.highest:
            self.bad, self.bad_value = self.bad + 1, value
            self._reported(time_s)
            return math.nan
        if value == self.value:
            if time_s == self.last_s:
                self.repeated += 1
                return math.nan
            self.same += 1
        else:
            self._changed(value)
            self.same, self.same_s, self.stuck, self.value = 0, time_s, False, value
            self.partner_turns = self.partner.turns if self.partner else 0
            if not abs(value - self.moved_to) <= self.move:
                upwards = value > self.moved_to
                self.turns += upwards != self.upwards
                self.upwards, self.moved_to = upwards, value
        self._reported(time_s)
        self.good += 1
        if self.stuck or self.is_of_no_sensor or (self.wrong and self.signal == "battery_current_A"):
            return math.nan
        self.true_s = received_s
        return value

    def _changed(self, value: float) -> None:
        if self.value != 0.0 and not self.stuck:
            self.longest = max(self.longest, self.same)
        rises = value > self.value
        self.reversals += rises != self.rises
        self.rises = rises
        self.changes += 1
        self.usual += max(_NEWEST_WEIGHT, 1.0 / self.changes) * (abs(value) - self.usual)

    def _reported(self, time_s: float) -> None:
        if not time_s > self.last_s:
            return
        gap_s, self.last_s = time_s - self.last_s, time_s
        if self.interval_s == 0.0:
            self.interval_s = gap_s if gap_s < math.inf else 0.0
        elif gap_s < SILENT_S or gap_s < self.silent_after_s:
            self.interval_s += _NEWEST_WEIGHT * (gap_s - self.interval_s)
            self.pauses = 0
        else:
            self.pauses += 1
            if self.pauses > 1:  # no outage: the first two values came too fast
                self.interval_s = gap_s

    def change_since_look(self) -> float:
        """Rate of change of the value since the last call; nan for the first call or without a newer value."""
        passed_s, change = self.last_s - self.looked_s, self.value - self.looked_at
        self.looked_at, self.looked_s = self.value, self.last_s
        return change / passed_s if passed_s > 0.0 else math.nan

    @property
    def is_of_no_sensor(self) -> bool:
        """True for a temperature that has never been other than 0 degC, as of a message that nobody has filled."""
        return self.value == 0.0 and self.changes == 1 and self.signal == "battery_temperature_degC"

    @property
    def is_same(self) -> bool:
        """True if the value has been the same for as long as a fault in a log lasts."""
        return self.same >= STOPPED.values and self.last_s - self.same_s >= STOPPED.contradicts_s

    @property
    def varies(self) -> bool:
        """True if its values have often gone up and down, although they may have been the same for long."""
        return self.changes >= NOISE_CHANGES and self.reversals >= NOISE_REVERSALS * self.changes

    @property
    def has_noise(self) -> bool:
        """True if its values normally differ from each other."""
        return self.varies and self.longest <= NOISE_REPEATS

    @property
    def is_repeated(self) -> bool:
        """True if the value has been the same for much longer than ever before."""
        return self.is_same and self.same > REPEATED_MORE * self.longest and self.last_s - self.same_s >= REPEATED_S

    @property
    def moves(self) -> bool:
        """True if it shows that the robot is not at rest."""
        return self.signal.partition(".")[0] in _MOVES and abs(self.value) > _NOT_AT_REST * self.usual


@dataclass
class Delivery:
    """Messages of one source."""

    signals: frozenset[str] = frozenset()  #: signals that it declares
    first_s: float = math.inf  #: receipt of the first message
    #: publisher -> receipt of its last message, and the delay of it
    last: dict[str, tuple[float, float]] = field(default_factory=dict)
    step_s: float = -math.inf  #: time at which the source's clock was last set


@dataclass
class SensorWatch:
    """The watch over all sensors of a robot."""

    #: battery and robot with the sensors
    battery: Battery | None = None
    robot: Robot | None = None
    #: source -> signals that it declares
    promised: Mapping[str, Iterable[str]] = field(default_factory=dict)
    began_s: float = 0.0  #: time from which messages are expected
    counts_per_turn: float | None = None  #: of the wheels' encoders, if they send counts

    def __post_init__(self) -> None:
        self.sensors: dict[str, WatchedSensor] = {}
        self.sources = {name: Delivery(frozenset(signals)) for name, signals in self.promised.items()}
        self._motion = MotionCheck(self.robot) if self.robot else None
        self._left_out = ""
        self._missed: set[str] = set()
        self._evidence: dict[str, list[WatchedSensor]] = {name: [] for name in EVIDENCE}
        self._recent, self._compared_s = Recorder(recent=True), -math.inf
        self._current = CurrentCheck(self.battery, recent=True) if self.battery else None
        self._wrong: dict[str, dict[str, str]] = {}  #: contradictions of the "current" and of the "wheels"
        self._together: set[str] = set()  #: names of those that are of several signals together

    def ages(self, now_s: float) -> dict[str, Age]:
        """Overdue evidence of estimates, by name: none of its sensors has sent a value that may be true in time."""
        found = {}
        for name, sensors in self._evidence.items():
            if sensors and not any(sensor.is_due(now_s) for sensor in sensors):
                age_s = min(now_s - sensor.true_s for sensor in sensors)
                found[name] = Age(age_s, not any(sensor.has_reported(now_s) for sensor in sensors))
        return found

    def take(
        self,
        source: str,
        time_s: float,
        received_s: float,
        values: Mapping[str, float],
        publisher: str = "",
        behind_s: float = 0.0,
    ) -> dict[str, float]:
        """Values of a message that may be used, nan for invalid ones; doubled ones are left out.

        behind_s: of its stamp against the wall clock of this machine, 0 where they are not comparable.
        """
        delivery = self.sources.setdefault(source, Delivery())
        delivery.first_s = min(delivery.first_s, received_s)
        known = publisher if publisher in delivery.last or len(delivery.last) < MOST_SENSORS else ""
        delivery.last[known] = received_s, max(received_s - time_s, behind_s if behind_s > BEHIND_S else 0.0)
        clean = {}
        for signal, value in values.items():
            if (sensor := self.sensors.get(signal) or self._first(signal, source, publisher)) is None:
                self._left_out = source
                continue
            is_known = sensor.source == source and (sensor.publisher == publisher or signal in EVENTS)
            if not is_known and not self._takes_over(sensor, source, publisher, received_s):
                continue
            clean[signal] = sensor.take(time_s, received_s, value)
            if sensor.compared and value == sensor.value and not sensor.stuck:
                self._recent.put(source, time_s, {signal: value})
        return clean

    def clock_was_set(self, source: str, now_s: float) -> None:
        """Record that the clock of a source was set."""
        self.sources[source].step_s = now_s

    def look(self, now_s: float) -> Iterator[Diagnostic]:
        """Conditions of all sensors and sources now."""
        self._find_stuck()
        if self._left_out:
            message = f"more than {MOST_SENSORS} signals: {self._left_out} sends new names again and again; look at it"
            yield Diagnostic("signals", Level.WARN, message)
        for name, delivery in self.sources.items():
            yield from self._conditions(name, delivery, now_s)
        yield from self._needed(now_s)
        yield from self._compare(now_s)
        for sensor in self.sensors.values():
            level, message = _condition(sensor, now_s)
            figures = {"value": sensor.value, "interval_s": sensor.interval_s, "age_s": now_s - sensor.last_s}
            yield Diagnostic(sensor.signal, level, message, figures)
            sensor.looked = True

    def _compare(self, now_s: float) -> Iterator[Diagnostic]:
        """Compare related signals: those of a wrong sign or unit stay marked until they are seen to be right."""
        if now_s - self._compared_s < _COMPARE_S:
            return
        self._compared_s, recent = now_s, self._recent.signals()
        current = self._current.findings(recent) if self._current else []
        wheels = list(check_wheels(recent, self.robot)) if self.robot else []
        for group, findings in (("current", current), ("wheels", wheels)):
            if any(finding.level in (Level.OK, Level.ERROR) for finding in findings):
                before = self._wrong.get(group, {})
                now = {f.name: f.message for f in findings if f.level == Level.ERROR}
                same = {name for name in now if _fix(now[name]) == _fix(before.get(name, ""))}
                self._wrong[group] = {name: before[name] if name in same else now[name] for name in now}
        wrong = {name: text for found in self._wrong.values() for name, text in found.items()}
        for sensor in self.sensors.values():
            sensor.wrong = wrong.pop(sensor.signal, "")
        for name in self._together - wrong.keys():
            yield Diagnostic(name, Level.OK, "agree")
        self._together = set(wrong)
        for name, text in wrong.items():
            yield Diagnostic(name, Level.ERROR, text)

    def take_contradiction(self, signal: str) -> None:
        """Take it that an estimate contradicts a sensor, which is stuck if it repeats itself."""
        if (sensor := self.sensors.get(signal)) and sensor.is_same:
            sensor.stuck = True

    def _conditions(self, name: str, delivery: Delivery, now_s: float) -> Iterator[Diagnostic]:
        """Conditions of a source: its clock, its delay, missing signals and missing messages."""
        if now_s - delivery.step_s < 60.0:
            yield Diagnostic(f"clock of {name}", Level.WARN, "was set; its times count from there")
        elif delivery.step_s > -math.inf:
            yield Diagnostic(f"clock of {name}", Level.OK, "goes on")
        yield _delay_of(name, delivery.last)
        if now_s - delivery.first_s >= MISSED_S:
            for signal in sorted(delivery.signals - self.sensors.keys()):
                came = f"has not come from {name} for {MISSED_S:.0f} s"
                yield Diagnostic(signal, Level.STALE, missing(came))
        if now_s - self.began_s >= PROMISED_S:
            none = delivery.first_s == math.inf
            message = NOTHING_CAME if none else "come"
            yield Diagnostic(f"messages of {name}", Level.STALE if none else Level.OK, message)

    def _needed(self, now_s: float) -> Iterator[Diagnostic]:
        """Conditions of what the estimates of battery and drive need at least, if all sources send something else."""
        sending = bool(self.sources) and all(now_s - delivery.first_s >= MISSED_S for delivery in self.sources.values())
        declared = {signal.partition(".")[0] for delivery in self.sources.values() for signal in delivery.signals}
        for group, owner in (("battery", self.battery), ("drive", self.robot)):
            name, needed = f"sensors of the {group}", EVIDENCE[group]
            if owner is not None and sending and not self._evidence[group] and not needed & declared:
                self._missed.add(name)
                text = f"no source sends {' or '.join(sorted(needed))}; look at names and topics, or leave its file out"
                yield Diagnostic(name, Level.STALE, text)
            elif name in self._missed:
                yield Diagnostic(name, Level.OK, "report")

    def _first(self, signal: str, source: str, publisher: str) -> WatchedSensor | None:
        """The sensor of a new signal; None if there are too many already."""
        if len(self.sensors) >= MOST_SENSORS:
            return None
        quantity = quantity_of(signal)
        plausible = limits_of(quantity.name, self.battery, self.robot)
        # No battery is beyond them, whereas a wheel may spin, a cell be dead, and a circuit be short.
        lowest, highest = plausible if quantity.name == "battery_voltage_V" else quantity.limits
        move = self._moves().get(quantity.name, math.inf)
        sensor = self.sensors[signal] = WatchedSensor(signal, source, publisher, lowest, highest, move)
        uncounted = quantity.name == "wheel_counts" and self.counts_per_turn is None
        sensor.absent = no_such_part(signal, self.robot) or (NOT_COUNTED if uncounted else "")
        sensor.plausible = plausible
        sensor.compared = quantity.name in _COMPARED and not sensor.absent
        for name, quantities in EVIDENCE.items():
            if quantity.name in quantities and not sensor.absent:
                self._evidence[name].append(sensor)
        for other in self.sensors.values():
            for a, b in ((sensor, other), (other, sensor)):
                if _PARTNER.get(a.signal.partition(".")[0]) == b.signal:
                    a.partner, a.partner_turns = b, b.turns
        return sensor

    def _moves(self) -> dict[str, float]:
        """Changes that count as moves of the battery's sensors; empty without a battery file."""
        if self.battery is None:
            return {}
        current_A = MOVE_C * self.battery.capacity_Ah
        ohm = float(ohmic_resistance(0.5, CircuitInput(0.0, ROOM_DEGC), self.battery.thevenin))
        return {"battery_current_A": current_A, "battery_voltage_V": ohm * current_A}

    def _takes_over(self, sensor: WatchedSensor, source: str, publisher: str, received_s: float) -> bool:
        """True if the signal's previous sender is silent; otherwise it is doubled, and the new sender is left out."""
        if sensor.is_silent(received_s):
            sensor.source, sensor.publisher, sensor.doubled_s = source, publisher, -math.inf
            return True
        sensor.doubled_by, sensor.doubled_s = sender(source, publisher), received_s
        return False

    def _find_repeated(self) -> None:
        """Find the sensors of sources, of messages and of one quantity of theirs, that are repeated to the last bit."""
        together: dict[tuple[str, float | str], list[WatchedSensor]] = {}
        for sensor in self.sensors.values():
            if sensor.varies:
                for part in (sensor.last_s, sensor.signal.partition(".")[0], ""):
                    together.setdefault((sensor.source, part), []).append(sensor)
        for sensors in together.values():
            noisy = [sensor for sensor in sensors if sensor.has_noise]
            repeated = len(noisy) >= FEWEST_WITH_NOISE and all(sensor.is_repeated for sensor in noisy)
            if repeated and any(sensor.moves for sensor in noisy):
                for sensor in sensors:
                    sensor.stuck = sensor.stuck or sensor.is_same

    def _find_stuck(self) -> None:
        self._find_repeated()
        for sensor in self.sensors.values():
            if sensor.is_same and sensor.partner and sensor.partner.turns - sensor.partner_turns >= TURNS:
                sensor.stuck = True
        if self._motion:
            speeds = {s.signal: (self._speed(s), s.is_same) for s in self.sensors.values() if s.good and not s.looked}
            for signal in self._motion.stuck(speeds):
                self.sensors[signal].stuck = True

    def _speed(self, sensor: WatchedSensor) -> float:
        """Value of a sensor; for encoder counts the speed [rad/s] since the last look, nan after an overflow."""
        if not sensor.signal.startswith("wheel_counts"):
            return sensor.value
        if self.counts_per_turn is None:
            return math.nan
        speed = 2.0 * math.pi / self.counts_per_turn * sensor.change_since_look()
        return speed if abs(speed) <= QUANTITIES["wheel_speed_rad_s"].limits.highest else math.nan


def _condition(sensor: WatchedSensor, now_s: float) -> tuple[Level, str]:
    if sensor.absent:
        return Level.ERROR, sensor.absent
    if sensor.is_silent(now_s):
        return Level.STALE, f"silent; look at the sensor, its wire and {sensor.source}"
    if sensor.wrong and not (sensor.bad and math.isnan(sensor.bad_value)):
        return Level.ERROR, sensor.wrong
    if sensor.bad and not sensor.good:
        return Level.ERROR, _bad(sensor)
    if sensor.stuck:
        return Level.ERROR, str(stuck())
    if sensor.bad:
        return Level.WARN, _bad(sensor)
    if now_s - sensor.doubled_s < sensor.silent_after_s:
        used = sender(sensor.source, sensor.publisher)
        return Level.WARN, doubled((used, sensor.doubled_by), used)
    if sensor.repeated > sensor.good:
        return Level.WARN, f"doubled: {sensor.source} sends each value twice; the second is left out"
    if text := _beyond(sensor, sensor.value):
        return Level.WARN, text
    if sensor.is_of_no_sensor:
        return Level.OK, f"0 degC from {sensor.source} so far, without any change: no sensor, left out"
    return Level.OK, f"reports, from {sensor.source}"


def _delay_of(source: str, last: Mapping[str, tuple[float, float]]) -> Diagnostic:
    """Condition of the largest delay of a source's publishers, of those that are heard at present."""
    newest_s = max((received_s for received_s, _ in last.values()), default=math.nan)
    delays = {name: delay_s for name, (at_s, delay_s) in last.items() if newest_s - at_s <= COUNTED_FOR_S}
    latest = max(delays, key=delays.__getitem__, default="")
    level, message = Level.OK, "in time"
    if (delay_s := delays.get(latest, 0.0)) > LATE_S:
        who = sender(source, latest)
        level = Level.WARN
        message = f"values of {who} come late, or its clock is behind; look at the link, and set both by the network"
    return Diagnostic(f"delay of {source}", level, message, {"delay_s": delay_s})


def _fix(sentence: str) -> str:
    """The advice at the end of a sentence about a fault."""
    return sentence.rpartition(";")[2]


def _bad(sensor: WatchedSensor) -> str:
    """Sentence about the values outside the limits since the last look; it stays the same while the fault lasts."""
    if not math.isfinite(sensor.bad_value):
        return str(no_number("in some of its values" if sensor.good else "in any of its values"))
    often = " now and then" if sensor.good else ""
    return _beyond(sensor, sensor.bad_value, f"{often}, which cannot be")


def _beyond(sensor: WatchedSensor, value: float, often: str = "") -> str:
    """Sentence about a value outside the plausible limits of this robot; "" if it is within them."""
    quantity = quantity_of(sensor.signal)
    return "".join(map(str, beyond_limits(quantity, value, value, sensor.plausible, "setup", often=often)))
