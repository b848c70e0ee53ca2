"""Figures in a notebook and as a file."""

import sys
from html import unescape

import numpy as np

from ohmward.report import Figure, Plot, Series

X = np.arange(10.0)
PLOT = Plot("Two & one", [Figure("a", "x [m]", "y", [Series(X, X, "line")]), Figure("b", "x [m]", "y", height_px=100)])


def test_a_terminal_shows_a_line():
    assert repr(PLOT) == "Plot('Two & one'; show it in a notebook, or save('page.html'))"


def test_a_notebook_shows_the_page_in_a_frame_that_is_high_enough():
    shown = PLOT._repr_html_()
    assert shown.startswith('<iframe srcdoc="') and shown.endswith("</iframe>")
    page, style = shown.removeprefix('<iframe srcdoc="').split('" style="')
    assert unescape(page) == PLOT.html()
    height_px = int(style.split("height:")[1].split("px")[0])
    assert height_px > 260 + 100


def test_a_notebook_also_stores_a_picture_for_where_no_page_is_shown():
    picture = PLOT._repr_png_() or b""
    assert picture.startswith(b"\x89PNG\r\n")
    width, height = (int.from_bytes(picture[start : start + 4]) for start in (16, 20))
    assert width == 800 and height > 360


def test_a_notebook_without_matplotlib_shows_the_page_alone(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert PLOT._repr_png_() is None


def test_a_file_is_the_same_page(tmp_path):
    PLOT.save(tmp_path / "plot.html")
    text = (tmp_path / "plot.html").read_text(encoding="utf-8")
    assert text == PLOT.html()
    assert "<title>Two &amp; one</title>" in text
