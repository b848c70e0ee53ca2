"""Kernels: one call, one log, many logs; what they take and what they refuse."""

import os
import pickle
import subprocess
import sys
import tracemalloc
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.trace import Kernel, isfinite, scan, where
from ohmward.trace import kernel as kernel_module
from ohmward.trace.lower import code_cache, lanes, llvm_run
from ohmward.trace.lower import llvm_machine_code as machine_code


class Tank(NamedTuple):
    level: Any
    flows: Any
    full: Any


class Sample(NamedTuple):
    inflow: Any
    dt_s: Any


def fill(tank: Tank, sample: Sample):
    """A leaky tank with two delayed flows: passes states on, swaps them, and has a condition as a state."""
    rate = (sample.inflow + tank.flows.sum() - tank.level / 7.0) * sample.dt_s
    level = where(tank.full, tank.level * 0.5, tank.level + rate)
    flows = np.array([tank.flows[1], sample.inflow])
    return Tank(level, flows, level > 3.0), (level, np.outer(flows, flows), tank.full, 2.5)


START = Tank(1.0, np.array([0.1, -0.2]), False)
STEPS, LANES = 40, 6
INFLOW = np.random.default_rng(0).normal(0.4, 1.0, (STEPS, LANES))
DT = np.random.default_rng(1).uniform(0.5, 1.5, STEPS)


@pytest.fixture(scope="module")
def kernel():
    return Kernel(fill, START, Sample(0.0, 1.0))


def loop(step, state, samples):
    """The reference: a loop with floats."""
    rows = []
    for sample in samples:
        state, output = step(state, sample)
        rows.append(output)
    return state, tuple(np.array(column) for column in zip(*rows, strict=True))


def with_floats(lane):
    return loop(fill, START, [Sample(*row) for row in zip(INFLOW[:, lane], DT, strict=True)])


def assert_equal(found, expected):
    for a, b in zip(found, expected, strict=True):
        np.testing.assert_array_equal(a, b)


# ---- one call


def test_a_call_returns_the_structure_of_the_function_with_plain_numbers(kernel):
    state, output = kernel(START, Sample(0.3, 1.0))
    expected_state, expected = fill(START, Sample(0.3, 1.0))
    assert type(state) is Tank
    assert type(state.level) is float
    assert state.full is False
    assert state.flows.dtype == float
    assert_equal(state, expected_state)
    assert_equal(output, expected)


def test_a_call_takes_whatever_numpy_takes_as_numbers(kernel):
    plain = kernel(START, Sample(2.0, 1.0))[0]
    loose = kernel((np.float32(1.0), [0.1, -0.2], 0), (np.int64(2), np.array(1.0)))[0]
    assert_equal(loose, plain)


def test_constants_are_handed_over_untouched():
    assert Kernel(lambda x, factor, names: x * factor[names[0]], 0.0, constants=({"a": 3.0}, ["a"]))(2.0) == 6.0


def test_results_without_operations_are_fine():
    assert Kernel(lambda x: (x, 1.0, True, ()), 0.0)(2.0) == (2.0, 1.0, True, ())


def test_empty_and_matrix_arguments():
    kernel = Kernel(lambda a, b: (a, b.T), np.zeros(0), np.zeros((2, 1, 3)))
    a, b = kernel([], np.arange(6.0).reshape(2, 1, 3))
    assert a.shape == (0,)
    np.testing.assert_array_equal(b, np.arange(6.0).reshape(2, 1, 3).T)


def test_argument_names_that_are_words_of_the_generated_code_do_no_harm():
    def awkward(_1, t0, exp, _0, array, step, table0, lambda_):
        return (_1 - t0) * np.exp(exp) + _0 / array - step * table0 + lambda_[0] * lambda_[1]

    values = (1.5, 0.25, 0.1, 2.0, 4.0, 3.0, 5.0, (7.0, 11.0))
    assert Kernel(awkward, *values)(*values) == pytest.approx(awkward(*values), rel=1e-15)


