from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ohmward.errors import InputError
from ohmward.traction import (
    RLMA,
    ROBOTINO,
    SEEDER,
    Differential,
    Motor,
    Omni,
    Robot,
    SkidSteer,
    Wheel,
    load_robot,
    save_robot,
)
from ohmward.traction.robot.robot import ROBOT_FILE
from traction.examples import ROBOTS

TEXT = ROBOT_FILE.dump(RLMA).partition("\n\n")[2]  # without the comments at its head
lengths = st.floats(0.15, 0.6)
shares = st.floats(0.0, 10.0)
chassis = st.one_of(
    st.builds(Differential, lengths, lengths, lengths, st.sampled_from(["front", "all"])),
    st.builds(SkidSteer, lengths, lengths, lengths),
    st.builds(Omni, lengths, st.sampled_from([(60.0, 180.0, 300.0), (45.0, 135.0, 225.0, 315.0)])),
)
motors = st.builds(
    Motor, st.floats(1e-3, 5.0), st.floats(1e-3, 10.0), st.floats(0.5, 100.0), st.floats(0.1, 1.0), shares
)
robots = st.builds(
    Robot,
    name=st.text(st.characters(codec="utf-8", exclude_categories=["C"])),
    mass_kg=st.floats(20.0, 40.0),
    yaw_inertia_kg_m2=st.floats(0.1, 4.0),
    chassis=chassis,
    wheel=st.builds(Wheel, st.floats(0.02, 0.14), st.floats(0.005, 0.1), st.floats(1e-5, 0.008)),
    motor=motors,
    height_m=st.floats(0.0, 1.0),
    idle_W=shares,
)


@pytest.mark.parametrize("robot", ROBOTS.values(), ids=ROBOTS)
def test_what_is_saved_is_loaded(robot, tmp_path):
    save_robot(robot, tmp_path / "robot.toml")
    loaded = load_robot(tmp_path / "robot.toml")
    assert replace(loaded, yaw_inertia_kg_m2=robot.yaw_inertia_kg_m2, wheel=robot.wheel) == robot
    np.testing.assert_allclose(loaded.inertia, robot.inertia, rtol=1e-8)


@given(robots)
def test_a_second_round_changes_nothing(robot):
    once = ROBOT_FILE.dump(ROBOT_FILE.parse(ROBOT_FILE.dump(robot)))
    assert ROBOT_FILE.dump(ROBOT_FILE.parse(once)) == once


def test_a_file_by_hand_needs_only_what_has_no_default():
    robot = ROBOT_FILE.parse("""
        format = "ohmward-robot/1"
        name = "mine"
        mass_kg = 20
        yaw_inertia_kg_m2 = 0.5
        [chassis]
        kind = "skid-steer"
        front_m = 0.2
        rear_m = 0.2
        track_m = 0.4
        [wheel]
        radius_m = 0.1
        width_m = 0.05
        inertia_kg_m2 = 0.005
        [motor]
        torque_constant_Nm_per_A = 0.5
        resistance_ohm = 0.2
    """)
    assert robot.chassis == SkidSteer(0.2, 0.2, 0.4)
    assert robot.mass_kg == 20.0
    assert robot.motor.gear_efficiency == 1.0


