"""Faults planted into a good drive, each found and named; the good drive raises nothing."""

import re
from dataclasses import replace

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.logs import DriveLog
from ohmward.traction import RLMA, Differential, SkidSteer
from ohmward.traction.drive_checks import check_drive, mended, with_signed_speed
from ohmward.traction.robot.packaged import generic_robot

TIME = np.arange(0.0, 20.0, 0.02)
TWO = generic_robot(15.0, 0.08, 0.36, layout="two-wheel")
FOUR = replace(RLMA, chassis=Differential(0.314, 0.314, 0.30, driven="all"))


def good(robot=RLMA, seed=1, gyro=True, **others):
    """A drive with turns in both directions; wheels roll, currents push against friction."""
    rng = np.random.default_rng(seed)
    speed, yaw = 0.3 + 0.1 * np.sin(TIME), 0.8 * np.sin(0.7 * TIME)
    motion = np.column_stack([speed, yaw] if robot.freedoms == 2 else [speed, 0 * yaw, yaw])
    rolling = motion @ robot.rolling.T / robot.wheel.radius_m
    wheels = rolling + 0.01 * rng.standard_normal(rolling.shape)
    current = 1.0 + 0.2 * rng.standard_normal((TIME.size, robot.driven))
    rate = yaw + 0.002 * rng.standard_normal(TIME.size) if gyro else None
    return DriveLog("drive", TIME, wheels, current, **({"yaw_rate_rad_s": rate, "speed_m_s": speed} | others))


def changed(log, name, column, function):
    values = np.array(getattr(log, name))
    values[:, column] = function(values[:, column])
    return replace(log, **{name: values})


def texts(robot, log):
    return [note.text for note in check_drive(robot, log).notes]


@pytest.mark.parametrize("robot", [RLMA, FOUR, replace(RLMA, chassis=SkidSteer(0.314, 0.314, 0.30))])
@pytest.mark.parametrize("gyro", [True, False])
def test_a_good_drive_raises_nothing(robot, gyro):
    assert texts(robot, good(robot, gyro=gyro)) == []
    assert texts(robot, good(robot, gyro=gyro, speed_m_s=None)) == []


def test_a_robot_that_stands_raises_nothing():
    still = DriveLog("still", TIME, np.zeros((TIME.size, 4)), np.zeros((TIME.size, 2)), np.zeros(TIME.size))
    assert texts(RLMA, still) == []


def test_a_stuck_encoder_is_named():
    stuck = np.where((TIME > 5) & (TIME < 9), 1.5, np.nan)
    log = changed(good(), "wheel_speed_rad_s", 1, lambda v: np.where(np.isnan(stuck), v, stuck))
    (text,) = texts(RLMA, log)
    assert "encoder of front right is at 1.5 rad/s, stuck: the same to the last bit from 5.04 s to 8.98 s" in text


