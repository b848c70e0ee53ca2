"""Dense linear algebra on small matrices, in loops: NumPy's routines reject object arrays, which hold traced scalars.

Nothing here branches on data, so every function runs with floats and with traced scalars alike.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ohmward.trace import Scalar, maximum, sqrt, where

PIVOT_FLOOR = 1e-14
"""Smallest pivot of a Cholesky factor, relative to the variance on the diagonal: some fifty roundings of float64."""

TINY = 2.0**-126
"""Floor of a divisor, so that a variance of zero is safe; float32's smallest normal number survives the export."""


def cholesky(P: np.ndarray, scale: float = 1.0) -> tuple[np.ndarray, float]:
    """Lower factor L of scale^2 P = L L', guarded: a pivot below the floor is raised to it, and `ok` reports it.

    Only the lower triangle of P is read; its structural zeros stay zeros in L. The elimination is that of P = U D U'
    with ones on the diagonal of U, because each column then waits for one division only, not for a square root as
    well.

    Args:
        P: (n, n) covariance.
        scale: of the factor, > 0.

    Returns:
        L: (n, n); its diagonal is positive whatever P holds, NaN excepted.
        ok: 1.0 when no pivot is below -`PIVOT_FLOOR` * |P[j, j]|; 0.0 when P is indefinite or not a number, and then
            L is not a factor of P.
    """
    n = len(P)
    L, U, V = (np.zeros_like(P, dtype=np.result_type(P, float)) for _ in range(3))  # V = U D
    ok = 1.0
    for j in range(n):
        pivot = _less_products(P[j, j], U[j, :j], V[j, :j])
        floor = PIVOT_FLOOR * abs(P[j, j]) + TINY
        ok = where(pivot >= -floor, ok, 0.0)
        d = where(pivot < floor, floor, pivot)  # NaN stays
        reciprocal, root = 1.0 / d, scale * np.sqrt(d)
        L[j, j] = root
        for i in range(j + 1, n):
            V[i, j] = _less_products(P[i, j], U[i, :j], V[j, :j])
            U[i, j] = V[i, j] * reciprocal
            L[i, j] = V[i, j] * (root * reciprocal)
    return L, ok


def _less_products(x: Scalar, a: np.ndarray, b: np.ndarray) -> Scalar:
    """The difference x - a_1 b_1 - a_2 b_2 - ..., the newest product last, so that nothing else waits for it."""
    for first, second in zip(a, b, strict=True):
        x = x - first * second
    return x


def solve_lower(L: np.ndarray, B: np.ndarray) -> np.ndarray:
    """Solve L X = B by forward substitution; L: (n, n) lower triangle, B: (n,) or (n, k)."""
    rows: list[Any] = []
    for i in range(len(L)):
        rows.append((B[i] - sum(L[i, j] * rows[j] for j in range(i))) / L[i, i])
    return np.array(rows)


def solve_upper(U: np.ndarray, B: np.ndarray) -> np.ndarray:
    """Solve U X = B by back substitution; U: (n, n) upper triangle, B: (n,) or (n, k)."""
    return solve_lower(U[::-1, ::-1], B[::-1])[::-1]


def solve_spd(S: np.ndarray, B: np.ndarray) -> np.ndarray:
    """Solve S X = B for a covariance S (m, m) and B (m,) or (m, k); one guarded division when m = 1."""
    if len(S) == 1:
        return B * (1.0 / maximum(S[0, 0], TINY))
    L, _ = cholesky(S)
    return solve_upper(L.T, solve_lower(L, B))


def mirror_lower(M: np.ndarray) -> np.ndarray:
    """The lower triangle of M (n, n) mirrored: symmetric to the bit, M[i, j] and M[j, i] the very same element."""
    i, j = np.indices(M.shape)
    return M[np.maximum(i, j), np.minimum(i, j)]


def lower_triangle(M: np.ndarray) -> np.ndarray:
    """The lower triangle of M (n, n), row by row, (n (n + 1) / 2,)."""
    return M[np.tril_indices(len(M))]


def symmetric_from(lower: np.ndarray) -> np.ndarray:
    """The symmetric matrix (n, n) of a lower triangle (n (n + 1) / 2,); undoes `lower_triangle`."""
    n = round((math.sqrt(8 * len(lower) + 1) - 1) / 2)
    i, j = np.indices((n, n))
    row, column = np.maximum(i, j), np.minimum(i, j)
    return np.asarray(lower)[row * (row + 1) // 2 + column]


def std(variance: Any) -> Any:
    """Standard deviation of a variance that rounding may have made negative."""
    return sqrt(maximum(variance, 0.0))
