"""Checks of parameters; each error names the parameter, the rule and the value."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from ohmward.errors import InputError


def as_numbers(name: str, values: Any, what: str = "an array of numbers") -> np.ndarray:
    """Convert values to an array of floats; InputError for anything but numbers, or rows of different lengths."""
    try:
        if np.asarray(values).dtype.kind not in "SU":  # text would become a number too
            return np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        pass
    raise InputError(f"{name} must be {what}, got {values!r:.80}")


def require_finite(name: str, values: float | Sequence[float]) -> None:
    """Raise InputError unless every value is a finite number."""
    numbers = as_numbers(name, values, "a number")
    finite = np.isfinite(numbers)
    if not finite.all():
        raise InputError(f"{name} must be finite, got {numbers[~finite][0]}")


def require_between(name: str, values: float | Sequence[float], low: float, high: float) -> None:
    """Raise InputError unless every value is finite and low <= value <= high."""
    require_finite(name, values)
    numbers = np.asarray(values, dtype=float)
    outside = (numbers < low) | (numbers > high)
    if outside.any():
        rule = f">= {low:g}" if high == np.inf else f"between {low:g} and {high:g}"
        raise InputError(f"{name} must be {rule}, got {numbers[outside][0]:g}")


def require_positive(name: str, values: float | Sequence[float]) -> None:
    """Raise InputError unless every value is finite and > 0."""
    require_finite(name, values)
    numbers = np.asarray(values, dtype=float)
    outside = numbers <= 0
    if outside.any():
        raise InputError(f"{name} must be > 0, got {numbers[outside][0]:g}")


def require_length(name: str, values: Sequence[float], length: int, why: str) -> None:
    """Raise InputError unless there are `length` values."""
    if len(values) != length:
        raise InputError(f"{name} must have {length} values ({why}), got {len(values)}")


def require_one_of(name: str, value: object, known: Iterable[str]) -> None:
    """Raise InputError unless the value is one of the known names; the message lists them."""
    known = tuple(known)
    if value not in known:
        raise InputError(f"{name} must be one of {', '.join(known)}, got {value!r}")


def require_mappings(**values: Mapping[str, Any] | None) -> None:
    """Raise InputError unless each value is a mapping, or None."""
    for name, value in values.items():
        if not isinstance(value, Mapping | None):
            raise InputError(f"{name} must be a dict, such as {{name: value}}, or None, got {value!r:.80}")


def path_of(path: str | PathLike[str]) -> Path:
    """Convert text to a Path; InputError for anything but text or a path."""
    if not isinstance(path, str | PathLike):
        raise InputError(f"the path of a file must be text or a Path, got {path!r:.80}")
    return Path(path)


def require_each_positive(prefix: str, owner: object, *names: str) -> None:
    """Raise InputError unless these attributes are finite and > 0; the message has the prefix before the name."""
    for name in names:
        require_positive(prefix + name, getattr(owner, name))


def require_each_not_negative(prefix: str, owner: object, *names: str) -> None:
    """Raise InputError unless these attributes are finite and >= 0; the message has the prefix before the name."""
    for name in names:
        require_between(prefix + name, getattr(owner, name), 0.0, np.inf)


#: Largest absolute value of a number in a file, by the unit at the end of its key; longer endings come before shorter
#: ones that they contain. Far beyond anything on wheels: the limits catch typing errors and broken files, 1e298 V,
#: before the numbers overflow where nobody would look for the cause.
LARGEST = {
    "_V_per_K": 10.0,
    "_degC": 1e4,
    "_ohm": 1e9,
    "_std": 10.0,
    "_share": 10.0,
    "_kWh": 1e6,
    "_Wh": 1e9,
    "_Ah": 1e9,
    "_kg": 1e7,
    "_m": 1e9,
    "_s": 1e11,
    "_A": 1e9,
    "_V": 1e9,
    "_W": 1e9,
    "_N": 1e9,
    "_K": 1e5,
}


def require_credible(place: str, value: Any) -> None:
    """Raise InputError for a number beyond the limit of its unit; values that are not finite are left to other checks.

    place: key of the value, with its unit last, "thevenin.tau_s".  value: a number, or lists of numbers.
    """
    largest = next((size for end, size in LARGEST.items() if place.endswith(end)), None)
    for number in _numbers(value):
        if isinstance(number, int) and abs(number) > sys.float_info.max:
            raise InputError(f"{place} must be below {sys.float_info.max:.2g}, got a longer number; correct it")
        if largest is not None and largest < abs(number) < float("inf"):
            raise InputError(f"{place} must be between {-largest:g} and {largest:g}, got {number:g}; correct it")


def _numbers(value: Any) -> Iterator[float]:
    if isinstance(value, list | tuple):
        for item in value:
            yield from _numbers(item)
    elif isinstance(value, int | float):
        yield value
