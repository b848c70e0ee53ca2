"""Lowering to LLVM IR: the loop over time of one log, or of a block of logs in SIMD lanes.

One function per program, no calls, no memory but the caller's:

    void scan(state, row, columns, time, outputs, out, first, last, lane, lanes)

    state    scalar k of the state is at state + k row, lane l of it 8 l bytes on
    columns  pointers to the samples' columns; column j at time t is at columns[j] + t time[j], and 8 l bytes on where
             every lane has its own value
    outputs  pointers and, in `out`, strides of the outputs, as the columns
    first, last   steps;   lane, lanes   the first lane and the end, a whole number of blocks apart

Memory holds doubles, whatever the arithmetic. Conditions are 0.0 and 1.0 there. All strides are in bytes.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from ohmward.trace.bounds import bounds
from ohmward.trace.elementary import Precision
from ohmward.trace.expression import Expression
from ohmward.trace.program import Program

_ARGUMENTS = (
    "ptr noalias %state, i64 %row, ptr noalias %columns, ptr noalias %time, ptr noalias %outputs, ptr noalias %out, "
    "i64 %first, i64 %last, i64 %lane, i64 %lanes"
)
_DOUBLE = 8


@dataclass(frozen=True)
class Target:
    """What the code is made for.

    precision: of the arithmetic.
    width:     lanes in a vector; 1 is scalar code.
    contract:  products and sums may become fused multiply-adds: faster, and other last bits on other machines.
    """

    precision: Precision
    width: int = 1
    contract: bool = True

    @property
    def bits(self) -> int:
        """Of a number."""
        return 64 if self.precision.name == "f64" else 32

    @property
    def number(self) -> str:
        """LLVM's type of a value."""
        return self.of("double" if self.bits == 64 else "float")

    @property
    def integer(self) -> str:
        """The integer of the same size."""
        return self.of(f"i{self.bits}")

    @property
    def flag(self) -> str:
        """Type of a condition."""
        return self.of("i1")

    def of(self, element: str) -> str:
        """A scalar or vector type."""
        return element if self.width == 1 else f"<{self.width} x {element}>"

    def constant(self, value: Any) -> str:
        """A literal; floats as the bits of a double, which LLVM wants for both precisions."""
        if isinstance(value, bool):
            return self.spread("i1", "true" if value else "false")
        rounded = value if self.bits == 64 else _single(value)
        return self.spread(self.element, f"0x{struct.unpack('<Q', struct.pack('<d', rounded))[0]:016X}")

    def whole(self, value: int) -> str:
        """An integer literal."""
        return self.spread(f"i{self.bits}", str(value))

    @property
    def element(self) -> str:
        """Type of one lane."""
        return "double" if self.bits == 64 else "float"

    def spread(self, element: str, literal: str) -> str:
        """A literal in every lane."""
        return literal if self.width == 1 else f"<{', '.join([f'{element} {literal}'] * self.width)}>"

    @property
    def suffix(self) -> str:
        """Of intrinsics: f64, v8f64, ..."""
        scalar = f"f{self.bits}"
        return scalar if self.width == 1 else f"v{self.width}{scalar}"


def signature() -> str:
    """The arguments of every function that is made here."""
    return _ARGUMENTS


def _single(value: float) -> float:
    """The nearest single, inf where it is too large."""
    try:
        return struct.unpack("<f", struct.pack("<f", value))[0]
    except OverflowError:
        return float("inf") if value > 0 else float("-inf")


def scan_source(program: Program, state_size: int, target: Target, own: Sequence[bool], name: str) -> str:
    """The module's text.

    program:    a step(state, sample) -> (state, output) without exp, log and their like; see `elementary.expand`.
    state_size: how many of its first inputs and outputs are the state.
    own:        for each sample column whether every lane has its own value.
    """
    writer = _LlvmWriter(program, state_size, target, tuple(own))
    body = list(writer.function(name))
    return "\n".join([*writer.globals, *body, *sorted(writer.declarations), ""])


