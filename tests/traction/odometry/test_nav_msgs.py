"""Estimates as ROS messages."""

import math

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from ohmward.traction import RLMA, Odometry
from ohmward.traction.odometry.nav_msgs import UNKNOWN_VARIANCE, odometry_message, six_by_six, twist_message


def test_the_fields_of_an_odometry_message():
    odometry = Odometry(RLMA)
    for k in range(50):
        e = odometry.update(0.02 * k, [1.0, 2.0], 0.4)
    message = odometry_message(e, 12.25)
    assert message["header"] == {"stamp": {"sec": 12, "nanosec": 250_000_000}, "frame_id": "odom"}
    pose, twist = message["pose"]["pose"], message["twist"]
    assert pose["position"] == {"x": e.x_m, "y": e.y_m, "z": 0.0}
    q = pose["orientation"]
    assert 2 * math.atan2(q["z"], q["w"]) == pytest.approx(e.yaw_rad)
    assert q["x"] ** 2 + q["y"] ** 2 + q["z"] ** 2 + q["w"] ** 2 == pytest.approx(1.0)
    assert twist["twist"]["linear"] == {"x": e.speed_m_s, "y": e.speed_left_m_s, "z": 0.0}
    assert twist["twist"]["angular"]["z"] == e.yaw_rate_rad_s
    assert twist_message(e, 12.25)["twist"] == twist


def test_the_covariance_stands_row_by_row():
    cov = np.array([[1.0, 0.2, 0.3], [0.2, 4.0, 0.5], [0.3, 0.5, 9.0]])
    full = np.array(six_by_six(cov)).reshape(6, 6)
    assert_array_equal(full[np.ix_([0, 1, 5], [0, 1, 5])], cov)
    assert_array_equal(full, full.T)
    assert [full[k, k] for k in (2, 3, 4)] == [UNKNOWN_VARIANCE] * 3
    assert full[5, 0] == six_by_six(cov)[30]
