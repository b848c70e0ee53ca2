"""Where the values of a traced function come from: the variables that held them, and the functions that made them.

The graph of a program contains neither. While an `OriginRecorder` is entered, each Python function that returns names
its values after its variables, and the order in which values are made shows which function made each.
"""

from __future__ import annotations

import inspect
import os
import re
import sys
from bisect import bisect_right
from collections.abc import Iterator
from functools import cache, lru_cache
from pathlib import Path
from types import CodeType, FrameType
from typing import Any, NamedTuple

import numpy as np

from ohmward.trace.expression import OF_THE_CALLER, Expression, next_serial

_PACKAGE = Path(__file__).parents[1]
#: Look-ups, whose variables have names, do not count as part of the function that called them.
_TABLES = str(Path(__file__).with_name("table.py"))
#: Folder of Python itself, whose functions count as part of the one that called them, too.
_PYTHONS_OWN = f"{Path(os.__file__).parent}{os.sep}"
_HAS_DOCSTRING = 0x4000000  # since Python 3.13
#: A shorter name is replaced by a longer one of the calling function.
_SPEAKING = 3


class Origin(NamedTuple):
    """Function that made a value."""

    name: str
    file: str  #: within the package
    summary: str  #: first sentence of its docstring


#: Recorders that are entered, the innermost last.
_recorders: list[OriginRecorder] = []


def recorder() -> OriginRecorder | None:
    """The innermost recorder that is entered, if any."""
    return _recorders[-1] if _recorders else None


class OriginRecorder:
    """Names and functions of the values that are made while it is entered, by their serials."""

    def __init__(self) -> None:
        self._names: dict[int, tuple[int, str]] = {}
        self._replaced: dict[int, int] = {}  # serial of a value -> of the one that it replaces
        self._parts: dict[int, int] = {}  # serial of a value -> of the one that it is a part of
        self._serials: list[int] = [-1]  # where the current function changes
        self._functions: list[Origin | None] = [None]  # current function from there on
        self._stack: list[Origin | None] = [None]

    def __enter__(self) -> OriginRecorder:
        self._before = sys.getprofile()
        sys.setprofile(self._event)
        _recorders.append(self)
        return self

    def __exit__(self, *_: Any) -> None:
        # a profiler in C, such as cProfile's, cannot be put back this way: it ends here
        sys.setprofile(self._before if callable(self._before) else None)
        _recorders.remove(self)

    def carry(self, old: Expression, new: Any, since: int) -> None:
        """Give `new`, made in place of `old` after serial `since`, the name and function of `old`."""
        if isinstance(new, Expression) and new.serial > since:
            source = self._source(old.serial)
            self._replaced[new.serial] = source
            self._parts |= dict.fromkeys(range(since + 1, new.serial), source)

    def name(self, serial: int) -> str:
        """Name of the variable that held a value; "" where none did."""
        return self._names.get(self._source(serial), (0, ""))[1]

    def place(self, serial: int) -> int:
        """Sort key that puts values in the order in which they were first made."""
        return self._parts.get(serial, self._source(serial))

    def origin(self, serial: int) -> Origin | None:
        """Function with a docstring that made a value; None outside any."""
        return self._functions[bisect_right(self._serials, self.place(serial)) - 1]

    def _source(self, serial: int) -> int:
        return self._replaced.get(serial, serial)

    def _event(self, frame: FrameType, event: str, _: Any) -> None:
        code = frame.f_code
        if event not in ("call", "return") or not _file_counts(code.co_filename) or code.co_name.startswith("<"):
            return
        if event == "call":
            own = None if code.co_filename == _TABLES else _origin(code)
            self._stack.append(own or self._stack[-1])
        else:
            self._name(frame)
            self._stack.pop()
        self._serials.append(next_serial())
        self._functions.append(self._stack[-1])

    def _name(self, frame: FrameType) -> None:
        """Name the values that the variables of a function hold."""
        code = frame.f_code
        arguments = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
        for variable, value in frame.f_locals.items():
            strength = 0 if variable in arguments else 1 + (len(variable) >= _SPEAKING)
            for name, x in _scalars(variable.strip("_"), value):
                serial = self._source(x.serial)
                if strength > self._names.get(serial, (-1, ""))[0]:
                    self._names[serial] = strength, name


@cache
def _file_counts(file: str) -> bool:
    is_pythons = file.startswith(_PYTHONS_OWN) and "site-packages" not in file
    is_callers = file.startswith(OF_THE_CALLER) and file != _TABLES
    return not (is_pythons or is_callers)


def _scalars(name: str, value: Any) -> Iterator[tuple[str, Expression]]:
    """Traced scalars of a variable, each with its name."""
    if isinstance(value, Expression):
        yield name, value
    elif isinstance(value, np.ndarray) and value.dtype == object:
        for index, x in np.ndenumerate(value):
            yield from _scalars("_".join([name, *map(str, index)]), x)
    elif isinstance(value, tuple | list):
        fields = getattr(value, "_fields", range(len(value)))
        for field, x in zip(fields, value, strict=True):
            yield from _scalars(f"{name}_{field}", x)


@lru_cache(maxsize=1024)
def _origin(code: CodeType) -> Origin | None:
    summary = _summary(code)
    path = Path(code.co_filename)
    file = path.relative_to(_PACKAGE).as_posix() if path.is_relative_to(_PACKAGE) else path.name
    return Origin(code.co_qualname.split("<locals>.")[-1], file, summary) if summary else None


def _summary(code: CodeType) -> str:
    """First sentence of a function's docstring."""
    has_one = bool(code.co_flags & _HAS_DOCSTRING) if sys.version_info >= (3, 13) else bool(code.co_consts)
    text = code.co_consts[0] if has_one and isinstance(code.co_consts[0], str) else ""
    paragraph = " ".join(inspect.cleandoc(text).split("\n\n")[0].split())
    return re.split(r"(?<=[\w)\]][.:;]) ", paragraph)[0].rstrip(".:;")
