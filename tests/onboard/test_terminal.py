"""The line for people: what is not known is a dash, and a row of the terminal holds it."""

import numpy as np

from ohmward import SlipEstimator
from ohmward.onboard.robot_state import RobotState
from ohmward.onboard.sinks.terminal import line_of, within_terminal


def test_a_slip_that_is_not_known_is_a_dash():
    estimate = SlipEstimator("rlma").update(0.0, [0.0] * 4)
    slip = estimate._replace(slip_ratio=np.array([np.nan, 0.124]))
    assert "slip - 12 %" in line_of(RobotState(0.0, 0.0, slip=slip))


def test_a_line_is_cut_where_the_terminal_ends(monkeypatch):
    monkeypatch.setenv("COLUMNS", "20")
    assert within_terminal("short") == "short"
    assert within_terminal("speed 0.50 m/s  slip 12 %") == "speed 0.50 m/s  sl…"
