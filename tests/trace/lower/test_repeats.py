"""Operations that are skipped where their inputs repeat, against steps that are made one by one, bit by bit."""

from typing import Any, NamedTuple

import numpy as np
import pytest

from ohmward.trace import cos, exp, log, sin, tanh, trace, where
from ohmward.trace.elementary import F64, expand
from ohmward.trace.lower.llvm_machine_code import vector_bits
from ohmward.trace.lower.llvm_run import MachineStep
from ohmward.trace.lower.packs import Packs
from ohmward.trace.lower.repeats import repeats_of

pytest.importorskip("llvmlite")
RNG = np.random.default_rng(3)
WIDTH = vector_bits() // 64


class State(NamedTuple):
    members: tuple[tuple[Any], ...]
    warm_K: Any


class Sample(NamedTuple):
    dt_s: Any
    warm_K: Any
    cold: Any
    u: Any


def step(state: State, sample: Sample) -> tuple:
    """Factors of a held temperature and of the time step, of numbers and conditions, in a bank of two members."""
    warm_K = where(sample.warm_K == sample.warm_K, sample.warm_K, state.warm_K)
    factor = exp(0.1 * warm_K) + log(2.0 + sin(warm_K))
    decay = exp(-sample.dt_s * factor) + where(sample.cold, cos(sample.dt_s), tanh(sample.dt_s))
    far = decay > 0.5
    members = tuple((decay * x + where(far, factor, 0.3 * k) * sample.u,) for k, (x,) in enumerate(state.members))
    return State(members, warm_K), (members[0][0] + members[1][0], factor)


PROGRAM = trace(step, State(((0.0,), (0.0,)), 0.0), Sample(0.0, 0.0, False, 0.0))
START = np.array([0.3, 0.1, 5.0])


def a_log(steps: int, lanes: int) -> list[np.ndarray]:
    """Columns (T, B) of which all but the last often repeat; missing values, and zeros of both signs."""
    dt_s = np.repeat(RNG.choice([0.0, -0.0, 1.0, 0.1, np.inf], (steps // 4, lanes)), 4, axis=0)
    warm_K = np.repeat(RNG.choice([np.nan, 0.0, -0.0, 3.0, 30.0], (steps // 4, lanes)), 4, axis=0)
    cold = np.repeat(RNG.choice([0.0, 1.0], (steps // 10, lanes)), 10, axis=0)
    return [dt_s, warm_K, cold, RNG.normal(size=(steps, lanes))]


def scanned(columns: list[np.ndarray], at_a_time: int, precision: str) -> tuple[np.ndarray, np.ndarray]:
    """States (3, B) and outputs (2, T, B) of so many steps at a time; the first of them skips nothing."""
    machine = MachineStep(PROGRAM, len(START), precision)
    steps, lanes = columns[0].shape
    state, outputs = np.repeat(START[:, None], lanes, axis=1), np.empty((2, steps, lanes))
    for first in range(0, steps, at_a_time):
        part = slice(first, first + at_a_time)
        if lanes > 1:
            machine.many(state, [c[part] for c in columns], [o[part] for o in outputs], 1)
        else:
            one = state[:, 0].copy()
            machine.one(one, [c[part, 0] for c in columns], [o[part, 0] for o in outputs], None)
            state[:, 0] = one
    return state, outputs


@pytest.mark.parametrize("precision", ["f64", "f32"])
@pytest.mark.parametrize("lanes", [1, WIDTH + 1])
def test_skipped_operations_have_the_bits_of_those_computed_again(lanes, precision):
    columns = a_log(200, lanes)
    for found, wanted in zip(scanned(columns, 200, precision), scanned(columns, 1, precision), strict=True):
        np.testing.assert_array_equal(found, wanted)


def test_groups_hold_what_follows_from_a_few_inputs():
    program = expand(PROGRAM, F64)
    groups = repeats_of(program, Packs(program).lane)
    names = [{x.name.removeprefix("sample.") for x in group.inputs} for group in groups]
    assert {"state.warm_K", "warm_K"} in names
    made = {x.serial for group in groups for x in (*group.inputs, *group.results)}
    for group in groups:
        inside = {node.serial for node in group.nodes}
        taken = {x.serial for node in group.nodes for x in node.args if hasattr(x, "serial")}
        assert taken - inside <= made
    assert all(group.results for group in groups)


def test_a_product_that_is_summed_elsewhere_is_made_there():
    """The processor fuses it with the sum; a stored product would be rounded before."""

    def add(x: float, sample: Sample) -> tuple:
        factor = exp(sample.dt_s) + exp(exp(sample.dt_s))
        return x + factor * factor, x

    (group,) = repeats_of(expand(trace(add, 0.0, Sample(0.0, 0.0, False, 0.0)), F64))
    assert [node.operation.name for node in group.results] == ["add"]
