"""Which column is which wheel, motor or sensor of the body."""

import pytest

from ohmward.errors import InputError
from ohmward.logs.wheel_columns import Wheels, find_drive_columns

FRONT = Wheels(("front_left", "front_right", "rear_left", "rear_right"), 2)
ALL = Wheels(FRONT.places, 4)
TWO = Wheels(("left", "right", "caster_1"), 2)
OMNI = Wheels(("wheel_1", "wheel_2", "wheel_3"), 3)


def columns(names, wheels=ALL, **kwargs):
    found = find_drive_columns("f.csv", ["t", *names], wheels, **kwargs).columns
    return {quantity: column.name for quantity, column in found.items() if quantity != "time"}


def speeds(names, wheels=ALL):
    return [columns(names, wheels).get(f"{place}_wheel_speed") for place in wheels.places]


@pytest.mark.parametrize(
    "names",
    [
        [f"{p}_wheel_speed_rad_s" for p in FRONT.places],
        ["omega_fl", "omega_fr", "omega_rl", "omega_rr"],
        ["v_fl", "v_fr", "v_rl", "v_rr"],
        ["wheelSpeedFL", "wheelSpeedFR", "wheelSpeedRL", "wheelSpeedRR"],
        ["lf_wheel_rpm", "rf_wheel_rpm", "lb_wheel_rpm", "rb_wheel_rpm"],
        ["front_left (rad/s)", "front_right (rad/s)", "back_left (rad/s)", "back_right (rad/s)"],
        ["velocity[0]", "velocity[1]", "velocity[2]", "velocity[3]"],
        ["m1vel", "m2vel", "m3vel", "m4vel"],
        [f"axis{k}.encoder.vel_estimate [rev/s]" for k in range(4)],
        ["enc_fl_ticks", "enc_fr_ticks", "enc_rl_ticks", "enc_rr_ticks"],
    ],
)
def test_every_wheel_has_its_column(names):
    assert speeds(names) == names
    assert speeds(names[::-1]) == names


@pytest.mark.parametrize(
    "left, right",
    [
        ("wl", "wr"),
        ("velL", "velR"),
        ("left_wheel_vel", "right_wheel_vel"),
        ("vel_1", "vel_2"),
        ("v_l", "v_r"),
        ("rpm_l", "rpm_r"),
        ("enc_left_delta", "enc_right_delta"),
        ("odom_left", "odom_right"),
        ("odo_left_mm", "odo_right_mm"),
        ("Weg links [cm]", "Weg rechts [cm]"),
        ("Drehzahl_links", "Drehzahl_rechts"),
        ("Drehzahl links [U/min]", "Drehzahl rechts [U/min]"),
        ("vitesse_gauche", "vitesse_droite"),
        ("Raddrehzahl_links", "Raddrehzahl_rechts"),
        ("左車輪速度[rad/s]", "右車輪速度[rad/s]"),
        ("左轮转速(rpm)", "右轮转速(rpm)"),
        ("vitesse gauche (tr/min)", "vitesse droite (tr/min)"),
        ("rueda_izq_rpm", "rueda_der_rpm"),
        ("Левое колесо об/мин", "Правое колесо об/мин"),
        ("motor_rpm_left", "motor_rpm_right"),
        ("lwheel_vel", "rwheel_vel"),
        ("left_tps", "right_tps"),
        ("v_l(ips)", "v_r(ips)"),
        ("LeftVelocityRadPerSec", "RightVelocityRadPerSec"),
        ("drivewhl_l_joint velocity [rad/s]", "drivewhl_r_joint velocity [rad/s]"),
        ("rueda_izquierda velocity [rad/s]", "rueda_derecha velocity [rad/s]"),
        ("base_to_left_wheel velocity [rad/s]", "base_to_right_wheel velocity [rad/s]"),
    ],
)
def test_a_pair_serves_the_driven_wheels_of_its_side(left, right):
    assert speeds([left, right]) == [left, right, left, right]
    assert speeds([left, right], FRONT) == [left, right, None, None]


def test_the_wheels_of_the_only_axle_with_speeds_are_those_of_a_robot_with_one_axle():
    names = ["front_left_steer_joint velocity [rad/s]", "front_right_steer_joint velocity [rad/s]", "v_rl", "v_rr"]
    assert speeds(names, TWO) == ["v_rl", "v_rr", None]
    with pytest.raises(InputError, match="both 'v_fl' and 'v_rl' may be the left_wheel_speed"):
        speeds(["v_fl", "v_fr", "v_rl", "v_rr"], TWO)


def test_an_exact_name_is_better_than_a_side():
    assert speeds(["wl", "wr", "omega_fl"]) == ["omega_fl", "wr", "wl", "wr"]


@pytest.mark.parametrize("separator", "._")
def test_signals_name_any_wheel_and_only_that(separator):
    wheels = Wheels(("left", "right", "swivel"), 3)
    names = [f"wheel_speed_rad_s{separator}{place}" for place in wheels.places]
    assert speeds(names, wheels) == names
    assert speeds([*names, f"wheel_speed_rad_s{separator}wished_left"], wheels) == names


