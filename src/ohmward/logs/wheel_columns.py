"""The columns of a drive: the speed of each wheel, the current of each motor, and the sensors of the body.

The speed of a wheel follows from a rotation, from the speed of its rim, or from the counts of its encoder.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, permutations
from typing import NamedTuple

import numpy as np

from ohmward.checks import require_positive
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
from ohmward.logs.table import Note, Table, counted
from ohmward.logs.units import UNITS, Unit, split_unit
from ohmward.signals.survey import find_gaps

#: Dimensions of a wheel's position, whose change is its speed.
POSITIONS = ("turn", "angle", "length")
_CORNERS_IN_ORDER = ("front", "rear", "left", "right")


class Wheels(NamedTuple):
    """The wheels to look for: their names, driven ones first, and the number of driven ones.

    steered: the speeds of the driven wheels may follow from one, of the first of them, and a steering angle.
    """

    places: Sequence[str]
    driven: int
    steered: bool = False

    @property
    def driven_places(self) -> Sequence[str]:
        """The names of the driven wheels."""
        return self.places[: self.driven]

    def of(self, channel: Channel) -> dict[str, str]:
        """Place -> quantity of every wheel that has the channel; only driven wheels have a motor current."""
        places = self.driven_places if channel is MOTOR_CURRENT else self.places
        return {place: f"{place}_{channel.name}" for place in places}

    @property
    def quantities(self) -> tuple[str, ...]:
        """Every channel that a file may have, by name."""
        of_wheels = [quantity for channel in WHEEL for quantity in self.of(channel).values()]
        return (TIME.name, *of_wheels, *(channel.name for channel in BODY))


class Found(NamedTuple):
    """columns: channel -> column, several wheels may share one; by_number: wheels were identified by number alone."""

    columns: dict[str, Column]
    by_number: bool


class _OfWheel(NamedTuple):
    """A column that may be a channel of a wheel, with the `corner` or the `number` of that wheel."""

    column: Column
    corner: frozenset[str]
    number: int | None
    place: str = ""  #: name of the wheel, from the name of a signal


#: Channels of the wheels by the names of their signals, whose quantity is first: `wheel_speed_rad_s.left`, in a
#: recording of ROS `wheel_speed_rad_s_left`.
_SIGNALS = {"wheel_speed_rad_s": WHEEL_SPEED, "wheel_counts": WHEEL_COUNTS, "motor_current_A": MOTOR_CURRENT}
_SIGNAL = re.compile(rf"(?P<quantity>{'|'.join(_SIGNALS)})[._](?P<place>.+)")


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
    `m1cur`; `gyro_z`, `wz`, `imu_acceleration_x`, `pitch_deg`, `gnss_speed`. A left and a right column serve all driven
    wheels of their side. Names with unknown words (`cmd_left`, `m1setvel`) are ignored.

    source: the file's name, for messages.  names: the columns of the file.
    columns: channel -> column, where the caller knows better; `left_wheel_speed` means all driven wheels of that side.
    units: channel or kind (`wheel_speed`) -> unit, where the names give none or a wrong one.
    leave: columns that must not be guessed, such as ground truth.

    Raises:
        InputError: no time or wheel speed, two columns fit equally well, or an override of something that is not there.
    """
    units = units or {}
    given = {quantity: name for key, name in (columns or {}).items() for quantity in _meant(key, wheels)}
    for key, spelling in units.items():
        if key not in [channel.name for channel in (TIME, *WHEEL, *BODY)]:
            _meant(key, wheels)
        given_unit(key, spelling)
    time = find_column(source, names, TIME, given, units, leave)
    not_measured = {"yaw_rad"} if "position_std_m" in names else set()  # of an estimated pose
    free = [name for name in names if name not in {*leave, *not_measured, *given.values(), time and time.name}]
    speeds = find_wheels(source, free, WHEEL_SPEED, wheels, given)
    if not speeds.columns:
        speeds = find_wheels(source, free, WHEEL_COUNTS, wheels, given)
    currents = Found({}, False) if wheels.steered else find_wheels(source, free, MOTOR_CURRENT, wheels, given)
    body = {channel.name: find_column(source, free, channel, {}, {}) for channel in BODY if channel.name not in given}
    named = {quantity: named_column(source, names, quantity, name) for quantity, name in given.items()}
    found = {TIME.name: time, **speeds.columns, **currents.columns, **body, **named}
    if not any(quantity in found for quantity in wheels.of(WHEEL_SPEED).values()):
        raise _no_wheels(source, names, wheels)
    chosen = {quantity: _with_unit(column, quantity, units) for quantity, column in found.items() if column}
    return Found(chosen, speeds.by_number or currents.by_number)


