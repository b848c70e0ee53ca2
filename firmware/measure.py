"""Exported filters on a Cortex-M4F under QEMU: bits, instructions, flash, RAM, stack. `make firmware` runs it.

Every filter is exported, compiled for two machines, and replays its vectors there; every output must have the very bits
of the reference. Instructions are counted by the emulator (`-icount shift=6`: 64 ns each, against a SysTick of known
frequency), so they are exact and repeat; cycles on hardware depend on its flash. Writes benchmarks/firmware.md.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

from ohmward.battery.battery import Battery
from ohmward.battery.chemistries import generic_battery
from ohmward.export import Export, battery_export, library, write_library

HERE = Path(__file__).resolve().parent
PAGE = HERE.parent / "benchmarks" / "firmware.md"
TOOLS = ("arm-none-eabi-gcc", "arm-none-eabi-size", "qemu-system-arm")
MACHINE_CODE = ["-mcpu=cortex-m4", "-mthumb", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard"]
WARNINGS = ["-std=c99", "-Wall", "-Wextra", "-Wdouble-promotion", "-Wconversion", "-pedantic", "-Werror"]
ARITHMETIC = ["-ffp-contract=off", "-fno-math-errno", "-ffunction-sections", "-fdata-sections"]
INSTRUCTION_NS = 64.0


class Machine(NamedTuple):
    """An emulated board: its name in QEMU, where its flash begins, the time of a SysTick [ns]."""

    name: str
    flash: str
    tick_ns: float


MACHINES = (Machine("mps2-an386", "0x00000000", 40.0), Machine("netduinoplus2", "0x08000000", 1e3 / 168))


#: Filters, and the time between their samples where it is always the same.
FILTERS = (
    ("textbook-ekf", None),
    ("textbook-ekf", 1.0),
    ("textbook-ukf", None),
    ("textbook-ukf", 1.0),
    ("coulomb", None),
    ("ekf", None),
    ("ekf", 1.0),
    ("ukf", None),
)


class Measured(NamedTuple):
    """What a filter took: bytes, and instructions of a step (the fewest, the mean, the most)."""

    title: str
    option: str
    machine: str
    flash: int
    tables: int
    state: int
    stack: int
    least: float
    mean: float
    most: float
    vectors: int
    wrong: int


def main() -> int:
    """Measure all, write the page; 1 where a bit is wrong."""
    if missing := [tool for tool in TOOLS if not shutil.which(tool)]:
        print(
            f"{', '.join(missing)} missing: apt-get install gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm"
        )
        return 0
    battery = generic_battery("nmc", 2.0)
    rows = []
    for name, sample_time_s in FILTERS:
        export = battery_export(battery, name, "filter", sample_time_s=sample_time_s)
        title = f"{name}, every {sample_time_s:g} s" if sample_time_s else name
        for option in ("-O2", "-Os"):
            for machine in MACHINES:
                rows.append(measure(export, title, option, machine))
                print(_line(rows[-1]), flush=True)
    if wrong := [row for row in rows if row.wrong]:
        print(f"{len(wrong)} of {len(rows)} have other bits than the reference", file=sys.stderr)
        return 1
    PAGE.write_text(page(rows, battery), encoding="utf-8")
    return 0


def measure(export: Export, title: str, option: str, machine: Machine) -> Measured:
    """Build, run and read one."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        write_library(library(export), folder)
        image = build(export, option, machine, folder)
        found = run(image, machine)
        text, tables = sizes(folder / "filter.o")
        ns = {k: found[k] * machine.tick_ns / INSTRUCTION_NS for k in ("least", "most", "total")}
    return Measured(
        title, option, machine.name, text, tables, _state_bytes(export), found["stack"], ns["least"],
        ns["total"] / found["vectors"], ns["most"], found["vectors"], found["wrong"],
    )  # fmt: skip


