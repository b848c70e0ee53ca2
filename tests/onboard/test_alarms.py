"""Alarms: limits with hysteresis, and the messages that go out."""

import asyncio
import http.server
import json
import math
import re
import threading
from contextlib import contextmanager

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.onboard.alarms import AlarmLimits, AlarmWatch
from ohmward.onboard.feed import Feed
from ohmward.onboard.robot_setup import SETUP_FILE
from ohmward.onboard.robot_state import Alarm, RobotState
from ohmward.onboard.sinks.mqtt import MqttSink
from ohmward.onboard.sinks.webhook import WebhookSink
from onboard.page_server import drive
from onboard.servers import mosquitto
from onboard.test_mqtt import client, until

AT_ONCE = AlarmLimits(after_s=0.0)


def state(soc=0.5, std=0.001, current_A=-3.0, **more) -> RobotState:
    found = drive()[-1]
    assert found.battery is not None
    charge = found.battery._replace(soc=soc, soc_std=std)
    return found._replace(battery=charge, range=None, sample={"battery_current_A": current_A}, **more)


def names(watch: AlarmWatch, *states: RobotState) -> list[tuple[str, ...]]:
    return [tuple(alarm.name for alarm in watch.take(one)) for one in states]


def test_an_alarm_is_raised_at_its_limit_and_ends_beyond_its_hysteresis():
    watch = AlarmWatch(AlarmLimits(soc_low=0.2, hysteresis=0.05, after_s=0.0))
    charges = (0.21, 0.19, 0.21, 0.24, 0.26, 0.24)
    assert names(watch, *(state(soc) for soc in charges)) == [(), ("low",), ("low",), ("low",), (), ()]


def test_a_value_has_to_stay_beyond_its_limit():
    watch = AlarmWatch(AlarmLimits(after_s=2.0))
    lows = [(0.0, 0.1), (1.0, 0.1), (1.5, 0.3), (2.5, 0.1), (4.0, 0.1), (4.5, 0.1)]
    found = names(watch, *(state(soc, time_s=time_s) for time_s, soc in lows))
    assert found == [(), (), (), (), (), ("low",)]


def test_between_two_looks_nothing_that_is_measured_is_missed():
    watch = AlarmWatch(AT_ONCE, look_s=0.2)
    reported = state(time_s=0.1)._replace(sample={"bms_alarm": 4.0})
    assert names(watch, state(time_s=0.0), reported, state(time_s=0.25)) == [(), (), ("bms",)]


def test_the_low_end_of_the_band_counts_and_a_band_that_says_nothing_is_an_alarm_of_its_own():
    assert names(AlarmWatch(AT_ONCE), state(0.3, 0.09)) == [("low",)]
    assert names(AlarmWatch(AT_ONCE), state(0.5, 0.25), state(0.5, 0.25, 5.0)) == [("charge",), ()]
    low_stays = [("low",), ("low", "charge"), ("low",)]
    assert names(AlarmWatch(AT_ONCE), state(0.1), state(0.5, 0.25), state(0.1)) == low_stays


def test_a_silent_battery_is_an_alarm_once_its_charge_is_not_known():
    watch = AlarmWatch(AT_ONCE)
    silent = state(silent=("battery",))
    assert names(watch, silent, silent._replace(battery=None)) == [(), ("charge",)]
    assert "no news from the sensors of the battery" in watch.alarms[0].text
    assert names(AlarmWatch(AT_ONCE), RobotState(0.0, 0.0)) == [()]


def test_who_charges_need_not_hear_of_it():
    assert names(AlarmWatch(AT_ONCE), state(0.02), state(0.02, current_A=5.0)) == [("empty", "low"), ()]


def test_the_offset_of_the_sensor_of_a_parked_robot_is_no_charging():
    parked = [state(0.02, current_A=current_A) for current_A in (-0.01, 0.02, -0.02, 0.05)]
    assert names(AlarmWatch(AT_ONCE), *parked) == [("empty", "low")] * 4


def test_an_unknown_charge_leaves_an_alarm_as_it_was():
    unknown = state(0.1)._replace(battery=None, slip=None, battery_time_s=math.nan)
    assert names(AlarmWatch(AT_ONCE), state(0.1), unknown) == [("low",), ("low",)]
    slip = drive()[-1].slip
    assert slip is not None
    stuck = state(slip=slip._replace(immobilised=1.0))
    assert names(AlarmWatch(AT_ONCE), stuck, stuck._replace(slip=None), state()) == [("stuck",), ("stuck",), ()]


def test_the_date_of_an_alarm_is_that_of_its_beginning():
    watch = AlarmWatch(AT_ONCE)
    watch.take(state(0.1, unix_s=100.0))
    assert watch.take(state(0.1, unix_s=200.0))[0].since_unix_s == 100.0


def test_what_the_management_of_the_battery_reports_is_an_alarm_until_it_says_0():
    reports = [state(), state(), state(), state()]
    values = [{"bms_alarm": 4.0}, {}, {"bms_alarm": 0.0}, {}]
    states = [one._replace(sample=value) for one, value in zip(reports, values, strict=True)]
    assert names(AlarmWatch(AT_ONCE), *states) == [("bms",), ("bms",), (), ()]


def test_slip_is_an_alarm_where_a_limit_is_given():
    slip = drive()[-1].slip
    assert slip is not None
    spinning = state(slip=slip._replace(slip_ratio=np.array([0.1, -0.7])))
    assert names(AlarmWatch(AT_ONCE), spinning) == [()]
    assert names(AlarmWatch(AlarmLimits(slip_ratio=0.5, after_s=0.0)), spinning) == [("slip",)]


