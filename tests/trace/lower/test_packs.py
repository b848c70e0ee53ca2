"""A bank of equal parts in the lanes of a vector against the same program without packs, bit by bit."""

from typing import Any, NamedTuple

import every_operation
import numpy as np
import pytest
from every_operation import Memory, Seen

from ohmward.trace import exp, maximum, table, trace, where
from ohmward.trace.elementary import F64, expand
from ohmward.trace.expression import Expression
from ohmward.trace.lower.llvm_run import MachineStep
from ohmward.trace.lower.packs import Packs, members
from ohmward.trace.structure import scalar_names

pytest.importorskip("llvmlite")
RNG = np.random.default_rng(7)


class Bank(NamedTuple):
    age: Any
    members: tuple[Memory, ...]
    best: Any


def step(state: Bank, sample: Seen) -> tuple:
    """Every operation in each member; shared values, a value from all members, and constants that differ by member."""
    shared = 0.5 * sample.w + state.age
    results = [every_operation.step(m, sample._replace(u=shared * sample.u)) for m in state.members]
    largest = results[0][0].level
    for after, _ in results[1:]:
        largest = maximum(largest, after.level)
    moved = tuple(
        after._replace(level=where(after.level < largest, after.level, 0.25 * k), held=after.held * (k + 1.0))
        for k, (after, _) in enumerate(results)
    )
    return Bank(state.age + 0.01, moved, largest), (*results[-1][1], largest)


def a_log(count):
    u, w = RNG.normal(0.0, 2.0, count), RNG.normal(0.0, 2.0, count)
    u[RNG.random(count) < 0.02] = np.nan
    w[RNG.random(count) < 0.02] = np.inf
    return [u, (RNG.random(count) < 0.5).astype(float), w]


def one_by_one(program, state, columns):
    """State (n,) and outputs (K, T) of one log: members in the lanes of a vector."""
    outputs = np.empty((len(program.outputs) - len(state), len(columns[0])))
    after = np.array(state, dtype=float)
    MachineStep(program, len(state), contract=False).one(after, columns, list(outputs), None)
    return after, outputs


def in_lanes(program, state, columns):
    """The same of one log among many: logs in the lanes of a vector, members one after the other."""
    outputs = [np.empty((len(columns[0]), 1)) for _ in program.outputs[len(state) :]]
    after = np.array(state, dtype=float)[:, None]
    MachineStep(program, len(state), contract=False).many(after, columns, outputs, 1)
    return after[:, 0], np.array(outputs)[:, :, 0]


def assert_same_bits(program, state, columns):
    for found, wanted in zip(one_by_one(program, state, columns), in_lanes(program, state, columns), strict=True):
        np.testing.assert_array_equal(found, wanted)


def bank_of(count):
    members = tuple(Memory(0.0, False, np.zeros(2)) for _ in range(count))
    return trace(step, Bank(0.0, members, 0.0), Seen(0.0, False, 0.0))


@pytest.mark.parametrize("count", [2, 3, 4, 5])
def test_a_bank_has_the_bits_of_its_members_one_after_the_other(count):
    program = bank_of(count)
    assert Packs(expand(program, F64)).operations
    start = [0.1, *(x for k in range(count) for x in (0.3 * k, k % 2, 0.1 + k, -0.2)), 0.0]
    assert_same_bits(program, start, a_log(300))


def test_members_are_found_in_the_state():
    program = bank_of(3)
    names = scalar_names(program.step_structure.state)
    starts = members(program.step_structure.state)
    assert starts is not None
    assert [names[k] for k in starts] == [f"members[{k}].level" for k in range(3)]
    one = trace(every_operation.step, Memory(0.0, False, np.zeros(2)), Seen(0.0, False, 0.0))
    assert members(one.step_structure.state) is None
    assert not Packs(one).places


def test_what_each_member_does_is_packed():
    """What all members share, most of `every_operation`, is done once anyway."""
    program = expand(bank_of(4), F64)
    packs = Packs(program)
    assert packs.order is not None
    assert len(packs.order) < 0.6 * len(program.nodes)


class Pair(NamedTuple):
    x: Any


def test_what_members_add_to_an_output_that_they_share_is_packed():
    """As the weights of a bank: they fade where all members agree, and are normalised by their sum."""

    def weigh(state: tuple, sample: Seen) -> tuple:
        members, fading = state
        logs = [exp(-m.x * m.x * sample.u) * m.x for m in members]
        total = logs[0] + logs[1] + logs[2]
        agree = (members[0].x > 0.0) & (members[1].x > 0.0) & (members[2].x > 0.0)
        after = tuple(Pair(where(agree, 0.9, fading) * m.x + log / total) for m, log in zip(members, logs, strict=True))
        return (after, 0.5 * fading), sum(m.x * log for m, log in zip(after, logs, strict=True))

    program = expand(trace(weigh, (tuple(Pair(0.0) for _ in range(3)), 0.0), Seen(0.0, False, 0.0)), F64)
    packs = Packs(program)
    assert packs.order is not None
    alone = [node.operation.name for node in packs.order if isinstance(node, Expression)]
    assert sorted(alone) == sorted(["add"] * 4 + ["logical_and"] * 2 + ["where", "multiply"])
    assert_same_bits(program, [0.5, 0.25, 0.75, 1.0], a_log(50))


def test_members_that_wait_for_each_other_stay_scalars():
    """The second member needs what the first has made: in one vector each would wait for the other."""

    def chain(state: tuple, sample: Seen) -> tuple:
        (a, b), level = state
        first = a.x * sample.u + 1.0
        second = b.x * first + 1.0
        return ((Pair(first), Pair(second)), level + second), second

    program = trace(chain, ((Pair(0.0), Pair(0.0)), 0.0), Seen(0.0, False, 0.0))
    assert Packs(program).order is None
    assert_same_bits(program, [0.5, 0.25, 0.0], a_log(50))


def test_members_read_a_table_whose_slopes_repeat():
    """The distinct slopes are a table of their own, found by a table of indices: a gather of a gather."""
    values = (0.25, 0.12, 0.06, 0.05, *(0.04,) * 7)

    def read(state: Bank, sample: Seen) -> tuple:
        moved = tuple(
            m._replace(level=0.5 * m.level + table(values, 0.0, 0.1, m.level + sample.u), held=0.9 * m.held + m.level)
            for m in state.members
        )
        return state._replace(members=moved), moved[0].level

    bank = Bank(0.0, tuple(Memory(0.0, False, np.zeros(2)) for _ in range(3)), 0.0)
    program = trace(read, bank, Seen(0.0, False, 0.0))
    assert Packs(expand(program, F64)).operations
    assert_same_bits(program, [0.1, *(x for k in range(3) for x in (0.3 * k, 0.0, 0.1, -0.2)), 0.0], a_log(100))
