"""Recognition of a robot's signals by their names, units and values: the wiring of a setup, and questions to the user.

The names are matched by the table of quantities, like the column names of a log: `BMS_PackVoltage`, `Pack_I`,
`MotorRPM_FL`, `wheel_speed_rl`. A name is tried alone first, then behind the name of its message: `BMS.Current`.
"""

from __future__ import annotations

import itertools
import math
import re
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.battery_columns import cell_names
from ohmward.logs.channels import (
    BATTERY,
    BODY,
    CURRENT,
    MOTOR_CURRENT,
    TIME,
    WHEEL_COUNTS,
    WHEEL_SPEED,
    Channel,
    channel_for,
    channel_of,
    robot_words,
)
from ohmward.logs.columns import Column, UnclearColumnsError, find_column, listed
from ohmward.logs.units import UNITS, Unit, unit_of
from ohmward.logs.wheel_columns import POSITIONS, Found, Wheels, find_wheels, wheel_places
from ohmward.onboard.message import PLUS, ScaledSignal, unmeasured_wheels
from ohmward.quantities import QUANTITIES, limits_of, quantity_of
from ohmward.signals.current_sign import SignEvidence, sign_evidence
from ohmward.traction.robot.chassis import Steered
from ohmward.traction.robot.robot import Robot

#: Words for a motor, whose speed may be measured before the gear.
_MOTOR = frozenset(("motor", "mot", "mc", "esc", "vesc", "erpm"))

#: Channels that exist only as signals, not as columns of a log.
_OF_SIGNALS = tuple(
    channel_for(q._replace(words=q.signal_words))._replace(first_of_many=False)
    for q in QUANTITIES.values()
    if q.signal_words
)


#: Key of a number in an object that says nothing of its own: Victron's brokers send `{"value": 26.4}` on each topic.
NAMELESS = "#value"


class Offered(NamedTuple):
    """A number that a source offers."""

    name: str  #: as the setup calls it: "BMS.PackVoltage", "robot/bms#current"
    short: str  #: its name alone: "PackVoltage"
    unit: str = ""  #: unit given by its source; "" for none
    #: times [s] and values (n,) as heard or recorded; empty if it is known only from a database
    time_s: np.ndarray = np.empty(0)
    values: np.ndarray = np.empty(0)
    #: limits of its values in the database, nan if not given
    lowest: float = math.nan
    highest: float = math.nan

    @property
    def long(self) -> str:
        """Its name behind the name of its message, or the last two words of its topic."""
        return ".".join(re.split(r"[./#]", self.name.removesuffix(NAMELESS))[-2:])

    @property
    def range(self) -> tuple[float, float]:
        """Lowest and highest value, as heard or else from the database; nan if unknown."""
        finite = self.values[np.isfinite(self.values)]
        return (float(finite.min()), float(finite.max())) if finite.size else (self.lowest, self.highest)


def short_name(name: str) -> str:
    """Name of a number on a broker alone: its key, or the last word of its topic."""
    return name.removesuffix(NAMELESS).replace("#", "/").rpartition("/")[2]


class Question(NamedTuple):
    """Question to the user, and the option of `ohmward setup` that answers it."""

    text: str
    option: str  #: "--unit"
    example: str  #: example of its value, "wheel_speed=rpm"; the part before an equals sign is fixed


class Answers(NamedTuple):
    """Answers of the user."""

    signals: Mapping[str, str] = {}  #: signal -> name of an offered number
    units: Mapping[str, str] = {}  #: channel -> unit, `wheel_speed` -> "rpm"
    current_sign: str = "auto"  #: effect of a positive current: "charge", "discharge"; "auto" finds it from values
    shaft: str | None = None  #: "wheel" or "motor": shaft at which the speeds are measured
    counts_per_turn: float | None = None  #: of the encoders


