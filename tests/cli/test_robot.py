"""`ohmward robot`: files of sizes, URDFs and names."""

import argparse
from dataclasses import replace

import numpy as np
import pytest

from logs.bags.examples import joint_states, twists, write_mcap
from ohmward.cli import arguments
from ohmward.cli.main import main
from ohmward.logs import write_table
from ohmward.traction import load_robot
from ohmward.traction.robot.packaged import LAYOUTS, PACKAGED, generic_robot
from ohmward.traction.robot.robot import ROBOT_FILE


def test_sizes_become_a_file(as_json, tmp_path):
    words = ["robot", "--radius", "0.06", "--track", "0.3", "--mass", "12", "-o", str(tmp_path / "robot.toml")]
    first, second = as_json(*words), as_json(*words, "--name", "cart")
    robot = load_robot(tmp_path / "robot.toml")
    assert ROBOT_FILE.dump(robot) == ROBOT_FILE.dump(generic_robot(12.0, 0.06, 0.3, name="cart"))
    assert first["backup"] is None and second["backup"].endswith(".bak")
    assert [wheel["name"] for wheel in first["wheels"] if wheel["driven"]] == ["left", "right"]


def test_the_next_commands_quote_the_name_of_the_file(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["robot", "husky", "-o", "my husky.toml"]) == 0
    assert "ohmward slip drive.csv --robot 'my husky.toml'" in capsys.readouterr().out


def test_the_help_explains_every_layout_and_another_is_refused(monkeypatch, refused):
    monkeypatch.setenv("COLUMNS", "2000")
    parser = argparse.ArgumentParser()
    arguments.robot(parser)
    assert all(f" {layout}: " in parser.format_help() for layout in LAYOUTS)
    words = ("robot", "--radius", "0.06", "--track", "0.3", "--mass", "12", "--layout", "tank")
    assert f"layout must be one of {', '.join(LAYOUTS)}, got 'tank'" in refused(*words)


@pytest.mark.parametrize("name", PACKAGED)
def test_known_robots_are_shown_with_their_wheels(name, capsys):
    assert main(["robot", name]) == 0
    out = capsys.readouterr().out
    assert out.startswith(f"{PACKAGED[name].name}: ") and " m ahead, " in out
    assert all(f"  {place.name} " in out for place in PACKAGED[name].places)