def test_the_yaw_of_an_estimated_pose_is_no_sensor():
    assert columns(["wl", "wr", "yaw_rad"])["yaw"] == "yaw_rad"
    assert "yaw" not in columns(["wl", "wr", "yaw_rad", "position_std_m"])


def test_numbers_count_from_one_or_from_zero():
    assert speeds(["m1vel", "m2vel", "m3vel"], OMNI) == ["m1vel", "m2vel", "m3vel"]
    assert speeds(["w0", "w1", "w2"], OMNI) == ["w0", "w1", "w2"]
    assert find_drive_columns("f", ["t", "m1vel"], OMNI).by_number


def test_more_numbers_than_wheels_name_none_of_them():
    with pytest.raises(InputError, match="no column for the speed of a wheel"):
        find_drive_columns("f", ["t", *(f"w{k}" for k in range(1, 9))], ALL)


@pytest.mark.parametrize(
    "quantity, name",
    [
        ("yaw_rate", "yaw_rate_rad_s"), ("yaw_rate", "wz"), ("yaw_rate", "gyro_z"), ("yaw_rate", "gz_dps"),
        ("yaw_rate", "imu.angular_velocity.z"), ("yaw_rate", "imu.gyro[2]"), ("yaw_rate", "gyro_rad[2]"),
        ("yaw", "imu_yaw"), ("heading", "heading_rad"),
        ("heading", "compass_deg"), ("heading", "gnss_heading"), ("heading_std", "heading_std_rad"),
        ("acceleration", "acceleration_m_s2"), ("acceleration", "ax"),
        ("acceleration", "imu_acceleration_x"), ("acceleration", "linear_acceleration.x"), ("pitch", "pitch_deg"),
        ("speed", "speed_m_s"), ("speed", "gnss_speed"), ("speed", "speed_over_ground_kn"),
        ("speed", "gps_ground_speed"), ("speed_std", "speed_std_m_s"), ("speed_age", "speed_age_s"),
        ("front_left_motor_current", "front_left_motor_current_A"), ("front_left_motor_current", "curL"),
        ("rear_left_motor_current", "i_rl_mA"), ("front_right_motor_current", "current_R"),
    ],
)  # fmt: skip
def test_other_channels(quantity, name):
    assert columns(["wl", "wr", name])[quantity] == name


@pytest.mark.parametrize(
    "name",
    ["cmd_left", "m1setvel", "setvel", "speed_true_m_s", "front_left_slip_true", "yaw_rate_true_rad_s", "icp_pitch",
     "current_A", "voltage_V", "soc_true", "odom_linear_x", "xsetspeed", "imu.gyro[0]", "imu_acceleration_y", "wx"],
)  # fmt: skip
def test_what_is_no_measurement_of_the_drive_is_left_alone(name):
    assert name not in columns(["wl", "wr", name]).values()


def test_the_word_of_the_caller_counts():
    given = {"left_wheel_speed": "a", "front_right_wheel_speed": "b", "yaw_rate": "c"}
    found = columns(["a", "b", "c", "wl", "wr"], columns=given)
    assert found == {
        "front_left_wheel_speed": "a",
        "rear_left_wheel_speed": "a",
        "front_right_wheel_speed": "b",
        "rear_right_wheel_speed": "wr",
        "yaw_rate": "c",
    }


def test_a_unit_is_given_for_a_channel_a_side_or_a_kind():
    units = {"wheel_speed": "m/s", "left_wheel_speed": "rad/s", "rear_left_wheel_speed": "rpm"}
    found = find_drive_columns("f", ["t", "wl", "wr"], ALL, units=units).columns
    symbols = [unit.symbol for p in ALL.places if (unit := found[f"{p}_wheel_speed"].unit)]
    assert symbols == ["rad/s", "m/s", "rpm", "m/s"]


def test_truths_are_left_alone_when_asked():
    assert "speed" not in columns(["wl", "wr", "speed_m_s"], leave=["speed_m_s"])


@pytest.mark.parametrize(
    "names, kwargs, message",
    [
        (["a", "b"], {}, "no column for the speed of a wheel.*--column front_left_wheel_speed=NAME"),
        (
            ["L foo", "R foo", "z"],
            {},
            "left_wheel_speed=L foo' --column 'right_wheel_speed=R foo'.*--unit wheel_speed=",
        ),
        (["wl", "wr", "vel_l"], {}, "both 'wl' and 'vel_l' may be the front_left_wheel_speed.*--column"),
        (["wl", "wr"], {"columns": {"left_wheel_speed": "lw"}}, "there is no column 'lw' .*has: 't', 'wl', 'wr'"),
        (["wl", "wr"], {"columns": {"front_left_speed": "wl"}}, "unknown quantity 'front_left_speed'"),
        (["wl", "wr"], {"units": {"wheel_speed": "V"}}, "unit 'V' of the wheel_speed is not known; use for example"),
        (["wl", "wr"], {"units": {"wheel": "rpm"}}, "unknown quantity 'wheel'"),
    ],
)
def test_refusals(names, kwargs, message):
    with pytest.raises(InputError, match=message):
        columns(names, **kwargs)
