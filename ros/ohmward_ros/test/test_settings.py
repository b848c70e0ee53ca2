"""The parameters make a setup; the node itself needs ROS, its process does not."""

import ast
from pathlib import Path

import pytest
from ohmward_ros.parameters import PARAMETERS
from ohmward_ros.settings import setup_of

from ohmward.errors import InputError
from ohmward.onboard.part import is_live

CONFIG = Path(__file__).parents[1] / "config" / "ohmward.yaml"


def test_parameters_become_source_and_sink():
    topics = {"imu": "", "odometry": "odom", "odometry_in": "gnss", "home_path": "plan", "home": "home"}
    setup = setup_of({"robot": "rlma"} | topics, "ohmward", "/robot1")
    (source,), (sink,) = setup.source, setup.sink
    assert (setup.robot, setup.battery) == ("rlma", None)
    assert (source.joint_states, source.imu, source.namespace) == ("joint_states", "", "/robot1")
    assert (source.odometry, source.home_path, sink.home) == ("gnss", "plan", "home")
    assert (sink.odometry, sink.twist, sink.transport) == ("odom", "ohmward/twist", "rclpy")


def test_without_battery_and_robot_there_is_nothing_to_estimate():
    with pytest.raises(InputError, match="nothing to estimate"):
        setup_of({})


def test_a_setup_keeps_its_own_sources_and_sinks(tmp_path):
    path = tmp_path / "robot.toml"
    text = 'format = "ohmward-setup/1"\nrobot = "rlma"\n[[sink]]\nkind = "json-lines"\npath = "log.jsonl"\n'
    path.write_text(text)
    setup = setup_of({"setup": str(path)})
    assert [type(part).__name__ for part in setup.sink] == ["JsonLinesSink", "Ros2Sink"]


def test_what_the_file_of_parameters_sets_is_a_parameter_with_its_default():
    given = CONFIG.read_text(encoding="utf-8").split("ros__parameters:")[1].splitlines()
    lines = [line.strip() for line in given if line.strip() and not line.strip().startswith("#")]
    found = {name: ast.literal_eval(value.replace("false", "False")) for name, value in (x.split(": ") for x in lines)}
    assert found == {name: PARAMETERS[name][0] for name in found}


@pytest.mark.parametrize(
    ("given", "kept"), [({}, True), ({"use_sim_time": True}, False), ({"bagfile": "run.mcap"}, False)]
)
def test_the_state_lies_in_a_folder_of_the_node_and_nowhere_in_a_simulation(monkeypatch, given, kept):
    monkeypatch.setenv("ROS_HOME", "/ros")
    setups = [setup_of({"robot": "rlma"} | given, "energy", space) for space in ("/r1", "/r2")]
    assert [is_live(source) for setup in setups for source in setup.source] == [kept] * 2
    folders = [f"/ros/ohmward/{space}/energy" if kept else None for space in ("r1", "r2")]
    assert [setup.state for setup in setups] == folders


def test_joints_mounting_and_home_are_read(monkeypatch):
    monkeypatch.setenv("HOME", "/home/robot")
    setup = setup_of(
        {"robot": "rlma", "joints": ["front_left=fl", "front_right=fr"], "imu_rpy": [0.0, 0.1, 0.2], "state": "~/kept"}
    )
    (source,) = setup.source
    assert (source.joints, source.imu_rpy) == ({"front_left": "fl", "front_right": "fr"}, (0.0, 0.1, 0.2))
    assert setup.state == "/home/robot/kept"


@pytest.mark.parametrize("entry", ["left", "=axle", "left="])
def test_a_joint_without_its_wheel_is_named(entry):
    with pytest.raises(InputError, match=f'joints must be entries like "left=wheel_left_joint", got .{entry}'):
        setup_of({"robot": "rlma", "joints": [entry]})
