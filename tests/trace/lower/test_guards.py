"""Operations that are skipped where nothing reads them, against the same ones computed everywhere, bit by bit."""

from typing import Any, NamedTuple

import numpy as np
import pytest

from ohmward.trace import exp, sqrt, trace, where
from ohmward.trace.elementary import F64, expand
from ohmward.trace.lower import llvm_source
from ohmward.trace.lower.guards import Guarded, guarded
from ohmward.trace.lower.llvm_machine_code import vector_bits
from ohmward.trace.lower.llvm_run import MachineStep

pytest.importorskip("llvmlite")
RNG = np.random.default_rng(5)
WIDTH = vector_bits() // 64


class State(NamedTuple):
    low_s: Any
    soc: Any


class Sample(NamedTuple):
    dt_s: Any
    u: Any
    v: Any


def series(x: Any, terms: int) -> Any:
    """A sum of products, as long as is asked for."""
    found = x
    for k in range(terms):
        found = 0.3 * found * x + float(k) / (1.0 + found * found)
    return found


def step(state: State, sample: Sample) -> tuple:
    """Rare events, one inside another and one whose condition is long; sums of a product and of what follows."""
    shared = sqrt(1.0 + sample.u * sample.u)
    of_all = sample.v * shared + 1e-3 * state.low_s * state.soc  # what repeats with a few inputs is skipped anyway
    low = (sample.v < 0.0) & (state.low_s > 1.0) & (shared > 1.1)
    inner = (sample.u > 0.0) & (sample.u < 2.0) & (sample.v < -0.1) & (sample.v > -3.0) & (state.low_s < 50.0)
    rough = where(low, where(inner, series(of_all, 60), 0.1) + series(0.3 + of_all, 12) + exp(of_all), state.soc)
    soc = where(low, sample.u * sample.v + rough, rough)
    event = (sample.u > 0.0) & (state.low_s > 2.0) & (series(of_all - 0.5 * shared, 12) > 0.4)
    low_s = where(sample.v < 0.0, state.low_s + sample.dt_s, 0.0)
    return State(low_s, soc), (where(event, 1.0, 0.0), shared * sample.v + soc)


PROGRAM = trace(step, State(0.0, 0.0), Sample(0.0, 0.0, 0.0))
START = np.array([0.0, 0.5])


def scanned(lanes: int, precision: str) -> tuple[np.ndarray, np.ndarray]:
    """States (2, B) and outputs (2, T, B); in part of the log the conditions hold often, in part never."""
    rng = np.random.default_rng(7)
    u, v = rng.normal(size=(2, 400, lanes))
    v[:100], v[150:160] = np.abs(v[:100]), np.nan
    v[200:300] = -np.abs(v[200:300])
    machine = MachineStep(PROGRAM, len(START), precision)
    state, outputs = np.repeat(START[:, None], lanes, axis=1), np.empty((2, 400, lanes))
    if lanes > 1:
        machine.many(state, [np.full_like(u, 1.0), u, v], list(outputs), 1)
    else:
        one = state[:, 0].copy()
        machine.one(one, [np.full(400, 1.0), u[:, 0].copy(), v[:, 0].copy()], list(outputs[:, :, 0]), None)
        state[:, 0] = one
    return state, outputs


@pytest.mark.parametrize("precision", ["f64", "f32"])
@pytest.mark.parametrize("lanes", [1, WIDTH + 1])
def test_what_is_read_has_the_bits_of_what_is_computed_everywhere(lanes, precision, monkeypatch):
    skipping = scanned(lanes, precision)
    assert 0 < skipping[1][0].mean() < 1
    every = lambda program, apart=(): tuple(x for x in program.nodes if x.serial not in apart)  # noqa: E731
    monkeypatch.setattr(llvm_source, "guarded", every)
    for found, wanted in zip(skipping, scanned(lanes, precision), strict=True):
        np.testing.assert_array_equal(found, wanted)


def test_groups_hold_what_is_read_where_all_conditions_of_an_event_hold():
    program = expand(PROGRAM, F64)
    items = guarded(program)
    groups = [item for item in items if isinstance(item, Guarded)]
    singles = [item for item in items if not isinstance(item, Guarded)]
    assert sorted(x.serial for group in groups for x in group.nodes) == sorted(
        {x.serial for x in program.nodes} - {x.serial for x in singles}
    )
    assert len(groups) == 3
    assert any(x is group.condition for group in groups for other in groups for x in other.results)
    assert {group.condition.operation.name for group in groups} == {"logical_and"}
    skipped = sum(len(group.nodes) for group in groups)
    assert skipped > 0.7 * len(program.nodes)


def test_each_item_comes_after_what_it_reads():
    program = expand(PROGRAM, F64)
    known = {x.serial for x in program.inputs}
    for item in guarded(program):
        if isinstance(item, Guarded):
            assert item.condition.serial in known
        for node in item.nodes if isinstance(item, Guarded) else (item,):
            assert {x.serial for x in node.args if hasattr(x, "serial")} <= known
            known.add(node.serial)


def test_a_program_without_events_keeps_its_order():
    plain = trace(lambda x, y: where(x > 0.0, series(y, 20), 1.0), 0.0, 0.0)
    assert guarded(plain) == plain.nodes
