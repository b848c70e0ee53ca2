import numpy as np
import pytest

from ohmward.battery.cells.cell_filter import CellEstimate
from ohmward.battery.cells.drift import cell_warnings, drifted, ranges

NAMES = ("cell 1", "cell 2", "cell 3")


def cells(difference=(0.0, 0.0, 0.0), capacity=(1.0, 1.0, 1.0), resistance=(1.0, 1.0, 1.0), std=0.01):
    d, q, r = map(np.array, (difference, capacity, resistance))
    stds = np.full(3, std)
    return CellEstimate(0.5 + d, stds, d, stds, q, stds, r, stds, np.zeros(3))


def test_equal_cells_warn_of_nothing():
    assert cell_warnings(cells(), NAMES) == ()


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"difference": (0.0, 0.0, -0.1)}, "cell 3: state of charge 10.0 ± 2.0 points below"),
        ({"difference": (0.1, 0.0, 0.0)}, "cell 1: state of charge 10.0 ± 2.0 points above"),
        ({"capacity": (1.0, 0.8, 1.0)}, "cell 2: capacity 20.0 ± 2.0 % below"),
        ({"resistance": (1.5, 1.0, 1.0)}, "cell 1: resistance 50.0 ± 2.0 % above"),
    ],
)
def test_the_cell_and_what_is_wrong_with_it_are_named(changed, says):
    (warning,) = cell_warnings(cells(**changed), NAMES)
    assert warning.text.startswith(says)


def test_a_cell_that_is_better_is_no_warning():
    assert cell_warnings(cells(capacity=(1.2, 1.0, 1.0), resistance=(0.6, 1.0, 1.0)), NAMES) == ()


def test_a_difference_that_is_not_certain_is_no_warning():
    sure, unsure = (cells(difference=(0.0, 0.0, -0.07), std=std) for std in (0.01, 0.02))
    assert drifted(sure)["state of charge"].tolist() == [False, False, True]
    assert cell_warnings(unsure, NAMES) == ()


def test_the_range_is_that_of_the_extremes():
    value, std = ranges(cells(difference=(0.02, 0.0, -0.05)))["SoC"]
    assert value == pytest.approx(0.07)
    assert std == pytest.approx(0.01 * 2**0.5)
