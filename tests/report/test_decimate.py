"""Decimation against its promises: nothing that a column of pixels could show is lost."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from ohmward.report import figure
from ohmward.report.figure import FINEST, Band, Series, column_edges, envelope, finest, m4, scatter

COLUMNS = 7
DRAWN = 1000
finite = st.floats(-1e6, 1e6)


@st.composite
def signals(draw):
    """Ascending x with ties, y with gaps."""
    n = draw(st.integers(1, 200))
    x = np.sort(draw(hnp.arrays(float, n, elements=finite)))
    y = draw(hnp.arrays(float, n, elements=finite | st.just(np.nan)))
    return x, y


@given(signals())
def test_every_column_keeps_its_first_last_lowest_and_highest_sample(signal):
    x, y = signal
    kept = m4(x, y, COLUMNS)
    edges = column_edges(x, COLUMNS)
    for i, j in pairwise(edges):
        seen = np.flatnonzero(np.isfinite(y[i:j])) + i
        if seen.size:
            assert {seen[0], seen[-1]} <= set(kept)
            inside = y[kept[(kept >= i) & (kept < j)]]
            assert (np.nanmin(inside), np.nanmax(inside)) == (y[seen].min(), y[seen].max())


@given(signals())
def test_a_gap_in_a_column_stays_a_gap_and_the_count_is_bounded(signal):
    x, y = signal
    kept = m4(x, y, COLUMNS)
    edges = column_edges(x, COLUMNS)
    assert (np.diff(kept) > 0).all()
    assert kept.size <= 5 * COLUMNS
    for i, j in pairwise(edges):
        assert np.isnan(y[i:j]).any() == np.isnan(y[kept[(kept >= i) & (kept < j)]]).any()


def test_columns_are_equally_wide_in_x_not_in_samples():
    x = np.concatenate([np.linspace(0, 1, 1000), [2.0, 3.0, 4.0]])
    assert np.diff(column_edges(x, 4)).tolist() == [999, 1, 1, 2]


def test_columns_start_where_the_data_start():
    assert np.diff(column_edges(1.7e9 + np.arange(40.0), 4)).tolist() == [10, 10, 10, 10]


def test_a_short_series_is_kept_whole():
    assert m4(np.arange(28.0), np.zeros(28), COLUMNS).tolist() == list(range(28))
    assert m4(np.arange(29.0), np.zeros(29), COLUMNS).size < 29


def test_one_spike_among_ten_million_samples_survives():
    y = np.zeros(10_000_000)
    y[7_654_321] = 1.0
    kept = m4(np.arange(y.size, dtype=float), y, 1000)
    assert 7_654_321 in kept
    assert kept.size <= 5000


@given(signals())
def test_what_a_figure_keeps_of_a_line_draws_what_the_line_draws(signal):
    x, y = signal
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(figure, "FINEST", 2 * COLUMNS)
        x_kept, y_kept = finest(x, y)
    assert (x_kept[0], x_kept[-1]) == (x[0], x[-1])
    wanted, found = m4(x, y, COLUMNS), m4(x_kept, y_kept, COLUMNS)
    if found.size < x_kept.size:
        np.testing.assert_array_equal(x_kept[found], x[wanted])
        np.testing.assert_array_equal(y_kept[found], y[wanted])
    else:  # so few that all are drawn, those of the line among them
        assert set(zip(x[wanted], np.nan_to_num(y[wanted], nan=1e9), strict=True)) <= set(
            zip(x_kept, np.nan_to_num(y_kept, nan=1e9), strict=True)
        )


def test_a_long_line_and_a_long_band_are_drawn_as_if_they_were_kept_whole(monkeypatch):
    rng = np.random.default_rng(0)
    x, y = np.cumsum(rng.exponential(size=1_600_000)), rng.standard_normal(1_600_000)
    y[rng.random(y.size) < 0.3] = np.nan
    y[:7] = y[-7:] = y[90_000:99_000] = np.nan
    line, band = Series(x, y, "l"), Band(x, y - 1.0, y + 1.0, "b")
    assert line.x.size < x.size and band.x.size <= 4 * FINEST
    wanted, found = m4(x, y, DRAWN), m4(line.x, line.y, DRAWN)
    np.testing.assert_array_equal(line.x[found], x[wanted])
    np.testing.assert_array_equal(line.y[found], y[wanted])
    whole = envelope(x, y - 1.0, y + 1.0, DRAWN)
    np.testing.assert_array_equal(envelope(band.x, band.low, band.high, DRAWN), whole)


@given(signals(), st.data())
def test_the_drawn_band_contains_every_sample_of_the_band(signal, data):
    x, low = signal
    high = low + data.draw(hnp.arrays(float, x.size, elements=st.floats(0, 1e6)))
    at, lowest, highest = envelope(x, low, high, COLUMNS)
    assert (np.diff(at) >= 0).all()
    assert at.size <= max(2 * COLUMNS, x.size)
    for i in np.flatnonzero(np.isfinite(low)):
        around = [k for k in range(at.size - 1) if at[k] <= x[i] <= at[k + 1]] or [0]
        assert any(_inside(at, lowest, highest, k, x[i], low[i], high[i]) for k in around)


def _inside(at, lowest, highest, k, x, low, high):
    """Is [low, high] at x within the edges drawn from point k to the next (or at k)?"""
    ends = slice(k, k + 2)
    slack = 1e-9 * (1 + abs(low) + abs(high))
    return (
        np.interp(x, at[ends], lowest[ends]) <= low + slack and high - slack <= np.interp(x, at[ends], highest[ends])
    ) or any(at[j] == x and lowest[j] <= low and high <= highest[j] for j in range(at.size))


def test_a_column_without_samples_of_the_band_is_a_gap():
    x = np.arange(100.0)
    low = np.where((x >= 50) & (x < 60), np.nan, 0.0)
    at, lowest, _ = envelope(x, low, low + 1, 10)
    assert np.isnan(lowest[(at > 50) & (at < 59)]).all()
    assert np.isfinite(lowest[(at < 40) | (at > 70)]).all()


@settings(max_examples=50)
@given(hnp.arrays(float, 500, elements=st.floats(-1, 1)), hnp.arrays(float, 500, elements=st.floats(-1, 1)))
def test_a_cloud_keeps_its_extremes_and_a_dot_near_every_sample(x, y):
    kept = scatter(x, y, 10, 8)
    assert kept.size <= 82
    assert (y[kept].min(), y[kept].max()) == (y.min(), y.max())
    width, height = np.ptp(x) / 10, np.ptp(y) / 8
    near = (abs(x[:, None] - x[kept]) <= width + 1e-12) & (abs(y[:, None] - y[kept]) <= height + 1e-12)
    assert near.any(axis=1).all()


def test_points_are_thinned_as_a_cloud_and_on_the_axis_that_shows_them():
    x = np.arange(40_000.0) % 200
    y = 10.0 ** np.linspace(-6, 0, x.size)
    linear, log = (Series(x, y, "s", "points").visible(800, 100, log_y) for log_y in (False, True))
    lowest_tenth = np.sort(y)[: y.size // 10].max()
    x, y = np.sort(x), y[np.argsort(x, kind="stable")]
    assert (y[linear] < lowest_tenth).sum() < (y[log] < lowest_tenth).sum() / 2


@pytest.mark.parametrize("style", ["line", "step", "dashed"])
def test_lines_are_thinned_by_m4(style):
    x = np.arange(1000.0)
    series = Series(x, np.sin(x), "s", style)
    assert series.visible(50, 100).tolist() == m4(x, np.sin(x), 50).tolist()