@pytest.mark.parametrize("frozen", [False, True])
def test_an_encoder_that_repeats_one_commanded_speed_while_others_go_on_is_named(frozen):
    """No encoder flickers: the log has the speeds that were commanded, for five seconds each."""
    speeds = np.repeat([[4.0, 4.0], [5.0, 3.0], [6.0, 6.0], [3.0, 5.0]], TIME.size // 4, axis=0)
    left = np.where(frozen & (TIME > 3.0), speeds[0, 0], speeds[:, 0])
    wheels = np.column_stack([left, speeds[:, 1], np.full((TIME.size, 2), np.nan)])
    log = replace(good(), wheel_speed_rad_s=wheels, yaw_rate_rad_s=None, speed_m_s=None)
    assert any("encoder of front left is at 4 rad/s, stuck" in text for text in texts(RLMA, log)) == frozen


def test_a_dead_gyro_is_left_out_and_a_good_one_is_not():
    log = good()
    assert mended(RLMA, log) is log
    dead = check_drive(RLMA, good(yaw_rate_rad_s=np.zeros(TIME.size)))
    assert np.isnan(np.asarray(dead.yaw_rate_rad_s)).all()
    assert "the gyro is stuck: the same to the last bit from 0 s to 19.98 s" in str(dead.notes[-1])
    rate = np.asarray(good().yaw_rate_rad_s)
    frozen = mended(RLMA, good(yaw_rate_rad_s=np.where(TIME > 12.0, rate[600], rate)))
    np.testing.assert_array_equal(np.isnan(np.asarray(frozen.yaw_rate_rad_s)), TIME >= 12.0)


def test_a_gyro_without_noise_is_not_dead_while_wheels_spin_or_turn_evenly():
    still = replace(good(), yaw_rate_rad_s=np.where((TIME > 5.0) & (TIME < 9.0), 0.0, 0.8 * np.sin(0.7 * TIME)))
    assert mended(RLMA, still) is still
    even = replace(good(), wheel_speed_rad_s=np.tile([4.0, 6.0, 4.0, 6.0], (TIME.size, 1)), yaw_rate_rad_s=0 * TIME)
    assert mended(RLMA, even) is even


def test_an_encoder_that_counts_as_many_in_every_step_at_a_steady_speed_is_not_stuck():
    """22 counts in each for as long as it takes the other, with 22 or 23, to make half a turn."""
    counts = np.column_stack([np.full(TIME.size, 22.0), 22.0 + np.arange(TIME.size) % 2])
    counts[: TIME.size // 2] += np.round(5.0 * np.sin(TIME[: TIME.size // 2]))[:, None]
    wheels = np.column_stack([counts * 2.0 * np.pi / 2048 / 0.02, np.full((TIME.size, 2), np.nan)])
    log = replace(good(), wheel_speed_rad_s=wheels, yaw_rate_rad_s=None, speed_m_s=None)
    assert not any("stuck" in text for text in texts(RLMA, log))


def test_an_encoder_that_never_turns_is_unplugged_but_a_wheel_may_stand():
    dead = changed(good(gyro=False), "wheel_speed_rad_s", 2, np.zeros_like)
    assert any("encoder of rear left is at 0 rad/s, stuck" in text for text in texts(RLMA, dead))
    pivot = changed(good(gyro=False), "wheel_speed_rad_s", 2, lambda v: np.where(TIME < 5, 0.0, v))
    assert not any("encoder of rear left is at" in text for text in texts(RLMA, pivot))


@pytest.mark.parametrize("wheel", range(4))
def test_an_encoder_that_counts_backwards_is_named_with_the_other_of_its_side(wheel):
    log = changed(good(FOUR, gyro=False), "wheel_speed_rad_s", wheel, np.negative)
    found = [text for text in texts(FOUR, log) if "contradict" in text]
    side = ["left", "right"][wheel % 2]
    assert len(found) == 1 and f"the encoder of front {side} or rear {side} counts the other way" in found[0]


def test_two_encoders_and_a_gyro_find_that_one_counts_backwards():
    log = good()
    speeds = np.array(log.wheel_speed_rad_s)
    speeds[:, 2:], speeds[:, 0] = np.nan, -speeds[:, 0]
    found = " ".join(texts(RLMA, replace(log, wheel_speed_rad_s=speeds, speed_m_s=None)))
    assert "front left" in found and "counts the other way" in found


def test_left_and_right_exchanged():
    log = good()
    speeds = log.wheel_speed_rad_s[:, [1, 0, 3, 2]]
    assert any("turn against each other" in text for text in texts(RLMA, replace(log, wheel_speed_rad_s=speeds)))


SCRUBBING = replace(RLMA, chassis=SkidSteer(0.314, 0.314, 0.30))


def scrubbing(gyro=1.0, wheels=1.0, **others):
    """A robot that turns at two thirds of what its wheels say; gyro, wheels: factors of their units."""
    log = good(SCRUBBING)
    yaw_rate = gyro / 1.5 * log.yaw_rate_rad_s
    return replace(
        log, wheel_speed_rad_s=wheels * log.wheel_speed_rad_s, yaw_rate_rad_s=yaw_rate, **{"speed_m_s": None, **others}
    )


@pytest.mark.parametrize(
    ("log", "expected"),
    [
        (scrubbing(), []),
        (scrubbing(gyro=-1.0), ["turn against each other"]),
        (scrubbing(gyro=180.0 / np.pi), ["the gyro in degrees per second? use --unit yaw_rate=deg/s"]),
    ],
)
def test_signs_and_units_of_a_robot_whose_wheels_scrub(log, expected):
    found = texts(SCRUBBING, log)
    assert len(found) == len(expected) and all(part in text for part, text in zip(expected, found, strict=True))


@pytest.mark.parametrize("wheels, unit", [(0.12, "m/s"), (9.55, "rpm")])
def test_a_gyro_shows_that_the_wheels_are_in_another_unit(wheels, unit):
    with pytest.raises(InputError, match=f"as fast as the gyro.*use --unit wheel_speed={unit}") as refused:
        check_drive(SCRUBBING, scrubbing(wheels=wheels))
    assert refused.value.options == ("--unit", f"wheel_speed={unit}")


def test_a_gyro_that_only_has_noise_shows_no_unit():
    """The robot drives straight on, and no factor makes its noise a turn."""
    noise = 0.3 * np.random.default_rng(0).standard_normal(TIME.size)
    log = good()
    assert texts(RLMA, replace(log, wheel_speed_rad_s=np.full((TIME.size, 4), 3.0), yaw_rate_rad_s=noise)) == []


@pytest.mark.parametrize("robot", [TWO, SCRUBBING], ids=["rolls", "scrubs"])
def test_a_gyro_of_another_axis(robot):
    other = good(robot, yaw_rate_rad_s=0.01 * np.sin(9.0 * TIME))
    assert any("it measures another axis, or is dead" in text for text in texts(robot, other))


def test_a_gyro_that_clips():
    clips = good(TWO, speed_m_s=None)
    fast, rate = 10.0 * clips.wheel_speed_rad_s, 10.0 * np.asarray(clips.yaw_rate_rad_s)
    clips = replace(clips, wheel_speed_rad_s=fast, yaw_rate_rad_s=np.clip(rate, -4.0, 4.0))
    assert any("the gyro clips at 229.2 deg/s in" in text for text in texts(TWO, clips))


def test_wheels_that_no_such_robot_has_are_in_another_unit():
    (text,) = texts(
        RLMA, replace(good(), wheel_speed_rad_s=100.0 * good().wheel_speed_rad_s, yaw_rate_rad_s=None, speed_m_s=None)
    )
    assert "plausible are -83.33 to 83.33; in another unit? use --unit wheel_speed=rpm, deg/s or mm/s" in text


def test_a_current_of_the_wrong_sign():
    log = changed(good(), "motor_current_A", 0, np.negative)
    (text,) = texts(RLMA, log)
    assert "motor of front left brakes all the way" in text


@pytest.mark.parametrize("gyro", [True, False])
def test_a_current_of_the_wrong_sign_is_read_with_the_other_where_a_gyro_confirms_the_encoders(gyro):
    log = good(gyro=gyro)
    push_A = 1.0 + (0.1 * np.cos(TIME)[:, None] + np.array([-1.0, 1.0]) * 0.06 * np.cos(0.7 * TIME)[:, None]) / 0.12
    log = replace(log, motor_current_A=push_A)
    mirrored = changed(log, "motor_current_A", 0, np.negative)
    assert mended(RLMA, log).motor_current_A is log.motor_current_A
    np.testing.assert_array_equal(mended(RLMA, mirrored).motor_current_A, (log if gyro else mirrored).motor_current_A)


def slowing(speed_m_s, current_A):
    """A drive straight ahead with these speeds (T,), both motors with this current (T,)."""
    rng = np.random.default_rng(1)
    wheels = speed_m_s[:, None] / RLMA.wheel.radius_m + 0.01 * rng.standard_normal((TIME.size, 4))
    current = current_A[:, None] + 0.1 * rng.standard_normal((TIME.size, 2))
    return DriveLog("slowing", TIME, wheels, current)


#: Braking from 2 m/s for 20 s, and the current [A] that takes most of the energy, the rest is rolling resistance.
SLOWING_M_S = 2.0 - 0.09 * TIME
BRAKING_A = np.full(
    TIME.size, -0.7 * 0.09 * RLMA.mass_kg * RLMA.wheel.radius_m / 2 / RLMA.motor.wheel_constant_Nm_per_A
)


@pytest.mark.parametrize("direction", [1, -1])
def test_a_drive_that_only_brakes_has_no_wrong_sign(direction):
    assert texts(RLMA, slowing(direction * SLOWING_M_S, direction * BRAKING_A)) == []


def test_a_descent_brakes_as_its_pitch_says():
    steady = slowing(np.full(TIME.size, 0.5), 20 * BRAKING_A)
    assert sum("brakes all the way" in text for text in texts(RLMA, steady)) == 2
    slope = 20 * 0.09 / 9.81
    assert texts(RLMA, replace(steady, pitch_rad=np.full(TIME.size, -slope))) == []


@pytest.mark.parametrize("flipped", ["motor_current_A", "wheel_speed_rad_s"])
def test_wrong_signs_of_a_drive_that_starts_and_stops(flipped):
    """It drives for ten seconds and brakes for one."""
    speed_m_s = np.interp(TIME % 12.0, [0.0, 2.0, 10.0, 11.0], [0.0, 1.0, 1.0, 0.0])
    current_A = np.where(TIME % 12.0 < 10.0, 1.0, -1.0) * (speed_m_s > 0)
    log = slowing(speed_m_s, current_A)
    assert texts(RLMA, log) == []
    found = texts(RLMA, replace(log, **{flipped: -getattr(log, flipped)}))
    assert sum("brakes all the way, but the robot does not slow down" in text for text in found) == 2


def test_a_blocked_wheel():
    log = changed(good(), "wheel_speed_rad_s", 0, lambda v: np.where(TIME < 4, 0.01 * v, v))
    log = replace(log, motor_current_A=3.0 * log.motor_current_A)
    assert any("motor of front left takes 3" in text and "does not turn" in text for text in texts(RLMA, log))


def test_a_dead_current_sensor_is_left_out():
    found = check_drive(RLMA, changed(good(), "motor_current_A", 1, np.zeros_like))
    assert "motor current of front right is 0 A" in found.notes[0].text
    assert np.isnan(found.motor_current_A).all(axis=0).tolist() == [False, True]


def test_a_counter_that_rolled_over_unseen():
    log = changed(good(), "wheel_speed_rad_s", 0, lambda v: np.where(np.arange(v.size) % 400 == 200, v - 5000, v))
    found = " ".join(texts(RLMA, log))
    assert "encoder of front left jumps to 4999 rad/s in 2 samples" in found and "rolled over" in found


@pytest.mark.parametrize(("share", "is_named"), [(0.9, True), (0.98, False), (1.1, True)])
def test_a_speed_from_outside_that_always_contradicts_the_wheels_is_named(share, is_named):
    found = texts(RLMA, good(speed_m_s=share * good().speed_m_s))
    assert any("nearly always: the radius" in text for text in found) == is_named


def test_a_unit_that_is_wrong():
    doubtful = replace(good(), wheel_speed_rad_s=3.0 * good().wheel_speed_rad_s, yaw_rate_rad_s=None)
    (text,) = texts(RLMA, doubtful)
    assert "the wheels say 3 times the speed" in text
    (text,) = texts(RLMA, good(speed_m_s=good().speed_m_s * 3600 / 1852))
    assert "the wheels say 0.514 times the speed" in text and "speed=kn" in text
    meaningless = replace(doubtful, wheel_speed_rad_s=9.55 * good().wheel_speed_rad_s)
    with pytest.raises(InputError, match=r"the wheels say 9.5\d times the speed.*--unit wheel_speed=rpm") as refused:
        check_drive(RLMA, meaningless)
    assert refused.value.options == ("--unit", "wheel_speed=rpm")
    with pytest.raises(InputError, match=r"the wheels say 0\.12 times the speed.*--unit wheel_speed=m/s"):
        check_drive(RLMA, replace(doubtful, wheel_speed_rad_s=RLMA.wheel.radius_m * good().wheel_speed_rad_s))


def test_a_speed_that_cannot_be_is_refused_beside_other_faults():
    log = changed(good(TWO, speed_m_s=3.6 * good().speed_m_s), "wheel_speed_rad_s", 0, np.negative)
    with pytest.raises(InputError, match=r"times the speed that was measured from outside.*counts the other way"):
        check_drive(TWO, log)


def there_and_back(every, std_m_s=0.03, sign=1.0, age_s=0.0):
    """Forward for 8 s, a stop of 4 s, back for 8 s; the speed from outside comes every so many samples, as a size."""
    rng = np.random.default_rng(2)
    true_m_s = np.interp(TIME, [0, 1, 7, 8, 12, 13, 19, 20], [0, 0.5, 0.5, 0, 0, -0.4, -0.4, 0])
    late_m_s = np.interp(TIME - age_s, TIME, true_m_s)
    speed = np.full(TIME.size, np.nan)
    speed[::every] = np.abs(late_m_s + std_m_s * rng.standard_normal(TIME.size))[::every]
    speed = np.where(late_m_s < 0, sign, 1.0) * speed
    wheels = np.repeat(true_m_s[:, None] / RLMA.wheel.radius_m, 4, axis=1)
    age = np.where(np.isfinite(speed), age_s, np.nan)
    log = DriveLog("size", TIME, wheels, np.full((TIME.size, 2), np.nan), speed_m_s=speed, speed_age_s=age)
    return log, late_m_s


@pytest.mark.parametrize("every", [1, 10, 50])
@pytest.mark.parametrize("std_m_s, age_s", [(0.0, 0.0), (0.03, 0.0), (0.03, 0.5)])
def test_a_speed_without_a_sign_gets_that_of_the_wheels(every, std_m_s, age_s):
    log, true_m_s = there_and_back(every, std_m_s, age_s=age_s)
    signed = with_signed_speed(RLMA, log)
    assert signed.speed_m_s is not None and log.speed_m_s is not None
    kept = np.isfinite(signed.speed_m_s)
    assert kept.sum() > 0.95 * np.isfinite(log.speed_m_s).sum()
    assert np.abs(signed.speed_m_s - true_m_s)[kept].max() < 0.2
    assert "never negative while the wheels turn back" in signed.notes[-1].text


@pytest.mark.parametrize("repeated, gyro", [(1.0, False), (0.0, True), (0.0, False)])
def test_a_speed_that_repeats_itself_while_the_wheels_change_theirs_is_left_out(repeated, gyro):
    """At zero, only where a gyro shows that the robot turns with its wheels."""
    log = good(RLMA, gyro=gyro)
    frozen = (TIME > 7.99) & (TIME < 14.0)
    speed = np.where(frozen, repeated * np.asarray(log.speed_m_s)[400], log.speed_m_s)
    left = np.asarray(mended(RLMA, replace(log, speed_m_s=speed)).speed_m_s)
    np.testing.assert_array_equal(np.isnan(left), frozen & (gyro or repeated > 0.0))


def test_a_speed_with_a_sign_or_of_wheels_that_only_turn_ahead_stays():
    signed, _ = there_and_back(10, sign=-1.0)
    assert with_signed_speed(RLMA, signed) is signed
    assert with_signed_speed(RLMA, good()) is not None and with_signed_speed(RLMA, good()).notes == ()


def test_wheels_that_spin_back_under_a_robot_that_stands_leave_the_speed_as_it_is():
    log, _ = there_and_back(10)
    stuck = replace(log, speed_m_s=np.where(TIME > 10, np.minimum(log.speed_m_s, 0.02), log.speed_m_s))
    assert with_signed_speed(RLMA, stuck) is stuck


def test_a_size_is_left_out_where_the_robot_slides_on_wheels_that_stand():
    log, _ = there_and_back(10)
    slid = replace(log, speed_m_s=np.where((TIME > 9) & (TIME < 11), log.speed_m_s + 0.5, log.speed_m_s))
    found = with_signed_speed(RLMA, slid).speed_m_s
    assert found is not None
    assert np.isnan(found[(TIME > 9) & (TIME < 11)]).all()


@pytest.mark.parametrize("forward", [1.0, -1.0])
@pytest.mark.parametrize("every", [1, 50])
def test_a_robot_that_is_stuck(every, forward):
    """Also by a speed that comes once a second, forward or backward, and though its wheels stand for a while."""
    log = good(RLMA, gyro=False)
    speed = forward * np.where((TIME > 8) & (TIME < 16), 0.01, log.speed_m_s)
    speed[np.arange(TIME.size) % every != 0] = np.nan
    wheels, current = forward * log.wheel_speed_rad_s, forward * log.motor_current_A
    wheels[(TIME > 10) & (TIME < 13)] = 0.0
    log = replace(log, wheel_speed_rad_s=wheels, motor_current_A=0 * current, speed_m_s=speed)
    (found,) = (text for text in texts(RLMA, log) if "the motor current" not in text)
    first, last = (float(number) for number in re.findall(r"([\d.]+) s", found))
    assert (first, last) == (pytest.approx(8.0, abs=1.1), pytest.approx(16.0, abs=1.1))
    assert "the robot stands by the speed from outside" in found


def test_a_robot_that_starts_late_by_its_speed_is_not_stuck():
    log = good(RLMA, gyro=False)
    assert texts(RLMA, replace(log, speed_m_s=np.where(TIME < 2.5, 0.0, log.speed_m_s))) == []


def reversing(turn_rate=0.4):
    """A drive that goes back for a third of the time, and turns about all along."""
    log = good()
    speed = 0.3 * np.sign(np.sin(2 * np.pi * TIME / 20.0) + 0.5)
    yaw = turn_rate * np.sin(0.7 * TIME)
    wheels = np.column_stack([speed, yaw]) @ RLMA.rolling.T / RLMA.wheel.radius_m
    return replace(log, wheel_speed_rad_s=wheels, yaw_rate_rad_s=yaw, speed_m_s=None)


@pytest.mark.parametrize("turn_rate", [0.4, 1.5])
def test_wheels_without_a_sign_are_named(turn_rate):
    log = reversing(turn_rate)
    assert texts(RLMA, log) == []
    sizes = replace(log, wheel_speed_rad_s=np.abs(log.wheel_speed_rad_s))
    assert any("lost their sign" in text for text in texts(RLMA, sizes))
    forward_m_s = log.wheel_speed_rad_s.mean(axis=1) * RLMA.wheel.radius_m
    outside = replace(sizes, yaw_rate_rad_s=None, speed_m_s=forward_m_s)
    assert any("the speed from outside is negative in" in text for text in texts(RLMA, outside))


@pytest.mark.parametrize("side", [0, 1])
def test_a_mirrored_side_is_named_without_a_gyro(side):
    log = replace(good(gyro=False, speed_m_s=None), motor_current_A=np.full((TIME.size, 2), np.nan))
    columns = [k for k, place in enumerate(RLMA.places) if ("left", "right")[side] in place.name]
    wheels = np.array(log.wheel_speed_rad_s)
    wheels[:, columns] *= -1.0
    mirrored = replace(log, wheel_speed_rad_s=wheels)
    assert any("on the spot: the encoders of one side are mounted mirrored" in text for text in texts(RLMA, mirrored))


def test_so_it_is_if_the_robot_turns_on_the_spot_in_a_fifth_of_the_time():
    spot = TIME % 10.0 < 2.0
    motion = np.column_stack([np.where(spot, 0.0, 0.8), np.where(spot, 0.8, 0.3 * np.sin(TIME))])
    wheels = motion @ RLMA.rolling.T / RLMA.wheel.radius_m
    nothing = np.full((TIME.size, 2), np.nan)
    assert texts(RLMA, DriveLog("drive", TIME, wheels, nothing)) == []
    (text,) = texts(RLMA, DriveLog("mirrored", TIME, wheels * [1.0, -1.0, 1.0, -1.0], nothing))
    assert "the encoders of one side are mounted mirrored" in text


def test_two_wheels_and_a_caster_without_an_encoder_have_sides_too():
    robot = generic_robot(20.0, 0.08, 0.4)
    yaw = 0.8 * np.sin(0.7 * TIME)
    wheels = np.column_stack([0.3 + 0.0 * TIME, yaw]) @ robot.rolling.T / robot.wheel.radius_m
    wheels[:, 2] = np.nan
    nothing = np.full((TIME.size, 2), np.nan)
    assert texts(robot, DriveLog("drive", TIME, wheels, nothing)) == []
    mirrored = DriveLog("mirrored", TIME, wheels * [-1.0, 1.0, 1.0], nothing)
    assert any("the encoders of one side are mounted mirrored" in text for text in texts(robot, mirrored))
    turned = np.where(TIME < 10.0, 1.0, -1.0) * yaw  # it drives back from 10 s on
    unsigned = DriveLog("unsigned", TIME, np.abs(wheels), nothing, turned)
    assert any("they have lost their sign" in text for text in texts(robot, unsigned))


@pytest.mark.parametrize("noise_rad_s", [0.0, 0.05])
def test_a_robot_that_only_turns_on_the_spot_is_asked_whether_it_did(noise_rad_s):
    """Two ways round with ramps, four turns in all: the wheels of a mirrored side on a straight line do the same."""
    yaw = 1.5 * np.clip(4.0 * np.sin(0.4 * TIME), -1.0, 1.0)
    wheels = np.column_stack([0.0 * yaw, yaw]) @ RLMA.rolling.T / RLMA.wheel.radius_m
    wheels += noise_rad_s * np.random.default_rng(1).standard_normal(wheels.shape)
    log = DriveLog("spin", TIME, wheels, np.full((TIME.size, 2), np.nan))
    (text,) = texts(RLMA, log)
    assert "turned 4 times on the spot; if it did not, the encoders of one side" in text


def test_a_robot_that_turns_on_the_spot_once_is_not_mirrored():
    yaw = np.where(TIME < 8.0, 0.8, 0.0)
    wheels = np.column_stack([0.0 * yaw, yaw]) @ RLMA.rolling.T / RLMA.wheel.radius_m
    log = DriveLog("spot", TIME, wheels, np.full((TIME.size, 2), np.nan))
    assert texts(RLMA, log) == []
