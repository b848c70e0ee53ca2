"""The package of ROS: built and tested by colcon without ROS; the way through rclpy with a stand-in of its calls."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
import types as modules
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ohmward
from ohmward import generic_battery, save_battery
from ohmward.errors import InputError
from ohmward.onboard.robot_setup import SETUP_FILE
from ohmward.onboard.ros import types
from ohmward.onboard.ros.transport import RosNetwork

ROOT = Path(__file__).parents[3]
PACKAGE = ROOT / "ros" / "ohmward_ros"


def test_colcon_builds_and_tests_the_package(tmp_path):
    colcon, python = shutil.which("colcon"), "/usr/bin/python3"
    if not colcon or not Path(python).exists():
        pytest.skip("colcon is not installed")
    version = subprocess.run([python, "-c", "import sys; print(sys.version_info[:2])"], capture_output=True, text=True)
    if version.stdout.strip() != str(sys.version_info[:2]):
        pytest.skip("colcon runs another Python than these tests")
    shutil.copytree(PACKAGE, tmp_path / "src" / "ohmward_ros")
    packages = [Path(ohmward.__file__).parents[1], Path(np.__file__).parents[1]]
    environment = os.environ | {"PYTHONPATH": ":".join(map(str, packages))}

    def run(*words: str) -> str:
        done = subprocess.run([colcon, *words], cwd=tmp_path, env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    run("build")
    installed = tmp_path / "install" / "ohmward_ros"
    assert (installed / "lib" / "ohmward_ros" / "ohmward_node").exists()
    assert (installed / "share" / "ohmward_ros" / "launch" / "ohmward.launch.py").exists()
    assert (installed / "share" / "ohmward_ros" / "config" / "ohmward.yaml").exists()
    assert (installed / "share" / "ament_index" / "resource_index" / "packages" / "ohmward_ros").exists()
    run("test")
    summary = run("test-result", "--all").splitlines()[-1]
    assert summary == "Summary: 4 tests, 0 errors, 0 failures, 0 skipped"


def test_nothing_but_the_package_looks_like_one_to_colcon():
    """Every `setup.py` of a workspace is run for its name and dependencies."""
    there = [ROOT / name for name in ("src", "tests", "docs", "ros", "benchmarks", "firmware")]
    assert [path for folder in there for path in folder.rglob("setup.py")] == [PACKAGE / "setup.py"]


ROS2_SETUP = """
format = "ohmward-setup/1"
robot = "rlma"
[[source]]
kind = "ros2"
SOURCE
[[sink]]
kind = "ros2"
SINK
"""


@pytest.mark.parametrize(
    ("source", "sink", "message"),
    [
        (
            'battery_state = "battery_state"',
            "",
            "battery_state of source ros2 and battery_state of sink ros2 are both /battery_state: ohmward would take "
            'its own estimates for measurements; give one of them another topic, .* "ohmward/battery_state"',
        ),
        ('battery_state = "/a/battery_state"', 'namespace = "/a"', "are both /a/battery_state"),
        ('odometry = "odom"\nnamespace = "a"', 'odometry = "/a/odom"', "odometry of source ros2 and odometry of sink"),
        ('imu = "t"', 'twist = "t"\ndomain = 3', "imu of source ros2 and twist of sink ros2 are both /t"),
    ],
)
def test_a_setup_that_would_hear_itself_is_refused(source, sink, message):
    with pytest.raises(InputError, match=message):
        SETUP_FILE.parse(ROS2_SETUP.replace("SOURCE", source).replace("SINK", sink))


@pytest.mark.parametrize(
    ("source", "sink"),
    [
        ('battery_state = "battery_state"', 'namespace = "/a"'),
        ('battery_state = "battery_state"', 'battery_state = ""'),
        ('battery_state = "battery_state"\ndomain = 1', "domain = 2"),
    ],
)
def test_a_setup_that_hears_others_is_taken(source, sink):
    SETUP_FILE.parse(ROS2_SETUP.replace("SOURCE", source).replace("SINK", sink))


class Rclpy:
    """The calls of rclpy that the transport makes, by the names and arguments of its documentation."""

    def __init__(self) -> None:
        self.sent: list[tuple[str, str, bytes]] = []
        self.receivers: dict[str, tuple[Any, str, bool]] = {}
        self.ended: list[str] = []

    def create_node(self, node_name: str, *, context: Any, namespace: str) -> Any:
        assert (node_name, namespace) == ("ohmward", "/robot1")
        sent, receivers = self.sent, self.receivers

        def create_publisher(msg_type: type, topic: str, qos_profile: int) -> Any:
            publish = lambda payload: sent.append((topic, msg_type.__name__, payload))  # noqa: E731
            return modules.SimpleNamespace(publish=publish)

        def create_subscription(msg_type: type, topic: str, callback: Any, qos_profile: str, *, raw: bool) -> None:
            receivers[topic] = callback, qos_profile, raw

        return modules.SimpleNamespace(
            create_publisher=create_publisher,
            create_subscription=create_subscription,
            destroy_node=lambda: self.ended.append("node"),
        )

    def install(self, monkeypatch) -> None:
        ended = self.ended

        class Context:
            def shutdown(self) -> None:
                ended.append("context")

        class Executor:
            def __init__(self, *, context: Context):
                self.context = context

            def add_node(self, node: Any) -> None: ...

            def spin(self) -> None: ...

            def shutdown(self) -> None:
                ended.append("executor")

        def init(*, args: None, context: Context, domain_id: int) -> None:
            assert (args, domain_id) == (None, 7)

        battery = type("BatteryState", (), {})
        found: dict[str, dict[str, Any]] = {
            "rclpy": {"init": init, "create_node": self.create_node},
            "rclpy.context": {"Context": Context},
            "rclpy.executors": {"SingleThreadedExecutor": Executor},
            "rclpy.qos": {"qos_profile_sensor_data": "best effort"},
            "sensor_msgs": {},
            "sensor_msgs.msg": {"BatteryState": battery},
        }
        for name, content in found.items():
            module = modules.ModuleType(name)
            for attribute, value in content.items():
                setattr(module, attribute, value)
            monkeypatch.setitem(sys.modules, name, module)


def test_rclpy_carries_the_same_bytes(monkeypatch):
    ros = Rclpy()
    ros.install(monkeypatch)
    transport = RosNetwork(transport="rclpy", namespace="/robot1", domain=7).open()
    heard: list[bytes] = []
    transport.subscribe("battery/raw", types.BATTERY_STATE, heard.append)
    transport.publish("battery_state", types.BATTERY_STATE, b"bytes")
    transport.publish("battery_state", types.BATTERY_STATE, b"more")
    callback, qos, raw = ros.receivers["battery/raw"]
    callback(b"in")
    transport.check()
    transport.close()
    assert ros.sent == [("battery_state", "BatteryState", b"bytes"), ("battery_state", "BatteryState", b"more")]
    assert (qos, raw, heard) == ("best effort", True, [b"in"])
    assert ros.ended == ["executor", "node", "context"]


@pytest.mark.parametrize("given", ["seven", "233", "-1"])
def test_a_domain_of_the_environment_that_is_none_is_named(given, monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", given)
    with pytest.raises(InputError, match=f"ROS_DOMAIN_ID must be 0 to 232, got '{given}'"):
        RosNetwork(transport="zenoh").open()


STAND_IN = """
import atexit, json, os, sys, threading, types
SAID = open(os.environ["SAID"], "a", buffering=1)
def say(*words): print(json.dumps(words), file=SAID)
GIVEN = json.loads(os.environ["GIVEN"])
class Node:
    def __init__(self, name, namespace): self.name, self.namespace = name, namespace
    def declare_parameter(self, name, default): return types.SimpleNamespace(value=GIVEN.get(name, default))
    def get_namespace(self): return "/robot1"
    def resolve_topic_name(self, topic): return topic if topic[0] == "/" else "/robot1/" + topic
    def create_publisher(self, kind, topic, qos):
        say("publisher", topic, kind.__name__, qos)
        return types.SimpleNamespace(publish=lambda payload: say("sent", topic, len(payload)))
    def create_subscription(self, kind, topic, callback, qos, *, raw):
        say("subscription", topic, kind.__name__, qos, raw)
    def destroy_node(self): say("destroyed", self.name)
