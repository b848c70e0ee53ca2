"""The parameters make a setup; the node itself needs ROS, its process does not."""

from pathlib import Path

import pytest
from ohmward_ros.settings import DEFAULTS, setup_of

from ohmward.errors import InputError
from ohmward.onboard.part import is_live

CONFIG = Path(__file__).parents[1] / "config" / "ohmward.yaml"


def test_parameters_become_source_and_sink():
    setup = setup_of({"robot": "rlma", "imu": "", "odometry": "odom"}, "/robot1")
    (source,), (sink,) = setup.source, setup.sink
    assert (setup.robot, setup.battery) == ("rlma", None)
    assert (source.joint_states, source.imu, source.namespace) == ("joint_states", "", "/robot1")
    assert (sink.odometry, sink.twist, sink.transport) == ("odom", "ohmward/twist", "rclpy")


@pytest.mark.parametrize(("bagfile", "live"), [("", True), ("run.mcap", False)])
def test_nothing_is_kept_of_a_bag(bagfile, live):
    setup = setup_of({"robot": "rlma", "bagfile": bagfile})
    assert setup.state is None
    assert [is_live(source) for source in setup.source] == [live]


def test_without_battery_and_robot_there_is_nothing_to_estimate():
    with pytest.raises(InputError, match="nothing to estimate"):
        setup_of({})


def test_a_setup_keeps_its_own_sources_and_sinks(tmp_path):
    path = tmp_path / "robot.toml"
    text = 'format = "ohmward-setup/1"\nrobot = "rlma"\n[[sink]]\nkind = "json-lines"\npath = "log.jsonl"\n'
    path.write_text(text)
    setup = setup_of({"setup": str(path)})
    assert [type(part).__name__ for part in setup.sink] == ["JsonLinesSink", "Ros2Sink"]


def test_the_file_of_parameters_has_each_with_its_default():
    lines = [line.strip() for line in CONFIG.read_text().splitlines() if ': "' in line and "#" not in line]
    found = {name: value.strip('"') for name, _, value in (line.partition(": ") for line in lines)}
    files = dict.fromkeys(("battery", "robot", "setup", "bagfile"), "")  # the launch file gives them
    assert found | files == DEFAULTS
