"""A cell of the study of traction: what the live estimator and the score give, drive by drive."""

import math

import numpy as np
import pytest

from ohmward.logs.drive_log import DriveLog
from ohmward.traction.score import DriveScore, DriveTruth, score_drive
from ohmward.traction.speed_observer.estimator import observe
from ohmward.traction.speed_observer.make_observer import default_observer
from ohmward_lab.assess.traction import (
    BASE_DRIVE,
    DRIVE_CONDITIONS,
    ROBOTS,
    SLIP_METHODS,
    figures,
    measured,
    slip_cell,
)

BY_NAME = {method.name: method for method in SLIP_METHODS}
CONDITIONS = {condition.name: condition for condition in DRIVE_CONDITIONS}


def test_a_cell_is_what_the_observer_gives():
    condition, runs = CONDITIONS["ice and more sensors: the same 0.2 s late"], 2
    samples, truth = measured("rlma", condition, runs, 3)
    robot, scores = ROBOTS["rlma"], []
    for run in range(runs):
        log = DriveLog(
            "drive",
            np.cumsum(samples.dt_s),
            samples.wheel_speed_rad_s[..., run],
            samples.current_A[..., run],
            yaw_rate_rad_s=samples.yaw_rate_rad_s[:, run],
            speed_m_s=samples.speed_m_s[:, run],
            speed_std_m_s=samples.speed_std_m_s[:, run],
            speed_age_s=samples.speed_age_s[:, run],
        )
        estimates = observe(default_observer(robot, condition.assumed, "ekf"), log).estimates
        motion = DriveTruth(truth.speed_m_s[:, run], truth.yaw_rate_rad_s[:, run], None, truth.slip_ratio[..., run])
        scores.append(score_drive(robot, estimates, motion))
    found = slip_cell("rlma", condition, BY_NAME["ekf"], runs, 3)
    assert found.rmse == pytest.approx(math.hypot(*(s.speed_rmse_m_s for s in scores)) / math.sqrt(runs), rel=1e-3)
    assert found.slip_rmse == pytest.approx(math.hypot(*(s.slip_rmse for s in scores)) / math.sqrt(runs), rel=1e-3)
    assert found.speed_covered == pytest.approx(np.mean([s.speed_coverage_95 for s in scores]), abs=1e-3)
    assert found.covered == min(found.speed_covered, found.slip_covered) > 0.8


def test_figures_by_hand():
    scores = [
        DriveScore(0.3, 0.5, 0.9, 0.1, 0.8, 0.0, math.nan, 10),
        DriveScore(0.4, 0.7, 0.7, 0.7, 0.6, 0.1, 0.5, 10),
    ]
    assert figures(scores, True) == pytest.approx(
        {
            "rmse": math.sqrt(0.125),
            "largest": 0.7,
            "speed_covered": 0.8,
            "slip_covered": 0.7,
            "slip_rmse": 0.5,
            "detected": 0.5,
            "false_alarms": 0.05,
        }
    )
    assert math.isnan(figures(scores, False)["speed_covered"])


def test_the_wheels_alone_are_as_wrong_as_they_slip_or_are_worn():
    exact = BASE_DRIVE._replace(counts_per_turn=10**6)
    smaller = exact._replace(world=exact.world._replace(radius_ratio=0.95))
    base, worn = (slip_cell("rlma", condition, BY_NAME["wheels"], 2, 1) for condition in (exact, smaller))
    assert base.rmse < 0.005 and base.way < 0.005 and math.isnan(base.covered)
    assert worn.way == pytest.approx(1 / 0.95 - 1.0, abs=0.004)


def test_an_omnidirectional_robot_is_judged_by_its_own_wheels():
    found = slip_cell("robotino", BASE_DRIVE, BY_NAME["ekf"], 2, 1)
    assert found.rmse < 0.02 and found.covered > 0.9 and found.robot == "robotino"
