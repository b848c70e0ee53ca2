"""Ground of the MuJoCo plant: adhesion under each wheel and grade, as functions of time and place."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ohmward.checks import require_between, require_finite
from ohmward.errors import InputError

#: Steepest grade of a simulation: 40 degrees, beyond which a wheeled robot slides.
STEEPEST_GRADE_RAD = 0.7
#: Largest adhesion of a simulation, above that of any tyre.
ROUGHEST = 3.0


@dataclass(frozen=True)
class Ground:
    """Adhesion and grade by functions of one's own; `uniform`, `switching` and `zones` make the usual ones."""

    #: (time_s, position_m (4, 2) of the wheels [m]) -> adhesion, a number or (4,), in (0, 3]
    friction: Callable[[float, np.ndarray], Any]
    #: (time_s, position_m (2,) of the robot [m]) -> slope, > 0 where x leads uphill, within +-0.7
    grade_rad: Callable[[float, np.ndarray], float]


def uniform(friction: ArrayLike, grade_rad: float = 0.0) -> Ground:
    """The same everywhere and always; friction: a number, or (4,) for each wheel its own.

    Raises:
        InputError: a value out of its range.
    """
    return switching((), np.asarray(friction, dtype=float)[None], grade_rad)


def switching(time_s: ArrayLike, friction: ArrayLike, grade_rad: ArrayLike = 0.0) -> Ground:
    """Ground that changes at the times (K,) [s], under all wheels at once.

    friction: (K + 1,) before, between and after the times, or (K + 1, 4) for each wheel.
    grade_rad: a number, or (K + 1,).

    Raises:
        InputError: times that do not increase, another number of values, a value out of its range.
    """
    times = _increasing("time_s", time_s)
    mu, grade = _pieces(times, friction, grade_rad)

    def now(t: float) -> int:
        return int(times.searchsorted(t, side="right"))

    return Ground(lambda t, _: mu[now(t)], lambda t, _: grade[now(t)])


def zones(edge_m: ArrayLike, friction: ArrayLike, grade_rad: ArrayLike = 0.0) -> Ground:
    """Ground that changes at the lines x = edge_m (K,) [m], under each wheel as it comes there.

    friction: (K + 1,) from the lowest x to the highest, or (K + 1, 4) for each wheel.
    grade_rad: a number, or (K + 1,); it takes effect as the robot's centre comes there.

    Raises:
        InputError: edges that do not increase, another number of values, a value out of its range.
    """
    edges = _increasing("edge_m", edge_m)
    mu, grade = _pieces(edges, friction, grade_rad)
    wheels = np.arange(4)
    return Ground(
        lambda _, position_m: mu[edges.searchsorted(position_m[:, 0], side="right"), wheels],
        lambda _, position_m: grade[edges.searchsorted(position_m[0], side="right")],
    )


def _increasing(name: str, values: ArrayLike) -> np.ndarray:
    array = np.asarray(values, dtype=float)
    require_finite(name, array.ravel().tolist())
    if array.ndim != 1 or np.any(np.diff(array) <= 0):
        raise InputError(f"{name} must be a list that increases strictly, got {array.tolist()}")
    return array


def _pieces(edges: np.ndarray, friction: ArrayLike, grade_rad: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Adhesion (K + 1, 4) and grade (K + 1,) between the edges (K,)."""
    mu, grade = np.asarray(friction, dtype=float), np.asarray(grade_rad, dtype=float)
    count = edges.size + 1
    if mu.shape not in ((count,), (count, 4)):
        raise InputError(f"friction must be ({count},) or ({count}, 4), one piece more than edges, got {mu.shape}")
    if grade.shape not in ((), (count,)):
        raise InputError(f"grade_rad must be a number or ({count},), one piece more than edges, got {grade.shape}")
    require_between("friction", mu.ravel().tolist(), 1e-3, ROUGHEST)
    require_between("grade_rad", grade.ravel().tolist(), -STEEPEST_GRADE_RAD, STEEPEST_GRADE_RAD)
    return np.broadcast_to(mu.reshape(count, -1), (count, 4)), np.broadcast_to(grade, count)
