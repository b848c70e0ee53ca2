"""Open-circuit voltage against state of charge: mean curve, hysteresis, temperature, and the slip of an aged cell.

Curves along SoC are given on a uniform grid, or on knots: straight between them, constant beyond.

The curve of a cell that has lost lithium is not its first curve over less charge: the electrodes have slipped against
each other. With oxides of nickel, manganese and cobalt against graphite, the sloped curve of the oxide stays in place
below full, and the knee of graphite comes earlier at empty; with iron phosphate, whose curve is flat, that of graphite
stays in place above empty, and the knee comes earlier at full. With a loss L of the capacity, s = `share`,

OCV_aged(z) = OCV(z + s L (1 - z) z^2 / (z^2 + k^2))   where full stays (s > 0),
OCV_aged(z) = OCV(z + s L z (1 - z)^2 / ((1 - z)^2 + k^2))   where empty stays (s < 0).

Full and empty stay full and empty. |s| is 1 where all of the loss is lithium, and 0 where the active material of both
electrodes is lost alike (Birkl et al. 2017, J. Power Sources 341, 373).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from ohmward.battery.models.temperature import ROOM_DEGC
from ohmward.checks import require_between, require_finite, require_length
from ohmward.errors import InputError
from ohmward.trace import clip, table

#: Points of a curve that is made from tests, a table or a chemistry, and their grid of SoC.
OCV_POINTS = 201
OCV_GRID = np.linspace(0.0, 1.0, OCV_POINTS)
#: Smallest span of SoC in which points show a curve.
LEAST_SPAN = 0.2


def hat(x: np.ndarray, knots: np.ndarray) -> np.ndarray:
    """(N, K) weights of the values on the knots (K,) at x (N,)."""
    x = np.clip(x, knots[0], knots[-1])
    left = np.clip(np.searchsorted(knots, x, side="right") - 1, 0, knots.size - 2)
    share = (x - knots[left]) / (knots[left + 1] - knots[left])
    weights = np.zeros((x.size, knots.size))
    rows = np.arange(x.size)
    weights[rows, left] = 1 - share
    weights[rows, left + 1] += share
    return weights


def between_knots(values: Sequence[Any] | np.ndarray, knots: np.ndarray, x: Any) -> Any:
    """The curve through values (K,) at x; values and x may be traced."""
    found = values[0]
    for k, (left, right) in enumerate(zip(knots.tolist(), knots[1:].tolist(), strict=False)):
        found = found + (values[k + 1] - values[k]) * clip((x - left) * (1.0 / (right - left)), 0.0, 1.0)
    return found


def correlation(knots: np.ndarray, length: float) -> np.ndarray:
    """(K, K) correlation between knots of a Gauss-Markov process along SoC: e^-1 at a distance of `length`."""
    return np.exp(-np.abs(knots[:, None] - knots) / length)


#: Distance k of the knee from the end of the curve: at empty with layered oxides, at full with iron phosphate.
_KNEE_AT_EMPTY, _KNEE_AT_FULL = 0.2, 0.08


def slip_shape(soc: Any, share: float) -> Any:
    """Change of the SoC on the curve per unit of `share` and of the loss; float, array or traced.

    share: its sign gives the end that stays in place, full for >= 0.
    """
    z = clip(soc, 0.0, 1.0)
    moved, knee = (z, _KNEE_AT_EMPTY) if share >= 0.0 else (1.0 - z, _KNEE_AT_FULL)
    return (1.0 - moved) * (moved * moved) / (moved * moved + knee * knee)


def monotone(values: np.ndarray, std: np.ndarray | float = 1.0) -> np.ndarray:
    """Rising values (N,) closest to these in the mean square of their differences over `std` (N,).

    By pooling adjacent violators (Ayer et al. 1955, Ann. Math. Stat. 26, 641).
    """
    weights = 1.0 / np.broadcast_to(np.square(std), values.shape)
    levels: list[tuple[float, float, int]] = []
    for value, weight in zip(values.tolist(), weights.tolist(), strict=True):
        level = (value, weight, 1)
        while levels and levels[-1][0] > level[0]:
            lower = levels.pop()
            total = lower[1] + level[1]
            level = ((lower[0] * lower[1] + level[0] * level[1]) / total, total, lower[2] + level[2])
        levels.append(level)
    return np.repeat([mean for mean, _, _ in levels], [count for _, _, count in levels])


def beyond_line(above_V: Any, below_V: Any) -> tuple[Any, Any]:
    """Mean [V] and variance [V^2] of what a line through the mean leaves out of a curve over a normal SoC.

    By Gauss-Hermite points, sqrt(3) sigma above and below the mean: derivatives would mistake the unevenness of a
    measured curve for its shape (statistical linearisation, Gelb 1974, 6.2).

    above_V, below_V: the curve minus the line at the outer points.
    """
    mean_V = (above_V + below_V) / 6.0
    return mean_V, (above_V * above_V + below_V * below_V) / 6.0 - mean_V * mean_V


@dataclass(frozen=True)
class OcvCurve:
    """Open-circuit voltage on a uniform grid of SoC from 0 to 1, ends included.

    Between the points it is a monotone cubic or straight, beyond the ends a straight line with the end slope.
    """

    #: (K,) mean of charge and discharge branch at the reference temperature, non-decreasing
    voltage_V: tuple[float, ...]
    #: (K,) half the distance between the fully developed charge and discharge branches, >= 0
    hysteresis_V: tuple[float, ...] = ()
    temperature_V_per_K: tuple[float, ...] = ()  #: (K,) change of voltage_V with temperature
    reference_degC: float = ROOM_DEGC  #: temperature for which voltage_V is given
    #: between the points: "hermite" (default), a monotone cubic, or "linear"
    interpolation: Literal["hermite", "linear"] | None = None

    def __post_init__(self) -> None:
        n = len(self.voltage_V)
        if n < 2:
            raise InputError(f"ocv.voltage_V needs at least 2 points from SoC 0 to 1, got {n}")
        for name in ("hysteresis_V", "temperature_V_per_K"):
            if not getattr(self, name):
                object.__setattr__(self, name, (0.0,) * n)
            require_length(f"ocv.{name}", getattr(self, name), n, "as many as ocv.voltage_V")
            require_finite(f"ocv.{name}", getattr(self, name))
        require_finite("ocv.voltage_V", self.voltage_V)
        if np.any(np.diff(self.voltage_V) < 0):
            at = int(np.argmin(np.diff(self.voltage_V))) / (n - 1)
            raise InputError(f"ocv.voltage_V must not fall with SoC, but it does above SoC {at:.3f}; sort or refit it")
        require_between("ocv.hysteresis_V", self.hysteresis_V, 0.0, np.inf)

    def mean_V(self, soc: Any, temperature_degC: Any) -> Any:
        """Mean of both branches [V] at soc, float, array or traced."""
        warmer_K = temperature_degC - self.reference_degC
        return self._at(self.voltage_V, soc) + warmer_K * self._at(self.temperature_V_per_K, soc)

    def hysteresis_at(self, soc: Any) -> Any:
        """Half the distance of the two branches [V] at soc (M in the literature), float, array or traced."""
        return self._at(self.hysteresis_V, soc)

    def soc_at(self, voltage_V: float, temperature_degC: float = ROOM_DEGC, branch: float = 0.0) -> float:
        """State of charge at which the curve passes `voltage_V`, in [0, 1]: the inverse of the curve, offline.

        branch: -1 discharge, 0 mean, 1 charge. A voltage above (below) the curve gives 1 (0).
        """
        soc = np.linspace(0.0, 1.0, 4001)
        curve = self.mean_V(soc, temperature_degC) + branch * self.hysteresis_at(soc)
        return float(np.interp(voltage_V, np.maximum.accumulate(curve) + 1e-12 * np.arange(len(soc)), soc))

    def corrected(
        self,
        voltage_V: np.ndarray,
        hysteresis_ratio: float = 1.0,
        more_V_per_K: Any = 0.0,
        soc: np.ndarray | None = None,
        std_V: np.ndarray | float = 1.0,
    ) -> OcvCurve:
        """The curve as a fit corrected it.

        voltage_V: (N,) its mean on a uniform grid of SoC, made monotone here; hysteresis_ratio: >= 0, of the hysteresis
        over that of this curve; more_V_per_K: (N,) or 0, change with temperature beyond that of this curve.
        std_V: (N,) error of the mean: where it falls, the less certain voltages give way; a number for equal ones.
        soc: (N,) SoC at which hysteresis and change with temperature are read from this curve; None keeps their places.
        """
        soc = np.linspace(0.0, 1.0, voltage_V.size) if soc is None else soc
        hysteresis_V = np.maximum(hysteresis_ratio * np.asarray(self.hysteresis_at(soc)), 0.0)
        slope = self._at(self.temperature_V_per_K, soc) + more_V_per_K
        return replace(
            self,
            voltage_V=tuple(monotone(voltage_V, std_V).tolist()),
            hysteresis_V=tuple(hysteresis_V.tolist()),
            temperature_V_per_K=tuple(slope.tolist()),
        )

    def scaled(self, factor: float) -> OcvCurve:
        """The curve of `factor` such cells in series."""
        return replace(
            self,
            voltage_V=tuple(factor * v for v in self.voltage_V),
            hysteresis_V=tuple(factor * v for v in self.hysteresis_V),
            temperature_V_per_K=tuple(factor * v for v in self.temperature_V_per_K),
        )

    def _at(self, values: tuple[float, ...], soc: Any) -> Any:
        if not any(values):
            return 0.0 * soc
        return table(values, 0.0, 1.0 / (len(values) - 1), soc, kind=self.interpolation or "hermite")