def init(*, args=None, context=None, domain_id=None): say("init", context is not None)
def create_node(name, *, context=None, namespace=""): return Node(name, namespace)
def shutdown(): say("shutdown")
def module(name, **content): sys.modules[name] = types.SimpleNamespace(**content)
class Context:
    def shutdown(self): say("context ended")
class SingleThreadedExecutor:
    def __init__(self, *, context): self.end = threading.Event()
    def add_node(self, node): pass
    def spin(self): self.end.wait()
    def shutdown(self): self.end.set(); say("executor ended")
module("rclpy.context", Context=Context)
module("rclpy.executors", SingleThreadedExecutor=SingleThreadedExecutor)
module("rclpy.qos", qos_profile_sensor_data="best effort")
KINDS = {"sensor_msgs": ("BatteryState", "JointState", "Imu"), "nav_msgs": ("Odometry",),
         "geometry_msgs": ("TwistWithCovarianceStamped",), "diagnostic_msgs": ("DiagnosticArray",)}
for package, kinds in KINDS.items():
    module(package)
    module(package + ".msg", **{kind: type(kind, (), {}) for kind in kinds})
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_node_takes_parameters_subscribes_as_to_sensors_and_ends_cleanly(tmp_path, number):
    """The node's program around a stand-in of rclpy, from its parameters to the signal that ends it."""
    save_battery(generic_battery("lfp", 12.0, 4), tmp_path / "battery.toml")
    (tmp_path / "rclpy.py").write_text(STAND_IN)
    given = {"battery": str(tmp_path / "battery.toml"), "robot": "rlma", "imu": "imu/raw"}
    paths = [str(tmp_path), str(ROOT / "ros" / "ohmward_ros"), str(Path(ohmward.__file__).parents[1])]
    more = {"GIVEN": json.dumps(given), "SAID": str(tmp_path / "said"), "PYTHONPATH": os.pathsep.join(paths)}
    program = [sys.executable, "-c", "from ohmward_ros.node import main; main()"]
    process = subprocess.Popen(program, cwd=tmp_path, env=os.environ | more, stderr=subprocess.PIPE, text=True)
    said: list[list[Any]] = []
    end_s = time.monotonic() + 60.0
    while not any(words[0] == "sent" for words in said) and time.monotonic() < end_s and process.poll() is None:
        time.sleep(0.1)
        text = (tmp_path / "said").read_text() if (tmp_path / "said").exists() else ""
        said = [json.loads(line) for line in text.splitlines()]
    process.send_signal(number)
    _, error = process.communicate(timeout=20)
    said = [json.loads(line) for line in (tmp_path / "said").read_text().splitlines()]
    assert process.returncode == 0 and "Traceback" not in error
    subscriptions = {words[1]: words[2:] for words in said if words[0] == "subscription"}
    assert subscriptions == {
        "battery/raw": ["BatteryState", "best effort", True],
        "joint_states": ["JointState", "best effort", True],
        "imu/raw": ["Imu", "best effort", True],
    }
    assert ["publisher", "/diagnostics", "DiagnosticArray", 10] in said
    assert said[:3] == [["init", False], ["destroyed", "ohmward_parameters"], ["shutdown"]]
    assert [words[0] for words in said].count("executor ended") == 2
    assert said[-1] == ["context ended"]
