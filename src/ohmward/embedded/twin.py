"""The firmware's twin: an exported library, compiled for this machine and called from Python.

It is the C that the microcontroller runs, compiled with the flags of its Makefile, so it gives the same bits. Needs a C
compiler and cffi (extra `twin`).
"""

from __future__ import annotations

import math
import os
import re
import shlex
import shutil
import subprocess
import sysconfig
import tempfile
from collections import namedtuple
from collections.abc import Iterator
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from ohmward.errors import InputError, OhmwardError
from ohmward.optional import require

#: As in the Makefile of the library: fused multiply-adds would change the last bits.
FLAGS = ("-std=c99", "-O2", "-fno-math-errno", "-ffp-contract=off")

_DRIVER = """\
#include <stddef.h>
#include "@NAME@.h"
@PROTOTYPE@
{
    for (size_t t = 0; t < count; ++t) {
        @NAME@_step(state, samples + t, outputs + t);
    }
}
"""
_PROTOTYPE = """\
void ohmward_twin_run(@NAME@_state *state, const @NAME@_sample *samples, @NAME@_output *outputs, size_t count)"""
_TYPES = {"float": np.float32, "_Bool": np.bool_}


class Twin:
    """An exported library on this machine.

    >>> twin = Twin("firmware/soc")                                        # doctest: +SKIP
    >>> first = twin.Sample(dt_s=0.0, current_A=-1.0, voltage_V=3.7, temperature_degC=25.0)    # doctest: +SKIP
    >>> twin.start(first, soc=0.5, soc_std=0.3)                            # doctest: +SKIP
    >>> twin.step(first).soc                                               # doctest: +SKIP
    0.5079

    Samples are tuples with the members of the C struct in their order, as `Sample` of the estimator or of the twin;
    nested tuples count with their members. A twin belongs to one thread; there may be many.

    folder: as `ohmward export` wrote it.
    name:   prefix of the library, where the folder holds several.

    Attributes:
        name: prefix of the library.
        Sample, Output, State: NamedTuples with the members of the C structs.
        arguments: names of the arguments of `start` after the sample.
        example: their values in the library's own test, which are those of its export.
        flags: bit of each of the output's `flags`, by name.

    Raises:
        InputError: there is no library in the folder, or there are several.
        OhmwardError: no C compiler, no cffi, or the compiler refuses the library.
    """

    def __init__(self, folder: str | PathLike[str], name: str | None = None):
        header = _header(Path(folder), name)
        self.name = header.stem
        text = header.read_text(encoding="utf-8")
        self.flags = {word: int(value) for word, value in re.findall(rf"#define {self.name.upper()}_(\w+) (\d+)", text)}
        self.arguments = tuple(re.findall(r", float (\w+)", _prototype(text, f"{self.name}_start")))
        self.example = dict(zip(self.arguments, _example(header), strict=False))
        self._ffi, self._library = _loaded(header)
        self._dtypes = {word: self._laid_out(word) for word in ("sample", "output", "state")}
        structs: list[Any] = [namedtuple(word.capitalize(), dtype.names or ()) for word, dtype in self._dtypes.items()]
        self.Sample, self.Output, self.State = structs
        self._state = np.zeros(1, self._dtypes["state"])
        self._started = False

    def start(self, sample: Any, **arguments: float) -> None:
        """Set the state before the first sample; then give that sample to `step` or `run`.

        arguments: as in the C, by name: `soc=0.5, soc_std=0.3`.

        Raises:
            InputError: a sample of another form, or other arguments.
        """
        if set(arguments) != set(self.arguments):
            wanted = ", ".join(f"{word}=..." for word in self.arguments) or "nothing else"
            raise InputError(f"{self.name}_start takes the sample and {wanted}; got {', '.join(arguments) or 'none'}")
        first = self._samples(sample, live=True)
        numbers = [float(arguments[word]) for word in self.arguments]
        start = getattr(self._library, f"{self.name}_start")
        start(self._pointer("state *", self._state), self._pointer("sample *", first), *numbers)
        self._started = True

    def step(self, sample: Any) -> Any:
        """`Output` after one sample: numbers, and arrays where the struct has arrays.

        Raises:
            InputError: not started, or a sample of another form.
        """
        outputs = self._run(self._samples(sample, live=True))
        return self.Output(*(_plain(outputs[word][0]) for word in self.Output._fields))

    def run(self, samples: Any) -> Any:
        """`Output` after each sample of a log, arrays (T, ...), continuing from the twin's state.

        samples: every member with a leading time axis (T, ...); one without it holds for all times.

        Raises:
            InputError: not started, or samples of another form.
        """
        outputs = self._run(self._samples(samples, live=False))
        return self.Output(*(np.ascontiguousarray(outputs[word]) for word in self.Output._fields))

    @property
    def state(self) -> Any:
        """The state after the last sample, a `State`."""
        return self.State(*(_plain(self._state[word][0]) for word in self.State._fields))

    def dtype(self, struct: str) -> np.dtype:
        """Memory layout of "sample", "output" or "state", here and on a Cortex-M, for reading dumps of the target."""
        return self._dtypes[struct]

    def records(self, samples: Any) -> np.ndarray:
        """Samples of a log as the C structs (T,) of `dtype("sample")`."""
        return self._samples(samples, live=False)

    def flag_counts(self, outputs: Any) -> dict[str, int]:
        """Number of samples that carry each flag, by its lower-case name; flags that never occur are left out."""
        if "flags" not in self.Output._fields:
            return {}
        flags = outputs.flags[np.isfinite(outputs.flags)].astype(int)
        counts = {name.lower(): int(np.count_nonzero(flags & bit)) for name, bit in self.flags.items()}
        return {name: count for name, count in counts.items() if count}

    def _run(self, samples: np.ndarray) -> np.ndarray:
        if not self._started:
            raise InputError(f"{self.name}: call start(sample, ...) before the first step")
        outputs = np.zeros(len(samples), self.dtype("output"))
        structs = (("state *", self._state), ("sample *", samples), ("output *", outputs))
        self._library.ohmward_twin_run(*(self._pointer(*struct) for struct in structs), len(samples))
        return outputs

    def _samples(self, tree: Any, live: bool) -> np.ndarray:
        """Structs (T,) of a tree of members; (1,) of a live sample."""
        values = [np.asarray(x) for x in _members_of(tree)]
        dtype = self.dtype("sample")
        if len(values) != len(dtype.names or ()):
            raise InputError(
                f"a sample of {self.name} has the members {', '.join(self.Sample._fields)}; got {len(values)} values"
            )
        shapes = [dtype[word].shape for word in self.Sample._fields]
        lengths = {len(x) for x, shape in zip(values, shapes, strict=True) if not live and x.ndim > len(shape)}
        if len(lengths) > 1:
            raise InputError(
                f"samples of {self.name} differ in length: {sorted(lengths)}; give every member one per row"
            )
        records = np.zeros(lengths.pop() if lengths else 1, dtype)
        for word, value, shape in zip(self.Sample._fields, values, shapes, strict=True):
            records[word] = self._fitting(word, value, shape, len(records))
        return records

    def _fitting(self, word: str, value: np.ndarray, shape: tuple[int, ...], count: int) -> np.ndarray:
        """The value of a member with its time axis first, where it has one."""
        timed = value.ndim > len(shape)
        if value.size != math.prod(shape) * (count if timed else 1):
            raise InputError(f"{self.name}_sample.{word} has the shape {shape}, in a log (T, ...); got {value.shape}")
        try:
            with np.errstate(over="ignore"):  # values beyond single precision become infinite
                return value.astype(float).reshape((count, *shape) if timed else shape).astype(np.float32)
        except (TypeError, ValueError) as error:
            raise InputError(f"{self.name}_sample.{word} must hold numbers, got {value!r:.80}") from error

    def _laid_out(self, struct: str) -> np.dtype:
        fields = dict(self._ffi.typeof(f"{self.name}_{struct}").fields)
        return np.dtype({
            "names": list(fields),
            "formats": [_format(field.type) for field in fields.values()],
            "offsets": [field.offset for field in fields.values()],
            "itemsize": self._ffi.sizeof(f"{self.name}_{struct}"),
        })  # fmt: skip

    def _pointer(self, kind: str, array: np.ndarray) -> Any:
        return self._ffi.cast(f"{self.name}_{kind}", array.ctypes.data)


