"""Maps: one scale in both directions, lines that go anywhere, gaps, and a page of their own."""

import re

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.report import Line, Map, Page
from ohmward.report.map import HEIGHT_PX, NEAR_PX, WIDTH_PX, area_of, thinned, to_px


def circle(radius=2.0, points=400):
    angle = np.linspace(0.0, 2 * np.pi, points)
    return Line(radius * np.cos(angle), radius * np.sin(angle), "circle")


def points_of(svg):
    """Points (n, 2) of each line."""
    texts = re.findall(r'<polyline points="([^"]+)"', svg)
    return [np.array([[float(v) for v in point.split(",")] for point in text.split()]) for text in texts]


def test_a_circle_is_drawn_round():
    wide = Line(np.array([-9.0, 9.0]), np.zeros(2), "wide")
    drawn = points_of(Map("Path", "x", "y", [wide, circle()]).svg())[1]
    across, down = np.ptp(drawn, axis=0)
    assert across == pytest.approx(down, abs=0.2)


def test_lines_lie_in_the_area_and_up_is_up():
    line = Line(np.array([0.0, 30.0]), np.array([0.0, 5.0]), "path")
    area = area_of([line])
    assert area.width * area.px_per_unit <= WIDTH_PX and area.height * area.px_per_unit <= HEIGHT_PX
    start, end = to_px(area, line.x, line.y)
    assert end[0] > start[0] and end[1] < start[1]
    assert (end - start)[0] / 30.0 == pytest.approx(-(end - start)[1] / 5.0)


def test_a_gap_splits_a_line_and_nothing_is_a_page_still():
    y = np.array([0.0, 1.0, np.nan, 1.0, 0.0])
    assert len(points_of(Map("Path", "x", "y", [Line(np.arange(5.0), y, "path")]).svg())) == 2
    nothing = Map("Path", "x", "y", [Line(np.full(3, np.nan), np.full(3, np.nan), "path")])
    assert points_of(nothing.svg()) == []
    assert points_of(Map("Path", "x", "y", []).svg()) == []


def test_points_that_look_like_one_are_left_out():
    points = np.column_stack([np.linspace(0.0, 10.0, 10001), np.zeros(10001)])
    kept = thinned(points)
    assert len(kept) == pytest.approx(10 / NEAR_PX, abs=2)
    assert np.diff(kept[:, 0]).max() < 1.01 * NEAR_PX


def test_a_map_is_a_block_of_a_page_and_a_page_of_its_own(tmp_path):
    drawn = Map("Path <of> a robot", "x [m]", "y [m]", [circle()])
    page = Page("drive").map(drawn).html()
    assert "Path &lt;of&gt; a robot" in page and "<svg" in page and "circle" in page
    drawn.save(tmp_path / "map.html")
    assert (tmp_path / "map.html").read_text(encoding="utf-8") == drawn.html()
    assert "<iframe" in drawn._repr_html_()


def test_a_line_needs_points_with_x_and_y_and_a_known_role():
    with pytest.raises(InputError, match="one length"):
        Line(np.zeros(3), np.zeros(2), "path")
    with pytest.raises(InputError, match="role"):
        Line(np.zeros(3), np.zeros(3), "path", "pink")  # type: ignore[arg-type]
