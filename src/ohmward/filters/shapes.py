"""Check of shapes: an array of the wrong shape is refused before it broadcasts into something plausible and wrong."""

from __future__ import annotations

import numpy as np

from ohmward.errors import InputError


def require_shape(name: str, array: np.ndarray, shape: tuple[int, ...]) -> None:
    """Raise `InputError` unless `array` is an array of `shape`; `name` as the caller wrote it."""
    found = np.shape(array)
    if found != shape:
        raise InputError(f"{name} must have shape {shape} but has {found}; {_advice(found, shape)}")


def _advice(found: tuple[int, ...], shape: tuple[int, ...]) -> str:
    if found == () and shape == (1, 1):
        return "wrap the number: np.array([[value]])"
    if found == () and shape == (1,):
        return "wrap the number: np.array([value])"
    if len(shape) == 2 and found == shape[:1]:
        return "a covariance is a matrix: np.diag(variances)"
    return "the state has as many elements as belief.mean, the output as many as y"