class RecognisedSignals(NamedTuple):
    """The wiring of one source."""

    signals: Mapping[str, ScaledSignal]  #: in the order of the table of quantities
    questions: tuple[Question, ...]
    notes: tuple[str, ...]  #: what was assumed
    unused: tuple[str, ...]  #: names of offered numbers that are not wired


class _Match(NamedTuple):
    """Number that a signal is wired to, and the unit in its name."""

    offered: Offered
    unit: Unit | None


def recognise(offered: Sequence[Offered], robot: Robot | None, answers: Answers) -> RecognisedSignals:
    """The signals among the numbers that a source offers.

    robot: its wheels are looked for; None takes the wheels as they are named.

    Raises:
        InputError: an answer names a number that is not offered, or a unit that does not fit the quantity.
    """
    found = _Finder(offered, robot, answers)
    found.find()
    signals: dict[str, ScaledSignal] = {}
    for signal, match in sorted(found.matches.items(), key=lambda item: _order(item[0])):
        signals[signal] = found.scaled(signal, match)
    used = {name for signal in signals.values() for name in signal.name.split(PLUS)}
    unused = tuple(one.name for one in offered if one.name not in used)
    return RecognisedSignals(signals, tuple(found.questions), tuple(found.notes), unused)


def ask_wheels(robot: Robot, signals: Collection[str], others: Sequence[Offered]) -> list[Question]:
    """A question for each driven wheel of which no source sends the speed or the counts.

    signals: those wired so far.  others: numbers that are not.
    """
    questions = []
    others = [one for one in others if _may_be(one, WHEEL_SPEED) or _may_be(one, WHEEL_COUNTS)]
    speeds = [one.name for one in others if unit_of(one.unit)]
    for place in unmeasured_wheels(signals, robot):
        near = [one.name for one in others if set(place.split("_")) <= set(robot_words(one.long))] or speeds
        which = f"is it {near[0]!r}" if len(near) == 1 else f"which one is it{', ' * bool(near)}{listed(near)}"
        text = f"no source sends the speed of the wheel {place!r}: {which}?"
        example = near[0] if len(near) == 1 else "NAME"
        questions.append(Question(text, "--signal", f"wheel_speed_rad_s.{place}={example}"))
    return questions


def _order(signal: str) -> tuple[int, str]:
    """Sort key of a signal in a setup: order of the table of quantities, then name or number of the part."""
    name, _, part = signal.partition(".")
    return list(QUANTITIES).index(name), f"{int(part):04d}" if part.isdecimal() else part


