import numpy as np
import pytest

from ohmward.battery.soc.sample import SocEstimate
from ohmward.battery.soc.score import score, soc_scores, voltage_errors_V
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


def test_no_voltage_no_errors():
    assert not voltage_errors_V(LOG, estimates(TRUTH, TRUTH)).size
    assert voltage_errors_V(LOG, estimates(TRUTH, TRUTH, 12.1)) == pytest.approx(0.1)


def test_the_interval_score_of_a_band_is_its_width_and_40_times_the_distance_beyond_it():
    # half width 1.96 * 0.01; the truth is inside in the first row, 0.03 - 0.0196 beyond in the second
    found = score(np.array([0.5, 0.5]), np.array([0.505, 0.53]), np.array([0.01, 0.01]))
    half = 1.959964 * 0.01
    assert found and found.interval_95 == pytest.approx(2 * half + 0.5 * 40 * (0.03 - half))
    assert found.error_over_std == pytest.approx(np.sqrt((0.5**2 + 3.0**2) / 2))


def test_the_interval_score_is_least_for_the_right_sigma():
    rng = np.random.default_rng(0)
    error = 0.02 * rng.standard_normal(50_000)
    scores = [score(error, 0 * error, np.full(error.size, std)) for std in (0.01, 0.015, 0.02, 0.027, 0.04)]
    assert int(np.argmin([found.interval_95 for found in scores if found])) == 2
    assert scores[2] and scores[2].error_over_std == pytest.approx(1.0, abs=0.01)


def test_an_error_of_more_than_four_sigma_is_confidently_wrong():
    found = score(np.zeros(4), np.array([0.01, 0.039, 0.041, -0.05]), np.full(4, 0.01))
    assert found and found.confidently_wrong == 0.5


def test_without_a_sigma_there_is_no_score_of_the_band():
    found = score(np.zeros(4), np.ones(4))
    assert found and np.isnan([found.coverage_95, found.interval_95, found.error_over_std]).all()
