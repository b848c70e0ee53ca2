"""Calibration in one call is that of its parts, one after the other."""

import re
import sys
from dataclasses import replace

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.logs.drive_log import DriveLog
from ohmward.traction import RLMA
from ohmward.traction.calibration import calibrate, calibrate_motor, calibrate_radius, with_parameters, with_wheel_loads
from ohmward.traction.robot.robot import GRAVITY
from ohmward.traction.terrain.floor import Floor
from traction.terrain.drives import OMNI, SMOOTH, omni_drive


@pytest.fixture(scope="module")
def drives():
    rng = np.random.default_rng(3)
    return [omni_drive([SMOOTH] * 3, direction, 0.12, 6.0, rng, OMNI) for direction in range(0, 360, 60)]


def test_the_motor_is_calibrated_with_the_new_radius(drives):
    found = calibrate(drives, OMNI)
    radius = calibrate_radius(drives, OMNI)
    motor = calibrate_motor(drives, with_parameters(OMNI, [radius]))
    assert found.parameters == (radius, *motor)
    assert found.robot == with_parameters(OMNI, found.parameters)
    assert found.floor is None


def test_a_floor_can_be_learnt_alone(drives):
    found = calibrate(drives, OMNI, parts=(), floor="smooth")
    assert found.parameters == () and found.robot == OMNI
    assert found.floor is not None and found.floor.name == "smooth"


def test_one_part_needs_no_list(drives):
    assert calibrate(drives, OMNI, parts="radius") == calibrate(drives, OMNI, parts=("radius",))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"parts": ("raduis",)}, "parts must be one of radius, track, motor, got 'raduis'"),
        ({"rolling": (-0.01, 0.02)}, "rolling must be between 0 and 1, got -0.01"),
        ({"rolling": (0.02, float("nan"))}, "rolling must be finite, got nan"),
    ],
)
def test_what_cannot_be_calibrated_is_refused(drives, given, message):
    with pytest.raises(InputError, match=message):
        calibrate(drives, OMNI, **given)


def stuck_drive(radius_m, moving_s, stuck_s, from_s=10.0):
    """[T]'s robot ahead at this true radius, its speed from outside once a second; in between, it is stuck."""
    rng = np.random.default_rng(1)
    time_s = np.arange(0.0, moving_s + stuck_s, 0.05)
    is_stuck = (time_s >= from_s) & (time_s < from_s + stuck_s)
    rim_m_s = 0.5 + 0.1 * np.sin(0.3 * time_s)
    wheels = np.repeat(rim_m_s[:, None] / radius_m, 4, axis=1) + 0.01 * rng.standard_normal((time_s.size, 4))
    body_m_s = np.where(is_stuck, 0.0, rim_m_s) + 0.02 * rng.standard_normal(time_s.size)
    body_m_s[np.arange(time_s.size) % 20 != 0] = np.nan
    return DriveLog("mud", time_s, wheels, np.full((time_s.size, 2), np.nan), speed_m_s=body_m_s)


@pytest.mark.parametrize("stuck_s", [15.0, 40.0])
def test_a_robot_that_was_stuck_tells_its_radius_from_the_rest(stuck_s):
    found = calibrate([stuck_drive(0.12, 60.0, stuck_s)], RLMA, parts=("radius",))
    (radius,) = found.parameters
    assert radius.identified and radius.value == pytest.approx(0.12, abs=3 * radius.std) and radius.std < 0.01
    note = found.notes[-1]
    assert note.level == "warning"
    assert "stretches of 1 s in which the wheels turn and the robot hardly moves" in note.text


def test_a_drive_without_a_stuck_robot_has_no_note():
    assert calibrate([stuck_drive(0.12, 60.0, 0.0)], RLMA, parts=("radius",)).notes == ()


def test_a_radius_that_no_drive_can_mean_is_not_written():
    found = calibrate([stuck_drive(0.4, 60.0, 0.0)], RLMA, parts=("radius",))
    assert found.robot == RLMA and "for 0.12 m: the wheels slip all the time" in found.parameters[0].reason


def test_a_radius_far_from_the_file_is_written_with_a_warning():
    found = calibrate(stuck_drive(0.16, 60.0, 0.0), RLMA, parts="radius")
    assert found.parameters[0].identified
    assert "the robot file 0.12 m: measure it" in found.notes[-1].text


