import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ohmward import SocEstimator, generic_battery
from ohmward.battery.cells.pack_estimator import PackEstimator
from ohmward.onboard.estimation import Estimation
from ohmward.traction.inbox import SensorInbox
from ohmward.traction.odometry.estimator import Odometry
from ohmward.traction.robot.packaged import RLMA
from ohmward.traction.speed_observer.estimator import SlipEstimator

PLACES = [place.name for place in RLMA.places]


@pytest.fixture(scope="module")
def battery():
    return generic_battery("nmc", 10.0, 4)


def last(states) -> Any:
    """The newest state; its parts are there."""
    return states[-1]


def current(t):
    return -3.0 - 2.0 * math.sin(0.3 * t)


def voltage(t):
    return 15.2 + 0.03 * current(t) - 1e-3 * t


@pytest.mark.usefixtures("in_python")
def test_the_charge_is_that_of_the_estimator(battery):
    estimation, alone = Estimation(battery), SocEstimator(battery)
    for k in range(100):
        t = 0.1 * k
        values = {"battery_current_A": current(t), "battery_voltage_V": voltage(t), "battery_temperature_degC": 21.0}
        (state,) = estimation.put(t, values)
        assert state.battery == alone.update(t, current(t), voltage(t), 21.0)
        assert state.time_s == state.battery_time_s == t
        assert math.isnan(state.drive_time_s)


def test_current_and_voltage_of_two_sources_make_one_sample(battery):
    """Current at 100 Hz from one source, voltage and temperature at 10 Hz from another, half a step apart."""
    estimation, whole = Estimation(battery), SocEstimator(battery)
    found = []
    for k in range(2000):
        t = 0.01 * k
        found += estimation.put(t, {"battery_current_A": current(t)})
        if k % 10 == 9:
            found += estimation.put(t + 0.005, {"battery_voltage_V": voltage(t), "battery_temperature_degC": 21.0})
        expected = whole.update(t, current(t), voltage(t), 21.0)
    assert len(found) == 200
    assert last(found).battery.soc == pytest.approx(expected.soc, abs=2e-3)
    assert not last(found).battery.flags


def test_cells_are_estimated_where_their_voltages_come(battery):
    estimation, alone = Estimation(battery), None
    for k in range(50):
        t = 0.1 * k
        cells = [voltage(t) / 4 + 0.002 * j for j in (-1.5, -0.5, 0.5, 1.5)]
        measured = {"battery_current_A": current(t), "battery_voltage_V": sum(cells)}
        states = estimation.put(t, measured | {f"cell_voltage_V.{j}": cell_V for j, cell_V in enumerate(cells)})
        if alone is None:
            alone = PackEstimator(battery)
        expected = alone.update(t, current(t), cells, math.nan)
    found = last(states).cells
    np.testing.assert_allclose(found.cells.soc, expected.cells.soc, atol=1e-3)
    assert found.pack.weakest == expected.pack.weakest == 0


def test_cells_alone_give_the_voltage_of_the_pack(battery):
    estimation = Estimation(battery)
    for k in range(30):
        t = 0.1 * k
        cells = {f"cell_voltage_V.{j}": voltage(t) / 4 for j in range(4)}
        states = estimation.put(t, {"battery_current_A": current(t)} | cells)
    assert last(states).battery.voltage_V == pytest.approx(voltage(t), abs=0.1)


def test_a_charger_that_says_full_is_heard(battery):
    estimation = Estimation(battery)
    estimation.put(0.0, {"battery_full": 1.0})
    for k in range(3):
        states = estimation.put(float(k), {"battery_current_A": 0.1, "battery_voltage_V": 16.0})
    assert last(states).battery.soc == pytest.approx(1.0, abs=0.02)
    assert last(states).battery.soc_std < 0.03


def drive(estimation, wheels_apart=False):
    states = []
    for k in range(200):
        t = 0.01 * k
        speeds = {f"wheel_speed_rad_s.{name}": min(2.0, t) for name in PLACES}
        currents = {f"motor_current_A.{name}": 0.6 for name in PLACES[: RLMA.driven]}
        if wheels_apart:
            for j, (signal, value) in enumerate((currents | speeds).items()):
                states += estimation.put(t + 1e-4 * j, {signal: value})
        else:
            states += estimation.put(t, speeds | currents)
    return states


