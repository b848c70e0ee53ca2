import math

import numpy as np
import pytest

from ohmward.battery.cells.cell_filter import CellSpread
from ohmward.battery.cells.drift import expected_weakest, largest_of


def test_the_largest_of_few_is_that_of_the_tables():
    """One: the variable itself. Two: 1 / sqrt(pi). Three: 1.5 / sqrt(pi). Ten: 1.53875 (Teichroew 1956)."""
    assert largest_of(1) == pytest.approx((0.0, 1.0), abs=1e-4)
    assert largest_of(2) == pytest.approx((1 / math.sqrt(math.pi), math.sqrt(1 - 1 / math.pi)), abs=1e-4)
    assert largest_of(3)[0] == pytest.approx(1.5 / math.sqrt(math.pi), abs=1e-4)
    assert largest_of(10)[0] == pytest.approx(1.53875, abs=1e-4)


def test_packs_drawn_from_the_spread_are_covered():
    rng = np.random.default_rng(0)
    spread, n, gone = CellSpread(), 6, 0.4
    lower = spread.soc_std * rng.standard_normal((20000, n))
    capacity = 1.0 + spread.capacity_std * rng.standard_normal((20000, n))
    weakest = (1.0 - gone * (2.0 - capacity) + lower).min(axis=1)
    expected = expected_weakest(1.0 - gone, 0.0, n, spread)
    assert expected.mean == pytest.approx(weakest.mean(), abs=2e-3)
    assert expected.std == pytest.approx(weakest.std(), rel=0.03)


def test_cells_that_do_not_differ_are_the_pack():
    spread = CellSpread(soc_std=0.0, capacity_std=0.0)
    assert expected_weakest(0.5, 0.02, 28, spread) == pytest.approx((0.5, 0.02))