def first_of(samples: Any) -> Any:
    """First sample of a log (T, ...); members without a time axis hold for all times."""
    return type(samples)(*(x[0] if getattr(x, "ndim", 0) else x for x in samples))


def output_columns(outputs: Any) -> dict[str, np.ndarray]:
    """Members of the output (T, ...) as columns (T,) by name; those of an array are numbered."""
    columns: dict[str, np.ndarray] = {}
    for name, values in outputs._asdict().items():
        if values.ndim == 1:
            columns[name] = values
        else:
            columns |= {f"{name}_{k}": column for k, column in enumerate(values.T)}
    return columns


def compiler() -> list[str]:
    """C compiler of this machine: CC of the environment, Python's own, cc, gcc or clang.

    Raises:
        OhmwardError: no compiler is installed.
    """
    named = (os.environ.get("CC"), sysconfig.get_config_var("CC"), "cc", "gcc", "clang")
    for words in (shlex.split(text) for text in named if text):
        if shutil.which(words[0]):
            return words
    raise OhmwardError(
        "the twin needs a C compiler, and there is none here (CC, cc, gcc, clang); "
        "apt-get install gcc on Debian and Ubuntu, xcode-select --install on a Mac"
    )


def _header(folder: Path, name: str | None) -> Path:
    found = [h for h in sorted(folder.glob(f"{name or '*'}.h")) if h.with_suffix(".c").is_file() and _steps(h)]
    if len(found) == 1:
        return found[0]
    if found:
        raise InputError(f"{folder}: there are several libraries, {', '.join(h.stem for h in found)}; name one")
    raise InputError(
        f"{folder}: there is no exported library{f' {name!r}' if name else ''}, which is NAME.h and NAME.c; "
        f"make one with `ohmward export FILE -o {folder}`"
    )


