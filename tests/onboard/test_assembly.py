from typing import Any

import pytest

from ohmward import InputError, generic_battery, save_battery
from ohmward.onboard.assembly import assemble, sinks_of
from ohmward.onboard.robot_setup import Setup
from ohmward.onboard.robot_state import Level
from ohmward.onboard.sinks.mqtt import MqttSink
from ohmward.onboard.sinks.page import PageSink
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
    assert f"{found.name}: {found.message}".startswith(f"wiring of {message}")


@pytest.mark.parametrize("name", FAULTS)
def test_strict_refuses_it(tmp_path, name):
    sources, message = FAULTS[name]
    with pytest.raises(InputError, match=message):
        assemble(setup(tmp_path, sources, strict=True))


def test_the_name_of_the_setup_is_that_of_the_robot_in_every_sink_that_has_none_of_its_own():
    sinks = (PageSink(), MqttSink(), InfluxSink(url="http://h/write?db=r"), PageSink(robot="cart 2", name="other"))
    found: list[Any] = [*sinks_of(Setup(name="cart", robot="rlma", sink=sinks))]
    page, mqtt, influx, other = found
    assert (page.robot, mqtt.topic, influx.robot, other.robot) == ("cart", "ohmward/cart", "cart", "cart 2")
