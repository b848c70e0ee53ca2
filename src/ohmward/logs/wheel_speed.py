"""The speed of a wheel from a rotation, from the speed of its rim, or from the counts of its encoder."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ohmward.checks import require_positive
from ohmward.errors import InputError
from ohmward.logs.channels import WHEEL_COUNTS, WHEEL_SPEED, channel_of, robot_words
from ohmward.logs.columns import Column, listed
from ohmward.logs.table import Note, Table, counted
from ohmward.logs.units import UNITS, Unit
from ohmward.signals.survey import find_gaps

#: Dimensions of a wheel's position, whose change is its speed.
POSITIONS = ("turn", "angle", "length")

#: Widths of counters that roll over within a drive.
WIDTHS = (8, 16, 32)


@dataclass(frozen=True)
class Mechanics:
    """The way from the shaft that is measured to the rim of the wheel.

    Raises:
        InputError: one of the numbers is not > 0.
    """

    radius_m: float | None = None  #: of the wheels, for speeds in m/s
    gear_ratio: float = 1.0  #: turns of the motor for one of the wheel
    at_motor_shaft: bool = False  #: speeds and counts are of the motor, before the gear
    counts_per_turn: float | None = None  #: of an encoder, for one turn of the shaft that it sits on

    def __post_init__(self) -> None:
        for name in ("radius_m", "gear_ratio", "counts_per_turn"):
            if (value := getattr(self, name)) is not None:
                require_positive(name, value)


class EncoderSpeed(NamedTuple):
    """The speed that an encoder shows."""

    speed_rad_s: np.ndarray  #: (T,) mean since the count before, NaN in rows without a new count and after gaps
    bits: int | None  #: of the counter, None where it never rolled over
    rollovers: int  #: their number


def unit_of_channel(quantity: str, column: Column, mechanics: Mechanics) -> Unit:
    """The unit of a column; where nothing tells it, that of the channel.

    A wheel's speed called `v` is in m/s; counts are what `counts_per_turn` is given for, and the positions of a name.
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


#: So many rows, turns and counts at least show that counts go up and down, in this share of the steps.
_FEWEST_ROWS, _FEWEST_TURNS, _FEWEST_COUNTS, _UP_AND_DOWN = 50, 3.0, 2.0, 0.2
#: Share of the usual interval of rows that lies between two at least; below 1, so that clocks that drift stay.
_USUAL_SHARE = 0.98
#: So many rows in a row show the usual interval, however they arrived.
_TOGETHER = 20
#: A row that comes after less than this share of the interval in which it was measured is one of a burst.
_BURST = 1 / 3
_POSITION_WORDS = frozenset(word for words in WHEEL_COUNTS.words for word in words)


def wheel_speed(
    source: str, name: str, unit: Unit, values: np.ndarray, time_s: np.ndarray, mechanics: Mechanics
) -> tuple[np.ndarray, tuple[Note, ...]]:
    """The speed of a wheel (T,) [rad/s] from a column, and a note where a counter rolled over.

    source, name: of the file and the column, for messages.
    values: (T,) in `unit`.  time_s: (T,) [s], increasing.

    Raises:
        InputError: the radius or the counts per turn are needed and not given.
    """
    if unit.dimension in ("speed", "length"):
        if mechanics.radius_m is None:
            raise InputError(f"{source}: {name!r} is in {unit.symbol}; give the radius of the wheels (radius_m)")
        at_rim = unit.in_si(values) / mechanics.radius_m
        return (at_rim if unit.dimension == "speed" else speed_from_angle(at_rim, time_s)), ()
    gear_ratio = mechanics.gear_ratio if mechanics.at_motor_shaft else 1.0
    if unit.dimension == "rotation":
        return unit.in_si(values) / gear_ratio, ()
    if unit.dimension == "angle":
        return speed_from_angle(unit.in_si(values), time_s) / gear_ratio, ()
    if mechanics.counts_per_turn is None:
        raise InputError(
            f"{source}: {name!r} counts the turns of a wheel; say how far with --counts-per-turn 4096 "
            "(counts_per_turn=4096), of positions in rad --unit wheel_speed=rad, or of a way at the rim --unit "
            "wheel_speed=m"
        )
    if are_since_last_row(values, mechanics.counts_per_turn):
        text = f"{name!r} does not grow with the way: taken as the counts since the row before, and added up"
        speed_rad_s = speed_from_counts(np.nancumsum(values), time_s, mechanics.counts_per_turn).speed_rad_s
        return speed_rad_s / gear_ratio, (Note(text, "warning"),)
    encoder = speed_from_counts(values, time_s, mechanics.counts_per_turn)
    rolled = Note(f"{name!r}: a counter of {encoder.bits} bits rolled over {encoder.rollovers} times: undone")
    return encoder.speed_rad_s / gear_ratio, (rolled,) if encoder.rollovers else ()


