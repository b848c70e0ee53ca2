"""Which column of a file is the time, the current, the voltage and the temperature, and in which unit."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from ohmward.errors import InputError
from ohmward.logs.units import Unit, split_unit, unit_of

QUANTITIES = ("time", "current", "voltage", "temperature")
REQUIRED = ("time", "current", "voltage")

_SYNONYMS: dict[str, frozenset[str]] = {
    "time": frozenset(
        ("time", "t", "timestamp", "time stamp", "datetime", "date time", "date", "stamp", "elapsed", "elapsed time",
         "unix time", "relative time", "total time", "header stamp", "seconds", "epoch")
    ),
    "current": frozenset(("current", "i", "curr", "amps", "amperage", "ibat", "ibatt")),
    "voltage": frozenset(("voltage", "v", "u", "volts", "potential", "vbat", "vbatt", "ubat", "ubatt", "ecell", "ewe")),
    "temperature": frozenset(("temperature", "temp", "t", "tbat", "tbatt", "temperature t")),
}  # fmt: skip
# Words that say where the whole battery was measured; they do not make it another quantity.
_BATTERY_WORDS = frozenset(
    ("battery", "batt", "bat", "pack", "terminal", "total", "measured", "meas", "test", "state", "field", "data",
     "main", "header", "stamp", "surface")
)  # fmt: skip
# Words of columns that serve where there is nothing better.
_SECOND_CHOICE = frozenset(("cell", "raw", "mean", "avg", "average"))
# Words that make a column something else than a measurement of the battery.
_OTHER_WORDS = frozenset(
    ("true", "truth", "std", "sigma", "var", "limit", "max", "min", "set", "setpoint", "target", "reference", "error",
     "residual", "predicted", "estimated", "estimate", "model", "step", "open", "circuit", "ocv", "delta", "offset",
     "bias", "nanosec", "nsecs", "nsec")
)  # fmt: skip
_HINTS = {"time": "time", "current": "cur", "voltage": "volt", "temperature": "temp"}
_NEVER = 99


class Column(NamedTuple):
    """A column chosen for a quantity; `unit` is None where its name does not say it."""

    name: str
    unit: Unit | None


def find_columns(
    source: str,
    names: Sequence[str],
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
) -> dict[str, Column]:
    """The column of each quantity, by its name: `current_A`, `Current / mA`, `I (A)`, `pack.voltage`, `timestamp_ns`.

    Names of the whole battery win over names of a cell, and those over names that merely end in the word.

    source: the file's name, for messages.
    names: the columns of the file.
    columns: quantity -> column name, where the caller knows better.
    units: quantity -> unit ("mA", "mV", "ms", "K", ...), where the name is silent or wrong.
    Returns: quantity -> Column; temperature may be missing.

    Raises:
        InputError: a quantity is missing, two columns fit equally well, or an override names what does not exist.
    """
    columns, units = dict(columns or {}), dict(units or {})
    for quantity in (*columns, *units):
        if quantity not in QUANTITIES:
            raise InputError(f"unknown quantity {quantity!r}; ohmward knows {', '.join(QUANTITIES)}")
    found = {quantity: find_column(source, names, quantity, columns, units) for quantity in QUANTITIES}
    return {quantity: column for quantity, column in found.items() if column}


def find_column(
    source: str, names: Sequence[str], quantity: str, columns: Mapping[str, str], units: Mapping[str, str]
) -> Column | None:
    """The column of one of the quantities; None only for one that may be missing. Arguments as of `find_columns`."""
    if column := _choose(source, names, quantity, columns):
        return _with_unit(column, quantity, units.get(quantity))
    if quantity in REQUIRED:
        raise _missing(source, names, quantity)
    return None


def _choose(source: str, names: Sequence[str], quantity: str, columns: Mapping[str, str]) -> Column | None:
    if quantity in columns:
        return _named(source, names, quantity, columns[quantity])
    return _fitting(source, [name for name in names if name not in columns.values()], quantity)


def _named(source: str, names: Sequence[str], quantity: str, wanted: str) -> Column:
    exact = [name for name in names if name == wanted] or [n for n in names if n.lower() == wanted.lower()]
    if not exact:
        raise InputError(
            f"{source}: there is no column {wanted!r} for the {quantity}{guess(wanted, names)}; it has: {listed(names)}"
        )
    unit = next((unit for _, unit in split_unit(exact[0]) if unit.quantity == quantity), None)
    return Column(exact[0], unit)


def _fitting(source: str, names: Sequence[str], quantity: str) -> Column | None:
    readings = [(rank, Column(name, unit)) for name in names for rank, unit in _readings(name, quantity)]
    best = min((rank for rank, _ in readings), default=_NEVER)
    if best == _NEVER:
        return None
    fits = list(dict.fromkeys(column for rank, column in readings if rank == best))
    if len({column.name for column in fits}) > 1 and quantity in REQUIRED:
        first, second = fits[0].name, fits[1].name
        raise InputError(
            f"{source}: both {first!r} and {second!r} may be the {quantity}; "
            f"choose with --column {argument(f'{quantity}={first}')} (columns={{{quantity!r}: {first!r}}})"
        )
    return fits[0]


def _readings(name: str, quantity: str) -> Iterator[tuple[int, Unit | None]]:
    """Ranks (0 is best, _NEVER is no) of the ways to read a name as this quantity."""
    for stem, unit in split_unit(name):
        if unit.quantity == quantity:
            yield _rank(stem, quantity, unit), unit
    # a bare `t` is a time; a temperature called `T` must carry its unit
    yield (_NEVER if quantity == "temperature" and name.lower() == "t" else _rank(name, quantity, None)), None


def _rank(stem: str, quantity: str, unit: Unit | None) -> int:
    words = re.findall(r"[^\W\d_]+", stem.lower())
    if _OTHER_WORDS & set(words):
        return _NEVER
    plain = [word for word in words if word not in _BATTERY_WORDS]
    for rank, candidate in enumerate((words, plain, [word for word in plain if word not in _SECOND_CHOICE])):
        if " ".join(candidate) in _SYNONYMS[quantity]:
            # a letter without a unit may be another quantity: v is a speed beside `voltage`
            bare_letter = 2 if unit is None and len(candidate) == 1 and len(candidate[0]) == 1 else 0
            return rank + bare_letter + _wall_clock(stem, quantity)
    # `motor_current` is a current, `current_speed` is not
    return 4 if words and words[-1] == quantity != "time" else _NEVER


def _wall_clock(stem: str, quantity: str) -> int:
    """A time since the start is better than the wall clock, which may be set while the log runs."""
    clocks = ("stamp", "date", "unix", "epoch")
    return 3 * (quantity == "time" and any(word in stem.lower() for word in clocks))


def _with_unit(column: Column, quantity: str, spelling: str | None) -> Column:
    if spelling is None:
        return column
    unit = unit_of(spelling)
    if unit is None or unit.quantity != quantity:
        raise InputError(f"unit {spelling!r} of the {quantity} is not known; use for example {_EXAMPLES[quantity]}")
    return column._replace(unit=unit)


_EXAMPLES = {"time": "s, ms, min or h", "current": "A or mA", "voltage": "V or mV", "temperature": "degC, K or degF"}


def _missing(source: str, names: Sequence[str], quantity: str) -> InputError:
    near = [name for name in names if _HINTS[quantity] in name.lower()]
    first = near[0] if near else "NAME"
    return InputError(
        f"{source}: no column for the {quantity} found; it has: {listed(names)}; "
        f"name it with --column {argument(f'{quantity}={first}')} (columns={{{quantity!r}: {first!r}}})"
    )


def argument(text: str) -> str:
    """The text as it must be typed in a shell."""
    return f"'{text}'" if re.search(r"[^\w=.,+-]", text) else text


def guess(wanted: str, names: Sequence[str]) -> str:
    """A question that names the nearest column, or nothing."""
    near = difflib.get_close_matches(wanted, names, n=1, cutoff=0.5)
    return f" (did you mean {near[0]!r}?)" if near else ""


def listed(names: Sequence[str], most: int = 30) -> str:
    """Names for a message, quoted and cut after `most`."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(repr(name) for name in names[:most]) + more
