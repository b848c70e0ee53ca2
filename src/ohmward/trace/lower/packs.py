"""Like operations of the members of a state, found so that one vector instruction can do all of them.

A state that holds a tuple of equal parts, as the members of a bank of filters, has a program that does the same to each
part. Operations that match, lane by lane, are a pack; it takes packs as arguments, and so on down to the inputs
(superword-level parallelism, Larsen and Amarasinghe 2000). What does not match stays scalar: lanes are put together for
a pack, and taken out of one, where it must be.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import Any

from ohmward.trace.bounds import within
from ohmward.trace.expression import Expression, constant_key
from ohmward.trace.operations import INPUT
from ohmward.trace.program import Program
from ohmward.trace.structure import Branch, Structure, size

#: One value of each member: nodes, inputs or constants.
Pack = tuple[Any, ...]
#: A pack by its values.
Key = tuple[Any, ...]


def members(structure: Structure) -> range | None:
    """Places of the scalars of the first tuple of equal parts, as range(first, end, size of a part); None without."""
    first = 0
    for child in structure.children if isinstance(structure, Branch) else ():
        if isinstance(child, Branch) and is_bank(child):
            return range(first, first + size(child), size(child.children[0]))
        first += size(child)
    return None


def is_bank(structure: Branch) -> bool:
    """True for a plain tuple of two or more equal records."""
    return (
        structure.type is tuple
        and len(structure.children) > 1
        and isinstance(structure.children[0], Branch)
        and all(child == structure.children[0] for child in structure.children)
    )


class Packs:
    """The packs of a program.

    places: indices of the packed scalars among those of the state.
    inputs, results: the packed scalars before and after a step.
    operations, arguments: nodes of each pack of operations and the packs of their arguments, by its key.
    lane: pack and lane in which an operation or input is computed, by serial.
    """

    def __init__(self, program: Program):
        state = program.step_structure.state
        starts = members(state)
        each = range(starts.step) if starts else range(0)
        self.program = program
        self.places = [tuple(s + k for s in starts or ()) for k in each]
        self.inputs = [tuple(program.inputs[i] for i in places) for places in self.places]
        self.results = [tuple(program.outputs[i] for i in places) for places in self.places]
        self.operations: dict[Key, Pack] = {}
        self.arguments: dict[Key, tuple[Pack, ...]] = {}
        self.lane: dict[int, tuple[Key, int]] = {}
        for pack in self.inputs:
            self._place(pack)
        self._find()

    def _find(self) -> None:
        """All packs of operations that the results need."""
        waiting = list(self.results)
        while waiting:
            pack = waiting.pop()
            if key_of(pack) in self.arguments or not is_like(pack):
                continue
            self.operations[key_of(pack)] = pack
            self.arguments[key_of(pack)] = arguments_of(pack)
            self._place(pack)
            waiting += [a for a in self.arguments[key_of(pack)] if not is_one(a)]

    def _place(self, pack: Pack) -> None:
        for lane, x in enumerate(pack):
            self.lane.setdefault(x.serial, (key_of(pack), lane))

    @cached_property
    def order(self) -> tuple[Any, ...] | None:
        """Nodes and keys of packs, each after what it needs; None where packs would wait for each other."""
        done: set[Any] = set()
        open_: set[Any] = set()
        found: list[Any] = []
        roots = [*(self._source(y) for y in self.program.outputs)]
        stack = [(root, False) for root in reversed(roots) if root is not None]
        while stack:
            vertex, ready = stack.pop()
            if ready:
                found.append(vertex)
                done.add(vertex)
                open_.discard(vertex)
            elif vertex in open_:
                return None
            elif vertex not in done:
                open_.add(vertex)
                stack.append((vertex, True))
                stack.extend((need, False) for need in self._needs(vertex) if need not in done)
        return tuple(found)

    def _needs(self, vertex: Any) -> Iterator[Any]:
        """Vertices that a vertex takes its arguments from."""
        if isinstance(vertex, Expression):
            values = list(vertex.args)
        else:
            packs = self.arguments[vertex]
            values = [x for pack in packs for x in (pack[:1] if self.is_vector(pack) else pack)]
        yield from (source for x in values if (source := self._source(x)) is not None)

    def _source(self, x: Any) -> Any:
        """The vertex that computes a scalar; None for constants and inputs."""
        if not isinstance(x, Expression) or x.operation is INPUT:
            return None
        return self.lane[x.serial][0] if x.serial in self.lane else x

    def is_vector(self, pack: Pack) -> bool:
        """True for what is one value in a register: a pack of operations or inputs, or one scalar for all lanes."""
        return (
            is_one(pack)
            or key_of(pack) in self.arguments
            or all(
                isinstance(x, Expression) and self.lane.get(x.serial) == (key_of(pack), k) for k, x in enumerate(pack)
            )
        )


def key_of(pack: Pack) -> Key:
    """Key of a pack: serials of its nodes, values of its constants."""
    return tuple(x.serial if isinstance(x, Expression) else ("constant", constant_key(x)) for x in pack)


def is_one(pack: Pack) -> bool:
    """True where all lanes are the same scalar."""
    return len(set(key_of(pack))) == 1


def is_like(pack: Pack) -> bool:
    """True for the same operation in every lane, of different nodes, with arguments that can be paired."""
    first = pack[0]
    if is_one(pack) or not all(isinstance(x, Expression) and x.operation is first.operation for x in pack):
        return False
    if first.operation is INPUT:
        return False
    arguments = arguments_of(pack)
    paired = {key_of(a)[0]: key_of(a) for a in reversed(arguments)}
    if any(paired[key_of(a)[0]] != key_of(a) for a in arguments):
        return False  # one scalar of the first lane would stand for two vectors
    return first.operation.name != "gather" or is_like_gather(*arguments)


def is_like_gather(index: Pack, table: Pack) -> bool:
    """True for one table, with indices that are alike where they are rounded down and stay within it."""
    last = len(table[0]) - 1
    whole = {isinstance(i, Expression) and i.operation.name == "floor" and within(i, 0.0, last) for i in index}
    return is_one(table) and len(whole) == 1 and (is_like(index) or whole == {False})


def arguments_of(pack: Pack) -> tuple[Pack, ...]:
    """Arguments of a pack of operations, those of commutative ones in the order in which they pair best."""
    first, *others = (x.args for x in pack)
    ordered = [first]
    for args in others:
        turned = args[::-1] if pack[0].operation.commutative else args
        ordered.append(max((args, turned), key=lambda a: sum(map(likeness, first, a))))
    return tuple(zip(*ordered, strict=True))


def likeness(a: Any, b: Any) -> int:
    """2 for the same scalar, 1 for the same operation, else 0."""
    if a is b or (not isinstance(a, Expression) and not isinstance(b, Expression) and a == b):
        return 2
    return int(isinstance(a, Expression) and isinstance(b, Expression) and a.operation is b.operation)
