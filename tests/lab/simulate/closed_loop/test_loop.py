"""The loop as a whole: energy, determinism, delays, both plants, reverse, limits of the battery."""

from dataclasses import replace

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward_lab.simulate import closed_loop
from ohmward_lab.simulate.closed_loop import Command, Control, Grade, Observing, Pack, Patch, Scenario, Sensing
from ohmward_lab.simulate.closed_loop.run import columns, drive_log, figures, true_slip

FLOOR = Patch(friction=0.5, rolling=0.01)
ICE = Patch(friction=0.08, rolling=0.01, from_m=0.5, to_m=1.2)
DRIVE = Scenario(
    duration_s=2.0,
    commands=(Command(speed_m_s=0.6), Command(1.5, speed_m_s=0.0)),
    ground=(FLOOR, ICE),
    grade=Grade((0.2, 0.6), (0.0, 0.04)),
    controller=Control(acceleration_m_s2=1.0),
)
#: Without noise, and with the true speed fed back.
EXACT = replace(DRIVE, sensors=Sensing(drive_speed_std_rad_s=1e-9), observer=Observing("true"))


@pytest.fixture(scope="module")
def drive():
    return closed_loop.run(DRIVE)


def test_the_energy_of_the_battery_is_accounted_for(drive):
    energy = drive.history.energy_J
    assert np.abs(energy.residual).max() <= 1e-9 * energy.battery[-1]
    assert energy.idle[-1] == pytest.approx(10.0 * 2.0)
    assert np.abs(energy.numerical).max() < 1e-3 * energy.battery[-1]
    assert np.abs(energy.resistor).max() < 1e-9 * energy.battery[-1]
    for loss in (energy.copper, energy.slip, energy.rolling):
        assert np.diff(loss).min() >= -1e-12


def test_the_charge_is_that_of_the_energy(drive):
    """What left the terminals, over a voltage between the lowest and the highest."""
    charge_As = (0.8 - drive.history.soc[-1]) * 12 * 3600
    mean_V = drive.history.energy_J.battery[-1] / charge_As
    assert drive.history.voltage_V.min() < mean_V < drive.history.voltage_V.max()


def test_the_robot_does_as_it_is_told(drive):
    truth = drive.history.truth
    assert truth.speed_m_s.max() == pytest.approx(0.6, abs=0.1)
    assert drive.warnings == ()
    estimate = drive.rows.estimate
    assert np.sqrt(np.mean((estimate.speed_m_s - drive.rows.truth.speed_m_s) ** 2)) < 0.04


@pytest.mark.slow
def test_the_same_seed_gives_the_same_run_and_another_another(drive):
    again, other = closed_loop.run(DRIVE), closed_loop.run(replace(DRIVE, seed=2))
    for name, values in columns(drive).items():
        assert np.array_equal(values, columns(again)[name], equal_nan=True)
    assert not np.array_equal(
        columns(drive)["front_left_motor_current_A"], columns(other)["front_left_motor_current_A"]
    )


@pytest.mark.slow
def test_reverse_is_the_mirror_of_forward():
    level = replace(EXACT, grade=Grade(), ground=(FLOOR,), sensors=Sensing(drive_speed_std_rad_s=1e-300))
    level = replace(level, commands=(Command(speed_m_s=0.6),), duration_s=0.6)
    robot = replace(level.model, height_m=0.0)
    mirrored = replace(level, commands=(Command(speed_m_s=-0.6),))
    for scenario in (level, mirrored):
        object.__setattr__(scenario, "model", robot)
    forward, reverse = closed_loop.run(level).history, closed_loop.run(mirrored).history
    assert reverse.truth.speed_m_s == pytest.approx(-forward.truth.speed_m_s, rel=1e-9)
    assert true_slip(reverse, robot) == pytest.approx(true_slip(forward, robot), rel=1e-9, nan_ok=True)
    assert reverse.energy_J.battery == pytest.approx(forward.energy_J.battery, rel=1e-9)


@pytest.mark.slow
def test_our_plant_agrees_with_mujoco():
    """Both with the creep law, and without rolling resistance, which brakes wheels in MuJoCo and the body in ours."""
    pytest.importorskip("mujoco", reason="the plant needs MuJoCo: pip install mujoco")
    smooth = tuple(replace(patch, rolling=0.0) for patch in EXACT.ground)
    ours, theirs = (closed_loop.run(replace(EXACT, plant=plant, ground=smooth)) for plant in ("own", "mujoco"))
    assert ours.history.truth.speed_m_s == pytest.approx(theirs.history.truth.speed_m_s, abs=2e-3)
    assert ours.history.truth.position_m[-1, 0] == pytest.approx(theirs.history.truth.position_m[-1, 0], rel=2e-3)
    assert ours.history.truth.normal_N == pytest.approx(theirs.history.truth.normal_N, abs=2.0)
    mine, other = (run.history.energy_J for run in (ours, theirs))
    assert mine.battery[-1] == pytest.approx(other.battery[-1], rel=3e-3)
    assert mine.slip[-1] == pytest.approx(other.slip[-1], rel=0.06)
    assert abs(other.numerical[-1]) < 1e-3 * other.battery[-1]


