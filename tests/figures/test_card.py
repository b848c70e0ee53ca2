"""What a notebook shows of a log, a battery, a robot and a run: a few true lines and a picture that is well-formed."""

import math
from html.parser import HTMLParser
from xml.etree import ElementTree

import numpy as np
import pytest

from ohmward.battery.chemistries import generic_battery
from ohmward.battery.soc.comparison import compare
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.errors import InputError
from ohmward.figures.plot import card
from ohmward.logs import DriveLog, Log
from ohmward.logs.table import Note
from ohmward.report import TIME, Figure, Line, Map, Series
from ohmward.report.card import card as html_card
from ohmward.traction import RLMA
from ohmward.traction.odometry.estimator import Odometry

T = 60
TIME_S = 1.0 * np.arange(T)
BATTERY = generic_battery("lfp", 12.0, n_series=4)
LOG = Log(
    "day", TIME_S, np.full(T, -3.0), np.linspace(13.2, 13.0, T),
    start_unix_s=1_700_000_000.0, notes=(Note("two gaps", "warning"), Note("read as A")),
)  # fmt: skip


class Text(HTMLParser):
    """The texts of the cells of an HTML table, and of what is about it."""

    def __init__(self, html: str):
        super().__init__()
        self.texts: list[str] = []
        self.feed(html)

    def handle_data(self, data):
        self.texts.append(data)


def facts(html):
    texts = Text(html).texts
    return texts[0], dict(zip(texts[1::2], texts[2::2], strict=False))


def polyline(html):
    svg = ElementTree.fromstring(html[html.index("<svg") : html.index("</svg>") + len("</svg>")])
    points = next(element for element in svg.iter() if element.tag == "polyline").attrib["points"]
    return np.array([[float(v) for v in pair.split(",")] for pair in points.split()])


def test_a_log_shows_what_is_in_it():
    title, found = facts(LOG._repr_html_())
    assert title == "day"
    assert found["begins"] == "2023-11-14 22:13:20 UTC"
    assert found["samples"] == "60 in 59 s, every 1 s"
    assert found["current"] == "-3 to -3 A, > 0 charges"
    assert found["charge"] == "-0.0492 Ah at the end, 0.0492 Ah in and out"
    assert found["warnings"] == "two gaps"


def test_a_run_shows_its_end_with_its_band():
    run = SocEstimator(BATTERY, 0.6, lowering="python").run(LOG)
    _, found = facts(run._repr_html_())
    assert found["SoC at the end"] == f"{100 * run.soc[-1]:.1f} % ± {196 * run.soc_std[-1]:.1f} % (95 %)"
    assert found["in words"] == run.explain().sentence


def test_a_battery_shows_how_well_it_is_known():
    _, found = facts(BATTERY._repr_html_())
    assert found["cells"] == "4 in series, lfp"
    assert found["capacity"].startswith("12.0 ± ") and found["capacity"].endswith(" Ah (95 %)")


def test_a_drive_a_robot_and_a_path_have_cards():
    wheels = np.hstack([np.full((T, 2), 2.0), np.full((T, 2), math.nan)])
    drive = DriveLog("drive", TIME_S, wheels, np.full((T, 2), math.nan), yaw_rate_rad_s=np.zeros(T))
    _, found = facts(card(drive))
    assert found["wheels"] == "4, 2 of them driven" and found["motor current"] == "not measured"
    assert facts(card(RLMA))[1]["wheels"] == "4, driven: front left, front right"
    assert facts(card(Odometry("rlma", "python").run(drive)))[1]["distance"].endswith(" m")


def test_something_else_is_refused():
    with pytest.raises(InputError, match="a card shows a log, a battery, a robot or a run, got dict"):
        card({})


def test_texts_are_escaped():
    assert "<script>" not in html_card("<script>", {"a": "<script>"})


def test_a_line_fills_the_picture_from_its_lowest_to_its_highest_value():
    points = polyline(html_card("x", {}, Figure("x", TIME, "V", [Series(TIME_S, TIME_S**2, "v")])))
    assert points[0] == pytest.approx([0.0, 90.0]) and points[-1] == pytest.approx([320.0, 0.0])


def test_a_gap_splits_a_line():
    values = np.where(TIME_S == 30.0, np.nan, TIME_S)
    html = html_card("x", {}, Figure("x", TIME, "V", [Series(TIME_S, values, "v")]))
    assert html.count("<polyline") == 2


def test_a_path_keeps_its_proportions():
    """A square of 1 m: as high as the picture, and no wider than high."""
    corners = np.array([[0, 1, 1, 0], [0, 0, 1, 1]], dtype=float)
    points = polyline(html_card("x", {}, Map("x", "m", "m", [Line(corners[0], corners[1], "path")])))
    assert np.ptp(points, axis=0) == pytest.approx([90.0, 90.0])


def test_a_comparison_shows_each_estimator_and_its_error():
    compared = compare(BATTERY, LOG, ["coulomb", "ocv"], truth=np.full(T, 0.9), initial_soc=0.9)
    _, found = facts(compared._repr_html_())
    assert found["log"] == "day"
    assert found["coulomb"].startswith("RMSE 0.") and "truth in the 95 % band" in found["coulomb"]
    assert list(compared.to_pandas().index) == sorted(
        ("coulomb", "ocv"), key=lambda n: compared.figures()[n]["soc_rmse"]
    )
    _, without = facts(compare(BATTERY, LOG, ["coulomb"])._repr_html_())
    assert without["coulomb"].endswith("at the end") and "RMSE" not in without["coulomb"]


@pytest.mark.parametrize("truth", [np.zeros(3), "soc"])
def test_a_truth_that_is_not_there_is_refused(truth):
    with pytest.raises(InputError, match=r"truth must have|no column 'soc'"):
        compare(BATTERY, LOG, ["coulomb"], truth=truth)
