"""Samples of a log for the fit."""

import numpy as np
import pytest

from ohmward.battery.learning.samples import _path_jumps


def test_the_charge_that_samples_leave_open_keeps_its_variance():
    path = np.random.default_rng(1).uniform(0.0, 1e-5, 1000)
    jumps = _path_jumps(path)
    assert 15 < len(jumps) <= 20
    assert sum(jump.std**2 for jump in jumps) == pytest.approx(path.sum())


def test_a_long_interval_is_one_jump_of_its_size():
    path = np.full(1000, 1e-9)
    path[500] = 0.02**2
    jumps = _path_jumps(path)
    assert max(jumps, key=lambda jump: jump.std) == (500, pytest.approx(0.02, rel=1e-2))
    assert sum(jump.std**2 for jump in jumps) == pytest.approx(path.sum())
