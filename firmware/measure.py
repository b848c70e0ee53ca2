"""Exported filters on a Cortex-M4F under QEMU: bits, instructions, flash, RAM, stack. `make firmware` runs it.

Every filter is exported, compiled for two machines, and replays its vectors and a simulated log there; every output
must have the very bits of the reference, which is NumPy in single precision for the vectors and the twin for the log.
Instructions are counted by the emulator (`-icount shift=6`: 64 ns each, against a SysTick of known frequency), so they
are exact and repeat; for cycles see cycles.py. Writes benchmarks/firmware.md.

    measure.py                           all filters, and the page
    measure.py DIR LOG [OPTIONS]         a recorded log of any length through an exported library; options are those of
                                         `ohmward twin`
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from cycles import CLOCK_MHZ, WAIT_STATES, Cycles, cycles
from emulator import INSTALL, MACHINES, TOOLS, Answer, Machine, Sizes, compile_library, do, link, run, sizes

from ohmward.battery.battery import Battery
from ohmward.battery.chemistries import generic_battery
from ohmward.battery.soc.estimator import samples_of
from ohmward.cli import twin as twin_command
from ohmward.cli.main import parse
from ohmward.embedded import Export, Twin, battery_export, controller_export, library, observer_export, write_library
from ohmward.embedded.twin import first_of
from ohmward.errors import OhmwardError
from ohmward.logs import DriveLog
from ohmward.traction import RLMA, ROBOTINO, hard_terrain
from ohmward.traction.motion.sample import samples_of as drive_samples_of
from ohmward_lab.simulate import closed_loop, make_robot_day

PAGE = Path(__file__).resolve().parents[1] / "benchmarks" / "firmware.md"
OPTIONS = ("-O2", "-Os")
#: What an STM32F411xE has [bytes].
FLASH, RAM = 512 * 1024, 128 * 1024
#: Fraction of the values of a simulated log that are missing, and of those that are wild.
MISSING, WILD = 0.005, 0.001

#: Filters of a battery, and how they are exported.
FILTERS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("coulomb", {}),
    ("ocv", {}),
    ("textbook-ekf", {}),
    ("textbook-ekf", {"sample_time_s": 1.0}),
    ("textbook-ekf", {"sample_time_s": 1.0, "curve_error_V": 0.004}),
    ("textbook-ukf", {}),
    ("textbook-ukf", {"sample_time_s": 1.0}),
    ("textbook-ukf", {"sample_time_s": 1.0, "curve_error_V": 0.004}),
    ("textbook-ukf", {"sample_time_s": 1.0, "curve_error_V": 0.004, "style": "loops"}),
    ("textbook-joint", {}),
    ("textbook-joint", {"style": "loops"}),
    ("published.rc-kf", {}),
    ("rc", {}),
    ("ekf", {}),
    ("ekf", {"sample_time_s": 1.0}),
    ("published.aekf", {}),
    ("ukf", {}),
    ("published.aukf", {}),
    ("published.hybrid", {}),
)
#: Observers, each with its robot and the scenario whose log it replays.
OBSERVERS = (
    (RLMA, "ekf", "example"),
    (RLMA, "aekf", "example"),
    (RLMA, "ukf", "example"),
    (RLMA, "aukf", "example"),
    (ROBOTINO, "ekf", "robotino"),
    (ROBOTINO, "aukf", "robotino"),
)
CONTROLLERS = ("slip-controller", "speed-controller")


class Case(NamedTuple):
    """Library to measure: its name on the page, the export, and the samples of a log or None."""

    title: str
    export: Export
    samples: Any = None


class Measured(NamedTuple):
    """Measured bytes, instructions and cycles of a library, and the number of outputs with other bits."""

    title: str
    option: str
    machine: str
    sizes: Sizes
    state: int
    structs: int
    answer: Answer
    cycles: Cycles
    wrong: int

    @property
    def flash(self) -> int:
        """Bytes of code and tables."""
        return self.sizes.code + self.sizes.tables

    @property
    def ram(self) -> int:
        """Bytes of state, sample, output, static variables and stack."""
        return self.structs + self.sizes.static + self.answer.stack

    @property
    def most(self) -> float:
        """Instructions of the longest step."""
        return max(self.answer.vectors.most, self.answer.log.most)

    @property
    def mean(self) -> float:
        """Instructions of a mean step of the log, or of the vectors without a log."""
        return self.answer.log.mean if self.answer.log.steps else self.answer.vectors.mean


def main(words: list[str]) -> int:
    """Measure all and write the page, or replay one log; 1 if a bit is wrong or a tool is missing."""
    if missing := [tool for tool in TOOLS if not shutil.which(tool)]:
        print(f"{', '.join(missing)} missing: {INSTALL}", file=sys.stderr)
        return 1
    if words:
        return replay(words)
    rows = []
    for case in cases():
        for row in measure(case):
            print(line(row), flush=True)
            rows.append(row)
    if wrong := [row for row in rows if row.wrong]:
        print(f"{len(wrong)} of {len(rows)} have other bits than the reference", file=sys.stderr)
        return 1
    PAGE.write_text(page(rows), encoding="utf-8")
    return 0


def replay(words: list[str]) -> int:
    """Replay a recorded log through a library on every machine; words: DIR LOG and options of `ohmward twin`."""
    try:
        args = parse(["twin", *words])
        twin = Twin(args.library, args.name)
        log = twin_command.prepare(twin, args)
    except OhmwardError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(shutil.copytree(args.library, Path(temporary) / "library"))
        return max(_replayed(folder, twin, log, option, machine) for option in OPTIONS for machine in MACHINES)


def _replayed(folder: Path, twin: Twin, log: twin_command.Replay, option: str, machine: Machine) -> int:
    """Replay on one machine and print the result; 1 if a bit is wrong."""
    compile_library(folder, twin.name, option)
    image = link(folder, twin.name, tuple(log.arguments.values()), option, machine)
    answer, wrong = compare(twin, image, machine, log.samples, log.arguments)
    print(
        f"{log.log.name} through {twin.name!r}, {option} on {machine.name}: {answer.log.steps:,} samples, "
        f"{answer.log.mean:.0f} instructions a step, {answer.log.least:.0f} to {answer.log.most:.0f}, "
        f"stack {answer.stack} bytes, {wrong} outputs with other bits than here",
        flush=True,
    )
    return 1 if wrong else 0


def cases() -> Iterator[Case]:
    """Every filter, observer and controller that can be exported."""
    battery, hour = battery_and_hour()
    for name, options in FILTERS:
        yield Case(title_of(name, **options), battery_export(battery, name, "filter", **options), hour)
    ground = hard_terrain("dry asphalt")
    for robot, name, scenario in OBSERVERS:
        samples = faulty(drive_samples_of(drive(scenario), robot))
        yield Case(f"{robot.name} speed, {name}", observer_export(robot, ground, name, "filter"), samples)
    for name in CONTROLLERS:
        yield Case(f"{RLMA.name} {name}", controller_export(RLMA, name, "filter"))


def title_of(name: str, sample_time_s: float = 0.0, curve_error_V: float = 0.0, style: str = "") -> str:
    """The name on the page."""
    every = f", every {sample_time_s:g} s" if sample_time_s else ""
    curve = f", curve within {1e3 * curve_error_V:g} mV" if curve_error_V else ""
    return f"{name}{every}{curve}{', loops' if style == 'loops' else ''}"


def battery_and_hour() -> tuple[Battery, Any]:
    """A battery, and the samples of an hour of a robot's day on it."""
    day = make_robot_day("lfp").mission
    battery = generic_battery("lfp", 12.0, 4)
    return battery, faulty(samples_of(day.between(day.time_s[0], day.time_s[0] + 3600.0)))


