"""Units of the columns of a log, and how they are written into column names."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import NamedTuple


class Unit(NamedTuple):
    """A unit of `quantity`: SI value (degC for temperature) = scale * value + offset."""

    symbol: str
    quantity: str
    scale: float
    offset: float = 0.0


# Spelled in lower case; the first spelling is the symbol.
_SPELLINGS: dict[Unit, tuple[str, ...]] = {
    Unit("A", "current", 1.0): ("a", "amp", "amps", "ampere", "amperes"),
    Unit("mA", "current", 1e-3): ("ma", "milliamp", "milliamps", "milliampere", "milliamperes"),
    Unit("uA", "current", 1e-6): ("ua", "µa", "μa", "microamp", "microamps", "microampere"),
    Unit("kA", "current", 1e3): ("ka", "kiloampere"),
    Unit("V", "voltage", 1.0): ("v", "volt", "volts"),
    Unit("mV", "voltage", 1e-3): ("mv", "millivolt", "millivolts"),
    Unit("uV", "voltage", 1e-6): ("uv", "µv", "μv", "microvolt", "microvolts"),
    Unit("kV", "voltage", 1e3): ("kv", "kilovolt"),
    Unit("s", "time", 1.0): ("s", "sec", "secs", "second", "seconds"),
    Unit("ms", "time", 1e-3): ("ms", "msec", "msecs", "millis", "millisecond", "milliseconds"),
    Unit("us", "time", 1e-6): ("us", "µs", "μs", "usec", "usecs", "micros", "microsecond", "microseconds"),
    Unit("ns", "time", 1e-9): ("ns", "nsec", "nsecs", "nanos", "nanosecond", "nanoseconds"),
    Unit("min", "time", 60.0): ("min", "mins", "minute", "minutes"),
    Unit("h", "time", 3600.0): ("h", "hr", "hrs", "hour", "hours"),
    Unit("d", "time", 86400.0): ("d", "day", "days"),
    Unit("degC", "temperature", 1.0): ("c", "degc", "deg c", "°c", "ºc", "℃", "celsius", "degree celsius"),
    Unit("K", "temperature", 1.0, -273.15): ("k", "kelvin"),
    Unit("degF", "temperature", 5 / 9, -160 / 9): ("f", "degf", "deg f", "°f", "ºf", "℉", "fahrenheit"),
}
UNITS: dict[str, Unit] = {spelling: unit for unit, spellings in _SPELLINGS.items() for spelling in spellings}

# `Current [mA]`, `I (A)`, `Temperature (C)_1`
_BRACKETS = re.compile(r"^(?P<stem>.*?)\s*[\[(]\s*(?P<unit>[^\[\]()]*?)\s*[\])]\s*_?(?P<rest>\d*)$")
# `Voltage / V`, `U/V`
_SLASH = re.compile(r"^(?P<stem>.+?)\s*/\s*(?P<unit>[^/]+?)\s*(?P<rest>)$")
# `current_A`, `voltage mV`, `time.ms`
_SUFFIX = re.compile(r"^(?P<stem>.+?)[\s_.,-]+(?P<unit>[^\W\d_]+|[°ºµμ]\w+|deg[ _][cfCF]|degree[ _]celsius)(?P<rest>)$")


def unit_of(spelling: str) -> Unit | None:
    """The unit with this spelling, or None."""
    return UNITS.get(" ".join(spelling.replace("_", " ").split()).lower())


def split_unit(name: str) -> Iterator[tuple[str, Unit]]:
    """Every way to read a column name as a stem and a unit, the most explicit notation first."""
    for notation in (_BRACKETS, _SLASH, _SUFFIX):
        if (found := notation.match(name.strip())) and (unit := unit_of(found["unit"])):
            yield f"{found['stem']} {found['rest']}".strip(), unit
