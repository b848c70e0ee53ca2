"""Packages that not everybody has: imported where they are used, and named where they are missing."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from importlib import import_module
from typing import Any

from ohmward.errors import OhmwardError

#: Packages whose name on the index is not that of their import.
_ON_THE_INDEX = {"tomli_w": "tomli-w", "can": "python-can", "serial": "pyserial", "paho": "paho-mqtt"}


class MissingPackageError(OhmwardError):
    """A package is not installed; the message says which, what needs it, and how to install it."""


def require(module: str, user: str) -> Any:
    """Import a module of an optional package.

    module: its full name, "scipy.optimize".
    user: subject of the message, "identification".

    Raises:
        MissingPackageError: "identification needs scipy, which is not installed: pip install scipy".
    """
    name = module.partition(".")[0]
    try:
        import_module(name)
        return import_module(module)
    except ImportError as error:
        package = _ON_THE_INDEX.get(name, name)
        raise MissingPackageError(f"{user} needs {package}, which is not installed: pip install {package}") from error


def one_blas_thread() -> AbstractContextManager[Any]:
    """Keep BLAS on one thread: on small matrices its threads wait for each other, and take ten times as long."""
    try:
        from threadpoolctl import threadpool_limits
    except ImportError:
        return nullcontext()
    return threadpool_limits(1)
