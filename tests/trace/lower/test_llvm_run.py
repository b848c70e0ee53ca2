"""Machine code against the same program on Python floats, bit by bit where nothing is contracted."""

import every_operation
import numpy as np
import pytest
from every_operation import Memory, Seen

from filters import saft_seven_states
from ohmward.trace import trace
from ohmward.trace.elementary import F64, expand
from ohmward.trace.lower import llvm_machine_code, llvm_run, python_source
from ohmward.trace.lower.llvm_machine_code import vector_bits
from ohmward.trace.lower.llvm_run import MachineStep, OneStep

pytest.importorskip("llvmlite")
RNG = np.random.default_rng(1)
WIDTH = vector_bits() // 64


PROGRAM = trace(every_operation.step, Memory(0.0, False, np.zeros(2)), Seen(0.0, False, 0.0))
STATE_SIZE, OUTPUTS = 4, 4
START = np.array([0.3, 0.0, 0.1, -0.2])


def a_log(steps: int, lanes: int | None = None) -> list[np.ndarray]:
    shape = (steps,) if lanes is None else (steps, lanes)
    u, w = RNG.normal(0.0, 2.0, shape), RNG.normal(0.0, 2.0, shape)
    u[RNG.random(shape) < 0.02] = np.nan
    w[RNG.random(shape) < 0.02] = np.inf
    return [u, (RNG.random(shape) < 0.5).astype(float), w]


def on_python_floats(columns: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """State (n,) and outputs (OUTPUTS, T) of the expanded program, run by Python."""
    scan = python_source.compile_scan(expand(PROGRAM, F64), STATE_SIZE)
    emitted: list[float] = []
    state = (START[0], bool(START[1]), *START[2:])
    rows = [columns[0].tolist(), [bool(x) for x in columns[1]], columns[2].tolist()]
    after = scan(tuple(float(x) if not isinstance(x, bool) else x for x in state), rows, emitted.extend)
    return np.array(after, float), np.array(emitted, float).reshape(-1, OUTPUTS).T


def in_machine_code(step: MachineStep, columns: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    state, outputs = START.copy(), np.empty((OUTPUTS, len(columns[0])))
    step.one(state, columns, list(outputs), None)
    return state, outputs


def test_one_log_has_the_bits_of_python_floats():
    columns = a_log(500)
    for found, wanted in zip(
        in_machine_code(MachineStep(PROGRAM, STATE_SIZE, contract=False), columns),
        on_python_floats(columns),
        strict=True,
    ):
        np.testing.assert_array_equal(found, wanted)


def test_contraction_changes_last_bits_only():
    columns = [np.nan_to_num(c, posinf=1.0) for c in a_log(200)]
    plain = in_machine_code(MachineStep(PROGRAM, STATE_SIZE, contract=False), columns)
    fused = in_machine_code(MachineStep(PROGRAM, STATE_SIZE, contract=True), columns)
    np.testing.assert_allclose(fused[1], plain[1], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("lanes", [1, WIDTH - 1, WIDTH, 2 * WIDTH + 3])
@pytest.mark.parametrize("threads", [1, 2])
def test_every_lane_is_a_log_of_its_own(lanes, threads):
    step = MachineStep(PROGRAM, STATE_SIZE, contract=False)
    columns = a_log(60, lanes)
    state, outputs = np.repeat(START[:, None], lanes, axis=1), np.empty((OUTPUTS, 60, lanes))
    step.many(state, columns, list(outputs), threads)
    for lane in range(lanes):
        after, wanted = in_machine_code(step, [np.ascontiguousarray(c[:, lane]) for c in columns])
        np.testing.assert_array_equal(outputs[:, :, lane], wanted)
        np.testing.assert_array_equal(state[:, lane], after)


def test_a_column_may_be_the_same_for_all_lanes_or_all_times():
    step = MachineStep(PROGRAM, STATE_SIZE, contract=False)
    u, _, w = a_log(40, WIDTH)
    shared, held = np.ascontiguousarray(w[:, 0]), np.broadcast_to(1.0, 40)
    state, outputs = np.repeat(START[:, None], WIDTH, axis=1), np.empty((OUTPUTS, 40, WIDTH))
    step.many(state, [u, held, shared], list(outputs), 1)
    for lane in range(WIDTH):
        _, wanted = in_machine_code(step, [np.ascontiguousarray(u[:, lane]), np.ones(40), shared])
        np.testing.assert_array_equal(outputs[:, :, lane], wanted)


def test_sample_by_sample_is_the_whole_log():
    columns = a_log(30)
    step = MachineStep(PROGRAM, STATE_SIZE, contract=False)
    after, wanted = in_machine_code(step, columns)
    live = OneStep(step, START)
    for k in range(30):
        live.sample[:] = [c[k] for c in columns]
        live.run()
        np.testing.assert_array_equal(live.output, wanted[:, k])
    np.testing.assert_array_equal(live.state, after)


def test_a_whole_adaptive_filter_in_both_precisions():
    start = saft_seven_states.PACKED
    program = trace(saft_seven_states.packed_step, start, (0.0, 0.0))
    flat = np.concatenate([np.ravel(x) for x in start]).astype(float)
    current, voltage = saft_seven_states.simulated_log(200)
    size = len(flat)
    results = {}
    for precision in ("f64", "f32"):
        state, outputs = flat.copy(), np.empty((len(program.outputs) - size, 200))
        MachineStep(program, size, precision).one(state, [current, voltage], list(outputs), None)
        results[precision] = outputs
    reference: list[float] = []
    python_source.compile_scan(program, size)(
        tuple(flat.tolist()), [current.tolist(), voltage.tolist()], reference.extend
    )
    wanted = np.array(reference).reshape(200, -1).T
    np.testing.assert_allclose(results["f64"], wanted, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(results["f32"], wanted, rtol=2e-3, atol=2e-3)


def test_threads_that_start_together_share_one_compilation(monkeypatch):
    compiled: list[str] = []
    compile_scan = llvm_machine_code.compile_scan

    def counted(source: str, name: str):
        compiled.append(name)
        return compile_scan(source, name)

    monkeypatch.setattr(llvm_run, "compile_scan", counted)
    columns = a_log(5, 8 * WIDTH)
    state, outputs = np.repeat(START[:, None], 8 * WIDTH, axis=1), np.empty((OUTPUTS, 5, 8 * WIDTH))
    MachineStep(PROGRAM, STATE_SIZE).many(state, columns, list(outputs), threads=8)
    assert len(compiled) == 1


def test_the_environment_says_how_many_threads(monkeypatch):
    monkeypatch.delenv("OHMWARD_THREADS", raising=False)
    assert llvm_run.processors() >= 1
    for text, threads in (("3", 3), ("0", 1), ("all", 1)):
        monkeypatch.setenv("OHMWARD_THREADS", text)
        assert llvm_run.processors() == threads
