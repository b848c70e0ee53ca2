"""The package of ROS, built and tested by colcon, and setups that would hear themselves."""

import os
import runpy
import shutil
import subprocess
import sys
import types
from functools import partial
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

import ohmward
from ohmward.errors import InputError
from ohmward.onboard.robot_setup import SETUP_FILE
from ohmward.onboard.ros.transport import RosNetwork
from ohmward.onboard.sinks.ros2 import Ros2Sink
from ohmward.onboard.sources.ros2 import Ros2Source

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
    # what the node needs without its neighbours: the `em` of the tests' environment is not the one of colcon
    beside, installed = tmp_path / "packages", Path(np.__file__).parents[1]
    beside.mkdir()
    for path in (*installed.glob("numpy*"), *installed.glob("msgspec*")):
        (beside / path.name).symlink_to(path)
    environment = os.environ | {"PYTHONPATH": f"{Path(ohmward.__file__).parents[1]}:{beside}"}

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
    assert summary == "Summary: 11 tests, 0 errors, 0 failures, 0 skipped"


class Recorded:
    """A stand-in for whatever the launch file makes: its class and its arguments."""

    made: ClassVar[list["Recorded"]] = []

    def __init__(self, *given, **named):
        self.given, self.named = given, named
        Recorded.made.append(self)


def test_arguments_of_the_launch_file_are_parameters_of_the_node(monkeypatch):
    """Read without ROS, whose launch has no wheel: what it would start, and with which names."""
    names = {
        "launch": ["LaunchDescription"],
        "launch.actions": ["DeclareLaunchArgument", "ExecuteProcess"],
        "launch.conditions": ["IfCondition"],
        "launch.substitutions": ["LaunchConfiguration", "PathJoinSubstitution", "PythonExpression"],
        "launch_ros": [],
        "launch_ros.actions": ["Node"],
        "launch_ros.parameter_descriptions": ["ParameterValue"],
        "launch_ros.substitutions": ["FindPackageShare"],
    }
    for module, classes in names.items():
        stand_in = types.ModuleType(module)
        for name in classes:
            setattr(stand_in, name, type(name, (Recorded,), {}))
        monkeypatch.setitem(sys.modules, module, stand_in)
    monkeypatch.setattr(Recorded, "made", [])
    monkeypatch.syspath_prepend(str(PACKAGE))
    parameters = runpy.run_path(str(PACKAGE / "ohmward_ros" / "parameters.py"))["PARAMETERS"]
    runpy.run_path(str(PACKAGE / "launch" / "ohmward.launch.py"))["generate_launch_description"]()
    declared = {one.given[0] for one in Recorded.made if type(one).__name__ == "DeclareLaunchArgument"}
    used = {one.given[0] for one in Recorded.made if type(one).__name__ == "LaunchConfiguration"}
    (node,) = [one for one in Recorded.made if type(one).__name__ == "Node"]
    texts, sim_time, _ = node.named["parameters"]
    assert used <= declared
    assert texts.keys() <= parameters.keys() and sim_time.keys() == {"use_sim_time"}
    setup = (PACKAGE / "setup.py").read_text(encoding="utf-8")
    assert f"{node.named['executable']} = " in setup and f'NAME = "{node.named["package"]}"' in setup


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


@pytest.mark.parametrize("topic", ["/imu//data", "imu data", "7imu", "imu/", "/", "imü"])
def test_a_topic_that_cannot_be_is_refused(topic):
    for part in (partial(Ros2Source, imu=topic), partial(Ros2Sink, twist=topic)):
        with pytest.raises(InputError, match="must be a topic of words of letters, digits and _"):
            part()
    assert Ros2Source(imu="~/imu", battery_state="/bms_1/state").imu == "~/imu"


@pytest.mark.parametrize("given", ["seven", "233", "-1"])
def test_a_domain_of_the_environment_that_is_none_is_named(given, monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", given)
    with pytest.raises(InputError, match=f"ROS_DOMAIN_ID must be 0 to 232, got '{given}'"):
        RosNetwork(transport="zenoh").open()