def test_limits_stand_in_the_setup():
    text = 'format = "ohmward-setup/1"\nbattery = "battery.toml"\n[alarms]\nsoc_low = 0.3\n'
    assert SETUP_FILE.parse(text).alarms == AlarmLimits(soc_low=0.3)
    with pytest.raises(InputError, match=r"alarms.soc_low must be between 0 and 1"):
        SETUP_FILE.parse(text.replace("0.3", "30.0"))


@contextmanager
def hook(*answers):
    """Address of a server that answers so, the last one again and again, and what it got."""
    got: list[dict] = []
    left = list(answers)

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_POST(self):
            body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
            status = left.pop(0) if len(left) > 1 else left[0]
            if status == 200:
                got.append(body | {"token": self.headers.get("Authorization", "")})
            self.send_response(status)
            self.end_headers()

        def log_message(self, *_):
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}/alarm", got
        server.shutdown()
        thread.join()


LOW = Alarm("low", "Drive home now: the battery may be down to 10 %.", 1.8e9)


def test_a_web_hook_gets_a_message_when_an_alarm_begins_and_one_when_it_ends(monkeypatch):
    monkeypatch.setattr("ohmward.onboard.sinks.webhook.AGAIN_S", 0.05)
    monkeypatch.setenv("HOOK_TOKEN", "secret")
    feed = Feed()
    for alarms in ((), (LOW,), (LOW,), ()):
        feed.put(state(unix_s=1.8e9, alarms=alarms))

    async def run(url):
        task = asyncio.create_task(WebhookSink(url, token="HOOK_TOKEN", robot="rover").run(feed))
        for _ in range(200):
            await asyncio.sleep(0.02)
            if len(got) == 2:
                break
        feed.end()
        await asyncio.wait_for(task, 60)

    with hook(503, 200) as (url, got):
        asyncio.run(run(url))
    assert got[0] == {
        "text": "rover: Drive home now: the battery may be down to 10 %.",
        "robot": "rover",
        "alarm": "low",
        "active": True,
        "at": "2027-01-15T08:00:00+00:00",
        "token": "Bearer secret",
    }
    assert [(one["alarm"], one["active"]) for one in got] == [("low", True), ("low", False)]
    assert feed.trouble == ""


def test_a_message_that_is_refused_for_good_does_not_hold_up_the_next(monkeypatch):
    monkeypatch.setattr("ohmward.onboard.sinks.webhook.AGAIN_S", 60.0)
    feed = Feed()
    for alarms in ((LOW,), ()):
        feed.put(state(unix_s=1.8e9, alarms=alarms))

    async def run(url):
        task = asyncio.create_task(WebhookSink(url).run(feed))
        await until(lambda: len(got) == 1, 20.0)
        feed.end()
        await asyncio.wait_for(task, 60)

    with hook(400, 200) as (url, got):
        asyncio.run(run(url))
    assert [one["active"] for one in got] == [False]


def test_an_address_that_is_none_is_refused():
    with pytest.raises(InputError, match=r"url must be http://HOST/PATH"):
        WebhookSink("hooks.example")


def test_a_broker_gets_the_alarms_when_they_change(tmp_path):
    async def run(port):
        feed = Feed()
        sink = MqttSink(host="127.0.0.1", port=port, topic="robots/rover")
        for alarms in ((), (LOW,), (LOW,), ()):
            feed.put(state(alarms=alarms))
        feed.end()
        await asyncio.wait_for(sink.run(feed), 60)

    with mosquitto(tmp_path) as broker:
        listener, got = client(broker, "robots/rover/#")
        asyncio.run(run(broker.port))
        asyncio.run(until(lambda: len(got.get("robots/rover/alarms", ())) == 3))
        listener.loop_stop()
    messages = [json.loads(payload) for payload in got["robots/rover/alarms"]]
    assert [[alarm["name"] for alarm in alarms] for alarms in messages] == [[], ["low"], []]


def test_home_assistant_finds_every_number_and_its_templates_read_the_view(tmp_path):
    jinja = pytest.importorskip("jinja2")
    sink = MqttSink(topic="robots/rover", home_assistant="homeassistant", robot="Rover")
    environment = jinja.Environment()
    environment.filters.setdefault("tojson", json.dumps)
    shown = dict(sink.payloads(state(0.4, alarms=(LOW,))))
    view = json.loads(shown["robots/rover/now"])
    found = {about["name"]: (topic, about) for topic, about in sink.discovery()}
    values = {
        name: environment.from_string(about["value_template"]).render(value_json=view)
        for name, (_, about) in found.items()
    }
    topic, about = found["Charge"]
    assert topic == "homeassistant/sensor/robots_rover/charge_soc/config"
    assert about["state_topic"] == "robots/rover/now" and about["availability_topic"] == "robots/rover/status"
    assert (values["Charge"], about["unit_of_measurement"], about["device_class"]) == ("40.0", "%", "battery")
    assert values["Range"] == "None" and values["Alarm"] == "ON"
    assert float(values["Charge out"]) > 0.0 and found["Energy out"][1]["device_class"] == "energy"
    assert len({about["unique_id"] for _, about in found.values()}) == len(found)
    attributes = environment.from_string(found["Alarm"][1]["json_attributes_template"]).render(value_json=view)
    assert json.loads(attributes) == {"alarms": [LOW.text]}


def test_home_assistant_finds_robots_whose_names_differ_in_an_umlaut():
    sinks = [MqttSink(topic=f"ohmward/{name}", home_assistant="ha", robot=name) for name in ("Süd 1", "Sod 1", "Söd 1")]
    topics = [topic for sink in sinks for topic, _ in sink.discovery()]
    assert len(set(topics)) == len(topics)
    assert all(re.fullmatch(r"ha/\w+/[a-zA-Z0-9_-]+/[a-zA-Z0-9_-]+/config", topic) for topic in topics)