def wheel_places(names: Sequence[str]) -> tuple[str, ...]:
    """Names of the wheels that have a column of speed or position, front and left ones first; () for fewer than two.

    They are corners or sides, `front_left`, `right`, or where the columns have none, numbers; or the sides of two
    columns that do not say what they are of a wheel, `wheel_left`.
    """
    found = [one for name in names if (one := _of_wheel(name, WHEEL_SPEED) or _of_wheel(name, WHEEL_COUNTS))]
    corners = {"_".join(word for word in _CORNERS_IN_ORDER if word in one.corner) for one in found if one.corner}
    numbers = {str(one.number) for one in found if one.number is not None and not one.corner}
    places = sorted(corners, key=lambda place: [_CORNERS_IN_ORDER.index(word) for word in place.split("_")])
    chosen = tuple(places or sorted(numbers, key=int))
    of_wheels = [name for name in names if _place(name)[0] <= WHEEL_SPEED.beside[0]]
    return chosen if len(chosen) > 1 else tuple(columns_of_sides(of_wheels))


def _meant(quantity: str, wheels: Wheels) -> list[str]:
    """The channels that a name in --column stands for; InputError where this robot has no such channel."""
    if quantity in wheels.quantities:
        return [quantity]
    if wheels.steered and quantity == WHEEL_SPEED.name:
        return list(wheels.of(WHEEL_SPEED).values())[:1]
    side, _, kind = quantity.partition("_")
    served = [place for place in wheels.driven_places if side in place.split("_")]
    if side not in SIDES or kind not in [channel.name for channel in WHEEL] or not served:
        raise InputError(
            f"unknown quantity {quantity!r}{guess(quantity, wheels.quantities)}; this robot has "
            f"{', '.join(wheels.quantities)}"
        )
    return [f"{place}_{kind}" for place in served]


def find_wheels(source: str, names: Sequence[str], channel: Channel, wheels: Wheels, given: Collection[str]) -> Found:
    """The columns of one channel of the wheels, found by corner, or if there are none, by number.

    given: channels not to look for.
    """
    wanted = {place: quantity for place, quantity in wheels.of(channel).items() if quantity not in given}
    candidates = [found for name in names if (found := _of_wheel(name, channel))]
    if wheels.steered and not any(c.corner & SIDES for c in candidates):
        one = [found.column for name in names if (found := _of_wheel(name, channel, alone=True))]
        first = next(iter(wanted.values()), "")
        return Found({first: only_one(source, names, channel.name, one)} if one and first else {}, False)
    for find in (_by_corner, _by_number):
        fits = {place: find(candidates, place, wheels) for place in wanted}
        columns = {
            wanted[place]: only_one(source, names, wanted[place], found) for place, found in fits.items() if found
        }
        if columns:
            return Found(columns, find is _by_number)
    return Found({}, False)


def _by_corner(candidates: Sequence[_OfWheel], place: str, wheels: Wheels) -> list[Column]:
    """The columns of the name or the corner of a wheel, or else of the side of a driven one.

    A column of a side serves every driven wheel of it; a robot whose wheels are sides has one axle, whose columns may
    name it: `rear_left`.
    """
    corner = set(place.split("_"))
    exact = [c.column for c in candidates if c.place == place or (c.corner and c.corner == corner)]
    if exact or place not in wheels.driven_places:
        return exact
    if corner <= SIDES:
        return [c.column for c in candidates if c.corner & SIDES == corner]
    return [c.column for c in candidates if c.corner and c.corner == corner & SIDES]


