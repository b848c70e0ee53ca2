"""Lowering to LLVM IR: the loop over time of one log, or of a block of logs in SIMD lanes.

One function per program, no calls, no memory but the caller's:

    void scan(state, row, columns, time, outputs, out, first, last, lane, lanes)

    state    scalar k of the state is at state + k row, and its lane l is 8 l bytes further
    columns  pointers to the samples' columns; column j at time t is at columns[j] + t time[j], and 8 l bytes further
             where every lane has its own value
    outputs  pointers and, in `out`, strides of the outputs, as for the columns
    first, last   steps;   lane, lanes   the first lane and the end, a whole number of blocks apart

Memory holds doubles, whatever the arithmetic. Conditions are 0.0 and 1.0 there. All strides are in bytes.
"""

from __future__ import annotations

from collections.abc import Collection, Generator, Iterator, Sequence
from typing import Any

from ohmward.trace.expression import Expression, is_condition
from ohmward.trace.lower.guards import Guarded, guarded
from ohmward.trace.lower.llvm_instructions import Instructions, Target
from ohmward.trace.lower.llvm_operations import SPELLINGS, spell
from ohmward.trace.lower.packs import Key, Pack, Packs, is_one, key_of
from ohmward.trace.lower.repeats import repeats_of
from ohmward.trace.program import Program

#: Arguments of every generated function.
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
    if target.width == 1 and (packs := Packs(program)).places and packs.order is not None:
        loop = _PackedLoop(program, state_size, target, own, packs)
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
        self.repeats = repeats_of(program, self.packed_serials())
        self.end = "step"  # the block with which a step ends

    def function(self, name: str) -> Iterator[str]:
        """Blocks of lanes, steps of time, and the program within."""
        step = list(self.step())
        state_phis = list(self.state_phis())
        yield f"define void @{name}({ARGUMENTS}) {{"
        yield "entry:"
        yield from self.arrays()
        yield from self.places()
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
        yield f"  %t = phi i64 [%first, %load], [%t1, %{self.end}]"
        yield from state_phis
        yield "  %go = icmp slt i64 %t, %last"
        yield "  br i1 %go, label %step, label %done"
        yield "step:"
        yield from step
        yield "  %t1 = add i64 %t, 1"
        yield "  br label %test"
        yield "done:"
        yield from self.store_state()
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
        yield from self.repeated()
        for item in guarded(self.program, self.write.words):
            yield from self.guard(item) if isinstance(item, Guarded) else spell(self.write, item)
        for j, y in self.results:
            yield from self.store_output(j, y)

    def packed_serials(self) -> Collection[int]:
        """Serials of the operations that are computed in lanes of a vector."""
        return ()

    def state_phis(self) -> Iterator[str]:
        """The state, from the step before or from memory."""
        for k, (symbol, y) in enumerate(zip(self.state, self.after, strict=True)):
            kind, word = self.write.type_of(symbol), self.write.word(y)
            yield f"  %x{k} = phi {kind} [%before{k}, %load], [{word}, %{self.end}]"

    def arrays(self) -> Iterator[str]:
        """Addresses and strides of columns and outputs."""
        for j, _ in self.columns:
            yield from _entry(f"column{j}", "ptr", "columns", j)
            yield from _entry(f"time{j}", "i64", "time", j)
        for j, _ in self.results:
            yield from _entry(f"output{j}", "ptr", "outputs", j)
            yield from _entry(f"out{j}", "i64", "out", j)

    # ---- operations that repeat their values

    def places(self) -> Iterator[str]:
        """Memory for the inputs and results of the operations that may repeat their values."""
        for j, group in enumerate(self.repeats):
            for k, x in enumerate((*group.inputs, *group.results)):
                yield f"  %stored{j}.{k} = alloca {self.write.type_of(x)}"

    def repeated(self) -> Iterator[str]:
        """Operations on a few inputs, which are skipped where those have the bits that they had before."""
        for j, group in enumerate(self.repeats):
            same = yield from self.same_inputs(j, group.inputs)
            yield f"  br i1 {same}, label %repeat{j}, label %compute{j}"
            yield f"compute{j}:"
            for node in group.nodes:
                yield from spell(self.write, node)
            for k, x in enumerate((*group.inputs, *group.results)):
                yield f"  store {self.write.type_of(x)} {self.write.word(x)}, ptr %stored{j}.{k}"
            yield f"  br label %repeat{j}"
            yield f"repeat{j}:"
            self.end = f"repeat{j}"
            for k, x in enumerate(group.results, start=len(group.inputs)):
                word = self.write.words[x.serial] = self.write.new()
                yield f"  {word} = load {self.write.type_of(x)}, ptr %stored{j}.{k}"

    def same_inputs(self, j: int, inputs: Sequence[Expression]) -> Generator[str, None, str]:
        """Name of the condition that a step before has stored these inputs, with the same bits in all lanes."""
        same = self.write.new()
        yield f"  {same} = icmp ne i64 %t, %first"
        for k, x in enumerate(inputs):
            whole = self.target.flag if x.boolean else self.target.integer
            before, now, equal, both = (self.write.new() for _ in range(4))
            yield f"  {before} = load {whole}, ptr %stored{j}.{k}"
            yield f"  {now} = bitcast {self.write.type_of(x)} {self.write.word(x)} to {whole}"
            yield f"  {equal} = icmp eq {whole} {before}, {now}"
            if self.target.width > 1:
                lanes, equal = equal, self.write.new()
                yield self.write.reduced(equal, lanes)
            yield f"  {both} = and i1 {same}, {equal}"
            same = both
        return same

    # ---- operations that are read only where a condition holds

    def guard(self, group: Guarded) -> Iterator[str]:
        """Operations that are skipped where no lane needs them; their results are 0 there."""
        before, needed, after = self.end, *(self.write.new()[1:] for _ in range(2))
        condition = self.write.word(group.condition)
        if self.target.width > 1:
            lanes, none, condition = condition, self.write.new(), self.write.new()
            yield self.write.line(none, "xor", self.target.flag, lanes, True)
            yield self.write.reduced(condition, none)
            needed, after = after, needed
        yield f"  br i1 {condition}, label %{needed}, label %{after}"
        if self.target.width > 1:
            needed, after = after, needed
        yield f"{needed}:"
        for node in group.nodes:
            yield from spell(self.write, node)
        yield f"  br label %{after}"
        yield f"{after}:"
        self.end = after
        for x in group.results:
            word, zero = self.write.new(), self.target.constant(False if x.boolean else 0.0)
            yield f"  {word} = phi {self.write.type_of(x)} [{self.write.word(x)}, %{needed}], [{zero}, %{before}]"
            self.write.words[x.serial] = word

    # ---- memory

    def load_state(self) -> Iterator[str]:
        """The state before the first step."""
        for k, symbol in enumerate(self.state):
            yield f"  %s{k}.by = mul i64 %row, {k}"
            yield f"  %s{k} = getelementptr i8, ptr %base, i64 %s{k}.by"
            yield from self.load(f"%before{k}", f"%s{k}", symbol.boolean, own=True)

    def store_state(self) -> Iterator[str]:
        """The state after the last step."""
        for k, symbol in enumerate(self.state):
            yield from self.store(f"%x{k}", f"%s{k}", symbol.boolean)

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


