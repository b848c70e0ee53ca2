"""Estimates along a whole log: the same object for charge, slip and range."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntFlag
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeVar

import numpy as np

from ohmward.filters.flags import count_flags
from ohmward.optional import require
from ohmward.rich_display import RichDisplay
from ohmward.runs import duration

if TYPE_CHECKING:
    from pandas import DataFrame

E = TypeVar("E", bound=tuple[Any, ...])


@dataclass(frozen=True, eq=False)
class Run(RichDisplay, Generic[E]):
    """Estimates along a whole log; their fields are attributes of the run too: `run.soc`."""

    time_s: np.ndarray  #: (T,) the log's
    estimates: E  #: every field with time in front: (T,), or (T, wheels)
    seconds: float  #: computing time, compilation included

    #: Type of the flags.
    flag_type: ClassVar[type[IntFlag]]

    def __getattr__(self, name: str) -> np.ndarray:
        """A field of the estimates, (T,) or (T, wheels)."""
        if name.startswith("_") or name == "estimates" or not hasattr(self.estimates, name):
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}", name=name, obj=self)
        values: np.ndarray = getattr(self.estimates, name)
        return values

    def __repr__(self) -> str:
        length_s = float(self.time_s[-1] - self.time_s[0]) if len(self.time_s) else 0.0
        flags = self.counts() or "none"
        return f"{type(self).__name__}({len(self.time_s)} samples in {duration(length_s)}, flags {flags})"

    def __dir__(self) -> list[str]:
        """Names of the attributes, with the fields of the estimates."""
        return sorted({*super().__dir__(), *_fields(self.estimates)})

    @property
    def flags(self) -> np.ndarray:
        """(T,) sums of flag values, as integers."""
        return _fields(self.estimates)["flags"].astype(int)

    def counts(self) -> dict[str, int]:
        """Number of samples that carry each flag, by name; flags that never occur are left out."""
        return count_flags(self.flags, self.flag_type)

    def to_pandas(self) -> DataFrame:
        """A row for each sample, indexed by `time_s`; flags are integers, arrays are columns `name_0`, `name_1`, ...

        What the run has stored at the end of the log only is left out.

        Raises:
            MissingPackageError: pandas is not installed.
        """
        pandas = require("pandas", "to_pandas")
        along = {name: values for name, values in columns(self.estimates) if len(values) == len(self.time_s)}
        data = {**along, "flags": self.flags}
        return pandas.DataFrame(data, index=pandas.Index(self.time_s, name="time_s"))


def columns(estimates: Any, prefix: str = "") -> Iterator[tuple[str, np.ndarray]]:
    """Name and values (T,) of every number of the estimates."""
    for name, values in _fields(estimates).items():
        if isinstance(values, tuple):
            yield from columns(values, f"{prefix}{name}_")
            continue
        table = np.asarray(values)
        for index in np.ndindex(table.shape[1:]):
            yield "_".join([prefix + name, *map(str, index)]), table[(slice(None), *index)]


def _fields(estimates: Any) -> dict[str, Any]:
    return estimates._asdict()
