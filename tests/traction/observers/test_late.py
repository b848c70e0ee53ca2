import numpy as np
import pytest

from ohmward.traction.observers.late import change_since, empty_history, remember


def test_the_change_since_then_even_within_a_step():
    history = empty_history(3)
    for dt_s, change in [(0.1, 5.0), (0.1, 1.0), (0.2, 2.0)]:
        history = remember(history, dt_s, change)
    assert [change_since(history, age) for age in (0.0, 0.1, 0.2, 0.3, 0.35)] == pytest.approx([0, 1, 2, 3, 5.5])


def test_older_than_what_is_remembered_is_all_that_is_remembered():
    history = remember(remember(empty_history(1), 0.1, 5.0), 0.1, 1.0)
    assert change_since(history, 9.0) == 1.0
    assert change_since(empty_history(0), 1.0) == 0.0
    assert np.shape(remember(empty_history(0), 0.1, 1.0).dt_s) == (0,)
