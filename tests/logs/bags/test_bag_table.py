"""Bags as logs: every format, topics by type and by name, messages that are damaged."""

import gzip
import sqlite3
import time

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.logs import read_drive, read_log
from ohmward.logs.read import open_table

from .examples import (
    FORMATS,
    START_NS,
    STEP_NS,
    TYPE,
    N,
    header,
    joint_states,
    payloads,
    store,
    truth,
    twists,
    write_mcap,
)

FLOAT, JOINTS = "std_msgs/msg/Float64", "sensor_msgs/msg/JointState"
TWIST = "geometry_msgs/msg/TwistWithCovarianceStamped"


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_gives_the_numbers_that_were_written(bags, name):
    log = read_log(bags / name)
    known = truth()
    np.testing.assert_array_equal(log.current_A, known["current"])
    np.testing.assert_array_equal(log.voltage_V, known["voltage"])
    np.testing.assert_allclose(log.time_s, 0.1 * np.arange(N), atol=1e-9)
    assert log.start_unix_s == pytest.approx(START_NS * 1e-9)
    assert [name for name in log.extra if name.startswith("cell_voltage")] == [f"cell_voltage[{k}]" for k in range(4)]
    assert not any(note.level == "warning" for note in log.notes)


def test_two_batteries_are_told_apart_by_their_topics(tmp_path):
    path = tmp_path / "two.mcap"
    write_mcap(path, {"/front": (TYPE, payloads(200)), "/rear": (TYPE, payloads(100, cells=0))})
    with pytest.raises(InputError, match=r"both /front and /rear are of type .*; choose with --topic /front"):
        read_log(path)
    assert len(read_log(path, where={"topic": "/rear"})) == 100
    with pytest.raises(InputError, match=r"no topic '/rare' that can be read; it has: /front \(sensor_msgs"):
        read_log(path, where={"topic": "/rare"})


def test_topics_of_numbers_are_read_by_their_names(tmp_path):
    found = store()
    number = found.types[FLOAT]
    columns = {
        name: (
            "std_msgs/msg/Float64",
            [bytes(found.serialize_cdr(number(float(v)), FLOAT)) for v in x],
        )
        for name, x in truth(500).items()
    }
    path = tmp_path / "plain.mcap"
    write_mcap(path, {f"/pack/{name}": column for name, column in columns.items()})
    for where in ({}, {"topic": "/pack/current,/pack/voltage"}):
        np.testing.assert_array_equal(read_log(path, where=where).current_A, truth(500)["current"])
    write_mcap(path, {f"/{name[0]}1": column for name, column in columns.items()})
    with pytest.raises(InputError, match=r"no topic of type sensor_msgs/msg/BatteryState; name .*--topic /a,/b"):
        read_log(path)


def test_a_drive_is_read_by_the_names_of_its_joints(tmp_path):
    found, n = store(), 300
    imu = found.types["sensor_msgs/msg/Imu"]
    still = found.types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
    vector = found.types["geometry_msgs/msg/Vector3"]
    speeds = np.column_stack([np.linspace(0.0, 5.0, n), np.linspace(0.0, 6.0, n)])
    names = ["left_wheel_joint", "right_wheel_joint"]
    wheels = joint_states(names, speeds)
    body = [
        found.serialize_cdr(
            imu(
                header(found.types, k, frame="imu_link"), still,
                np.zeros(9), vector(0.0, 0.0, 0.3), np.zeros(9), vector(0.1, 0.0, 9.8), np.zeros(9),
            ),
            "sensor_msgs/msg/Imu",
        )
        for k in range(n)
    ]  # fmt: skip
    path = tmp_path / "drive.mcap"
    topics = {"/joint_states": (JOINTS, wheels), "/imu": ("sensor_msgs/msg/Imu", body)}
    write_mcap(path, {name: (type_, list(map(bytes, messages))) for name, (type_, messages) in topics.items()})
    log = read_drive(path, ("left", "right"), 2)
    np.testing.assert_array_equal(log.wheel_speed_rad_s, speeds)
    np.testing.assert_array_equal(log.yaw_rate_rad_s, 0.3)
    np.testing.assert_array_equal(log.acceleration_m_s2, 0.1)


