import math

import pytest

from cli.examples import MODEL
from ohmward.battery.soc.sample import SocSample
from ohmward.filters.belief import unpack
from ohmward_lab.published.registry import GivenStart

FIRST = SocSample(0.0, 0.0, float(MODEL.ocv.mean_V(0.9, 25.0)), math.nan)


def test_a_start_that_the_first_voltage_contradicts_is_taken_as_it_is():
    assert float(unpack(GivenStart(MODEL).init(FIRST, 0.5).belief).mean[0]) == 0.5


def test_no_start_comes_from_the_first_voltage():
    assert float(unpack(GivenStart(MODEL).init(FIRST).belief).mean[0]) == pytest.approx(0.9, abs=0.01)