def test_a_sample_of_the_drive_is_estimated_at_once():
    """No sample waits for the next one, and the estimate is that of the observer alone."""
    estimation, alone, inbox = Estimation(robot=RLMA), SlipEstimator(RLMA), SensorInbox(RLMA, 0.0, prompt=True)
    states = drive(estimation)
    assert [state.drive_time_s for state in states] == pytest.approx([0.01 * k for k in range(200)])
    for k in range(200):
        t = 0.01 * k
        inbox.put(t, wheel_speed_rad_s=[min(2.0, t)] * 4, current_A=[0.6] * RLMA.driven)
        (sample,) = inbox.take()
        expected = alone.update(**sample)
    assert last(states).slip.speed_m_s == expected.speed_m_s
    assert last(states).pose.x_m == pytest.approx(last(states).pose.distance_m)


def test_a_drive_after_a_long_silence_is_not_late():
    estimation = Estimation(robot=RLMA)
    for time_s in (0.0, 0.1, 3600.0, 3600.1, 3599.0):
        estimation.put(time_s, {f"wheel_speed_rad_s.{place}": 2.0 for place in PLACES})
    assert (estimation.late, estimation.late_s) == (1, pytest.approx(1.1))
    assert estimation.state.drive_time_s == 3600.1


def test_without_a_wheel_there_is_no_speed():
    """An inertial unit reports from the start, a wheel from 1 s on."""
    estimation = Estimation(robot=RLMA)
    for k in range(100):
        wheels = {f"wheel_speed_rad_s.{place}": 2.0 for place in PLACES} if k >= 50 else {}
        for state in estimation.put(0.02 * k, {"yaw_rate_rad_s": 0.01, "wheel_speed_rad_s.axle": 2.0} | wheels):
            assert (state.slip is None) == (state.pose is None) == (state.drive_time_s < 0.999)
            assert state.is_silent("drive") == (state.slip is None)
    assert state.slip is not None


def test_without_motor_currents_the_pose_is_that_of_wheels_and_gyro():
    estimation, alone = Estimation(robot=RLMA), Odometry(RLMA)
    for k in range(200):
        t, speeds = 0.02 * k, dict.fromkeys((f"wheel_speed_rad_s.{name}" for name in PLACES), min(2.0, 0.02 * k))
        outside = {"speed_m_s": 0.12 * min(2.0, t)} if k % 50 == 0 else {}
        states = estimation.put(t, speeds | outside | {"yaw_rate_rad_s": 0.01})
        expected = alone.update(t, [min(2.0, t)] * 4, 0.01, speed_m_s=outside.get("speed_m_s"))
    for value, other in zip(last(states).pose, expected, strict=True):
        np.testing.assert_allclose(value, other, atol=1e-12)


def test_without_motor_currents_slip_is_that_of_the_pose_and_names_the_wheel():
    estimation = Estimation(robot=RLMA)
    for k in range(200):
        speeds = {f"wheel_speed_rad_s.{place}": 4.0 for place in PLACES[:2]}
        speeds[f"wheel_speed_rad_s.{PLACES[0]}"] += 3.0 * (k > 150)
        state = last(estimation.put(0.02 * k, speeds | {"yaw_rate_rad_s": 0.001 * (k % 3)}))
    assert state.slip.speed_m_s == state.pose.speed_m_s == pytest.approx(0.48, abs=0.01)
    assert state.slip.slipping.tolist() == [1.0, 0.0]
    assert state.slip.slip_speed_m_s[0] == pytest.approx(3.0 * RLMA.wheel.radius_m, abs=0.01)


def test_a_heading_is_of_the_pose_alone():
    """A compass that turns by 0.05 rad while the wheels go straight on, and another robot without it."""
    plain, compass = Estimation(robot=RLMA), Estimation(robot=RLMA)
    for k in range(701):
        values = {f"wheel_speed_rad_s.{place}": 0.5 for place in PLACES}
        plain_state = last(plain.put(0.01 * k, values))
        heading = {"heading_rad": 2.0 + 0.05 * (k > 300), "heading_std_rad": 0.02}
        state = last(compass.put(0.01 * k, values | heading))
    assert state.sample["heading_rad"] == 2.05
    np.testing.assert_equal(tuple(state.slip), tuple(plain_state.slip))
    assert state.pose.yaw_rad > plain_state.pose.yaw_rad + 1e-5


def test_wheels_that_report_one_by_one_are_one_sample():
    states = drive(Estimation(robot=RLMA), wheels_apart=True)
    together = drive(Estimation(robot=RLMA))
    assert 198 <= len(states) <= 205
    assert last(states).slip.speed_m_s == pytest.approx(together[-1].slip.speed_m_s, abs=2e-3)


