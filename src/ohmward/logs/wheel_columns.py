"""The columns of a drive: the speed of each wheel, the current of each motor, and the sensors of the body."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

from ohmward.errors import InputError
from ohmward.logs.channels import (
    BODY,
    CORNERS,
    MOTOR_CURRENT,
    SIDES,
    TIME,
    WHEEL,
    WHEEL_COUNTS,
    WHEEL_SPEED,
    Channel,
    channel_of,
    robot_words,
)
from ohmward.logs.columns import Column, argument, find_column, given_unit, guess, listed, named_column, only_one
from ohmward.logs.units import split_unit
from ohmward.logs.wheel_speed import POSITIONS

_CORNERS_IN_ORDER = ("front", "rear", "left", "right")


class Wheels(NamedTuple):
    """The wheels that are looked for: their names, driven ones first, and the number of driven ones."""

    places: Sequence[str]
    driven: int

    @property
    def driven_places(self) -> Sequence[str]:
        """The names of the driven wheels."""
        return self.places[: self.driven]

    def of(self, channel: Channel) -> dict[str, str]:
        """Place -> quantity of every wheel that has the channel; a motor's current only the driven ones have."""
        places = self.driven_places if channel is MOTOR_CURRENT else self.places
        return {place: f"{place}_{channel.name}" for place in places}

    @property
    def quantities(self) -> tuple[str, ...]:
        """Every channel that a file may have, by name."""
        of_wheels = [quantity for channel in WHEEL for quantity in self.of(channel).values()]
        return (TIME.name, *of_wheels, *(channel.name for channel in BODY))


class Found(NamedTuple):
    """columns: channel -> column, several wheels may share one; by_number: wheels were told by their numbers alone."""

    columns: dict[str, Column]
    by_number: bool


class _OfWheel(NamedTuple):
    """A column that may be a channel of a wheel: of which `corner`, or of the wheel with which `number`."""

    column: Column
    corner: frozenset[str]
    number: int | None


def find_drive_columns(
    source: str,
    names: Sequence[str],
    wheels: Wheels,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    leave: Collection[str] = (),
) -> Found:
    """The column of each channel, by its name.

    `front_left_wheel_speed_rad_s`, `omega_fl`, `v_fl`, `left_wheel_vel`, `velL`, `wl`, `m1vel`, `velocity[0]`; `curL`,
    `m1cur`; `gyro_z`, `wz`, `imu_acceleration_x`, `pitch_deg`, `gnss_speed`. A left and a right one serve all driven
    wheels of their side. Names with words that are not known (`cmd_left`, `m1setvel`) are left alone.

    source: the file's name, for messages.  names: the columns of the file.
    columns: channel -> column, where the caller knows better; `left_wheel_speed` means all driven wheels of that side.
    units: channel or kind (`wheel_speed`) -> unit, where the names are silent or wrong.
    leave: columns that are not to be guessed: truths.

    Raises:
        InputError: no time or no wheel speed, two columns fit equally well, or an override names what does not exist.
    """
    units = units or {}
    given = {quantity: name for key, name in (columns or {}).items() for quantity in _meant(key, wheels)}
    _require_units(units, wheels)
    time = find_column(source, names, TIME, given, units, leave)
    free = [name for name in names if name not in {*leave, *given.values(), time and time.name}]
    speeds = find_wheels(source, free, WHEEL_SPEED, wheels, given)
    if not speeds.columns:
        speeds = find_wheels(source, free, WHEEL_COUNTS, wheels, given)
    currents = find_wheels(source, free, MOTOR_CURRENT, wheels, given)
    body = {channel.name: find_column(source, free, channel, {}, {}) for channel in BODY if channel.name not in given}
    named = {quantity: named_column(source, names, quantity, name) for quantity, name in given.items()}
    found = {TIME.name: time, **speeds.columns, **currents.columns, **body, **named}
    if not any(quantity in found for quantity in wheels.of(WHEEL_SPEED).values()):
        raise _no_wheels(source, names, wheels)
    chosen = {quantity: _with_unit(column, quantity, units) for quantity, column in found.items() if column}
    return Found(chosen, speeds.by_number or currents.by_number)


def wheel_places(names: Sequence[str]) -> tuple[str, ...]:
    """Names of the wheels whose speeds or positions the columns are, front and left ones first; () for fewer than two.

    They are corners or sides, `front_left`, `right`, or where the columns have none, numbers.
    """
    found = [one for name in names if (one := _of_wheel(name, WHEEL_SPEED) or _of_wheel(name, WHEEL_COUNTS))]
    corners = {"_".join(word for word in _CORNERS_IN_ORDER if word in one.corner) for one in found if one.corner}
    numbers = {str(one.number) for one in found if one.number is not None and not one.corner}
    places = sorted(corners, key=lambda place: [_CORNERS_IN_ORDER.index(word) for word in place.split("_")])
    chosen = tuple(places or sorted(numbers, key=int))
    return chosen if len(chosen) > 1 else ()


