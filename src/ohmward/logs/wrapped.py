"""Currents that wrapped: a 16-bit number of milliamperes goes from 32.767 A to -32.768 A, and the voltage does not.

At an edge of the voltage dV = R dI, or R (dI - P sign(dI)) where the number wrapped, P its range. A log whose edges one
R explains only if some of them wrapped, and others did not, has such a current.
"""

from __future__ import annotations

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.sign import spread

#: Range of a 16-bit number, in its last digit; of it the current uses this share at least.
_RANGE, _USED = 65_536, 0.5
#: Last digits [A] that are tried, the smallest first.
_LAST_DIGITS_A = (1e-4, 1e-3, 1e-2, 1e-1)
#: An edge of the voltage is this share of the largest; so many edges are looked at.
_EDGE, _MOST_EDGES = 0.2, 300
#: So many edges wrapped at least, and so many did not; they leave this share of the squares that they leave as logged.
_FEWEST, _LEFT = 5, 0.1


def require_not_wrapped(source: str, current_A: np.ndarray, voltage_V: np.ndarray) -> None:
    """Refuse a current that wrapped.

    current_A, voltage_V: (T,) of the battery, of either sign; nan where not known.

    Raises:
        InputError: names the range of the number, and how often the current wrapped.
    """
    known = np.isfinite(current_A) & np.isfinite(voltage_V)
    if not known.any():
        return
    largest_A = float(np.abs(current_A[known]).max())
    digit_A = next((digit for digit in _LAST_DIGITS_A if largest_A <= digit * _RANGE / 2), None)
    if digit_A is None or largest_A < _USED * digit_A * _RANGE / 2:
        return
    range_A = digit_A * _RANGE
    count = count_wraps(np.diff(current_A[known]), np.diff(voltage_V[known]), range_A)
    if count >= _FEWEST:
        raise InputError(
            f"{source}: the voltage contradicts {count} steps of the current unless {range_A:g} A are added: a 16-bit "
            f"number of {1e3 * digit_A:g} mA that wrapped beyond {range_A / 2:g} A; let the logger write more bits, or "
            "another unit"
        )


def count_wraps(dI: np.ndarray, dV: np.ndarray, range_A: float) -> int:
    """Number of edges at which the current wrapped; 0 where the edges as logged are explained as well.

    dI, dV: (T - 1,) steps of current [A] and voltage [V].
    """
    size = np.abs(dV)
    edge = np.flatnonzero((size >= _EDGE * size.max(initial=0.0)) & (size > 6.0 * spread(dV)) & (dI != 0.0))
    edge = edge[:: max(edge.size // _MOST_EDGES, 1)]
    if edge.size < _FEWEST:
        return 0
    dI, dV = dI[edge], dV[edge]
    as_logged = float(dV @ dV) - float(dI @ dV) ** 2 / max(float(dI @ dI), 1e-300)
    steps_A = np.stack([dI, dI - range_A * np.sign(dI)], axis=1)
    large = np.abs(steps_A) > _EDGE * range_A
    ohms = np.broadcast_to(dV[:, None], steps_A.shape)[large] / steps_A[large]
    left_V2 = (dV[:, None] - ohms[:, None, None] * steps_A) ** 2
    left = left_V2.min(axis=2).sum(axis=1)
    if not ohms.size or left.min() > _LEFT * as_logged:
        return 0
    is_wrapped = np.argmin(left_V2[np.argmin(left)], axis=1)
    return int(is_wrapped.sum()) if np.count_nonzero(is_wrapped == 0) >= _FEWEST else 0
