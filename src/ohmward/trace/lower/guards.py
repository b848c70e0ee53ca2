"""Operations whose values are read only where a condition holds, and which are skipped elsewhere.

The state of charge at a cut-off is needed at the cut-off alone: `where(condition, x, y)` reads x, and `condition & x`
too, only where the condition holds. The same is true of the operations that only x takes.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterator, Sequence
from typing import Any, NamedTuple

from ohmward.trace.expression import Expression
from ohmward.trace.lower.repeats import FUSED
from ohmward.trace.program import Program, serials

#: Fewest operations that are worth a branch.
_FEWEST_GUARDED = 20

#: Serials of the nodes of an item of the order: one, or those of a group.
_Item = tuple[int, ...]


class Guarded(NamedTuple):
    """Operations that are needed only where a condition holds."""

    condition: Expression
    nodes: tuple[Expression, ...]  #: each after its arguments
    results: tuple[Expression, ...]  #: those of them that other operations take, and may find to be 0 elsewhere


def guarded(program: Program, apart: Collection[int] = ()) -> tuple[Expression | Guarded, ...]:
    """The operations of a program in an order in which those that can be skipped together are together.

    apart: serials of operations that are computed before, in another way.
    """
    return tuple(_Order(program, apart).written())


class _Order:
    """Items that are written one after the other: operations, and groups of them with the condition of each."""

    def __init__(self, program: Program, apart: Collection[int]):
        self.nodes = {node.serial: node for node in program.nodes if node.serial not in apart}
        self.takers = defaultdict[int, list[Expression]](list)
        self.read = {node.serial: _read(node) for node in program.nodes}
        for node in program.nodes:
            for serial in self.read[node.serial]:
                self.takers[serial].append(node)
        self.item: dict[int, _Item] = {serial: (serial,) for serial in self.nodes}
        self.condition: dict[_Item, Expression] = {}
        self.needed: dict[_Item, list[int]] = {}
        for condition, members in self.candidates(program):
            alone = {serial for serial in members if len(self.item[serial]) == 1}
            if len(alone) >= _FEWEST_GUARDED and len(group := self.together(alone)) >= _FEWEST_GUARDED:
                self.item |= dict.fromkeys(group, group)
                self.condition[group] = condition
                self.needed = {}

    def candidates(self, program: Program) -> Iterator[tuple[Expression, list[int]]]:
        """Conditions and the operations that each guards, first those that save most.

        The more conditions must hold together, the more seldom they do; a single one may hold all the time.
        """
        guards = _guards(program, self.takers)
        members = defaultdict[int, list[int]](list)
        for serial in self.nodes:
            for guard in guards[serial]:
                members[guard].append(serial)
        several = [
            x
            for x in program.nodes
            if x.operation.name == "logical_and" and len(members.get(x.serial, ())) >= _FEWEST_GUARDED
        ]
        several.sort(key=lambda x: len(members[x.serial]) * len(set(_implied(x))), reverse=True)
        yield from ((x, members[x.serial]) for x in several)

    def together(self, members: set[int]) -> _Item:
        """Those of the members that need nothing which needs one of them."""
        found: dict[int, None] = {}
        after: set[int] = set()  # nodes that need one of those found, but are none
        for item in self.order():
            if any(serial in after or (serial in found and item[0] not in members) for serial in self.needs(item)):
                after.update(item)
            elif item[0] in members:
                found[item[0]] = None
        for serial in reversed(list(found)):
            if self.is_fused(serial) and self.takers[serial][0].serial not in found:
                del found[serial]
        return tuple(found)

    def is_fused(self, serial: int) -> bool:
        """True where the processor may fuse an operation with the one that alone takes it, if written beside it."""
        return self.nodes[serial].operation.name in FUSED and len(self.takers[serial]) == 1

    def needs(self, item: _Item) -> list[int]:
        """Serials of what an item reads, its condition included; a fused argument last, after what that one reads."""
        if item in self.needed:
            return self.needed[item]
        read = [serial for member in item for serial in self.read[member]]
        read += [self.condition[item].serial] if item in self.condition else []
        read = [serial for serial in read if self.item.get(serial, item) is not item]
        fused = [serial for serial in read if self.item[serial] == (serial,) and self.is_fused(serial)]
        before = [need for serial in fused for need in self.needs((serial,))]
        self.needed[item] = [*before, *(serial for serial in read if serial not in fused), *fused]
        return self.needed[item]

    def order(self) -> Iterator[_Item]:
        """The items, each after what it needs, and fused ones directly before what they are fused with."""
        done: set[int] = set()
        for serial in self.nodes:
            waiting = [] if self.item[serial] == (serial,) and self.is_fused(serial) else [self.item[serial]]
            while waiting:
                item = waiting[-1]
                need = next((need for need in self.needs(item) if need not in done), None)
                if item[0] not in done and need is not None:
                    waiting.append(self.item[need])
                    continue
                waiting.pop()
                if item[0] not in done:
                    done.update(item)
                    yield item

    def written(self) -> Iterator[Expression | Guarded]:
        """The items as operations and groups."""
        if not self.condition:
            yield from self.nodes.values()
        conditions = {x.serial for x in self.condition.values()}
        for item in self.order() if self.condition else ():
            nodes = tuple(self.nodes[serial] for serial in item)
            if item not in self.condition:
                yield from nodes
                continue
            results = [x for x in nodes if x.serial in conditions or not serials(self.takers[x.serial]) <= {*item}]
            yield Guarded(self.condition[item], nodes, tuple(results))


def _guards(program: Program, takers: dict[int, list[Expression]]) -> dict[int, frozenset[int]]:
    """Serials of the conditions that all hold wherever an operation is needed, by its serial."""
    cones = _cones(program)
    always = serials(program.outputs)
    guards: dict[int, frozenset[int]] = {}
    for node in reversed(program.nodes):
        each = [guards[taker.serial].union(_where_read(taker, node, cones)) for taker in takers[node.serial]]
        guards[node.serial] = frozenset.intersection(*each) if each and node.serial not in always else frozenset()
    return guards


def _cones(program: Program) -> dict[int, int]:
    """For each value the operations and inputs that it is made from, itself included, as the bits of a number."""
    cones: dict[int, int] = {}
    for k, node in enumerate((*program.inputs, *program.nodes)):
        cones[node.serial] = 1 << k
        for serial in serials(node.args):
            cones[node.serial] |= cones[serial]
    return cones


def _where_read(taker: Expression, node: Expression, cones: dict[int, int]) -> Iterator[int]:
    """Serials of the conditions without which an operation does not read this argument.

    Of two conditions that must both hold, the one with fewer operations is looked at first.
    """
    name, (first, *others) = taker.operation.name, taker.args
    read_once = sum(x is node for x in taker.args) == 1
    if name == "where" and read_once and node is others[0] and isinstance(first, Expression):
        yield from _implied(first)
    if name == "logical_and" and read_once:
        other = others[0] if node is first else first
        if isinstance(other, Expression):
            before, own = cones[other.serial], cones[node.serial]
            if before.bit_count() < own.bit_count():
                yield from _implied(other)


def _implied(condition: Expression) -> Iterator[int]:
    """Serials of the conditions that hold wherever this one does."""
    yield condition.serial
    if condition.operation.name == "logical_and":
        for x in condition.args:
            yield from _implied(x) if isinstance(x, Expression) else ()


def _read(node: Expression) -> Sequence[int]:
    """Serials of what the code of an operation reads: of an index that is rounded down also what it is made from."""
    args: list[Any] = list(node.args)
    if node.operation.name == "gather" and isinstance(args[0], Expression):
        args += args[0].args
    return [x.serial for x in args if isinstance(x, Expression)]
