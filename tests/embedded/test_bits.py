"""Machine code in single precision gives the bits that the vectors hold, which the C gives on every machine."""

import numpy as np
import pytest

from embedded.batteries import BATTERY
from ohmward.embedded import battery_export
from ohmward.trace import single_precision
from ohmward.trace.structure import size

pytest.importorskip("llvmlite")

EXPORTS = [
    ("textbook-ekf", {}),
    ("textbook-ukf", {"sample_time_s": 1.0}),
    ("textbook-ukf", {"curve_error_V": 4e-3}),
    ("textbook-joint", {}),
    ("ekf", {}),
]


@pytest.mark.parametrize(("name", "options"), EXPORTS)
def test_machine_code_has_the_bits_of_the_vectors(name, options):
    from ohmward.trace.lower.llvm_run import MachineStep

    export = battery_export(BATTERY, name, **options)
    samples = export.samples.astype(np.float32)
    first = np.concatenate([samples[0], np.array(export.arguments, np.float32)])
    start = single_precision.evaluator(export.start)(first)
    _, expected = single_precision.run(export.step, start, samples)

    count = size(export.step.argument_structure.children[0])
    state, found = start.astype(float), np.empty((expected.shape[1], len(samples)))
    columns = [np.ascontiguousarray(column, float) for column in samples.T]
    MachineStep(export.step, count, "f32", contract=False).one(state, columns, list(found), None)
    np.testing.assert_array_equal(found.T.astype(np.float32), expected)
