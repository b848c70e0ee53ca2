"""What the browser gets is what the figure holds, to the precision of a screen."""

import base64
import zlib

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from ohmward.report.figure import TIME, Band, Figure, Marker, Series, Span
from ohmward.report.payload import GAP, stack


def unpack(number, data, unit=1.0):
    """The column as the browser reads it, from the description in packed.py."""
    column = data["columns"][number]
    planes = np.frombuffer(zlib.decompress(base64.b64decode(column["data"])), np.uint8).reshape(4, -1)
    words = (planes.astype(np.int64).T * [1, 2**8, 2**16, 2**24]).sum(axis=1).astype(np.uint32)
    if "per_unit" not in column:
        return words.view(np.float32).astype(float) * unit
    steps = words.view(np.int32).astype(np.int64)
    values = column["first"] + np.cumsum(np.where(steps == GAP, 0, steps))
    return np.where(steps == GAP, np.nan, values / column["per_unit"] * unit)


def test_samples_arrive_in_the_unit_of_the_axis_to_a_hundred_millionth_of_it():
    t = np.linspace(0.0, 7200.0, 900)
    y = 12 + np.sin(t / 100)
    data = stack([Figure("f", TIME, "V", [Series(t, y, "v")], markers=[Marker(1800.0, "m")], spans=[Span(0, 60, "s")])])
    (figure,) = data["figures"]
    (series,) = figure["series"]
    assert (data["x_label"], data["extent"]) == ("Time [min]", [0.0, 120.0])
    assert unpack(series["x"], data, 60.0) == pytest.approx(t, abs=7200 / 1e8)
    assert unpack(series["y"][0], data) == pytest.approx(y, abs=np.ptp(y) / 1e5)
    assert figure["markers"][0]["x"] == 30.0
    assert (figure["spans"][0]["from"], figure["spans"][0]["to"]) == (0.0, 1.0)


def test_every_one_of_a_million_samples_is_in_the_page():
    rng = np.random.default_rng(0)
    t = np.cumsum(rng.exponential(0.1, 1_000_000))
    y = rng.standard_normal(t.size)
    y[rng.random(t.size) < 0.1] = np.nan
    data = stack([Figure("f", "t [s]", "V", [Series(t, y, "v")], [Band(t, y - 1, y + 1, "b")])])
    series, band = data["figures"][0]["series"][0], data["figures"][0]["bands"][0]
    np.testing.assert_allclose(unpack(series["x"], data), t, atol=t[-1] / 1e8)
    np.testing.assert_allclose(unpack(series["y"][0], data), y, atol=1e-4)
    np.testing.assert_allclose(unpack(band["y"][1], data), y + 1, atol=1e-4)
    assert band["x"] == series["x"]


@given(hnp.arrays(float, st.integers(1, 40), elements=st.floats(-1e9, 1e9) | st.just(np.nan)))
def test_no_value_is_lost_beside_a_spike(y):
    data = stack([Figure("f", "x", "y", [Series(np.arange(float(y.size)), y, "s")])])
    span = np.ptp(y[np.isfinite(y)]) if np.isfinite(y).any() else 0.0
    size = np.abs(y) / 1e5
    found = unpack(data["figures"][0]["series"][0]["y"][0], data)
    assert (np.isnan(found) == np.isnan(y)).all()
    assert (np.isnan(y) | (abs(found - y) <= np.maximum(span / 1e3, size) + 1e-9)).all()


def test_a_column_that_several_series_show_is_packed_once():
    t = np.arange(100.0)
    data = stack([Figure("a", "t", "y", [Series(t, t**2, "s")]), Figure("b", "t", "y", [Series(t, -t, "s")])])
    assert len(data["columns"]) == 3


@example(np.array([1.0, 1.0 + 1e-9, 1.0 + 1e-9]))
@settings(max_examples=50)
@given(hnp.arrays(float, st.integers(1, 50), elements=st.sampled_from([0.0, 1e-9, 1.0, 1.0 + 1e-9, 7.0, 1e3])))
def test_samples_at_equal_times_stay_separate_samples(x):
    data = stack([Figure("f", "x", "y", [Series(np.sort(x), np.arange(x.size), "s")])])
    assert (np.diff(unpack(data["figures"][0]["series"][0]["x"], data)) > 0).all()


def test_recorded_decimals_arrive_exactly_and_gaps_as_gaps():
    y = np.array([13.779, np.nan, np.inf, 13.783])
    data = stack([Figure("f", "x", "y", [Series(np.arange(4.0), y, "s")])])
    (series,) = data["figures"][0]["series"]
    assert str(unpack(series["y"][0], data).tolist()) == "[13.779, nan, nan, 13.783]"
    assert data["columns"][series["y"][0]]["extremes"] == [13.779, 13.783]


def test_a_log_axis_keeps_the_digits_of_small_values():
    y = np.array([1.0, 1 / 3e4, 1 / 3e8])
    figure = Figure("f", "x", "y", [Series(np.arange(3.0), y, "s")], [Band(np.arange(3.0), y, 2 * y, "b")], log_y=True)
    data = stack([figure])
    (drawn,) = data["figures"]
    assert unpack(drawn["series"][0]["y"][0], data) == pytest.approx(y, rel=1e-7)
    assert unpack(drawn["bands"][0]["y"][0], data) == pytest.approx(y, rel=1e-7)
    assert drawn["series"][0]["decimals"] is None


def test_colours_follow_the_roles():
    x = np.arange(2.0)
    series = [Series(x, x, "a"), Series(x, x, "b", role="estimate"), Series(x, x, "c", role="background")]
    (figure,) = stack([Figure("f", "x", "y", series, [Band(x, x, x, "d")])])["figures"]
    assert [s["colour"] for s in figure["series"]] == ["orange", "blue", "grey"]
    assert figure["bands"][0]["colour"] == "blue"


def test_the_line_of_a_truth_is_drawn_last_and_keeps_its_colour():
    x = np.arange(2.0)
    series = [Series(x, x, "true", "dashed", "reference"), Series(x, x, "estimated", role="estimate")]
    (figure,) = stack([Figure("f", "x", "y", series)])["figures"]
    assert [(s["label"], s["colour"]) for s in figure["series"]] == [("estimated", "blue"), ("true", "ink")]