def test_joints_of_several_publishers_on_one_topic(tmp_path):
    """The arm speaks first, then each wheel with a message of its own."""
    speeds = np.arange(1.0, 61.0)[:, None]
    by_joint = [joint_states([name], speeds) for name in ("shoulder", "left_wheel_joint", "right_wheel_joint")]
    messages = [by_joint[k % 3][k] for k in range(60)]
    write_mcap(tmp_path / "drive.mcap", {"/joint_states": (JOINTS, messages)})
    log = read_drive(tmp_path / "drive.mcap", ("left", "right"), 2)
    np.testing.assert_array_equal(log.wheel_speed_rad_s[:, 0], speeds[1::3, 0])
    np.testing.assert_allclose(log.wheel_speed_rad_s[1:-1, 1], speeds[4:-4:3, 0], atol=1e-9)


@pytest.mark.parametrize("frame", ["map", "/robot1/odom"])
def test_a_speed_in_a_frame_that_does_not_turn_with_the_robot_is_warned_of(tmp_path, frame):
    speeds = np.linspace(0.0, 1.0, 100)
    wheels = joint_states(["left_wheel_joint", "right_wheel_joint"], np.column_stack([speeds, speeds]))
    topics = {"/joints": (JOINTS, wheels), "/gnss": (TWIST, twists(speeds, frame=frame))}
    write_mcap(tmp_path / "drive.mcap", topics)
    log = read_drive(tmp_path / "drive.mcap", ("left", "right"), 2, where={"topic": "/gnss"})
    assert any(f"/gnss: its velocity is said to be in {frame!r}" in note.text for note in log.notes)


def test_a_topic_with_a_speed_is_named_until_it_is_read(tmp_path):
    speeds = np.linspace(0.0, 1.0, 100)
    wheels = joint_states(["left_wheel_joint", "right_wheel_joint"], np.column_stack([speeds, speeds]))
    write_mcap(tmp_path / "drive.mcap", {"/joints": (JOINTS, wheels), "/gnss": (TWIST, twists(speeds))})
    without = read_drive(tmp_path / "drive.mcap", ("left", "right"), 2)
    assert without.speed_m_s is None
    assert [note.text for note in without.notes if "/gnss" in note.text] == [
        f"not read: /gnss ({TWIST}); add a forward speed that is not from the wheels with --topic NAME"
    ]
    log = read_drive(tmp_path / "drive.mcap", ("left", "right"), 2, where={"topic": "/gnss"})
    assert not any("velocity is said" in note.text for note in log.notes)
    np.testing.assert_array_equal(log.speed_m_s, speeds)
    assert not any(note.text.startswith("not read") for note in log.notes)


def test_frames_and_cells_of_changing_length_do_not_shift_the_numbers(tmp_path):
    mixed = [message for pair in zip(payloads(100, cells=4), payloads(100, cells=3), strict=True) for message in pair]
    path = tmp_path / "mixed.mcap"
    write_mcap(path, {"/battery": (TYPE, mixed)})
    log = read_log(path, current_sign="charge")
    assert len(log) == 100  # two messages have one stamp
    np.testing.assert_array_equal(log.current_A, truth(100)["current"])


def test_messages_that_are_shorter_than_their_fields_are_left_out(tmp_path):
    messages = payloads(100)
    messages[10:20] = [message[:30] for message in messages[10:20]]
    messages[50] = b""
    path = tmp_path / "broken.mcap"
    write_mcap(path, {"/battery": (TYPE, messages)})
    log = read_log(path, current_sign="charge")
    assert len(log) == 89
    assert any("11 messages could not be read" in note.text for note in log.notes)


