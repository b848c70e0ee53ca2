import numpy as np
import pytest

from ohmward.battery.cells.cell_filter import CellEstimate
from ohmward.battery.cells.drift import pack_state


def cells(soc, capacity, std=0.01):
    soc, capacity = np.array(soc), np.array(capacity)
    stds = np.full(soc.shape, std)
    return CellEstimate(soc, stds, soc - np.median(soc), stds, capacity, stds, np.ones_like(soc), stds, 0.0 * soc)


def test_equal_cells_are_the_pack():
    found = pack_state(cells([0.6, 0.6, 0.6], [1.0, 1.0, 1.0]), 10.0)
    assert found.soc == pytest.approx(0.6)
    assert found.usable_Ah == pytest.approx(6.0)
    assert found.capacity_Ah == pytest.approx(10.0)
    assert found.soc_std == pytest.approx(0.01)
    assert found.soc_spread == 0.0


def test_the_weakest_cell_ends_the_discharge_and_the_fullest_the_charge():
    """A: 6 of 10 Ah, B: 4 of 8 Ah: 4 Ah can be taken, and 4 Ah can be charged."""
    found = pack_state(cells([0.6, 0.5], [1.0, 0.8]), 10.0)
    assert found.weakest == 1
    assert found.usable_Ah == pytest.approx(4.0)
    assert found.capacity_Ah == pytest.approx(8.0)
    assert found.soc == pytest.approx(0.5)
    assert found.weakest_soc == 0.5


def test_the_cell_with_the_least_charge_is_the_weakest_not_that_with_the_lowest_soc():
    found = pack_state(cells([0.5, 0.55], [1.0, 0.8]), 10.0)
    assert found.weakest == 1
    assert found.usable_Ah == pytest.approx(4.4)


def test_cells_that_are_not_balanced_hold_less_than_each_of_them():
    found = pack_state(cells([1.0, 0.9], [1.0, 1.0]), 10.0)
    assert found.soc == pytest.approx(1.0)
    assert found.capacity_Ah == pytest.approx(9.0)


def test_a_pack_with_an_empty_and_a_full_cell_is_empty():
    found = pack_state(cells([0.0, 1.0], [1.0, 1.0]), 10.0)
    assert found.soc == found.capacity_Ah == 0.0 and found.soc_std == 1.0
    nearly = pack_state(cells([0.02, 1.0], [1.0, 1.0]), 10.0)
    assert nearly.soc == 1.0 and nearly.soc_std == pytest.approx(0.5)  # 0.1 of 0.2 Ah


def test_it_works_along_a_log():
    estimates = cells(np.linspace([1.0, 0.95], [0.1, 0.0], 5), np.ones((5, 2)))
    found = pack_state(estimates, np.full(5, 2.0))
    assert found.usable_Ah == pytest.approx(2.0 * estimates.soc[:, 1])
    assert found.weakest.tolist() == [1] * 5
