import math
import random
import re

import numpy as np
import pytest

from ohmward import generic_battery
from ohmward.battery.models.thevenin import CircuitInput, ohmic_resistance
from ohmward.onboard.robot_state import Diagnostic, Level
from ohmward.onboard.sensor_watch import MISSED_S, MOST_SENSORS, SensorWatch
from ohmward.traction.robot.packaged import RLMA

PLACES = [place.name for place in RLMA.places]


@pytest.fixture(scope="module")
def battery():
    return generic_battery("lfp", 10.0, 4)


class Robot:
    """Ten seconds and more of sensors at 50 Hz: a robot that drives, with noise, and a fault from 5 s on."""

    def __init__(self, battery, fault=None, until_s=10.0):
        self.watch = SensorWatch(battery, RLMA)
        self.draw = random.Random(1)
        self.fault, self.until_s = fault or (lambda values: values), until_s
        self.told, self.clean = {}, []

    def sample(self, t):
        speed = 4.0 + 3.0 * math.sin(1.1 * t)
        current = -3.0 - 2.0 * math.sin(1.1 * t) + self.draw.gauss(0.0, 0.02)
        wheels = {f"wheel_speed_rad_s.{name}": speed + self.draw.gauss(0.0, 0.05) for name in PLACES}
        return wheels | {
            "battery_current_A": current,
            "battery_voltage_V": 13.1 + 0.03 * current + self.draw.gauss(0.0, 0.004),
            "yaw_rate_rad_s": self.draw.gauss(0.0, 0.01),
        }

    def run(self, begin_s=0.0, end_s=10.0, source="robot"):
        for k in range(int(begin_s * 50), int(end_s * 50)):
            t = 0.02 * k
            values = self.sample(t)
            if 5.0 <= t < self.until_s:
                values = self.fault(values)
            self.clean.append(self.watch.take(source, t, t, values))
            if k % 12 == 0:
                self.told |= {d.name: d for d in self.watch.look(t)}
        return self

    def wrong(self):
        return {name: d.message for name, d in self.told.items() if d.level != Level.OK}


def stuck(*signals):
    held: dict[str, float] = {}

    def fault(values):
        held.update({signal: held.get(signal, values[signal]) for signal in signals})
        return values | held

    return fault


def constant(signal, value):
    return lambda values: values | {signal: value}


def without(signal):
    return lambda values: {name: value for name, value in values.items() if name != signal}


def test_sensors_that_work_are_not_accused(battery):
    robot = Robot(battery).run(end_s=60.0)
    assert robot.wrong() == {}
    assert all(math.isfinite(value) for clean in robot.clean for value in clean.values())


def test_a_robot_at_rest_is_not_accused(battery):
    """All values are the same to the last bit, for a minute."""
    watch = SensorWatch(battery, RLMA)
    values = Robot(battery).sample(0.0) | {f"wheel_speed_rad_s.{name}": 0.0 for name in PLACES}
    for k in range(3000):
        watch.take("robot", 0.02 * k, 0.02 * k, values)
    assert [d for d in watch.look(60.0) if d.level != Level.OK] == []


WHEEL = f"wheel_speed_rad_s.{PLACES[0]}"

