"""Positions of wheels, in radians or degrees, that go on or start anew each turn."""

import numpy as np
import pytest

from ohmward.logs import read_drive, write_table
from ohmward.traction import RLMA

T = 0.05 * np.arange(400)
SPEED = 4.0 + np.sin(T)
ANGLE = np.concatenate([[0.0], np.cumsum(0.05 * SPEED[1:])])


@pytest.mark.parametrize(
    ("unit", "angle"),
    [
        ("rad", ANGLE),
        ("deg", np.degrees(ANGLE)),
        ("rad", np.mod(ANGLE, 2 * np.pi)),
        ("rad", np.mod(-ANGLE + np.pi, 2 * np.pi) - np.pi),
    ],
)
def test_the_speed_is_the_change_of_the_position(unit, angle, tmp_path):
    names = [f"front_{side}_wheel_position_{unit}" for side in ("left", "right")]
    write_table({"time_s": T, **dict.fromkeys(names, angle)}, tmp_path / "drive.csv")
    log = read_drive(tmp_path / "drive.csv", RLMA)
    sign = -1.0 if angle[1] < angle[0] or angle.min() < -1 else 1.0
    measured = log.wheel_speed_rad_s[np.isin(log.time_s, T[1:]), :2]
    np.testing.assert_allclose(measured[-399:], sign * np.column_stack([SPEED, SPEED])[1:], rtol=1e-5)


def test_positions_without_a_unit_in_their_name(tmp_path):
    names = ["position[0]", "position[1]"]
    write_table({"time_s": T, **dict.fromkeys(names, ANGLE)}, tmp_path / "drive.csv")
    log = read_drive(tmp_path / "drive.csv", RLMA, units={"wheel_speed": "rad"})
    assert np.nanmax(np.abs(log.wheel_speed_rad_s[-399:, 0] - SPEED[1:])) < 1e-5
