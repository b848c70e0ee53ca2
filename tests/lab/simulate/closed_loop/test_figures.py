import math

import numpy as np
import pytest

from ohmward_lab.simulate.closed_loop.run import track_command

TIME_S = np.arange(0.01, 2.001, 0.01)


def test_slip_settles_when_it_stays():
    slip = np.where(TIME_S < 0.505, 0.5, 0.13)
    slip = np.where((TIME_S > 0.80) & (TIME_S < 0.835), 0.2, slip)
    held = track_command(TIME_S, np.column_stack([slip, np.full_like(slip, 0.12)]), 0.0, 0.12)
    assert held.settle_s == pytest.approx(0.84)
    assert held.rms_error == pytest.approx(0.01)
    assert (held.from_s, held.to_s) == pytest.approx((0.0, 2.0))


def test_slip_that_does_not_stay_never_settled():
    slip = np.where(TIME_S < 1.995, 0.12, 0.3)[:, None]
    assert math.isnan(track_command(TIME_S, slip, 0.0, 0.12).settle_s)


def test_the_worst_wheel_counts():
    slip = np.column_stack([np.full_like(TIME_S, 0.12), np.full_like(TIME_S, 0.17)])
    held = track_command(TIME_S, slip, 0.0, 0.12)
    assert held.rms_error == pytest.approx(0.05)
    assert math.isnan(held.settle_s)


def test_slip_that_is_not_known_is_not_reached():
    slip = np.where(TIME_S < 0.305, np.nan, 0.12)[:, None]
    assert track_command(TIME_S, slip, 0.0, 0.12).settle_s == pytest.approx(0.31)
