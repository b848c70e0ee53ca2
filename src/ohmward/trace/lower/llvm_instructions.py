"""Types, literals and instructions of LLVM IR, for one value or for a vector of lanes."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass, replace
from itertools import count
from typing import Any

from ohmward.trace.elementary import Precision
from ohmward.trace.expression import Expression, is_condition


@dataclass(frozen=True)
class Target:
    """Arithmetic and vector width of the generated code."""

    precision: Precision  #: of the arithmetic
    width: int = 1  #:     lanes in a vector; 1 is scalar code
    #:  products and sums may become fused multiply-adds: faster, but last bits differ between machines
    contract: bool = True

    @property
    def bits(self) -> int:
        """Size of a number."""
        return 64 if self.precision.name == "f64" else 32

    @property
    def element(self) -> str:
        """Type of a number in one lane."""
        return "double" if self.bits == 64 else "float"

    @property
    def number(self) -> str:
        """Type of a number."""
        return self.of(self.element)

    @property
    def integer(self) -> str:
        """Type of an integer of the size of a number."""
        return self.of(f"i{self.bits}")

    @property
    def flag(self) -> str:
        """Type of a condition."""
        return self.of("i1")

    @property
    def suffix(self) -> str:
        """Ending of the names of intrinsics: f64, v8f64, ..."""
        return f"{self.lanes}f{self.bits}"

    @property
    def lanes(self) -> str:
        """Lanes in the names of intrinsics: v8, nothing for scalar code."""
        return "" if self.width == 1 else f"v{self.width}"

    def of(self, element: str) -> str:
        """The type of `element` in every lane."""
        return element if self.width == 1 else f"<{self.width} x {element}>"

    def constant(self, value: Any) -> str:
        """A literal; floats as the bits of a double, as LLVM requires for both precisions."""
        if isinstance(value, bool):
            return self.spread("i1", "true" if value else "false")
        rounded = value if self.bits == 64 else _single(value)
        return self.spread(self.element, f"0x{struct.unpack('<Q', struct.pack('<d', rounded))[0]:016X}")

    def whole(self, value: int) -> str:
        """An integer literal."""
        return self.spread(f"i{self.bits}", str(value))

    def spread(self, element: str, literal: str) -> str:
        """A literal in every lane."""
        return literal if self.width == 1 else f"<{', '.join([f'{element} {literal}'] * self.width)}>"


def _single(value: float) -> float:
    """The nearest number in single precision, inf where it is too large."""
    try:
        single: float = struct.unpack("<f", struct.pack("<f", value))[0]
    except OverflowError:
        return math.inf if value > 0 else -math.inf
    return single


class Instructions:
    """Lines of LLVM IR while a function is written, and the globals and declarations that they need.

    words: names of the values that have been computed, by serial.
    """

    def __init__(self, target: Target):
        self.target = target
        self.globals: list[str] = []
        self.declarations: set[str] = set()
        self.words: dict[int, str] = {}
        self._tables: dict[tuple[float, ...], str] = {}
        self._numbers = count(1)

    def beside(self, width: int) -> Instructions:
        """Instructions of the same function on vectors of this width: they share names, globals and declarations."""
        wide = Instructions(replace(self.target, width=width))
        wide.globals, wide.declarations = self.globals, self.declarations
        wide._tables, wide._numbers = self._tables, self._numbers
        return wide

    def new(self) -> str:
        """Name of a new temporary value."""
        return f"%v{next(self._numbers)}"

    def word(self, x: Any) -> str:
        """Name of a traced value, or a literal; a name is returned as it is."""
        if isinstance(x, str):
            return x
        return self.words[x.serial] if isinstance(x, Expression) else self.target.constant(x)

    def type_of(self, x: Expression) -> str:
        """LLVM's type of a traced value."""
        return self.target.flag if x.boolean else self.target.number

    # ---- one instruction each; arguments are traced values, constants or names

    def line(self, result: str, instruction: str, kind: str, *args: Any) -> str:
        """An instruction on arguments of one type."""
        return f"  {result} = {instruction} {kind} {', '.join(self.word(a) for a in args)}"

    def arithmetic(self, result: str, instruction: str, *args: Any) -> str:
        """An instruction on numbers, such as fadd."""
        contract = " contract" if self.target.contract else ""
        return self.line(result, f"{instruction}{contract}", self.target.number, *args)

    def compare(self, result: str, predicate: str, a: Any, b: Any) -> str:
        """A comparison of two numbers, or of two conditions for equality."""
        if is_condition(a):
            predicate = {"oeq": "eq", "une": "ne"}[predicate]
            return self.line(result, f"icmp {predicate}", self.target.flag, a, b)
        return self.line(result, f"fcmp {predicate}", self.target.number, a, b)

    def select(self, result: str, condition: Any, a: Any, b: Any) -> str:
        """`a` where the condition holds, else `b`."""
        flag, kind = self.target.flag, self.target.number
        return f"  {result} = select {flag} {self.word(condition)}, {kind} {self.word(a)}, {kind} {self.word(b)}"

    def intrinsic(self, result: str, name: str, x: Any) -> str:
        """An LLVM intrinsic of one number, such as sqrt."""
        return self.call(result, self.target.number, f"llvm.{name}.{self.target.suffix}", (self.target.number, x))

    def call(self, result: str, kind: str, function: str, *arguments: tuple[str, Any]) -> str:
        """A call of an external function with arguments (type, value), which it declares."""
        self.declarations.add(f"declare {kind} @{function}({', '.join(t for t, _ in arguments)})")
        words = ", ".join(f"{t.removesuffix(' immarg')} {self.word(x)}" for t, x in arguments)
        return f"  {result} = call {kind} @{function}({words})"

    def reduced(self, result: str, flags: str) -> str:
        """True where the flags of all lanes are."""
        kind, function = self.target.flag, f"llvm.vector.reduce.and.v{self.target.width}i1"
        self.declarations.add(f"declare i1 @{function}({kind})")
        return f"  {result} = call i1 @{function}({kind} {flags})"

    def table(self, values: tuple[float, ...]) -> str:
        """Name of the global that holds a table."""
        if values not in self._tables:
            name = self._tables[values] = f"@table{len(self._tables)}"
            one = Target(self.target.precision)
            entries = ", ".join(f"{one.element} {one.constant(v)}" for v in values)
            array = f"[{len(values)} x {one.element}] [{entries}]"
            self.globals.append(f"{name} = private unnamed_addr constant {array}, align 64")
        return self._tables[values]