def test_the_time_of_receipt_counts_where_the_stamp_is_of_another_clock(tmp_path):
    found = store()
    message = payloads(1)[0]
    parsed = found.deserialize_cdr(message, TYPE)
    parsed.header.stamp.sec = 12
    path = tmp_path / "unset.mcap"
    write_mcap(path, {"/battery": (TYPE, [bytes(found.serialize_cdr(parsed, TYPE))] * 5)})
    log = read_log(path, current_sign="charge")
    np.testing.assert_allclose(log.time_s, 0.1 * np.arange(5), atol=1e-9)
    assert log.start_unix_s == pytest.approx(START_NS * 1e-9)


def test_a_folder_without_a_recording_and_an_empty_one_are_refused(tmp_path):
    with pytest.raises(InputError, match="is a folder; name one log file in it"):
        open_table(tmp_path)
    write_mcap(tmp_path / "none.mcap", {"/battery": (TYPE, [])})
    with pytest.raises(InputError, match="holds no message"):
        open_table(tmp_path / "none.mcap")


def test_a_database_of_something_else_is_refused(tmp_path):
    with sqlite3.connect(tmp_path / "other.db3") as database:
        database.execute("CREATE TABLE things (a)")
    with pytest.raises(InputError, match="no table of this database"):
        open_table(tmp_path / "other.db3")


def test_split_recordings_are_read_one_after_the_other(tmp_path):
    folder = tmp_path / "day"
    folder.mkdir()
    messages = payloads(240)
    for part in range(12):
        first = 20 * part
        write_mcap(folder / f"day_{part}.mcap", {"/battery": (TYPE, messages[first : first + 20])})
    (folder / "metadata.yaml").write_text("rosbag2_bagfile_information: {}\n")
    log = read_log(folder)
    np.testing.assert_allclose(log.time_s, STEP_NS * 1e-9 * np.arange(240), atol=1e-9)
    assert log.name == "day"


@pytest.mark.slow
def test_messages_are_read_faster_than_one_by_one(tmp_path):
    """File and all, in a third of the time that rosbags takes for the messages alone."""
    messages, count, types = payloads(1000), 100_000, store()
    path = tmp_path / "long.mcap"
    write_mcap(path, {"/battery": (TYPE, [messages[k % 1000] for k in range(count)])}, chunk=65536)
    began_s = time.process_time()
    file = open_table(path).part("battery")
    table = file.load(file.names)
    ended_s = time.process_time()
    for message in messages:
        types.deserialize_cdr(message, TYPE)
    one_by_one_s = (time.process_time() - ended_s) / len(messages)
    assert table.line.size == count
    np.testing.assert_array_equal(table.columns["current [A]"], np.tile(truth(1000)["current"], count // 1000))
    assert (ended_s - began_s) / count < one_by_one_s / 1.5


@pytest.mark.parametrize("name", ["NONE.mcap", "one.bag"])
def test_a_packed_recording_is_unpacked(bags, tmp_path, name):
    path = tmp_path / f"{name}.gz"
    path.write_bytes(gzip.compress((bags / name).read_bytes()))
    log = read_log(path)
    assert log.name == name.partition(".")[0]
    np.testing.assert_array_equal(log.current_A, truth()["current"])


def test_a_recording_without_a_topic_of_ros_names_its_serialisations(tmp_path):
    writing = pytest.importorskip("mcap.writer")
    with (tmp_path / "json.mcap").open("wb") as stream:
        writer = writing.Writer(stream)
        writer.start()
        channel = writer.register_channel("/battery", "json", writer.register_schema("Battery", "jsonschema", b"{}"))
        writer.add_message(channel, 1, b'{"voltage": 13.2}', 1)
        writer.finish()
    with pytest.raises(InputError, match=r"no topic is in a serialisation of ROS .*it has: /battery \(json\)"):
        read_log(tmp_path / "json.mcap")
