"""Motion of a drive for its energy: an omni-directional robot travels to the side as well."""

import numpy as np
import pytest

from ohmward.energy.drive_record import observe_motion, record_drive
from ohmward.logs import DriveLog, Log
from ohmward.traction import ROBOTINO, hard_terrain

TIME_S = np.arange(0.0, 20.0, 0.02)


@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.0, 1.0), (0.6, -0.8)])
def test_travel_in_every_direction_is_driving(direction):
    speed_m_s = 0.3 * (TIME_S > 5.0)
    motion = np.column_stack([*(speed_m_s * d for d in direction), 0.0 * TIME_S])
    wheels = motion @ ROBOTINO.rolling[: ROBOTINO.driven].T / ROBOTINO.wheel.radius_m
    rng = np.random.default_rng(1)
    log = DriveLog("drive", TIME_S, wheels + 0.02 * rng.standard_normal(wheels.shape), 0.3 * np.sign(wheels))
    found = observe_motion(ROBOTINO, log, hard_terrain("dry asphalt"), TIME_S)
    assert np.sum(found.speed_m_s) * 0.02 == pytest.approx(0.3 * 15.0, rel=0.1)
    battery = Log("drive", TIME_S, np.where(speed_m_s > 0.0, -2.0, -0.5), np.full(TIME_S.size, 24.0))
    record = record_drive(battery, found, "carpet")
    driven = [one.stretch for one in record.driven if one.stretch.terrain == "carpet"]
    assert sum(stretch.time_s for stretch in driven) == pytest.approx(15.0, abs=2.0)
    assert record.balance is not None and record.balance.energy.balance.rolling > 1.0
