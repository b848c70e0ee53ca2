"""The line for people: what is not known is a dash, and a row of the terminal holds it."""

import math

import numpy as np
import pytest

from ohmward import SlipEstimator
from ohmward.energy.points import Quantiles
from ohmward.energy.range_step import RangeEstimate, RangeFlag
from ohmward.onboard.robot_state import RobotState
from ohmward.onboard.sinks.terminal import line_of, within_terminal


def test_a_slip_that_is_not_known_is_a_dash():
    estimate = SlipEstimator("rlma").update(0.0, [0.0] * 4)
    slip = estimate._replace(slip_ratio=np.array([np.nan, 0.124]))
    assert "slip - 12 %" in line_of(RobotState(0.0, 0.0, slip=slip))


@pytest.mark.parametrize(
    ("range_km", "text"),
    [((0.3, 2.9, 6.3), "range 2.9 km (0.3 to 6.3), 1.0 h"), ((math.inf,) * 3, ""), ((math.nan,) * 3, "")],
)
def test_a_range_has_its_band_and_one_that_does_not_end_is_left_out(range_km, text):
    distance_m, duration_s = Quantiles(*(1e3 * km for km in range_km)), Quantiles(1e3, 3600.0, 1e4)
    reach = RangeEstimate(distance_m, duration_s, distance_m, distance_m, math.nan, 99.0, RangeFlag(0))
    line = line_of(RobotState(0.0, 0.0, range=reach))
    assert text in line and ("range" in line) == bool(text)


def test_a_line_is_cut_where_the_terminal_ends(monkeypatch):
    monkeypatch.setenv("COLUMNS", "20")
    assert within_terminal("short") == "short"
    assert within_terminal("speed 0.50 m/s  slip 12 %") == "speed 0.50 m/s  sl…"
