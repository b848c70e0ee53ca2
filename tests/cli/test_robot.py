"""`ohmward robot`: files of sizes, URDFs and names."""

import pytest

from ohmward.cli.main import main
from ohmward.traction import load_robot
from ohmward.traction.robot.packaged import PACKAGED, generic_robot
from ohmward.traction.robot.robot import ROBOT_FILE


def test_sizes_become_a_file(as_json, tmp_path):
    words = ["robot", "--radius", "0.06", "--track", "0.3", "--mass", "12", "-o", str(tmp_path / "robot.toml")]
    first, second = as_json(*words), as_json(*words, "--name", "cart")
    robot = load_robot(tmp_path / "robot.toml")
    assert ROBOT_FILE.dump(robot) == ROBOT_FILE.dump(generic_robot(12.0, 0.06, 0.3, name="cart"))
    assert first["backup"] is None and second["backup"].endswith(".bak")
    assert [wheel["name"] for wheel in first["wheels"] if wheel["driven"]] == ["left", "right"]


@pytest.mark.parametrize("name", PACKAGED)
def test_known_robots_are_shown_with_a_drawing(name, capsys):
    assert main(["robot", name]) == 0
    out = capsys.readouterr().out
    assert PACKAGED[name].name in out and "+" in out
    drawing = out.split("\n\n")[1]
    assert drawing.count("#") == PACKAGED[name].driven


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
