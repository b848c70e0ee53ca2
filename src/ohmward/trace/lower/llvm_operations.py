"""The spelling of every operation in LLVM IR."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from ohmward.trace.bounds import within
from ohmward.trace.expression import Expression
from ohmward.trace.lower.llvm_instructions import Instructions, Target

#: Lines of an operation: (instructions, name of the result, arguments) -> lines.
Speller = Callable[[Instructions, str, tuple[Any, ...]], Iterator[str]]


def spell(w: Instructions, node: Expression) -> Iterator[str]:
    """Lines that compute a node."""
    result = f"%n{len(w.words)}"  # not the serial: it differs from trace to trace
    w.words[node.serial] = result
    yield from SPELLINGS[node.operation.name](w, result, node.args)


def _arithmetic(instruction: str, w: Instructions, result: str, args: tuple[Any, ...]) -> Iterator[str]:
    yield w.arithmetic(result, instruction, *args)


def _comparison(predicate: str, w: Instructions, result: str, args: tuple[Any, ...]) -> Iterator[str]:
    yield w.compare(result, predicate, *args)


def _bitwise(instruction: str, w: Instructions, result: str, args: tuple[Any, ...]) -> Iterator[str]:
    yield w.line(result, instruction, w.target.flag, *args)


def _intrinsic(name: str, w: Instructions, result: str, args: tuple[Any, ...]) -> Iterator[str]:
    yield w.intrinsic(result, name, args[0])


def _extremum(predicate: str, opposite: str, w: Instructions, result: str, args: tuple[Any, ...]) -> Iterator[str]:
    """Of a and b the first if it is smaller (larger) or nan, else the second."""
    a, b = args
    first = w.new()
    if isinstance(b, float) and b and not math.isnan(b):  # with b = 0 the sign of a zero could be lost
        yield w.compare(first, opposite, a, b)
        yield w.select(result, first, b, a)
        return
    missing, taken = w.new(), w.new()
    yield w.compare(first, predicate, a, b)
    yield w.compare(missing, "uno", a, a)
    yield w.line(taken, "or", w.target.flag, first, missing)
    yield w.select(result, taken, a, b)


def _where(w: Instructions, result: str, args: tuple[Any, ...]) -> Iterator[str]:
    yield w.select(result, *args)


def _sign(w: Instructions, result: str, args: tuple[Any, ...]) -> Iterator[str]:
    """Nested choices: 1, -1, or the zero or nan itself."""
    (x,) = args
    above, below, not_above = w.new(), w.new(), w.new()
    yield w.compare(above, "ogt", x, 0.0)
    yield w.compare(below, "olt", x, 0.0)
    zero, not_below = w.new(), w.new()
    yield w.compare(zero, "oeq", x, 0.0)
    yield w.select(not_below, zero, 0.0, x)
    yield w.select(not_above, below, -1.0, not_below)
    yield w.select(result, above, 1.0, not_above)


def _floor_divide(w: Instructions, result: str, args: tuple[Any, ...]) -> Iterator[str]:
    quotient = w.new()
    yield w.arithmetic(quotient, "fdiv", *args)
    yield w.intrinsic(result, "floor", quotient)


def _remainder(w: Instructions, result: str, args: tuple[Any, ...]) -> Iterator[str]:
    """As a - floor(a/b) b, which loses digits where the quotient is large."""
    a, b = args
    whole, product = w.new(), w.new()
    yield from _floor_divide(w, whole, args)
    yield w.arithmetic(product, "fmul", whole, b)
    yield w.arithmetic(result, "fsub", a, product)


def _isfinite(w: Instructions, result: str, args: tuple[Any, ...]) -> Iterator[str]:
    size = w.new()
    yield w.intrinsic(size, "fabs", args[0])
    yield w.line(result, "fcmp olt", w.target.number, size, math.inf)


def _not(w: Instructions, result: str, args: tuple[Any, ...]) -> Iterator[str]:
    yield w.line(result, "xor", w.target.flag, args[0], True)


def _layout(target: Target) -> tuple[int, int]:
    """Bias of the exponent of a number, and bits of its mantissa (IEEE 754)."""
    return (1023, 52) if target.bits == 64 else (127, 23)


def _power_of_two(w: Instructions, result: str, args: tuple[Any, ...]) -> Iterator[str]:
    """The sum with rounder and bias has n + bias in its lowest bits; shifted, they are the exponent."""
    t = w.target
    bias, mantissa = _layout(t)
    lifted, bits, moved = w.new(), w.new(), w.new()
    yield w.line(lifted, "fadd", t.number, args[0], t.precision.rounder + bias)
    yield f"  {bits} = bitcast {t.number} {lifted} to {t.integer}"
    yield f"  {moved} = shl {t.integer} {bits}, {t.whole(mantissa)}"
    yield f"  {result} = bitcast {t.integer} {moved} to {t.number}"


def _exponent(w: Instructions, result: str, args: tuple[Any, ...]) -> Iterator[str]:
    """The exponent's bits become the lowest of 2^52 (2^23), which is then subtracted with the bias."""
    t = w.target
    bias, mantissa = _layout(t)
    bits, moved, lifted, number = w.new(), w.new(), w.new(), w.new()
    yield f"  {bits} = bitcast {t.number} {w.word(args[0])} to {t.integer}"
    yield f"  {moved} = lshr {t.integer} {bits}, {t.whole(mantissa)}"
    yield f"  {lifted} = or {t.integer} {moved}, {t.whole((bias + mantissa) << mantissa)}"
    yield f"  {number} = bitcast {t.integer} {lifted} to {t.number}"
    yield w.line(result, "fsub", t.number, number, 2.0**mantissa + bias)


