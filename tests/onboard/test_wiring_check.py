import math
import re

import numpy as np
import pytest

from ohmward import generic_battery
from ohmward.onboard.robot_state import Level
from ohmward.onboard.wiring_check import CurrentCheck, Recorder, SignalRecord, check_wheels, check_wiring
from ohmward.traction.robot.packaged import RLMA

PLACES = [place.name for place in RLMA.places]
WHEELS = [f"wheel_speed_rad_s.{name}" for name in PLACES]
MOTORS = [f"motor_current_A.{name}" for name in PLACES[: RLMA.driven]]


@pytest.fixture(scope="module")
def battery():
    return generic_battery("lfp", 10.0, 4)


def drive(change=lambda values: values, seconds=20):
    """A robot that drives and turns, sets out and stops, its sensors at 50 Hz."""
    recorder, draw = Recorder(), np.random.default_rng(1)
    for k in range(50 * seconds):
        t = 0.02 * k
        speed_m_s, yaw_rate = 0.8 * (k % 200 > 100), 0.5 * math.sin(0.7 * t)
        turning = RLMA.rolling @ np.array([speed_m_s, yaw_rate]) / RLMA.wheel.radius_m
        current_A = -0.5 - 4.0 * (speed_m_s > 0) + draw.normal(0, 0.02)
        values = dict(zip(WHEELS, turning + draw.normal(0, 0.02, 4), strict=True))
        values |= dict.fromkeys(MOTORS, 0.6 * (speed_m_s > 0))
        values |= {
            "yaw_rate_rad_s": yaw_rate,
            "battery_current_A": current_A,
            "battery_voltage_V": 13.2 + 0.03 * current_A + draw.normal(0, 0.002),
            "battery_temperature_degC": 21.0,
        }
        recorder.put("robot", t, change({s: float(v) for s, v in values.items()}))
    return recorder.signals()


def findings(change=lambda values: values, battery=None, robot=RLMA, promised=None):
    found = check_wiring(drive(change), promised or {"robot": ()}, battery, robot)
    return {f.name: f.message for f in found if f.level == Level.ERROR}


def test_a_robot_that_is_wired_as_it_should_be_passes(battery):
    found = check_wiring(drive(), {"robot": (*WHEELS, "battery_current_A")}, battery, RLMA)
    assert [f for f in found if f.level != Level.OK] == []
    told = {f.name: f.message for f in found}
    assert "agree" in told["signs of wheels and gyro"]


def scaled(factor, *signals, offset=0.0):
    return lambda values: values | {s: factor * values[s] + offset for s in signals}