@pytest.mark.parametrize(
    "arguments, words",
    [
        ((START,), "arguments must be a tuple of 2"),
        ((START, (1.0,)), r"sample must be a Sample of 2, got \(1.0,\)"),
        ((START._replace(flows=np.zeros(3)), Sample(1.0, 1.0)), r"tank.flows must have the shape \(2,\)"),
        ((START._replace(flows=1.0), Sample(1.0, 1.0)), r"tank.flows must have the shape \(2,\).*got \(\)"),
        ((START, Sample("fast", 1.0)), "sample.inflow must hold numbers, got 'fast'"),
        ((START, Sample(None, 1.0)), "sample.inflow must hold numbers, got None"),
    ],
)
def test_a_call_that_does_not_fit_is_refused(kernel, arguments, words):
    with pytest.raises(InputError, match=words):
        kernel(*arguments)


@pytest.mark.parametrize(
    "example, words",
    [
        ("text", "x must be a number, an array of numbers, .* got str; .*constants="),
        ({"a": 1.0}, "x must be a number.*got dict"),
        ((1.0, None), r"x\[1\] must be a number.*got NoneType"),
        (START._replace(full=1j), "x.full must be a number.*got complex"),
    ],
)
def test_examples_that_are_no_numbers_are_refused(example, words):
    with pytest.raises(InputError, match=words):
        Kernel(lambda x: x, example)


def test_results_that_are_no_numbers_are_refused():
    with pytest.raises(InputError, match=r"result\[1\] must be a number.*got list"):
        Kernel(lambda x: (x, [x]), 0.0)


# ---- one log


def test_a_scan_is_the_loop_with_floats_to_the_last_bit(kernel):
    for lane in range(LANES):
        state, outputs = kernel.scan(START, Sample(INFLOW[:, lane], DT))
        expected_state, expected = with_floats(lane)
        assert_equal(state, expected_state)
        assert_equal(outputs, expected)
        assert outputs[2].dtype == bool
        assert type(state.full) is bool


def test_a_scan_in_two_parts_is_one_scan(kernel):
    whole = kernel.scan(START, Sample(INFLOW[:, 0], DT))
    middle, first = kernel.scan(START, Sample(INFLOW[:17, 0], DT[:17]))
    end, second = kernel.scan(middle, Sample(INFLOW[17:, 0], DT[17:]))
    assert_equal(end, whole[0])
    assert_equal(map(np.concatenate, zip(first, second, strict=True)), whole[1])


def test_a_sample_leaf_without_time_holds_for_all_times(kernel):
    constant = kernel.scan(START, Sample(INFLOW[:, 0], 0.5))
    spelled = kernel.scan(START, Sample(INFLOW[:, 0], np.full(STEPS, 0.5)))
    assert_equal(constant[1], spelled[1])


def test_an_empty_log_leaves_the_state(kernel):
    state, outputs = kernel.scan(START, Sample(np.zeros(0), np.zeros(0)))
    assert_equal(state, START)
    assert [o.shape for o in outputs] == [(0,), (0, 2, 2), (0,), (0,)]


def test_chunks_are_reported_and_do_not_show(kernel, monkeypatch):
    expected = kernel.scan(START, Sample(INFLOW[:, 0], DT))
    monkeypatch.setattr(scan, "_CHUNK_SCALARS", 99)
    reports = []
    found = kernel.scan(START, Sample(INFLOW[:, 0], DT), progress=lambda done, total: reports.append((done, total)))
    assert_equal(found[0], expected[0])
    assert_equal(found[1], expected[1])
    assert reports[-1] == (STEPS, STEPS)
    assert len(reports) > 2


