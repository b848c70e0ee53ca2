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

from collections.abc import Iterator, Sequence
from typing import Any

from ohmward.trace.expression import Expression, is_condition
from ohmward.trace.lower.llvm_instructions import Instructions, Target
from ohmward.trace.lower.llvm_operations import spell
from ohmward.trace.program import Program

#: Arguments of every function that is made here.
ARGUMENTS = (
    "ptr noalias %state, i64 %row, ptr noalias %columns, ptr noalias %time, ptr noalias %outputs, ptr noalias %out, "
    "i64 %first, i64 %last, i64 %lane, i64 %lanes"
)
_DOUBLE = 8


def scan_source(program: Program, state_size: int, target: Target, own: Sequence[bool], name: str) -> str:
    """Text of the module with the function `name`.

    program:    a step(state, sample) -> (state, output) without exp, log and the like; see `elementary.expand`.
    state_size: number of its first inputs and outputs that are the state.
    own:        for each sample column True where every lane has its own value.
    """
    loop = _LogLoop(program, state_size, target, own)
    body = list(loop.function(name))
    return "\n".join([*loop.write.globals, *body, *sorted(loop.write.declarations), ""])


class _LogLoop:
    """The loops over lanes and time around a program; memory in, memory out.

    state:   inputs that are the state.
    columns: number and input of the sample columns that the program reads.
    results: number and value of the outputs.
    own:     for each sample column True where every lane has its own value.
    """

    def __init__(self, program: Program, state_size: int, target: Target, own: Sequence[bool]):
        self.write, self.target, self.program, self.own = Instructions(target), target, program, own
        self.state = program.inputs[:state_size]
        self.after = program.outputs[:state_size]
        columns = enumerate(program.inputs[state_size:])
        self.columns = [(j, symbol) for j, symbol in columns if symbol.serial in program.used]
        self.results = list(enumerate(program.outputs[state_size:]))

    def function(self, name: str) -> Iterator[str]:
        """Blocks of lanes, steps of time, and the program within."""
        step = list(self.step())
        after = [self.write.word(y) for y in self.after]
        yield f"define void @{name}({ARGUMENTS}) {{"
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
            yield f"  %x{k} = phi {self.write.type_of(symbol)} [%before{k}, %load], [{word}, %step]"
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

    def step(self) -> Iterator[str]:
        """One step: samples in, operations, outputs out."""
        self.write.words |= {symbol.serial: f"%x{k}" for k, symbol in enumerate(self.state)}
        for j, symbol in self.columns:
            yield from self.load_sample(j, symbol)
        for node in self.program.nodes:
            yield from spell(self.write, node)
        for j, y in self.results:
            yield from self.store_output(j, y)

    def arrays(self) -> Iterator[str]:
        """Addresses and strides of columns and outputs."""
        for j, _ in self.columns:
            yield from _entry(f"column{j}", "ptr", "columns", j)
            yield from _entry(f"time{j}", "i64", "time", j)
        for j, _ in self.results:
            yield from _entry(f"output{j}", "ptr", "outputs", j)
            yield from _entry(f"out{j}", "i64", "out", j)

    # ---- memory

    def load_state(self) -> Iterator[str]:
        """The state before the first step."""
        for k, symbol in enumerate(self.state):
            yield f"  %s{k}.by = mul i64 %row, {k}"
            yield f"  %s{k} = getelementptr i8, ptr %base, i64 %s{k}.by"
            yield from self.load(f"%before{k}", f"%s{k}", symbol.boolean, own=True)

    def load_sample(self, j: int, symbol: Expression) -> Iterator[str]:
        """Column j of the sample at time t."""
        yield f"  %c{j}.by = mul i64 %t, %time{j}"
        yield f"  %c{j}.row = getelementptr i8, ptr %column{j}, i64 %c{j}.by"
        shift = "%shift" if self.own[j] else "0"
        yield f"  %c{j} = getelementptr i8, ptr %c{j}.row, i64 {shift}"
        yield from self.load(f"%u{j}", f"%c{j}", symbol.boolean, self.own[j])
        self.write.words[symbol.serial] = f"%u{j}"

    def store_output(self, j: int, y: Any) -> Iterator[str]:
        """Output j at time t."""
        yield f"  %o{j}.by = mul i64 %t, %out{j}"
        yield f"  %o{j}.row = getelementptr i8, ptr %output{j}, i64 %o{j}.by"
        yield f"  %o{j} = getelementptr i8, ptr %o{j}.row, i64 %shift"
        yield from self.store(self.write.word(y), f"%o{j}", is_condition(y))

    def load(self, name: str, pointer: str, boolean: bool, own: bool) -> Iterator[str]:
        """A value from memory: one double for each lane, or one for all lanes."""
        write, target, kind = self.write, self.target, self.target.of("double")
        as_stored = target.bits == 64 and not boolean
        if own or target.width == 1:
            doubles = name if as_stored else write.new()
            yield f"  {doubles} = load {kind}, ptr {pointer}, align {_DOUBLE}"
        else:
            single, first = write.new(), write.new()
            doubles = name if as_stored else write.new()
            yield f"  {single} = load double, ptr {pointer}, align {_DOUBLE}"
            yield f"  {first} = insertelement {kind} poison, double {single}, i64 0"
            zeros = f"<{target.width} x i32> zeroinitializer"
            yield f"  {doubles} = shufflevector {kind} {first}, {kind} poison, {zeros}"
        if boolean:
            yield f"  {name} = fcmp une {kind} {doubles}, {target.spread('double', '0.0')}"
        elif target.bits == 32:
            yield f"  {name} = fptrunc {kind} {doubles} to {target.number}"

    def store(self, word: str, pointer: str, boolean: bool) -> Iterator[str]:
        """A value to memory, as a double."""
        target, kind, doubles = self.target, self.target.of("double"), word
        if boolean:
            doubles = self.write.new()
            one, zero = target.spread("double", "1.0"), target.spread("double", "0.0")
            yield f"  {doubles} = select {target.flag} {word}, {kind} {one}, {kind} {zero}"
        elif target.bits == 32:
            doubles = self.write.new()
            yield f"  {doubles} = fpext {target.number} {word} to {kind}"
        yield f"  store {kind} {doubles}, ptr {pointer}, align {_DOUBLE}"


def _entry(name: str, kind: str, array: str, index: int) -> Iterator[str]:
    """One entry of an array of the caller's."""
    yield f"  %{name}.at = getelementptr {kind}, ptr %{array}, i64 {index}"
    yield f"  %{name} = load {kind}, ptr %{name}.at"
