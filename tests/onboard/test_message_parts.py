"""Signals of messages and what takes them."""

import math

from ohmward.onboard.message import MOST_KINDS, MessageSorter, ScaledSignal, Wiring
from ohmward.traction.robot.packaged import RLMA


def test_wheels_by_name_and_number_stand_in_their_places():
    values = {"wheel_speed_rad_s.rear_left": 3.0, "wheel_speed_rad_s.1": 2.0, "motor_current_A.0": 0.5}
    parts = MessageSorter(RLMA, counted=False).parts(values)
    assert parts.drive
    assert not parts.battery
    message = parts.drive_message(values)
    assert [value for value in message["wheel_speed_rad_s"] if not math.isnan(value)] == [2.0, 3.0]
    assert message["wheel_speed_rad_s"][1:3] == [2.0, 3.0]
    assert message["current_A"][0] == 0.5
    assert math.isnan(message["current_A"][1])


def test_what_the_robot_does_not_have_is_passed_over():
    values = {"wheel_speed_rad_s.4": 1.0, "motor_current_A.rear_left": 1.0, "wheel_counts.0": 7.0, "estimate.soc": 0.5}
    parts = MessageSorter(RLMA, counted=False).parts(values)
    assert not parts.drive
    assert parts.reported == ("estimate.soc",)
    assert MessageSorter(RLMA, counted=True).parts(values).drive_message(values)["wheel_counts"][0] == 7.0
    assert not MessageSorter(None, counted=True).parts(values).drive


def test_a_sum_is_measured_whenever_each_of_its_numbers_has_come_again():
    wiring = Wiring({"battery_current_A": ScaledSignal("a + b", -0.001, 2.0), "battery_voltage_V": "a.U"})
    found = [wiring.values(numbers) for numbers in ({"a": 1e3, "a.U": 12.0}, {"a": 2e3}, {"b": 3e3}, {"b": 1e3})]
    assert found == [{"battery_voltage_V": 12.0}, {}, {"battery_current_A": -3.0}, {}]
    assert wiring.values({"a": None})["battery_current_A"] != 0.0


def test_kinds_of_messages_do_not_fill_memory():
    sorter = MessageSorter(RLMA, counted=False)
    for k in range(3 * MOST_KINDS):
        assert sorter.parts({"yaw_rate_rad_s": 0.1, f"estimate.{k}": 0.0}).body == ("yaw_rate_rad_s",)
    assert len(sorter._kinds) <= MOST_KINDS
