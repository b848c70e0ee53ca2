"""Variance of a capacity that a part can show, from its anchors and the axis of its curve."""

import pytest

from ohmward.battery.learning.solve import capacity_error2
from ohmward.battery.soc.anchor_rule import SocAnchor

FULL, EMPTY = SocAnchor(0, 1.0, 0.01), SocAnchor(9, 0.0, 0.02)


@pytest.mark.parametrize(
    ("anchors", "error2"),
    [
        ((), 2 * 0.05**2 / 0.5**2),
        ((FULL, FULL), 2 * 0.05**2 / 0.5**2),
        ((FULL, EMPTY), 0.01**2 + 0.02**2),
        ((FULL, FULL, EMPTY), 0.01**2 + 0.02**2),
    ],
)
def test_two_events_or_two_places_of_the_curve_show_the_capacity(anchors, error2):
    assert capacity_error2(0.05, anchors, 0.5) == pytest.approx(error2, rel=1e-12)