class _Finder:
    """Matches of one source, quantity after quantity: a number matched once is not offered to later quantities."""

    def __init__(self, offered: Sequence[Offered], robot: Robot | None, answers: Answers):
        self.offered, self.robot, self.answers = list(offered), robot, answers
        self.matches: dict[str, _Match] = {}
        self.questions: list[Question] = []
        self.notes: list[str] = []
        self._unclear: dict[str, UnclearColumnsError] = {}

    def find(self) -> None:
        """Match wheels and motors first, whose currents are not the battery's; then cells, battery and body."""
        self._take_answers()
        finders: tuple[Callable[[Mapping[str, Offered]], None], ...] = (self._wheels, self._cells, self._single)
        for find in finders:
            for long in (False, True):
                find(self._texts(long))
        found = {quantity_of(signal).channel for signal in self.matches}
        of_battery = any(quantity_of(signal).group == "battery" for signal in self.matches)
        if self.robot:
            self._unclear.pop(WHEEL_SPEED.name, None)  # `ask_wheels` asks, for each wheel
        for channel, error in self._unclear.items():
            is_missing = error.faults[next(iter(error.faults))].startswith("no column")
            if channel not in found and (of_battery or not is_missing):
                self._ask_which(channel, error)
        self._ask_shaft()
        self._ask_units()
        self._ask_sign()

    def _take_answers(self) -> None:
        for signal, name in self.answers.signals.items():
            quantity_of(signal)
            parts = []
            for part in name.split(PLUS):
                one = next((one for one in self.offered if part in (one.name, one.short)), None)
                if one is None:
                    known = listed([o.name for o in self.offered])
                    raise InputError(f"{signal}: there is no {part!r}; there are {known}")
                parts.append(one)
            one = parts[0]
            if len(parts) > 1:
                if {other.unit for other in parts} != {one.unit}:
                    raise InputError(f"{signal}: {name} have different units; only numbers in one unit can be added")
                one = Offered(PLUS.join(other.name for other in parts), one.short, one.unit)
            self.matches[signal] = _Match(one, unit_of(one.unit) if one.unit else None)

    def _texts(self, long: bool) -> dict[str, Offered]:
        """Numbers not matched yet, by unique names with units in the form of a log's column names."""
        taken = {id(match.offered) for match in self.matches.values()}
        texts = {id(one): _column(one, long) for one in self.offered}
        counts = Counter(texts.values())
        return {texts[id(o)]: o for o in self.offered if id(o) not in taken and counts[texts[id(o)]] == 1}

    def _wheels(self, texts: Mapping[str, Offered]) -> None:
        """Speeds or counts of wheels, and currents of motors."""
        robot = self.robot
        places = tuple(p.name for p in robot.places) if robot else wheel_places(list(texts))
        if not places:
            return
        steered = robot is not None and isinstance(robot.chassis, Steered)
        wheels = Wheels(places, robot.driven if robot else len(places), steered)
        for kind in (WHEEL_SPEED, WHEEL_COUNTS, MOTOR_CURRENT):
            taken = {signal.partition(".")[0] for signal in self.matches}
            if kind is WHEEL_COUNTS and taken & {"wheel_speed_rad_s", "wheel_counts"}:
                continue
            try:
                found = self._of_kind(kind, list(texts), wheels)
            except UnclearColumnsError as error:
                self._unclear[kind.name] = error
                continue
            if found.by_number:
                self.notes.append(f"each {kind.name} identified by its number alone, in the order {', '.join(places)}")
            for place, quantity in wheels.of(kind).items():
                if column := found.columns.get(quantity):
                    self._add_wheel(kind, place if robot else str(places.index(place)), column, texts)

    def _of_kind(self, kind: Channel, names: Sequence[str], wheels: Wheels) -> Found:
        """Columns of wheels; if both wheel and motor report a speed, the wheel's is used, behind the gear."""
        try:
            return find_wheels("", names, kind, wheels, ())
        except UnclearColumnsError:
            of_wheels = [name for name in names if not _MOTOR & set(robot_words(name))]
            found = find_wheels("", of_wheels, kind, wheels, ())
            if not found.columns:
                raise
            return found

    def _add_wheel(self, kind: Channel, place: str, column: Column, texts: Mapping[str, Offered]) -> None:
        unit = column.unit or (unit_of("rpm") if "rpm" in robot_words(column.name) else None)  # as in `MotorRPM_FL`
        counted = kind is WHEEL_COUNTS or (unit is not None and unit.dimension in POSITIONS)
        name = "motor_current_A" if kind is MOTOR_CURRENT else "wheel_counts" if counted else "wheel_speed_rad_s"
        self.matches.setdefault(f"{name}.{place}", _Match(texts[column.name], unit))

    def _cells(self, texts: Mapping[str, Offered]) -> None:
        """Match voltages of cells, which have the word "cell" in their names and count from 0 or 1."""
        rows = [name for name in cell_names(list(texts)) if "cell" in name.lower()]
        if any(signal.startswith("cell_voltage_V") for signal in self.matches):
            return
        for k, name in enumerate(rows):
            self.matches[f"cell_voltage_V.{k}"] = _Match(texts[name], unit_of(texts[name].unit))

    def _single(self, texts: Mapping[str, Offered]) -> None:
        names = {quantity.channel: name for name, quantity in QUANTITIES.items() if not quantity.each}
        for channel in (*BATTERY, *BODY, *_OF_SIGNALS):
            signal = names.get(channel.name, "")
            if channel is TIME or not signal or signal in self.matches:
                continue
            free = [n for n, one in texts.items() if all(one is not match.offered for match in self.matches.values())]
            try:
                column = find_column("", free, channel, {}, {})
            except UnclearColumnsError as error:
                self._unclear[channel.name] = error
                continue
            if column:
                self.matches[signal] = _Match(texts[column.name], column.unit)

    def _ask_which(self, channel: str, error: UnclearColumnsError) -> None:
        signal = next((n for n, q in QUANTITIES.items() if q.channel == channel), channel)
        texts = {_column(one, long): one.name for one in self.offered for long in (True, False)}
        names = [texts[name] for name in error.choice.values() if name in texts]
        tied = [texts.get(name, name) for name in dict.fromkeys(itertools.chain(*error.ties.values()))]
        text = f"{listed(tied)} may each be the {channel}: which one is it?"
        if not tied:
            text = f"no signal of the {channel} found: which one is it?"
            if not any(_may_be(one, channel_of(channel)) for one in self._texts(long=True).values()):
                self.notes.append(
                    f"nothing that is offered can be the {channel}: estimates without it are less certain"
                )
                return
        elif channel == CURRENT.name:
            text += " That of batteries in parallel is the sum: NAME + NAME"
        part = "" if not QUANTITIES[signal].each else ".NAME"
        self.questions.append(Question(text, "--signal", f"{signal}{part}={(names or ['NAME'])[0]}"))

    def _ask_shaft(self) -> None:
        """Ask whether speeds named after motors are measured before the gear."""
        speeds = [m.offered for s, m in self.matches.items() if s.startswith(("wheel_speed", "wheel_counts"))]
        if electrical := [one.name for one in speeds if "erpm" in robot_words(one.long)]:
            self.notes.append(f"{listed(electrical)}: of the electrical turns; divide scale by the motor's pole pairs")
        of_motors = [one for one in speeds if _MOTOR & set(robot_words(one.long))]
        gear = self.robot.motor.gear_ratio if self.robot else 1.0
        if of_motors and gear != 1.0 and self.answers.shaft is None:
            text = f"is {of_motors[0].name} the speed of the motor, before the gear of {gear:g}, or of the wheel?"
            self.questions.append(Question(text, "--shaft", "motor"))
        counted = any(signal.startswith("wheel_counts") for signal in self.matches)
        if counted and self.answers.counts_per_turn is None:
            text = "how many counts has a turn of the wheel?"
            self.questions.append(Question(text, "--counts-per-turn", "4096"))

    def _ask_units(self) -> None:
        """Ask for units missing from the names, once for each channel; a battery's are assumed if the values allow."""
        asked: set[str] = set()
        for signal, match in list(self.matches.items()):
            quantity = quantity_of(signal)
            channel = quantity.channel
            if not match.unit and quantity.example.startswith("%") and match.offered.range[1] > quantity.limits.highest:
                self.matches[signal] = match._replace(unit=unit_of("%"))
                self.notes.append(f"{match.offered.name} has no unit: assumed to be %")
                continue
            if match.unit or channel in self.answers.units or channel in asked or quantity.unit in ("1", "counts", ""):
                continue
            own, fits = quantity.unit, _fitting(signal, match.offered, self.robot)
            if quantity.group == "battery" and own in fits:
                self.notes.append(f"{match.offered.name} has no unit: assumed to be {own}")
                continue
            asked.add(channel)
            proposed = fits[0] if fits else own
            units = ", ".join(fits or (quantity.example or own,))
            text = f"{match.offered.name} has no unit ({units}?)"
            self.questions.append(Question(text, "--unit", f"{channel}={proposed}"))

    def _ask_sign(self) -> None:
        """Find the sign of the current from values, or ask for it."""
        current, voltage = self.matches.get("battery_current_A"), self.matches.get("battery_voltage_V")
        if current is None or self.answers.current_sign != "auto":
            return
        evidence = _evidence(current.offered, voltage.offered) if voltage else None
        verdict = evidence.verdict if evidence else ""
        if verdict in ("charge", "discharge"):
            self.answers = self.answers._replace(current_sign=verdict)
            self.notes.append(f"{current.offered.name}: positive is {verdict}, as the voltage answers it")
            return
        likely = "charge" if evidence and evidence.edges.t_value > 0.0 else "discharge"
        text = f"does a positive {current.offered.name} charge or discharge the battery?"
        text += f" The voltage does not show it clearly: {evidence}" if evidence else ""
        self.questions.append(Question(text, "--current-sign", likely))

    def scaled(self, signal: str, match: _Match) -> ScaledSignal:
        """The signal with its scale and offset to the unit of the quantity."""
        quantity = quantity_of(signal)
        unit = match.unit
        if given := self.answers.units.get(quantity.channel):
            unit = unit_of(given)
            if unit is None or (unit.dimension != UNITS[quantity.unit.lower()].dimension and not _by_radius(unit)):
                raise InputError(
                    f"--unit {quantity.channel}={given}: no unit of the {quantity.label.lower()}; give one of "
                    f"{quantity.example or quantity.unit}"
                )
        scale, offset = (unit.scale, unit.offset) if unit and quantity.name != "wheel_counts" else (1.0, 0.0)
        if quantity.name == "wheel_speed_rad_s" and unit and _by_radius(unit):
            scale /= self.robot.wheel.radius_m if self.robot else 1.0
        if self.answers.shaft == "motor" and quantity.owner == "wheel" and self.robot:
            scale /= self.robot.motor.gear_ratio
        if quantity.name == "battery_current_A" and self.answers.current_sign == "discharge":
            scale = -scale
        return ScaledSignal(match.offered.name, scale, offset)


