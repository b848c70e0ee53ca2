"""Operations that give the values of the step before wherever a few inputs repeat theirs.

The temperature of a battery and the interval of its samples seldom change, so the factors and decays that follow from
them need not be computed at every sample.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection
from typing import NamedTuple

from ohmward.trace.expression import Expression
from ohmward.trace.program import Program, serials

#: Most inputs of such operations, and the fewest operations that are worth a comparison of them with those before.
_MOST_INPUTS, _LEAST_GROUP = 3, 50
#: Stands for the inputs of an operation that is computed in another way: too many.
_MANY = frozenset(range(-_MOST_INPUTS - 1, 0))
#: Operations that the processor fuses with the sum that alone takes their result; a stored result it would round.
FUSED = {"multiply", "negative"}


class Repeats(NamedTuple):
    """Operations on a few inputs."""

    inputs: tuple[Expression, ...]
    nodes: tuple[Expression, ...]  #: the operations, each after its arguments
    results: tuple[Expression, ...]  #: those of them that other operations, or outputs, take


def repeats_of(program: Program, apart: Collection[int] = ()) -> tuple[Repeats, ...]:
    """Groups of operations on one, two or three inputs of a program; a later one may take results of earlier ones.

    apart: serials of operations that are computed in another way.
    """
    needed = _needed(program, apart)
    takers = _takers(program)
    waiting = [node for node in program.nodes if node.serial not in apart]
    groups = []
    for count in range(1, _MOST_INPUTS + 1):
        number = Counter(needed[node.serial] for node in waiting)
        for inputs in sorted((each for each in number if len(each) == count), key=lambda each: -number[each]):
            nodes = [node for node in waiting if needed[node.serial] <= inputs]
            if len(nodes) < _LEAST_GROUP:
                continue
            taken = {node.serial for node in nodes}
            for node in reversed(nodes):
                alone = len(takers[node.serial]) == 1 and takers[node.serial].isdisjoint(taken)
                if alone and node.operation.name in FUSED:
                    taken.remove(node.serial)
            nodes = [node for node in nodes if node.serial in taken]
            results = [node for node in nodes if not takers[node.serial] <= taken]
            groups.append(Repeats(tuple(x for x in program.inputs if x.serial in inputs), tuple(nodes), tuple(results)))
            waiting = [node for node in waiting if node.serial not in taken]
    return tuple(groups)


def _needed(program: Program, apart: Collection[int]) -> dict[int, frozenset[int]]:
    """Serials of the inputs on which each input and operation depends, by its serial."""
    needed = {x.serial: frozenset((x.serial,)) for x in program.inputs}
    for node in program.nodes:
        inputs = frozenset[int]().union(*(needed[serial] for serial in serials(node.args)))
        needed[node.serial] = _MANY if node.serial in apart else inputs
    return needed


def _takers(program: Program) -> dict[int, set[int]]:
    """Serials of the operations that take each value, by its serial; -1 for an output."""
    takers: dict[int, set[int]] = {serial: {-1} for serial in serials(program.outputs)}
    for node in program.nodes:
        for serial in serials(node.args):
            takers.setdefault(serial, set()).add(node.serial)
    return takers
