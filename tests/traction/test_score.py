"""Figures against a truth, from errors that are known."""

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.traction import RLMA, ROBOTINO
from ohmward.traction.score import DriveTruth, score_drive, true_slip
from ohmward.traction.speed_observer.estimate import SlipEstimate

T = 1000
RADIUS = RLMA.wheel.radius_m


def estimates(speed, rim, slip, robot=RLMA, **others):
    """Estimates (T, ...) of one speed, one speed of all rims and one slip."""
    wheels = np.ones((T, robot.driven))
    blank = dict.fromkeys(SlipEstimate._fields, np.zeros(T)) | {"radius_ratio": np.ones(T)}
    known = {
        "speed_m_s": speed * np.ones(T),
        "speed_std_m_s": 0.01 * np.ones(T),
        "wheel_speed_rad_s": rim / robot.wheel.radius_m * wheels,
        "slip_speed_m_s": slip * wheels,
        "slip_speed_std_m_s": 0.01 * wheels,
        "slip_ratio": slip / rim * wheels,
        "slipping": 0 * wheels,
    }
    return SlipEstimate(**(blank | known | others))


def test_errors_that_are_known():
    score = score_drive(RLMA, estimates(0.9, 1.0, 0.1), DriveTruth(0.88 * np.ones(T)))
    assert score.speed_rmse_m_s == pytest.approx(0.02)
    assert score.speed_max_error_m_s == pytest.approx(0.02)
    assert score.slip_rmse == pytest.approx(0.02)
    assert (score.speed_coverage_95, score.coverage_95) == (0.0, 0.0)
    assert score.samples == T


def test_a_band_that_is_honest_covers_95_percent():
    error = 0.01 * np.random.default_rng(1).standard_normal(T)
    score = score_drive(RLMA, estimates(0.9, 1.0, 0.1), DriveTruth(0.9 + error))
    assert score.speed_coverage_95 == pytest.approx(0.95, abs=0.02)
    assert score.coverage_95 == pytest.approx(0.95, abs=0.02)


def test_alarms_are_judged_by_the_allowed_slip():
    # allowed: 0.03 + 0.05 * 1.0 = 0.08 m/s; clearly beyond: 0.16
    true_speed = np.repeat([0.93, 0.9, 0.8], [400, 100, 500])
    alarm = np.zeros((T, 2))
    alarm[:40] = alarm[600:] = 1.0
    score = score_drive(RLMA, estimates(0.9, 1.0, 0.1, slipping=alarm), DriveTruth(true_speed))
    assert score.false_alarm_rate == pytest.approx(0.1)
    assert score.detection_rate == pytest.approx(0.8)


def test_what_did_not_happen_has_no_rate():
    score = score_drive(RLMA, estimates(0.0, 0.01, 0.0), DriveTruth(np.zeros(T)))
    assert np.isnan(score.detection_rate) and np.isnan(score.slip_rmse)
    assert score.false_alarm_rate == 0.0


def test_the_yaw_rate_moves_the_centres_of_the_wheels():
    truth = DriveTruth(np.ones(T), yaw_rate_rad_s=2.0 * np.ones(T))
    slip = true_slip(RLMA, estimates(1.0, 1.0, 0.0), truth)
    half = RLMA.places[0].y_m
    assert slip.speed_m_s[0] == pytest.approx([2.0 * half, -2.0 * half])


def test_a_known_ratio_gives_the_slip_speed():
    driving = DriveTruth(0.8 * np.ones(T), slip_ratio=0.2 * np.ones((T, 2)))
    assert true_slip(RLMA, estimates(0.8, 1.0, 0.2), driving).speed_m_s == pytest.approx(0.2)
    braking = DriveTruth(1.0 * np.ones(T), slip_ratio=-0.2 * np.ones((T, 2)))
    assert true_slip(RLMA, estimates(1.0, 0.8, -0.2), braking).speed_m_s == pytest.approx(-0.2)


def test_the_rim_turns_on_the_radius_that_was_estimated():
    e = estimates(0.9, 1.0, 0.1, radius_ratio=np.full(T, 0.9))
    assert true_slip(RLMA, e, DriveTruth(0.9 * np.ones(T))).speed_m_s == pytest.approx(0.0)


def test_samples_without_a_truth_are_left_out():
    truth = np.full(T, np.nan)
    truth[7] = 0.9
    score = score_drive(RLMA, estimates(0.9, 1.0, 0.1), DriveTruth(truth))
    assert (score.samples, score.speed_rmse_m_s, score.coverage_95) == (1, 0.0, 1.0)


def test_a_robot_that_moves_sideways_needs_its_lateral_speed():
    e = estimates(0.0, 0.1, 0.0, ROBOTINO)
    assert np.isnan(score_drive(ROBOTINO, e, DriveTruth(np.zeros(T))).slip_rmse)
    known = DriveTruth(np.zeros(T), np.zeros(T), np.zeros(T))
    assert np.isfinite(score_drive(ROBOTINO, e, known).slip_rmse)


def test_shapes_must_fit():
    with pytest.raises(InputError, match=r"truth.speed_m_s must have the shape \(1000,\)"):
        score_drive(RLMA, estimates(0.9, 1.0, 0.1), DriveTruth(np.ones(3)))