def build(export: Export, option: str, machine: Machine, folder: Path) -> Path:
    """The image of the filter with its replay."""
    script = (HERE / "cortex-m4f.ld.in").read_text().replace("@FLASH@", machine.flash)
    (folder / "machine.ld").write_text(script)
    arguments = "".join(f", {a:#.6g}f" for a in export.arguments)
    common = ["arm-none-eabi-gcc", *MACHINE_CODE, *WARNINGS, *ARITHMETIC, option, f"-I{folder}"]
    _do([*common, "-c", "-o", folder / "filter.o", folder / "filter.c"])
    sources = [HERE / "startup.c", HERE / "replay.c", folder / "filter.o"]
    link = [
        f"-T{folder / 'machine.ld'}",
        "-nostartfiles",
        "-Wl,--gc-sections",
        "--specs=nosys.specs",
        "-lm",
        "-Wl,--no-warn-rwx-segments",
    ]
    _do([*common, f"-DSTART_ARGUMENTS={arguments}", "-Wno-pedantic", "-o", folder / "image.elf", *sources, *link])
    return folder / "image.elf"


def run(image: Path, machine: Machine) -> dict[str, int]:
    """What the image says of itself."""
    options: list[str | Path] = ["-nographic", "-semihosting-config", "enable=on,target=native", "-icount", "shift=6"]
    options += ["-kernel", image]
    result = subprocess.run(
        ["qemu-system-arm", "-machine", machine.name, *options],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    words = [line.split() for line in (result.stdout + result.stderr).splitlines()]
    found = {w[0]: int(w[1]) for w in words if len(w) == 2 and w[1].isdigit()}
    if "wrong" not in found:
        raise RuntimeError(f"{machine.name}: no answer: {result.stdout}{result.stderr}")
    return found


def sizes(object_file: Path) -> tuple[int, int]:
    """Bytes of code, and of tables and other constants."""
    lines = _do(["arm-none-eabi-size", "-A", object_file]).splitlines()
    parts = [line.split() for line in lines if line.startswith((".text", ".rodata"))]
    code = sum(int(p[1]) for p in parts if p[0].startswith(".text"))
    return code, sum(int(p[1]) for p in parts if p[0].startswith(".rodata"))


def _state_bytes(export: Export) -> int:
    from ohmward.export.c_library import size

    return size(export).state


def _do(command: list) -> str:
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    if result.returncode:
        raise RuntimeError(f"{' '.join(map(str, command))}\n{result.stdout}{result.stderr}")
    return result.stdout


def _line(row: Measured) -> str:
    return (
        f"{row.title:24s} {row.option} {row.machine:14s} code {row.flash:6d} tables {row.tables:5d} "
        f"state {row.state:4d} stack {row.stack:4d} instructions {row.mean:7.0f} ({row.least:.0f} to {row.most:.0f}) "
        f"wrong {row.wrong}"
    )


def page(rows: list[Measured], battery: Battery) -> str:
    """The table in Markdown."""
    compiler = _do(["arm-none-eabi-gcc", "--version"]).splitlines()[0]
    emulator = _do(["qemu-system-arm", "--version"]).splitlines()[0]
    first = MACHINES[0].name
    lines = [
        "# Filters on a Cortex-M4F",
        "",
        f"Written by `make firmware`: {compiler}; {emulator}. Battery: {battery.name}, 2 RC pairs.",
        f"Every filter replayed its vectors on {' and '.join(m.name for m in MACHINES)};",
        "every output had the bits of the reference.",
        "Instructions are those of one step, mean and range over the vectors, which contain faults of every sensor.",
        "Hardware takes one to two cycles for most of them, and more where its flash is slow.",
        "",
        "| filter | | code [bytes] | tables [bytes] | state [bytes] | stack [bytes] | instructions | range |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for r in rows:
        if r.machine == first:
            cells = (
                r.title,
                r.option,
                r.flash,
                r.tables,
                r.state,
                r.stack,
                f"{r.mean:.0f}",
                f"{r.least:.0f}-{r.most:.0f}",
            )
            lines.append(f"| {' | '.join(map(str, cells))} |")
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    sys.exit(main())