class _PackedLoop(_LogLoop):
    """The loop over one log with the members of the state in the lanes of vectors.

    packs: of the program.
    """

    def __init__(self, program: Program, state_size: int, target: Target, own: Sequence[bool], packs: Packs):
        self.packs = packs
        super().__init__(program, state_size, target, own)
        lanes = len(packs.places[0])
        self.wide = self.write.beside(1 << (lanes - 1).bit_length())
        self.vectors = {key_of(pack): f"%p{j}" for j, pack in enumerate(packs.inputs)}
        self.packed = {k for places in packs.places for k in places}

    def step(self) -> Iterator[str]:
        """One step: samples in, packs and single operations, outputs out."""
        alone = enumerate(self.state)
        self.write.words |= {symbol.serial: f"%x{k}" for k, symbol in alone if k not in self.packed}
        for j, symbol in self.columns:
            yield from self.load_sample(j, symbol)
        yield from self.single([x for group in self.repeats for x in group.inputs])
        yield from self.repeated()
        for vertex in self.packs.order or ():
            if isinstance(vertex, Expression):
                if vertex.serial not in self.write.words:
                    yield from self.single(vertex.args)
                    yield from spell(self.write, vertex)
            else:
                yield from self.operation(vertex)
        for y in [*(y for k, y in enumerate(self.after) if k not in self.packed), *(y for _, y in self.results)]:
            yield from self.single((y,))
        for pack in self.packs.results:
            yield from self.vector(pack)
        for j, y in self.results:
            yield from self.store_output(j, y)

    def packed_serials(self) -> Collection[int]:
        """Serials of the operations and inputs that are in lanes of a vector."""
        return self.packs.lane

    def single(self, values: Sequence[Any]) -> Iterator[str]:
        """Extract the scalars that were computed in lanes."""
        for x in values:
            if isinstance(x, Expression) and x.serial not in self.write.words:
                key, lane = self.packs.lane[x.serial]
                word = self.write.words[x.serial] = self.write.new()
                kind = self.wide.type_of(x)
                yield f"  {word} = extractelement {kind} {self.vectors[key]}, i64 {lane}"

    def operation(self, key: Key) -> Iterator[str]:
        """A pack of operations."""
        first, arguments = self.packs.operations[key][0], self.packs.arguments[key]
        spoken: list[Any] = []
        for x, argument in zip(first.args, arguments, strict=True):
            yield from self.argument(x, argument)
            spoken.append(
                x if isinstance(x, Expression | tuple) or is_one(argument) else self.vectors[key_of(argument)]
            )
        if first.operation.name == "gather" and key_of(arguments[0]) in self.packs.arguments:
            for x, argument in zip(first.args[0].args, self.packs.arguments[key_of(arguments[0])], strict=True):
                yield from self.argument(x, argument)  # an index that is rounded down is read before the rounding
        self.vectors[key] = self.wide.new()
        yield from SPELLINGS[first.operation.name](self.wide, self.vectors[key], tuple(spoken))

    def argument(self, first: Any, pack: Pack) -> Iterator[str]:
        """A pack under the name of its first lane; the table of a gather has no value of its own."""
        if isinstance(first, tuple):
            return
        yield from self.vector(pack)
        if isinstance(first, Expression):
            self.wide.words[first.serial] = self.vectors[key_of(pack)]

    def vector(self, pack: Pack) -> Iterator[str]:
        """A pack as one value: put together from scalars where it was not computed as one."""
        key = key_of(pack)
        if key in self.vectors:
            return
        first = pack[0]
        if is_one(pack) and not isinstance(first, Expression):
            self.vectors[key] = self.wide.word(first)
            return
        boolean = is_condition(first)
        kind = self.wide.target.flag if boolean else self.wide.target.number
        element = self.write.target.flag if boolean else self.write.target.number
        yield from self.single(pack)
        filled = "poison"
        for lane in range(self.wide.target.width):
            word = self.write.word(pack[lane] if lane < len(pack) else first)
            vector = self.wide.new()
            yield f"  {vector} = insertelement {kind} {filled}, {element} {word}, i64 {lane}"
            filled = vector
        self.vectors[key] = filled

    # ---- state

    def state_phis(self) -> Iterator[str]:
        """The state, from the step before or from memory, packs as vectors."""
        for k, (symbol, y) in enumerate(zip(self.state, self.after, strict=True)):
            if k not in self.packed:
                kind, word = self.write.type_of(symbol), self.write.word(y)
                yield f"  %x{k} = phi {kind} [%before{k}, %load], [{word}, %{self.end}]"
        for j, (before, after) in enumerate(zip(self.packs.inputs, self.packs.results, strict=True)):
            word = self.vectors[key_of(after)]
            yield f"  %p{j} = phi {self.wide.type_of(before[0])} [%packed{j}, %load], [{word}, %{self.end}]"

    def load_state(self) -> Iterator[str]:
        """The state before the first step."""
        yield from super().load_state()
        for j, (places, pack) in enumerate(zip(self.packs.places, self.packs.inputs, strict=True)):
            filled, width = "poison", self.wide.target.width
            element = self.write.type_of(pack[0])
            for lane in range(width):
                vector = f"%packed{j}" if lane == width - 1 else self.wide.new()
                word = f"%before{places[lane if lane < len(places) else 0]}"
                yield f"  {vector} = insertelement {self.wide.type_of(pack[0])} {filled}, {element} {word}, i64 {lane}"
                filled = vector

    def store_state(self) -> Iterator[str]:
        """The state after the last step."""
        for k, symbol in enumerate(self.state):
            if k not in self.packed:
                yield from self.store(f"%x{k}", f"%s{k}", symbol.boolean)
        for j, (places, pack) in enumerate(zip(self.packs.places, self.packs.inputs, strict=True)):
            for lane, k in enumerate(places):
                word = self.write.new()
                yield f"  {word} = extractelement {self.wide.type_of(pack[0])} %p{j}, i64 {lane}"
                yield from self.store(word, f"%s{k}", pack[0].boolean)


def _entry(name: str, kind: str, array: str, index: int) -> Iterator[str]:
    """Load one entry of an array of the caller."""
    yield f"  %{name}.at = getelementptr {kind}, ptr %{array}, i64 {index}"
    yield f"  %{name} = load {kind}, ptr %{name}.at"