def _gather(w: Instructions, result: str, args: tuple[Any, ...]) -> Iterator[str]:
    """Entry of a table; an index beyond its ends takes the nearest entry, nan the first."""
    t, (index, values) = w.target, args
    table, place = w.table(values), w.new()
    last = len(values) - 1
    if index.operation.name == "floor" and within(index, 0.0, last):
        # the conversion truncates like `floor`, and need not wait for it
        yield f"  {place} = fptosi {t.number} {w.word(index.args[0])} to {t.of('i32')}"
    else:
        yield from _clamped_index(w, place, index, last)
    pointer = w.new()
    yield f"  {pointer} = getelementptr {t.element}, ptr {table}, {t.of('i32')} {place}"
    if t.width == 1:
        yield f"  {result} = load {t.element}, ptr {pointer}"
        return
    function = f"llvm.masked.gather.{t.suffix}.{t.lanes}p0"
    alignment, mask, default = ("i32 immarg", str(t.bits // 8)), (t.flag, True), (t.number, "poison")
    yield w.call(result, t.number, function, (t.of("ptr"), pointer), alignment, mask, default)


def _clamped_index(w: Instructions, result: str, index: Any, last: int) -> Iterator[str]:
    """An index as an integer from 0 to `last`; 0 for nan."""
    t, indices = w.target, w.target.of("i32")
    whole, not_negative = w.new(), w.new()
    yield w.call(whole, indices, f"llvm.fptosi.sat.{t.lanes}i32.{t.suffix}", (t.number, index))
    for name, source, function, limit in ((not_negative, whole, "smax", 0), (result, not_negative, "smin", last)):
        bound = t.spread("i32", str(limit))
        yield w.call(name, indices, f"llvm.{function}.{t.lanes}i32", (indices, source), (indices, bound))


SPELLINGS: dict[str, Speller] = {
    "add": partial(_arithmetic, "fadd"),
    "subtract": partial(_arithmetic, "fsub"),
    "multiply": partial(_arithmetic, "fmul"),
    "divide": partial(_arithmetic, "fdiv"),
    "negative": partial(_arithmetic, "fneg"),
    "remainder": _remainder,
    "floor_divide": _floor_divide,
    "absolute": partial(_intrinsic, "fabs"),
    "sqrt": partial(_intrinsic, "sqrt"),
    "floor": partial(_intrinsic, "floor"),
    "minimum": partial(_extremum, "olt", "ogt"),
    "maximum": partial(_extremum, "ogt", "olt"),
    "where": _where,
    "sign": _sign,
    "gather": _gather,
    "power_of_two": _power_of_two,
    "exponent": _exponent,
    "less": partial(_comparison, "olt"),
    "less_equal": partial(_comparison, "ole"),
    "equal": partial(_comparison, "oeq"),
    "not_equal": partial(_comparison, "une"),
    "logical_and": partial(_bitwise, "and"),
    "logical_or": partial(_bitwise, "or"),
    "logical_not": _not,
    "isfinite": _isfinite,
}