class _LlvmWriter:
    """The text of one function while it is written."""

    def __init__(self, program: Program, state_size: int, target: Target, own: tuple[bool, ...]):
        self.program, self.state_size, self.target, self.own = program, state_size, target, own
        self.globals: list[str] = []
        self.declarations: set[str] = set()
        self.tables: dict[tuple, str] = {}
        self.words: dict[int, str] = {}
        self.fresh = 0

    # ---- the frame

    def function(self, name: str) -> Iterator[str]:
        """Blocks of lanes, steps of time, and the program within."""
        step = list(self.step())
        after = [self.word(y) for y in self.program.outputs[: self.state_size]]
        yield f"define void @{name}({_ARGUMENTS}) {{"
        yield "entry:"
        yield from self.arrays()
        yield "  br label %block"
        yield "block:"
        yield "  %l = phi i64 [%lane, %entry], [%l1, %done]"
        yield "  %more = icmp slt i64 %l, %lanes"
        yield "  br i1 %more, label %load, label %end"
        yield "load:"
        yield f"  %shift = mul i64 %l, {_DOUBLE}"
        yield "  %base = getelementptr i8, ptr %state, i64 %shift"
        yield from self.load_state()
        yield "  br label %test"
        yield "test:"
        yield "  %t = phi i64 [%first, %load], [%t1, %step]"
        for k, (symbol, word) in enumerate(zip(self.state, after, strict=True)):
            yield f"  %x{k} = phi {self.kind(symbol)} [%before{k}, %load], [{word}, %step]"
        yield "  %go = icmp slt i64 %t, %last"
        yield "  br i1 %go, label %step, label %done"
        yield "step:"
        yield from step
        yield "  %t1 = add i64 %t, 1"
        yield "  br label %test"
        yield "done:"
        for k, symbol in enumerate(self.state):
            yield from self.store(f"%x{k}", f"%s{k}", symbol.boolean)
        yield f"  %l1 = add i64 %l, {self.target.width}"
        yield "  br label %block"
        yield "end:"
        yield "  ret void"
        yield "}"

    @property
    def state(self) -> tuple[Expression, ...]:
        """Inputs that are the state."""
        return self.program.inputs[: self.state_size]

    @property
    def samples(self) -> list[tuple[int, Expression]]:
        """Number and input of the columns that the program reads."""
        read = {a.serial for node in self.program.nodes for a in node.args if isinstance(a, Expression)}
        read |= {y.serial for y in self.program.outputs if isinstance(y, Expression)}
        columns = enumerate(self.program.inputs[self.state_size :])
        return [(j, symbol) for j, symbol in columns if symbol.serial in read]

    @property
    def results(self) -> list[tuple[int, Any]]:
        """Number and value of the outputs."""
        return list(enumerate(self.program.outputs[self.state_size :]))

    def step(self) -> Iterator[str]:
        """One step: samples in, operations, outputs out."""
        self.words |= {symbol.serial: f"%x{k}" for k, symbol in enumerate(self.state)}
        for j, symbol in self.samples:
            yield from self.sample(j, symbol)
        for node in self.program.nodes:
            yield from self.operation(node)
        for j, y in self.results:
            yield from self.store_output(j, y)

    def arrays(self) -> Iterator[str]:
        """Where columns and outputs begin, and their strides."""
        for j, _ in self.samples:
            yield from self.entry(f"column{j}", "ptr", "columns", j)
            yield from self.entry(f"time{j}", "i64", "time", j)
        for j, _ in self.results:
            yield from self.entry(f"output{j}", "ptr", "outputs", j)
            yield from self.entry(f"out{j}", "i64", "out", j)

    def load_state(self) -> Iterator[str]:
        """The state before the first step."""
        for k, symbol in enumerate(self.state):
            yield f"  %s{k}.by = mul i64 %row, {k}"
            yield f"  %s{k} = getelementptr i8, ptr %base, i64 %s{k}.by"
            yield from self.load(f"before{k}", f"s{k}", symbol.boolean, own=True)

    def kind(self, x: Expression) -> str:
        """LLVM's type of a value."""
        return self.target.flag if x.boolean else self.target.number

    def new(self) -> str:
        """A name that nothing else has."""
        self.fresh += 1
        return f"%v{self.fresh}"

    # ---- memory

    def entry(self, name: str, kind: str, array: str, index: int) -> Iterator[str]:
        """One entry of an array of the caller's."""
        yield f"  %{name}.at = getelementptr {kind}, ptr %{array}, i64 {index}"
        yield f"  %{name} = load {kind}, ptr %{name}.at"

    def sample(self, j: int, symbol: Expression) -> Iterator[str]:
        yield f"  %c{j}.by = mul i64 %t, %time{j}"
        yield f"  %c{j}.row = getelementptr i8, ptr %column{j}, i64 %c{j}.by"
        shift = "%shift" if self.own[j] else "0"
        yield f"  %c{j} = getelementptr i8, ptr %c{j}.row, i64 {shift}"
        yield from self.load(f"u{j}", f"c{j}", symbol.boolean, self.own[j])
        self.words[symbol.serial] = f"%u{j}"

    def load(self, name: str, pointer: str, boolean: bool, own: bool) -> Iterator[str]:
        """A value from memory: one double for each lane, or one for all."""
        target = self.target
        vector = own and target.width > 1
        kind = target.of("double") if vector else "double"
        result = f"%{name}" if not boolean and target.bits == 64 and (vector or target.width == 1) else self.new()
        yield f"  {result} = load {kind}, ptr %{pointer}, align {_DOUBLE}"
        if target.width > 1 and not own:
            one, kind = self.new(), target.of("double")
            yield f"  {one} = insertelement {kind} poison, double {result}, i64 0"
            zeros = f"<{target.width} x i32> zeroinitializer"
            result = self.new() if boolean or target.bits == 32 else f"%{name}"
            yield f"  {result} = shufflevector {kind} {one}, {kind} poison, {zeros}"
        if boolean:
            zero = target.spread("double", "0.0")
            yield f"  %{name} = fcmp une {target.of('double')} {result}, {zero}"
        elif target.bits == 32:
            yield f"  %{name} = fptrunc {target.of('double')} {result} to {target.number}"

    def store(self, word: str, pointer: str, boolean: bool) -> Iterator[str]:
        target, value = self.target, word
        if boolean:
            value = self.new()
            ones, zeros = target.spread("double", "1.0"), target.spread("double", "0.0")
            kind = target.of("double")
            yield f"  {value} = select {target.flag} {word}, {kind} {ones}, {kind} {zeros}"
        elif target.bits == 32:
            value = self.new()
            yield f"  {value} = fpext {target.number} {word} to {target.of('double')}"
        yield f"  store {target.of('double')} {value}, ptr {pointer}, align {_DOUBLE}"

    def store_output(self, j: int, y: Any) -> Iterator[str]:
        yield f"  %o{j}.by = mul i64 %t, %out{j}"
        yield f"  %o{j}.row = getelementptr i8, ptr %output{j}, i64 %o{j}.by"
        yield f"  %o{j} = getelementptr i8, ptr %o{j}.row, i64 %shift"
        boolean = y.boolean if isinstance(y, Expression) else isinstance(y, bool)
        yield from self.store(self.word(y), f"%o{j}", boolean)

    # ---- operations

    def word(self, x: Any) -> str:
        """The name of a value, or a literal."""
        return self.words[x.serial] if isinstance(x, Expression) else self.target.constant(x)

    def operation(self, node: Expression) -> Iterator[str]:
        """The lines of one operation."""
        name = node.operation.name
        result = self.words[node.serial] = f"%n{len(self.words)}"  # not the serial: it differs from trace to trace
        yield from _SPELLINGS[name](self, result, node.args)

    def line(self, result: str, instruction: str, kind: str, *words: str) -> str:
        return f"  {result} = {instruction} {kind} {', '.join(words)}"

    def arithmetic(self, result: str, instruction: str, *args: Any) -> str:
        """An instruction like fadd on names, literals or values."""
        flags = " contract" if self.target.contract else ""
        words = [a if isinstance(a, str) else self.word(a) for a in args]
        return self.line(result, f"{instruction}{flags}", self.target.number, *words)

    def compare(self, result: str, predicate: str, a: Any, b: Any) -> str:
        if _is_condition(a):
            predicate = {"oeq": "eq", "une": "ne"}[predicate]
            return self.line(result, f"icmp {predicate}", self.target.flag, self.word(a), self.word(b))
        return self.line(result, f"fcmp {predicate}", self.target.number, self.word(a), self.word(b))

    def select(self, result: str, flag: str, a: Any, b: Any) -> str:
        kind = self.target.number
        words = [x if isinstance(x, str) else self.word(x) for x in (a, b)]
        return f"  {result} = select {self.target.flag} {flag}, {kind} {words[0]}, {kind} {words[1]}"

    def intrinsic(self, result: str, name: str, x: Any) -> str:
        kind, function = self.target.number, f"llvm.{name}.{self.target.suffix}"
        self.declarations.add(f"declare {kind} @{function}({kind})")
        word = x if isinstance(x, str) else self.word(x)
        return f"  {result} = call {kind} @{function}({kind} {word})"

    def table(self, values: tuple[float, ...]) -> str:
        """The global that holds a table."""
        if values not in self.tables:
            name = self.tables[values] = f"@table{len(self.tables)}"
            one = Target(self.target.precision)
            entries = ", ".join(f"{one.element} {one.constant(v)}" for v in values)
            self.globals.append(
                f"{name} = private unnamed_addr constant [{len(values)} x {one.element}] [{entries}], align 64"
            )
        return self.tables[values]


