"""Ticks and labels that people would have chosen."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ohmward.errors import InputError
from ohmward.report.axis import (
    WallClock,
    decimals,
    linear_ticks,
    nice_step,
    shared_x,
    tick_labels,
    time_unit,
    value_decimals,
)
from ohmward.report.figure import TIME, Band, Figure, Series


@given(st.floats(1e-9, 1e9), st.integers(2, 12))
def test_a_nice_step_is_one_two_or_five_and_the_smallest_that_fits(span, intervals):
    step = nice_step(span, intervals)
    mantissa = step / 10 ** math.floor(math.log10(step) + 1e-9)
    assert min(abs(mantissa - m) for m in (1, 2, 5)) < 1e-6
    assert span / step <= intervals * (1 + 1e-6)
    assert span / (step / 2.5) > intervals * (1 - 1e-6)


@given(st.floats(-1e6, 1e6), st.floats(1e-3, 1e6))
def test_linear_ticks_lie_inside_and_are_multiples_of_their_step(low, span):
    ticks = linear_ticks(low, low + span)
    slack = 1e-6 * span
    assert low - slack <= ticks[0] and ticks[-1] <= low + span + slack
    assert 2 <= ticks.size <= 7
    step = nice_step(span, 6)
    assert ticks / step == pytest.approx(np.round(ticks / step), abs=1e-6)


def test_an_axis_has_two_ticks_at_least():
    assert linear_ticks(-9.1, 9.1, 2).tolist() == [-5.0, 0.0, 5.0]


@pytest.mark.parametrize(
    ("low", "high", "labels"),
    [
        (0, 0.4, ["0.0", "0.1", "0.2", "0.3", "0.4"]),
        (-3.2, 4.1, ["−2", "0", "2", "4"]),
        (11.98, 13.02, ["12.0", "12.5", "13.0"]),
        (12.031, 12.049, ["12.035", "12.040", "12.045"]),
        (0, 5e7, ["0", "1e7", "2e7", "3e7", "4e7", "5e7"]),
        (0, 2e-4, ["0", "5e−5", "1e−4", "1.5e−4", "2e−4"]),
    ],
)
def test_tick_labels_read_as_written_by_hand(low, high, labels):
    assert tick_labels(linear_ticks(low, high, 5)) == labels


@pytest.mark.parametrize(("duration", "name"), [(1, "s"), (179, "s"), (181, "min"), (10_799, "min"), (10_801, "h")])
def test_the_unit_of_time_follows_the_duration(duration, name):
    assert time_unit(duration)[0] == name


def test_figures_of_a_stack_share_their_extent_in_one_unit():
    x = np.array([0.0, 600.0])
    one = Figure("a", TIME, "y", [Series(x, x, "s")])
    two = Figure("b", TIME, "y", bands=[Band(x + 300, x, x, "b")])
    assert shared_x([one, two])[:4] == ("Time [min]", 0.0, 15.0, 60.0)


def test_a_log_with_dates_has_an_axis_in_seconds_of_its_clock_and_names_the_zone():
    x = np.array([0.0, 600.0])
    figures = [Figure("a", TIME, "y", [Series(x, x, "s")])]
    axis = shared_x(figures, WallClock(1.7e9, "Europe/Berlin"))
    assert axis.place(60.0) == 1.7e9 + 60
    assert tuple(axis) == ("Time (Europe/Berlin)", 1.7e9, 1.7e9 + 600, 1.0, 1.7e9, "Europe/Berlin")
    assert shared_x(figures, WallClock(0.0, "")).label == "Time (as in the log, which names no time zone)"
    other = [Figure("a", "Slip [-]", "y", [Series(x, x, "s")])]
    assert shared_x(other, WallClock(1.7e9)).time_zone is None


def test_a_stack_with_two_kinds_of_x_is_refused():
    with pytest.raises(InputError, match=r"one x_label, got \['Slip', 'time'\]: plot them separately"):
        shared_x([Figure("a", TIME, "y"), Figure("b", "Slip", "y")])


@pytest.mark.parametrize("x", [[], [5.0]])
def test_a_figure_with_hardly_any_data_still_has_an_extent(x):
    axis = shared_x([Figure("a", "x", "y", [Series(np.array(x), np.array(x), "s")])])
    assert axis.high - axis.low == 1.0


@pytest.mark.parametrize(("resolution", "places"), [(0.001, 3), (0.02, 2), (0.5, 1), (1, 0), (5, 0), (100, -2)])
def test_decimals_show_a_resolution(resolution, places):
    assert decimals(resolution) == places


def test_value_decimals_follow_the_bulk_and_not_a_spike():
    y = np.linspace(12.0, 13.0, 1000)
    calm = value_decimals(y)
    y[500] = 1e6
    assert calm == 5
    assert value_decimals(y) == calm


@pytest.mark.parametrize(("values", "places"), [([3.3, 3.3], 4), ([0.0], 4), ([np.nan], 0), ([250.0, 250.0], 2)])
def test_value_decimals_of_constants(values, places):
    assert value_decimals(np.array(values)) == places


def test_a_point_at_an_end_of_the_axis_has_a_margin_and_a_line_none():
    x = np.array([2.0, 12.0])
    lines, points = (Figure("f", "Capacity [%]", "y", [Series(x, x, "s", style)]) for style in ("line", "points"))
    assert shared_x([lines])[1:3] == (2.0, 12.0)
    assert shared_x([points])[1:3] == pytest.approx((1.7, 12.3))
