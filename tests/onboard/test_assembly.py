import math
from dataclasses import replace
from typing import Any

import pytest

from ohmward import InputError, generic_battery, save_battery
from ohmward.onboard.assembly import assemble, sinks_of
from ohmward.onboard.control.outputs import MqttOutput
from ohmward.onboard.message import ScaledSignal
from ohmward.onboard.robot_setup import SETUP_FILE, Setup
from ohmward.onboard.robot_state import Level
from ohmward.onboard.sinks.control import ControlSink
from ohmward.onboard.sinks.mqtt import MqttSink
from ohmward.onboard.sinks.page import PageSink
from ohmward.onboard.sinks.ros2 import Ros2Sink
from ohmward.onboard.sinks.server import InfluxSink
from ohmward.onboard.sources.json_lines import JsonLinesSource

FAULTS = {
    "a wheel that there is not": (
        (JsonLinesSource(signals={"wheel_speed_rad_s.middle": "w"}),),
        "wheel_speed_rad_s.middle: the robot has no such wheel; it has front_left, ",
    ),
    "counts without their number in a turn": (
        (JsonLinesSource(signals={"wheel_counts.0": "n"}),),
        "wheel_counts.0: counts need counts_per_turn",
    ),
    "two sources of one quantity": (
        tuple(JsonLinesSource(name=name, signals={"yaw_rate_rad_s": "r"}) for name in ("imu", "drives")),
        "yaw_rate_rad_s: imu and drives both send it; leave it out of one of them",
    ),
}


def setup(tmp_path, sources, strict):
    save_battery(generic_battery("lfp", 12.0, 4), tmp_path / "battery.toml")
    return Setup(
        battery=str(tmp_path / "battery.toml"),
        robot="rlma",
        state=str(tmp_path / "state"),
        strict=strict,
        source=sources,
    )


@pytest.mark.parametrize("name", FAULTS)
def test_wiring_that_cannot_be_used_is_named_and_the_process_starts_without(tmp_path, name):
    sources, message = FAULTS[name]
    process = assemble(setup(tmp_path, sources, strict=False))
    (found,) = [d for d in process.diagnostics.values() if d.level == Level.ERROR]
    assert f"{found.name}: {found.message}".startswith(message)


@pytest.mark.parametrize("name", FAULTS)
def test_strict_refuses_it(tmp_path, name):
    sources, message = FAULTS[name]
    with pytest.raises(InputError, match=message):
        assemble(setup(tmp_path, sources, strict=True))


def test_the_name_of_the_setup_is_that_of_the_robot_in_every_sink_that_has_none_of_its_own():
    sinks = (
        PageSink(),
        MqttSink(),
        InfluxSink(url="http://h/write?db=r"),
        PageSink(robot="cart 2", name="other"),
        ControlSink(mqtt=MqttOutput()),
    )
    found: list[Any] = [*sinks_of(Setup(name="cart", robot="rlma", sink=sinks))]
    page, mqtt, influx, other, control = found
    assert (page.robot, mqtt.topic, influx.robot, other.robot) == ("cart", "ohmward/cart", "cart", "cart 2")
    assert control.mqtt.topic == "ohmward/cart/drives"


@pytest.mark.parametrize(
    ("name", "sink", "warnings"),
    [("robot", MqttSink(), 1), ("robot", MqttSink(topic="mine"), 0), ("robot", PageSink(), 0), ("cart", MqttSink(), 0)],
)
def test_the_usual_name_is_logged_where_other_robots_may_have_it(caplog, name, sink, warnings):
    sinks_of(Setup(name=name, robot="rlma", sink=(sink,)))
    assert [record.getMessage().partition(":")[0] for record in caplog.records] == ["sink mqtt"] * warnings


def test_a_control_sink_is_of_the_robot_of_the_setup():
    output = MqttOutput(topic="drives")
    (sink,) = sinks_of(Setup(robot="rlma", sink=(ControlSink(mqtt=output),)))
    assert isinstance(sink, ControlSink) and sink.robot == "rlma"
    with pytest.raises(
        InputError, match=r"sink control: robot = 'husky' is not that of the setup, 'rlma'; leave it out"
    ):
        sinks_of(Setup(robot="rlma", sink=(ControlSink("husky", mqtt=output),)))


JSON_SETUP = """
format = "ohmward-setup/1"
battery = "battery.toml"
HEAD
[[source]]
kind = "json-lines"
[source.signals]
battery_current_A = SIGNAL
"""


@pytest.mark.parametrize(
    ("head", "signal", "message"),
    [
        ("", '{name = "I", scal = 0.001}', r"signals\[battery_current_A\].scal is not a key .* did you mean scale"),
        ("", '{name = "I", scale = 0.0}', r"signals\[battery_current_A\]: scale must not be 0"),
        ("", "{scale = 2.0}", r"signals\[battery_current_A\].name is missing"),
        ("", "5", r"signals\[battery_current_A\]: expected"),
        ("counts_per_turn = 0.0", '"I"', "counts_per_turn must be > 0"),
        ("[alarms]\nsoc_lo = 0.2", '"I"', "alarms.soc_lo is not a key .* did you mean soc_low"),
    ],
)
def test_a_slip_of_the_pen_in_a_setup_is_named(head, signal, message):
    with pytest.raises(InputError, match=message):
        SETUP_FILE.parse(JSON_SETUP.replace("HEAD", head).replace("SIGNAL", signal))


def test_a_signal_has_a_scale_where_one_is_given():
    setup = SETUP_FILE.parse(JSON_SETUP.replace("HEAD", "").replace("SIGNAL", '{name = "I", scale = 0.001}'))
    (source,) = setup.source
    assert isinstance(source, JsonLinesSource)
    assert source.signals == {"battery_current_A": ScaledSignal("I", 0.001)}


@pytest.mark.parametrize("sink", [PageSink(interval_s=-1.0), MqttSink(interval_s=math.nan), Ros2Sink(slow_s=-0.5)])
def test_a_time_between_states_that_cannot_be_is_refused_for_every_sink(sink):
    with pytest.raises(InputError, match=f"_s of sink {sink.name} must be"):
        Setup(robot="rlma", sink=(sink,))


@pytest.mark.parametrize(
    ("of_file", "of_setup", "assumed"),
    [(0.0, None, 0.002), (0.01, None, 0.01), (0.01, 0.0, 0.0)],
    ids=["nobody said", "in the battery file", "in the setup"],
)
def test_the_voltage_sensor_of_a_robot_is_not_that_of_the_test_unless_told(tmp_path, of_file, of_setup, assumed):
    battery = generic_battery("lfp", 12.0, 4)
    path = tmp_path / "battery.toml"
    save_battery(replace(battery, noise=replace(battery.noise, voltage_gain_std=of_file)), path)
    estimation = assemble(Setup(battery=str(path), state=str(tmp_path / "state"), voltage_gain_std=of_setup)).estimation
    assert estimation.battery and estimation.battery.noise.voltage_gain_std == assumed
