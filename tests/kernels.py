"""Estimators and controllers as the tests of several rooms compile them: each once."""

from typing import Any

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
