"""The common base of logs: read-only arrays over one increasing time, and the selection of samples."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from copy import copy
from dataclasses import fields, replace
from typing import Any, Self

import numpy as np

from ohmward.checks import as_numbers
from ohmward.errors import InputError
from ohmward.logs.clock import clock_of_dates
from ohmward.logs.columns import guess, listed
from ohmward.logs.dates import window_s
from ohmward.logs.frame import plain_array
from ohmward.logs.hints import FileHints
from ohmward.logs.table import Note
from ohmward.quantities import QUANTITIES
from ohmward.rich_display import RichDisplay
from ohmward.runs import duration


class TimeSeries(RichDisplay):
    """Base of the frozen dataclasses with `name`, `time_s` (T,), its Unix start, more arrays, `extra` and `notes`."""

    name: str
    time_s: np.ndarray
    extra: Mapping[str, np.ndarray]
    notes: tuple[Note, ...]
    start_unix_s: float | None

    def __len__(self) -> int:
        return self.time_s.size

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.name!r}, {len(self)} samples in {duration(self.duration_s)})"

    @property
    def duration_s(self) -> float:
        """Last minus first time [s]."""
        return float(self.time_s[-1] - self.time_s[0])

    @property
    def dt_s(self) -> np.ndarray:
        """(T-1,) [s], the time between neighbouring samples."""
        return np.diff(self.time_s)

    def column(self, name: str) -> np.ndarray:
        """A column (T,) of `extra`, in its own unit; InputError with the nearest name where there is none."""
        if name in self.extra:
            return self.extra[name]
        names = list(self.extra)
        there = f"it has: {listed(names)}" if names else "it has no further numeric columns"
        raise InputError(f"{self.name}: there is no column {name!r}{guess(name, names)}; {there}")

    def quantities(self, owner: str) -> dict[str, np.ndarray]:
        """Measured quantities (T,) of the "battery" or the "body", by their name in the table of quantities.

        A quantity without a field of its own is taken from `extra`.
        """
        known = [quantity for quantity in QUANTITIES.values() if quantity.owner == owner and quantity.words]
        found = {quantity.name: getattr(self, quantity.field, self.extra.get(quantity.field)) for quantity in known}
        return {name: values for name, values in found.items() if values is not None}

    def select(self, rows: slice | np.ndarray) -> Self:
        """The samples that a slice, a mask (T,) or indices pick; at least one, in order of time."""
        log: Any = self
        arrays = {f.name: value[rows] for f in fields(log) if isinstance(value := getattr(log, f.name), np.ndarray)}
        return replace(log, **arrays, extra={name: values[rows] for name, values in self.extra.items()})

    def between(self, start_s: float, stop_s: float) -> Self:
        """The samples with start_s <= time_s < stop_s; the clock keeps its zero; InputError where there is none."""
        first, last = np.searchsorted(self.time_s, as_numbers("the time of a sample", [start_s, stop_s], "a number"))
        if first == last:
            raise InputError(
                f"log {self.name!r} has no sample in {start_s:g} s <= time < {stop_s:g} s; "
                f"it spans {self.time_s[0]:g} s to {self.time_s[-1]:g} s"
            )
        return self.select(slice(first, last))

    def with_notes(self, *notes: Note) -> Self:
        """The same log with more notes."""
        log = copy(self)  # whose arrays have been checked
        object.__setattr__(log, "notes", self.notes + notes)
        return log

    def part(self, hints: FileHints) -> Self:
        """The part between `start` and `stop` of the hints, if they give them; InputError where it has no sample."""
        window = window_s(self.name, self.start_unix_s, hints)
        return self if window is None else self.between(*window)

    def _freeze(self, names: Iterable[str]) -> None:
        """Make the time, the arrays of these names and those in `extra` read-only float64 views.

        A time given as dates also sets the Unix start, unless that was given.
        """
        start_unix_s = self.start_unix_s
        time_s = self._plain("time_s", self.time_s)
        if time_s.dtype.kind in "mM":
            clock = clock_of_dates(time_s)
            time_s = clock.time_s
            start_unix_s = clock.start_unix_s if start_unix_s is None else start_unix_s
        arrays = {"time_s": time_s} | {name: getattr(self, name) for name in names}
        frozen: dict[str, Any] = {name: self._numbers(name, v) for name, v in arrays.items() if v is not None}
        frozen["extra"] = {name: self._numbers(name, values) for name, values in self.extra.items()}
        frozen |= {"notes": tuple(self.notes), "start_unix_s": start_unix_s}
        for name, values in frozen.items():
            object.__setattr__(self, name, values)
        time_s = self.time_s
        title = f"{self._title}: time_s"
        if time_s.ndim != 1 or not time_s.size:
            raise InputError(f"{title} must be one-dimensional with at least one sample, not {time_s.shape}")
        if not np.isfinite(time_s).all():
            raise InputError(f"{title} must be finite; drop the samples without a time")
        if (falls := time_s[1:] <= time_s[:-1]).any():
            i = int(np.argmax(falls))
            raise InputError(
                f"{title} must increase strictly, but sample {i + 1} ({time_s[i + 1]:g} s) does not come after sample "
                f"{i} ({time_s[i]:g} s); sort the samples and merge equal times"
            )

    def _plain(self, name: str, values: Any) -> np.ndarray:
        try:
            return plain_array(values)
        except (TypeError, ValueError) as error:
            raise InputError(f"{self._title}: {name} must be an array of numbers ({error})") from error

    def _numbers(self, name: str, values: Any) -> np.ndarray:
        array = self._plain(name, values)
        if array.dtype.kind not in "iuf":
            kind = {"M": "dates", "m": "durations"}.get(array.dtype.kind, "text")
            raise InputError(
                f"{self._title}: {name} must be numbers, not {kind}; only time_s may be dates or durations"
            )
        array = array.astype(float, copy=False).view()
        array.flags.writeable = False
        return array

    @property
    def _title(self) -> str:
        return f"{type(self).__name__} {self.name!r}"

    def _require_lengths(self, names: Iterable[str]) -> None:
        """Raise InputError unless the arrays of these names and in `extra`, where present, are (T,)."""
        for name, values in {**{name: getattr(self, name) for name in names}, **self.extra}.items():
            if values is not None and values.shape != self.time_s.shape:
                shapes = f"{name} has shape {values.shape}, time_s has {self.time_s.shape}"
                raise InputError(f"{self._title}: {shapes}; give equal lengths")