@pytest.mark.slow
def test_late_samples_are_used_late():
    late = replace(DRIVE, duration_s=0.5, commands=(Command(speed_m_s=0.6),), sensors=Sensing(delay_s=0.04))
    rows = closed_loop.run(late).rows
    assert rows.time_s[-1] == pytest.approx(0.46)


@pytest.mark.slow
def test_a_controller_without_fresh_speeds_gives_up_and_says_so():
    slow = replace(DRIVE, duration_s=0.4, commands=(Command(speed_m_s=0.6),), sensors=Sensing(interval_s=0.3))
    run = closed_loop.run(slow)
    assert any("too old or too uncertain" in warning for warning in run.warnings)
    assert run.history.truth.torque_N_m[-30:].max() < run.history.truth.torque_N_m.max() / 2


@pytest.mark.parametrize("sensors", [Sensing(drop_share=1.0), Sensing(delay_s=1.0)])
def test_sensors_of_which_nothing_arrives_are_refused(sensors):
    short = replace(DRIVE, duration_s=0.1, commands=(Command(speed_m_s=0.6),), sensors=sensors)
    with pytest.raises(InputError, match=r"no sample of the sensors arrived in 0\.1 s; lower sensors\.drop_share"):
        closed_loop.run(short)


@pytest.mark.slow
def test_slip_that_the_motors_cannot_give_is_said():
    strong = Scenario(
        0.8,
        (Command(slip_ratio=0.5),),
        ground=(FLOOR,),
        observer=Observing("true"),
        controller=Control("slip", torque_limit_Nm=2.0),
    )
    run = closed_loop.run(strong)
    assert any("the slip asked for did not come about" in warning for warning in run.warnings)
    assert np.isnan(figures(run).slip_settle_s)


@pytest.mark.parametrize(
    "law", ["sliding-mode", *(pytest.param(law, marks=pytest.mark.slow) for law in ("fuzzy", "pid"))]
)
def test_slip_is_held_on_the_true_speed(law):
    scenario = Scenario(
        1.0,
        (Command(slip_ratio=0.12),),
        ground=(Patch(friction=0.2, rolling=0.01),),
        observer=Observing("true"),
        controller=Control("slip", law),
    )
    found = figures(closed_loop.run(scenario))
    assert found.slip_settle_s < 0.4
    assert found.slip_rms_error < 0.01


@pytest.mark.slow
def test_a_full_battery_leaves_the_braking_to_the_resistor():
    full = replace(
        EXACT,
        battery=Pack(start_soc=1.0),
        commands=(Command(torque_Nm=3.0), Command(1.0, torque_Nm=-3.0)),
        ground=(Patch(friction=2.0),),
        grade=Grade(),
        controller=Control("torque"),
    )
    run = closed_loop.run(full)
    assert np.diff(run.history.energy_J.resistor).min() > -1e-9
    assert run.history.energy_J.resistor[-1] > 1.0
    assert np.abs(run.history.energy_J.residual).max() < 1e-9 * run.history.energy_J.battery.max()


def test_an_empty_battery_ends_the_drive():
    run = closed_loop.run(replace(EXACT, battery=Pack(start_soc=1e-4)))
    assert run.history.truth.time_s[-1] < 1.0
    assert len(run.rows.time_s) >= 1
    assert any("the battery is empty" in warning for warning in run.warnings)


@pytest.mark.slow
def test_a_weak_battery_limits_the_torque():
    weak = replace(EXACT, battery=Pack(start_soc=0.02), ground=(Patch(friction=2.0),), grade=Grade())
    run = closed_loop.run(replace(weak, commands=(Command(torque_Nm=8.0),), controller=Control("torque")))
    assert any("limited the torque" in warning for warning in run.warnings)
    assert run.history.voltage_V.min() > 0.99 * weak.battery.battery.voltage_min_V


def test_progress_is_told():
    told = []
    closed_loop.run(
        replace(EXACT, duration_s=0.5, commands=(Command(speed_m_s=0.1),)), lambda k, n: told.append((k, n))
    )
    assert told == [(0, 500), (200, 500), (400, 500)]


def test_the_log_says_what_was_measured_and_what_was_true(drive):
    table, log = columns(drive), drive_log(drive)
    assert log.time_s == pytest.approx(np.arange(0.0, 2.001, 0.01))
    assert log.wheel_speed_rad_s.shape == (201, 4)
    assert np.isnan(log.wheel_speed_rad_s[:, 2:]).all()
    assert table["soc_true"][0] == 0.8
    assert np.isfinite(table["voltage_V"]).all()
    assert "speed_m_s" not in table
    assert table["front_left_slip_true"] == pytest.approx(drive.rows.truth.slip_ratio[:, 0], nan_ok=True)
    assert "simulated, not measured: RLMA, seed 1" in str(log.notes[0])