def test_drives_that_contradict_each_other_are_in_the_band_and_the_odd_one_is_named():
    drives = [replace(stuck_drive(r, 60.0, 0.0), name=f"{r:g}") for r in (0.115, 0.115, 0.115, 0.127)]
    found = calibrate(drives, RLMA, parts="radius")
    (radius,) = found.parameters
    assert radius.identified and abs(radius.value - 0.115) < 2 * radius.std
    assert "log '0.127' alone gives 0.127 m" in found.notes[-1].text


def test_wheels_that_slip_now_and_then_show_no_radius():
    log = stuck_drive(0.12, 60.0, 0.0)
    assert log.speed_m_s is not None
    slips = replace(log, speed_m_s=log.speed_m_s * np.where(log.time_s > 45.0, 0.5, 1.0))
    found = calibrate(slips, RLMA, parts="radius")
    assert found.robot == RLMA
    assert re.search(
        r"log 'mud' from 45 s to 58 s alone gives 0\.06.* the wheels slip much", found.parameters[0].reason
    )


def test_an_encoder_that_counts_half_is_named():
    log = stuck_drive(0.12, 60.0, 0.0)
    turn_m_s = 0.2 * np.sin(0.7 * log.time_s)[:, None] * [-1.0, 1.0, -1.0, 1.0]
    wheels = (log.wheel_speed_rad_s + turn_m_s / 0.12) * [0.5, 1.0, 0.5, 1.0]
    found = calibrate(replace(log, wheel_speed_rad_s=wheels), RLMA, parts="radius")
    assert found.robot == RLMA and "the left wheel asks for a radius of 0.2" in found.parameters[0].reason


@pytest.mark.parametrize("late_s", [-1.0, 0.0, 2.0])
def test_a_true_motion_that_is_late_is_named(late_s):
    log = stuck_drive(0.12, 60.0, 0.0)
    rim_m_s = 0.12 * log.wheel_speed_rad_s.mean(axis=1)
    late = replace(log, speed_m_s=np.interp(log.time_s - late_s, log.time_s, rim_m_s))
    found = [note.text for note in calibrate(late, RLMA, parts="radius").notes if "true motion comes" in note.text]
    when = "after" if late_s > 0.0 else "before"
    assert [f"{abs(late_s):.1f} s {when} that of the wheels" in text for text in found] == [True] * (late_s != 0.0)


def test_faults_of_the_drives_are_warnings():
    log = stuck_drive(0.12, 60.0, 0.0)
    held = np.where(np.arange(4) == 0, 4.0, log.wheel_speed_rad_s)
    found = calibrate([log, replace(log, name="held", wheel_speed_rad_s=held)], RLMA, parts="radius")
    assert found.notes[0].text.startswith("held: the encoder of front left is at 4 rad/s, stuck")


def test_without_currents_the_usual_parts_leave_the_motors_out():
    found = calibrate(stuck_drive(0.12, 60.0, 0.0), RLMA)
    assert [parameter.name for parameter in found.parameters] == ["wheel.radius_m"]
    assert found.notes[-1].text == "the motors were not calibrated: no drive has their currents"
    with pytest.raises(InputError, match="without motor currents"):
        calibrate(stuck_drive(0.12, 60.0, 0.0), RLMA, parts="motor")


@pytest.mark.parametrize(
    "friction, std, told", [(0.7, 0.5, True), (1.7, 0.16, True), (7.3, 0.4, False), (1.5, 0.8, False)]
)
def test_a_floor_that_the_drives_do_not_tell_is_not_learnt(drives, monkeypatch, friction, std, told):
    floor = Floor("green", friction=friction, stiffness=2.0, rolling=0.1, friction_std=std)
    monkeypatch.setattr(sys.modules[calibrate.__module__], "learn_floor", lambda *_: floor)
    found = calibrate(drives, OMNI, parts=(), floor="green")
    assert (found.floor is not None) == told
    assert told == (not any("floor 'green' was not identified" in note.text for note in found.notes))


def test_wheel_loads_are_the_mass():
    weight_N = OMNI.mass_kg * GRAVITY
    loaded = with_wheel_loads(OMNI, (0.3 * weight_N, 0.3 * weight_N, 0.5 * weight_N))
    assert loaded.mass_kg == pytest.approx(1.1 * OMNI.mass_kg)
    assert loaded.wheel_load_N == pytest.approx((0.3 * weight_N, 0.3 * weight_N, 0.5 * weight_N))


def test_loads_in_another_unit_are_refused():
    with pytest.raises(InputError, match="give newtons, not kilograms or grams"):
        with_wheel_loads(OMNI, (3.0, 3.0, 3.0))
