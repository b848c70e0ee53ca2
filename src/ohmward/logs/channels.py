"""The channels of batteries and drives, one table: names, units, and the words that columns call them by."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import NamedTuple

from ohmward.logs.units import UNITS, Unit

SIDES = frozenset(("left", "right"))
CORNERS = SIDES | {"front", "rear"}

# Abbreviations in the names of wheels and of the body's sensors, spelled out.
_SPELLED_OUT: dict[str, tuple[str, ...]] = {
    "l": ("left",), "r": ("right",), "back": ("rear",),
    **dict.fromkeys(("fl", "lf"), ("front", "left")), **dict.fromkeys(("fr", "rf"), ("front", "right")),
    **dict.fromkeys(("rl", "bl", "lr", "lb"), ("rear", "left")),
    **dict.fromkeys(("rr", "br", "rb"), ("rear", "right")),
    "wl": ("w", "left"), "wr": ("w", "right"), "vl": ("v", "left"), "vr": ("v", "right"),
    "il": ("i", "left"), "ir": ("i", "right"),
    "wz": ("w", "z"), "gz": ("gyro", "z"), "ax": ("a", "x"), "yawrate": ("yaw", "rate"),
}  # fmt: skip


#: Between the words of `PackVoltage`; not of `mAmps`.
_WITHIN = re.compile(r"(?<=[a-z][a-z])(?=[A-Z][a-z])")


def letters(stem: str) -> list[str]:
    """Words of letters in lower case: `T1_Batt` as t, batt; `PackVoltage` as pack, voltage."""
    return re.findall(r"[^\W\d_]+", _WITHIN.sub(" ", stem).lower())


def robot_words(stem: str) -> list[str]:
    """Words and numbers, abbreviations spelled out: `velL` as vel, left; `m1vel` as m, 1, vel."""
    parts = re.findall(r"[A-Z]?[a-zäöü]+|[A-Z]+(?![a-z])|\d+", stem)
    return [word for part in parts for word in _SPELLED_OUT.get(part.lower(), (part.lower(),))]


class Channel(NamedTuple):
    """A quantity that a column may hold."""

    name: str  #: as in `columns={"current": "I_batt"}`; a channel of wheels stands behind a wheel's name
    #: of its units; default: the unit where a column names none; example: units for a message
    dimensions: tuple[str, ...]

    default: Unit
    example: str
    words: frozenset[frozenset[str]]  #: each a set of words that names it, in any order
    beside: tuple[frozenset[str], ...]  #: words that may stand beside those, the best fit first
    split: Callable[[str], list[str]] = robot_words  #: the words in a column's name
    required: bool = False  #: without it a recording is refused
    first_of_many: bool = False  #: of several columns that fit equally well the first is taken, not refused


def word_set(text: str) -> frozenset[str]:
    """The words of a text."""
    return frozenset(text.split())


def _words(*names: str) -> frozenset[frozenset[str]]:
    return frozenset(map(word_set, names))


def _each(first: str, second: str) -> list[str]:
    """Every word of the first with every word of the second; `-` stands for none."""
    return [f"{a} {b}".replace("-", "") for a in first.split() for b in second.split()]


# Words that say where the whole battery was measured; they do not make it another quantity.
_OF_BATTERY = word_set(
    "battery batt bat bms pack terminal total measured meas test state field data main header stamp surface payload"
)
# Words of columns that serve where there is nothing better.
_SECOND_CHOICE = word_set("cell raw mean avg average")
# And of those that serve where there is no such one either.
_THIRD_CHOICE = word_set("now latest bus in input")
_BESIDE_BATTERY = (frozenset[str](), _OF_BATTERY, _OF_BATTERY | _SECOND_CHOICE,
                   _OF_BATTERY | _SECOND_CHOICE | _THIRD_CHOICE)  # fmt: skip
_BESIDE_WHEELS = (
    word_set(
        "wheel wheels motor m joint joints state states drive angular ang rim encoder enc measured meas actual act "
        "feedback fb service"
    ),
)
_BESIDE_BODY = (word_set("imu data body base robot msg"),)
_COMPASSES = "- compass magnetic mag gnss gps"
_SPEEDOMETERS = "- ground gnss gps vo visual flow radar lidar"

TIME = Channel(
    "time", ("time",), UNITS["s"], "s, ms, min or h",
    _words("time", "t", "timestamp", "time stamp", "datetime", "date time", "date", "stamp", "elapsed", "elapsed time",
           "unix time", "unixtime", "relative time", "total time", "header stamp", "seconds", "epoch", "ts", "realtime",
           "run time", "prog time", "program time", "date and time", "last changed", "last updated", "test", "x value",
           "cumulative time", "absolute time", "record time", "system time",
           "zeit", "datum", "temps", "tiempo", "tempo", "czas", "время", "时间", "時間", "시간", "dpt time"),
    _BESIDE_BATTERY, letters, required=True,
)  # fmt: skip
CURRENT = Channel(
    "current", ("current",), UNITS["a"], "A or mA",
    _words("current", "i", "cur", "curr", "ipack", "amps", "amperage", "ibat", "ibatt", "strom", "courant", "corriente",
           "corrente", "prąd", "ток", "电流", "電流", "전류"),
    _BESIDE_BATTERY, letters, required=True,
)  # fmt: skip
VOLTAGE = Channel(
    "voltage", ("voltage",), UNITS["v"], "V or mV",
    _words("voltage", "v", "u", "vol", "volt", "volts", "potential", "vtot", "vpack", "upack", "vfas",
           "vbat", "vbatt", "ubat", "ubatt", "ecell", "ewe",
           "spannung", "tension", "tensión", "voltaje", "tensione", "tensão", "napięcie", "напряжение", "电压", "電圧",
           "電壓", "전압"),
    _BESIDE_BATTERY, letters, required=True,
)  # fmt: skip
TEMPERATURE = Channel(
    "temperature", ("temperature",), UNITS["degc"], "degC, K or degF",
    _words("temperature", "temp", "t", "tbat", "tbatt", "temperature t", "temperature a", "aux temperature",
           "temperatur", "température", "temperatura", "температура", "温度", "溫度", "온도"),
    _BESIDE_BATTERY, letters, first_of_many=True,
)  # fmt: skip
WHEEL_SPEED = Channel(
    "wheel_speed", ("rotation", "speed", "turn", "angle", "length"), UNITS["rad/s"],
    "rad/s, rpm, m/s, counts, rad or m",
    _words("speed", "vel", "velocity", "velocities", "v", "w", "omega", "rate", "angvel"), _BESIDE_WHEELS,
)  # fmt: skip
WHEEL_COUNTS = WHEEL_SPEED._replace(
    dimensions=("turn", "angle", "length"),
    default=UNITS["counts"],
    words=_words("counts", "count", "ticks", "tick", "encoder", "enc", "position", "positions", "pos", "angle",
                 "s", "way", "distance", "dist", "travel"),
)  # fmt: skip
MOTOR_CURRENT = Channel(
    "motor_current", ("current",), UNITS["a"], "A or mA",
    _words("current", "currents", "cur", "curr", "i", "amps"), _BESIDE_WHEELS,
)  # fmt: skip

_OF_A_TABLE = (word_set("values value table curve mean average avg quasi cell pack battery cc reference ref"),)
_OPEN_CIRCUIT = "- voltage v u e emf ocv ocp uocv vocv"
#: The columns of a table of open-circuit voltage; of several that fit equally well the first is taken.
OCV_TABLE = tuple(
    Channel(name, (unit.dimension,), unit, example, words, _OF_A_TABLE, letters, first_of_many=True)
    for name, unit, example, words in (
        ("soc", UNITS["1"], "% or 1", _words("soc", "state of charge", "charge state", "z")),
        ("ocv", UNITS["v"], "V or mV",
         _words("ocv", "ocp", "emf", "voltage", "potential", "v", "u", "e", "uocv", "vocv", "voc", "uoc", "ocv voltage",
                *_each("v u", "oc ocv"), "open circuit", "open circuit voltage", "open circuit potential",
                "equilibrium voltage")),
        ("ocv_charge", UNITS["v"], "V or mV", _words(*_each(_OPEN_CIRCUIT, "charge charging chg ch"))),
        ("ocv_discharge", UNITS["v"], "V or mV",
         _words(*_each(_OPEN_CIRCUIT, "discharge discharging dischg dchg dis"))),
        ("hysteresis", UNITS["v"], "V or mV",
         _words("hysteresis", "hysteresis voltage", "half gap", "hysteresis half gap")),
        ("ocv_slope", UNITS["v/k"], "V/K or mV/K",
         _words("dvdt", "dudt", "docvdt", *_each("dv du de docv dvoltage", "dt dtemperature"),
                *_each("entropy entropic temperature", "coefficient"))),
        ("reference_temperature", UNITS["degc"], "degC, K or degF", TEMPERATURE.words - _words("t")),
    )
)  # fmt: skip

#: The channels of a battery's log.
BATTERY = (TIME, CURRENT, VOLTAGE, TEMPERATURE)
#: The channels of each wheel, those of the motor only where it is driven.
WHEEL = (WHEEL_SPEED, MOTOR_CURRENT)
#: The channels of a robot's body.
BODY = (
    Channel(
        "yaw_rate", ("rotation",), UNITS["rad/s"], "rad/s or deg/s",
        _words(*_each("yaw", "rate vel velocity speed gyro"), *_each("gyro w omega", "z"), "angular velocity z",
               "ang vel z"), _BESIDE_BODY,
    ),
    Channel("yaw", ("angle",), UNITS["rad"], "rad or deg", _words("yaw", "yaw angle"), _BESIDE_BODY),
    Channel("heading", ("angle",), UNITS["rad"], "rad or deg", _words("compass", *_each(_COMPASSES, "heading")),
            _BESIDE_BODY),
    Channel("heading_std", ("angle",), UNITS["rad"], "rad or deg", _words(*_each("heading", "std sigma")),
            _BESIDE_BODY),
    Channel(
        "acceleration", ("acceleration",), UNITS["m/s2"], "m/s2 or g",
        _words(*_each("acceleration accel acc", "- x forward"), "a x",
               *(f"linear {name}" for name in _each("acceleration accel acc", "x forward"))), _BESIDE_BODY,
    ),
    Channel("pitch", ("angle",), UNITS["rad"], "rad or deg", _words("pitch", "pitch angle"), _BESIDE_BODY),
    Channel(
        "speed", ("speed",), UNITS["m/s"], "m/s or km/h", _words(*_each("speed velocity", _SPEEDOMETERS)), _BESIDE_BODY
    ),
    Channel(
        "speed_std", ("speed",), UNITS["m/s"], "m/s",
        _words(*(f"speed {name}" for name in _each("std sigma", _SPEEDOMETERS))), _BESIDE_BODY,
    ),
    Channel(
        "speed_age", ("time",), UNITS["s"], "s or ms",
        _words(*(f"age {name}" for name in _each("speed", _SPEEDOMETERS))), _BESIDE_BODY,
    ),
)  # fmt: skip
CHANNELS = {channel.name: channel for channel in (*BATTERY, *WHEEL, *BODY, *OCV_TABLE)}


def channel_of(quantity: str) -> Channel:
    """The channel of a quantity of one wheel or of the whole: `front_left_wheel_speed` is a `wheel_speed`."""
    of_wheels = [channel for channel in WHEEL if quantity.endswith(channel.name)]
    return of_wheels[0] if of_wheels else CHANNELS[quantity]