FAULTS = {
    "a wire that is off": (constant("battery_voltage_V", math.nan), "battery_voltage_V", "no number"),
    "a sensor in another unit": (constant("battery_voltage_V", 13100.0), "battery_voltage_V", "13100, which cannot"),
    "a silent sensor": (without("yaw_rate_rad_s"), "yaw_rate_rad_s", "silent"),
    "a stuck voltage": (stuck("battery_voltage_V"), "battery_voltage_V", "stuck"),
    "a stuck current": (stuck("battery_current_A"), "battery_current_A", "stuck"),
    "a stuck wheel": (stuck(WHEEL), WHEEL, "stuck"),
    "an encoder without its wire": (constant(WHEEL, 0.0), WHEEL, "stuck"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_named_kept_out_and_forgotten_when_it_is_over(battery, name):
    fault, signal, message = FAULTS[name]
    robot = Robot(battery, fault, until_s=17.0).run(end_s=16.0)
    assert set(robot.wrong()) == {signal}
    assert re.search(message, robot.wrong()[signal])
    assert not math.isfinite(robot.clean[-1].get(signal, math.nan))
    others = [value for other, value in robot.clean[-1].items() if other != signal]
    assert all(map(math.isfinite, others))
    robot.run(16.0, 19.0)
    assert robot.wrong() == {}
    assert math.isfinite(robot.clean[-1][signal])


@pytest.mark.parametrize("degC", [25.0, -15.0])
@pytest.mark.parametrize(
    ("factor", "ratio", "fix"),
    [
        (10.0, 0.6, "tenths of an ampere? then scale = 0.1"),
        (0.1, 1.6, "then scale = 10"),
        (1.0, 0.2, ""),
        (1.0, 5.0, ""),
    ],
)
def test_a_current_of_another_unit_from_the_start_is_named_with_a_label(degC, factor, ratio, fix):
    """A cell has `ratio` of the resistance of its label."""
    battery, draw = generic_battery("nmc", 20.0, 7), random.Random(1)
    ohm = ratio * float(ohmic_resistance(0.5, CircuitInput(0.0, degC), battery.thevenin))
    watch = SensorWatch(battery)
    for k in range(3000):
        t = 0.1 * k
        current = -2.0 - 3.0 * (t % 6.0 > 3.0)
        values = {
            "battery_current_A": factor * (current + draw.gauss(0.0, 0.02)),
            "battery_voltage_V": 25.9 + ohm * current + draw.gauss(0.0, 0.002),
            "battery_temperature_degC": degC + draw.gauss(0.0, 0.1),
        }
        watch.take("bms", t, t, values)
        wrong = [d.message for d in watch.look(t) if d.level != Level.OK]
    assert len(wrong) == bool(fix) and all(text.endswith(fix) for text in wrong)


@pytest.mark.parametrize(("factor", "message"), [(-1.0, "wrong sign.*scale = -1"), (10.0, "then scale = 0.1")])
def test_a_current_that_changes_sign_or_unit_is_named_and_not_used_until_it_is_right(battery, factor, message):
    """At 10 Hz, with a load that steps every 3 s; wrong in the second of three minutes."""
    watch, draw, used = SensorWatch(battery), random.Random(1), []
    told: dict[int, list[Diagnostic]] = {}
    for k in range(1800):
        t = 0.1 * k
        current = -2.0 - 3.0 * (t % 6.0 > 3.0)
        values = {
            "battery_current_A": (factor if 60.0 < t < 120.0 else 1.0) * (current + draw.gauss(0.0, 0.02)),
            "battery_voltage_V": 13.1 + 0.03 * current + draw.gauss(0.0, 0.002),
        }
        used.append(math.isfinite(watch.take("bms", t, t, values)["battery_current_A"]))
        told |= {k // 600: [d for d in watch.look(t) if d.level != Level.OK]}
    assert told[0] == told[2] == []
    ((name, level, text, _),) = told[1]
    assert (name, level) == ("battery_current_A", Level.ERROR)
    assert re.search(message, text)
    assert all(used[:600]) and not any(used[1000:1200]) and all(used[-100:])


def test_the_voltage_of_another_battery_accuses_no_current(battery):
    watch, draw, wrong = SensorWatch(battery), random.Random(1), []
    for k in range(1200):
        t = 0.1 * k
        current = -2.0 - 3.0 * (t % 6.0 > 3.0)
        voltage = (12.0 if t < 60.0 else 13.3) + 0.03 * current + draw.gauss(0.0, 0.002)
        watch.take("bms", t, t, {"battery_current_A": current + draw.gauss(0.0, 0.02), "battery_voltage_V": voltage})
        wrong += [d for d in watch.look(t) if d.level != Level.OK]
    assert wrong == []


def test_a_fault_of_a_slow_sensor_stays_named_between_its_values(battery):
    watch = SensorWatch(battery)
    for k in range(5):
        watch.take("bms", float(k), float(k), {"battery_temperature_degC": -127.0})
    told = [d for t in (4.2, 4.4, 4.6) for d in watch.look(t) if d.name == "battery_temperature_degC"]
    assert [d.level for d in told] == [Level.ERROR] * 3
    assert "its wire is off" in told[0].message


def test_a_source_that_repeats_its_last_message_is_stuck_until_it_goes_on(battery):
    held: dict[str, float] = {}

    def fault(values):
        held.update(held or values)
        return dict(held)

    robot = Robot(battery, fault, until_s=20.0)
    for k in range(50):  # a current that was the same for long before is not evidence, but stuck with the others
        robot.watch.take("robot", -1.0 + 0.02 * k, -1.0 + 0.02 * k, {"battery_current_A": -0.5})
    robot.run(end_s=20.0)
    noisy = {*(f"wheel_speed_rad_s.{name}" for name in PLACES), "battery_current_A", "battery_voltage_V"}
    assert set(robot.wrong()) == noisy | {"yaw_rate_rad_s"} and all("stuck" in m for m in robot.wrong().values())
    assert not any(map(math.isfinite, robot.clean[-1].values()))
    assert robot.run(20.0, 30.0).wrong() == {}


def test_encoders_that_stop_together_are_stuck_although_their_message_goes_on(battery, monkeypatch):
    robot = Robot(battery, stuck(*(f"wheel_speed_rad_s.{name}" for name in PLACES)), until_s=20.0)
    driving = robot.sample
    monkeypatch.setattr(robot, "sample", lambda t: driving(t) | {"motor_current_A.0": robot.draw.gauss(2.0, 0.1)})
    robot.run(end_s=20.0)
    assert set(robot.wrong()) == {f"wheel_speed_rad_s.{name}" for name in PLACES}


def test_one_message_of_a_source_is_found_to_be_repeated(battery):
    robot = Robot(battery)
    held = robot.sample(0.1)
    names = ("battery_current_A", "battery_voltage_V")
    for k in range(1000):
        t, values = 0.02 * k, robot.sample(0.02 * k)
        of_battery = {name: (values if t < 5.0 else held)[name] for name in names}
        robot.watch.take("bridge", t, t, {n: v for n, v in values.items() if n not in names})
        robot.watch.take("bridge", t + 0.001, t + 0.001, of_battery)
    assert {d.name for d in robot.watch.look(20.0) if d.level != Level.OK} == set(names)


@pytest.mark.parametrize("step", [0.5, None], ids=["quantised", "without noise"])
def test_values_without_noise_may_be_the_same_for_long(battery, monkeypatch, step):
    """A robot that drives for 20 s and goes on at a constant speed, with coarse sensors or in a simulation."""

    def sample(t):
        x = math.sin(1.1 * min(t, 20.0))
        values = {f"wheel_speed_rad_s.{name}": 4.0 + 3.0 * x for name in PLACES}
        values |= {"battery_current_A": -5.0 - 2.0 * x, "battery_voltage_V": 13.0 - 0.03 * x, "yaw_rate_rad_s": 0.1 * x}
        draw = random.Random(t)
        return {
            name: step * round((value + draw.gauss(0, 0.1)) / step) if step else value for name, value in values.items()
        }

    robot = Robot(battery)
    monkeypatch.setattr(robot, "sample", sample)
    assert robot.run(end_s=60.0).wrong() == {}


def test_a_robot_that_stops_and_stands_is_not_taken_for_a_source_that_repeats(battery, monkeypatch):
    """Its encoders are still, and its battery gives a small current without noise that a sensor could show."""
    robot = Robot(battery)
    driving = robot.sample
    still = dict.fromkeys((*(f"wheel_speed_rad_s.{name}" for name in PLACES), "yaw_rate_rad_s"), 0.0)
    still |= {"battery_current_A": -0.3, "battery_voltage_V": 13.1}
    monkeypatch.setattr(robot, "sample", lambda t: driving(t) if t < 20.0 else still)
    assert robot.run(end_s=60.0).wrong() == {}


def test_an_encoder_that_counts_no_more_is_stuck_until_it_counts_again(battery):
    class Counting(Robot):
        counts = dict.fromkeys(PLACES, 4000)

        def sample(self, t):
            values = super().sample(t)
            speeds = {name: values.pop(f"wheel_speed_rad_s.{name}") for name in PLACES}
            self.counts = {name: (self.counts[name] + round(163.0 * 0.02 * w)) % 65536 for name, w in speeds.items()}
            return values | {f"wheel_counts.{name}": float(count) for name, count in self.counts.items()}

    counter = f"wheel_counts.{PLACES[0]}"
    robot = Counting(battery, stuck(counter), until_s=12.0)
    robot.watch = SensorWatch(battery, RLMA, counts_per_turn=1024)
    robot.run(end_s=11.0)
    assert set(robot.wrong()) == {counter}
    assert math.isnan(robot.clean[-1][counter])
    robot.run(11.0, 14.0)
    assert robot.wrong() == {}


def test_the_unit_that_would_fit_is_named_as_in_the_trial(battery):
    (message,) = Robot(battery, constant("battery_voltage_V", 13100.0)).run().wrong().values()
    assert message.endswith("millivolts? then scale = 0.001")


def test_wheels_that_spin_in_place_accuse_nobody(battery):
    """Driven wheels spin on ice; the free wheels stand, to the last bit."""

    def ice(values):
        free = {f"wheel_speed_rad_s.{name}": 0.0 for name in PLACES[RLMA.driven :]}
        return values | free

    assert Robot(battery, ice).run().wrong() == {}


def test_a_gyro_that_the_pose_contradicts_is_stuck_while_it_repeats_itself(battery):
    watch = SensorWatch(battery, RLMA)

    def level(time_s, rate_rad_s):
        watch.take("imu", time_s, time_s, {"yaw_rate_rad_s": rate_rad_s})
        watch.take_contradiction("yaw_rate_rad_s")
        return next(d.level for d in watch.look(time_s) if d.name == "yaw_rate_rad_s")

    assert [level(0.1 * k, 0.01 * k) for k in range(30)] == [Level.OK] * 30
    repeated = [level(3.0 + 0.1 * k, 0.0) for k in range(30)]
    assert repeated == [Level.OK] * 20 + [Level.ERROR] * 10
    assert level(6.0, 0.1) == Level.OK


@pytest.mark.parametrize(
    ("first", "second", "names"),
    [
        (("can0", ""), ("mqtt", ""), ("can0", "mqtt")),
        (("ros2", "/bms"), ("ros2", "/bms (publisher 2)"), ("/bms of ros2", "/bms (publisher 2) of ros2")),
    ],
    ids=["sources", "publishers of a topic"],
)
def test_a_quantity_that_two_send_is_named_and_the_first_is_used(battery, first, second, names):
    watch = SensorWatch(battery, RLMA)
    for k in range(100):
        t = 0.1 * k
        assert watch.take(first[0], t, t, {"battery_voltage_V": 13.0 + 1e-3 * k}, first[1])
        assert watch.take(second[0], t, t, {"battery_voltage_V": 12.0}, second[1]) == {}
    (found,) = [d for d in watch.look(10.0) if d.level != Level.OK]
    assert found.name == "battery_voltage_V"
    assert f"{names[0]} and {names[1]} both send it; {names[0]} is used" in found.message


def test_a_temperature_of_zero_throughout_is_of_no_sensor(battery):
    watch = SensorWatch(battery)
    used: list[float] = []
    for k, degC in enumerate([0.0, 0.0, 0.5, 0.0]):
        used += watch.take("ros2", float(k), float(k), {"battery_temperature_degC": degC}).values()
        assert ["no sensor, left out" in d.message for d in watch.look(k) if "battery" in d.name] == [k < 2]
    np.testing.assert_equal(used, [math.nan, math.nan, 0.5, 0.0])


def test_an_event_may_come_from_any_publisher_of_a_source(battery):
    watch = SensorWatch(battery)
    watch.take("ros2", 0.0, 0.0, {"battery_full": 0.0}, "/bms")
    assert watch.take("ros2", 0.1, 0.1, {"battery_full": 1.0}, "services") == {"battery_full": 1.0}


def test_the_second_source_takes_over_where_the_first_is_silent(battery):
    watch = SensorWatch(battery, RLMA)
    for k in range(100):
        t = 0.1 * k
        if t < 5.0:
            watch.take("can0", t, t, {"battery_voltage_V": 13.0})
        used = watch.take("mqtt", t, t, {"battery_voltage_V": 12.0 + 1e-3 * k})
        if 0.0 < t - 5.95 < 0.11:  # just taken over
            assert [d.message for d in watch.look(t) if d.level != Level.OK] == []
    assert used
    assert [d for d in watch.look(10.0) if d.level != Level.OK] == []


def test_a_message_that_comes_twice_is_used_once(battery):
    watch = SensorWatch(battery, RLMA)
    for k in range(50):
        t, values = 0.1 * k, {"battery_current_A": -1.0 - 0.01 * k}
        assert math.isfinite(watch.take("mqtt", t, t, values)["battery_current_A"])
        assert math.isnan(watch.take("mqtt", t, t, values)["battery_current_A"])


def test_what_a_source_promises_and_never_sends_is_named(battery):
    watch = SensorWatch(battery, RLMA, {"can0": ("battery_voltage_V", "battery_current_A"), "mqtt": ()})
    watch.take("can0", 20.0, 20.0, {"battery_current_A": 1.0})
    before, after = ({d.name: d.message for d in watch.look(now_s) if d.level == Level.STALE} for now_s in (49.0, 50.0))
    assert set(before) == {"messages of mqtt"} and "nothing came" in before["messages of mqtt"]
    assert "has not come from can0 for 30 s" in after["battery_voltage_V"]


def test_a_source_from_which_nothing_came_is_one_condition_from_when_it_runs_on(battery):
    watch = SensorWatch(battery, RLMA, {"can0": ("battery_voltage_V", "battery_current_A")}, began_s=100.0)
    assert list(watch.look(104.9))[1:] == []
    assert [d.name for d in watch.look(105.0) if d.level == Level.STALE] == ["messages of can0"]
    assert [d.name for d in watch.look(200.0) if d.level == Level.STALE] == ["messages of can0"]


@pytest.mark.parametrize("lag_s", [1.5, 60.0])
def test_values_that_come_late_are_late_and_not_silent(battery, lag_s):
    """The link becomes slow after 2 s; from 8 s on nothing comes."""
    watch = SensorWatch(battery, RLMA, {"radio": ()})
    told: dict[str, Level] = {}
    for k in range(80):
        t = 0.1 * k
        watch.take("radio", t - (0.0 if t < 2.0 else lag_s), t, {"battery_current_A": -1.0 - 0.01 * (k % 7)})
        told |= {d.name: d.level for d in watch.look(t)}
        assert told["battery_current_A"] == Level.OK
    assert told["delay of radio"] == Level.WARN
    assert {d.name: d.level for d in watch.look(10.0)}["battery_current_A"] == Level.STALE


def test_the_second_source_waits_while_the_first_is_late(battery):
    watch = SensorWatch(battery, RLMA)
    for k in range(100):
        t = 0.1 * k
        assert watch.take("radio", t - 1.5, t, {"battery_voltage_V": 13.0 + 1e-3 * k})
        assert watch.take("can0", t, t, {"battery_voltage_V": 12.0 + 1e-3 * k}) == {}


def test_a_value_that_is_late_is_not_the_same_for_longer(battery):
    """A wheel at 100 Hz is the same for 0.3 s while the others move; all come 5 s late."""
    held = dict.fromkeys((f"wheel_speed_rad_s.{name}" for name in PLACES), 4.0)
    watch = SensorWatch(battery, RLMA)
    for k in range(30):
        t = 0.01 * k
        values = {name: v + 0.01 * k for name, v in held.items()} | {WHEEL: 1.0}
        watch.take("radio", t, t + 5.0, values)
    assert {d.name: d.level for d in watch.look(5.3)}[WHEEL] == Level.OK


def test_late_values_and_clocks_that_were_set_are_named(battery):
    watch = SensorWatch(battery)
    watch.take("radio", 1.0, 3.0, {"battery_current_A": 1.0})
    watch.clock_was_set("radio", 3.0)
    found = {d.name: d.level for d in watch.look(3.1)}
    assert found["delay of radio"] == found["clock of radio"] == Level.WARN
    watch.take("radio", 70.0, 70.01, {"battery_current_A": 1.1})
    assert {d.level for d in watch.look(70.1)} == {Level.OK}


def test_a_publisher_whose_stamps_are_always_behind_is_named_beside_one_in_time(battery):
    watch = SensorWatch(battery)
    for k in range(20):
        watch.take("ros2", 0.1 * k, 0.1 * k, {"battery_current_A": -1.0 - 0.01 * k}, "/bms", behind_s=3.0)
        watch.take("ros2", 0.1 * k, 0.1 * k, {"yaw_rate_rad_s": 0.01 * k}, "/imu")
    found = {d.name: d for d in watch.look(2.0)}["delay of ros2"]
    assert found.level == Level.WARN and found.values["delay_s"] == pytest.approx(3.0)
    assert found.message.startswith("values of /bms of ros2 come late, or its clock is behind")
    watch.take("ros2", 30.0, 30.0, {"yaw_rate_rad_s": 0.3}, "/imu")  # the other one is silent by now
    assert {d.name: d for d in watch.look(30.0)}["delay of ros2"].level == Level.OK


def test_names_without_end_do_not_fill_memory(battery):
    watch = SensorWatch(battery)
    watch.take("robot", 0.0, 0.0, {"battery_voltage_V": 13.0})
    for k in range(2 * MOST_SENSORS):
        watch.take("mqtt", 0.1, 0.1, {f"estimate.{k}": 1.0})
    assert len(watch.sensors) == MOST_SENSORS
    assert watch.take("robot", 0.2, 0.2, {"battery_voltage_V": 13.1}) == {"battery_voltage_V": 13.1}
    (found,) = (diagnostic for diagnostic in watch.look(0.3) if diagnostic.name == "signals")
    assert "mqtt sends new names" in found.message


def test_a_drive_without_any_wheel_is_missed_until_one_comes(battery):
    """Joints without velocities, or a topic that nobody publishes: nothing else tells why there is no speed."""
    watch = SensorWatch(battery, RLMA)
    watch.take("ros2", 1.0, 1.0, {"battery_voltage_V": 13.0, "yaw_rate_rad_s": 0.0, "wheel_speed_rad_s.arm": 1.0})

    def found(now_s):
        return {d.name: d.level for d in watch.look(now_s) if d.name.startswith("sensors of the ")}

    assert found(MISSED_S) == {}
    assert found(MISSED_S + 1.0) == {"sensors of the drive": Level.STALE}
    watch.take("ros2", 40.0, 40.0, {"wheel_speed_rad_s.front_left": 1.0})
    assert found(41.0) == {"sensors of the drive": Level.OK}


@pytest.mark.parametrize("voltage_V", [0.0008, 5.0, 16.5, 26.4])
def test_a_voltage_that_the_battery_cannot_have_is_left_out(battery, voltage_V):
    """A management that has just started, or another battery: its charge would come from a voltage that is none."""
    taken = SensorWatch(battery).take("bms", 0.0, 0.0, {"battery_voltage_V": voltage_V, "battery_current_A": -3.0})
    assert math.isnan(taken["battery_voltage_V"]) and taken["battery_current_A"] == -3.0


def test_the_files_of_another_robot_are_named(battery):
    def strange(values):
        return values | {"wheel_speed_rad_s.middle": 1.0, "wheel_counts.0": 7.0}

    other = Robot(generic_battery("nmc", 50.0, 14), strange).run()
    wrong = other.wrong()
    assert wrong.keys() == {"battery_voltage_V", "wheel_speed_rad_s.middle", "wheel_counts.0"}
    assert wrong["wheel_counts.0"].startswith("counts need counts_per_turn")
    assert re.match(
        r"reads 1[23].*, which cannot be, plausible are 26.* to .*; check its unit", wrong["battery_voltage_V"]
    )
    assert wrong["wheel_speed_rad_s.middle"].startswith("the robot has no such wheel; it has front_left, front_right")


def test_messages_that_come_late_are_missed_no_longer(battery):
    watch = SensorWatch(battery, RLMA, {"simulation": ()})
    late = {d.name: d.level for d in watch.look(6.0)}
    watch.take("simulation", 6.5, 6.5, {"yaw_rate_rad_s": 0.0})
    after = {d.name: d.level for d in watch.look(7.0)}
    assert (late["messages of simulation"], after["messages of simulation"]) == (Level.STALE, Level.OK)


def test_a_link_that_delivers_in_bursts_is_not_silent_between_them():
    """Values of every 0.02 s come together every 1.6 s; then nothing comes."""
    watch, levels = SensorWatch(), []
    for burst in range(1, 10):
        for k in range(80):
            watch.take("wifi", 1.6 * (burst - 1) + 0.02 * k, 1.6 * burst, {"yaw_rate_rad_s": 1e-3 * k})
        levels += [d.level for d in watch.look(1.6 * burst + 1.55) if d.name == "yaw_rate_rad_s"]
    assert levels[1:] == [Level.OK] * 8
    assert [d.level for d in watch.look(20.0) if d.name == "yaw_rate_rad_s"] == [Level.STALE]


def test_a_slow_sensor_whose_first_values_came_in_haste_is_not_silent():
    """A broker's retained value, the live one at once after it, then one every half minute."""
    watch = SensorWatch()
    for time_s in (0.0, 0.01, 30.0, 60.0, 90.0):
        watch.take("mqtt", time_s, time_s, {"battery_voltage_V": 13.0 + 1e-3 * time_s})
    (found,) = [d for d in watch.look(100.0) if d.name == "battery_voltage_V"]
    assert found.level == Level.OK


def test_a_simulation_that_is_still_being_made_lacks_no_sensor(battery):
    watch = SensorWatch(battery, RLMA)  # a source that makes its own measurements promises none
    assert list(watch.look(60.0)) == []
    watch.take("simulation", 61.0, 61.0, {"pitch_rad": 0.1})
    assert {d.name for d in watch.look(62.0 + MISSED_S) if d.level == Level.STALE} >= {"sensors of the battery"}
