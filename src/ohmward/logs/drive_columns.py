"""Which column of a file is the speed of which wheel, the current of which motor, and what the body's sensors saw."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from ohmward.errors import InputError
from ohmward.logs.columns import Column, argument, find_column, guess, listed
from ohmward.logs.drive_units import AMPERE, COUNTS, M_S, M_S2, RAD, RAD_S, SECOND, drive_unit_of, split_drive_unit
from ohmward.logs.units import Unit

WHEEL_SPEED, MOTOR_CURRENT = "wheel_speed", "motor_current"
BODY = ("yaw_rate", "heading", "acceleration", "pitch", "speed", "speed_std", "speed_age")

_EXAMPLES = {
    "time": "s or ms", WHEEL_SPEED: "rad/s, rpm, m/s or counts", MOTOR_CURRENT: "A or mA",
    "yaw_rate": "rad/s or deg/s", "heading": "rad or deg", "acceleration": "m/s2 or g", "pitch": "rad or deg",
    "speed": "m/s or km/h", "speed_std": "m/s", "speed_age": "s or ms",
}  # fmt: skip

#: What each kind of channel may be measured in.
MEASURED_IN: dict[str, tuple[str, ...]] = {
    "time": ("time",),
    WHEEL_SPEED: ("rotation", "speed", "turn"),
    MOTOR_CURRENT: ("current",),
    "yaw_rate": ("rotation",),
    "heading": ("angle",),
    "acceleration": ("acceleration",),
    "pitch": ("angle",),
    "speed": ("speed",),
    "speed_std": ("speed",),
    "speed_age": ("time",),
}

_DEFAULT_UNIT: dict[str, Unit] = {
    MOTOR_CURRENT: AMPERE,
    "yaw_rate": RAD_S,
    "heading": RAD,
    "acceleration": M_S2,
    "pitch": RAD,
    "speed": M_S,
    "speed_std": M_S,
    "speed_age": SECOND,
}

_SIDES = {"left", "right"}
_CORNERS = _SIDES | {"front", "rear"}
_FUSED: dict[str, tuple[str, ...]] = {
    "l": ("left",), "r": ("right",), "back": ("rear",),
    **dict.fromkeys(("fl", "lf"), ("front", "left")), **dict.fromkeys(("fr", "rf"), ("front", "right")),
    **dict.fromkeys(("rl", "bl", "lr", "lb"), ("rear", "left")),
    **dict.fromkeys(("rr", "br", "rb"), ("rear", "right")),
    "wl": ("w", "left"), "wr": ("w", "right"), "vl": ("v", "left"), "vr": ("v", "right"),
    "il": ("i", "left"), "ir": ("i", "right"),
    "wz": ("w", "z"), "gz": ("gyro", "z"), "ax": ("a", "x"), "yawrate": ("yaw", "rate"),
}  # fmt: skip
_SPEED = {"speed", "vel", "velocity", "velocities", "v", "w", "omega", "rate", "angvel"}
_CURRENT = {"current", "currents", "cur", "curr", "i", "amps"}
_COUNT = {"counts", "count", "ticks", "tick", "encoder", "enc"}
_ABOUT_WHEELS = {
    "wheel", "wheels", "motor", "m", "joint", "joints", "state", "states", "drive", "angular", "ang", "rim", "encoder",
    "enc", "measured", "meas", "actual", "act", "feedback", "fb", "service",
}  # fmt: skip
_ABOUT_BODY = {"imu", "data", "body", "base", "robot", "msg"}
_X = [frozenset(("x",)), frozenset(("forward",)), frozenset()]
_SOURCES = [
    frozenset(),
    *(frozenset((s,)) for s in ("ground", "gnss", "gps", "vo", "visual", "flow", "radar", "lidar")),
]
_BODY_WORDS: dict[str, list[frozenset[str]]] = {
    "yaw_rate": [
        *(frozenset(("yaw", word)) for word in ("rate", "vel", "velocity", "speed", "gyro")),
        *(frozenset((word, "z")) for word in ("gyro", "w", "omega")),
        *(frozenset((*words, "z")) for words in (("angular", "velocity"), ("ang", "vel"))),
    ],
    "heading": [frozenset((word,)) for word in ("yaw", "heading")],
    "acceleration": [
        *(frozenset((word,)) | x for word in ("acceleration", "accel", "acc") for x in _X),
        *(frozenset(("linear", word)) | x for word in ("acceleration", "accel", "acc") for x in _X[:2]),
        frozenset(("a", "x")),
    ],
    "pitch": [frozenset(("pitch",)), frozenset(("pitch", "angle"))],
    "speed": [frozenset((word,)) | of for word in ("speed", "velocity") for of in _SOURCES],
    "speed_std": [frozenset(("speed", word)) | of for word in ("std", "sigma") for of in _SOURCES],
    "speed_age": [frozenset(("speed", "age")) | of for of in _SOURCES],
}  # fmt: skip


class Wheels(NamedTuple):
    """The wheels that are looked for: their names, driven ones first, and how many are driven."""

    places: Sequence[str]
    driven: int

    @property
    def quantities(self) -> tuple[str, ...]:
        """Every channel that a file may have, by name."""
        speeds = (f"{place}_{WHEEL_SPEED}" for place in self.places)
        currents = (f"{place}_{MOTOR_CURRENT}" for place in self.places[: self.driven])
        return ("time", *speeds, *currents, *BODY)


class Found(NamedTuple):
    """columns: channel -> column, several wheels may share one; by_number: wheels were told by their numbers alone."""

    columns: dict[str, Column]
    by_number: bool


class _Reading(NamedTuple):
    """A name as a channel of a wheel: `corner` of `_CORNERS`, or a number, or both empty."""

    column: Column
    corner: frozenset[str]
    number: int | None


def kind_of(quantity: str) -> str:
    """The kind of a channel: `front_left_wheel_speed` is a `wheel_speed`."""
    return next((kind for kind in (WHEEL_SPEED, MOTOR_CURRENT) if quantity.endswith(kind)), quantity)


def find_drive_columns(
    source: str,
    names: Sequence[str],
    wheels: Wheels,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    leave: Sequence[str] = (),
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
    given = _by_wheel(dict(columns or {}), wheels)
    _check_kinds(units or {}, wheels)
    free = [name for name in names if name not in {*given.values(), *leave}]
    time = find_column(source, [*free, *given.values()], "time", given, units or {})
    free = [name for name in free if time is None or name != time.name]
    speeds, by_number = _of_wheels(source, free, WHEEL_SPEED, wheels, given)
    currents, also = _of_wheels(source, free, MOTOR_CURRENT, wheels, given)
    body = {kind: _of_body(source, free, kind) for kind in BODY if kind not in given}
    named = {quantity: _named(source, names, quantity, name) for quantity, name in given.items() if quantity != "time"}
    found = {"time": time, **speeds, **currents, **body, **named}
    if not any(kind_of(quantity) == WHEEL_SPEED for quantity in {**speeds, **named}):
        raise _no_wheels(source, names, wheels)
    chosen = {quantity: _with_unit(column, quantity, units or {}) for quantity, column in found.items() if column}
    return Found(chosen, by_number or also)


def _by_wheel(columns: dict[str, str], wheels: Wheels) -> dict[str, str]:
    """The overrides with those of a side given to its wheels."""
    result: dict[str, str] = {}
    for quantity, name in columns.items():
        result |= dict.fromkeys(_meant(quantity, wheels), name)
    return result


def _meant(quantity: str, wheels: Wheels) -> list[str]:
    """The channels that a name in --column stands for."""
    if quantity in wheels.quantities:
        return [quantity]
    side, kind = quantity.partition("_")[::2]
    served = [place for place in wheels.places[: wheels.driven] if side in place.split("_")]
    if side not in _SIDES or kind not in (WHEEL_SPEED, MOTOR_CURRENT) or not served:
        raise InputError(
            f"unknown quantity {quantity!r}{guess(quantity, wheels.quantities)}; this robot has "
            f"{', '.join(wheels.quantities)}"
        )
    return [f"{place}_{kind}" for place in served]


def _check_kinds(units: Mapping[str, str], wheels: Wheels) -> None:
    for quantity, spelling in units.items():
        if quantity not in MEASURED_IN:
            _meant(quantity, wheels)
        unit, kind = drive_unit_of(spelling), kind_of(quantity)
        if unit is None or unit.quantity not in MEASURED_IN[kind]:
            raise InputError(f"unit {spelling!r} of the {quantity} is not known; use for example {_EXAMPLES[kind]}")


def _words(stem: str) -> list[str]:
    """`velL` as vel, left; `m1vel` as m, 1, vel; `omega_FL` as omega, front, left."""
    parts = re.findall(r"[A-Z]?[a-zäöü]+|[A-Z]+(?![a-z])|\d+", stem)
    return [word for part in parts for word in _FUSED.get(part.lower(), (part.lower(),))]


def _of_wheels(
    source: str, names: Sequence[str], kind: str, wheels: Wheels, given: Mapping[str, str]
) -> tuple[dict[str, Column], bool]:
    """The columns of one kind: by corner or side, else by number; and whether it was by number."""
    places = wheels.places if kind == WHEEL_SPEED else wheels.places[: wheels.driven]
    wanted = [place for place in places if f"{place}_{kind}" not in given]
    for read in _READERS[kind]:
        readings = [reading for name in names if (reading := read(name))]
        for find in (_by_name, _by_number):
            if found := find(readings, wanted, wheels):
                columns = {f"{p}_{kind}": _only(source, f"{p}_{kind}", fits) for p, fits in found.items()}
                return columns, find is _by_number
    return {}, False


def _by_name(readings: Sequence[_Reading], wanted: Sequence[str], wheels: Wheels) -> dict[str, list[_Reading]]:
    """Wheels by their corner; driven ones also by their side."""
    found: dict[str, list[_Reading]] = {}
    for place in wanted:
        corner = set(place.split("_"))
        side = corner & _SIDES if place in wheels.places[: wheels.driven] else set()
        fits = [r for r in readings if r.corner == corner] or [r for r in readings if side and r.corner == side]
        found |= {place: fits} if fits else {}
    return found


def _by_number(readings: Sequence[_Reading], wanted: Sequence[str], wheels: Wheels) -> dict[str, list[_Reading]]:
    """Wheels in the robot's order, counted from 0 or 1; two numbers for four driven wheels are the sides."""
    numbered = [r for r in readings if r.number is not None and not r.corner]
    first = 0 if any(r.number == 0 for r in numbered) else 1
    if len({r.number for r in numbered}) == 2 and wheels.driven == 4:
        order = {place: 0 if "left" in place else 1 for place in wheels.places}
    else:
        order = {place: index for index, place in enumerate(wheels.places)}
    found = {place: [r for r in numbered if r.number == order[place] + first] for place in wanted}
    return {place: fits for place, fits in found.items() if fits}


