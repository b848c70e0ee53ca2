"""Robots of URDFs: their sizes, what they leave open, and what is refused."""

import math

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.traction import Omni, SkidSteer, TwoWheeled
from ohmward.traction.robot.robot import ROBOT_FILE
from ohmward.traction.robot.urdf import read_urdf, rotation


def link(name, mass_kg=0.0, at="0 0 0", shape="", yaw=0.01):
    inertial = (
        f'<inertial><origin xyz="{at}"/><mass value="{mass_kg}"/>'
        f'<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.0008" iyz="0" izz="{yaw}"/></inertial>'
    )
    collision = f"<collision><geometry>{shape}</geometry></collision>" if shape else ""
    return f'<link name="{name}">{inertial if mass_kg else ""}{collision}</link>'


def joint(name, child, at, kind="continuous", axis="0 1 0", parent="base", rpy="0 0 0"):
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{at}" rpy="{rpy}"/><axis xyz="{axis}"/></joint>'
    )


def wheel(name, at, radius_m=0.05, **options):
    shape = f'<cylinder radius="{radius_m}" length="0.02"/>' if radius_m else '<mesh filename="wheel.stl"/>'
    return link(name, 0.5, shape=shape, yaw=0.001) + joint(f"{name}_joint", name, at, **options)


def urdf(tmp_path, *parts):
    path = tmp_path / "robot.urdf"
    path.write_text(f'<robot name="mine">{"".join(parts)}</robot>', encoding="utf-8")
    return path


BASE = link("base", 9.0, at="-0.05 0 0.1", yaw=0.2)
PAIR = (wheel("left_wheel", "0 0.15 0"), wheel("right_wheel", "0 -0.15 0"))


def test_two_wheels_and_a_caster(tmp_path):
    caster = link("caster") + joint("caster_joint", "caster", "-0.2 0 -0.03", kind="fixed")
    found = read_urdf(urdf(tmp_path, BASE, *PAIR, caster))
    robot, centre_m = found.robot, -0.05 * 9.0 / 10.0
    assert isinstance(robot.chassis, TwoWheeled)
    assert (robot.name, robot.mass_kg, robot.wheel.radius_m, robot.wheel.width_m) == ("mine", 10.0, 0.05, 0.02)
    assert robot.wheel.inertia_kg_m2 == pytest.approx(0.0008)
    sizes_m = robot.chassis.axle_m, robot.chassis.track_m, *robot.chassis.casters_m
    assert sizes_m == pytest.approx((-centre_m, 0.3, -0.2 - centre_m))
    parts = 0.2 + 9.0 * (-0.05 - centre_m) ** 2 + 2 * (0.001 + 0.5 * (0.15**2 + centre_m**2))
    assert robot.yaw_inertia_kg_m2 == pytest.approx(parts)
    assert robot.height_m == pytest.approx(0.9 * 0.1 + 0.05)
    assert found.joints == {"left": "left_wheel_joint", "right": "right_wheel_joint"}
    text = ROBOT_FILE.dump(robot)
    assert ROBOT_FILE.dump(ROBOT_FILE.parse(text)) == text


def test_frames_are_followed_and_a_wheel_that_turns_backwards_is_said(tmp_path):
    """As in many URDFs: wheels about their own z, on frames that are rolled; one of them the other way round."""
    turned = (
        wheel("left_wheel", "0 0.15 0", axis="0 0 1", rpy="-1.5707963 0 0"),
        wheel("right_wheel", "0 -0.15 0", axis="0 0 2", rpy="1.5707963 0 0"),
    )
    found = read_urdf(urdf(tmp_path, BASE, *turned))
    assert isinstance(found.robot.chassis, TwoWheeled) and found.robot.chassis.track_m == pytest.approx(0.3)
    assert found.robot.wheel.inertia_kg_m2 == pytest.approx(0.001)  # about their own z
    assert [words for words in found.assumed if "right_wheel_joint" in words and "change the sign" in words]
    assert [words for words in found.assumed if words.startswith("caster: none found")]


def test_inertias_that_the_masses_cannot_have_are_not_believed(tmp_path):
    """Links with the inertia 1, as of files that were written for a picture: wheels are discs, the robot is a box."""
    found = read_urdf(
        urdf(tmp_path, BASE, *(part.replace('"0.0008"', '"1"').replace('"0.001"', '"1"') for part in PAIR))
    )
    assert found.robot.wheel.inertia_kg_m2 == pytest.approx(0.5 * 0.05**2 / 2)
    assert found.robot.yaw_inertia_kg_m2 == pytest.approx(10.0 * 2 * 0.3**2 / 12)
    assert sum("that their mass allows" in words for words in found.assumed) == 2