def _by_number(candidates: Sequence[_OfWheel], place: str, wheels: Wheels) -> list[Column]:
    """The columns of a wheel in the robot's order, counted from 0 or 1; two numbers for four driven ones are sides.

    More numbers than wheels do not say which wheel is where: then there are none.
    """
    numbered = [c for c in candidates if c.number is not None and not c.corner]
    numbers = {c.number for c in numbered}
    if len(numbers) > len(wheels.places):
        return []
    sides = len(numbers) == 2 and wheels.driven == 4
    index = int("left" not in place) if sides else list(wheels.places).index(place)
    first = 0 if 0 in numbers else 1
    return [c.column for c in numbered if c.number == first + index]


def _of_wheel(name: str, channel: Channel, alone: bool = False) -> _OfWheel | None:
    """The name as a channel of a wheel, if all its words are known and one of them, or a unit of speed, names it.

    alone: it needs no corner and no number, but a word or a unit that tells it from the speed of the body.
    """
    if signal := _SIGNAL.fullmatch(name):
        if _SIGNALS[signal["quantity"]] is not channel:
            return None
        column = Column(name, channel.default)
        rest, corner, numbers = _place(signal["place"])
        if rest - channel.beside[0] or len(numbers) > 1:  # a word that is not known: the name of the place alone counts
            return _OfWheel(column, frozenset(), None, signal["place"])
        return _OfWheel(column, corner, next(iter(numbers), None), signal["place"])
    naming = frozenset[str]().union(*channel.words)
    counts = channel is WHEEL_COUNTS
    angles = [(stem, unit) for stem, unit in split_unit(name) if unit and unit.dimension in ("angle", "length")]
    for stem, unit in [*angles, (name, channel.default)] if counts else split_unit(name):
        if unit and (unit.dimension not in channel.dimensions or (unit.dimension in POSITIONS and not counts)):
            continue
        rest, corner, numbers = _place(stem)
        named = bool(rest & naming) or (channel is WHEEL_SPEED and unit is not None)
        known = rest <= naming | channel.beside[0] and len(numbers) <= 1
        of_rotation = bool(rest & channel.beside[0]) or (unit is not None and unit.dimension != "speed")
        if named and known and (corner or numbers or (alone and of_rotation)):
            return _OfWheel(Column(name, unit), corner, next(iter(numbers), None))
    return None


def _place(text: str) -> tuple[set[str], frozenset[str], list[int]]:
    """The words of a text, without those of a corner and without numbers; the corner; the numbers."""
    words = robot_words(text)
    corner = CORNERS & set(words)
    return (
        {word for word in words if word not in corner and not word.isdecimal()},
        corner,
        [int(word) for word in words if word.isdecimal()],
    )


def _with_unit(column: Column, quantity: str, units: Mapping[str, str]) -> Column:
    """The column with the unit that was given for this channel, for its side, or for its kind."""
    kind = channel_of(quantity).name
    key = next((key for key in (quantity, *_sides(quantity, kind), kind) if key in units), None)
    return column._replace(unit=given_unit(quantity, units[key])) if key else column


def _sides(quantity: str, kind: str) -> list[str]:
    return [f"{side}_{kind}" for side in SIDES if side in quantity.split("_")]


def columns_of_sides(names: Sequence[str]) -> dict[str, str]:
    """The only column that is named for each side, "left" and "right"; {} unless both have one."""
    sides = {side: [name for name in names if SIDES & set(robot_words(name)) == {side}] for side in ("left", "right")}
    return {side: found[0] for side, found in sides.items()} if all(len(f) == 1 for f in sides.values()) else {}


def _no_wheels(source: str, names: Sequence[str], wheels: Wheels) -> InputError:
    chosen = {f"{side}_{WHEEL_SPEED.name}": name for side, name in columns_of_sides(names).items()}
    if not any(SIDES & set(place.split("_")) for place in wheels.driven_places):
        chosen = {}
    one = WHEEL_SPEED.name if wheels.steered else f"{wheels.places[0]}_{WHEEL_SPEED.name}"
    given = chosen or {one: "NAME"}
    options = [f"{quantity}={name}" for quantity, name in given.items()]
    return InputError(
        f"{source}: no column for the speed of a wheel found; it has: {listed(names)}; name each with "
        f"{' '.join(f'--column {argument(option)}' for option in options)} (columns={given}), and its unit with --unit "
        "wheel_speed=rpm, rad/s, m/s, rad, m or counts",
        [word for option in options if chosen for word in ("--column", option)],
    )


