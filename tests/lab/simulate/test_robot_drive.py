import numpy as np
import pytest

from ohmward.energy.mission import PLAN_FILE
from ohmward.traction import RLMA
from ohmward_lab.simulate.closed_loop import parse_scenario, run, save_scenario
from ohmward_lab.simulate.closed_loop.run import figures
from ohmward_lab.simulate.robot_drive import WAY_HOME, robot_drive
from scripts import script


def test_it_can_be_written_and_read(tmp_path):
    save_scenario(robot_drive("lead-acid", 0.3, 7), tmp_path / "drive.toml")
    assert parse_scenario((tmp_path / "drive.toml").read_text()) == robot_drive("lead-acid", 0.3, 7)


def test_the_way_home_is_a_plan(tmp_path):
    (tmp_path / "plan.toml").write_text(WAY_HOME)
    plan = PLAN_FILE.load(tmp_path / "plan.toml")
    assert sum(leg.distance_m for leg in plan.legs) == 4500.0
    assert plan.reserve_soc == 0.1


@pytest.fixture(scope="module")
def drive():
    return run(robot_drive())


@pytest.mark.slow
def test_it_is_what_it_says(drive):
    truth, slip = drive.history.truth, drive.rows.truth.slip_ratio[:, 0]
    assert drive.warnings == ()
    assert set(truth.friction[:, 0]) == {0.8, 0.1}
    assert truth.grade_rad.max() == pytest.approx(0.06)
    started_again = (drive.rows.time_s > 9.2) & (drive.rows.time_s < 10.5)
    assert slip[started_again].max() > 0.2
    assert abs(truth.speed_m_s[-1]) < 0.05
    assert figures(drive).energy_J.climb > 100.0


@pytest.mark.slow
def test_the_picture_of_the_readme_tells_the_truth(drive):
    log, track = script("make_pictures", "docs").drive_home(drive)
    truth, found = log.extra["speed_true_m_s"], track.estimates.speed_m_s
    wheels = RLMA.wheel.radius_m * track.estimates.wheel_speed_rad_s.mean(axis=1)
    rms = [float(np.sqrt(np.mean((v - truth) ** 2))) for v in (found, wheels)]
    assert 3 * rms[0] < rms[1]
