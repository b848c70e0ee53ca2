"""Single precision on NumPy: near the truth in double precision, and the bits of machine code."""

import numpy as np
import pytest

from filters import saft_seven_states
from ohmward.trace import Kernel, single_precision, table, tanh, trace, where
from ohmward.trace.lower.llvm_run import MachineStep

SAMPLES = np.stack(saft_seven_states.simulated_log(40), axis=1).astype(np.float32)


def flat(tree):
    return np.concatenate([np.ravel(x) for x in tree]).astype(float)


def test_a_filter_is_near_its_double():
    start, samples = saft_seven_states.PACKED, SAMPLES
    kernel = Kernel(saft_seven_states.packed_step, start, (0.0, 0.0), lowering="python")
    _, (mean, _) = kernel.scan(start, tuple(samples.T.astype(float)))
    _, outputs = single_precision.run(kernel.program, flat(start), samples)
    assert outputs.dtype == np.float32
    np.testing.assert_allclose(outputs[:, :7], mean, rtol=2e-4, atol=2e-4)


def test_it_has_the_bits_of_machine_code():
    pytest.importorskip("llvmlite")
    start, samples = saft_seven_states.PACKED, SAMPLES
    program = trace(saft_seven_states.packed_step, start, (0.0, 0.0))
    state, outputs = flat(start), np.empty((8, 40))
    step = MachineStep(program, state.size, "f32", contract=False)
    step.one(state, [np.ascontiguousarray(c, float) for c in samples.T], list(outputs), None)
    after, found = single_precision.run(program, flat(start), samples)
    np.testing.assert_array_equal(found.T, outputs)
    np.testing.assert_array_equal(after, state)


def test_conditions_and_tables():
    def step(armed, x):
        armed = armed | (x > 1.0)
        return armed, (where(armed, table([0.0, 2.0, 1.0], 0.0, 1.0, x), tanh(x)), armed)

    program = trace(step, False, 0.0)
    _, outputs = single_precision.run(program, np.array([0.0]), np.array([[0.5], [1.5], [np.nan], [9.0]]))
    np.testing.assert_allclose(outputs[:, 0], [np.tanh(0.5), 1.5, np.nan, -6.0], rtol=1e-6)
    np.testing.assert_array_equal(outputs[:, 1], [0.0, 1.0, 1.0, 1.0])
