"""The benchmark on the measured Robotino: a few of the runs that it judges in full, and how it finds its truth."""

from dataclasses import replace

import numpy as np
import pytest

from needs import measured_file
from ohmward.traction import ROBOTINO
from ohmward.traction.terrain.slip_on_floors import slip_on_floors
from scripts import script
from traction.terrain.drives import SMOOTH, SOFT

robotino, robotino_live, robotino_blue = map(script, ("robotino", "robotino_live", "robotino_blue"))


@pytest.fixture(scope="module")
def recordings():
    return measured_file(robotino.FOLDER)


@pytest.mark.slow
def test_slip_on_a_floor_learnt_from_other_runs_is_that_of_the_camera(recordings):
    def some(name, numbers):
        return {k: robotino.read_run(recordings / f"{name}.parquet", k) for k in numbers}

    table = some("table", range(0, 72, 7))
    robot = robotino.calibrated(robotino.weighed("wheel_load_nonuniform_load.csv"), table)
    assert robot.wheel.radius_m == pytest.approx(0.0358, abs=0.0005)
    gray = some("gray", range(0, 216, 14))
    floors = robotino.floor_of("table", table, robot), robotino.floor_of("gray", gray, robot)
    others = some("gray", range(5, 216, 26))
    judged = robotino.judge(slip_on_floors(robot, floors), others)
    assert np.mean([abs(j.found - j.true) for j in judged]) < 0.03
    unseen = robotino.judge(slip_on_floors(robot, floors[:1]), others)
    assert np.mean([abs(j.found - j.true) < 1.96 * j.std for j in unseen]) > 0.85
    blue = robotino.judged_blue(slip_on_floors(robot, floors))
    assert np.mean([abs(j.found - j.true) < 1.96 * j.std for j in blue]) > 0.85


def test_a_recorded_run_sample_by_sample_is_the_run_at_once_and_survives_what_is_lost(recordings):
    estimator = slip_on_floors(robotino.weighed("wheel_load_nonuniform_load.csv"), (SMOOTH, SOFT))
    log = robotino.read_run(recordings / "two_table_gray.parquet", 5).drive.log
    at_once, (single,) = estimator.run(log), robotino_live.live(estimator, {5: log}).values()
    np.testing.assert_allclose(single.travel_slip, at_once.travel_slip, atol=1e-9)
    assert [c.time_s for c in single.crossings] == [c.time_s for c in at_once.crossings]
    lost = np.random.default_rng(1).random(log.motor_current_A.shape) < 0.1
    lost[0] = False
    speed = np.where(lost[:, ::-1], np.nan, log.wheel_speed_rad_s)
    holed = estimator.run(
        replace(log, motor_current_A=np.where(lost, np.nan, log.motor_current_A), wheel_speed_rad_s=speed)
    )
    assert np.nanmean(holed.travel_slip) == pytest.approx(np.nanmean(at_once.travel_slip), abs=0.01)
    assert holed.counts()["no_current"] == lost.any(axis=1).sum()


def test_time_follows_from_ticks_and_speeds():
    dt = np.array([0.4, 0.5, 0.45])
    rpm = np.outer([200.0, 240.0, 260.0, 250.0], [-1.0, 0.0, 1.1])
    turns = np.vstack([np.zeros(3), np.cumsum((rpm[1:] + rpm[:-1]) / 120 * dt[:, None], axis=0)])
    np.testing.assert_allclose(robotino_blue.steps(turns * robotino_blue.TICKS_PER_TURN, rpm), dt)


def test_a_file_without_a_time_column_is_read_by_its_ticks(recordings):
    drives = list(robotino_blue.blue_drives(ROBOTINO, robotino.PIXEL_M))
    assert len(drives) > 60
    step_s = np.concatenate([np.diff(drive.log.time_s) for drive in drives])
    assert 0.40 < np.median(step_s) < 0.50


def test_a_wheel_has_crossed_once_it_stands_clearly_on_the_other_side():
    t = np.arange(8.0)
    hovering = np.array([-0.05, -0.02, 0.002, -0.003, 0.004, 0.02, 0.05, 0.1])
    stays = np.full(8, -0.1)
    assert robotino.crossing_times(t, np.column_stack([hovering, stays, -stays])) == [4.0]