@cache
def drive(scenario: str) -> DriveLog:
    """The log of a scenario that comes with ohmward."""
    return closed_loop.drive_log(closed_loop.run(closed_loop.find_scenario(scenario)))


def faulty(samples: Any) -> Any:
    """Samples of a log (T, ...) with missing and wild values, the first sample unchanged."""
    rng = np.random.default_rng(0)

    def spoilt(values: np.ndarray) -> np.ndarray:
        chance = rng.random(values.shape)
        chance[:1] = 1.0
        wild = rng.choice([np.inf, -np.inf, 1e9, -1e9], values.shape)
        return np.where(chance < MISSING, np.nan, np.where(chance < MISSING + WILD, wild, values))

    return type(samples)(*(spoilt(np.asarray(values, float)) if np.ndim(values) else values for values in samples))


def measure(case: Case, options: Sequence[str] = OPTIONS, machines: Sequence[Machine] = MACHINES) -> Iterator[Measured]:
    """Build, run, compare and read one library with every option on every machine."""
    export = case.export
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        write_library(library(export), folder)
        twin = Twin(folder)
        arguments = dict(zip(twin.arguments, export.arguments, strict=True))
        state, *others = (twin.dtype(word).itemsize for word in ("state", "sample", "output"))
        for option in options:
            needed = sizes(compile_library(folder, export.name, option))
            spent = None
            for machine in machines:
                image = link(folder, export.name, export.arguments, option, machine)
                answer, wrong = compare(twin, image, machine, case.samples, arguments)
                spent = spent or cycles(image, export.name, machine)
                structs, wrong = state + sum(others), wrong + answer.wrong
                yield Measured(case.title, option, machine.name, needed, state, structs, answer, spent, wrong)


