"""Figures refuse what cannot be drawn, with the name, the rule and the fix."""

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.report.figure import TIME, Band, Figure, Marker, Series, Span

X = np.arange(3.0)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Series(X, X[:2], "v"), r"'v': x, y must be 1-D and equally long, got .*\(3,\).*\(2,\)"),
        (lambda: Series(X[::-1], X, "v"), r"'v': x must ascend, got 2 before 1 at index 0; .*style='points'"),
        (lambda: Series(np.array([0, np.nan, 1]), X, "v"), "x must be finite"),
        (lambda: Series(X, X, "v", style="wavy"), "style must be one of line, points, step, dashed, got 'wavy'"),  # type: ignore[arg-type]
        (lambda: Series(X, X, "v", role="pink"), "role must be one of auto, estimate, .* got 'pink'"),  # type: ignore[arg-type]
        (lambda: Series(X, X, "v", axis="top"), "axis must be one of left, right, got 'top'"),  # type: ignore[arg-type]
        (lambda: Band(X, X, X - 1, "b"), "low must not exceed high, got 0 > -1 at index 0"),
        (lambda: Band(X, X, X, "b", role="auto"), "role must be one of estimate, .* got 'auto'"),  # type: ignore[arg-type]
        (lambda: Figure("f", TIME, "y", [Series(X, X, "v", axis="right")]), "needs right_label"),
        (lambda: Figure("f", TIME, "y", [Series(X, X, "v")], log_y=True), "log_y needs values > 0, 'v' has 0; set"),
        (lambda: Figure("f", TIME, "y", bands=[Band(X, X - 1, X, "b")], log_y=True), "'b' has -1"),
        (lambda: Figure("f", TIME, "y", y_limits=(1, 1)), "y_limits must ascend"),
        (lambda: Figure("f", TIME, "y", y_limits=(0, 1), log_y=True), "y_limits of a log axis must be positive"),
        (lambda: Figure("f", TIME, "y", markers=[Marker(1.0, "m", "pink")]), "role must be one of"),  # type: ignore[arg-type]
        (lambda: Figure("f", TIME, "y", markers=[Marker(np.nan, "m")]), "must be finite"),
        (lambda: Figure("f", TIME, "y", spans=[Span(0.0, np.inf, "m")]), "must be finite"),
        (lambda: Figure("f", TIME, "y", spans=[Span(2.0, 1.0, "m")]), "span 'm': x_from must not exceed x_to"),
    ],
)
def test_what_cannot_be_drawn_is_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()


def test_points_may_come_in_any_order_and_integers_become_floats():
    series = Series(np.array([3, 1, 2]), np.array([30, 10, 20]), "v", "points")
    assert series.y.dtype == float
    assert series.x.tolist() == [1, 2, 3]
    assert series.y.tolist() == [10, 20, 30]


def test_infinite_values_become_gaps_and_the_input_is_left_alone():
    y = np.array([1.0, np.inf, 2.0])
    assert np.isnan(Series(X, y, "v").y[1])
    assert np.isinf(y[1])


def test_a_right_series_may_be_negative_beside_a_logarithmic_left_axis():
    Figure("f", TIME, "y", [Series(X, X + 1, "v"), Series(X, -X, "i", axis="right")], right_label="I [A]", log_y=True)


def test_a_band_with_one_edge_unknown_has_a_gap_in_both():
    band = Band(X, np.array([0.0, np.nan, 0.0]), np.array([1.0, 1.0, np.inf]), "b")
    assert np.isnan(band.low).tolist() == np.isnan(band.high).tolist() == [False, True, True]