def _is_condition(x: Any) -> bool:
    return x.boolean if isinstance(x, Expression) else isinstance(x, bool)


# ---- one speller for each operation: (writer, name of the result, arguments) -> lines

_Speller = Callable[[_LlvmWriter, str, tuple], Iterator[str]]


def _plain(instruction: str) -> _Speller:
    def lines(w: _LlvmWriter, result: str, args: tuple) -> Iterator[str]:
        yield w.arithmetic(result, instruction, *args)

    return lines


def _comparison(predicate: str) -> _Speller:
    def lines(w: _LlvmWriter, result: str, args: tuple) -> Iterator[str]:
        yield w.compare(result, predicate, *args)

    return lines


def _bitwise(instruction: str) -> _Speller:
    def lines(w: _LlvmWriter, result: str, args: tuple) -> Iterator[str]:
        yield w.line(result, instruction, w.target.flag, *(w.word(a) for a in args))

    return lines


def _intrinsic(name: str) -> _Speller:
    def lines(w: _LlvmWriter, result: str, args: tuple) -> Iterator[str]:
        yield w.intrinsic(result, name, args[0])

    return lines


def _extremum(predicate: str) -> _Speller:
    """Of a and b the first if it is smaller (larger) or nan, else the second."""
    opposite = {"olt": "ogt", "ogt": "olt"}[predicate]

    def lines(w: _LlvmWriter, result: str, args: tuple) -> Iterator[str]:
        first = w.new()
        if isinstance(args[1], float) and args[1] and not math.isnan(args[1]):  # of zeros the sign could be lost
            yield w.compare(first, opposite, *args)
            yield w.select(result, first, args[1], args[0])
            return
        missing, taken = w.new(), w.new()
        yield w.compare(first, predicate, *args)
        yield w.compare(missing, "uno", args[0], args[0])
        yield w.line(taken, "or", w.target.flag, first, missing)
        yield w.select(result, taken, *args)

    return lines