def _column(one: Offered, long: bool) -> str:
    """The name of a column with its unit."""
    stem = one.long if long else one.short
    return f"{stem} [{one.unit}]" if one.unit and unit_of(one.unit) else stem


def _may_be(one: Offered, channel: Channel) -> bool:
    """True for a number in a unit of the channel, or in none."""
    unit = unit_of(one.unit)
    return unit is None or unit.dimension in channel.dimensions


def _by_radius(unit: Unit) -> bool:
    """True for a speed of the rim, which is divided by the radius to give the wheel speed."""
    return unit.dimension == "speed"


def _evidence(current: Offered, voltage: Offered) -> SignEvidence | None:
    """Evidence of the current's sign from the voltage; None if either was not heard."""
    if len(current.values) < 2 or len(voltage.values) < 2:
        return None
    answered_V = np.interp(current.time_s, voltage.time_s, voltage.values)
    return sign_evidence(current.time_s, current.values, answered_V)


def _fitting(signal: str, one: Offered, robot: Robot | None) -> list[str]:
    """Units of the table's examples in which the values are possible for the quantity; all if no values are known."""
    quantity = quantity_of(signal)
    low, high = limits_of(quantity.name, None, robot)
    units = [unit for word in re.split(", | or ", quantity.example) if (unit := unit_of(word))]
    of_speed = [unit for unit in units if unit.dimension not in ("turn", "angle", "length") or quantity.unit == "rad"]
    lowest, highest = one.range
    if not (math.isfinite(lowest) and math.isfinite(highest)):
        return [unit.symbol for unit in of_speed]
    radius_m = robot.wheel.radius_m if robot else 1.0

    def is_possible(unit: Unit) -> bool:
        scale = unit.scale / (radius_m if quantity.owner == "wheel" and _by_radius(unit) else 1.0)
        return low <= scale * lowest + unit.offset and scale * highest + unit.offset <= high

    return [unit.symbol for unit in of_speed if is_possible(unit)]