def test_a_car_has_its_rear_wheels_and_an_axle_that_steers(tmp_path):
    knuckles = "".join(
        link(f"knuckle_{side}") + joint(f"steer_{side}", f"knuckle_{side}", f"0.3 {y} 0", "revolute", "0 0 1")
        + wheel(f"front_{side}", "0 0 0", parent=f"knuckle_{side}")
        for side, y in (("left", 0.15), ("right", -0.15))
    )  # fmt: skip
    chassis = read_urdf(urdf(tmp_path, link("base", 9.0, at="0.1 0 0.1"), *PAIR, knuckles)).robot.chassis
    assert isinstance(chassis, TwoWheeled)
    assert np.subtract(chassis.casters_m, chassis.axle_m) == pytest.approx(0.3)


def test_four_wheels_on_two_axles_and_wheels_on_a_circle(tmp_path):
    four = [
        wheel(f"w{k}", f"{x} {y} 0") for k, (x, y) in enumerate(((-0.2, 0.2), (0.2, -0.2), (0.2, 0.2), (-0.2, -0.2)))
    ]
    found = read_urdf(urdf(tmp_path, BASE, *four))
    assert isinstance(found.robot.chassis, SkidSteer)
    assert found.joints == {
        "front_left": "w2_joint", "front_right": "w1_joint", "rear_left": "w0_joint", "rear_right": "w3_joint",
    }  # fmt: skip
    circle = [
        wheel(f"w{bearing}", f"{0.15 * np.cos(b)} {0.15 * np.sin(b)} 0", axis=f"{np.cos(b)} {np.sin(b)} 0")
        for bearing, b in ((bearing, np.radians(bearing)) for bearing in (300, 60, 180))
    ]
    found = read_urdf(urdf(tmp_path, BASE, *circle))
    assert isinstance(found.robot.chassis, Omni)
    assert (found.robot.chassis.arm_m, found.robot.chassis.bearings_deg) == (pytest.approx(0.15), (60.0, 180.0, 300.0))
    assert found.joints == {"wheel_1": "w60_joint", "wheel_2": "w180_joint", "wheel_3": "w300_joint"}


def test_what_a_file_leaves_open_can_be_given(tmp_path):
    parts = [part.replace("<inertial>", "<!--").replace("</inertial>", "-->") for part in (
        wheel("left_wheel", "0 0.15 0", None), wheel("right_wheel", "0 -0.15 0", None),
    )]  # fmt: skip
    meshes = urdf(tmp_path, link("base"), *parts)
    with pytest.raises(InputError, match="only meshes of its wheels; give their radius with --radius"):
        read_urdf(meshes)
    with pytest.raises(InputError, match="no masses; give the robot's with --mass"):
        read_urdf(meshes, radius_m=0.04)
    robot = read_urdf(meshes, radius_m=0.04, mass_kg=5.0).robot
    assert (robot.wheel.radius_m, robot.mass_kg) == (0.04, 5.0)


@pytest.mark.parametrize("rpy", [(0.1, -0.4, 2.0), (0.0, -math.pi / 2, 3.1), (-3.0, 0.2, 0.0)])
def test_an_inertial_unit_that_is_mounted_turned_is_said(rpy, tmp_path):
    unit = link("imu_link") + joint("imu_joint", "imu_link", "0 0 0.1", kind="fixed", rpy="{} {} {}".format(*rpy))
    level = link("second_imu") + joint("second_joint", "second_imu", "0 0 0.1", kind="fixed")
    found = read_urdf(urdf(tmp_path, BASE, *PAIR, unit, level)).imu_rpy
    assert list(found) == ["imu_link"]
    np.testing.assert_allclose(rotation(*found["imu_link"]), rotation(*rpy), atol=1e-12)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<sdf/>", "first element is <sdf>"),
        ("<robot", "is no XML"),
        ('<!DOCTYPE r><robot name="a"/>', "document type"),
        ('<robot name="a"><link name="${n}"/></robot>', "xacro .* > robot.urdf"),
        ('<robot name="a"><link name="a"/><link name="b"/></robot>', "one link must be nobody's child, found 2: a, b"),
        (f'<robot name="a">{BASE}</robot>', "no two wheels"),
        (f'<robot name="a">{BASE}{joint("j", "nowhere", "0 0 0")}</robot>', "joint 'j' leads to 'nowhere'"),
        (
            f'<robot name="a">{BASE}{wheel("w", "0 zero 0")}</robot>',
            "three numbers in xyz, rpy and axis, got '0 zero 0'",
        ),
        (f'<robot name="a">{link("base", "heavy")}</robot>', "a number is none"),
        (
            f'<robot name="a">{BASE}{wheel("a", "0 0.1 0")}{wheel("b", "0 -0.1 0.02", 0.07)}</robot>',
            "radii from 0.05 to 0.07 m",
        ),
    ],
)
def test_what_is_no_robot_is_refused_with_the_reason(text, message, tmp_path):
    path = tmp_path / "robot.urdf"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=message):
        read_urdf(path)
