"""Results of [P], mean of three discharges with sensors of their own."""

import numpy as np
import pytest

from ohmward_lab.reproduce import paper_identification, paper_soc


@pytest.fixture(scope="module")
def lead_acid():
    return {row.quantity: row for row in paper_soc.discharge("lead-acid").rows}


@pytest.fixture(scope="module")
def lfp():
    return {row.quantity: row for row in paper_soc.discharge("lfp").rows}


def test_against_the_count_of_its_own_sensor_the_published_filter_looks_as_good_as_printed(lead_acid, lfp):
    right = "T2RC + UKF from a right start, against the count: MAE"
    assert lead_acid[f"sealed lead-acid 12 V 5 Ah, {right}"].corrected < 0.6
    assert lfp[f"LFP 12 V 6 Ah, {right}"].corrected < lfp[f"LFP 12 V 6 Ah, {right}"].printed


def test_against_the_truth_the_default_estimator_is_better(lead_acid, lfp):
    for rows in (lead_acid, lfp):
        (row,) = [r for q, r in rows.items() if q.endswith("against the truth: MAE")]
        assert row.default is not None and row.corrected is not None
        assert row.default < 0.75 * row.corrected


def test_two_time_constants_leave_less_than_one():
    rows = {row.quantity.split(",")[0]: row for row in paper_identification.relaxations().rows if "RMS" in row.quantity}
    single = rows["sealed lead-acid 12 V 5 Ah: one time constant"].corrected
    double = rows["sealed lead-acid 12 V 5 Ah: two time constants"].corrected
    assert single is not None and double is not None
    assert double < 0.8 * single


def test_the_nonlinear_fit_is_a_tenth_of_its_start():
    found = np.array([row.corrected for row in paper_identification.fit().rows])
    assert (found[1::2] < 0.2 * found[::2]).all()


def test_the_resistance_at_100_Hz_is_that_of_the_battery():
    rows = [r for r in paper_identification.pulse_test().rows if r.quantity.endswith("(default: true step)")]
    for row in rows:
        assert row.as_printed == pytest.approx(row.default, rel=0.05)
