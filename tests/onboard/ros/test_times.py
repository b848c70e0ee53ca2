"""Stamps of ROS: topics whose clocks differ, none at all, simulations and bags at any rate, and what goes out of it."""

import asyncio
import math
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from ohmward import generic_battery
from ohmward.onboard.clock import SystemClock
from ohmward.onboard.estimation import Estimation
from ohmward.onboard.process import Process
from ohmward.onboard.robot_state import Level
from ohmward.onboard.ros import messages, types
from ohmward.onboard.ros.cdr import read, serialize
from ohmward.onboard.sinks.ros2 import Ros2Sink, Translation
from ohmward.onboard.sources.ros2 import Ros2Source, RosTime
from ohmward.traction import RLMA

BEGIN_S, SPEED_M_S, SECONDS = 1_800_000_000.0, 0.5, 12.0
TOPICS = {"joints": types.JOINT_STATE, "imu": types.IMU, "battery": types.BATTERY_STATE, "clock": types.CLOCK}
BATTERY = generic_battery("lfp", 12.0, 4)


class StandingClock(SystemClock):
    """The clock of a computer, as the test sets it."""

    elapsed_s = 0.0

    def now_s(self):
        return 100.0 + self.elapsed_s

    def unix_s(self):
        return BEGIN_S + self.elapsed_s


def payload(topic, stamp_s, seconds):
    """A message of a robot that accelerates for two seconds and drives straight on; seconds: since it began."""
    header = messages.header(stamp_s, "")
    jitter = 1e-3 * math.sin(50.0 * seconds)  # a sensor that works is never the same twice
    if topic == "clock":
        return serialize(types.CLOCK, {"clock": header["stamp"]})
    if topic == "joints":
        turns = min(seconds / 2.0, 1.0) * SPEED_M_S / RLMA.wheel.radius_m
        names = [f"{place.name}_wheel_joint" for place in RLMA.places]
        content = {"name": names, "position": [], "velocity": [turns + jitter] * len(names), "effort": []}
        return serialize(types.JOINT_STATE, {"header": header} | content)
    if topic == "battery":
        sample = {"battery_current_A": -6.0 + jitter, "battery_voltage_V": 13.1 + 1e-3 * jitter}
        from_driver = messages.battery_state(driver_state(), sample, None, "base_link")
        return serialize(types.BATTERY_STATE, from_driver | {"header": header})
    nothing = {"x": 0.0, "y": 0.0, "z": 0.0}
    of_unit: dict[str, Any] = {
        "orientation": nothing | {"w": 0.0},
        "angular_velocity": nothing | {"z": 0.1 * jitter},
        "linear_acceleration": nothing | {"x": (SPEED_M_S / 2.0 if seconds < 2.0 else 0.0) + jitter},
        **{f"{name}_covariance": [0.0] * 9 for name in ("orientation", "angular_velocity", "linear_acceleration")},
    }
    return serialize(types.IMU, {"header": header} | of_unit)


def driver_state():
    return messages.RobotState(0.0, 0.0)


def driven(
    monkeypatch, offsets=None, rate=1.0, clock=None, begin_s=BEGIN_S, joints_hz=50.0, ros_time=None, set_back_s=0.0
):
    """Messages that go out, by topic, and the process, after a drive.

    offsets: of the stamps of a topic [s]; nan: it has none.  rate: seconds of the drive in a second; clock: /clock is
    published, or that of a bag alone, False; None is the wall clock.  set_back_s: the clock of the joints is set back
    by this in the middle of the drive.
    """
    offsets, standing = offsets or {}, StandingClock()
    monkeypatch.setattr("ohmward.onboard.sources.ros2.time.time", standing.unix_s)
    source = Ros2Source(battery_state="battery", joint_states="joints", imu="imu", live=clock is None)
    process = Process(Estimation(BATTERY, RLMA), [source], [Ros2Sink()], standing)
    ros_time = ros_time or (None if clock is None else RosTime())
    delays = np.random.default_rng(3)
    hertz = {"joints": joints_hz, "imu": 2.0 * joints_hz, "battery": 10.0} | ({"clock": 100.0 / rate} if clock else {})
    events = []
    for topic, hz in hertz.items():
        seconds = np.arange(int(SECONDS * hz)) / hz
        arrived_s = seconds / rate + 0.001 + delays.exponential(0.001, len(seconds))
        in_order_s = np.maximum.accumulate(arrived_s)  # no message overtakes another one of its topic
        events += [(a, topic, t) for a, t in zip(in_order_s.tolist(), seconds.tolist(), strict=True)]
    for arrived_s, topic, seconds in sorted(events):
        standing.elapsed_s = arrived_s
        stamp_s = begin_s + seconds + offsets.get(topic, 0.0)
        if topic == "joints" and seconds > 0.5 * SECONDS:
            stamp_s -= set_back_s
        sent = payload(topic, stamp_s if math.isfinite(stamp_s) else math.nan, seconds)
        name = "/clock" if topic == "clock" else topic
        if message := source.message(TOPICS[topic], sent, standing.now_s(), name, ros_time):
            process.put(message)
    return sent_by(process), process


def sent_by(process):
    """Numbers of the messages of each type that the states become."""
    ((sink, feed),) = process.sinks
    translation = Translation(sink)
    found: dict[str, list[dict[str, float]]] = {}

    async def translate():
        feed.end()
        for state in await feed.batch():
            for _, type_, content in translation.messages(state):
                found.setdefault(type_, []).append(read(type_, content)[1])

    asyncio.run(translate())
    return found


def stamps(sent):
    return np.array([m["header.stamp.sec"] + 1e-9 * m["header.stamp.nanosec"] for m in sent])


