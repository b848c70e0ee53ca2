"""Units of what a driving robot measures, and how they are written into column names."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

from ohmward.logs.units import UNITS, Unit, split_unit, unit_of

COUNTS = Unit("counts", "turn", 1.0)
RAD_S = Unit("rad/s", "rotation", 1.0)
M_S = Unit("m/s", "speed", 1.0)
M_S2 = Unit("m/s2", "acceleration", 1.0)
RAD = Unit("rad", "angle", 1.0)
AMPERE, SECOND = UNITS["a"], UNITS["s"]

# Spelled in lower case, a slash or an underscore for "per".
_SPELLINGS: dict[Unit, tuple[str, ...]] = {
    RAD_S: ("rad/s", "rad/sec", "radps", "rad_per_s", "rad_per_sec", "rads"),
    Unit("deg/s", "rotation", math.pi / 180): ("deg/s", "deg/sec", "degps", "dps", "deg_per_s", "°/s"),
    Unit("rpm", "rotation", math.pi / 30): ("rpm", "rev/min", "1/min"),
    M_S: ("m/s", "m/sec", "mps", "m_per_s"),
    Unit("mm/s", "speed", 1e-3): ("mm/s", "mmps"),
    Unit("km/h", "speed", 1 / 3.6): ("km/h", "kmh", "kph"),
    M_S2: ("m/s2", "m/s^2", "m/s²", "mps2", "m_per_s2"),
    Unit("g", "acceleration", 9.80665): ("g",),
    RAD: ("rad", "radian", "radians"),
    Unit("deg", "angle", math.pi / 180): ("deg", "degree", "degrees", "°"),
    COUNTS: ("counts", "count", "ticks", "tick"),
}  # fmt: skip
_UNITS = {spelling: unit for unit, spellings in _SPELLINGS.items() for spelling in spellings}
_UNITS |= {spelling.replace("/", "_"): unit for spelling, unit in _UNITS.items()}

_BRACKETS = re.compile(r"^(?P<stem>.*?)\s*[\[(]\s*(?P<unit>[^\[\]()]+?)\s*[\])]$")
_LONGEST_FIRST = "|".join(re.escape(s) for s in sorted(_UNITS, key=len, reverse=True))
_SUFFIX = re.compile(rf"^(?P<stem>.+?)[\s_.,-]+(?P<unit>{_LONGEST_FIRST})$", re.IGNORECASE)


def drive_unit_of(spelling: str) -> Unit | None:
    """The unit with this spelling, of a drive or of any log; or None."""
    return _UNITS.get("".join(spelling.split()).lower()) or unit_of(spelling)


def split_drive_unit(name: str) -> Iterator[tuple[str, Unit | None]]:
    """Every way to read a column name as a stem and a unit, the most explicit first; last the name without one."""
    for notation in (_BRACKETS, _SUFFIX):
        if (found := notation.match(name.strip())) and (unit := drive_unit_of(found["unit"])):
            yield found["stem"], unit
    yield from split_unit(name)
    yield name, None
