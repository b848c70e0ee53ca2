"""MQTT with a real Mosquitto."""

import asyncio
import json
import math
import random
import subprocess
import sys
import time
from contextlib import suppress
from typing import Any

import pytest
from paho.mqtt import client as paho

from ohmward import generic_battery
from ohmward.errors import InputError, OhmwardError
from ohmward.onboard.estimation import Estimation
from ohmward.onboard.feed import Feed
from ohmward.onboard.message import Signals, Wiring
from ohmward.onboard.mqtt_broker import Payload
from ohmward.onboard.part import keep_running
from ohmward.onboard.robot_state import Level
from ohmward.onboard.sinks.mqtt import MqttSink
from ohmward.onboard.sources.mqtt import MqttSource
from onboard.servers import free_port, mosquitto

SIGNALS: Signals = {"battery_current_A": "robot/bms#current", "battery_voltage_V": "robot/voltage"}


def state(time_s=1.0):
    (found,) = Estimation(generic_battery("nmc", 10.0, 7)).put(
        0.0, {"battery_current_A": -1.0, "battery_voltage_V": 26.0}
    )
    return found._replace(time_s=time_s)


def client(broker, *topics, **credentials):
    """A client of the broker, and what it gets: topic -> payloads."""
    got: dict[str, list[bytes]] = {}
    one = paho.Client(paho.CallbackAPIVersion.VERSION2)
    one.on_message = lambda _c, _d, m: got.setdefault(m.topic, []).append(bytes(m.payload))
    one.connect("127.0.0.1", broker.port)
    for topic in topics:
        one.subscribe(topic, 1)
    one.loop_start()
    return one, got


async def until(condition, within_s=60.0):
    end_s = time.monotonic() + within_s
    while not condition():
        assert time.monotonic() < end_s, "in vain"
        await asyncio.sleep(0.02)


async def cancelled(task):
    task.cancel()
    with suppress(asyncio.CancelledError):
        await task


def test_topics_become_messages(tmp_path):
    got: list = []
    with mosquitto(tmp_path) as broker:

        async def run():
            source = MqttSource(host="127.0.0.1", port=broker.port, signals=SIGNALS, topics=("robot/all",))
            other, _ = client(broker)
            other.publish("robot/voltage", b"24.9", 1, retain=True).wait_for_publish(5.0)  # measured before
            task = asyncio.create_task(source.run(got.append))
            await asyncio.sleep(0.5)
            other.publish("robot/bms", b'{"current": -2.5, "time_s": 7}')
            other.publish("robot/voltage", b"25.5")
            other.publish("robot/all", b'{"wheel_speed_rad_s": [1, 2], "colour": "red"}')
            other.publish("robot/all", b"\xff\xfe no json")
            await until(lambda: len(got) == 3)
            other.loop_stop()
            await cancelled(task)

        asyncio.run(run())
    assert [dict(message.values) for message in got] == [
        {"battery_current_A": -2.5},
        {"battery_voltage_V": 25.5},
        {"wheel_speed_rad_s.0": 1.0, "wheel_speed_rad_s.1": 2.0},
    ]
    assert got[0].stamp_s == 7.0 and math.isnan(got[1].stamp_s)
    assert got[0].publisher == "robot/bms"  # whose clock need not be that of another topic


@pytest.mark.parametrize("in_haste", [False, True], ids=["delivered", "cancelled"])
def test_states_are_retained_and_whoever_ends_is_offline(tmp_path, in_haste):
    with mosquitto(tmp_path) as broker:
        sink = MqttSink(host="127.0.0.1", port=broker.port, numbers=("battery.soc", "slip.speed_m_s"))

        async def run():
            feed = Feed()
            task = asyncio.create_task(sink.run(feed))
            feed.put(state())
            await asyncio.sleep(0.7)
            late, got = client(broker, "ohmward/robot/#")
            await until(lambda: len(got) == 4)
            await asyncio.sleep(0.1)
            if in_haste:
                await cancelled(task)
            feed.end()
            await asyncio.wait([task])
            await until(lambda: got["ohmward/robot/status"][-1] == b"offline")
            late.loop_stop()
            return got

        got = asyncio.run(run())
    assert got["ohmward/robot/status"] == [b"online", b"offline"]
    assert float(got["ohmward/robot/battery/soc"][0]) == pytest.approx(state().battery.soc, abs=1e-6)
    assert json.loads(got["ohmward/robot/state"][0])["battery"]["soc"] == state().battery.soc


def test_a_process_that_is_killed_leaves_its_will(tmp_path):
    with mosquitto(tmp_path) as broker:
        other, got = client(broker, "ohmward/robot/status")
        program = f"""
import asyncio
from ohmward.onboard.feed import Feed
from ohmward.onboard.sinks.mqtt import MqttSink
asyncio.run(MqttSink(host="127.0.0.1", port={broker.port}).run(Feed()))
"""
        process = subprocess.Popen([sys.executable, "-c", program])
        asyncio.run(until(lambda: b"online" in got.get("ohmward/robot/status", []), 20.0))
        process.kill()
        process.wait()
        asyncio.run(until(lambda: got["ohmward/robot/status"][-1] == b"offline"))
        other.loop_stop()