def distance_m(sent):
    return sent[-1]["pose.pose.position.x"]


@pytest.fixture(scope="module")
def usual():
    with pytest.MonkeyPatch.context() as patch:
        return driven(patch)


def check(found, usual, begin_s=BEGIN_S, joint_offset_s=0.0):
    """As far and as much charge as in the usual run, a pose for each message of the joints, stamps that increase."""
    (sent, process), (expected, without) = found, usual
    for type_ in (types.ODOMETRY, types.TWIST, types.BATTERY_STATE, types.DIAGNOSTICS):
        assert np.all(np.diff(stamps(sent[type_])) > 0.0)
    odometry = sent[types.ODOMETRY]
    assert len(odometry) >= 50 * SECONDS - 5
    assert_allclose(np.diff(stamps(odometry)[5:]), 0.02, atol=1e-6)
    assert stamps(odometry)[-1] == pytest.approx(begin_s + SECONDS - 0.02 + joint_offset_s, abs=1e-6)
    assert distance_m(odometry) == pytest.approx(distance_m(expected[types.ODOMETRY]), rel=0.005)
    charge, usual_charge = (p.estimation.state.battery.soc for p in (process, without))
    assert charge == pytest.approx(usual_charge, abs=0.005 * 6.0 * SECONDS / 3600.0 / 12.0 + 1e-6)
    conditions = process.watch.look(process.now_s())
    assert [c for c in conditions if c.level != Level.OK and "BatteryState" not in c.name] == []


def test_the_usual_run_is_the_drive(usual):
    assert distance_m(usual[0][types.ODOMETRY]) == pytest.approx(SPEED_M_S * (SECONDS - 1.0), rel=0.01)
    check(usual, usual)


@pytest.mark.parametrize(
    "offsets",
    [{"joints": -0.01}, {"joints": -0.7}, {"joints": 0.05}, {"imu": -0.7, "battery": 0.05}, {"battery": math.nan},
     {"battery": -BEGIN_S + 500.0}],
)  # fmt: skip
def test_topics_whose_clocks_differ_cost_nothing(monkeypatch, usual, offsets):
    check(driven(monkeypatch, offsets), usual, joint_offset_s=offsets.get("joints", 0.0))


@pytest.mark.parametrize("set_back_s", [0.05, 0.2, 0.5, 0.9])
def test_a_clock_that_is_set_back_costs_that_time_and_half_a_second(monkeypatch, usual, set_back_s):
    sent, process = driven(monkeypatch, set_back_s=set_back_s)
    sent_as_usual = usual[0][types.ODOMETRY]
    assert distance_m(sent[types.ODOMETRY]) == pytest.approx(distance_m(sent_as_usual), rel=0.01)
    assert len(sent[types.ODOMETRY]) >= len(sent_as_usual) - 50 * (0.5 + set_back_s) - 5
    state = process.estimation.state
    assert state.time_s - state.drive_time_s < 0.03


@pytest.mark.parametrize("rate", [0.5, 0.9, 1.0, 3.0, 10.0])
def test_a_simulation_counts_by_its_own_clock(monkeypatch, usual, rate):
    check(driven(monkeypatch, rate=rate, clock=True, begin_s=1000.0), usual, begin_s=1000.0)


@pytest.mark.parametrize("rate", [1.0, 10.0])
def test_a_bag_without_a_clock_counts_by_its_stamps(monkeypatch, usual, rate):
    check(driven(monkeypatch, rate=rate, clock=False, begin_s=1.7e9), usual, begin_s=1.7e9)


def test_a_battery_slower_than_its_message_is_not_sent_twice(monkeypatch):
    sent, _ = driven(monkeypatch)
    of_battery = stamps(sent[types.BATTERY_STATE]) - BEGIN_S
    assert_allclose(np.round(of_battery * 10.0) / 10.0, of_battery, atol=1e-6)  # those of its samples


def test_a_simulation_that_pauses_calls_nobody_silent(monkeypatch):
    _, process = driven(monkeypatch, clock=True, begin_s=1000.0)
    process.clock.elapsed_s += 3600.0
    assert process.now_s() == pytest.approx(1000.0 + SECONDS, abs=0.02)
    assert [c for c in process.watch.look(process.now_s()) if c.level == Level.STALE] == []


@pytest.mark.parametrize("clock", [True, False])
def test_a_simulation_or_a_bag_in_a_loop_begins_again(monkeypatch, caplog, clock):
    """A bag of twelve seconds, and its first two seconds once more, as far again as in the first two."""
    ros_time = RosTime()
    _, process = driven(monkeypatch, clock=clock, begin_s=1000.0, ros_time=ros_time)
    source = process.sources[0]
    for k in range(100):
        for topic, name in (("clock", "/clock"), ("joints", "joints"), ("imu", "imu"))[not clock :]:
            content = payload(topic, 1000.0 + 0.02 * k, 0.02 * k)
            process.put(source.message(TOPICS[topic], content, process.clock.now_s(), name, ros_time))
    assert caplog.text.count("its time went back; everything restarts") == 1
    assert process.estimation.state.drive_time_s == pytest.approx(1000.0 + 0.02 * 99, abs=0.02)
    assert process.estimation.state.pose.x_m == pytest.approx(SPEED_M_S * 1.0, rel=0.1)
    assert process.state.restarts == 1


def test_two_senders_of_a_bag_whose_clocks_differ_are_no_loop():
    ros_time = RosTime()
    found = [ros_time.received(1000.0 + 0.1 * k - 20.0 * (k % 2), "joints") for k in range(200)]
    assert found[20:] == sorted(found[20:])