def test_the_logged_charge_is_the_charge_that_flowed(drive):
    """Means between the rows: coulombs are kept but for the sensor's offset and noise."""
    table = columns(drive)
    flowed_As = float(np.sum(table["current_A"][1:]) * 0.01)
    true_As = (drive.rows.soc[-1] - drive.rows.soc[0]) * 12 * 3600
    assert flowed_As == pytest.approx(true_As + 0.02 * 2.0, abs=5 * 0.02 * 0.01 * np.sqrt(200) + 0.006 * 2.0)


def test_mujoco_refuses_what_it_cannot_be():
    pytest.importorskip("mujoco", reason="the plant needs MuJoCo: pip install mujoco")
    scenario = Scenario(1.0, (Command(speed_m_s=0.1),), plant="mujoco", ground=(FLOOR,))
    with pytest.raises(InputError, match="four wheels on two axles, not omni-wheels"):
        closed_loop.run(replace(scenario, robot="robotino"))
    with pytest.raises(InputError, match="knows one rolling resistance"):
        closed_loop.run(replace(scenario, ground=(FLOOR, Patch(friction=0.1, from_m=1.0))))
    with pytest.raises(InputError, match="soils out of"):
        closed_loop.run(replace(scenario, ground=(Patch(terrain="soft soil"),)))


START = (Command(speed_m_s=0.6),)
ROLLING = replace(EXACT, start_speed_m_s=1.0, commands=START, grade=Grade(), ground=(FLOOR,), duration_s=0.6)
COASTING = (Command(torque_Nm=0.0),)


def largest_speed_error(run):
    return np.abs(run.rows.estimate.speed_m_s - run.rows.truth.speed_m_s).max()


def test_a_robot_that_rolls_at_the_start_keeps_rolling_and_its_observer_knows():
    coasting = replace(ROLLING, commands=COASTING, controller=Control("torque"), observer=Observing("ukf"))
    run = closed_loop.run(coasting)
    assert run.history.truth.speed_m_s[-1] == pytest.approx(1.0 - 0.6 * 0.01 * 9.81, abs=0.01)
    assert largest_speed_error(run) < 0.02


@pytest.mark.parametrize("plant", ["own", "mujoco"])
def test_drag_takes_what_it_should(plant):
    if plant == "mujoco":
        pytest.importorskip("mujoco", reason="the plant needs MuJoCo: pip install mujoco")
    ground = (Patch(friction=0.5, rolling=0.0),)
    coasting = replace(ROLLING, plant=plant, ground=ground, commands=COASTING, controller=Control("torque"))
    coasting = replace(coasting, drag_N_s2_per_m2=32.0)
    run = closed_loop.run(coasting)
    truth, mass = run.history.truth, coasting.model.inertia[0] + coasting.model.inertia[2:].sum() / 0.12**2
    assert truth.speed_m_s[-1] == pytest.approx(1 / (1 + 32.0 / mass * 0.6), rel=0.01)
    power_W = 32.0 * truth.speed_m_s**3
    assert run.history.energy_J.drawbar[-1] == pytest.approx(np.trapezoid(power_W, truth.time_s), rel=0.02)
    assert abs(run.history.energy_J.numerical[-1]) < 0.01 * run.history.energy_J.drawbar[-1]


def test_a_mode_takes_over_in_the_middle_of_a_drive():
    switching = replace(
        ROLLING,
        start_speed_m_s=0.0,
        commands=(Command(slip_ratio=0.12), Command(0.3, speed_m_s=0.5, mode="speed")),
        controller=Control("slip"),
    )
    run = closed_loop.run(switching)
    torque, time = run.history.truth.torque_N_m[:, 0], run.history.truth.time_s
    assert np.abs(np.diff(torque[(time > 0.2)])).max() < 12.0
    assert np.abs(run.history.truth.slip_ratio[(time > 0.28) & (time < 0.3), 0] - 0.12).max() < 0.02
    assert run.history.truth.speed_m_s[-1] == pytest.approx(0.5, abs=0.12)
    assert [tracked.slip_ratio for tracked in figures(run).slip] == [0.12]


def test_the_observer_of_momentum_serves_the_loop():
    standing_first = (Command(torque_Nm=0.0, mode="torque"), Command(0.5, slip_ratio=0.12))
    sensors = Sensing(interval_s=0.001, encoders="all")
    run = closed_loop.run(
        replace(
            DRIVE,
            duration_s=1.2,
            commands=standing_first,
            ground=(FLOOR,),
            grade=Grade(),
            sensors=sensors,
            observer=Observing("momentum"),
            controller=Control("slip"),
        )
    )
    assert largest_speed_error(run) < 0.02
    late = run.history.truth.time_s > 0.9
    assert np.abs(run.history.truth.slip_ratio[late, :2] - 0.12).max() < 0.03
