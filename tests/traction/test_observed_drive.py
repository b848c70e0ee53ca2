"""A recorded drive in one call, and its figures."""

from dataclasses import replace

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.logs import DriveLog
from ohmward.traction import RLMA, ROBOTINO, hard_terrain
from ohmward.traction.observed_drive import drive_figures, floor_figures, observe_drive, observe_on_floors
from ohmward.traction.robot.chassis import TwoWheeled
from ohmward.traction.robot.packaged import load_robot
from ohmward.traction.terrain.floor import Floor, Floors
from traction.odometry.examples import one_side_spins

TIME_S = np.arange(0.0, 3.0, 0.01)
SPIN_RAD_S = np.where((TIME_S > 1.0) & (TIME_S < 1.5), 9.0, 0.0)
CARPET = Floor("carpet", friction=1.4, stiffness=3.0, rolling=0.1, roller=0.22, friction_std=0.1, stiffness_std=0.03)


def drive(robot, wheel_speed_rad_s, current_A):
    rng = np.random.default_rng(1)
    wheels = wheel_speed_rad_s + 0.03 * rng.standard_normal((TIME_S.size, len(robot.places)))
    currents = current_A + 0.05 * rng.standard_normal((TIME_S.size, robot.driven))
    return DriveLog("drive", TIME_S, wheels, currents)


@pytest.fixture(scope="module")
def spun():
    """A drive at 0.36 m/s in which the front wheels spin for half a second."""
    return observe_drive(RLMA, drive(RLMA, 3.0 + np.outer(SPIN_RAD_S, [1, 1, 0, 0]), 0.6), hard_terrain("dry asphalt"))


def test_figures_of_a_drive(spun):
    figures = drive_figures(spun)
    assert figures.distance_m == pytest.approx(0.36 * TIME_S[-1], rel=0.05)
    assert figures.speed_final_m_s == pytest.approx(0.36, abs=0.03)
    assert [episode.wheel for episode in figures.slip_episodes] == ["front_left", "front_right"]
    assert figures.immobilised_episodes == []
    assert 0.0 <= figures.unobserved_share <= 1.0


def test_a_number_comes_with_its_std_or_not_at_all(spun):
    figures = drive_figures(spun)
    for value, std in (
        ("friction_ratio", "friction_std"),
        ("grade_rad", "grade_std_rad"),
        ("radius_ratio", "radius_std"),
    ):
        assert (getattr(figures, value) is None) == (getattr(figures, std) is None)


def test_progress_is_told():
    told = []
    log = drive(RLMA, np.full((TIME_S.size, 4), 3.0), 0.6)
    observe_drive(RLMA, log, hard_terrain("dry asphalt"), "ekf", lambda done, total: told.append(done / total))
    assert told[-1] == 1.0


def test_without_motor_currents_slip_is_what_wheels_and_gyro_show():
    """The right rim gains 0.3 m/s for a second, on a curve: it slips, the other does not."""
    time_s = np.arange(0.0, 12.0, 0.02)
    turn, spin = 0.2 * np.sin(time_s), np.where((time_s > 6.0) & (time_s < 7.0), 0.3, 0.0)
    rims = 0.4 + np.outer(turn, RLMA.rolling[:2, 1]) + np.outer(spin, [0.0, 1.0])
    wheels = np.full((time_s.size, 4), np.nan)
    wheels[:, :2] = rims / RLMA.wheel.radius_m
    gyro = turn + 0.002 * np.random.default_rng(1).standard_normal(time_s.size)
    log = DriveLog("no currents", time_s, wheels, np.full((time_s.size, 2), np.nan), yaw_rate_rad_s=gyro)
    observed = observe_drive(RLMA, log, hard_terrain("dry asphalt"), "ekf")
    episodes = drive_figures(observed).slip_episodes
    assert {episode.wheel for episode in episodes} == {"front_right"}
    assert 6.0 < episodes[0].start_s < 6.3 and episodes[-1].end_s == pytest.approx(7.0, abs=0.3)
    e = observed.track.estimates
    np.testing.assert_allclose(e.speed_m_s, observed.path.speed_m_s, atol=1e-12)
    assert np.mean(np.abs(e.speed_m_s - 0.4) < 1.96 * e.speed_std_m_s) > 0.95
    assert e.slip_speed_m_s[325, 1] == pytest.approx(0.3, abs=0.02)
    assert e.slip_speed_m_s[325, 0] == pytest.approx(0.0, abs=0.02)


@pytest.mark.parametrize("axle_m", [0.05, 0.125])
def test_without_motor_currents_wheels_and_a_gyro_always_show_the_speed(axle_m):
    """Wherever the axle is, and although the gyro is later than usual now and then."""
    robot = replace(RLMA, chassis=TwoWheeled(axle_m, 0.34, (-0.3,)))
    time_s = np.arange(0.0, 20.0, 0.02)
    speed_m_s = np.interp(time_s, [2.0, 4.0, 14.0, 16.0], [0.0, 0.8, 0.8, 0.0])
    wheels = np.full((time_s.size, 3), np.nan)
    wheels[:, :2] = speed_m_s[:, None] / robot.wheel.radius_m
    gyro = 0.002 * np.random.default_rng(1).standard_normal(time_s.size)
    gyro[::97] = np.nan
    log = DriveLog("no currents", time_s, wheels, np.full((time_s.size, 2), np.nan), yaw_rate_rad_s=gyro)
    observed = observe_drive(robot, log, hard_terrain("dry asphalt"))
    assert drive_figures(observed).unobserved_share == 0.0
    assert observed.track.estimates.unobserved_s.max() == 0.0


