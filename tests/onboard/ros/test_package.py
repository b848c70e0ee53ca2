"""The package of ROS: built and tested by colcon without ROS; the way through rclpy with a stand-in of its calls."""

import os
import shutil
import subprocess
import sys
import types as modules
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ohmward
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