#: Widths of counters that roll over within a drive.
WIDTHS = (8, 16, 32)


@dataclass(frozen=True)
class Mechanics:
    """The transmission from the measured shaft to the rim of the wheel; its numbers must be > 0."""

    radius_m: float | None = None  #: of the wheels, for speeds in m/s
    gear_ratio: float = 1.0  #: turns of the motor for one of the wheel
    at_motor_shaft: bool = False  #: speeds and counts are measured at the motor, before the gear
    counts_per_turn: float | None = None  #: of an encoder, for one turn of the shaft that it sits on

    def __post_init__(self) -> None:
        for name in ("radius_m", "gear_ratio", "counts_per_turn"):
            if (value := getattr(self, name)) is not None:
                require_positive(name, value)


def unit_of_channel(quantity: str, column: Column, mechanics: Mechanics) -> Unit:
    """The unit of a column, by default that of the channel.

    A wheel speed called `v` is in m/s; it is in counts if `counts_per_turn` is given or its name is that of a position.
    """
    if column.unit:
        return column.unit
    channel = channel_of(quantity)
    if channel is not WHEEL_SPEED:
        return channel.default
    words = set(robot_words(column.name))
    if mechanics.counts_per_turn is not None or words & _POSITION_WORDS:
        return UNITS["counts"]
    return UNITS["m/s"] if "v" in words else channel.default


#: Counts since the last row are recognised from this many rows, turns and counts on, if this share of steps reverses.
_FEWEST_ROWS, _FEWEST_TURNS, _FEWEST_COUNTS, _UP_AND_DOWN = 50, 3.0, 2.0, 0.2
#: Counts that never leave zero by more than this share of a turn are doubtful, and those that return to it this often.
_HARDLY, _OFTEN = 0.25, 3
#: Fewest rows for which counts stay at zero.
_FEWEST_AT_ZERO = 3
#: Smallest interval between rows as a share of the usual one; below 1, so that times of a drifting clock are kept.
_USUAL_SHARE = 0.98
#: Number of consecutive rows that show the usual interval even if they arrived in bursts.
_TOGETHER = 20
#: A row that arrives within this share of the interval at which it was measured is part of a burst.
_BURST = 1 / 3
_POSITION_WORDS = frozenset(word for words in WHEEL_COUNTS.words for word in words)


def wheel_speed(
    source: str, name: str, unit: Unit, values: np.ndarray, time_s: np.ndarray, mechanics: Mechanics
) -> tuple[np.ndarray, tuple[Note, ...]]:
    """The speed of a wheel (T,) [rad/s] from a column, and notes; InputError without the radius or counts it needs.

    source, name: of the file and the column, for messages.
    values: (T,) in `unit`.  time_s: (T,) [s], increasing.
    """
    if unit.dimension in ("speed", "length"):
        if mechanics.radius_m is None:
            raise InputError(
                f"{source}: {name!r} is in {unit.symbol}; give the wheels' radius (--radius, --robot, radius_m)"
            )
        at_rim = unit.in_si(values) / mechanics.radius_m
        return (at_rim if unit.dimension == "speed" else speed_from_angle(at_rim, time_s)), ()
    gear_ratio = mechanics.gear_ratio if mechanics.at_motor_shaft else 1.0
    if unit.dimension == "rotation":
        return unit.in_si(values) / gear_ratio, ()
    if unit.dimension == "angle":
        return speed_from_angle(unit.in_si(values), time_s) / gear_ratio, ()
    if mechanics.counts_per_turn is None and unit is UNITS["erpm"]:
        raise InputError(
            f"{source}: {name!r} counts electrical turns; give the motor's pole pairs, with --counts-per-turn 7 "
            "(counts_per_turn=7), and --motor-shaft (at_motor_shaft=True) if the wheel is behind a gear"
        )
    if mechanics.counts_per_turn is None:
        raise InputError(
            f"{source}: {name!r} counts the turns of a wheel; say how far with --counts-per-turn 4096 "
            "(counts_per_turn=4096), of positions in rad --unit wheel_speed=rad, or of a way at the rim --unit "
            "wheel_speed=m"
        )
    if unit.dimension == "turn rate":
        return unit.in_si(values) * (2 * math.pi / mechanics.counts_per_turn / gear_ratio), ()
    if are_since_last_row(values, mechanics.counts_per_turn):
        text = f"{name!r} does not grow along the drive: read as counts since the previous row, and added up"
        speed_rad_s, _ = speed_from_counts(np.nancumsum(values), time_s, mechanics.counts_per_turn)
        return speed_rad_s / gear_ratio, (Note(text, "warning"),)
    speed_rad_s, rolled = speed_from_counts(values, time_s, mechanics.counts_per_turn)
    notes: tuple[Note, ...] = (Note(f"{name!r}: {rolled}"),) if rolled else ()
    if not rolled and (times := returns_to_zero(values)) >= _OFTEN:
        text = f"{name!r} returns to zero {times} times, as the counts of a second do: then say --unit "
        notes += (Note(f"{text}wheel_speed=counts/s", "warning", ("--unit", "wheel_speed=counts/s")),)
    elif not rolled and _hardly_turn(values, mechanics.counts_per_turn):
        text = f"{name!r} stays within {np.nanmax(np.abs(values)) / mechanics.counts_per_turn:.2g} turns of zero"
        notes += (Note(f"{text}: if these are counts since the previous row, add them up in the file", "warning"),)
    return speed_rad_s / gear_ratio, notes


