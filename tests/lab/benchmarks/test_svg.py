"""The picture is XML and shows the figure's numbers at the right places."""

import re
from xml.etree import ElementTree

import numpy as np
import pytest

from ohmward.report import TIME, Band, Figure, Marker, Series, Span
from scripts import script

svg = script("svg")
to_svg = svg.to_svg

X = np.arange(5.0)
SVG = "{http://www.w3.org/2000/svg}"


def parse(*figures, **options):
    return ElementTree.fromstring(to_svg(*figures, **options))


def texts(root):
    return [t.text for t in root.iter(f"{SVG}text")]


def paths(root, cls):
    return [p.get("d") for p in root.findall(f"{SVG}svg/{SVG}path") if p.get("class") == cls]


def vertices(path):
    """Absolute corners of a path made of M, l, h, v, z."""
    at, corners = np.zeros(2), []
    for command, numbers in re.findall(r"([Mlhvz])([^Mlhvz]*)", path):
        values = [float(v) for v in re.findall(r"-?[\d.]+(?:e-?\d+)?", numbers)]
        if command in "hv":
            at = at + np.array([values[0], 0.0] if command == "h" else [0.0, values[0]])
            corners.append(at)
            continue
        for step in np.reshape(values, (-1, 2)):
            at = step if command == "M" else at + step
            corners.append(at)
    return np.array(corners)


def test_the_picture_is_xml_and_names_everything():
    figure = Figure(
        "A & <B>",
        TIME,
        "V [V]",
        [Series(X, X, "left <1>"), Series(X, -X, "right", axis="right")],
        [Band(X, X - 1, X + 1, "95 %")],
        [Marker(2.0, "spike")],
        [Span(1.0, 2.0, "rest"), Span(3.0, 4.0, "rest")],
        right_label="I [A]",
    )
    shown = texts(parse(figure))
    for text in ("A & <B>", "left <1>", "right", "95 %", "spike", "V [V]", "I [A]", "Time [s]", "−4"):
        assert text in shown
    assert shown.count("rest") == 1


def test_a_line_runs_through_its_samples():
    y = np.array([0.0, 3.0, 1.0, 4.0, 2.0])
    root = parse(Figure("f", "x", "y", [Series(X, y, "s")], y_limits=(0, 4), height_px=200), width_px=800)
    (path,) = paths(root, "line blue")
    corners = vertices(path)
    width = float(next(s for s in root.iter(f"{SVG}svg") if s is not root).get("width", "0"))
    assert corners[:, 0] == pytest.approx(X / 4 * width, abs=0.11)
    assert corners[:, 1] == pytest.approx(200 - y * 50, abs=0.11)


def test_ticks_of_a_log_axis_are_powers_of_ten_or_in_a_short_range_their_multiples():
    def labels(low: float, high: float) -> list[str]:
        return [label for _, label in svg.Scale(low, high, 0.0, 1.0, log=True).ticks(6)]

    assert labels(5e-6, 200.0) == ["1e−5", "1e−4", "0.001", "0.01", "0.1", "1", "10", "100"]
    assert labels(1.5, 60.0) == ["2", "5", "10", "20", "50"]


def test_a_log_axis_puts_decades_at_equal_distances():
    root = parse(Figure("f", "x", "y", [Series(X, 10.0**X, "s")], log_y=True, height_px=200))
    steps = np.diff(vertices(paths(root, "line blue")[0])[:, 1])
    assert steps == pytest.approx(np.full(4, steps[0]), abs=0.2)
    assert {"1", "10", "100", "1000", "10000"} <= set(texts(root))


def test_a_gap_splits_the_line_and_a_lone_sample_is_a_dot():
    y = np.array([0.0, 1.0, np.nan, 1.0, np.nan])
    (path,) = paths(parse(Figure("f", "x", "y", [Series(X, y, "s")])), "line blue")
    assert path.count("M") == 2
    assert path.endswith("h0")


def test_steps_hold_and_dots_are_single():
    series = [Series(X, X, "a", "step"), Series(X, X, "b", "points"), Series(X, X, "c", "dashed")]
    root = parse(Figure("f", "x", "y", series))
    corners = vertices(paths(root, "line blue")[0])
    assert (np.diff(corners, axis=0) == 0).any(axis=1).all()
    assert paths(root, "dots orange")[0].count("h0") == 5
    assert len(paths(root, "line dashed green")) == 1


def test_a_band_goes_out_along_the_top_and_back_along_the_bottom():
    root = parse(Figure("f", "x", "y", bands=[Band(X, X, X + 1, "b")], y_limits=(0, 5), height_px=100))
    (path,) = paths(root, "area blue")
    assert vertices(path)[:, 1] == pytest.approx([80, 60, 40, 20, 0, 20, 40, 60, 80, 100], abs=0.11)


def test_panels_of_a_stack_share_x_and_do_not_overlap():
    one = Figure("one", TIME, "a", [Series(X, X, "s")])
    two = Figure("two", TIME, "b", [Series(X + 4, X, "s", axis="right")], right_label="r")
    panels = [s for s in parse(one, two).iter(f"{SVG}svg") if s.get("y")]
    tops = [float(p.get("y", "0")) for p in panels]
    assert panels[0].get("width") == panels[1].get("width")
    assert tops[1] > tops[0] + float(panels[0].get("height", "0"))
    assert vertices(paths(parse(one, two), "line blue")[0])[-1, 0] == pytest.approx(
        float(panels[0].get("width", "0")) / 2, abs=0.11
    )


def test_a_picture_of_a_million_samples_is_small_and_the_same_every_time():
    t = np.arange(1e6)
    figure = Figure("f", TIME, "y", [Series(t, np.random.default_rng(0).normal(size=t.size), "s")])
    assert to_svg(figure) == to_svg(figure)
    assert len(to_svg(figure)) < 60_000


@pytest.mark.parametrize("log_y", [False, True])
def test_no_data_is_an_empty_picture(log_y):
    parse(Figure("f", TIME, "y", [Series(np.empty(0), np.empty(0), "s")], log_y=log_y))
    parse(Figure("f", TIME, "y", [Series(X, np.full(5, np.nan), "s")], log_y=log_y))


def test_a_long_legend_takes_more_lines():
    series = [Series(X, X, f"a rather long name {i}") for i in range(12)]
    wide, narrow = (parse(Figure("f", "x", "y", series), width_px=w) for w in (3000, 500))
    heights = [float(root.get("viewBox", "").split()[3]) for root in (wide, narrow)]
    assert heights[1] > heights[0] + 40
