"""Messages to and from another process by zenoh, in the format of rmw_zenoh, through a router of zenoh."""

import asyncio
import json
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from ohmward.battery.chemistries import generic_battery
from ohmward.errors import InputError, OhmwardError
from ohmward.onboard.estimation import Estimation
from ohmward.onboard.feed import Feed
from ohmward.onboard.message import Message
from ohmward.onboard.process import Process
from ohmward.onboard.ros import types
from ohmward.onboard.sinks.ros2 import NEWEST, Ros2Sink
from ohmward.onboard.sources.ros2 import Ros2Source, wheel_of
from onboard.servers import free_port

from .test_messages import at, driven

pytest.importorskip("zenoh")
OTHER = str(Path(__file__).with_name("other_node.py"))
BATTERY_KEY = f"0/robot1/battery_state/sensor_msgs::msg::dds_::BatteryState_/{types.HASHES[types.BATTERY_STATE]}"


def other(*words: object) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, OTHER, *map(str, words)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )


def start_router(port: int) -> subprocess.Popen[str]:
    process = other("router", port)
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    return process


@pytest.fixture
def router() -> Iterator[int]:
    """Port of a router."""
    port = free_port()
    process = start_router(port)
    yield port
    process.kill()
    process.communicate()


def network(port: int) -> dict[str, Any]:
    return {"transport": "zenoh", "router": f"tcp/127.0.0.1:{port}"}


def test_another_process_reads_what_the_sink_sends(router):
    sink = Ros2Sink(**network(router), namespace="robot1", slow_s=0.0, interval_s=0.0)

    async def deliver() -> list[str]:
        feed = Feed()
        task = asyncio.create_task(sink.run(feed))
        feed.put(at(0.0, driven()))
        await asyncio.sleep(1.0)  # the tokens are there with the first message
        process = other("listen", router, BATTERY_KEY, types.BATTERY_STATE, 2)
        assert process.stdout is not None
        tokens = await asyncio.to_thread(process.stdout.readline)
        await asyncio.sleep(0.5)  # until the router has told the writer of its reader
        for k in range(20):
            feed.put(at(1.0 + k, driven()))
            await asyncio.sleep(0.01)
        feed.end()
        lines = (await asyncio.to_thread(process.communicate))[0].splitlines()
        await task
        return [tokens, *lines]

    tokens, *lines = asyncio.run(deliver())
    assert [json.loads(line) for line in lines] == [[k, 16, 0.5, "base_link", True] for k in range(2, 22)]
    ours = [token.split("/", 5) for token in json.loads(tokens)]
    kinds = [token[5] for token in ours]
    assert "NN/%/%robot1/ohmward" in kinds
    dds = "sensor_msgs::msg::dds_::BatteryState_"
    assert f"MP/%/%robot1/ohmward/%robot1%battery_state/{dds}/{types.HASHES[types.BATTERY_STATE]}/::,10:,:,:,," in kinds
    assert any("/%diagnostics/" in kind for kind in kinds)


def test_after_an_absence_of_the_network_come_the_newest_states_alone(router):
    sink = Ros2Sink(**network(router), namespace="robot1", slow_s=0.0, interval_s=0.0)

    async def deliver() -> list[str]:
        process = other("listen", router, BATTERY_KEY, types.BATTERY_STATE, 2)
        assert process.stdout is not None
        await asyncio.to_thread(process.stdout.readline)
        feed = Feed()
        for k in range(60):
            feed.put(at(1.0 + k, driven()))
        feed.end()
        await sink.run(feed)
        return (await asyncio.to_thread(process.communicate))[0].splitlines()

    assert [json.loads(line)[0] for line in asyncio.run(deliver())] == list(range(1, NEWEST + 1))


def test_the_source_hears_another_process_and_the_estimate_follows(router):
    """From the bytes of another node to a state of charge."""
    source = Ros2Source(**network(router), battery_state="/bms/battery")
    states = Feed()
    process = Process(Estimation(generic_battery("lfp", 12.0, 4, "test")), [source], [])
    process.sinks.append((Ros2Sink(**network(router)), states))

    async def hear() -> None:
        running = asyncio.create_task(process.run())
        await asyncio.sleep(0.5)
        speaker = other("publish", router, 60)
        await asyncio.to_thread(speaker.wait)
        process.stop()
        await running

    asyncio.run(hear())
    state = process.estimation.state
    assert state.battery is not None
    assert 0.0 < state.battery.soc < 1.0
    assert state.sample["battery_voltage_V"] == pytest.approx(13.0)
    assert state.sample["battery_current_A"] == pytest.approx(-0.1 * 59, abs=0.4)
    assert state.sample.get("cell_voltage_V.3", 3.25) == 3.25


def test_without_a_router_the_fix_is_named():
    sink = Ros2Sink(**network(free_port()))
    with pytest.raises(OhmwardError, match=r"no zenoh router at tcp/127.0.0.1:\d+; start one with: ros2 run rmw_zenoh"):
        asyncio.run(sink.run(Feed()))


def test_a_router_that_goes_away_is_told_and_found_again():
    port = free_port()
    first = start_router(port)
    source = Ros2Source(**network(port), battery_state="/bms/battery")
    heard: list[Message] = []

    async def hear() -> str:
        running = asyncio.create_task(source.run(heard.append))
        await asyncio.sleep(0.5)
        first.kill()
        first.communicate()
        try:
            await asyncio.wait_for(running, 60.0)
        except OhmwardError as error:
            reason = str(error)
        second = await asyncio.to_thread(start_router, port)
        again = asyncio.create_task(source.run(heard.append))
        await asyncio.sleep(0.5)
        await asyncio.to_thread(other("publish", port, 5).wait)
        await asyncio.sleep(0.1)
        again.cancel()
        await asyncio.gather(again, return_exceptions=True)
        second.kill()
        second.communicate()
        return reason

    began_s = time.monotonic()
    assert "is away; is rmw_zenohd running?" in asyncio.run(hear())
    assert heard and heard[-1].values["battery_voltage_V"] == pytest.approx(13.0)
    assert time.monotonic() - began_s < 30.0


@pytest.mark.parametrize(
    ("joint", "wheel"),
    [("front_left_wheel_joint", "front_left"), ("wheel_left", "left"), ("wheel_joint", "wheel_joint")],
)
def test_joints_are_wheels_by_their_names(joint, wheel):
    assert wheel_of(joint) == wheel


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({}, "no topic: give battery_state"),
        ({"battery_state": "/b", "transport": "dds"}, "transport must be one of"),
        ({"battery_state": "/b", "node": "my node"}, "node must be a name of letters"),
        ({"battery_state": "/b", "domain": 500}, "domain must be"),
        ({"battery_state": "/b", "namespace": "a-b"}, "namespace must be names"),
    ],
)
def test_settings_that_cannot_be_are_refused(settings, message):
    with pytest.raises(InputError, match=message):
        Ros2Source(**settings)
