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
from ohmward.logs.columns import Column, find_column, given_unit, guess, listed, named_column, only_one
from ohmward.logs.units import split_unit

_KINDS = tuple(channel.name for channel in (TIME, *WHEEL, *BODY))


class Wheels(NamedTuple):
    """The wheels that are looked for: their names, driven ones first, and the number of driven ones."""

    places: Sequence[str]
    driven: int

    @property
    def driven_places(self) -> Sequence[str]:
        """The names of the driven wheels."""
        return self.places[: self.driven]

    @property
    def quantities(self) -> tuple[str, ...]:
        """Every channel that a file may have, by name."""
        speeds = (f"{place}_{WHEEL_SPEED.name}" for place in self.places)
        currents = (f"{place}_{MOTOR_CURRENT.name}" for place in self.driven_places)
        return (TIME.name, *speeds, *currents, *(channel.name for channel in BODY))


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
    for key, spelling in units.items():
        if key not in _KINDS:
            _meant(key, wheels)
        given_unit(key, spelling)
    found: dict[str, Column | None] = {TIME.name: find_column(source, names, TIME, given, units, leave)}
    taken = {column.name for column in found.values() if column} | {*leave, *given.values()}
    free = [name for name in names if name not in taken]
    speeds = _find_wheels(source, free, WHEEL_SPEED, wheels.places, wheels, given)
    if not speeds.columns:
        speeds = _find_wheels(source, free, WHEEL_COUNTS, wheels.places, wheels, given)
    currents = _find_wheels(source, free, MOTOR_CURRENT, wheels.driven_places, wheels, given)
    found |= speeds.columns | currents.columns
    found |= {channel.name: find_column(source, free, channel, {}, {}) for channel in BODY if channel.name not in given}
    found |= {key: named_column(source, names, key, name) for key, name in given.items()}
    if not any(quantity.endswith(WHEEL_SPEED.name) for quantity in found):
        raise _no_wheels(source, names, wheels)
    chosen = {quantity: _with_unit(column, quantity, units) for quantity, column in found.items() if column}
    return Found(chosen, speeds.by_number or currents.by_number)


def _meant(quantity: str, wheels: Wheels) -> list[str]:
    """The channels that a name in --column stands for.

    Raises:
        InputError: this robot has no such channel.
    """
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


def _find_wheels(
    source: str, names: Sequence[str], channel: Channel, places: Sequence[str], wheels: Wheels, given: Collection[str]
) -> Found:
    """The columns of the wheels at these places: by their corners, and only if there are none by their numbers."""
    wanted = [place for place in places if f"{place}_{channel.name}" not in given]
    candidates = [found for name in names if (found := _of_wheel(name, channel))]
    fits = _by_corner(candidates, wanted, wheels)
    by_number = not any(fits.values())
    if by_number:
        fits = _by_number(candidates, wanted, wheels)
    quantities = {f"{place}_{channel.name}": columns for place, columns in fits.items() if columns}
    columns = {quantity: only_one(source, quantity, columns) for quantity, columns in quantities.items()}
    return Found(columns, by_number and bool(columns))


def _by_corner(candidates: Sequence[_OfWheel], wanted: Sequence[str], wheels: Wheels) -> dict[str, list[Column]]:
    """Wheels by their corner; driven ones also by their side."""
    fits = {}
    for place in wanted:
        corner = set(place.split("_"))
        fits[place] = [c.column for c in candidates if c.corner and c.corner == corner]
        if not fits[place] and place in wheels.driven_places:
            fits[place] = [c.column for c in candidates if c.corner and c.corner == corner & SIDES]
    return fits


def _by_number(candidates: Sequence[_OfWheel], wanted: Sequence[str], wheels: Wheels) -> dict[str, list[Column]]:
    """Wheels in the robot's order, counted from 0 or 1; two numbers for four driven wheels are the sides."""
    numbered = [c for c in candidates if c.number is not None and not c.corner]
    numbers = {c.number for c in numbered}
    first = 0 if 0 in numbers else 1
    sides = len(numbers) == 2 and wheels.driven == 4
    fits = {}
    for index, place in enumerate(wheels.places):
        number = first + (("left" not in place) if sides else index)
        fits[place] = [c.column for c in numbered if c.number == number]
    return {place: fits[place] for place in wanted}


def _of_wheel(name: str, channel: Channel) -> _OfWheel | None:
    """The name as a channel of a wheel, if all its words are known and one of them says so, or the unit of a speed."""
    naming = frozenset[str]().union(*channel.words)
    counts = channel is WHEEL_COUNTS
    for stem, unit in [(name, channel.default)] if counts else split_unit(name):
        if unit and (unit.dimension not in channel.dimensions or (unit.dimension == "turn" and not counts)):
            continue
        words = robot_words(stem)
        corner = CORNERS & set(words)
        numbers = [int(word) for word in words if word.isdecimal()]
        rest = {word for word in words if word not in corner and not word.isdecimal()}
        told = bool(rest & naming) or (channel is WHEEL_SPEED and unit is not None)
        known = rest <= naming | channel.beside[0] and len(numbers) <= 1
        if told and known and (corner or numbers):
            return _OfWheel(Column(name, unit), corner, numbers[0] if numbers else None)
    return None


def _with_unit(column: Column, quantity: str, units: Mapping[str, str]) -> Column:
    """The column with the unit that was given for this channel, for its side, or for its kind."""
    kind = channel_of(quantity).name
    sides = [f"{side}_{kind}" for side in SIDES if side in quantity.split("_")]
    key = next((key for key in (quantity, *sides, kind) if key in units), None)
    return column._replace(unit=given_unit(quantity, units[key])) if key else column


def _no_wheels(source: str, names: Sequence[str], wheels: Wheels) -> InputError:
    option = f"{wheels.places[0]}_{WHEEL_SPEED.name}"
    return InputError(
        f"{source}: no column for the speed of a wheel found; it has: {listed(names)}; name each with "
        f"--column {option}=NAME (columns={{{option!r}: NAME}}), and its unit with --unit wheel_speed=rpm"
    )