def test_signals_of_the_sample_have_names():
    state = drive(Estimation(robot=RLMA))[-1]
    assert state.sample[f"wheel_speed_rad_s.{PLACES[0]}"] == pytest.approx(1.99)
    assert all(isinstance(value, float) for value in state.sample.values())


def test_counts_become_speeds():
    estimation, speeds = Estimation(robot=RLMA, counts_per_turn=1000.0), []
    for k in range(100):
        counts = {f"wheel_counts.{j}": float(round(1000 * 0.05 * k / (2 * math.pi))) for j in range(4)}
        for state in estimation.put(0.01 * k, counts):
            speeds += [value for signal, value in state.sample.items() if signal.startswith("wheel_speed_rad_s")]
    assert np.mean(speeds[20:]) == pytest.approx(5.0, rel=0.02)


def test_what_the_robot_does_not_have_is_passed_over():
    estimation = Estimation(robot=RLMA)
    assert estimation.put(0.0, {"wheel_speed_rad_s.17": 1.0, "wheel_counts.0": 5.0, "battery_current_A": 1.0}) == []


def test_the_range_needs_battery_and_robot(battery):
    estimation: Any = Estimation(battery, RLMA)
    states: Any = estimation.put(0.0, {"battery_current_A": -1.0, "battery_voltage_V": 15.0})
    assert math.isnan(states[0].range.distance_m.p50)
    estimation.take_forecast(estimation.forecast()())
    (state,) = estimation.put(1.0, {"battery_current_A": -1.0, "battery_voltage_V": 15.0})
    assert state.range.distance_m.p10 < state.range.distance_m.p50 < state.range.distance_m.p90
    assert Estimation(battery).range is None


@pytest.mark.parametrize("left", [{}, {"yaw_rate_rad_s": 0.0}])
def test_the_range_learns_nothing_while_no_speed_is_measured(battery, left):
    """The wheels fall silent while the robot stands; what the battery then gives is not what it takes to stand."""
    estimation: Any = Estimation(battery, RLMA)
    learnt = {}
    for k in range(4000):
        wheels = {f"wheel_speed_rad_s.{place}": 8.0 * (k < 1200) for place in PLACES} if k < 1500 else left
        load_A = -0.5 if 1200 <= k < 1500 else -3.0
        estimation.put(0.1 * k, wheels | {"battery_current_A": load_A, "battery_voltage_V": 15.0})
        learnt[k] = estimation.range.consumption, estimation.range.state.recent
    assert learnt[1800] != learnt[1199]
    assert learnt[3999] == learnt[1800]


@pytest.mark.usefixtures("in_python")
def test_another_battery_begins_with_its_first_voltage(battery):
    """It was half empty, and another one, nearly full, is put in; an event that stays is one."""
    estimation, alone = Estimation(battery), SocEstimator(battery)
    for k in range(100):
        estimation.put(0.1 * k, {"battery_current_A": -3.0, "battery_voltage_V": 14.4})
    before = last([estimation.state]).battery.soc
    for k in range(100, 110):
        values = {"battery_changed": 1.0, "battery_current_A": 0.0, "battery_voltage_V": 16.5}
        state = last(estimation.put(0.1 * k, values))
        assert state.battery == alone.update(0.1 * k, 0.0, 16.5, math.nan)
    assert state.battery.soc > before + 0.2


def test_another_battery_begins_with_the_capacity_of_the_label(battery):
    """Not with that of the battery before, which had been learnt."""
    known = replace(battery, noise=replace(battery.noise, capacity_std=0.01))
    estimation, alone = Estimation(known, label=battery), SocEstimator(battery)
    estimation.put(0.0, {"battery_current_A": -3.0, "battery_voltage_V": 14.4})
    values = {"battery_changed": 1.0, "battery_current_A": 0.0, "battery_voltage_V": 16.5}
    assert last(estimation.put(1.0, values)).battery == alone.update(1.0, 0.0, 16.5, math.nan)
    assert estimation.battery == battery


def test_a_battery_that_was_just_put_in_is_not_silent(battery):
    """Nav2 would drive home for the percentage 0 of a silent one."""
    estimation = Estimation(battery)
    estimation.put(0.0, {"battery_current_A": -3.0, "battery_voltage_V": 14.4})
    estimation.put(0.5, {"battery_changed": 1.0})
    assert estimation.state.battery is None
    assert not estimation.state.is_silent("battery")


def test_a_forecast_of_the_battery_that_was_taken_out_is_ignored(battery):
    estimation: Any = Estimation(battery, RLMA)
    estimation.put(0.0, {"battery_current_A": -1.0, "battery_voltage_V": 15.0})
    compute = estimation.forecast()
    estimation.put(1.0, {"battery_changed": 1.0})
    estimation.take_forecast(compute())
    (state,) = estimation.put(2.0, {"battery_current_A": -1.0, "battery_voltage_V": 15.0})
    assert math.isnan(state.range.distance_m.p50)


