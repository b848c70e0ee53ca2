"""Uncertainty budget of one state: the part of its variance that each group of other states explains.

    v(A) = P_sA P_AA^-1 P_As        variance of x_s that would vanish if the states A were known
    part of g = mean over all orders of (v(those before g, and g) - v(those before g))

These are the Shapley values of v: they add up to v(all), whatever the correlations, and two causes that explain the
same share it evenly (Owen and Prieur 2017, "On Shapley value for measuring importance of dependent inputs").
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from math import comb
from typing import NamedTuple

import numpy as np

#: States whose correlation matrix is closer to singular than this are the same state for the budget.
_LEAST_EIGENVALUE = 1e-9


class VariancePart(NamedTuple):
    """One line of the budget."""

    variance: float  #: part of the whole; all parts together with `VarianceBudget.rest` are the whole
    removable: float  #: variance that would vanish if this cause alone were known


class VarianceBudget(NamedTuple):
    """Variance of a state, its parts by cause, and the rest that would stay if every cause were known."""

    variance: float
    parts: dict[str, VariancePart]
    rest: float


def variance_budget(cov: np.ndarray, of: int, causes: Mapping[str, Sequence[int]]) -> VarianceBudget:
    """The budget of the state `of`, for causes that are groups of other states.

    cov: (n, n), symmetric positive semidefinite.  causes: indices of the states of each cause, by name; about ten at
    most, because every subset of them is looked at.
    """
    names = tuple(causes)
    explained = {
        subset: explained_variance(cov, of, [i for name in subset for i in causes[name]])
        for size in range(len(names) + 1)
        for subset in combinations(names, size)
    }
    parts = {name: VariancePart(_shapley_value(name, names, explained), explained[(name,)]) for name in names}
    return VarianceBudget(float(cov[of, of]), parts, float(cov[of, of]) - explained[names])


def explained_variance(cov: np.ndarray, of: int, known: Sequence[int]) -> float:
    """Variance of the state `of` that would vanish if the states `known` were known, v(A)."""
    states = [i for i in known if cov[i, i] > 0.0]
    if not states:
        return 0.0
    std = np.sqrt(np.diag(cov)[states])
    correlation = cov[np.ix_(states, states)] / np.outer(std, std)
    values, vectors = np.linalg.eigh(correlation)
    along = vectors.T @ (cov[states, of] / std)
    usable = values > _LEAST_EIGENVALUE
    return min(float(np.sum(along[usable] ** 2 / values[usable])), float(cov[of, of]))


def _shapley_value(name: str, names: tuple[str, ...], explained: Mapping[tuple[str, ...], float]) -> float:
    """Mean over all orders of what the cause adds to those before it."""
    others = [other for other in names if other != name]
    total = 0.0
    for size in range(len(names)):
        weight = 1.0 / (len(names) * comb(len(names) - 1, size))
        for before in combinations(others, size):
            joined = tuple(n for n in names if n == name or n in before)
            total += weight * (explained[joined] - explained[before])
    return total
