"""Digest of what a function of ohmward can reach in this process: the files and current constants of its modules.

A constant, a function or a class that is changed at run time changes this digest. It does not cover containers that can
be changed in place, such as caches, or modules that are imported inside functions; no traced step has any.
"""

from __future__ import annotations

import hashlib
import operator
import sys
import time
from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from functools import cache, partial
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

OURS = frozenset({"ohmward", "ohmward_lab"})

_STARTED_UNIX_S = time.time()


class UnknownReachError(Exception):
    """Files do not determine what code would do: it contains foreign code, or a file was edited meanwhile."""


def reach_of(names: Iterable[str]) -> bytes:
    """SHA-256 of these modules of ohmward, and of all of ohmward that they name.

    Raises:
        UnknownReachError: see there.
    """
    waiting, seen = list(names), {__name__}  # this module makes no code, and its time of start always differs
    found = {}
    while waiting:
        name = waiting.pop()
        if name not in seen:
            seen.add(name)
            described = _described(sys.modules[name])
            found[name] = described.digest
            waiting += described.modules
    return hashlib.sha256("\0".join(found[name] for name in sorted(found)).encode()).digest()


class _Described(NamedTuple):
    """A module as it was, and its description; its names and those of its classes then had these values."""

    names: tuple[tuple[Mapping[str, Any], tuple[Any, ...]], ...]
    arrays: tuple[tuple[np.ndarray, bytes], ...]  #: among them, with their content
    digest: str  #: SHA-256 of the module's file and of its constants
    modules: frozenset[str]  #: of ohmward, that it names

    @property
    def is_unchanged(self) -> bool:
        """True where every name still has the same object as its value, and every array the same content."""
        return all(
            len(now) == len(before) and all(map(operator.is_, now.values(), before)) for now, before in self.names
        ) and all(array.tobytes() == content for array, content in self.arrays)


#: A process that makes many kernels describes each module once.
_DESCRIBED: dict[ModuleType, _Described] = {}


def _described(module: ModuleType) -> _Described:
    """The description of a module as it is now."""
    if (before := _DESCRIBED.get(module)) and before.is_unchanged:
        return before
    description = _Description()
    lines = [_file_digest(str(module.__file__))]
    names: list[Mapping[str, Any]] = [vars(module)]
    for word, value in vars(module).items():
        if not word.startswith("__"):
            lines.append(f"{word}={description.of(value)}")
            if isinstance(value, type) and value.__module__ == module.__name__:
                names.append(vars(value))
                lines += [f"{w}={description.of(v)}" for w, v in vars(value).items() if not w.startswith("__")]
    found = _Described(
        tuple((mapping, tuple(mapping.values())) for mapping in names),
        tuple(description.arrays),
        hashlib.sha256("\n".join(lines).encode()).hexdigest(),
        frozenset(description.modules),
    )
    if not description.can_change_in_place:
        _DESCRIBED[module] = found
    return found


class _Description:
    """Texts of values; equal ones are equal in every process.

    modules: of ohmward, named so far.
    arrays: described so far, with their content.
    can_change_in_place: another value so far does not stay what it is for as long as it is the same object.
    """

    def __init__(self) -> None:
        self.modules: set[str] = set()
        self.arrays: list[tuple[np.ndarray, bytes]] = []
        self.can_change_in_place = False

    def of(self, value: Any) -> str:
        """Text of a value.

        Raises:
            UnknownReachError: it is a function or class from outside ohmward, NumPy and the standard library.
        """
        if value is None or isinstance(value, (bool, int, float, complex, str, bytes)):
            return repr(value)
        if isinstance(value, np.ndarray):
            self.arrays.append((value, value.tobytes()))
            return f"{value.dtype}{value.shape}{value.tobytes()!r}"
        if isinstance(value, tuple):
            return f"({', '.join(map(self.of, value))})"
        if isinstance(value, frozenset):
            return f"{{{', '.join(sorted(map(self.of, value)))}}}"
        if isinstance(value, partial):
            return self.of((value.func, value.args, *value.keywords.items()))
        if isinstance(value, ModuleType):
            return self._named(value.__name__, "")
        home, name = getattr(value, "__module__", None), getattr(value, "__qualname__", None)
        if isinstance(home, str) and isinstance(name, str):
            return self._named(home, name)
        if is_dataclass(value):
            frozen = type(value).__dataclass_params__.frozen  # type: ignore[union-attr,unused-ignore]
            self.can_change_in_place |= not frozen
            return self.of((type(value), *(getattr(value, field.name) for field in fields(value))))
        return type(value).__qualname__

    def _named(self, module: str, name: str) -> str:
        package = module.split(".")[0]
        if package in OURS:
            self.modules.add(module)
        elif package != "numpy" and package not in sys.stdlib_module_names:
            raise UnknownReachError(f"{module}.{name}")
        return f"{module}.{name}"


@cache
def _file_digest(path: str) -> str:
    """SHA-256 of a file from which a module of this process came.

    Raises:
        UnknownReachError: it was written since this process started, or is not a file, as in an archive.
    """
    file = Path(path)
    try:
        # a time in the future is of a clock that was ahead of this one, as after a boot without a clock: no edit since
        if _STARTED_UNIX_S < file.stat().st_mtime <= time.time():
            raise UnknownReachError(path)
        return hashlib.sha256(file.read_bytes()).hexdigest()
    except OSError as error:
        raise UnknownReachError(path) from error
