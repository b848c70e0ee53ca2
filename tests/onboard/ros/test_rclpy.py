"""The node of ROS 2 and its transport on rclpy itself, between nodes of this computer."""

import asyncio
import importlib.util
import math
import os
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

import ohmward
from ohmward import generic_battery, save_battery
from ohmward.onboard.ros import types
from ohmward.onboard.ros.transport import RosNetwork, message_class
from ohmward.onboard.sources.ros2 import Ros2Source
from ohmward.traction.robot.packaged import load_robot

rclpy = pytest.importorskip("rclpy", reason="rclpy is not installed: pip install 'ohmward[rclpy]', or source a ROS 2")
DescribeParameters = importlib.import_module("rcl_interfaces.srv").DescribeParameters

PACKAGE = Path(__file__).parents[3] / "ros" / "ohmward_ros"
#: A domain for each process of the tests, so that nodes of two tests never meet.
DOMAIN = 100 + os.getpid() % 100
WHEELS = ("front_left", "front_right", "rear_left", "rear_right")
#: What is waited for comes within this time, also on a busy computer [s].
PATIENCE_S = 60.0


class Robot:
    """A node with the topics of a robot's drivers, which hears what ohmward sends."""

    def __init__(self) -> None:
        self.context = rclpy.context.Context()
        rclpy.init(args=None, context=self.context, domain_id=DOMAIN)
        self.node = rclpy.create_node("robot", context=self.context)
        self.executor = rclpy.executors.SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        threading.Thread(target=self.executor.spin, daemon=True).start()
        self.heard: dict[str, list] = {}
        best_effort = rclpy.qos.qos_profile_sensor_data
        self.battery, self.joints, self.imu = (
            self.node.create_publisher(message_class(type_), topic, best_effort)
            for type_, topic in (
                (types.BATTERY_STATE, "bms"),
                (types.JOINT_STATE, "joint_states"),
                (types.IMU, "imu/data"),
            )
        )

    def hear(self, type_: str, topic: str) -> list:
        """Messages of a topic from now on."""
        heard = self.heard[topic] = []
        self.node.create_subscription(message_class(type_), topic, heard.append, 50)
        return heard

    def until(self, done, battery: bool = False, wheels: bool = False) -> None:
        """Let sensors report at 50 Hz until it is done."""
        end_s = time.monotonic() + PATIENCE_S
        while not done():
            assert time.monotonic() < end_s, f"nothing within {PATIENCE_S} s; heard {self.heard}"
            if battery:
                self.battery.publish(self.battery_state())
            if wheels:
                self.joints.publish(self.joint_states())
                self.imu.publish(self.stamped(types.IMU))
            time.sleep(0.02)

    def stamped(self, type_: str):
        """A message with the time of now."""
        message = message_class(type_)()  # type: ignore[operator]
        message.header.stamp = self.node.get_clock().now().to_msg()
        return message

    def battery_state(self):
        """A battery of four cells that gives 3 A."""
        message = self.stamped(types.BATTERY_STATE)
        message.voltage, message.current, message.temperature = 13.2, -3.0 - 0.1 * (time.monotonic() % 1.0), 24.0
        return message

    def joint_states(self):
        """Wheels that turn at 4 rad/s."""
        message = self.stamped(types.JOINT_STATE)
        message.name = [f"{wheel}_wheel_joint" for wheel in WHEELS]
        message.velocity = [4.0 + 1e-3 * (time.monotonic() % 1.0)] * len(WHEELS)
        return message

    def close(self) -> None:
        """End the node."""
        self.executor.shutdown()
        self.node.destroy_node()
        self.context.shutdown()


@pytest.fixture
def robot(tmp_path, monkeypatch):
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setenv("ROS_DOMAIN_ID", str(DOMAIN))
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "log"))
    monkeypatch.setenv("ROS_HOME", str(tmp_path / "home"))
    monkeypatch.chdir(tmp_path)
    found = Robot()
    yield found
    found.close()


@pytest.fixture
def start(tmp_path):
    """The function that starts the node with arguments behind `--ros-args`."""
    save_battery(generic_battery("lfp", 12.0, 4), tmp_path / "battery.toml")
    paths = [str(PACKAGE), str(Path(ohmward.__file__).parents[1]), *sys.path]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, paths))}
    started = []

    def begin(arguments: str, before: str = "") -> subprocess.Popen:
        program = [sys.executable, "-c", f"{before}from ohmward_ros.node import main; main()", "--ros-args"]
        process = subprocess.Popen([*program, *arguments.split()], env=environment, stderr=subprocess.PIPE, text=True)
        started.append(process)
        return process

    yield begin
    for process in started:
        process.kill()


def test_the_transport_carries_messages_both_ways(robot):
    transport = RosNetwork(transport="rclpy", namespace="/robot1").open()
    sent = robot.hear(types.BATTERY_STATE, "/robot1/battery_state")
    received: list[bytes] = []
    transport.subscribe("/bms", types.BATTERY_STATE, lambda payload, _: received.append(payload))
    robot.until(lambda: received, battery=True)

    def echoed() -> bool:
        transport.publish("battery_state", types.BATTERY_STATE, received[0])
        return bool(sent)

    robot.until(echoed)
    transport.check()
    transport.close()
    assert (sent[0].voltage, sent[0].temperature) == (pytest.approx(13.2), 24.0)


