"""LLVM IR to machine code in this process."""

from __future__ import annotations

import ctypes
import hashlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from itertools import count
from typing import Any

from ohmward.errors import OhmwardError
from ohmward.optional import MissingPackageError, require
from ohmward.trace.lower.code_cache import cached

#: Level of the code generator: LLVM's -O2. Straight-line code gains nothing from more.
_LEVEL = 2
#: A traced program is one straight line without a common subexpression. Of the optimiser's passes only this one makes
#: it faster; all of them together take as long as the code generator.
_PASSES = ("instruction_combine",)
#: Constants lie near the code, so that instructions can contain their addresses; the linker keeps both together.
_CODE_MODEL = "small"
_NUMBERS = count()
_SIGNATURE = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p, ctypes.c_int64], *[ctypes.c_void_p] * 4, *[ctypes.c_int64] * 4)


class NoMachineCodeError(OhmwardError):
    """Machine code cannot be made here; the message says why."""


@cache
def llvm() -> Any:
    """The binding of llvmlite, ready to compile for this processor.

    Raises:
        NoMachineCodeError: llvmlite is not installed, or does not know the processor.
    """
    try:
        binding = require("llvmlite.binding", "machine code")
    except MissingPackageError as error:
        raise NoMachineCodeError(str(error)) from error
    try:
        binding.initialize_native_target()
        binding.initialize_native_asmprinter()
        machine()
    except RuntimeError as error:
        raise NoMachineCodeError(f"llvmlite cannot compile for this processor ({error})") from error
    return binding


def reason_for_none() -> str:
    """The reason why there is no machine code; empty if there is."""
    try:
        llvm()
    except NoMachineCodeError as error:
        return str(error)
    return ""


def machine() -> Any:
    """Target machine: this processor with all its instructions. The engine that it is given to owns it."""
    import llvmlite.binding as binding

    target = binding.Target.from_default_triple()
    features = binding.get_host_cpu_features().flatten()
    return target.create_target_machine(
        cpu=binding.get_host_cpu_name(), features=features, opt=_LEVEL, reloc="pic", codemodel=_CODE_MODEL, jit=True
    )


@cache
def vector_bits() -> int:
    """Width of the processor's vectors of floating-point numbers."""
    llvm()
    import llvmlite.binding as binding

    features = binding.get_host_cpu_features()
    if features.get("avx512f"):
        return 512
    return 256 if features.get("avx") else 128


def compile_scan(source: str, name: str) -> tuple[Callable[..., None], Any]:
    """The function `name` of a module, and the library that must live as long as it.

    Raises:
        NoMachineCodeError: see `llvm`; or LLVM refuses this program.
    """
    return linked(compiled(source), name)


def compiled(source: str) -> bytes:
    """Object file of a module, from the disk if it was compiled before.

    Raises:
        NoMachineCodeError: see `llvm`; or LLVM refuses this program.
    """
    llvm()
    with _refused():
        return cached(_key(source), lambda: compile_object(source))


def linked(code: bytes, name: str) -> tuple[Callable[..., None], Any]:
    """The function `name` of an object file, and the library that must live as long as it.

    Raises:
        NoMachineCodeError: see `llvm`; or LLVM refuses this file.
    """
    builder = llvm().JITLibraryBuilder()
    with _refused():
        library = builder.add_object_img(code).export_symbol(name).link(_linker(), f"ohmward{next(_NUMBERS)}")
    return _SIGNATURE(library[name]), library


@contextmanager
def _refused() -> Iterator[None]:
    """Turn LLVM's refusal of a program into a NoMachineCodeError."""
    try:
        yield
    except RuntimeError as error:
        raise NoMachineCodeError(f"LLVM cannot compile this program for this processor ({error})") from error


@cache
def _linker() -> Any:
    """Linker that loads object files into memory, each in one piece, as the small code model demands."""
    return llvm().create_lljit_compiler(machine(), use_jit_link=True)


def compile_object(source: str) -> bytes:
    """Object file of a module."""
    binding = llvm()
    module = binding.parse_assembly(source)
    module.verify()
    target = machine()
    module.triple, module.data_layout = binding.get_default_triple(), str(target.target_data)
    passes = binding.create_new_module_pass_manager()
    for name in _PASSES:
        getattr(passes, f"add_{name}_pass")()
    passes.run(module, binding.create_pass_builder(target, binding.create_pipeline_tuning_options(_LEVEL)))
    code: bytes = target.emit_object(module)
    return code


def _key(source: str) -> str:
    """Key of a program: its text, the processor and the compiler."""
    return hashlib.sha256(source.encode() + b"\0" + this_machine()).hexdigest()


def this_machine() -> bytes:
    """Processor and compiler, as far as they determine the code of a program.

    Raises:
        NoMachineCodeError: see `llvm`.
    """
    llvm()
    import llvmlite
    import llvmlite.binding as binding

    parts = (binding.get_host_cpu_name(), binding.get_host_cpu_features().flatten(), llvmlite.__version__)
    return "\0".join(map(str, (*parts, _LEVEL, _PASSES, _CODE_MODEL))).encode()