@pytest.mark.parametrize("given", [(), ("--radius", "0.061")], ids=["GNSS and gyro", "radius and gyro"])
def test_a_drive_shows_the_sizes(given, as_json, tmp_path):
    t = np.arange(0.0, 60.0, 0.1)
    speed, turn = 0.4 + 0.2 * (t // 12 % 3), np.repeat([0.0, 0.5, -0.6, 0.0, 0.3], t.size // 5)
    sides = {
        f"{side}_rpm": (speed + way * 0.15 * turn) / 0.061 * 30 / np.pi for side, way in (("left", -1), ("right", 1))
    }
    outside = {} if given else {"gnss_speed": speed}
    write_table({"time_s": t, **sides, **outside, "gyro_z": turn + 0.01}, tmp_path / "drive.csv")
    found = as_json("robot", str(tmp_path / "drive.csv"), "--mass", "12", *given, "-o", str(tmp_path / "robot.toml"))
    robot, known = load_robot(tmp_path / "robot.toml"), {p["name"]: p for p in found["parameters"]}
    assert robot.wheel.radius_m == pytest.approx(0.061, rel=1e-6)
    assert abs(known["chassis.track_m"]["value"] - 0.3) < known["chassis.track_m"]["std"] < 0.01
    assert ROBOT_FILE.dump(replace(robot, name="robot")) == ROBOT_FILE.dump(
        generic_robot(12.0, robot.wheel.radius_m, known["chassis.track_m"]["value"])
    )


def test_the_odometry_of_a_bag_gives_back_the_sizes_of_its_driver(as_json, tmp_path):
    turn = np.repeat([0.0, 0.5, -0.6, 0.0], 100)
    wheels = (0.4 + np.outer(turn, [-0.15, 0.15])) / 0.061
    topics = {
        "/joint_states": (
            "sensor_msgs/msg/JointState",
            joint_states(["wheel_left_joint", "wheel_right_joint"], wheels),
        ),
        "/odom": ("geometry_msgs/msg/TwistWithCovarianceStamped", twists(np.full(turn.size, 0.4), turn)),
    }
    write_mcap(tmp_path / "drive.mcap", topics)
    found = as_json("robot", str(tmp_path / "drive.mcap"), "--topic", "/odom", "--mass", "4")
    known = {p["name"]: p["value"] for p in found["parameters"]}
    assert known == {"wheel.radius_m": pytest.approx(0.061, rel=1e-3), "chassis.track_m": pytest.approx(0.3, rel=0.01)}


def test_what_a_drive_does_not_show_is_asked_for(refused, tmp_path):
    t = np.arange(0.0, 20.0, 0.1)
    ahead = {"time_s": t, "gnss_speed": np.full(t.size, 0.5), "gyro_z": np.zeros(t.size)}
    write_table(ahead | dict.fromkeys(("left_rpm", "right_rpm"), np.full(t.size, 80.0)), tmp_path / "a.csv")
    write_table(ahead | dict.fromkeys(("left_m_s", "right_m_s"), np.full(t.size, 0.5)), tmp_path / "b.csv")
    drive = ("robot", str(tmp_path / "a.csv"))
    assert "no drive shows the mass of a robot; give --mass KG" in refused(*drive)
    assert "do not show chassis.track_m: the robot hardly turns" in refused(*drive, "--mass", "3")
    assert "no drive shows the track of a car robot" in refused(*drive, "--mass", "3", "--layout", "car")
    assert "'left_m_s' is in m/s; give the wheels' radius" in refused("robot", str(tmp_path / "b.csv"), "--mass", "3")


def test_a_drive_with_the_wheels_of_another_layout_names_that(refused, tmp_path):
    wheels = [f"{axle}_{side}_rpm" for axle in ("front", "rear") for side in ("left", "right")]
    t = np.arange(0.0, 20.0, 0.1)
    write_table(
        {"time_s": t, "gyro_z": np.sin(t), "gnss_speed": t} | dict.fromkeys(wheels, 60.0 * t), tmp_path / "a.csv"
    )
    assert "give --layout skid-steer" in refused("robot", str(tmp_path / "a.csv"), "--mass", "60")


def test_joints_of_a_urdf_that_are_called_otherwise_are_named(tmp_path, capsys):
    wheel = '<link name="{0}"><visual><geometry><sphere radius="0.05"/></geometry></visual></link>'
    joint = (
        '<joint name="{0}_motor_7" type="continuous"><parent link="base"/><child link="{0}"/>'
        '<origin xyz="0 {1} 0"/><axis xyz="0 1 0"/></joint>'
    )
    parts = [part.format(*of) for of in (("l", 0.1), ("r", -0.1)) for part in (wheel, joint)]
    (tmp_path / "a.urdf").write_text(f'<robot name="a"><link name="base"/>{"".join(parts)}</robot>', encoding="utf-8")
    assert main(["robot", str(tmp_path / "a.urdf"), "--mass", "3"]) == 0
    assert 'joints = { left = "l_motor_7", right = "r_motor_7" }' in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([], "give a URDF, a robot file, one of rlma"),
        (["--mass", "3"], "a robot needs --radius and --track too"),
        (["husky", "--mass", "60"], "--mass: husky has its own; write it with -o and edit that"),
        (["nobody"], "must be a robot file or one of"),
        (["husky", "-o", "husky.csv"], ".toml"),
    ],
)
def test_what_cannot_be_is_refused(words, message, refused):
    assert message in refused("robot", *words)
