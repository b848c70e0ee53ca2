"""Cycles of a step on a Cortex-M4F, estimated: the instructions that QEMU executes, each with the cycles of its kind.

Cycles by kind are those of the Cortex-M4 Technical Reference Manual (ARM DDI 0439, tables 3-1 and 7-1): divisions and
roots of singles 14, loads 2, a taken branch 1 to refill the pipeline and two more where its target is not aligned, one
cycle where an instruction needs the single that the one before it made. Fewest: flash as fast as the core, which is
what a cache of instructions gives to code that fits it. Most: every line of 16 bytes and every constant of the code
waits for the flash. Hardware lies between; DWT->CYCCNT tells there.
"""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from emulator import Machine, command, do

#: STM32F411 at 100 MHz and 2.7 to 3.6 V (RM0383, table 5): a flash access waits so many cycles; lines of 128 bits.
CLOCK_MHZ, WAIT_STATES, LINE_BYTES = 100.0, 3, 16
#: Steps that are counted: the code is nearly straight, so few tell as much as all.
STEPS = 8

_INSTRUCTION = re.compile(r"^\s*([0-9a-f]+):\t([0-9a-f ]+?)\s*\t([a-z]\w*)\S*(?:\t(.*))?$")
_SYMBOL = re.compile(r"^([0-9a-f]+) ([0-9a-f]+) [tT] (\w+)$")
_EXECUTED = re.compile(r"^Trace \d+: \S+ \[[0-9a-f]+/([0-9a-f]+)/")
_SINGLE = re.compile(r"\bs\d+\b")
#: Cycles of the kinds that take more than one, by the beginning of their names; the first that fits counts.
_CYCLES = {
    "vdiv": 14, "vsqrt": 14, "vmla": 3, "vmls": 3, "vnmla": 3, "vnmls": 3, "vfma": 3, "vfms": 3, "vldr": 2, "vstr": 2,
    "ldrd": 3, "strd": 3, "ldr": 2, "sdiv": 12, "udiv": 12,
}  # fmt: skip
_MANY = ("ldm", "stm", "push", "pop", "vldm", "vstm", "vpush", "vpop")
_ARITHMETIC = ("vadd", "vsub", "vmul", "vdiv", "vsqrt", "vmla", "vmls", "vnml", "vnmul", "vfma", "vfms", "vcvt")
_ACCUMULATE = ("vmla", "vmls", "vnmla", "vnmls", "vfma", "vfms")
_REFILL = 2


class Instruction(NamedTuple):
    """Instruction of the image.

    size, cycles: in bytes, and of its kind.
    makes, needs: register of the single that it makes (or ""), and of those that it needs.
    constant: True where it reads a constant of the code.
    """

    size: int
    cycles: int
    makes: str
    needs: frozenset[str]
    constant: bool


class Cycles(NamedTuple):
    """Of a mean step: instructions, and the fewest and the most cycles they can take."""

    instructions: float
    fewest: float
    most: float


def cycles(image: Path, name: str, machine: Machine) -> Cycles:
    """Of the first vectors that the image replays; name: prefix of the library."""
    code = dict(_instructions(do(["arm-none-eabi-objdump", "-d", image])))
    symbols = [_SYMBOL.match(line) for line in do(["arm-none-eabi-nm", "-S", image]).splitlines()]
    own = {m[3]: (int(m[1], 16), int(m[2], 16)) for m in symbols if m and m[3].startswith(f"{name}_")}
    functions = [(address, count) for address, count in own.values() if address in code]
    first, last = min(a for a, _ in functions), max(a + count for a, count in functions)
    executed = _steps(_trace(image, machine, first, last), own[f"{name}_step"][0])
    fewest = most = 0
    for before, now, after in zip([0, *executed[:-1]], executed, [*executed[1:], 0], strict=True):
        spent, waited = _cost(code, before, now, after)
        fewest, most = fewest + spent, most + spent + waited
    return Cycles(len(executed) / STEPS, fewest / STEPS, most / STEPS)


def _cost(code: dict[int, Instruction], before: int, now: int, after: int) -> tuple[int, int]:
    """Cycles of an instruction between its neighbours, and those that the flash may add."""
    this, previous = code[now], code.get(before)
    stalled = previous is not None and previous.makes in this.needs
    left = after != now + this.size
    fetched = previous is None or before + previous.size != now or now // LINE_BYTES != before // LINE_BYTES
    return this.cycles + stalled + _REFILL * left, WAIT_STATES * (fetched + this.constant)


def _instructions(disassembly: str) -> Iterator[tuple[int, Instruction]]:
    """Of every address."""
    for match in filter(None, map(_INSTRUCTION.match, disassembly.splitlines())):
        address, code, word, operands = match[1], match[2], match[3], match[4] or ""
        first, _, rest = operands.partition(",")
        arithmetic = word.startswith(_ARITHMETIC)
        reads = rest if arithmetic and not word.startswith(_ACCUMULATE) else operands
        yield (
            int(address, 16),
            Instruction(
                len(code.replace(" ", "")) // 2,
                _cycles_of(word, operands),
                first if arithmetic else "",
                frozenset(_SINGLE.findall(reads)),
                "[pc" in operands,
            ),
        )


def _cycles_of(word: str, operands: str) -> int:
    if word.startswith(_MANY):
        return 1 + sum(_registers(part) for part in re.findall(r"[rsd]?\w+-[rsd]?\w+|\w+", operands.split("{")[-1]))
    return next((count for beginning, count in _CYCLES.items() if word.startswith(beginning)), 1)


def _registers(part: str) -> int:
    """Number of words of `r4`, `s0-s3` or `d8-d15`."""
    numbers = [int(n) for n in re.findall(r"\d+", part)]
    count = numbers[-1] - numbers[0] + 1 if len(numbers) == 2 else 1
    return count * (2 if part.startswith("d") else 1)


def _trace(image: Path, machine: Machine, first: int, last: int) -> Iterator[int]:
    """Addresses in [first, last) in the order in which they are executed."""
    options = ["-singlestep", "-d", "exec,nochain", "-dfilter", f"{first:#x}..{last - 1:#x}"]
    with subprocess.Popen(
        [*command(image, machine), *options], stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True
    ) as process:
        assert process.stderr is not None
        try:
            for line in process.stderr:
                if match := _EXECUTED.match(line):
                    yield int(match[1], 16)
        finally:
            process.kill()


def _steps(executed: Iterator[int], entry: int) -> list[int]:
    """Addresses that the first steps execute."""
    found: list[int] = []
    entered = 0
    for address in executed:
        entered += address == entry
        if entered > STEPS:
            break
        if entered:
            found.append(address)
    executed.close()  # type: ignore[attr-defined]
    return found