def test_a_broker_that_is_restarted_gets_every_state(tmp_path):
    """States wait in the feed while it is away; the source hears again; both say what was wrong."""
    told: list[Any] = []
    got: list[Any] = []
    with mosquitto(tmp_path) as broker:
        sink = MqttSink(host="127.0.0.1", port=broker.port, interval_s=0.0)
        source = MqttSource(host="127.0.0.1", port=broker.port, signals=SIGNALS)

        async def run():
            feed = Feed()
            tasks = [
                asyncio.create_task(keep_running("sink", lambda: sink.run(feed), told.append, 0.1)),
                asyncio.create_task(keep_running("source", lambda: source.run(got.append), told.append, 0.1)),
            ]
            one, before = client(broker, "ohmward/robot/state")
            await asyncio.sleep(0.5)
            for k in range(5):
                feed.put(state(float(k)))
            await until(lambda: len(before.get("ohmward/robot/state", [])) == 5)
            one.loop_stop()
            broker.stop()
            for k in range(5, 10):
                feed.put(state(float(k)))
            await asyncio.sleep(0.5)
            broker.start()
            two, after = client(broker, "ohmward/robot/state")
            await until(lambda: b'"time_s": 9.0' in b"".join(after.get("ohmward/robot/state", [])), 20.0)

            def heard():
                two.publish("robot/voltage", b"25.0")
                return got

            await until(heard, 20.0)
            two.loop_stop()
            for task in tasks:
                await cancelled(task)
            return before["ohmward/robot/state"] + after["ohmward/robot/state"]

        states = asyncio.run(run())
    assert {json.loads(text)["time_s"] for text in states} == {float(k) for k in range(10)}
    faults = {told.name: told.message for told in told if told.level == Level.ERROR}
    assert "broker" in faults["sink"] and "broker" in faults["source"]
    assert told[-1].level == Level.OK


def test_a_broker_that_is_not_there_is_one_line_with_the_fix():
    source = MqttSource(host="127.0.0.1", port=free_port(), signals=SIGNALS)
    with pytest.raises(OhmwardError, match=r"no MQTT broker at 127.0.0.1:\d+ .* is it running there\?"):
        asyncio.run(source.run(print))


def test_the_password_comes_from_a_secret(tmp_path, monkeypatch):
    passwords = tmp_path / "passwords"
    passwords.touch(mode=0o600)
    subprocess.run(["mosquitto_passwd", "-b", str(passwords), "robot", "sesame-9"], check=True)
    with mosquitto(tmp_path, "allow_anonymous false", f"password_file {passwords}") as broker:
        settings: dict[str, Any] = {"host": "127.0.0.1", "port": broker.port, "signals": SIGNALS, "username": "robot"}
        source = MqttSource(**settings, password="MQTT_PASSWORD")
        monkeypatch.setenv("MQTT_PASSWORD", "wrong-7")
        with pytest.raises(OhmwardError, match=r"refuses .* check username, password") as found:
            asyncio.run(source.run(print))
        assert "wrong-7" not in str(found.value)
        monkeypatch.setenv("MQTT_PASSWORD", "sesame-9")

        async def run():
            task = asyncio.create_task(source.run(print))
            await asyncio.sleep(0.5)
            assert not task.done()
            await cancelled(task)

        asyncio.run(run())


def test_payloads_of_any_kind_are_no_fault():
    source = MqttSource(signals=SIGNALS, topics=("robot/all",))
    wiring = Wiring(SIGNALS)
    random.seed(2)
    seeds = [b'{"current": -2.5, "time_s": 7}', b"25.5", b'{"cell_voltage_V": [3.3, null, "x"]}', b"1e999", b"[" * 3000]
    for _ in range(10_000):
        payload = bytearray(random.choice(seeds))
        for _ in range(random.randrange(4)):
            payload[random.randrange(len(payload))] = random.getrandbits(8)
        topic = random.choice(["robot/bms", "robot/voltage", "robot/all", "x"])
        source.message(Payload(topic, bytes(payload[: random.randrange(len(payload) + 1)]), 1.0), wiring)


def test_settings_are_checked():
    refused: list[tuple[dict[str, Any], str]] = [
        ({"signals": {}}, "no topics; name some"),
        ({"signals": {"battery_current_A": "robot/+/x"}}, "not the name of one topic"),
        ({"signals": SIGNALS, "username": "u", "password": "pa55 word"}, "says where the secret is, not the secret"),
        ({"signals": SIGNALS, "password": "MQTT"}, "password without username"),
        (
            {"signals": SIGNALS, "host": "10.0.0.7", "username": "u", "password": "MQTT"},
            "for everybody on the way to read; write tls = true",
        ),
        ({"signals": SIGNALS, "ca_file": "ca.pem"}, "write tls = true"),
        ({"signals": SIGNALS, "port": 0}, "port must be between 1 and 65535"),
    ]
    for settings, message in refused:
        with pytest.raises(InputError, match=message):
            MqttSource(**settings)
    with pytest.raises(InputError, match="topic must be a topic without"):
        MqttSink(topic="a/#")
