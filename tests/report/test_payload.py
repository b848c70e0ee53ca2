"""What the browser gets is what the figure holds, to the precision of a screen."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from ohmward.report.figure import TIME, Band, Figure, Marker, Series, Span
from ohmward.report.payload import stack


def unpack(part, data, unit=1.0):
    return np.cumsum(part["x"]) / data["per_unit"] * unit


def test_samples_arrive_in_the_unit_of_the_axis_to_a_millionth_of_it():
    t = np.linspace(0.0, 7200.0, 900)
    y = 12 + np.sin(t / 100)
    data = stack([Figure("f", TIME, "V", [Series(t, y, "v")], markers=[Marker(1800.0, "m")], spans=[Span(0, 60, "s")])])
    (figure,) = data["figures"]
    (series,) = figure["series"]
    assert (data["x_label"], data["extent"]) == ("Time [min]", [0.0, 120.0])
    assert unpack(series, data, 60.0) == pytest.approx(t, abs=7200 / 1e6)
    assert series["y"] == pytest.approx(y, abs=np.ptp(y) / 1e4)
    assert figure["markers"][0]["x"] == 30.0
    assert (figure["spans"][0]["from"], figure["spans"][0]["to"]) == (0.0, 1.0)


@settings(max_examples=50)
@given(hnp.arrays(float, st.integers(1, 50), elements=st.sampled_from([0.0, 1e-9, 1.0, 1.0 + 1e-9, 7.0, 1e3])))
def test_samples_at_equal_times_stay_separate_samples(x):
    data = stack([Figure("f", "x", "y", [Series(np.sort(x), np.arange(x.size), "s")])])
    steps = data["figures"][0]["series"][0]["x"]
    assert all(isinstance(d, int) for d in steps)
    assert all(d > 0 for d in steps[1:])


def test_numbers_are_short_and_gaps_are_null():
    y = np.array([1 / 3, np.nan, np.inf, 2.0])
    (series,) = stack([Figure("f", "x", "y", [Series(np.arange(4.0), y, "s")])])["figures"][0]["series"]
    assert json.dumps(series["y"]) == "[0.3333, null, null, 2]"


def test_a_log_axis_keeps_the_digits_of_small_values():
    y = np.array([1.0, 1 / 3e4, 1 / 3e8])
    figure = Figure("f", "x", "y", [Series(np.arange(3.0), y, "s")], [Band(np.arange(3.0), y, 2 * y, "b")], log_y=True)
    (data,) = stack([figure])["figures"]
    assert data["series"][0]["y"] == pytest.approx(y, rel=5e-5)
    assert data["bands"][0]["low"] == pytest.approx(y, rel=5e-5)
    assert data["series"][0]["decimals"] is None


def test_the_band_of_the_payload_contains_the_band():
    t = np.arange(100_000.0)
    low = np.random.default_rng(0).normal(size=t.size)
    data = stack([Figure("f", "x", "y", bands=[Band(t, low, low + 1, "b")])])
    (band,) = data["figures"][0]["bands"]
    x, lowest, highest = unpack(band, data), np.array(band["low"]), np.array(band["high"])
    assert (np.interp(t, x, lowest) <= low + 1e-3).all()
    assert (np.interp(t, x, highest) >= low + 1 - 1e-3).all()


def test_colours_follow_the_roles():
    x = np.arange(2.0)
    series = [Series(x, x, "a"), Series(x, x, "b", role="estimate"), Series(x, x, "c", role="background")]
    (figure,) = stack([Figure("f", "x", "y", series, [Band(x, x, x, "d")])])["figures"]
    assert [s["colour"] for s in figure["series"]] == ["orange", "blue", "grey"]
    assert figure["bands"][0]["colour"] == "blue"