@pytest.mark.parametrize("current_A", [np.nan, 3.0])
def test_a_skid_steered_robot_slips_as_wheels_and_gyro_show_whatever_its_motors_draw(current_A):
    husky = load_robot("husky")
    _, given, spins = one_side_spins(0, True, np.random.default_rng(3))
    log = DriveLog(
        "yard",
        0.02 * np.arange(len(spins)),
        given.robot.wheel_speed_rad_s,
        np.full((len(spins), 4), current_A),
        yaw_rate_rad_s=given.robot.yaw_rate_rad_s,
        speed_m_s=given.robot.speed_m_s,
    )
    observed = observe_drive(husky, log, hard_terrain("gravel"))
    e = observed.track.estimates
    assert np.sqrt(np.mean((e.speed_m_s - 0.8)[spins] ** 2)) < 0.06
    wheels = {episode.wheel for episode in drive_figures(observed).slip_episodes}
    assert wheels == {"front_left", "rear_left"}


@pytest.mark.parametrize("interval", [10, 50])
def test_an_outside_speed_of_unstated_noise_does_no_harm(interval):
    """Half a metre a second of noise, five times or once a second, beside wheels that show the speed within 2 cm/s."""
    rng = np.random.default_rng(2)
    time_s = np.arange(0.0, 40.0, 0.02)
    speed_m_s = np.interp(time_s, [2.0, 4.0, 20.0, 24.0, 38.0], [0.0, 0.8, 0.8, 0.4, 0.4])
    wheels = np.full((time_s.size, 4), np.nan)
    wheels[:, :2] = (speed_m_s[:, None] + 0.005 * rng.standard_normal((time_s.size, 2))) / RLMA.wheel.radius_m
    gyro, nothing = 0.002 * rng.standard_normal(time_s.size), np.full((time_s.size, 2), np.nan)
    outside = np.full(time_s.size, np.nan)
    outside[::interval] = speed_m_s[::interval] + 0.5 * rng.standard_normal(outside[::interval].size)
    log = DriveLog("noisy", time_s, wheels, nothing, yaw_rate_rad_s=gyro, speed_m_s=outside)
    e = observe_drive(RLMA, log, hard_terrain("dry asphalt"), "ekf").track.estimates
    assert np.abs(e.speed_m_s - speed_m_s).max() < 0.05


def test_the_speed_is_covered_where_a_wheel_has_fallen_silent():
    """The left encoder ends at 6 s, and the robot brakes at 9 s."""
    time_s = np.arange(0.0, 14.0, 0.02)
    speed_m_s = np.interp(time_s, [9.0, 10.0], [0.8, 0.3])
    wheels = np.full((time_s.size, 4), np.nan)
    wheels[:, :2] = speed_m_s[:, None] / RLMA.wheel.radius_m
    wheels[time_s > 6.0, 0] = np.nan
    gyro = 0.002 * np.random.default_rng(1).standard_normal(time_s.size)
    log = DriveLog("a wheel", time_s, wheels, np.full((time_s.size, 2), np.nan), yaw_rate_rad_s=gyro)
    e = observe_drive(RLMA, log, hard_terrain("dry asphalt"), "ekf").track.estimates
    late = time_s > 8.0
    assert np.mean(np.abs(e.speed_m_s - speed_m_s)[late] < 1.96 * e.speed_std_m_s[late]) > 0.95
    early = time_s < 6.0
    assert e.speed_std_m_s[early].max() < 0.1


def test_a_drive_on_learnt_floors():
    log = drive(ROBOTINO, np.array([[-3.0, 0.0, 3.0]]), np.array([[-0.5, 0.0, 0.5]]))
    observed = observe_on_floors(ROBOTINO, log, Floors("another robot", (CARPET,)))
    assert observed.on_floors is not None
    figures = floor_figures(observed.on_floors)
    assert next(iter(figures.floor_share)) == "carpet"
    assert sum(figures.floor_share.values()) == pytest.approx(1.0)
    assert figures.travel_slip_mean is not None
    assert figures.travel_slip_std is not None and figures.travel_slip_std > 0.0
    assert any("learnt by 'another robot'" in note.text for note in observed.notes)
    assert drive_figures(observed).friction_ratio is None


#: Wheel speeds of a Robotino that drives ahead at 0.3 m/s, to the left, and in between.
DIRECTIONS = {"ahead": (0.3, 0.0, 0.0), "to the left": (0.0, 0.3, 0.0), "askew": (0.2, 0.2, 0.0)}


@pytest.mark.parametrize("motion", DIRECTIONS.values(), ids=DIRECTIONS)
@pytest.mark.parametrize("floors", [False, True])
def test_the_way_of_an_omnidirectional_robot_counts_in_every_direction(motion, floors):
    wheels = ROBOTINO.rolling[: ROBOTINO.driven] @ np.array(motion) / ROBOTINO.wheel.radius_m
    log = drive(ROBOTINO, wheels[None], 0.4 * np.sign(wheels)[None])
    if floors:
        observed = observe_on_floors(ROBOTINO, log, Floors("robot", (CARPET,)))
    else:
        observed = observe_drive(ROBOTINO, log, hard_terrain("dry asphalt"))
    assert drive_figures(observed).distance_m == pytest.approx(np.hypot(*motion[:2]) * TIME_S[-1], rel=0.2)


def test_a_log_of_another_robot_is_refused():
    with pytest.raises(InputError, match="has 3 wheels and 3 motors, robot 'RLMA' has 4 and 2"):
        observe_drive(RLMA, drive(ROBOTINO, np.ones((1, 3)), 0.5), hard_terrain("dry asphalt"))


def test_an_unknown_filter_is_refused():
    with pytest.raises(InputError, match="filter must be one of"):
        observe_drive(RLMA, drive(RLMA, np.full((TIME_S.size, 4), 3.0), 0.6), hard_terrain("dry asphalt"), "pf")