@pytest.mark.parametrize("lowering", ("python", "machine"))
def test_outputs_of_the_end_are_the_last_of_the_whole_log(lowering, monkeypatch):
    kernel = Kernel(fill, START, Sample(0.0, 1.0), lowering=lowering)
    samples = Sample(INFLOW[:, 0], DT)
    end, (level, flows, full, constant) = kernel.scan(START, samples)
    monkeypatch.setattr(scan, "_CHUNK_SCALARS", 99)
    found_end, found = kernel.scan(START, samples, at_end=("[1]", "[2]", "[3]"))
    assert_equal(found_end, end)
    assert_equal(found, (level, flows[-1:], full[-1:], constant[-1:]))
    assert found[2].dtype == bool
    into = tuple(np.full((2 * len(column), *column.shape[1:]), np.nan)[::2] for column in found)
    kernel.scan(START, samples, at_end=("[1]", "[2]", "[3]"), into=into)
    assert_equal(into, tuple(column.astype(float) for column in found))
    nothing = kernel.scan(START, Sample(np.zeros(0), np.zeros(0)), at_end=("[1]",))
    assert [o.shape for o in nothing[1]] == [(0,), (0, 2, 2), (0,), (0,)]


def test_python_exceptions_become_infinities_and_nan_for_their_step_only():
    def step(s, x):
        return s + where(isfinite(x), x, 0.0), (1.0 / x, np.sqrt(x), np.log(x), np.exp(x), s)

    x = np.array([1.0, 0.0, -4.0, 1e4, np.nan, np.inf, 2.0])
    state, outputs = Kernel(step, 0.0, 0.0).scan(0.5, x)
    assert state == 0.5 + x[np.isfinite(x)].sum()
    with np.errstate(all="ignore"):
        expected = (1.0 / x, np.sqrt(x), np.log(x), np.exp(x))
    for found, wanted in zip(outputs[:4], expected, strict=True):
        np.testing.assert_allclose(found, wanted, rtol=1e-15)


def test_memory_stays_flat_over_a_long_log():
    kernel = Kernel(lambda s, x: (0.9 * s + x, s), 0.0, 0.0)
    u = np.zeros(1_000_000)
    tracemalloc.start()
    kernel.scan(0.0, u)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < u.nbytes + 25e6


# ---- many logs


@pytest.mark.parametrize("block", [1, 4, 4096])
def test_every_lane_is_its_own_scan(kernel, monkeypatch, block):
    monkeypatch.setattr(lanes, "BLOCK_LANES", block)
    state, outputs = kernel.scan_lanes(START, Sample(INFLOW, DT))
    assert [o.shape for o in outputs] == [(STEPS, LANES), (STEPS, 2, 2, LANES), (STEPS, LANES), (STEPS, LANES)]
    for lane in range(LANES):
        expected_state, expected = with_floats(lane)
        assert_equal((x[..., lane] for x in state), expected_state)
        assert_equal((o[..., lane] for o in outputs), expected)


def test_states_may_differ_by_lane(kernel):
    levels = np.linspace(0.0, 3.0, LANES)
    start = Tank(levels, np.tile(START.flows[:, None], LANES), np.zeros(LANES, bool))
    state, _ = kernel.scan_lanes(start, Sample(INFLOW[:, 0], DT))
    for lane, level in enumerate(levels):
        expected, _ = kernel.scan(START._replace(level=level), Sample(INFLOW[:, 0], DT))
        assert_equal((x[..., lane] for x in state), expected)


def test_lanes_go_on_from_the_state_that_they_returned(kernel):
    whole = kernel.scan_lanes(START, Sample(INFLOW, DT))
    middle, _ = kernel.scan_lanes(START, Sample(INFLOW[:17], DT[:17]))
    end, _ = kernel.scan_lanes(middle, Sample(INFLOW[17:], DT[17:]))
    assert_equal(end, whole[0])


