"""Pictures by matplotlib: axes with what the figures hold, files that are what their names say."""

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.report import TIME, Band, Figure, Line, Map, Marker, Plot, Series, Span

pytest.importorskip("matplotlib")

TIME_S = 60.0 * np.arange(200)
SOC = np.linspace(90.0, 20.0, 200)
FIGURES = [
    Figure(
        "Charge",
        TIME,
        "SoC [%]",
        [Series(TIME_S, SOC, "estimate", role="estimate"), Series(TIME_S, SOC + 1, "reference", "dashed", "reference")],
        [Band(TIME_S, SOC - 2, SOC + 2, "95 % band")],
        [Marker(600.0, "full")],
        [Span(60.0, 120.0, "rest"), Span(180.0, 240.0, "rest")],
    ),
    Figure("Voltage", TIME, "V", [Series(TIME_S, SOC, "V"), Series(TIME_S, SOC, "A", axis="right")], right_label="A"),
]
BEGINS = {".svg": b"<?xml", ".pdf": b"%PDF-", ".png": b"\x89PNG"}


@pytest.fixture
def axes():
    pyplot = pytest.importorskip("matplotlib.pyplot")
    pyplot.switch_backend("agg")
    canvas = Plot("Day", FIGURES).to_matplotlib()
    yield canvas.axes
    pyplot.close(canvas)


def test_each_figure_has_axes_with_its_samples(axes):
    charge, voltage, current = axes
    assert [ax.get_title(loc="left") for ax in (charge, voltage)] == ["Charge", "Voltage"]
    estimate = charge.lines[0]
    assert estimate.get_xdata() == pytest.approx(TIME_S / 3600.0) and estimate.get_ydata() == pytest.approx(SOC)
    assert charge.get_ylabel() == "SoC [%]" and voltage.get_xlabel() == "Time [h]" and current.get_ylabel() == "A"


def test_the_legend_names_spans_of_one_label_once(axes):
    words = [text.get_text() for text in axes[0].get_legend().get_texts()]
    assert sorted(words) == ["95 % band", "estimate", "full", "reference", "rest"]


def test_right_and_left_axis_share_a_legend(axes):
    assert [text.get_text() for text in axes[1].get_legend().get_texts()] == ["A", "V"]


@pytest.mark.parametrize("ending", [*BEGINS, ".PNG"])
def test_a_picture_is_what_its_name_says(ending, tmp_path):
    path = tmp_path / f"day{ending}"
    Plot("Day", FIGURES).save(path)
    assert path.read_bytes().startswith(BEGINS[ending.lower()])
    assert list(tmp_path.iterdir()) == [path]


def test_a_map_has_one_scale():
    drawn = Map("Path", "Forward [m]", "Left [m]", [Line(np.arange(5.0), np.zeros(5), "path")]).to_matplotlib()
    assert drawn.axes[0].get_aspect() == 1.0 and drawn.axes[0].get_xlabel() == "Forward [m]"
    pytest.importorskip("matplotlib.pyplot").close(drawn)


@pytest.mark.parametrize("name", ["run.jpg", "run"])
def test_another_ending_is_refused(name, tmp_path):
    with pytest.raises(InputError, match=rf"{name}: name a page .html, and a picture .svg or .pdf or .png"):
        Plot("Day", FIGURES).save(tmp_path / name)
    assert not list(tmp_path.iterdir())
