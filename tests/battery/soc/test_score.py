import numpy as np
import pytest

from ohmward.battery.soc.sample import SocEstimate
from ohmward.battery.soc.score import soc_scores, voltage_score
from ohmward.logs import Log

TIME_S = np.arange(0.0, 7200.0, 10.0)
LOG = Log("x", TIME_S, 0.0 * TIME_S, np.full(TIME_S.size, 12.0))
TRUTH = np.full(TIME_S.size, 0.5)


def estimates(soc, std, voltage_V=np.nan) -> SocEstimate:
    fields = dict.fromkeys(SocEstimate._fields, np.full(TIME_S.size, np.nan))
    voltage = np.full(TIME_S.size, voltage_V)
    return SocEstimate(**(fields | {"soc": soc, "soc_std": std, "voltage_V": voltage}))


def test_coverage_is_that_of_1_96_sigma():
    # an error of 0.02 all along: outside the band for the first quarter of the log, inside for the rest
    std = np.where(TIME_S < 1800, 0.0101, 0.0103)
    figures = soc_scores(LOG, estimates(TRUTH + 0.02, std), TRUTH)
    assert figures["coverage_95"] == pytest.approx(0.75)
    assert figures["coverage_95_after_1h"] == 1.0


def test_the_first_hour_is_left_out():
    soc = TRUTH + np.where(TIME_S < 3600, 0.1, -0.01)
    figures = soc_scores(LOG, estimates(soc, 0.1 * TRUTH), TRUTH)
    assert figures["soc_max_error"] == pytest.approx(0.1)
    assert figures["soc_max_error_after_1h"] == pytest.approx(0.01)
    assert figures["soc_error_mean_after_1h"] == pytest.approx(-0.01)
    assert figures["soc_rmse"] == pytest.approx(np.sqrt((0.01 + 0.0001) / 2))


def test_no_truth_no_figures():
    assert set(soc_scores(LOG, estimates(TRUTH, TRUTH), None).values()) == {None}


def test_no_voltage_no_score():
    assert voltage_score(LOG, estimates(TRUTH, TRUTH)) is None
    found = voltage_score(LOG, estimates(TRUTH, TRUTH, 12.1))
    assert found and found.mean == pytest.approx(0.1)
