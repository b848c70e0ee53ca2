from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from ohmward.energy.balance import DRIVE_TERMS, drive_balance, integrate_drive
from ohmward.errors import InputError
from ohmward.logs.drive_log import DriveLog
from ohmward.trace import Kernel
from ohmward.traction import RLMA, RobotInput, forces, scene
from ohmward.traction.dynamics.forces import power
from ohmward_lab.simulate.implicit_step import step
from traction.examples import HARD, LOSSY, ROBOTS, SLIPPERY, TERRAINS

ROBOT = replace(RLMA, motor=LOSSY, idle_W=8.0)
DT = 0.002


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("ground", TERRAINS)
def test_the_balance_of_a_simulated_robot_closes(name, ground):
    rng = np.random.default_rng(0)
    p = scene(replace(ROBOTS[name], idle_W=5.0), TERRAINS[ground])
    for _ in range(20):
        x, u = rng.normal(0, 2, len(p.robot.state_names)), RobotInput(rng.normal(0, 5, p.robot.driven), 0.05)
        split = power(x, u, p, forces(x, u, p))
        assert split.residual == pytest.approx(0.0, abs=1e-9 * (1 + abs(split.battery)))
        assert split.idle == 5.0
        assert min(split.copper, split.drive, split.slip, split.rolling) >= 0.0


def simulated(ground, current_A, grade_rad=0.0):
    """A drive of the model, as a log and as an observer that is always right would see it."""
    p = scene(ROBOT, ground)

    def one(x, i):
        found = step(x, RobotInput(i, grade_rad), p, DT)
        return found.state, (found, forces(found.state, RobotInput(i, grade_rad), p))

    x0 = np.zeros(4)
    _, (steps, on_wheels) = Kernel(one, x0, np.zeros(2)).scan(x0, np.repeat(current_A[:, None], 2, axis=1))
    x = np.asarray(steps.state)
    time_s = DT * np.arange(len(x))
    seen = SimpleNamespace(
        speed_m_s=x[:, 0],
        yaw_rate_rad_s=x[:, 1],
        wheel_speed_rad_s=x[:, 2:],
        slip_speed_m_s=on_wheels.slip_speed_m_s[:, :2],
        slip_speed_std_m_s=np.full((len(x), 2), 0.01),
        traction_N=on_wheels.traction_N[:, :2],
        grade_rad=np.full(len(x), grade_rad),
        grade_std_rad=np.full(len(x), 0.01),
    )
    wheels = np.column_stack([x[:, 2:], np.full((len(x), 2), np.nan)])
    return p, DriveLog("simulated", time_s, wheels, np.repeat(current_A[:, None], 2, axis=1)), seen, steps.energy


@pytest.mark.parametrize(("ground", "grade"), [(HARD, 0.0), (SLIPPERY, 0.05)])
def test_a_recorded_drive_gives_back_what_the_simulation_spent(ground, grade):
    ramp = np.linspace(0.0, 1.0, 500)
    current = 4.0 * np.concatenate([ramp, np.ones(1500), 1 - ramp, np.zeros(500), -0.5 * ramp])
    p, log, seen, flows = simulated(ground, current, grade)
    split = drive_balance(log, seen, p)
    energy = integrate_drive(log, split, seen, p.robot)
    for found in (split, energy.balance):
        total = sum(getattr(found, name) for name in DRIVE_TERMS)
        assert total == pytest.approx(found.battery, rel=1e-12, abs=1e-12)
    for name in ("copper", "drive", "slip", "rolling", "climb"):
        spent = float(np.sum(getattr(flows, name)))
        assert getattr(energy.balance, name) == pytest.approx(spent, rel=0.01, abs=0.3), name
    assert energy.balance.residual == pytest.approx(0.0, abs=0.01 * energy.balance.battery)


def test_braking_gives_back_and_is_counted_as_such():
    current = np.concatenate([np.full(1500, 4.0), np.full(400, -3.0)])
    p, log, seen, _ = simulated(HARD, current)
    split = drive_balance(log, seen, p, idle_W=0.0)
    energy = integrate_drive(log, split, seen, p.robot)
    assert split.battery[1600] < 0 and split.kinetic[1600] < 0
    assert energy.regenerated_J == pytest.approx(-np.trapezoid(np.minimum(split.battery, 0.0), log.time_s))
    assert energy.regenerated_J > 5.0


def test_power_that_the_models_do_not_explain_is_the_residual():
    p, log, seen, _ = simulated(HARD, np.full(800, 2.0))
    plain = drive_balance(log, seen, p)
    measured = drive_balance(log, seen, p, battery_W=plain.battery + 7.0)
    assert measured.residual - plain.residual == pytest.approx(np.full(800, 7.0))


def test_uncertainties_are_those_of_slip_and_grade():
    p, log, seen, _ = simulated(HARD, np.full(800, 2.0))
    energy = integrate_drive(log, drive_balance(log, seen, p), seen, p.robot)
    distance_m = np.trapezoid(seen.speed_m_s, log.time_s)
    assert energy.std_J["climb"] == pytest.approx(42.0 * 9.80665 * 0.01 * distance_m)
    assert energy.std_J["slip"] == pytest.approx(0.01 * np.trapezoid(np.abs(seen.traction_N).sum(axis=1), log.time_s))


def test_gaps_are_left_out():
    p, log, seen, _ = simulated(HARD, np.full(800, 2.0))
    holes = log.motor_current_A.copy()
    holes[300:500] = np.nan
    log = replace(log, motor_current_A=holes)
    energy = integrate_drive(log, drive_balance(log, seen, p), seen, p.robot)
    assert energy.balance.idle == pytest.approx(8.0 * DT * (799 - 201))
    assert all(np.isfinite(getattr(energy.balance, name)) for name in DRIVE_TERMS)


def test_without_motor_currents_there_is_no_balance():
    p, log, seen, _ = simulated(HARD, np.full(10, 2.0))
    with pytest.raises(InputError, match="needs the currents of all 2 motors"):
        drive_balance(replace(log, motor_current_A=np.full((10, 2), np.nan)), seen, p)
