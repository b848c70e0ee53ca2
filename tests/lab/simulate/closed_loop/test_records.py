from typing import Any, NamedTuple

import numpy as np

from ohmward_lab.simulate.closed_loop.loop import Records


class Inner(NamedTuple):
    a: Any
    b: Any


class Outer(NamedTuple):
    x: Any
    inner: Inner
    nothing: Any


def test_records_come_back_with_time_in_front():
    records: Records[Outer] = Records()
    for k in range(5):
        records.add(Outer(np.array([k, k + 1.0, np.nan]), Inner(float(k), np.full((2, 2), k)), None))
    back = records.stacked()
    assert len(records) == 5
    assert back.nothing is None
    assert back.x.shape == (5, 3)
    np.testing.assert_array_equal(back.x[3], [3.0, 4.0, np.nan])
    np.testing.assert_array_equal(back.inner.a, np.arange(5.0))
    np.testing.assert_array_equal(back.inner.b[4], np.full((2, 2), 4.0))