def _meant(quantity: str, wheels: Wheels) -> list[str]:
    """The channels that a name in --column stands for; InputError where this robot has no such channel."""
    if quantity in wheels.quantities:
        return [quantity]
    side, _, kind = quantity.partition("_")
    served = [place for place in wheels.driven_places if side in place.split("_")]
    if side not in SIDES or kind not in [channel.name for channel in WHEEL] or not served:
        raise InputError(
            f"unknown quantity {quantity!r}{guess(quantity, wheels.quantities)}; this robot has "
            f"{', '.join(wheels.quantities)}"
        )
    return [f"{place}_{kind}" for place in served]


def _require_units(units: Mapping[str, str], wheels: Wheels) -> None:
    """Raise InputError for a unit that is not known, or is of a channel that the robot does not have."""
    for key, spelling in units.items():
        if key not in [channel.name for channel in (TIME, *WHEEL, *BODY)]:
            _meant(key, wheels)
        given_unit(key, spelling)


def find_wheels(source: str, names: Sequence[str], channel: Channel, wheels: Wheels, given: Collection[str]) -> Found:
    """The columns of one channel of the wheels: by their corners, and only if there are none by their numbers.

    given: channels that are not looked for.

    Raises:
        UnclearColumnsError: two columns fit a wheel equally well.
    """
    wanted = {place: quantity for place, quantity in wheels.of(channel).items() if quantity not in given}
    candidates = [found for name in names if (found := _of_wheel(name, channel))]
    for find in (_by_corner, _by_number):
        fits = {place: find(candidates, place, wheels) for place in wanted}
        columns = {
            wanted[place]: only_one(source, names, wanted[place], found) for place, found in fits.items() if found
        }
        if columns:
            return Found(columns, find is _by_number)
    return Found({}, False)


def _by_corner(candidates: Sequence[_OfWheel], place: str, wheels: Wheels) -> list[Column]:
    """The columns of the corner of a wheel, or else of the side of a driven one."""
    corner = set(place.split("_"))
    exact = [c.column for c in candidates if c.corner and c.corner == corner]
    if exact or place not in wheels.driven_places:
        return exact
    return [c.column for c in candidates if c.corner and c.corner == corner & SIDES]


def _by_number(candidates: Sequence[_OfWheel], place: str, wheels: Wheels) -> list[Column]:
    """The columns of a wheel in the robot's order, counted from 0 or 1; two numbers for four driven ones are sides."""
    numbered = [c for c in candidates if c.number is not None and not c.corner]
    numbers = {c.number for c in numbered}
    sides = len(numbers) == 2 and wheels.driven == 4
    index = int("left" not in place) if sides else list(wheels.places).index(place)
    first = 0 if 0 in numbers else 1
    return [c.column for c in numbered if c.number == first + index]


def _of_wheel(name: str, channel: Channel) -> _OfWheel | None:
    """The name as a channel of a wheel, if all its words are known and one of them says so, or the unit of a speed."""
    naming = frozenset[str]().union(*channel.words)
    counts = channel is WHEEL_COUNTS
    angles = [(stem, unit) for stem, unit in split_unit(name) if unit and unit.dimension in ("angle", "length")]
    for stem, unit in [*angles, (name, channel.default)] if counts else split_unit(name):
        if unit and (unit.dimension not in channel.dimensions or (unit.dimension in POSITIONS and not counts)):
            continue
        words = robot_words(stem)
        corner = CORNERS & set(words)
        numbers = [int(word) for word in words if word.isdecimal()]
        rest = {word for word in words if word not in corner and not word.isdecimal()}
        named = bool(rest & naming) or (channel is WHEEL_SPEED and unit is not None)
        known = rest <= naming | channel.beside[0] and len(numbers) <= 1
        if named and known and (corner or numbers):
            return _OfWheel(Column(name, unit), corner, numbers[0] if numbers else None)
    return None


def _with_unit(column: Column, quantity: str, units: Mapping[str, str]) -> Column:
    """The column with the unit that was given for this channel, for its side, or for its kind."""
    kind = channel_of(quantity).name
    sides = [f"{side}_{kind}" for side in SIDES if side in quantity.split("_")]
    key = next((key for key in (quantity, *sides, kind) if key in units), None)
    return column._replace(unit=given_unit(quantity, units[key])) if key else column


def _no_wheels(source: str, names: Sequence[str], wheels: Wheels) -> InputError:
    sides = {side: [name for name in names if SIDES & set(robot_words(name)) == {side}] for side in ("left", "right")}
    chosen = {f"{side}_{WHEEL_SPEED.name}": of_side[0] for side, of_side in sides.items() if len(of_side) == 1}
    if len(chosen) < len(sides) or not any(SIDES & set(place.split("_")) for place in wheels.driven_places):
        chosen = {}
    given = chosen or {f"{wheels.places[0]}_{WHEEL_SPEED.name}": "NAME"}
    options = [f"{quantity}={name}" for quantity, name in given.items()]
    return InputError(
        f"{source}: no column for the speed of a wheel found; it has: {listed(names)}; name each with "
        f"{' '.join(f'--column {argument(option)}' for option in options)} (columns={given}), and its unit with --unit "
        "wheel_speed=rpm, rad/s, m/s, rad, m or counts",
        [word for option in options if chosen for word in ("--column", option)],
    )