def _hardly_turn(counts: np.ndarray, counts_per_turn: float) -> bool:
    """True for counts (T,) that return to zero, and would be a drive only as those since the row before."""
    size = np.abs(counts[np.isfinite(counts)])
    return bool(
        size.size >= _FEWEST_ROWS
        and size.min() == 0.0
        and _FEWEST_COUNTS <= size.max() < _HARDLY * counts_per_turn
        and size.sum() >= _FEWEST_TURNS * counts_per_turn
    )


def returns_to_zero(counts: np.ndarray) -> int:
    """How often counts (T,) come to zero, stay there and leave it to the side that they came from."""
    known = counts[np.isfinite(counts)]
    first = np.flatnonzero(np.diff(known, prepend=np.nan) != 0.0)  # of each stretch of equal counts
    lasts = np.diff(first, append=known.size) >= _FEWEST_AT_ZERO
    before, here, after = known[first][:-2], known[first][1:-1], known[first][2:]
    return int(np.count_nonzero((here == 0.0) & lasts[1:-1] & (before * after > 0.0)))


def are_since_last_row(counts: np.ndarray, counts_per_turn: float) -> bool:
    """True for counts (T,) since the row before: within a turn of zero, and up and down all the time.

    A running counter reverses as seldom as the wheel does. Where the counts add up to no distance, it does not matter.
    """
    values = counts[np.isfinite(counts)]
    if values.size < _FEWEST_ROWS or counter_bits(values) is not None:
        return False
    if np.abs(values).max() > counts_per_turn or np.abs(values).sum() < _FEWEST_TURNS * counts_per_turn:
        return False
    ways = np.sign(np.diff(values))
    ways = ways[ways != 0.0]
    turns_round = np.count_nonzero(ways[1:] != ways[:-1])
    return bool(np.ptp(values) >= _FEWEST_COUNTS and turns_round > _UP_AND_DOWN * ways.size)


#: Units that columns of wheels may be in; the wheels of a drive turn alike, with this cosine between their speeds, and
#: of two in different units one so many times as fast, within this share.
_ROTATIONS, _RATIO_WITHIN, _SAME_DRIVE = (UNITS["rad/s"], UNITS["rpm"], UNITS["deg/s"]), 0.1, 0.8