def _where(w: _LlvmWriter, result: str, args: tuple) -> Iterator[str]:
    yield w.select(result, w.word(args[0]), args[1], args[2])


def _sign(w: _LlvmWriter, result: str, args: tuple) -> Iterator[str]:
    """Nested choices: 1, -1, or the zero or nan itself."""
    above, below, one = w.new(), w.new(), w.new()
    yield w.compare(above, "ogt", args[0], 0.0)
    yield w.compare(below, "olt", args[0], 0.0)
    zero, kept = w.new(), w.new()
    yield w.compare(zero, "oeq", args[0], 0.0)
    yield w.select(kept, zero, 0.0, args[0])
    yield w.select(one, below, -1.0, kept)
    yield w.select(result, above, 1.0, one)


def _floor_divide(w: _LlvmWriter, result: str, args: tuple) -> Iterator[str]:
    quotient = w.new()
    yield w.arithmetic(quotient, "fdiv", *args)
    yield w.intrinsic(result, "floor", quotient)


def _remainder(w: _LlvmWriter, result: str, args: tuple) -> Iterator[str]:
    """As a - floor(a/b) b, which loses digits where the quotient is large."""
    whole, product = w.new(), w.new()
    yield from _floor_divide(w, whole, args)
    yield w.arithmetic(product, "fmul", whole, args[1])
    yield w.arithmetic(result, "fsub", args[0], product)


def _isfinite(w: _LlvmWriter, result: str, args: tuple) -> Iterator[str]:
    size = w.new()
    yield w.intrinsic(size, "fabs", args[0])
    yield w.line(result, "fcmp olt", w.target.number, size, w.target.constant(float("inf")))


def _not(w: _LlvmWriter, result: str, args: tuple) -> Iterator[str]:
    yield w.line(result, "xor", w.target.flag, w.word(args[0]), w.target.constant(True))


def _power_of_two(w: _LlvmWriter, result: str, args: tuple) -> Iterator[str]:
    """The sum with the rounder has n in its lowest bits; shifted, they are the exponent."""
    t, bias, mantissa = w.target, *((1023, 52) if w.target.bits == 64 else (127, 23))
    lifted, bits, moved = w.new(), w.new(), w.new()
    yield f"  {lifted} = fadd {t.number} {w.word(args[0])}, {t.constant(t.precision.rounder + bias)}"
    yield f"  {bits} = bitcast {t.number} {lifted} to {t.integer}"
    yield f"  {moved} = shl {t.integer} {bits}, {t.whole(mantissa)}"
    yield f"  {result} = bitcast {t.integer} {moved} to {t.number}"


