"""Results of [P], mean of three discharges with sensors of their own."""

from typing import Any

import numpy as np
import pytest

from ohmward_lab.reproduce import paper


@pytest.fixture(scope="module")
def lead_acid():
    return {row.quantity: row for row in paper.discharge("lead-acid").rows}


@pytest.fixture(scope="module")
def lfp():
    return {row.quantity: row for row in paper.discharge("lfp").rows}


def test_against_the_count_of_its_own_sensor_the_published_filter_is_as_good_as_printed(lead_acid, lfp):
    right = "T2RC + UKF from a right start, against the count: MAE"
    for rows, name in ((lead_acid, "sealed lead-acid 12 V 5 Ah"), (lfp, "LFP 12 V 6 Ah")):
        row = rows[f"{name}, {right}"]
        assert row.as_printed < 1.2 * row.printed


def test_against_the_truth_the_default_estimator_is_as_good(lead_acid, lfp):
    """It leaves room for errors that these simulated batteries do not have: a tenth of a point, of right starts."""
    for rows in (lead_acid, lfp):
        (row,) = [r for q, r in rows.items() if q.endswith("right start, against the truth: MAE")]
        assert row.default is not None and row.corrected is not None
        assert row.default < row.corrected + 0.1


def test_the_filter_on_the_RC_model_finds_back_from_twenty_points_off(lead_acid):
    found = {q: row.as_printed for q, row in lead_acid.items() if q.endswith("after 500 s")}
    assert len(found) == 2 and all(0.0 < left < 6.0 for left in found.values())


def test_the_count_is_off_by_no_more_than_its_sensor_allows(lead_acid):
    (row,) = [r for r in lead_acid.values() if r.printed == 83.0]
    assert row.corrected < 83.0


def test_the_flat_parts_of_the_LFP_curve_stand_beside_the_printed_ones():
    rows: dict[str, Any] = {row.quantity[-10:]: row for row in paper.open_circuit().rows if "rise" in row.quantity}
    assert [row.printed for row in rows.values()] == [0.024, 0.2]
    assert all(0.0 < row.as_printed < 0.2 for row in rows.values())


def test_the_hybrid_stands_among_the_methods():
    hybrid: list[Any] = [row for row in paper.comparison().rows if "hybrid" in row.quantity]
    assert len(hybrid) == 2 and all(0.0 < row.as_printed < 2.0 for row in hybrid)


def test_two_time_constants_leave_less_than_one():
    rows = {row.quantity.split(",")[0]: row for row in paper.relaxations().rows if "RMS" in row.quantity}
    single = rows["sealed lead-acid 12 V 5 Ah: one time constant"].corrected
    double = rows["sealed lead-acid 12 V 5 Ah: two time constants"].corrected
    assert single is not None and double is not None
    assert double < single


def test_the_nonlinear_fit_is_a_quarter_of_its_start_or_less():
    found = np.array([row.corrected for row in paper.fit().rows])
    assert (found[1::2] < 0.25 * found[::2]).all()


def test_the_resistance_at_100_Hz_is_that_of_the_battery():
    rows = [r for r in paper.pulse_test().rows if r.quantity.endswith("(default: true step)")]
    for row in rows:
        assert row.as_printed == pytest.approx(row.default, rel=0.05)
