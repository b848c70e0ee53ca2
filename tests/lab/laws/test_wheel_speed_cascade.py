"""The wheel speed that has the slip, and the drive under it."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ohmward.errors import InputError
from ohmward.traction.control import ControlFlag, Limits, Measurement, SlipCommand
from ohmward.traction.control.slip_law import rim_speed_m_s, surface
from ohmward_lab.traction.wheel_speed_cascade import WheelSpeedCascade, WheelSpeedDrive
from traction.control.examples import DRY, LIMITS, SLIPPERY, WHEEL, Truth, measured, turn

CASCADE = WheelSpeedCascade(WHEEL)


@given(st.floats(0, 3), st.floats(-0.9, 0.9))
def test_the_reference_lies_on_the_surface(travel, slip):
    rim = rim_speed_m_s(travel, slip, 0.2)
    if slip >= 0 or travel >= 0.2:
        assert surface(rim, travel, slip, 0.2).sigma == pytest.approx(0.0, abs=1e-9)
    assert rim >= 0


@pytest.mark.parametrize("ground", [DRY, SLIPPERY], ids=["dry", "slippery"])
@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_at_50_hz_it_holds_a_slip(ground, direction):
    drive = WheelSpeedDrive(LIMITS)
    x = Truth()
    state, motor = CASCADE.init(measured(x)), drive.init(0.0)
    for k in range(1500):
        if k % 20 == 0:
            state, reference, report = CASCADE.step(state, SlipCommand(0.12, direction), measured(x), 0.02)
        motor, torque = drive.step(motor, reference, x.wheel_speed_rad_s, 1e-3)
        x = turn(x, torque, ground, 1e-3, pull_N=direction * 16.0 * x.speed_m_s**2)
    assert report.slip_ratio == pytest.approx(0.12, abs=0.005)


def test_what_cannot_be_used_asks_for_standstill():
    state = CASCADE.init(Measurement(5.0, 0.6))
    for command, m, flag in (
        (SlipCommand(0.12), Measurement(5.0, math.nan), ControlFlag.STALE),
        (SlipCommand(1.2), Measurement(5.0, 0.6), ControlFlag.BAD_COMMAND),
        (SlipCommand(-0.18), Measurement(0.1, 0.01), ControlFlag.STOPPED),
    ):
        _, reference, report = CASCADE.step(state, command, m, 0.02)
        assert reference == pytest.approx(5.0 - 200.0 * 0.02)
        assert int(report.flags) & flag


@pytest.mark.parametrize("dt_s", [math.nan, -0.5, 1e9])
def test_an_impossible_time_step_changes_neither_reference_nor_torque(dt_s):
    state = CASCADE.init(Measurement(5.0, 0.6))
    _, reference, _ = CASCADE.step(state, SlipCommand(0.12), Measurement(5.0, 0.6), dt_s)
    assert reference == 5.0
    drive = WheelSpeedDrive(LIMITS)
    motor, _ = drive.step(drive.init(0.0), 5.0, 4.0, 1e-3)
    assert drive.step(motor, 9.0, 4.0, dt_s)[0] == motor


def test_the_drive_does_not_wind_up():
    drive = WheelSpeedDrive(Limits(2.0))
    state = drive.init(0.0)
    for _ in range(2000):
        state, torque = drive.step(state, 20.0, 0.0, 1e-3)
    assert torque == 2.0
    _, torque = drive.step(state, 0.0, 0.5, 1e-3)
    assert torque < 0


def test_the_drive_reaches_its_speed_against_a_load():
    drive, x = WheelSpeedDrive(LIMITS), Truth()
    state = drive.init(0.0)
    for _ in range(1500):
        state, torque = drive.step(state, 5.0, x.wheel_speed_rad_s, 1e-3)
        x = turn(x, torque, DRY, 1e-3, pull_N=10.0)
    assert x.wheel_speed_rad_s == pytest.approx(5.0, abs=0.02)


def test_bad_settings_are_refused():
    with pytest.raises(InputError, match=r"wheel_speed_cascade.floor_m_s must be > 0"):
        WheelSpeedCascade(WHEEL, floor_m_s=-1.0)
    with pytest.raises(InputError, match=r"wheel_speed_drive.integral_Nm must be > 0"):
        WheelSpeedDrive(LIMITS, integral_Nm=0.0)