def _exponent(w: _LlvmWriter, result: str, args: tuple) -> Iterator[str]:
    """The exponent's bits as the lowest of 2^52 (2^23), which is then taken away."""
    t, bias, mantissa = w.target, *((1023, 52) if w.target.bits == 64 else (127, 23))
    bits, moved, lifted, number = w.new(), w.new(), w.new(), w.new()
    yield f"  {bits} = bitcast {t.number} {w.word(args[0])} to {t.integer}"
    yield f"  {moved} = lshr {t.integer} {bits}, {t.whole(mantissa)}"
    yield f"  {lifted} = or {t.integer} {moved}, {t.whole((bias + mantissa) << mantissa)}"
    yield f"  {number} = bitcast {t.integer} {lifted} to {t.number}"
    yield f"  {result} = fsub {t.number} {number}, {t.constant(2.0**mantissa + bias)}"


def _gather(w: _LlvmWriter, result: str, args: tuple) -> Iterator[str]:
    """An entry of a table; what is no index within it takes the nearest entry, nan the first."""
    t, (index, values) = w.target, args
    table, indices, place = w.table(values), t.of("i32"), w.new()
    yield from (
        _index_within(w, place, index) if _is_place(index, len(values)) else _clamped_index(w, place, index, values)
    )
    pointer = w.new()
    yield f"  {pointer} = getelementptr {t.element}, ptr {table}, {indices} {place}"
    if t.width == 1:
        yield f"  {result} = load {t.element}, ptr {pointer}"
        return
    function = f"llvm.masked.gather.{t.suffix}.v{t.width}p0"
    pointers, mask = f"<{t.width} x ptr>", t.flag
    w.declarations.add(f"declare {t.number} @{function}({pointers}, i32 immarg, {mask}, {t.number})")
    yield (
        f"  {result} = call {t.number} @{function}({pointers} {pointer}, i32 {t.bits // 8}, "
        f"{mask} {t.constant(True)}, {t.number} poison)"
    )


def _index_within(w: _LlvmWriter, result: str, index: Expression) -> Iterator[str]:
    """The conversion cuts off what `floor` does, and need not wait for it."""
    (number,) = index.args
    yield f"  {result} = fptosi {w.target.number} {w.word(number)} to {w.target.of('i32')}"


def _clamped_index(w: _LlvmWriter, result: str, index: Any, values: tuple[float, ...]) -> Iterator[str]:
    t, indices = w.target, w.target.of("i32")
    whole, low = w.new(), w.new()
    convert = f"llvm.fptosi.sat.{'' if t.width == 1 else f'v{t.width}'}i32.{t.suffix}"
    w.declarations.add(f"declare {indices} @{convert}({t.number})")
    yield f"  {whole} = call {indices} @{convert}({t.number} {w.word(index)})"
    for name, source, function, limit in ((low, whole, "smax", 0), (result, low, "smin", len(values) - 1)):
        call = f"llvm.{function}.{'' if t.width == 1 else f'v{t.width}'}i32"
        w.declarations.add(f"declare {indices} @{call}({indices}, {indices})")
        yield f"  {name} = call {indices} @{call}({indices} {source}, {indices} {t.spread('i32', str(limit))})"


def _is_place(index: Any, count: int) -> bool:
    """Whether it is the floor of a number between 0 and the last place of a table, whatever the data."""
    found = bounds(index)
    return found is not None and index.operation.name == "floor" and found[0] >= 0.0 and found[1] <= count - 1


_SPELLINGS: dict[str, _Speller] = {
    "add": _plain("fadd"),
    "subtract": _plain("fsub"),
    "multiply": _plain("fmul"),
    "divide": _plain("fdiv"),
    "negative": _plain("fneg"),
    "remainder": _remainder,
    "floor_divide": _floor_divide,
    "absolute": _intrinsic("fabs"),
    "sqrt": _intrinsic("sqrt"),
    "floor": _intrinsic("floor"),
    "minimum": _extremum("olt"),
    "maximum": _extremum("ogt"),
    "where": _where,
    "sign": _sign,
    "gather": _gather,
    "power_of_two": _power_of_two,
    "exponent": _exponent,
    "less": _comparison("olt"),
    "less_equal": _comparison("ole"),
    "equal": _comparison("oeq"),
    "not_equal": _comparison("une"),
    "logical_and": _bitwise("and"),
    "logical_or": _bitwise("or"),
    "logical_not": _not,
    "isfinite": _isfinite,
}