def are_since_last_row(counts: np.ndarray, counts_per_turn: float) -> bool:
    """True for counts (T,) that are anew in each row: within a turn of zero, and up and down all the time.

    A counter turns round as seldom as the wheel does. Where the counts come to no way, it does not matter.
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


def without_bursts(
    table: Table, time_s: np.ndarray, columns: Mapping[str, Column], mechanics: Mechanics
) -> tuple[np.ndarray, tuple[Note, ...]]:
    """The times (T,) of the rows where positions of wheels arrived in bursts as they were measured, and a note.

    A position over the time between two arrivals is no speed where the second did not wait for its turn.
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
    """Times (T,) [s] of positions that were measured evenly and arrived in bursts, as they would have without waiting.

    A row cannot have been measured later than any that came after it, less the usual interval for each in between.
    Rows that come evenly, or with pauses, keep their times.

    time_s: (T,) [s] of arrival, increasing.
    """
    if time_s.size < _FEWEST_ROWS:
        return time_s
    step_s = _USUAL_SHARE * float(np.median(time_s[_TOGETHER:] - time_s[:-_TOGETHER])) / _TOGETHER
    counted_s = step_s * np.arange(time_s.size)
    return np.minimum.accumulate((time_s - counted_s)[::-1])[::-1] + counted_s


def speed_from_counts(counts: np.ndarray, time_s: np.ndarray, counts_per_turn: float) -> EncoderSpeed:
    """The speed of a wheel from its encoder.

    counts: (T,) whole numbers, NaN where nothing new.  time_s: (T,) [s], increasing.
    counts_per_turn: of the wheel, > 0.
    """
    values = counts[np.isfinite(counts)]
    bits = counter_bits(values)
    span = math.inf if bits is None else 2.0**bits
    speed = rate_of_change(time_s, counts, span, 2 * math.pi / counts_per_turn)
    steps = np.diff(values)
    rollovers = int(np.count_nonzero((steps >= span / 2) | (steps < -span / 2)))
    return EncoderSpeed(speed, bits if rollovers else None, rollovers)


def speed_from_angle(angle_rad: np.ndarray, time_s: np.ndarray) -> np.ndarray:
    """The speed (T,) [rad/s] of a wheel from its position (T,) [rad], NaN in rows without a new one and after gaps.

    A position that stays within one turn is one that starts anew each turn, if it ever jumps by more than half of it.
    """
    known = angle_rad[np.isfinite(angle_rad)]
    is_within_turn = known.size and np.ptp(known) <= 2 * math.pi + 1e-6
    return rate_of_change(time_s, angle_rad, 2 * math.pi if is_within_turn else math.inf)


def rate_of_change(
    time_s: np.ndarray, values: np.ndarray, span: float = math.inf, scale: float = 1.0, over_gaps: bool = False
) -> np.ndarray:
    """(T,) change of `scale` times the values (T,) over the time since the value before; NaN in rows without a value.

    span: at which the values start anew; they are taken to have changed the short way.
    over_gaps: the rate over a gap counts; else it is NaN.
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
    """Notes on the units of the channels of a drive, one for all columns of a kind that are read alike."""
    alike: dict[tuple[str, str, bool], list[str]] = {}
    for quantity, column in columns.items():
        key = channel_of(quantity).name, unit_of_channel(quantity, column, mechanics).symbol, column.unit is None
        alike.setdefault(key, []).append(column.name)
    notes = []
    for (kind, symbol, guessed), names in alike.items():
        unit = f"taken as {symbol}, which the name does not say" if guessed else f"in {symbol}"
        doubtful = guessed and kind == WHEEL_SPEED.name and symbol == WHEEL_SPEED.default.symbol
        advice = "; for another say --unit wheel_speed=m/s, rpm or deg/s" if doubtful else ""
        text = f"{kind.replace('_', ' ')} from {listed(list(dict.fromkeys(names)))}, {unit}{advice}"
        notes.append(Note(text, "warning" if doubtful else "info"))
        if kind == WHEEL_SPEED.name:
            notes += _shaft_notes(UNITS[symbol], names, mechanics)
    return notes


def _shaft_notes(unit: Unit, names: list[str], mechanics: Mechanics) -> list[Note]:
    """A note on the shaft or rim that the speeds of wheels are taken to be of, where that is not plain."""
    gear = f"{mechanics.gear_ratio:g}"
    if unit.dimension in ("speed", "length"):
        quantity = "speed" if unit.dimension == "speed" else "way"
        return [Note(f"that is the {quantity} of a rim of radius {mechanics.radius_m:g} m")]
    if mechanics.at_motor_shaft:
        return [Note(f"that is the motor's, before a gear of {gear} (--motor-shaft)")]
    if mechanics.gear_ratio != 1.0 and any({"motor", "m"} & set(robot_words(name)) for name in names):
        text = f"taken as the wheel's, behind the gear of {gear}; if not, say --motor-shaft"
        return [Note(text, "warning")]
    return []
