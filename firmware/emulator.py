"""Library on an emulated Cortex-M4F: build its image, run it with a log, read its answer."""

from __future__ import annotations

import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ohmward.trace.lower.c_operations import literal

HERE = Path(__file__).resolve().parent
SOURCES = ("startup.c", "replay.c", "board.c")
TOOLS = ("arm-none-eabi-gcc", "arm-none-eabi-size", "arm-none-eabi-objdump", "qemu-system-arm")
INSTALL = "apt-get install --no-install-recommends gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm"
MACHINE_CODE = ["-mcpu=cortex-m4", "-mthumb", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard"]
WARNINGS = ["-std=c99", "-Wall", "-Wextra", "-Wdouble-promotion", "-Wconversion", "-pedantic", "-Werror"]
ARITHMETIC = ["-ffp-contract=off", "-fno-math-errno", "-ffunction-sections", "-fdata-sections"]
LINK = ["-nostartfiles", "-Wl,--gc-sections", "--specs=nosys.specs", "-lm", "-Wl,--no-warn-rwx-segments"]
INSTRUCTION_NS = 64.0


class Machine(NamedTuple):
    """An emulated board: its name in QEMU, where its flash begins, the time of a SysTick [ns]."""

    name: str
    flash: str
    tick_ns: float


MACHINES = (Machine("mps2-an386", "0x00000000", 40.0), Machine("netduinoplus2", "0x08000000", 1e3 / 168))


class Sizes(NamedTuple):
    """Bytes of code, of tables and other constants, and of static variables."""

    code: int
    tables: int
    static: int


class Times(NamedTuple):
    """Steps, and instructions of one: the fewest, the mean, the most."""

    steps: int
    least: float
    mean: float
    most: float


class Answer(NamedTuple):
    """Answer of an image: instructions over the vectors and over the log, wrong vectors, bytes of stack."""

    vectors: Times
    log: Times
    wrong: int
    stack: int


def compile_library(folder: Path, name: str, option: str) -> Path:
    """The object of the library NAME in a folder."""
    target = folder / f"{name}.o"
    do([*_compiler(folder, option), "-c", "-o", target, folder / f"{name}.c"])
    return target


def link(folder: Path, name: str, arguments: Sequence[float], option: str, machine: Machine) -> Path:
    """The image of a compiled library with its replay; arguments: of the start."""
    script = (HERE / "cortex-m4f.ld.in").read_text(encoding="utf-8").replace("@FLASH@", machine.flash)
    (folder / "machine.ld").write_text(script, encoding="utf-8")
    (folder / "library.h").write_text(_library_header(name, arguments), encoding="utf-8")
    sources = [*(HERE / file for file in SOURCES), folder / f"{name}.o"]
    image = folder / "image.elf"
    options = ["-Wno-pedantic", f"-T{folder / 'machine.ld'}", *LINK]
    do([*_compiler(folder, option), "-o", image, *sources, *options])
    return image


def run(image: Path, machine: Machine, samples: np.ndarray | None = None) -> tuple[Answer, bytes]:
    """Answer of the image, and the bytes of its outputs for the structs of a log (T,) of any length."""
    folder = image.parent
    (folder / "outputs.bin").write_bytes(b"")
    if samples is not None:
        samples.tofile(folder / "samples.bin")
    result = subprocess.run(
        command(image, machine), cwd=folder, capture_output=True, text=True, timeout=600, check=False
    )
    words = [line.split() for line in (result.stdout + result.stderr).splitlines()]
    found = {w[0]: int(w[1]) for w in words if len(w) == 2 and w[1].isdigit()}
    if "stack" not in found:
        raise RuntimeError(f"{machine.name}: no answer: {result.stdout}{result.stderr}")
    answer = Answer(_times(found, "vectors", machine), _times(found, "log", machine), found["wrong"], found["stack"])
    return answer, (folder / "outputs.bin").read_bytes()


def command(image: Path, machine: Machine) -> list[str | Path]:
    """The command line that runs an image."""
    options = ["-nographic", "-semihosting-config", "enable=on,target=native", "-icount", "shift=6"]
    return ["qemu-system-arm", "-machine", machine.name, *options, "-kernel", image]


def sizes(object_file: Path) -> Sizes:
    """Memory of the compiled library."""
    parts = [line.split() for line in do(["arm-none-eabi-size", "-A", object_file]).splitlines()]
    bytes_of = {p[0]: int(p[1]) for p in parts if len(p) == 3 and p[0].startswith(".")}

    def of(*beginnings: str) -> int:
        return sum(count for section, count in bytes_of.items() if section.startswith(beginnings))

    return Sizes(of(".text"), of(".rodata"), of(".data", ".bss"))


def do(words: Sequence[str | Path]) -> str:
    """Run a tool and return its output; RuntimeError if it fails."""
    result = subprocess.run(words, capture_output=True, text=True, check=False)
    if result.returncode:
        raise RuntimeError(f"{' '.join(map(str, words))}\n{result.stdout}{result.stderr}")
    return result.stdout


def _compiler(folder: Path, option: str) -> list[str | Path]:
    return ["arm-none-eabi-gcc", *MACHINE_CODE, *WARNINGS, *ARITHMETIC, option, f"-I{folder}"]


def _library_header(name: str, arguments: Sequence[float]) -> str:
    """Header that gives the library the name `filter`, which the replay uses, and the arguments of its start."""
    words = ("state", "sample", "output", "start", "step", "vector", "is_right")
    same = [f"#define filter_{word} {name}_{word}" for word in words] if name != "filter" else []
    same += [f"#define FILTER_VECTORS {name.upper()}_VECTORS"] if name != "filter" else []
    given = "".join(f", {literal(a)}" for a in arguments)
    includes = ["#include <math.h>", f'#include "{name}.h"', f'#include "{name}_vectors.h"']
    return "\n".join([*includes, *same, f"#define START_ARGUMENTS {given}", ""])


def _times(found: dict[str, int], what: str, machine: Machine) -> Times:
    steps, scale = found[what], machine.tick_ns / INSTRUCTION_NS
    if not steps:
        return Times(0, 0.0, 0.0, 0.0)
    least, most, total = (found[f"{what}_{word}"] * scale for word in ("least", "most", "total"))
    return Times(steps, least, total / steps, most)