def _as_speed(name: str) -> _Reading | None:
    for stem, unit in split_drive_unit(name):
        fits = unit is None or unit.quantity in ("rotation", "speed")
        if fits and (reading := _of_wheel(name, stem, unit, _SPEED, unit is not None)):
            return reading
    return None


def _as_current(name: str) -> _Reading | None:
    for stem, unit in split_drive_unit(name):
        if (unit is None or unit.quantity == "current") and (reading := _of_wheel(name, stem, unit, _CURRENT, False)):
            return reading
    return None


def _as_counts(name: str) -> _Reading | None:
    return _of_wheel(name, name, COUNTS, _COUNT, False)


_READERS = {WHEEL_SPEED: (_as_speed, _as_counts), MOTOR_CURRENT: (_as_current,)}


def _of_wheel(name: str, stem: str, unit: Unit | None, what: set[str], enough: bool) -> _Reading | None:
    """The name as a channel of a wheel if all its words are known and one says what it is; `enough`: the unit does."""
    words = _words(stem)
    corner = frozenset(_CORNERS & set(words))
    numbers = [int(word) for word in words if word.isdecimal()]
    rest = [word for word in words if word not in corner and not word.isdecimal()]
    known = all(word in what or word in _ABOUT_WHEELS for word in rest) and len(numbers) <= 1
    if not known or not (enough or any(word in what for word in rest)) or not (corner or numbers):
        return None
    return _Reading(Column(name, unit), corner, numbers[0] if numbers else None)