@pytest.mark.parametrize(
    ("home_m", "at_s", "least", "most"), [(10.0, 0.5, 0.9, 1.0), (1e6, 0.5, 0.0, 0.1), (10.0, 90.0, math.nan, 0.0)]
)
def test_the_probability_of_reaching_home_is_that_of_a_way_given_lately(battery, home_m, at_s, least, most):
    estimation: Any = Estimation(battery, RLMA)
    estimation.put(0.0, {"home_distance_m": home_m})
    estimation.put(at_s, {"battery_current_A": -1.0, "battery_voltage_V": 15.0})
    estimation.take_forecast(estimation.forecast()())
    (state,) = estimation.put(at_s + 1.0, {"battery_current_A": -1.0, "battery_voltage_V": 15.0})
    found = state.range.home_probability
    assert math.isnan(found) if math.isnan(least) else least <= found <= most


def test_the_pose_begins_again_at_its_origin_when_asked_for():
    estimation, found = Estimation(None, RLMA), []
    for k in range(300):
        values = dict.fromkeys((f"wheel_speed_rad_s.{place}" for place in PLACES), 4.0) | {"yaw_rate_rad_s": 0.0}
        event = {"pose_reset": 1.0} if k == 200 else {"pose_reset": 0.0} if k == 201 else {}
        found += estimation.put(0.01 * k, values | event)
    x_m = [float(state.pose.x_m) for state in found if state.pose]
    assert x_m[195] > 0.8 and x_m[205] < 0.1
    assert x_m[-1] == pytest.approx(x_m[99], abs=0.02)


@pytest.mark.parametrize("left", [{"front_left"}, {"rear_left"}, {"front_right", "rear_left"}])
def test_the_speed_follows_whatever_wheels_are_left_where_no_motor_current_is(left):
    """Motor currents and some wheels are silent, and the robot brakes."""
    estimation = Estimation(None, RLMA)
    for k in range(500):
        speed_rad_s = (6.6 if k < 300 else 3.0) + 0.01 * math.sin(k)
        values = {f"wheel_speed_rad_s.{name}": speed_rad_s for name in PLACES if k < 250 or name in left}
        values |= {f"motor_current_A.{name}": 1.0 + 0.1 * math.sin(k) for name in PLACES[:2] if k < 250}
        estimation.put(0.02 * k, values | {"yaw_rate_rad_s": 0.001 * math.sin(k), "acceleration_m_s2": 0.0})
    slip = last([estimation.state]).slip
    assert abs(slip.speed_m_s - 3.0 * RLMA.wheel.radius_m) < 2.0 * slip.speed_std_m_s + 0.02
    assert slip.speed_m_s < 0.5


@pytest.mark.parametrize(
    ("chemistry", "silent_s", "soc"), [("nmc", 20.0, 0.95), ("nmc", 5.0, 0.75), ("lfp", 20.0, 0.8), ("lfp", 5.0, 0.75)]
)
def test_a_battery_that_was_changed_is_found_by_its_voltage(chemistry, silent_s, soc):
    """Of twenty minutes under a changing load the filter knows its errors, which another battery does not share."""
    battery = generic_battery(chemistry, 20.0, 7)
    curve, ohm = battery.thevenin.ocv, 0.3 * battery.thevenin.largest_ohm

    def after(estimation, begin_s, soc, seconds):
        for k in range(seconds):
            current_A = -1.0 - 5.0 * (k // 20 % 2) + 1e-4 * (k % 7)
            voltage_V = float(curve.mean_V(soc, 25.0)) + ohm * current_A + 1e-4 * (k % 5)
            estimation.put(begin_s + k, {"battery_current_A": current_A, "battery_voltage_V": voltage_V})
        return estimation.state.battery

    changed, same = Estimation(battery), Estimation(battery)
    before = after(changed, 0.0, 0.5, 1200), after(same, 0.0, 0.5, 1200)[:2]
    assert before[0].soc_std < 0.25
    now = after(changed, 1200.0 + silent_s, soc, 120)
    assert changed.swaps == 1 and changed.exchanged_s < 1260.0
    assert abs(now.soc - soc) < 2.0 * now.soc_std
    assert after(same, 1200.0 + silent_s, 0.5, 120)[:2] == pytest.approx(before[1], abs=0.02)
    assert same.swaps == 0
