"""Live steps in machine code kept whole on disk: a process that starts again neither traces nor compiles them.

A step is known by its function and settings, and by every file of this package, the processor and the compiler, as all
of these make its code. Only functions of ohmward itself are kept, and only while `keeping` is in force: whoever changes
a constant at run time would find the step of before.
"""

from __future__ import annotations

import hashlib
import io
import pickle
import pickletools
import platform
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import fields, is_dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ohmward.trace.lower.code_cache import cached
from ohmward.trace.lower.llvm_machine_code import NoMachineCodeError, compiled, linked, this_machine
from ohmward.trace.lower.llvm_run import STEP_NAME, MachineStep
from ohmward.trace.program import Program, symbols
from ohmward.trace.structure import Branch, Structure

_KEEPING = ContextVar("_KEEPING", default=False)

#: Packages whose functions and classes a step may name: their versions are in its key.
_KNOWN = {"ohmward", "numpy", "functools", "collections", "builtins", "__builtin__", "copy_reg", "copyreg", "_codecs"}


class _Stored(NamedTuple):
    """A live step on disk: the shape of its program and the object file; see `Program`."""

    argument_structure: Branch
    result_structure: Structure
    name: str
    outputs: int
    state_size: int
    code: bytes


@contextmanager
def keeping() -> Iterator[None]:
    """While in force, kernels take their live steps from the disk, or leave them there."""
    token = _KEEPING.set(True)
    try:
        yield
    finally:
        _KEEPING.reset(token)


def key_of(function: Callable[..., Any], examples: tuple[Any, ...], constants: tuple[Any, ...]) -> str | None:
    """Key of a step; None where it is not stored."""
    if not _KEEPING.get():
        return None
    try:
        content = _content((function, examples, constants))
        parts = (content, package_digest(), np.__version__.encode(), platform.python_version().encode(), this_machine())
    except (pickle.PicklingError, AttributeError, TypeError, NoMachineCodeError):
        return None
    named = {re.split("[. ]", str(word))[0] for code, word, _ in pickletools.genops(content) if code.name == "GLOBAL"}
    return hashlib.sha256(b"\0".join(parts)).hexdigest() if named <= _KNOWN else None


class _Pickler(pickle.Pickler):
    """Content of settings: the fields of dataclasses, without values that they have cached meanwhile."""

    def reducer_override(self, value: Any) -> Any:
        """Type and fields of a dataclass; the usual way for all others."""
        if not is_dataclass(value) or isinstance(value, type):
            return NotImplemented
        return type(value), tuple(getattr(value, field.name) for field in fields(value))


def _content(tree: Any) -> bytes:
    """The tree as bytes, in which protocol 2 names every class and function in full."""
    file = io.BytesIO()
    _Pickler(file, protocol=2).dump(tree)
    return file.getvalue()


def kept_step(key: str, make: Callable[[], MachineStep]) -> MachineStep:
    """The step of a key, for live samples only; `make` gives one that is not on disk.

    Raises:
        NoMachineCodeError: there is none for this program or processor.
    """
    stored: _Stored = pickle.loads(cached(key, lambda: pickle.dumps(_outline(make()))))
    program = Program(
        symbols(stored.argument_structure),
        (),
        (0.0,) * stored.outputs,
        stored.argument_structure,
        stored.result_structure,
        stored.name,
    )
    return MachineStep.of_code(program, stored.state_size, linked(stored.code, STEP_NAME))


def _outline(step: MachineStep) -> _Stored:
    program = step.program
    return _Stored(
        program.argument_structure,
        program.result_structure,
        program.name,
        len(program.outputs),
        step.state_size,
        compiled(step.source(1, (False,) * step.columns)),
    )


@cache
def package_digest() -> bytes:
    """SHA-256 of every file of this distribution that is Python."""
    found = hashlib.sha256()
    for package in ("ohmward", "ohmward_lab"):
        root = Path(str(files(package)))
        for path in sorted(root.rglob("*.py")):
            found.update(f"{package}/{path.relative_to(root)}\0".encode() + path.read_bytes() + b"\0")
    return found.digest()
