"""Steps in machine code stored on disk, so that a restarted process neither traces nor compiles them.

A step is identified by everything that determines its code: its function and settings and what these can reach in this
process, the files of their modules and the current constants there, as well as the processor and the compiler. Only
functions of ohmward itself are stored.
"""

from __future__ import annotations

import hashlib
import io
import pickle
import pickletools
import platform
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from typing import Any, NamedTuple

import numpy as np

from ohmward.trace.lower.code_cache import cached, is_cached
from ohmward.trace.lower.llvm_machine_code import NoMachineCodeError, compiled, linked, this_machine
from ohmward.trace.lower.llvm_run import STEP_NAME, MachineStep
from ohmward.trace.lower.reach import OURS, UnknownReachError, reach_of
from ohmward.trace.program import Program, symbols
from ohmward.trace.structure import Branch, Structure

#: Packages besides ours whose functions and classes a step may name: their versions are in its key.
_KNOWN = {"numpy", "functools", "collections", "builtins", "__builtin__", "copy_reg", "copyreg", "_codecs"}
#: Module that makes the code of every step.
_COMPILER = "ohmward.trace.lower.llvm_run"


class _Stored(NamedTuple):
    """A step on disk: the shape of its program and the object file; see `Program`."""

    argument_structure: Branch
    result_structure: Structure
    name: str
    outputs: int
    state_size: int
    code: bytes


def key_of(function: Callable[..., Any], examples: tuple[Any, ...], constants: tuple[Any, ...]) -> str | None:
    """Key of a step; None where it is not stored."""
    try:
        content = _content((function, examples, constants))
        modules = {str(word).split()[0] for code, word, _ in pickletools.genops(content) if code.name == "GLOBAL"}
        if not {module.split(".")[0] for module in modules} <= _KNOWN | OURS:
            return None
        reach = reach_of({_COMPILER, *(module for module in modules if module.split(".")[0] in OURS)})
        parts = (content, reach, np.__version__.encode(), platform.python_version().encode(), this_machine())
    except (pickle.PicklingError, AttributeError, TypeError, NoMachineCodeError, UnknownReachError):
        return None
    return hashlib.sha256(b"\0".join(parts)).hexdigest()


class _Pickler(pickle.Pickler):
    """Pickler of settings: the fields of dataclasses, without values that they have cached since."""

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


def is_stored(key: str | None) -> bool:
    """True where the step of a key is on disk."""
    return key is not None and is_cached(key)


def stored_step(key: str, make: Callable[[], MachineStep]) -> MachineStep:
    """The step of a key, for one log and for live samples; `make` is called if it is not on disk.

    Raises:
        NoMachineCodeError: there is no machine code for this program or processor.
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
