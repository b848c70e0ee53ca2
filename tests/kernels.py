"""Estimators and controllers as the tests of several rooms compile them: each once."""

from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest

from ohmward.trace import Kernel

#: So many are kept; the tests of a file use few.
MOST = 16
_KERNELS: dict[Any, Kernel] = {}


def kernel_of(settings: Any, *examples: Any, lowering: str | None = None) -> Kernel:
    """The compiled step of an estimator or controller; equal settings share one, whatever the numbers in the examples.

    A test that replaces a part of an estimator by another makes a `Kernel` of its own.
    """
    key = (type(settings), settings, lowering)
    if key not in _KERNELS:
        while len(_KERNELS) >= MOST:
            del _KERNELS[next(iter(_KERNELS))]
        _KERNELS[key] = Kernel(settings.step, *examples, lowering=lowering)
    return _KERNELS[key]


def assert_compiled_is_plain(settings: Any, state: Any, samples: Iterable[Any], tolerance: float = 1e-12) -> None:
    """Step through the samples in Python on NumPy arrays, and compiled: the estimates are the same to 1e-9."""
    compiled = state
    for sample in samples:
        state, expected = settings.step(state, sample)
        compiled, found = kernel_of(settings, state, sample)(compiled, sample)
        assert np.hstack(found) == pytest.approx(np.hstack(expected), rel=1e-9, abs=tolerance, nan_ok=True)
