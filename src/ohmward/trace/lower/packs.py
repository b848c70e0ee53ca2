"""Matching operations on the members of a state, which one vector instruction can do together.

If a state holds a tuple of equal parts, such as the members of a bank of filters, its program does the same to each
part. Operations that match, lane by lane, are a pack; its arguments are packs too, and so on down to the inputs
(superword-level parallelism, Larsen and Amarasinghe 2000). Packs are found from each member's state after a step back
to the inputs, and from the inputs on to what all members contribute to an output. What does not match stays scalar:
lanes are assembled into a pack, and extracted from one, where necessary.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property
from typing import Any

from ohmward.trace.bounds import within
from ohmward.trace.expression import Expression, constant_key
from ohmward.trace.operations import INPUT
from ohmward.trace.program import Program
from ohmward.trace.structure import Branch, Structure, size

#: Largest number of rounds in which operations without counterparts are set apart.
_MOST_ROUNDS = 10
#: One value of each member: nodes, inputs or constants.
Pack = tuple[Any, ...]
#: Key of a pack, made of its values.
Key = tuple[Any, ...]


def members(structure: Structure) -> range | None:
    """Starts of the parts of the first tuple of equal parts, as range(first, end, size of a part); None without one."""
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
    forms: of operations and inputs, see `_Forms`.
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
        own = [pack for pack, result in zip(self.inputs, self.results, strict=True) if not is_one(result)]
        self.forms = _Forms(program, own)
        for pack in self.inputs:
            self._place(pack)
        self._find(self.results)
        self._find(self.forms.alike())

    def _find(self, waiting: Iterable[Pack]) -> None:
        """Add packs of operations, and those of their arguments."""
        waiting = list(waiting)
        while waiting:
            pack = waiting.pop()
            key = key_of(pack)
            if key in self.arguments or not self.is_like(pack):
                continue
            self.operations[key] = pack
            self.arguments[key] = self.forms.arguments_of(pack)
            self._place(pack)
            waiting += [a for a in self.arguments[key] if not is_one(a)]

    def is_like(self, pack: Pack) -> bool:
        """True for the same operation in every lane, of different nodes, with arguments that can be paired."""
        first = pack[0]
        if is_one(pack) or not all(isinstance(x, Expression) and x.operation is first.operation for x in pack):
            return False
        if first.operation is INPUT:
            return False
        arguments = self.forms.arguments_of(pack)
        keys = [key_of(a) for a in arguments]
        paired = {key[0]: key for key in reversed(keys)}
        if any(paired[key[0]] != key for key in keys):
            return False  # one scalar of the first lane would stand for two vectors
        return first.operation.name != "gather" or self.is_like_gather(*arguments)

    def is_like_gather(self, index: Pack, table: Pack) -> bool:
        """True for one table, with indices that are alike where they are rounded down and stay within it."""
        last = len(table[0]) - 1
        whole = {isinstance(i, Expression) and i.operation.name == "floor" and within(i, 0.0, last) for i in index}
        return is_one(table) and len(whole) == 1 and (self.is_like(index) or whole == {False})

    def _place(self, pack: Pack) -> None:
        key = key_of(pack)
        for lane, x in enumerate(pack):
            self.lane.setdefault(x.serial, (key, lane))

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
        """True for a pack in one register: of operations or of inputs, or one scalar for all lanes."""
        return (
            is_one(pack)
            or key_of(pack) in self.arguments
            or all(
                isinstance(x, Expression) and self.lane.get(x.serial) == (key_of(pack), k) for k, x in enumerate(pack)
            )
        )


def key_of(pack: Pack) -> Key:
    """Key of a pack: serials of its nodes, values of its constants."""
    return tuple([x.serial if isinstance(x, Expression) else ("constant", constant_key(x)) for x in pack])


def is_one(pack: Pack) -> bool:
    """True where all lanes are the same scalar."""
    return len(set(key_of(pack))) == 1


class _Forms:
    """Form of every operation: what it does to the inputs of a member, irrespective of the member.

    An operation on one member has a form made of its kind and the forms of its arguments; constants may differ between
    members. Operations on no member, or on several, are shared and have forms of their own; so do state values common
    to all members, and operations without a counterpart in each other member: a sum over members ends with the last.
    """

    def __init__(self, program: Program, inputs: Sequence[Pack]):
        self.program, self._inputs = program, inputs
        self._shared: set[int] = set()
        self._forget()
        for _ in range(_MOST_ROUNDS if inputs else 0):
            self._take_up_all()
            alone = self._alone()
            if not alone:
                break
            self._shared |= alone

    def _forget(self) -> None:
        self._numbers: dict[Any, int] = {}
        self._form: dict[int, int] = {}
        self._member: dict[int, int] = {}
        self._nodes: dict[int, dict[int, list[Expression]]] = {}

    def _take_up_all(self) -> None:
        self._forget()
        for k, pack in enumerate(self._inputs):
            for member, x in enumerate(pack):
                self._form[x.serial], self._member[x.serial] = self._number(("input", k)), member
        for node in self.program.nodes:
            members = {
                self._member[x.serial] for x in node.args if isinstance(x, Expression) and x.serial in self._member
            }
            if len(members) == 1 and node.serial not in self._shared:
                self._take_up(node, *members)

    def _take_up(self, node: Expression, member: int) -> None:
        forms = [self.of(x) for x in node.args]
        shape = (node.operation.name, *(sorted(forms) if node.operation.commutative else forms))
        form = self._form[node.serial] = self._number(shape)
        self._member[node.serial] = member
        self._nodes.setdefault(form, {}).setdefault(member, []).append(node)

    def _alone(self) -> set[int]:
        """Serials of operations without counterparts, except those that lack theirs only because of their arguments."""
        paired = {x.serial for nodes in self._complete() for of_one in nodes.values() for x in of_one}
        alone: set[int] = set()
        after: set[int] = set()
        for node in self.program.nodes:
            if any(isinstance(x, Expression) and x.serial in after for x in node.args):
                after.add(node.serial)
            elif node.serial in self._member and node.serial not in paired:
                alone.add(node.serial)
                after.add(node.serial)
        return alone

    def _complete(self) -> Iterator[dict[int, list[Expression]]]:
        """Operations of one form by member, where every member has the same number of them."""
        members = len(self._inputs[0]) if self._inputs else 0
        for nodes in self._nodes.values():
            if len(nodes) == members and len({len(of_one) for of_one in nodes.values()}) == 1:
                yield nodes

    def _number(self, shape: Any) -> int:
        return self._numbers.setdefault(shape, len(self._numbers))

    def of(self, x: Any) -> int:
        """Number of the form of a node or a constant."""
        if not isinstance(x, Expression):
            return self._number(("table", x) if isinstance(x, tuple) else "constant")
        return self._form[x.serial] if x.serial in self._form else self._number(("shared", x.serial))

    def alike(self) -> Iterator[Pack]:
        """Packs of operations of one form on all members; several are matched in the order of tracing."""
        for nodes in self._complete():
            yield from zip(*(nodes[member] for member in sorted(nodes)), strict=True)

    def arguments_of(self, pack: Pack) -> tuple[Pack, ...]:
        """Arguments of a pack of operations, those of commutative ones in the order in which they pair best."""
        first, *others = (x.args for x in pack)
        if pack[0].operation.commutative:
            others = [max((args, args[::-1]), key=lambda a: sum(map(self.likeness, first, a))) for args in others]
        return tuple(zip(first, *others, strict=True))

    def likeness(self, a: Any, b: Any) -> int:
        """3 for the same form, 1 for the same operation, else 0."""
        if self.of(a) == self.of(b):
            return 3
        return int(isinstance(a, Expression) and isinstance(b, Expression) and a.operation is b.operation)
