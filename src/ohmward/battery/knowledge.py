"""Knowledge that a battery file has gained from logs: a Gaussian over the corrections of its own parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ohmward.checks import require_between, require_finite
from ohmward.errors import InputError


@dataclass(frozen=True)
class SeenLog:
    """A log that a battery has learnt from."""

    name: str  #: of the log
    fingerprint: str = ""  #: of its measurements; the same log once more has the same one, "" where none was taken
    #: Unix time of its first and its last sample, None without a wall clock
    start_unix_s: float | None = None
    end_unix_s: float | None = None
    hours: float = 0.0  #: its length
    summary: str = ""  #: what was learnt from it, in a line
    anchors: int = 0  #: number of times at which something else than the voltage told its state of charge
    end_soc: float | None = None  #: state of charge at its last sample, None in a file that did not keep it
    end_soc_std: float | None = None  #: its standard deviation
    end_current_A: float = 0.0  #: current there


@dataclass(frozen=True)
class Knowledge:
    """Covariance of the errors left in the parameters of a battery file; their means are in the file itself."""

    names: tuple[str, ...]  #: (K,) of the parameters, as `learning.parameters` defines them
    covariance: tuple[float, ...]  #: (K (K + 1) / 2,) lower triangle, row by row
    logs: tuple[SeenLog, ...] = ()  #: that the battery has learnt from, in their order
    #: lowest state of charge that they have shown. Above it the curve is known over the charge below full, whatever the
    #: capacity is; below it, along SoC.
    seen_from_soc: float = 1.0

    def __post_init__(self) -> None:
        size = len(self.names)
        if len(self.covariance) != size * (size + 1) // 2:
            raise InputError(
                f"knowledge.covariance must be the lower triangle of {size} by {size} parameters, "
                f"{size * (size + 1) // 2} numbers, got {len(self.covariance)}; remove [knowledge] to begin anew"
            )
        require_finite("knowledge.covariance", self.covariance)
        require_between("knowledge.seen_from_soc", self.seen_from_soc, 0.0, 1.0)

    @classmethod
    def of(
        cls, names: Sequence[str], covariance: np.ndarray, logs: Sequence[SeenLog] = (), seen_from_soc: float = 1.0
    ) -> Knowledge:
        """The knowledge with this covariance (K, K)."""
        lower = covariance[np.tril_indices(len(names))]
        return cls(tuple(names), tuple(lower.tolist()), tuple(logs), seen_from_soc)

    @property
    def matrix(self) -> np.ndarray:
        """(K, K) covariance; what rounding took from its smallest variances is given back."""
        size = len(self.names)
        full = np.zeros((size, size))
        full[np.tril_indices(size)] = self.covariance
        full += np.tril(full, -1).T
        std = np.sqrt(np.maximum(np.diag(full), _LEAST_VARIANCE))
        values, vectors = np.linalg.eigh(full / np.outer(std, std))
        return np.outer(std, std) * ((vectors * np.maximum(values, _LEAST_KNOWN_EIGENVALUE)) @ vectors.T)


#: Numbers in a file have six digits, so that no eigenvalue of a correlation matrix is known better.
_LEAST_KNOWN_EIGENVALUE = 1e-6
#: Least variance of a parameter, in its unit.
_LEAST_VARIANCE = math.ulp(1.0)
