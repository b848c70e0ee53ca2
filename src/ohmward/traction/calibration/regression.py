"""Linear regression with a prior, and a covariance that stands when the rows of one drive err together.

    beta = H^-1 (A' y / sigma^2 + P0^-1 beta0),   H = A' A / sigma^2 + P0^-1
    cov  = H^-1 (sum over groups g g' + P0^-1) H^-1,   g = A_g' e_g / sigma^2     (sandwich; White 1980)

sigma is that of the residuals e. Groups are drives where there are ten of them, else rows: a sandwich of few groups
is too small.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

FEWEST_DRIVES = 10


class Regression(NamedTuple):
    """beta: (p,); cov: (p, p); residual: (K,) measured minus fitted; std: of the residuals."""

    beta: np.ndarray
    cov: np.ndarray
    residual: np.ndarray
    std: float


def regress(A: np.ndarray, y: np.ndarray, drive: np.ndarray, prior: np.ndarray, prior_std: np.ndarray) -> Regression:
    """Fit y = A beta.

    Args:
        A: (K, p).
        y: (K,).
        drive: (K,) number of the recording of each row.
        prior: (p,) mean.
        prior_std: (p,) standard deviation; infinity for no prior.
    """
    P0_inv = np.diag(1 / prior_std**2)
    beta = np.linalg.lstsq(A, y, rcond=None)[0]
    for _ in range(20):
        std = max(float(np.sqrt(np.mean((y - A @ beta) ** 2))), 1e-12)
        H = A.T @ A / std**2 + P0_inv
        beta = np.linalg.solve(H, A.T @ y / std**2 + P0_inv @ prior)
    residual = y - A @ beta
    H_inv = np.linalg.inv(H)
    g = scores(A, residual, drive) / std**2
    return Regression(beta, H_inv @ (g.T @ g + P0_inv) @ H_inv, residual, std)


def scores(A: np.ndarray, residual: np.ndarray, drive: np.ndarray) -> np.ndarray:
    """A_g' e_g of every group, (groups, p), with the correction for the degrees of freedom that the fit took."""
    numbers, group = np.unique(drive, return_inverse=True)
    if numbers.size < FEWEST_DRIVES:
        group = np.arange(residual.size)
    count = int(group.max()) + 1
    total = np.zeros((count, A.shape[1]))
    np.add.at(total, group, A * residual[:, None])
    return total * np.sqrt(count / max(count - A.shape[1], 1))
