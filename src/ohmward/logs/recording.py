"""What recordings have in common: read-only arrays over one time that increases, and the choice of samples."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields, replace
from typing import Any, TypeVar

import numpy as np

from ohmward.errors import InputError

R = TypeVar("R", bound=Any)  #: a frozen dataclass with `name`, `time_s` (T,), `extra` and `notes`


def freeze(log: Any, names: Iterable[str]) -> None:
    """Arrays of these names and all in `extra` become read-only float64 views; what the caller owns stays as it is."""
    for name in names:
        if getattr(log, name) is not None:
            object.__setattr__(log, name, _frozen(getattr(log, name)))
    object.__setattr__(log, "extra", {name: _frozen(values) for name, values in log.extra.items()})
    object.__setattr__(log, "notes", tuple(log.notes))


def require_time(log: Any) -> None:
    """`time_s` has samples, all finite and each later than the one before.

    Raises:
        InputError: it has not.
    """
    time_s, what = log.time_s, f"{type(log).__name__} {log.name!r}: time_s"
    if time_s.ndim != 1 or not time_s.size:
        raise InputError(f"{what} must be one-dimensional with at least one sample, not {time_s.shape}")
    if not np.isfinite(time_s).all():
        raise InputError(f"{what} must be finite; drop the samples without a time")
    if (falls := np.flatnonzero(np.diff(time_s) <= 0)).size:
        i = int(falls[0])
        raise InputError(
            f"{what} must increase strictly, but sample {i + 1} ({time_s[i + 1]:g} s) does not come after sample {i} "
            f"({time_s[i]:g} s); sort the samples and merge equal times"
        )


def require_lengths(log: Any, names: Iterable[str]) -> None:
    """The arrays of these names and all in `extra` are (T,) where they are there.

    Raises:
        InputError: one is not.
    """
    for name, values in {**{name: getattr(log, name) for name in names}, **log.extra}.items():
        if values is not None and values.shape != log.time_s.shape:
            raise InputError(
                f"{type(log).__name__} {log.name!r}: {name} has shape {values.shape}, time_s has {log.time_s.shape}; "
                "give equal lengths"
            )


def select(log: R, rows: slice | np.ndarray) -> R:
    """The samples that a slice, a mask (T,) or indices pick; at least one, in order of time."""
    arrays = {f.name: value[rows] for f in fields(log) if isinstance(value := getattr(log, f.name), np.ndarray)}
    return replace(log, **arrays, extra={name: values[rows] for name, values in log.extra.items()})


def between(log: R, start_s: float, stop_s: float) -> R:
    """The samples with start_s <= time_s < stop_s; the clock keeps its zero.

    Raises:
        InputError: there is none.
    """
    first, last = np.searchsorted(log.time_s, [start_s, stop_s])
    if first == last:
        raise InputError(
            f"log {log.name!r} has no sample in {start_s:g} s <= time < {stop_s:g} s; "
            f"it spans {log.time_s[0]:g} s to {log.time_s[-1]:g} s"
        )
    return select(log, slice(first, last))


def _frozen(values: Any) -> np.ndarray:
    array = np.asarray(values, dtype=float).view()
    array.flags.writeable = False
    return array
