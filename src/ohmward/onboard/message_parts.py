"""Parts of a message: which of its signals are of the battery, of the drive, or estimates of a microcontroller.

A quantity of the table that no estimator takes goes beside the next sample of its battery or drive.

A source sends messages of a few kinds again and again, so that each kind, known by the names of its signals, is sorted
once.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from ohmward.quantities import BODY, GROUPS, QUANTITIES, Quantity, quantity_of
from ohmward.traction.inbox import WHEELS
from ohmward.traction.robot.robot import Robot

#: Kinds of messages that are remembered; a robot has a dozen, and somebody who sends at random must not fill memory.
MOST_KINDS = 256


class MessageParts(NamedTuple):
    """Signals of one kind of message."""

    battery: bool  #: has any of the battery
    #: argument of `SensorInbox.put`, and the signal of each wheel or motor, "" where there is none
    wheels: tuple[tuple[str, tuple[str, ...]], ...]
    body: tuple[str, ...]  #: signals of the body, which are arguments themselves
    reported: tuple[str, ...]  #: estimates of a microcontroller
    #: of the "battery" and of the "drive": signals that no estimator takes, and their names in a state
    beside: Mapping[str, Mapping[str, str]]

    @property
    def drive(self) -> bool:
        """True where the message has any signal of the drive."""
        return bool(self.wheels or self.body)

    def drive_message(self, values: Mapping[str, float]) -> dict[str, Any]:
        """Keyword arguments of `SensorInbox.put`; nan in the place of a wheel that the message does not tell of."""
        message: dict[str, Any] = {name: values[name] for name in self.body}
        for argument, signals in self.wheels:
            message[argument] = [values[signal] if signal else math.nan for signal in signals]
        return message


class MessageSorter:
    """The parts of messages to one robot.

    Args:
        robot: None without a drive.
        counted: the inbox takes counts of encoders; they are passed over otherwise.
    """

    def __init__(self, robot: Robot | None, counted: bool):
        self._robot = robot
        self._counted = counted
        self._kinds: dict[tuple[str, ...], MessageParts] = {}

    def parts(self, values: Mapping[str, float]) -> MessageParts:
        """The parts of a message with these signals."""
        names = tuple(values)
        found = self._kinds.get(names)
        if found is None:
            if len(self._kinds) >= MOST_KINDS:
                self._kinds.clear()
            found = self._kinds[names] = self._sort(names)
        return found

    def _sort(self, names: Sequence[str]) -> MessageParts:
        body: list[str] = []
        wheels: dict[str, list[str]] = {}
        beside: dict[str, dict[str, str]] = {group: {} for group in GROUPS}
        known = {signal: QUANTITIES[name] for signal in names if (name := signal.partition(".")[0]) in QUANTITIES}
        for signal, quantity in known.items():
            argument = quantity.name.removeprefix("motor_")
            places = places_of(quantity, self._robot)
            wheel = wheel_number(signal, places)
            if quantity.name in BODY:
                body.append(signal)
            elif argument in WHEELS:
                if wheel is not None and (argument != "wheel_counts" or self._counted):
                    wheels.setdefault(argument, [""] * len(places))[wheel] = signal
            elif quantity.group and not quantity.estimated_from:
                name = signal if wheel is None else f"{quantity.name}.{places[wheel]}"
                beside[quantity.group][signal] = name
        return MessageParts(
            any(quantity.group == "battery" for quantity in known.values()),
            tuple((argument, tuple(signals)) for argument, signals in wheels.items()),
            tuple(body),
            tuple(signal for signal in names if signal.startswith("estimate.")),
            beside,
        )


def places_of(quantity: Quantity, robot: Robot | None) -> tuple[str, ...]:
    """Names of the robot's wheels that have a quantity; none for one that is not of wheels or motors."""
    if robot is None or quantity.owner not in ("wheel", "motor"):
        return ()
    return tuple(place.name for place in robot.places)[: robot.driven if quantity.owner == "motor" else None]


def wheel_number(signal: str, places: Sequence[str]) -> int | None:
    """Number of the wheel that a signal is of, by the wheel's name or number; None where there is none such."""
    part = signal.partition(".")[2]
    if part in places:
        return places.index(part)
    return int(part) if part.isdecimal() and int(part) < len(places) else None


def no_such_part(signal: str, robot: Robot | None) -> str:
    """Sentence about a wheel or motor that the robot does not have; "" where it has it."""
    quantity = quantity_of(signal)
    places = places_of(quantity, robot)
    if not places or wheel_number(signal, places) is not None:
        return ""
    return f"the robot has no such {quantity.each}; it has {', '.join(places)}"