def _steps(header: Path) -> bool:
    return bool(_prototype(header.read_text(encoding="utf-8", errors="replace"), f"{header.stem}_step"))


def _prototype(text: str, function: str) -> str:
    """Prototype of a function in a header; empty if it is not there."""
    found = re.search(rf"\bvoid {function}\([^;]*\);", text)
    return found[0] if found else ""


def _example(header: Path) -> list[float]:
    """Arguments after the sample with which the library's test calls its start; nothing without a test."""
    test = header.with_name(f"test_{header.stem}.c")
    text = test.read_text(encoding="utf-8") if test.is_file() else ""
    found = re.search(rf"{header.stem}_start\(&state, &sample((?:, [^,;]+)*)\);", text)
    return [float(word.strip(" ()f")) for word in found[1].split(",")[1:]] if found else []


def _loaded(header: Path) -> tuple[Any, Any]:
    """Types of a library and its compiled functions; nothing stays on the disk."""
    ffi = require("cffi", "the twin").FFI()
    cc, include, name = compiler(), f"-I{header.parent}", header.stem
    prototype = _PROTOTYPE.replace("@NAME@", name)
    types = _run_compiler([*cc, "-std=c99", "-E", "-P", include, "-include", header.name, "-xc", os.devnull])
    ffi.cdef(f"{types}\n{prototype};")
    with tempfile.TemporaryDirectory() as temporary:
        driver = Path(temporary) / "driver.c"
        driver.write_text(_DRIVER.replace("@PROTOTYPE@", prototype).replace("@NAME@", name), encoding="utf-8")
        library = Path(temporary) / f"{name}.so"
        sources = [str(driver), str(header.with_suffix(".c"))]
        _run_compiler([*cc, *FLAGS, include, "-shared", "-fPIC", "-o", str(library), *sources, "-lm"])
        return ffi, ffi.dlopen(str(library))


def _run_compiler(command: list[str]) -> str:
    """Run a compiler and return its output; OhmwardError if it fails."""
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    if result.returncode:
        lines = "\n".join(result.stderr.splitlines()[:10])
        raise OhmwardError(f"the C compiler refuses the library; export it again\n{' '.join(command)}\n{lines}")
    return result.stdout


def _format(ctype: Any) -> Any:
    return (_TYPES[ctype.item.cname], (ctype.length,)) if ctype.kind == "array" else _TYPES[ctype.cname]


def _members_of(tree: Any) -> Iterator[Any]:
    """Values of nested tuples, in order; arrays without entries have no member in C."""
    if isinstance(tree, tuple):
        for part in tree:
            yield from _members_of(part)
    elif np.size(tree):
        yield tree


def _plain(value: Any) -> Any:
    """A Python number or bool; an array stays one."""
    return value.copy() if isinstance(value, np.ndarray) else value.item()
