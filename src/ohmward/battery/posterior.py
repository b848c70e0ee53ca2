"""Most likely parameters of a battery given voltages: Gauss-Newton on the posterior, for identification and learning.

And the least errors that a file keeps, however much data agree: none is surer than its model is accurate.

    minimise  (x - m)' P^-1 (x - m) + sum w rho(r^2 / R),      R = white^2 + (share over)^2 + (std slope)^2

with the residuals r = y - V(x). An error of the model persists for minutes, so that a sample counts w <= 1. Samples
that do not fit count less: rho is the pseudo-Huber loss (Hartley and Zisserman 2004, A6.8), by reweighting.

The two fits keep their unknowns and priors apart. A test is tied to full charges, so that its voltage is linear in
resistances that no file has yet, and the chemistry gives their prior. Everyday logs leave the state of charge open, and
correct the logarithms of a file's values, whose prior is the file's own knowledge.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np

from ohmward.battery.models.ocv import OcvCurve
from ohmward.errors import InputError

#: Knots of SoC of the correction of the open-circuit curve. Stages of graphite are 5 % of SoC wide and more; the ends
#: are steep. The curves of the chemistries have their bends at knots, so that the bends of a curve that is not the
#: cell's favour no SoC axis over another.
OCV_KNOTS = np.concatenate([[0.0, 0.01, 0.02, 0.035], np.linspace(0.05, 0.95, 37), [0.96, 0.97, 0.98, 0.99, 1.0]])
#: Knots of the correction of its change with temperature, and correlation length of that: a stage of graphite.
ENTROPY_KNOTS, ENTROPY_LENGTH = np.array([0.0, 0.5, 1.0]), 0.2
#: Smallest error of the SoC axis of a curve: branches of measured cells agree to within this.
SOC_AXIS_STD = 0.005
#: Smallest error of an activation [K]: that of measured cells differs by 1000 and more between warm and cold, and a fit
#: at two temperatures is also used beyond them.
ACTIVATION_STD_K = 700.0
#: Smallest relative error of a hysteresis: the part of the gap of low-rate branches that is not overpotential was 0.71
#: to 0.87 for a cell at -15 to 45 degC.
HYSTERESIS_STD = 0.15
#: The same of a hysteresis from low-rate branches alone, 0.35 to 0.7 of their gap on measured LFP cells, and of a
#: chemistry's usual one: half the gap is 2 to 21 mV at mid SoC of seven lithium cells at 25 degC, 12 to 19 usually.
USUAL_HYSTERESIS_STD = 0.5
#: Relative error of the overpotential that is the model's own, however well its resistances are known.
OVERPOTENTIAL_STD = 0.1
#: Smallest error of the curve's change with temperature over that before any data, and the error of one from low-rate
#: tests: rests at two temperatures are not equally complete, and branches include overpotential, which changes as well.
ENTROPY_SHARE = 0.5
#: Number of standard deviations beyond which errors count less.
_ROBUST_AT = 2.5
#: Error of SoC from sample to sample, which the slope of the curve turns into a voltage error.
_SOC_STD = 0.003
#: Most halvings of a step, and step in posterior standard deviations below which the search ends.
_MOST_HALVINGS, _SMALL_STEP = 5, 0.03
#: Largest rise of the cost in a step: the slope of the curve is an average, so that no step is exactly downhill.
_SLACK = 0.5


@dataclass(frozen=True)
class Unknowns:
    """Unknowns of a fit by groups, in the order of their vector."""

    sizes: Mapping[str, int]  #: number of each group, by its name; 0 for one that is not sought
    names: tuple[str, ...] = ()  #: (K,) of the unknowns, where a file keeps what is known of them

    @property
    def size(self) -> int:
        """Number K of unknowns."""
        return sum(self.sizes.values())

    def group(self, name: str) -> slice:
        """Places of a group in the vector of all; empty for one that is not sought."""
        if name not in self._groups:
            raise InputError(f"no group of unknowns {name!r}; there are {', '.join(self.sizes)}")
        return self._groups[name]

    @cached_property
    def _groups(self) -> dict[str, slice]:
        stops = accumulate(self.sizes.values())
        return {name: slice(stop - size, stop) for (name, size), stop in zip(self.sizes.items(), stops, strict=True)}

    def places(self, *names: str) -> np.ndarray:
        """Places of several groups in the vector of all."""
        return np.concatenate([np.arange(self.size)[self.group(name)] for name in names])


class Gaussian(NamedTuple):
    """Gaussian density of the unknowns x: precision P^-1 (K, K) and information P^-1 m (K,)."""

    precision: np.ndarray
    information: np.ndarray

    def times(self, other: Gaussian) -> Gaussian:
        """The product of both densities."""
        return Gaussian(self.precision + other.precision, self.information + other.information)

    def cost(self, x: np.ndarray) -> float:
        """(x - m)' P^-1 (x - m), up to a constant."""
        return float(x @ self.precision @ x - 2.0 * self.information @ x)