def _of_body(source: str, names: Sequence[str], kind: str) -> Column | None:
    fits = []
    for name in names:
        for stem, unit in split_drive_unit(name):
            words = frozenset(_words(stem))
            if (unit is None or unit.quantity in MEASURED_IN[kind]) and _is(kind, words):
                fits.append(_Reading(Column(name, unit), frozenset(), None))
                break
    return _only(source, kind, fits) if fits else None


def _is(kind: str, words: frozenset[str]) -> bool:
    return words in _BODY_WORDS[kind] or words - _ABOUT_BODY in _BODY_WORDS[kind]


def _only(source: str, quantity: str, fits: Sequence[_Reading]) -> Column:
    if len(fits) > 1:
        first, second = fits[0].column.name, fits[1].column.name
        raise InputError(
            f"{source}: both {first!r} and {second!r} may be the {quantity}; "
            f"choose with --column {argument(f'{quantity}={first}')} (columns={{{quantity!r}: {first!r}}})"
        )
    return fits[0].column


def _named(source: str, names: Sequence[str], quantity: str, wanted: str) -> Column:
    if wanted not in names:
        raise InputError(
            f"{source}: there is no column {wanted!r} for the {quantity}{guess(wanted, names)}; it has: {listed(names)}"
        )
    fitting = MEASURED_IN[kind_of(quantity)]
    unit = next((u for _, u in split_drive_unit(wanted) if u and u.quantity in fitting), None)
    return Column(wanted, unit)


def _with_unit(column: Column, quantity: str, units: Mapping[str, str]) -> Column:
    """The column with the unit that was given for this channel, for its side, or for its kind."""
    kind = kind_of(quantity)
    side = next((f"{s}_{kind}" for s in _SIDES if s in quantity.split("_")), kind)
    spelling = next((units[key] for key in (quantity, side, kind) if key in units), None)
    unit = column.unit if spelling is None else drive_unit_of(spelling)
    return Column(column.name, unit)


def may_be_of_the_motor(name: str) -> bool:
    """Whether the name of a wheel's speed says that it is the motor's."""
    return bool({"motor", "m"} & set(_words(name)))


def default_unit(kind: str, name: str) -> Unit:
    """What a column is taken to be in where nothing says it: rad/s for a wheel, but m/s where it is called `v`."""
    if kind == WHEEL_SPEED:
        return M_S if "v" in _words(name) else RAD_S
    return _DEFAULT_UNIT[kind]


def _no_wheels(source: str, names: Sequence[str], wheels: Wheels) -> InputError:
    option = f"{wheels.places[0]}_{WHEEL_SPEED}"
    return InputError(
        f"{source}: no column for the speed of a wheel found; it has: {listed(names)}; name each with "
        f"--column {option}=NAME (columns={{{option!r}: NAME}}), and its unit with --unit wheel_speed=rpm"
    )
