"""Units of measured quantities, and their notation in the names of columns."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterator
from functools import lru_cache
from typing import NamedTuple

import numpy as np


class Unit(NamedTuple):
    """A unit of `dimension`: SI value (degC for temperature) = scale * value + offset."""

    symbol: str
    dimension: str
    scale: float
    offset: float = 0.0

    def in_si(self, values: np.ndarray) -> np.ndarray:
        """The values in SI units; the array itself if nothing changes."""
        scaled = values if self.scale == 1.0 else values * self.scale
        return scaled if self.offset == 0.0 else scaled + self.offset


_RPM = ("rpm", "rev/min", "u/min", "1/min", "tr/min", "giri/min", "obr/min", "об/мин")
# Spelled in lower case. A slash stands for an underscore as well: `speed_m_s`.
_SPELLINGS: dict[Unit, tuple[str, ...]] = {
    Unit("A", "current", 1.0): ("a", "amp", "amps", "ampere", "amperes", "adc", "а"),
    Unit("mA", "current", 1e-3): ("ma", "ма", "mamp", "mamps", "milliamp", "milliamps", "milliampere", "milliamperes"),
    Unit("uA", "current", 1e-6): ("ua", "µa", "μa", "microamp", "microamps", "microampere"),
    Unit("cA", "current", 1e-2): ("ca", "centiamp", "centiamps"),
    Unit("dA", "current", 0.1): ("da", "deciamp", "deciamps"),
    Unit("kA", "current", 1e3): ("ka", "kiloampere"),
    Unit("V", "voltage", 1.0): ("v", "volt", "volts", "vdc", "в"),
    Unit("mV", "voltage", 1e-3): ("mv", "мв", "mvolt", "mvolts", "millivolt", "millivolts"),
    Unit("uV", "voltage", 1e-6): ("uv", "µv", "μv", "microvolt", "microvolts"),
    Unit("cV", "voltage", 1e-2): ("cv", "centivolt", "centivolts"),
    Unit("dV", "voltage", 0.1): ("dv", "decivolt", "decivolts"),
    Unit("kV", "voltage", 1e3): ("kv", "kilovolt"),
    Unit("W", "power", 1.0): ("w", "watt", "watts"),
    Unit("mW", "power", 1e-3): ("mw", "milliwatt", "milliwatts"),
    Unit("kW", "power", 1e3): ("kw", "kilowatt", "kilowatts"),
    Unit("Ah", "charge", 3600.0): ("ah", "amp hours", "ampere hours"),
    Unit("mAh", "charge", 3.6): ("mah",),
    Unit("Wh", "energy", 3600.0): ("wh", "watt hours"),
    Unit("kWh", "energy", 3.6e6): ("kwh",),
    Unit("s", "time", 1.0): ("s", "sec", "secs", "second", "seconds", "с", "сек"),
    Unit("ms", "time", 1e-3): ("ms", "мс", "msec", "msecs", "millis", "millisecond", "milliseconds"),
    Unit("us", "time", 1e-6): ("us", "µs", "μs", "usec", "usecs", "micros", "microsecond", "microseconds"),
    Unit("ns", "time", 1e-9): ("ns", "nsec", "nsecs", "nanos", "nanosecond", "nanoseconds"),
    Unit("min", "time", 60.0): ("min", "mins", "minute", "minutes"),
    Unit("h", "time", 3600.0): ("h", "hr", "hrs", "hour", "hours"),
    Unit("d", "time", 86400.0): ("d", "day", "days"),
    Unit("degC", "temperature", 1.0): ("c", "degc", "deg c", "deg_c", "°c", "ºc", "℃", "celsius", "degree celsius"),
    Unit("K", "temperature", 1.0, -273.15): ("k", "kelvin"),
    Unit("degF", "temperature", 5 / 9, -160 / 9): ("f", "degf", "deg f", "deg_f", "°f", "ºf", "℉", "fahrenheit"),
    Unit("rad/s", "rotation", 1.0): ("rad/s", "rad/sec", "radps", "rad_per_s", "rad_per_sec", "radpersec", "rads"),
    Unit("deg/s", "rotation", math.pi / 180): ("deg/s", "deg/sec", "degps", "dps", "deg_per_s", "degpersec", "°/s"),
    Unit("mdeg/s", "rotation", math.pi / 180e3): ("mdeg/s", "mdps", "mdegps"),
    Unit("rpm", "rotation", math.pi / 30): _RPM,
    Unit("turns/s", "rotation", 2 * math.pi): ("turns/s", "turn/s", "rev/s", "rps", "rotationspersec"),
    Unit("counts/s", "turn rate", 1.0): ("counts/s", "ticks/s", "pulses/s", "tps", "cps", "pps", "qpps"),
    Unit("erpm", "turn rate", 1 / 60): ("erpm",),  # pole pairs of the motor pass in a minute
    Unit("m/s", "speed", 1.0): ("m/s", "m/sec", "mps", "m_per_s", "meterspersec"),
    Unit("mm/s", "speed", 1e-3): ("mm/s", "mmps"),
    Unit("in/s", "speed", 0.0254): ("in/s", "ips"),
    Unit("ft/s", "speed", 0.3048): ("ft/s",),
    Unit("km/h", "speed", 1 / 3.6): ("km/h", "kmh", "kph"),
    Unit("mph", "speed", 0.44704): ("mph", "mi/h"),
    Unit("kn", "speed", 1852 / 3600): ("kn", "knot", "knots"),
    Unit("m/s2", "acceleration", 1.0): ("m/s2", "m/s^2", "m/s²", "mps2", "m_per_s2"),
    Unit("g", "acceleration", 9.80665): ("g",),
    Unit("rad", "angle", 1.0): ("rad", "radian", "radians"),
    Unit("deg", "angle", math.pi / 180): ("deg", "degree", "degrees", "°"),
    Unit("turns", "angle", 2 * math.pi): ("turns", "rev", "revs", "revolutions"),
    Unit("counts", "turn", 1.0): ("counts", "count", "ticks", "tick", "pulses", "pulse"),
    Unit("m", "length", 1.0): ("m", "meter", "meters", "metre", "metres"),
    Unit("cm", "length", 1e-2): ("cm",),
    Unit("mm", "length", 1e-3): ("mm",),
    Unit("1", "share", 1.0): ("1", "-"),
    Unit("%", "share", 1e-2): ("%", "percent", "pct"),
    Unit("permille", "share", 1e-3): ("permille", "‰"),
    Unit("V/K", "entropy", 1.0): ("v/k", "v_per_k", "v/degc", "v/°c"),
    Unit("mV/K", "entropy", 1e-3): ("mv/k", "mv_per_k", "mv/degc", "mv/°c"),
}


def _key(spelling: str) -> str:
    return "".join(spelling.split()).lower().replace("_", "/")


UNITS: dict[str, Unit] = {_key(spelling): unit for unit, spellings in _SPELLINGS.items() for spelling in spellings}

#: Labels that Prometheus and Grafana write behind a name.
LABELS = re.compile(r"\s*\{[^{}]*\}")
# `Current [mA]`, `I (A)`, `Temperature (C)_1`
_BRACKETS = re.compile(r"^(?P<stem>.*?)\s*[\[(]\s*(?P<unit>[^\[\]()]*?)\s*[\])]\s*_?(?P<rest>\d*)$")
# `Voltage / V`, `U/V`
_SLASH = re.compile(r"^(?P<stem>.+?)\s*/\s*(?P<unit>[^/]+?)\s*(?P<rest>)$")
# `current_A`, `voltage mV`, `time.ms`; `voltage_0.1V`, `current 10mA`, but `range 10A` is no multiple
_SUFFIX = re.compile(r"^(?P<stem>.+?)[\s_.,-]+(?P<unit>(?:0?\.0*1|10{1,2}(?=m[VA]))?[^\W\d_]+|[°ºµμ]\w*)(?P<rest>)$")
# `speed_m_s`, `wheel rad/s`, `temp_deg_C`: units that are not letters alone, the longest first
_OF_PARTS = sorted(
    (s for spellings in _SPELLINGS.values() for s in spellings if not s.isalpha()), key=len, reverse=True
)
_PARTS = "|".join(re.escape(spelling).replace("/", "[/_]") for spelling in _OF_PARTS)
_COMPOUND = re.compile(rf"^(?P<stem>.+?)[\s_.,-]+(?P<unit>{_PARTS})(?P<rest>)$", re.IGNORECASE)


# `rpm_left`, `ticks.right`, `motor_rpm_left`, `current_ma_left`
_BEFORE = re.compile(
    r"^(?P<stem>(?:[^\W_]+[\s_.-]+)*?)(?P<unit>e?rpm|q?pps|tps|cps|ticks?|pulses?|counts?|mps|dps|m[av])[\s_.-]+(?P<rest>.+)$",
    re.IGNORECASE,
)
# `LeftVelocityRadPerSec`, `CurrentAmps`: units that are spelled out
_SPELLED_OUT = "|".join(
    sorted(
        (s for of in _SPELLINGS.values() for s in of if s.isascii() and s.isalpha() and len(s) > 3),
        key=len,
        reverse=True,
    )
)
_CAMEL = re.compile(rf"^(?P<stem>.*[a-z\d])(?P<unit>(?=[A-Z])(?i:{_SPELLED_OUT}))(?P<rest>)$")
# `TimeUS` of ArduPilot, `BattV`, `tempC`, `busVoltageMv`
_CAPITALS = re.compile(
    r"^(?P<stem>\w*?(?:[Tt]ime(?:stamp)?|[Ee]lapsed|[Bb]at(?:t(?:ery)?)?|[Pp]ack|[Bb]ms|[Bb]us|[Vv]oltage|[Cc]urrent"
    r"|[Tt]emp(?:erature)?))(?P<unit>[uUmMnN]?S|[UMN]s|m?[VA]|M[VvAa]|[CFK])(?P<rest>)$"
)
# `ms`, `ms_today`: the time of a microcontroller
_TIME_AS_UNIT = re.compile(r"^(?P<unit>[mµu]s)(?:_today)?$")
# `voltage_now`, `POWER_SUPPLY_CURRENT_NOW`: the files of a power supply under Linux, in millionths
_POWER_SUPPLY = re.compile(r"^(?:power_supply_)?(?P<stem>(?P<of>voltage|current)_(?:now|avg))$", re.IGNORECASE)
#: A name that is itself a unit names the quantity: `Volts`, `millis`; of shorter names only these do.
_SHORTEST_UNIT_AS_NAME, _UNITS_AS_NAMES = 4, frozenset(("A", "mA", "mV"))


#: A multiple of a unit: `0.1A`, `10 mV`.
_MULTIPLE = re.compile(r"(?P<factor>\d*\.?\d+)(?P<unit>\D+)")


def unit_of(spelling: str) -> Unit | None:
    """The unit with this spelling, or a multiple of it, `0.1A`; None if there is none.

    What a potential is measured against, as in `V vs. Ref.`, belongs to no unit.
    """
    key = _key(spelling.partition(" vs")[0])
    if key in UNITS or not (found := _MULTIPLE.fullmatch(key)):
        return UNITS.get(key)
    unit = UNITS.get(found["unit"])
    if unit is None or unit.offset or not float(found["factor"]):
        return None
    return Unit(f"{found['factor']} {unit.symbol}", unit.dimension, float(found["factor"]) * unit.scale)


@lru_cache(maxsize=4096)
def split_unit(name: str) -> tuple[tuple[str, Unit | None], ...]:
    """Every division of a column's name into stem and unit, the most explicit notation first; last the bare name.

    Labels keep their place behind the stem: `current{robot="r1"} [A]`.
    """
    labels = "".join(LABELS.findall(name))
    divisions = _divisions(LABELS.sub("", name).strip().removesuffix("()"))
    return tuple((stem + labels, unit) for stem, unit in divisions)


def _divisions(name: str) -> Iterator[tuple[str, Unit | None]]:
    for notation in (_BRACKETS, _COMPOUND, _SLASH, _SUFFIX, _BEFORE, _CAPITALS, _CAMEL):
        if (found := notation.match(name)) and (unit := unit_of(found["unit"])):
            yield f"{found['stem']} {found['rest']}".strip(), unit
    if (found := _TIME_AS_UNIT.match(name)) and (unit := unit_of(found["unit"])):
        yield "time", unit
    if found := _POWER_SUPPLY.match(name):
        yield found["stem"], UNITS["uv" if found["of"].lower() == "voltage" else "ua"]
    if (len(name) >= _SHORTEST_UNIT_AS_NAME or name in _UNITS_AS_NAMES) and (unit := unit_of(name)):
        yield unit.dimension, unit
    yield name, None


def unit_in_brackets(name: str) -> Unit | None:
    """The unit of any dimension that a column's name has in brackets, or None."""
    found = _BRACKETS.match(name.strip())
    return unit_of(found["unit"]) if found else None


def unit_in_name(name: str, dimensions: Collection[str]) -> Unit | None:
    """The unit of one of the dimensions that a column's name ends in, or None."""
    return next((unit for _, unit in split_unit(name) if unit and unit.dimension in dimensions), None)
