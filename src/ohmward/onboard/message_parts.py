"""Parts of a message: which of its signals are of the battery, of the drive, or estimates of a microcontroller.

A source sends messages of a few kinds again and again, so that each kind, known by the names of its signals, is sorted
once.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from ohmward.onboard.plausible import wheel_number
from ohmward.onboard.quantities import BATTERY, DRIVE, ESTIMATES
from ohmward.traction.robot.robot import Robot

_BATTERY, _DRIVE = ({quantity.name for quantity in group} for group in (BATTERY, DRIVE))
_REPORTED = f"{ESTIMATES[0].name}."

#: Kinds of messages that are remembered; a robot has a dozen, and somebody who sends at random must not fill memory.
MOST_KINDS = 256


class MessageParts(NamedTuple):
    """Signals of one kind of message."""

    battery: bool  #: has any of the battery
    #: argument of `SensorInbox.put`, and the signal of each wheel or motor, "" where there is none
    wheels: tuple[tuple[str, tuple[str, ...]], ...]
    body: tuple[str, ...]  #: signals of the body, which are arguments themselves
    reported: tuple[str, ...]  #: estimates of a microcontroller

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
        self._places = tuple(place.name for place in robot.places) if robot else ()
        self._driven = robot.driven if robot else 0
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
        for signal in names:
            name, _, part = signal.partition(".")
            if name not in _DRIVE or (name == "wheel_counts" and not self._counted):
                continue
            if not part:
                body.append(signal)
                continue
            argument = name.removeprefix("motor_")
            places = self._places[: self._driven] if argument == "current_A" else self._places
            if (wheel := wheel_number(signal, places)) is not None:
                wheels.setdefault(argument, [""] * len(places))[wheel] = signal
        return MessageParts(
            any(name.partition(".")[0] in _BATTERY for name in names),
            tuple((argument, tuple(signals)) for argument, signals in wheels.items()),
            tuple(body),
            tuple(name for name in names if name.startswith(_REPORTED)),
        )