def variances(rows: np.ndarray, cov: np.ndarray) -> np.ndarray:
    """(N,) variances of rows (N, K) @ x, with the covariance (K, K) of x."""
    return np.einsum("nk,kl,nl->n", rows, cov, rows)


class Tangent(Protocol):
    """Rows of a problem, linear about a point."""

    @property
    def residual(self) -> np.ndarray:
        """(R,) residuals over their standard deviations, outlying ones counting less."""
        ...

    @property
    def columns(self) -> np.ndarray:
        """(R, K) derivatives of the expected values, over the same standard deviations."""
        ...

    @property
    def cost(self) -> float:
        """Sum of their losses."""
        ...


#: Type of the rows of a problem.
T = TypeVar("T", bound=Tangent)


def voltage_variance(white_V: float, share: Any, over_V2: Any, slope_V: Any) -> Any:
    """(N,) variance R of a single voltage [V^2].

    share: relative error of the overpotential, of which over_V2 (N,) is the square; slope_V: (N,) of the voltage along
    SoC.
    """
    return white_V**2 + share**2 * over_V2 + (_SOC_STD * slope_V) ** 2


def robust_weights(square: np.ndarray) -> np.ndarray:
    """(N,) weights of the pseudo-Huber loss at r^2 / R: 1 for small residuals, like 1/|r| for large ones."""
    return np.asarray(1.0 / np.sqrt(1.0 + square / _ROBUST_AT**2))


def pseudo_huber(robust: np.ndarray) -> np.ndarray:
    """(N,) loss rho of residuals with these weights."""
    return 2 * _ROBUST_AT**2 * (1.0 / robust - 1.0)


def gauss_newton(
    problem: Callable[[np.ndarray], T],
    prior: Gaussian,
    x: np.ndarray,
    most_steps: int,
    minimum: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray],
) -> tuple[np.ndarray, T]:
    """The minimum, and the rows there.

    minimum: of the quadratic function with Hessian H (K, K) and the negative gradient (K,) at x (K,).
    """
    here = problem(x)
    for _ in range(most_steps):
        columns = here.columns
        H = hessian(columns, prior)
        step = minimum(H, columns.T @ here.residual + prior.information - prior.precision @ x, x) - x
        shorter = 1.0
        for _ in range(_MOST_HALVINGS):
            there = problem(x + shorter * step)
            if there.cost + prior.cost(x + shorter * step) <= here.cost + prior.cost(x) + _SLACK:
                break
            shorter *= 0.5
        else:
            break
        x, here = x + shorter * step, there
        if shorter**2 * step @ H @ step < _SMALL_STEP**2 * step.size:
            break
    return x, here


def hessian(columns: np.ndarray, prior: Gaussian) -> np.ndarray:
    """(K, K) Hessian of half the cost, by Gauss and Newton: the posterior precision.

    columns: (M, K) of the rows.
    """
    return columns.T @ columns + prior.precision


def remaining_std(found: float, least: float, before: float) -> float:
    """Standard deviation that is left in a file: the one found, not below the least and never above the one before."""
    return min(max(found, least), before)


def beyond_axis_V(std_V: np.ndarray, ocv: OcvCurve, axis_std: float = SOC_AXIS_STD) -> np.ndarray:
    """(N,) error of the model [V] on a uniform grid of SoC without that of the SoC axis, which the filter adds itself.

    Otherwise a steep end of the curve would count twice, and any voltage would be possible there.
    """
    fine = np.linspace(0.0, 1.0, len(ocv.voltage_V))
    slope_V = np.interp(np.linspace(0.0, 1.0, std_V.size), fine, np.gradient(np.asarray(ocv.voltage_V), fine))
    return np.sqrt(np.maximum(std_V**2 - (axis_std * slope_V) ** 2, 0.0))