def test_inputs_are_not_modified(kernel):
    start = Tank(np.full(LANES, 1.0), np.zeros((2, LANES)), np.zeros(LANES, bool))
    before = pickle.dumps((start, INFLOW, DT))
    kernel.scan_lanes(start, Sample(INFLOW, DT))
    kernel.scan(START, Sample(INFLOW[:, 0], DT))
    assert pickle.dumps((start, INFLOW, DT)) == before


@pytest.mark.parametrize(
    "samples, words",
    [
        (Sample(INFLOW, DT[:-1]), r"one common length along time, got \[39, 40\]"),
        (Sample(0.0, 1.0), "one common length along time, got none"),
        (Sample(np.zeros((STEPS, 2, 3)), DT), r"samples.inflow must have the shape"),
        ((DT,), "samples must be a Sample of 2"),
    ],
)
def test_samples_that_do_not_fit_are_refused(kernel, samples, words):
    with pytest.raises(InputError, match=words):
        kernel.scan(START, samples)
    with pytest.raises(InputError, match=words if "inflow" not in words else "."):
        kernel.scan_lanes(START, samples)


def test_lanes_need_a_lane_axis_of_one_length(kernel):
    with pytest.raises(InputError, match="one common number of lanes, got none"):
        kernel.scan_lanes(START, Sample(DT, DT))
    with pytest.raises(InputError, match=r"one common number of lanes, got \[5, 6\]"):
        kernel.scan_lanes(START._replace(level=np.zeros(5)), Sample(INFLOW, DT))


# ---- steps


@pytest.mark.parametrize(
    "step, words",
    [
        (lambda s, x: s + x, r"needs step\(state, sample\) -> \(state, output\)"),
        (lambda s, x: (np.array([s, x]), x), r"turns state from a number into an array \(2,\) of numbers"),
        (lambda s, x: (s > 0, x), "turns state from a number into a condition"),
        (lambda s, x: ((s, s), x), "turns state from|another structure|structure of the one"),
    ],
)
def test_functions_that_are_no_steps_can_be_called_but_not_scanned(step, words):
    kernel = Kernel(step, 0.0, 0.0)
    kernel(1.0, 2.0)
    with pytest.raises(InputError, match=words):
        kernel.scan(0.0, np.zeros(3))


# ---- to look at


def test_sources_can_be_read_and_explained(kernel):
    assert "def step(tank_level, tank_flows_0, tank_flows_1, tank_full, sample_inflow, sample_dt_s):" in kernel.source()
    assert "for k in range(steps):" in kernel.source("numpy")
    assert "define void @" in kernel.source("llvm")
    assert "fill: " in kernel.explain()
    with pytest.raises(InputError, match='"python", "numpy" or "llvm", got \'c\''):
        kernel.source("c")


@pytest.mark.parametrize(
    ("lowering", "live"), [("python", "PythonLive"), ("machine", "MachineLive"), ("auto", "PromptLive")]
)
def test_an_explanation_names_what_runs(lowering, live):
    kernel = Kernel(lambda state, x: (state + x, state), 0.0, 0.0, lowering=lowering)
    assert type(kernel.live(0.0)).__name__ == live
    assert ("Live samples and logs: Python" in kernel.explain()) == (lowering == "python")


def scaled(x, factor):
    return x * factor


def test_kernels_travel_between_processes():
    kernel = pickle.loads(pickle.dumps(Kernel(partial(scaled, factor=3.0), 0.0)))
    assert kernel(2.0) == 6.0


def test_a_few_long_lanes_are_worth_machine_code_too():
    kernel = Kernel(lambda state, x: (state + x, state), 0.0, 0.0, lowering="auto")
    kernel.scan_lanes(0.0, np.zeros((9_999, 2)))
    assert "machine" not in vars(kernel)
    kernel.scan_lanes(0.0, np.zeros((10_000, 2)))
    assert "machine" in vars(kernel)


def without(monkeypatch, reason):
    """LLVM as it is where llvmlite is missing or the processor unknown."""

    def refused(*_args):
        raise machine_code.NoMachineCodeError(reason)

    monkeypatch.setattr(machine_code, "llvm", refused)
    monkeypatch.setattr(llvm_run, "compile_scan", refused)
    code_cache.warn_once.cache_clear()