def test_publishers_of_a_topic_are_told_apart(robot):
    second = robot.node.create_publisher(message_class(types.JOINT_STATE), "joint_states", 10)
    source, publishers = Ros2Source(transport="rclpy", joint_states="joint_states"), set[str]()

    async def hear() -> None:
        task = asyncio.create_task(source.run(lambda message: publishers.add(message.publisher)))
        while len(publishers) < 2:
            for publisher in (robot.joints, second):
                publisher.publish(robot.joint_states())
            await asyncio.sleep(0.02)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)

    asyncio.run(asyncio.wait_for(hear(), PATIENCE_S))
    assert publishers == {"joint_states", "joint_states (publisher 2)"}


@pytest.mark.slow
def test_sensors_that_fall_silent_are_unknown_and_a_signal_ends_the_node(robot, start, tmp_path):
    """Battery and wheels, then the wheels alone, then none; a bag is played, of which nothing is kept."""
    battery = robot.hear(types.BATTERY_STATE, "battery_state")
    odometry = robot.hear(types.ODOMETRY, "ohmward/odometry")
    conditions = robot.hear(types.DIAGNOSTICS, "/diagnostics")
    node = start("-p battery:=battery.toml -p robot:=rlma -p battery_state_in:=bms -p bagfile:=run.mcap")

    def charge() -> float:
        return battery[-1].percentage if battery else math.nan

    def stale() -> set[str]:
        return {status.name for status in conditions[-1].status if status.level == b"\x03"}

    robot.until(lambda: charge() > 0.0 and odometry, battery=True, wheels=True)
    assert battery[-1].present and battery[-1].voltage == pytest.approx(13.2)
    assert odometry[-1].twist.twist.linear.x == pytest.approx(0.48, abs=0.02)
    robot.until(lambda: math.isnan(charge()) and "ohmward: charge" in stale(), wheels=True)
    assert not battery[-1].present and math.isnan(battery[-1].voltage)
    assert odometry and "ohmward: drive" not in stale()
    robot.until(lambda: {"ohmward: charge", "ohmward: drive"} <= stale())
    odometry.clear()
    count = len(conditions)
    robot.until(lambda: len(conditions) >= count + 2)
    assert odometry == []
    node.send_signal(signal.SIGTERM)
    _, error = node.communicate(timeout=PATIENCE_S)
    assert node.returncode == 0 and "Traceback" not in error
    assert not (tmp_path / "home" / "ohmward").exists()


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ("-r battery/raw:=/battery_state", "battery_state_in and battery_state are both /battery_state"),
        ("-r battery_state:=battery/raw", "battery_state_in and battery_state are both /battery/raw"),
        ("-p imu:=5", "parameter imu must be text: -p \"PARAMETER:='5'\", got 5"),
        ("-p imu:=imu//data", "imu must be a topic of words of letters, digits and _"),
        ("-p slow_s:=1", "parameter slow_s must be a number with a point: 5.0, not 5, got 1"),
        ("-p joints:=[left]", "joints must be entries like"),
        ("-p battery", "Couldn't parse parameter override rule"),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence(robot, start, arguments, sentence):
    node = start(f"-p battery:=battery.toml {arguments}")
    _, error = node.communicate(timeout=PATIENCE_S)
    assert node.returncode == 1
    assert sentence in error and "Traceback" not in error


def test_parameters_topics_and_services_of_two_robots_are_there_before_any_sensor_reports(robot, start, tmp_path):
    """On one computer, in one working folder; nothing is heard of any driver."""
    nodes = [start(f"-p robot:=rlma -r __ns:=/{name}") for name in "ab"]
    graph = robot.node

    def services() -> set[str]:
        return {name for name, types_ in graph.get_service_names_and_types() if types_ == ["std_srvs/srv/Trigger"]}

    def topics() -> set[str]:
        return {name for name, _ in graph.get_topic_names_and_types()}

    expected = {f"/{name}/{topic}" for name in "ab" for topic in ("battery_state", "ohmward/odometry", "ohmward/twist")}
    robot.until(lambda: expected <= topics())
    of_nodes = graph.get_node_names_and_namespaces
    robot.until(lambda: [name for name, space in of_nodes() if space in ("/a", "/b")] == ["ohmward", "ohmward"])
    found = described(robot, "/a/ohmward", ["imu", "joints"])
    assert [(one.name, one.type, one.read_only) for one in found] == [("imu", 4, True), ("joints", 9, True)]
    assert "sensor_msgs/Imu" in found[0].description
    if importlib.util.find_spec("std_srvs"):
        robot.until(lambda: {"/b/ohmward/reset_pose", "/b/ohmward/battery_changed"} <= services())
    for node in nodes:
        node.send_signal(signal.SIGINT)
        _, error = node.communicate(timeout=PATIENCE_S)
        assert node.returncode == 0 and "Traceback" not in error
    folders = sorted(str(path.relative_to(tmp_path)) for path in (tmp_path / "home" / "ohmward").glob("*/*"))
    assert folders == ["home/ohmward/a/ohmward", "home/ohmward/b/ohmward"]