WRONG = {
    "current": (scaled(-1.0, "battery_current_A"), "battery_current_A", "wrong sign.*scale = -1"),
    "wheel": (scaled(-1.0, WHEELS[1]), WHEELS[1], "wrong sign.*scale = -1"),
    "gyro": (scaled(-1.0, "yaw_rate_rad_s"), "yaw_rate_rad_s", "wrong sign.*scale = -1"),
    "motor": (scaled(-1.0, MOTORS[0]), MOTORS[0], "wrong sign.*scale = -1"),
    "millivolts": (scaled(1000.0, "battery_voltage_V"), "battery_voltage_V", "millivolts. then scale = 0.001"),
    "milliamperes": (scaled(1000.0, "battery_current_A"), "battery_current_A", "milliamperes. then scale = 0.001"),
    "kelvins": (
        scaled(1.0, "battery_temperature_degC", offset=273.15),
        "battery_temperature_degC",
        "kelvins. then offset = -273.15",
    ),
    "no number": (scaled(math.nan, "battery_voltage_V"), "battery_voltage_V", "no number in any of its values"),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_is_named_with_its_fix(battery, name):
    change, signal, text = WRONG[name]
    found = findings(change, battery)
    assert set(found) == {signal}
    assert re.search(text, found[signal])


def test_rpm_are_told(battery):
    found = findings(scaled(60 / (2 * math.pi), *WHEELS), battery)
    assert any("rpm? then scale = 0.1047" in text for text in found.values())


def test_what_never_came_is_named(battery):
    def cut(values):
        return {s: v for s, v in values.items() if s not in (WHEELS[0], "battery_current_A")}

    found = findings(cut, battery, promised={"robot": (WHEELS[0],), "other": ("battery_full",)})
    assert "never came from robot" in found[WHEELS[0]] or "wheel is driven" in found[WHEELS[0]]
    assert "the charge needs it" in found["battery_current_A"]
    assert "nothing came" in found["other"]


def test_a_wheel_that_the_robot_does_not_have_is_named(battery):
    found = findings(lambda values: values | {"wheel_speed_rad_s.middle": 1.0}, battery)
    fault = f"the robot has no such wheel; it has {', '.join(PLACES)}"
    assert found == {"wheel_speed_rad_s.middle": f"{fault}; leave it out of the source, or correct the robot file"}


@pytest.mark.parametrize(
    ("senders", "names"),
    [
        ([("can0", ""), ("mqtt", "")], "can0 and mqtt"),
        ([("ros2", "/bms"), ("ros2", "/bms (publisher 2)")], "/bms (publisher 2) of ros2 and /bms of ros2"),
    ],
    ids=["sources", "publishers of a topic"],
)
def test_two_that_send_a_quantity_are_named(battery, senders, names):
    recorder = Recorder()
    for k in range(100):
        for source, publisher in senders:
            recorder.put(source, 0.1 * k, {"battery_voltage_V": 13.0, "battery_full": 0.0}, publisher)
    found = check_wiring(recorder.signals(), {}, battery, None)
    assert [f.name for f in found if f"{names} both send it" in f.message] == ["battery_voltage_V"]


def test_straight_ahead_the_gyro_is_open(battery):
    speeds = drive()[WHEELS[0]].values / RLMA.wheel.radius_m
    recorder = Recorder()
    for k, speed in enumerate(np.abs(speeds) + 2.0):
        recorder.put("robot", 0.02 * k, dict.fromkeys(WHEELS, speed) | {"yaw_rate_rad_s": 0.0})
    (found,) = check_wheels(recorder.signals(), RLMA)
    assert found.level == Level.WARN and "turn a little" in found.message


def test_at_rest_signs_are_open_and_nothing_is_wrong(battery):
    still = dict.fromkeys((*WHEELS, *MOTORS, "yaw_rate_rad_s"), 0.0) | {"battery_current_A": -0.5}
    found = check_wiring(drive(lambda values: values | still), {"robot": ()}, battery, RLMA)
    assert {f.level for f in found} == {Level.OK, Level.WARN}
    assert any(f.name == "battery_current_A" and "drive a little" in f.message for f in found)


@pytest.mark.parametrize("signals", [(), ("battery_current_A", "battery_voltage_V", *WHEELS)])
def test_a_source_that_sent_nothing_is_one_finding(battery, signals):
    promised = {"can": signals}
    wrong = [f for f in check_wiring({}, promised, battery, RLMA) if f.level == Level.ERROR]
    assert [(f.name, f.message) for f in wrong] == [
        ("can", "nothing came; is the other side on, connected and sending?")
    ]


def test_a_passive_wheel_has_no_motor(battery):
    found = findings(lambda values: values | {"motor_current_A.3": 0.0}, battery)
    fault = f"the robot has no such motor; it has {', '.join(PLACES[: RLMA.driven])}"
    assert found == {"motor_current_A.3": f"{fault}; leave it out of the source, or correct the robot file"}


@pytest.mark.parametrize(("recent", "after_s", "named"), [(False, 0.0, True), (True, 20.0, False), (True, 40.0, True)])
def test_a_wrong_sign_in_small_changes_alone_is_named_live_once_two_records_show_it(battery, recent, after_s, named):
    rng, check = np.random.default_rng(1), CurrentCheck(battery, recent)
    current_A = -5.0 + 0.05 * rng.normal(size=1500)
    times_s = 0.05 * np.arange(current_A.size)
    values = {"battery_current_A": current_A, "battery_voltage_V": 13.0 - 0.05 * current_A}
    for begin_s in (0.0, after_s):
        of_record = (times_s >= begin_s) & (times_s < begin_s + 30.0)
        found = check.findings(
            {s: SignalRecord(("can0",), times_s[of_record], v[of_record]) for s, v in values.items()}
        )
    assert [finding.level for finding in found] == [Level.ERROR] * named


def test_a_robot_that_brakes_while_it_is_listened_to_has_no_wrong_sign(battery):
    """From 1.9 m/s to a stop in twenty seconds; the motors take half of the energy that it gives up."""
    recorder, deceleration = Recorder(), 0.095
    force_A = RLMA.mass_kg * RLMA.wheel.radius_m / RLMA.driven / RLMA.motor.wheel_constant_Nm_per_A
    for k in range(1000):
        speed_m_s = 1.9 - deceleration * 0.02 * k
        values = dict.fromkeys(WHEELS, speed_m_s / RLMA.wheel.radius_m)
        values |= dict.fromkeys(MOTORS, -0.5 * deceleration * force_A)
        recorder.put("robot", 0.02 * k, values)
    found = check_wiring(recorder.signals(), {"robot": ()}, None, RLMA)
    assert [f for f in found if f.level == Level.ERROR] == []