def compare(twin: Twin, image: Path, machine: Machine, samples: Any, arguments: dict[str, float]) -> tuple[Answer, int]:
    """Answer of the image, and the number of its outputs with other bits than here; prints the first of them."""
    if samples is None:
        return run(image, machine)[0], 0
    twin.start(first_of(samples), **arguments)
    expected = twin.run(samples)
    answer, raw = run(image, machine, twin.records(samples))
    found = np.frombuffer(raw, twin.dtype("output"))
    if len(found) != len(expected[0]):
        raise RuntimeError(f"{machine.name}: {len(found)} outputs came back for {len(expected[0])} samples")
    right = np.ones(len(found), bool)
    for word, values in zip(twin.Output._fields, expected, strict=True):
        same = same_bits(np.ascontiguousarray(found[word]), values).reshape(len(found), -1).all(axis=1)
        if right.all() and not same.all():
            t = int(np.argmin(same))
            print(f"sample {t}: {word} is {found[word][t]!r}, here {values[t]!r}", file=sys.stderr)
        right &= same
    return answer, int(np.count_nonzero(~right))


def same_bits(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """True where two arrays have the same bits, or both are no number."""
    if a.dtype == np.bool_:
        return a == b
    return (a.view(np.uint32) == b.view(np.uint32)) | (np.isnan(a) & np.isnan(b))


def line(row: Measured) -> str:
    """Line of the terminal for one library."""
    return (
        f"{row.title:28s} {row.option} {row.machine:14s} flash {row.flash:6d} state {row.state:5d} "
        f"stack {row.answer.stack:5d} instructions {row.mean:6.0f}, at most {row.most:6.0f}, "
        f"{row.cycles.fewest:6.0f} to {row.cycles.most:6.0f} cycles, "
        f"{row.answer.vectors.steps} vectors and {row.answer.log.steps} samples, wrong {row.wrong}"
    )


def page(rows: list[Measured]) -> str:
    """Page with the table in Markdown."""
    compiler = do(["arm-none-eabi-gcc", "--version"]).splitlines()[0]
    emulator = do(["qemu-system-arm", "--version"]).splitlines()[0]
    columns = (
        "", "", "code [bytes]", "tables [bytes]", "flash", "state [bytes]", "stack [bytes]", "RAM", "instructions",
        "at most", "time [us]", "samples",
    )  # fmt: skip
    text = f"""\
# Filters on a Cortex-M4F

Written by `make firmware`: {compiler}; {emulator}.
Every library replayed its vectors on {" and ".join(m.name for m in MACHINES)}, and all but the controllers a
simulated log with missing and wild values: the filters of a battery (generic lfp, 12 Ah, 4 cells, 2 RC pairs) an hour
of a robot's day, the observers a drive in closed loop. Every output had the bits of the reference.

- flash: code and tables, and their share of the 512 KB of an STM32F411xE
- RAM: the state; with one sample, one output, static variables and the deepest stack its share of 128 KB
- instructions: of a mean step of the log (of the vectors where there is none), and of the longest of all
- time: of a mean step at {CLOCK_MHZ:g} MHz. Least: the executed instructions by the cycles of their kinds, flash as
  fast as the core. Most: every 16 bytes of code and every constant in it wait {WAIT_STATES} more cycles. An STM32F411
  fetches ahead and lies between; `firmware/cycles.py` says how it is counted
"""
    lines = [columns, ["---"] * len(columns), *(cells(row) for row in rows if row.machine == MACHINES[0].name)]
    return "\n".join([text, *(f"| {' | '.join(words)} |" for words in lines), ""])


def cells(row: Measured) -> list[str]:
    """A row of the page."""
    cycle_share = row.mean / row.cycles.instructions
    fewest, most = (cycle_share * count / CLOCK_MHZ for count in (row.cycles.fewest, row.cycles.most))
    shares = [f"{100 * part / whole:.2g} %" for part, whole in ((row.flash, FLASH), (row.ram, RAM))]
    steps = row.answer.vectors.steps + row.answer.log.steps
    numbers = [row.sizes.code, row.sizes.tables, shares[0], row.state, row.answer.stack, shares[1]]
    numbers += [f"{row.mean:.0f}", f"{row.most:.0f}", f"{fewest:.3g} to {most:.3g}", steps]
    return [row.title, row.option, *map(str, numbers)]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