@pytest.mark.parametrize(
    "old, new, message",
    [
        ("mass_kg = 42.0", "mass_g = 42000.0", r"mass_g is not a key .* did you mean mass_kg\? Units are part"),
        ("mass_kg = 42.0\n", "", "mass_kg is missing; add it"),
        ("mass_kg = 42.0", 'mass_kg = "42"', "mass_kg: expected `float`, got `str`, got '42'"),
        ("mass_kg = 42.0", "mass_kg = -1.0", "robot.mass_kg must be > 0, got -1"),
        ("mass_kg = 42.0", "mass_kg = nan", "robot.mass_kg must be finite"),
        ("front_m = 0.314", "front_m = 0.0", "chassis.front_m must be > 0"),
        ("front_m", "font_m", r"chassis.font_m is not a key .* did you mean front_m"),
        ("[motor]", "[engine]", "engine is not a key of a robot file"),
        ("[wheel]", "[wheel]\ncolour = 1", "wheel.colour is not a key of a robot file; there are: radius_m"),
        (
            'kind = "differential"',
            'kind = "tank"',
            "chassis.kind must be one of differential, skid-steer, two-wheel, steered, omni, mecanum; got 'tank'",
        ),
        ('kind = "differential"\n', "", "chassis.kind must be one of .* got None"),
        ("robot/1", "robot/2", "format must be 'ohmward-robot/1', got 'ohmward-robot/2'"),
        ("mass_kg = 42.0", "mass_kg = 42.0.0", "is not valid TOML: .*line"),
        ("radius_m = 0.12", "radius_m = 0.4", "wheel.radius_m must be below half the wheelbase of 0.628 m"),
        ("track_m = 0.3", "track_m = 0.001", "wheels front_left and front_right stand 0.001 m apart, less than"),
        ("kg_m2 = 2.569826", "kg_m2 = 2569.8", "yaw_inertia_kg_m2 must be between 0.00509 and 45.8 .*got 2569.8"),
        ("mass_kg = 42.0", "mass_kg = 42000.0", "mass_kg must be between .* a cube of steel .*correct one of them"),
        ("track_m = 0.3", "track_m = 300.0", "wheel.radius_m must be between 0.75 and .* got 0.12"),
    ],
)
def test_mistakes_are_named_with_their_fix(old, new, message, tmp_path):
    assert old in TEXT
    path = tmp_path / "robot.toml"
    path.write_text(TEXT.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(InputError, match=message) as caught:
        load_robot(path)
    assert "robot.toml: " in str(caught.value)


def test_a_table_that_is_none_is_refused():
    scalars = 'format = "ohmward-robot/1"\nname = "x"\nmass_kg = 1.0\nyaw_inertia_kg_m2 = 0.1\n'
    text = f"{scalars}chassis = 3\nwheel = 4\nmotor = 5"
    with pytest.raises(InputError, match=r"chassis.kind must be one of .* got 3"):
        ROBOT_FILE.parse(text)
    with pytest.raises(InputError, match=r"wheel must be a table \[wheel\], got 4"):
        ROBOT_FILE.parse(text.replace("chassis = 3", 'chassis = {kind = "omni", arm_m = 0.2}'))


def test_files_that_cannot_be_read_are_named(tmp_path):
    with pytest.raises(InputError, match=r"none.toml: cannot be read .* check the path"):
        load_robot(tmp_path / "none.toml")
    (tmp_path / "binary.toml").write_bytes(b"\x80\xfe")
    with pytest.raises(InputError, match=r"binary.toml: is not text in UTF-8"):
        load_robot(tmp_path / "binary.toml")


def test_the_robot_of_the_dissertation():
    assert (RLMA.mass_kg, RLMA.wheel.radius_m, RLMA.chassis) == (42.0, 0.12, Differential(0.314, 0.314, 0.30))
    assert RLMA.state_names == ("v_m_s", "yaw_rate_rad_s", "front_left_rad_s", "front_right_rad_s")
    rolling = 2 * 0.0108 / 0.12**2  # the rear wheels turn with the body
    wheels = 4 * 1.5 * (0.314**2 + 0.15**2 + 0.12**2 / 4 + 0.05**2 / 12)
    yaw = 36.0 * (0.68**2 + 0.38**2) / 12 + wheels
    assert RLMA.inertia.tolist() == pytest.approx([42.0 + rolling, yaw + rolling * 0.15**2, 0.0108, 0.0108])


def test_the_robot_of_the_paper():
    motor, robot = SEEDER.motor, load_robot("seeder")
    half_speed_rad_s = 0.5 * 12.0 / motor.torque_constant_Nm_per_A
    current_A = (12.0 - motor.torque_constant_Nm_per_A * half_speed_rad_s) / motor.resistance_ohm
    assert motor.torque_constant_Nm_per_A * current_A * half_speed_rad_s == pytest.approx(514.0)
    assert robot is SEEDER and robot.driven == 2 and robot.state_names[0] == "v_m_s" and motor.gear_ratio == 16.0


def test_the_omni_robot():
    assert ROBOTINO.wheel.radius_m == 0.04
    assert ROBOTINO.motor.gear_ratio == 16.0
    assert ROBOTINO.state_names[:3] == ("v_m_s", "v_left_m_s", "yaw_rate_rad_s")


@pytest.mark.parametrize(
    "field, value", [("mass_kg", 0.0), ("yaw_inertia_kg_m2", -1.0), ("height_m", -0.1), ("idle_W", -1.0)]
)
def test_impossible_robots_are_refused(field, value):
    with pytest.raises(InputError, match=f"robot.{field} must be"):
        replace(RLMA, **{field: value})
    with pytest.raises(InputError, match=r"wheel.width_m must be > 0"):
        Wheel(0.1, 0.0, 0.01)
