"""LLVM IR to machine code in this process, and a cache of it on disk.

The key of an entry is made of the text, the processor and the version of LLVM. Entries are written to a temporary file
and renamed, so several processes may write at once; each carries the checksum of its code, so a damaged one is compiled
again. A folder that cannot be written is no error: one warning, and every process compiles for itself. The folder holds
at most `MOST_ENTRIES`: the parameters of a battery are constants of its program, so every battery has its own entry.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import warnings
from collections.abc import Callable
from functools import cache
from itertools import count
from pathlib import Path
from typing import Any

from ohmward.errors import OhmwardError
from ohmward.optional import MissingPackageError, require

#: Level of optimisation: LLVM's -O2. Straight-line code gains nothing from more.
_LEVEL = 2
#: Constants lie near the code, so instructions hold their addresses; the linker keeps both together.
_CODE_MODEL = "small"
#: Bytes of a SHA-256.
_DIGEST = 32

#: Entries of the cache, some 40 kB each; beyond that the oldest are removed.
MOST_ENTRIES = 1000
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
    return 512 if features.get("avx512f") else 256 if features.get("avx") else 128


def compile_scan(source: str, name: str) -> tuple[Callable[..., None], Any]:
    """The function `name` of a module, and the library that must live as long as it.

    Raises:
        NoMachineCodeError: see `llvm`; or LLVM refuses this program.
    """
    binding = llvm()
    try:
        code = cached(source, lambda: compile_object(source))
        linked = (
            binding.JITLibraryBuilder()
            .add_object_img(code)
            .export_symbol(name)
            .link(_linker(), f"ohmward{next(_NUMBERS)}")
        )
    except RuntimeError as error:
        raise NoMachineCodeError(f"LLVM cannot compile this program for this processor ({error})") from error
    return _SIGNATURE(linked[name]), linked


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
    options = binding.create_pipeline_tuning_options(speed_level=_LEVEL)
    options.loop_vectorization = options.slp_vectorization = options.loop_unrolling = False
    passes = binding.create_pass_builder(target, options)
    passes.getModulePassManager().run(module, passes)
    code: bytes = target.emit_object(module)
    return code


# ---- the cache


def folder() -> Path:
    """Folder of compiled programs: OHMWARD_CACHE, else one in the user's cache folder."""
    if named := os.environ.get("OHMWARD_CACHE"):
        return Path(named)
    base = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA") or Path.home() / ".cache"
    return Path(base) / "ohmward"


def cached(source: str, compile_it: Callable[[], bytes]) -> bytes:
    """Code of a source, from the cache if it is there and undamaged."""
    path = folder() / f"{_key(source)}.o"
    found = _read(path)
    if found is None:
        found = compile_it()
        _write(path, found)
    return found


def _key(source: str) -> str:
    import llvmlite
    import llvmlite.binding as binding

    parts = (source, binding.get_host_cpu_name(), binding.get_host_cpu_features().flatten(), llvmlite.__version__)
    return hashlib.sha256("\0".join(map(str, (*parts, _LEVEL, _CODE_MODEL))).encode()).hexdigest()


def _read(path: Path) -> bytes | None:
    try:
        content = path.read_bytes()
    except OSError:
        return None
    code = content[_DIGEST:]
    return code if hashlib.sha256(code).digest() == content[:_DIGEST] else None


def _write(path: Path, code: bytes) -> None:
    temporary = path.with_name(f"{path.name}.{os.getpid()}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary.write_bytes(hashlib.sha256(code).digest() + code)
        temporary.replace(path)
        _prune(path.parent)
    except OSError as error:
        say_once(
            f"compiled programs cannot be written to {path.parent} ({error.strerror}); name another folder in "
            "OHMWARD_CACHE; until then every start compiles anew"
        )


def _prune(folder: Path) -> None:
    """Remove the oldest entries when there are too many, a quarter of them at once."""
    entries = list(folder.glob("*.o"))
    if len(entries) <= MOST_ENTRIES:
        return
    for old in sorted(entries, key=_written)[: len(entries) - 3 * MOST_ENTRIES // 4]:
        old.unlink(missing_ok=True)


def _written(path: Path) -> float:
    """Time at which a file was written; 0 for one that another process has removed."""
    try:
        return path.stat().st_mtime
    except OSError:
        return 0.0


@cache
def say_once(what: str) -> None:
    """Warn, but of the same only once in a process."""
    warnings.warn(what, RuntimeWarning, stacklevel=2)