@pytest.mark.parametrize(
    "reason",
    ["machine code needs llvmlite, which is not installed: pip install llvmlite", "cannot compile for this processor"],
)
def test_without_machine_code_long_logs_run_in_python_which_is_said_once(monkeypatch, reason):
    without(monkeypatch, reason)
    kernel = Kernel(lambda state, x: (state + x, state), 0.0, 0.0, lowering="auto")
    long = np.ones(10_000)
    with pytest.warns(RuntimeWarning, match=reason):
        state, _ = kernel.scan(0.0, long)
    assert state == 10_000
    assert kernel.scan(0.0, long)[0] == 10_000  # a second warning would be an error here
    assert kernel.scan_lanes(0.0, np.ones((10_000, 2)))[0].tolist() == [10_000, 10_000]
    assert reason in kernel.explain()


def test_short_logs_and_live_samples_need_no_machine_code_and_say_nothing(monkeypatch):
    without(monkeypatch, "llvmlite is not installed")
    kernel = Kernel(lambda state, x: (state + x, state), 0.0, 0.0, lowering="auto")
    assert kernel.scan(0.0, np.ones(9))[0] == 9
    assert kernel.live(1.0).step(2.0) == 1.0


def test_live_steps_begin_in_python_and_continue_in_machine_code(monkeypatch):
    returned: list[int] = []
    monkeypatch.setattr(kernel_module, "return_freed", lambda: returned.append(1))
    kernel: Any = Kernel(lambda state, x: (state + x, 2.0 * state), 0.0, 0.0, lowering="auto")
    with kernel_module._BEHIND:  # nothing is compiled meanwhile
        first, second = kernel.live(1.0), kernel.live(10.0)
        assert [first.step(2.0), first.state] == [2.0, 3.0]
        assert "_one_machine" not in vars(kernel)
    kernel._behind.join()
    assert len(returned) == 1
    assert [first.step(4.0), second.step(1.0)] == [6.0, 20.0]
    assert [first.state, second.state] == [7.0, 11.0]
    assert type(kernel.live(0.0)).__name__ == "MachineLive"
    first.state = 0.0
    assert first.step(0.0) == 0.0
    assert first.is_finite()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_a_process_forked_behind_the_first_live_steps_can_compile():
    of_child: Any
    of_parent, of_child = (Kernel(lambda state, x: (state + x, state), 0.0, 0.0, lowering="auto") for _ in range(2))
    of_parent.live(1.0)
    child = os.fork()
    if child == 0:
        of_child.live(1.0)
        of_child._behind.join(20.0)
        os._exit(of_child._behind.is_alive())
    assert os.waitpid(child, 0)[1] == 0


def test_machine_code_that_is_asked_for_is_not_replaced(monkeypatch):
    without(monkeypatch, "llvmlite is not installed")
    kernel = Kernel(lambda state, x: (state + x, state), 0.0, 0.0, lowering="machine")
    with pytest.raises(machine_code.NoMachineCodeError, match="llvmlite"):
        kernel.scan(0.0, np.ones(9))
    with pytest.raises(machine_code.NoMachineCodeError, match="llvmlite"):
        kernel.live(0.0)


def test_a_live_step_outlives_its_kernel():
    """In a process of its own: code that was freed ends it."""
    code = """
import gc
import numpy as np
from ohmward.trace import Kernel

lives = []
for k in range(20):
    kernel = Kernel(lambda state, sample, k=k: (state + sample * k, state), 0.0, 1.0, lowering="machine")
    lives.append(kernel.live(0.0).step)
    del kernel
    gc.collect()
assert [step(1.0) for step in lives] == [0.0] * 20
assert [step(1.0) for step in lives] == [float(k) for k in range(20)]
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