def described(robot: Robot, node: str, names: list[str]) -> list:
    """Descriptors of parameters of another node."""
    asking = robot.node.create_client(DescribeParameters, f"{node}/describe_parameters")
    assert asking.wait_for_service(timeout_sec=PATIENCE_S)
    answer = asking.call_async(DescribeParameters.Request(names=names))
    robot.until(answer.done)
    return list(answer.result().descriptors)


def test_services_change_what_is_estimated(robot, start):
    trigger = pytest.importorskip("std_srvs.srv", reason="std_srvs is not installed").Trigger
    battery = robot.hear(types.BATTERY_STATE, "battery_state")
    odometry = robot.hear(types.ODOMETRY, "ohmward/odometry")
    node = start("-p battery:=battery.toml -p robot:=rlma -p battery_state_in:=bms")

    def call(name: str) -> str:
        client = robot.node.create_client(trigger, f"/ohmward/{name}")
        assert client.wait_for_service(timeout_sec=PATIENCE_S)
        answer = client.call_async(trigger.Request())
        robot.until(answer.done, battery=True, wheels=True)
        assert answer.result().success
        return answer.result().message

    def driven_m() -> float:
        return odometry[-1].pose.pose.position.x if odometry else 0.0

    def charge() -> float:
        return battery[-1].percentage if battery else math.nan

    robot.until(lambda: driven_m() > 1.0 and charge() > 0.0, battery=True, wheels=True)
    before = charge()
    assert before < 0.9
    assert call("reset_pose") == "the pose restarts at the origin of odom"
    robot.until(lambda: driven_m() < 0.9, battery=True, wheels=True)
    assert call("battery_full") == "the battery is full"
    robot.until(lambda: charge() > 0.95, battery=True, wheels=True)
    call("battery_changed")
    robot.until(lambda: charge() == pytest.approx(before, abs=0.1), battery=True, wheels=True)
    node.send_signal(signal.SIGINT)
    node.communicate(timeout=PATIENCE_S)
    assert node.returncode == 0


def test_what_a_driver_has_queued_counts_at_the_time_of_its_measurement(robot, start):
    """Eight seconds at 4 rad/s are sent within a moment, the next two as they are measured."""
    odometry = robot.hear(types.ODOMETRY, "ohmward/odometry")
    reliable = rclpy.qos.QoSProfile(depth=1000)
    robot.joints = robot.node.create_publisher(message_class(types.JOINT_STATE), "joint_states", reliable)
    robot.imu = robot.node.create_publisher(message_class(types.IMU), "imu/data", reliable)
    start("-p robot:=rlma")
    robot.until(lambda: robot.joints.get_subscription_count() and robot.imu.get_subscription_count())
    time.sleep(1.0)  # until the node has found the publishers, too
    now_s, begin_s = time.time(), time.monotonic()
    for k in range(400):
        for publisher, message in ((robot.imu, robot.stamped(types.IMU)), (robot.joints, robot.joint_states())):
            past_s = now_s - 8.0 + 0.02 * k
            message.header.stamp.sec, message.header.stamp.nanosec = int(past_s), int(1e9 * (past_s % 1.0))
            publisher.publish(message)
    robot.until(lambda: time.monotonic() > begin_s + 2.0, wheels=True)
    radius_m = load_robot("rlma").wheel.radius_m
    assert odometry[-1].pose.pose.position.x == pytest.approx(4.0 * radius_m * 10.0, rel=0.05)
    assert 8.0 < stamp_s(odometry[-1]) - stamp_s(odometry[0]) < 10.5


def stamp_s(message) -> float:
    return message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec


@pytest.mark.parametrize("after_s", [0.1, 0.4, 1.0])
def test_a_signal_while_the_node_begins_leaves_no_traceback(robot, start, after_s):
    node = start("-p robot:=rlma")
    time.sleep(after_s)
    node.send_signal(signal.SIGINT)
    _, error = node.communicate(timeout=PATIENCE_S)
    assert not re.search(r'node\.py", line \d+, in main', error)  # a busy computer may not have begun it by then


#: What is raised in a callback of the garbage collection the interpreter prints, and goes on.
LOST = """
import ohmward_ros.node as n
raising = n.End.__call__
def lost(*signal):
    try:
        raising(*signal)
    except SystemExit:
        pass
n.End.__call__ = lost
"""


def test_a_signal_whose_exception_got_lost_ends_the_node_all_the_same(robot, start):
    node = start("-p robot:=rlma", LOST)
    time.sleep(0.5)
    node.send_signal(signal.SIGINT)
    node.communicate(timeout=PATIENCE_S)
    assert node.returncode == 0