def other_unit_notes(columns: Mapping[str, Column], speeds: Mapping[str, np.ndarray]) -> list[Note]:
    """A warning of wheels with one unit in their names, of which one turns so much faster as if it were in another one.

    columns, speeds: of the wheels by channel, (T,) in SI units.
    """
    for (one, a), (other, b) in combinations(columns.items(), 2):
        known = np.isfinite(speeds[one]) & np.isfinite(speeds[other])
        one_rad_s, other_rad_s = speeds[one][known], speeds[other][known]
        size, other_size = np.linalg.norm(one_rad_s), np.linalg.norm(other_rad_s)
        if a.unit != b.unit or known.sum() < _FEWEST_ROWS or not size * other_size > 0.0:
            continue
        ratio, cosine = size / other_size, abs(one_rad_s @ other_rad_s) / (size * other_size)
        for slow, fast in permutations(_ROTATIONS, 2):
            if cosine >= _SAME_DRIVE and abs(ratio * fast.scale / slow.scale - 1.0) <= _RATIO_WITHIN:
                keys = [(*_sides(quantity, WHEEL_SPEED.name), quantity)[0] for quantity in (one, other)]
                options = ("--unit", f"{keys[0]}={fast.symbol}", "--unit", f"{keys[1]}={slow.symbol}")
                text = f"{a.name!r} turns {ratio:.3g} times as fast as {b.name!r}: in {fast.symbol}, and that in "
                return [Note(f"{text}{slow.symbol}? then say {' '.join(options)}", "warning", options)]
    return []


def without_bursts(
    table: Table, time_s: np.ndarray, columns: Mapping[str, Column], mechanics: Mechanics
) -> tuple[np.ndarray, tuple[Note, ...]]:
    """Times (T,) of the measurements, where rows with positions of wheels arrived in bursts, and a note.

    Within a burst, the change of position over the time between two arrivals is not the speed.
    """
    positions = [
        table.columns[column.name]
        for quantity, column in columns.items()
        if channel_of(quantity) is WHEEL_SPEED and unit_of_channel(quantity, column, mechanics).dimension in POSITIONS
    ]
    if not positions:
        return time_s, ()
    known = np.isfinite(np.column_stack(positions)).all(axis=1)
    arrived_s = time_s[known]
    even_s = even_times(arrived_s)
    in_bursts = int(np.count_nonzero(np.diff(arrived_s) < _BURST * np.diff(even_s)))
    if not in_bursts:
        return time_s, ()
    text = f"{counted(in_bursts, 'row')} with positions of wheels arrived in bursts: their times are made even"
    moved_s = np.interp(time_s, arrived_s, even_s - arrived_s)
    return time_s + moved_s, (Note(text),)


def even_times(time_s: np.ndarray) -> np.ndarray:
    """Times (T,) [s] at which positions were measured, if that was at even intervals but they arrived in bursts.

    A row was measured no later than any row after it, less the usual interval for each step between the two. Rows that
    arrive evenly, or with pauses, keep their times.

    time_s: (T,) [s] of arrival, increasing.
    """
    if time_s.size < _FEWEST_ROWS:
        return time_s
    counted_s = _USUAL_SHARE * measured_interval_s(time_s) * np.arange(time_s.size)
    return np.minimum.accumulate((time_s - counted_s)[::-1])[::-1] + counted_s


def measured_interval_s(time_s: np.ndarray) -> float:
    """Usual interval [s] at which rows that may arrive in bursts, at times (T,) [s], were measured.

    Many rows together show it, from the last row of one burst to that of another: from any row to any other, the phase
    of the bursts would make it too long.
    """
    together_s = float(np.median(time_s[_TOGETHER:] - time_s[:-_TOGETHER])) / _TOGETHER
    last = np.flatnonzero(np.append(np.diff(time_s) >= _BURST * together_s, True))
    later = np.searchsorted(last, last + _TOGETHER)
    first, end = last[later < last.size], last[later[later < last.size]]
    return float(np.median((time_s[end] - time_s[first]) / (end - first))) if end.size else together_s


def speed_from_counts(counts: np.ndarray, time_s: np.ndarray, counts_per_turn: float) -> tuple[np.ndarray, str]:
    """The speed of a wheel (T,) [rad/s] from its encoder by `rate_of_change`; a clause on rollovers, "" for none.

    counts: (T,) whole numbers, NaN in rows without a new one.  time_s: (T,) [s], increasing.
    counts_per_turn: of the wheel, > 0.
    """
    values = counts[np.isfinite(counts)]
    bits = counter_bits(values)
    span = math.inf if bits is None else 2.0**bits
    speed = rate_of_change(time_s, counts, span, 2 * math.pi / counts_per_turn)
    steps = np.diff(values)
    rollovers = int(np.count_nonzero((steps >= span / 2) | (steps < -span / 2)))
    return speed, f"a counter of {bits} bits rolled over {rollovers} times: undone" if rollovers else ""


def speed_from_angle(angle_rad: np.ndarray, time_s: np.ndarray) -> np.ndarray:
    """The speed (T,) [rad/s] of a wheel from its position (T,) [rad], NaN in rows without a new one and after gaps.

    A position that stays within one turn is assumed to wrap where it jumps by more than half a turn.
    """
    known = angle_rad[np.isfinite(angle_rad)]
    is_within_turn = known.size and np.ptp(known) <= 2 * math.pi + 1e-6
    return rate_of_change(time_s, angle_rad, 2 * math.pi if is_within_turn else math.inf)


def rate_of_change(
    time_s: np.ndarray, values: np.ndarray, span: float = math.inf, scale: float = 1.0, over_gaps: bool = False
) -> np.ndarray:
    """Rate (T,) of `scale` times the values (T,) since the previous value; NaN in rows without a value.

    span: range after which the values wrap; changes are assumed to be the short way round.
    over_gaps: keep the rate over a gap; else it is NaN.
    """
    known = np.flatnonzero(np.isfinite(values))
    steps = np.diff(values[known])
    if math.isfinite(span):
        steps = np.mod(steps + span / 2, span) - span / 2
    rate = np.full(values.size, np.nan)
    rate[known[1:]] = scale * steps / np.diff(time_s[known])
    if not over_gaps:
        rate[known[1:][find_gaps(time_s[known])]] = np.nan
    return rate


def counter_bits(counts: np.ndarray) -> int | None:
    """Width of the counter that fits its values (N,) and jumps over half of its range; None if none does.

    A counter of b bits shows 0 to 2^b - 1, or with a sign -2^(b-1) to 2^(b-1) - 1.
    """
    if counts.size < 2:
        return None
    low, high = counts.min(), counts.max()
    jump = np.abs(np.diff(counts)).max()
    for bits in WIDTHS:
        span = 2.0**bits
        if (low >= 0 and high < span) or (-span / 2 <= low and high < span / 2):
            return bits if jump > span / 2 else None
    return None


def unit_notes(columns: Mapping[str, Column], mechanics: Mechanics) -> list[Note]:
    """Notes on the units of the channels of a drive, one for all columns of a kind with the same unit."""
    alike: dict[tuple[str, str, bool], list[str]] = {}
    for quantity, column in columns.items():
        key = channel_of(quantity).name, unit_of_channel(quantity, column, mechanics).symbol, column.unit is None
        alike.setdefault(key, []).append(column.name)
    notes = []
    for (kind, symbol, guessed), names in alike.items():
        unit = f"assumed to be in {symbol}, as the name gives no unit" if guessed else f"in {symbol}"
        doubtful = guessed and kind == WHEEL_SPEED.name and symbol == WHEEL_SPEED.default.symbol
        advice = "; for another say --unit wheel_speed=m/s, rpm or deg/s" if doubtful else ""
        text = f"{kind.replace('_', ' ')} from {listed(list(dict.fromkeys(names)))}, {unit}{advice}"
        notes.append(Note(text, "warning" if doubtful else "info"))
        if kind == WHEEL_SPEED.name:
            notes += _shaft_notes(UNITS[symbol], names, mechanics)
    return notes


def _shaft_notes(unit: Unit, names: list[str], mechanics: Mechanics) -> list[Note]:
    """A note on the shaft or rim at which wheel speeds are assumed to be measured, where that is not obvious."""
    gear = f"{mechanics.gear_ratio:g}"
    if unit.dimension in ("speed", "length"):
        quantity = "speed" if unit.dimension == "speed" else "way"
        return [Note(f"that is the {quantity} of a rim of radius {mechanics.radius_m:g} m")]
    if mechanics.at_motor_shaft:
        return [Note(f"that is the motor's, before a gear of {gear} (--motor-shaft)")]
    if mechanics.gear_ratio != 1.0 and any({"motor", "m"} & set(robot_words(name)) for name in names):
        text = f"assumed to be the wheel's, behind the gear of {gear}; otherwise add --motor-shaft"
        return [Note(text, "warning")]
    return []
