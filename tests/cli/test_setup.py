"""`ohmward setup`: names of databases as people have them, what is heard, and what is asked."""

import json
import math
import os
import threading
import time
import tty
from contextlib import contextmanager
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cli.test_docs import listed
from logs.bags.examples import TYPE, joint_states, payloads, twists, write_mcap
from ohmward.cli.main import main
from ohmward.onboard.recognition import Answers, Offered, ask_wheels, recognise, short_name
from ohmward.onboard.robot_setup import SETUP_FILE
from ohmward.onboard.robot_state import RobotState, plain_state
from ohmward.onboard.serial_frame import SerialFrame, encode
from ohmward.onboard.sinks.ros2 import Ros2Sink
from ohmward.onboard.sources.serial import SerialSource
from ohmward.traction.robot.packaged import load_robot
from onboard.servers import mosquitto

BATTERY = ("--chemistry", "lfp", "--capacity-ah", "40", "--n-series", "8")
SIZES = ("--mass-kg", "60", "--wheel-radius-m", "0.1", "--track-m", "0.45")
RPM = math.pi / 30
CORNERS = ("front_left", "front_right", "rear_left", "rear_right")
CHANNELS = count()

#: Names as people have them: signals with their units in messages, and what they are here with scale.
STYLES = {
    "one word, abbreviated corners, rpm in the name alone": (
        {
            "BMS_Status1": {"BMS_PackVoltage": "V", "Pack_I": "A", "BMS_Temp": "degC", "BMS_TempMax": "degC"},
            "BMS_Status2": {"BMS_SOC": "%", "CCL": "A", "Max_Discharge_Current": "A", "BMS_Alarms": ""},
            "Cells": {f"CellVoltage_{k}": "mV" for k in (1, 2, 3, 4)},
            "Drives": {f"MotorRPM_{corner}": "" for corner in ("FL", "FR", "RL", "RR")},
            "Currents": {f"MotorCurrent_{corner}": "A" for corner in ("FL", "FR", "RL", "RR")},
            "IMU": {"YawRate": "deg/s", "AccelX": "g"},
            "Command": {"SetpointRPM_FL": "rpm"},
        },
        {"battery_voltage_V": 1.0, "battery_current_A": 1.0, "battery_temperature_degC": 1.0}
        | {"bms_soc": 0.01, "bms_charge_limit_A": 1.0, "bms_discharge_limit_A": 1.0, "bms_alarm": 1.0}
        | {f"cell_voltage_V.{k}": 0.001 for k in range(4)}
        | {f"wheel_speed_rad_s.{corner}": RPM for corner in CORNERS}
        | {f"motor_current_A.{corner}": 1.0 for corner in CORNERS}
        | {"yaw_rate_rad_s": math.pi / 180, "acceleration_m_s2": 9.80665},
    ),
    "the message says whose it is": (
        {
            "BMS": {"Voltage": "V", "Current": "A"},
            "Charger": {"Voltage": "V", "Current": "A"},
            "DriveLeft": {"Speed": "rpm", "Current": "A"},
            "DriveRight": {"Speed": "rpm", "Current": "A"},
        },
        {"battery_voltage_V": 1.0, "battery_current_A": 1.0}
        | {f"wheel_speed_rad_s.{side}": RPM for side in ("left", "right")}
        | {f"motor_current_A.{side}": 1.0 for side in ("left", "right")},
    ),
    "speeds of rims, motors by number": (
        {
            "Pack": {"U_Batt": "V", "I_Batt": "A", "T_Batt": "C", "I_limit_chg": "A"},
            "Wheels": {f"wheel_speed_{corner}": "km/h" for corner in ("fl", "fr", "rl", "rr")},
            "Motors": {"Motor1_RPM": "rpm", "Motor2_RPM": "rpm"},
        },
        {"battery_voltage_V": 1.0, "battery_current_A": 1.0, "battery_temperature_degC": 1.0, "bms_charge_limit_A": 1.0}
        | {f"wheel_speed_rad_s.{corner}": 1 / 3.6 / 0.1 for corner in CORNERS},
    ),
    "controllers by number": (
        {
            "BMS_01": {"HV_Battery_Voltage": "V", "HV_Battery_Current": "A"},
            "MC1": {"MC1_ActualSpeed": "rpm", "MC1_Current": "A", "MC1_Temp": "degC"},
            "MC2": {"MC2_ActualSpeed": "rpm", "MC2_Current": "A", "MC2_Temp": "degC"},
        },
        {"battery_voltage_V": 1.0, "battery_current_A": 1.0}
        | {f"wheel_speed_rad_s.{side}": RPM for side in ("left", "right")}
        | {f"motor_current_A.{side}": 1.0 for side in ("left", "right")},
    ),
}


def database(messages, limits="[-3000|3000]"):
    """The text of a DBC: 16 bits a signal, a hundredth of its unit each."""
    lines = ['VERSION ""', "", "NS_ :", "", "BS_:", "", "BU_: ROBOT", ""]
    for k, (message, signals) in enumerate(messages.items()):
        lines.append(f"BO_ {256 + k} {message}: 8 ROBOT")
        for j, (name, unit) in enumerate(signals.items()):
            lines.append(f' SG_ {name} : {16 * j}|16@1- (0.01,0) {limits} "{unit}" ROBOT')
        lines.append("")
    return "\n".join(lines)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def set_up(capsys):
    """Run `ohmward setup --json`; its object, and its exit status: 1 where it asks."""

    def run(*words, status):
        capsys.readouterr()
        assert main(["setup", *words, "--json"]) == status
        return json.loads(capsys.readouterr().out)

    return run


def written_source() -> Any:
    """The only source of the setup that was written."""
    (source,) = SETUP_FILE.load("robot.toml").source
    return source


@pytest.mark.parametrize("style", STYLES)
def test_signals_are_recognised_as_people_name_them(style, folder, set_up):
    messages, wanted = STYLES[style]
    (folder / "bus.dbc").write_text(database(messages))
    found = set_up("bus.dbc", *BATTERY, *SIZES, "--current-sign", "charge", status=0)
    assert {s: one["scale"] for s, one in found["signals"].items()} == pytest.approx(wanted)
    assert set(written_source().signals) == set(wanted)


def test_what_names_do_not_tell_is_asked_all_at_once_and_answered_by_the_options_it_prints(folder, set_up):
    messages = {
        "BMS": {"Voltage": "", "Current": ""},
        "Drive": {"SpeedLeft": "", "SpeedRight": ""},
        "IMU": {"GyroZ": "dps", "YawRate": "rad/s"},
    }
    (folder / "bus.dbc").write_text(database(messages, "[-300|300]"))
    words = ("bus.dbc",)
    assert main(["setup", *words]) == 2  # neither battery nor robot
    first = set_up(*words, "--robot", "seeder", status=1)
    asked = {question["option"] for question in first["asked"]}
    assert asked == {"--chemistry", "--capacity-ah", "--n-series", "--signal", "--unit", "--current-sign"}
    answers = [word for question in first["asked"] for word in (question["option"], question["example"])]
    second = set_up(*words, "--robot", "seeder", *answers, status=0)
    assert second["asked"] == []
    assert second["signals"]["battery_current_A"]["scale"] == -1.0
    assert second["signals"]["wheel_speed_rad_s.left"]["scale"] == pytest.approx(RPM)
    assert second["backups"] == {"robot.toml": "robot.toml.bak"}


@pytest.mark.parametrize(("values", "unit"), [([26.1, 26.3], ""), ([26_100.0, 26_300.0], "mV")])
def test_a_unit_is_asked_for_where_the_values_cannot_be_in_that_of_the_quantity(values, unit):
    heard = Offered("BMS.U", "U", time_s=np.arange(2.0), values=np.array(values))
    asked = [
        question.example for question in recognise([heard], None, Answers()).questions if "unit" in question.option
    ]
    assert asked == ([f"voltage={unit}"] if unit else [])


def test_numbers_that_are_all_called_value_have_the_names_of_their_topics():
    places = ("system/0/Dc/Battery", "battery/279/Dc/0", "solarcharger/288/Dc/0")
    names = [f"N/c061/{place}/{name}#value" for place in places for name in ("Voltage", "Current")]
    found = recognise([Offered(name, short_name(name)) for name in names], None, Answers())
    assert [signal.name for signal in found.signals.values()] == [names[1], names[0]]


def test_strings_in_parallel_are_wired_as_their_sum():
    heard = [Offered(f"BMS{k}.Current", "Current", "mA") for k in (1, 2)]
    given = Answers({"battery_current_A": "BMS1.Current + BMS2.Current"}, current_sign="discharge")
    wired = recognise(heard, None, given).signals["battery_current_A"]
    assert (wired.name, wired.scale) == ("BMS1.Current + BMS2.Current", -0.001)


def test_a_current_is_not_asked_for_where_nothing_can_be_one():
    found = recognise([Offered("BMS.Voltage", "Voltage", "V"), Offered("BMS.SOC", "SOC", "%")], None, Answers())
    assert list(found.signals) == ["battery_voltage_V", "bms_soc"] and not found.questions
    assert "can be the current" in found.notes[0]


def test_a_wheel_is_asked_for_among_what_can_be_a_speed():
    offered = [Offered(f"VESC{k}.{name}", name, unit) for k in (1, 2) for name, unit in (("ERPM", "rpm"), ("I", "A"))]
    (left, _) = ask_wheels(load_robot("seeder"), [], offered)
    assert "'VESC1.ERPM', 'VESC2.ERPM'?" in left.text
    wired = {"wheel_speed_rad_s.left": "VESC1.ERPM", "wheel_speed_rad_s.right": "VESC2.ERPM"}
    assert "pole pairs" in "".join(recognise(offered, load_robot("seeder"), Answers(wired)).notes)


@pytest.mark.parametrize(("soc", "scale"), [(76.0, 0.01), (0.76, 1.0)])
def test_a_charge_without_a_unit_is_in_percent_where_it_is_more_than_one(soc, scale):
    heard = Offered("bms/soc", "soc", time_s=np.arange(2.0), values=np.full(2, soc))
    assert recognise([heard], None, Answers()).signals["bms_soc"].scale == scale


def test_kelvin_is_offered_for_values_that_are_kelvin():
    heard = Offered("BMS.Temp", "Temp", time_s=np.arange(2.0), values=np.array([298.0, 299.0]))
    asked = [q.example for q in recognise([heard], None, Answers()).questions if "unit" in q.option]
    assert asked == ["temperature=K"]


def test_a_speed_of_the_motor_is_divided_by_the_gear(folder, set_up):
    (folder / "bus.dbc").write_text(database({"Drive": {"MotorRPM_L": "rpm", "MotorRPM_R": "rpm"}}))
    words = ("bus.dbc", *SIZES, "--gear", "5")
    assert [question["option"] for question in set_up(*words, status=1)["asked"]] == ["--shaft"]
    found = set_up(*words, "--shaft", "motor", status=0)
    assert found["signals"]["wheel_speed_rad_s.left"]["scale"] == pytest.approx(RPM / 5)


@contextmanager
def sending(send):
    """Send again and again, with the number of the time, until the end."""
    end = threading.Event()

    def run():
        for k in count():
            if end.wait(0.02):
                return
            send(k)

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield
    finally:
        end.set()
        thread.join()


def frame_of(bus_database, k):
    """A frame of a battery whose positive current discharges it: 20 mohm."""
    import can

    current = 5.0 + 10.0 * (k // 5 % 2)
    message = bus_database.get_message_by_name("BMS")
    data = message.encode({"Pack_V": 26.4 - 0.02 * current, "Pack_I": current})
    return can.Message(timestamp=0.02 * k, arbitration_id=message.frame_id, is_extended_id=False, data=data)


@pytest.fixture
def bus_database(folder):
    import cantools

    (folder / "bus.dbc").write_text(database({"BMS": {"Pack_V": "V", "Pack_I": "A"}, "Absent": {"YawRate": "rad/s"}}))
    return cantools.database.load_file("bus.dbc")


def test_of_a_bus_only_what_is_heard_is_wired_and_the_voltage_tells_the_sign(bus_database, set_up):
    import can

    channel = f"setup{next(CHANNELS)}"
    with can.Bus(interface="virtual", channel=channel) as bus, sending(lambda k: bus.send(frame_of(bus_database, k))):
        found = set_up(f"virtual:{channel}", "--dbc", "bus.dbc", *BATTERY, "--seconds", "3", status=0)
    assert {s: one["scale"] for s, one in found["signals"].items()} == {
        "battery_current_A": -1.0,
        "battery_voltage_V": 1.0,
    }
    assert "as the voltage answers it" in found["assumed"][0]


def test_a_recording_of_a_bus_tells_the_same(bus_database, set_up):
    import can

    with can.Logger("day.log") as log:
        for k in range(300):
            log.on_message_received(frame_of(bus_database, k))
    found = set_up("day.log", "--dbc", "bus.dbc", "--channel", "can1", *BATTERY, status=0)
    assert found["signals"]["battery_current_A"]["scale"] == -1.0
    source = written_source()
    assert (source.channel, source.dbc) == ("can1", "bus.dbc")


def test_topics_of_a_broker_and_their_keys_are_recognised(folder, set_up):
    from paho.mqtt import client as paho

    with mosquitto(folder) as broker:
        client = paho.Client(paho.CallbackAPIVersion.VERSION2)
        client.connect("127.0.0.1", broker.port)
        client.loop_start()
        client.publish("shed/bms", '{"voltage": 26.1, "current_mA": -4000, "mode": "idle"}', retain=True)
        client.publish("shed/drive/left/rpm", "30", retain=True)
        client.publish("shed/drive/right/rpm", "30", retain=True)
        client.publish("shed/imu", '{"yaw_rate_rad_s": 0.1}', retain=True)
        client.publish("ohmward/cart/battery/soc", "0.5", retain=True)
        client.publish("ohmward/cart/state", json.dumps(plain_state(RobotState(1.0, 2.0))), retain=True)
        address = f"mqtt://127.0.0.1:{broker.port}"
        words = (address, *BATTERY, *SIZES, "--seconds", "2", "--current-sign", "charge")
        found = set_up(*words, status=0)
        client.loop_stop()
    wired = {s: (one["name"], one["scale"]) for s, one in found["signals"].items()}
    assert wired["battery_current_A"] == ("shed/bms#current_mA", 0.001)
    assert wired["wheel_speed_rad_s.left"] == ("shed/drive/left/rpm", pytest.approx(RPM))
    source = written_source()
    assert source.topics == ("shed/imu",)
    assert "ohmward/cart" not in json.dumps(found)


def test_topics_of_a_bag_become_those_of_the_robot(folder, set_up):
    write_mcap(folder / "day.mcap", {"/front": (TYPE, payloads(20)), "/rear": (TYPE, payloads(20))})
    found = set_up("day.mcap", *BATTERY, status=1)
    assert found["asked"][0]["example"] == "battery_state=/front"
    set_up("day.mcap", *BATTERY, "--signal", "battery_state=/rear", status=0)
    source = written_source()
    assert source.battery_state == "/rear"


def test_the_robot_is_given_the_states_by_ros_under_a_topic_of_their_own(folder, set_up):
    write_mcap(folder / "day.mcap", {"/battery_state": (TYPE, payloads(20))})
    set_up("day.mcap", *BATTERY, status=0)
    sink = next(sink for sink in SETUP_FILE.load("robot.toml").sink if isinstance(sink, Ros2Sink))
    assert (sink.battery, sink.battery_state) == ("battery.toml", "ohmward/battery_state")


@pytest.mark.parametrize(("chemistry", "n_series"), [((), "4"), (("--chemistry", "lead-acid"), "6")])
def test_cells_in_series_are_suggested_by_the_voltage(chemistry, n_series, folder, set_up):
    """Of a pack at 13 V: four cells of LFP, the chemistry in the example, or six of lead-acid."""
    write_mcap(folder / "day.mcap", {"/bms": (TYPE, payloads(20))})
    asked = {q["option"]: q["example"] for q in set_up("day.mcap", "--robot", "seeder", *chemistry, status=1)["asked"]}
    assert asked["--n-series"] == n_series


JOINTS, TWIST = "sensor_msgs/msg/JointState", "geometry_msgs/msg/TwistWithCovarianceStamped"
CAR = ["front_left_steer_joint", "front_right_steer_joint", "rear_left_wheel_joint", "rear_right_wheel_joint"]


def write_drive(path, joints):
    """A bag with a battery, joints, and a speed beside them."""
    still = joint_states(joints, np.zeros((20, len(joints))))
    topics = {"/bms": (TYPE, payloads(20)), "/joints": (JOINTS, still), "/gnss/vel": (TWIST, twists(np.zeros(20)))}
    write_mcap(path, topics)


def test_the_driven_wheels_of_a_car_are_wired(folder, set_up):
    write_drive(folder / "car.mcap", CAR)
    found = set_up("car.mcap", *BATTERY, *SIZES, "--wheels", "2", status=0)
    assert written_source().joints == {"left": CAR[2], "right": CAR[3]}
    assert found["unused"] == [*CAR[:2], "/gnss/vel"]


def test_a_driven_wheel_that_no_source_sends_is_asked_for(folder, set_up):
    write_drive(folder / "car.mcap", ["axle_a", "axle_b", "arm"])
    words = ("car.mcap", *BATTERY, *SIZES, "--wheels", "2")
    asked = {question["example"]: question["text"] for question in set_up(*words, status=1)["asked"]}
    listing = "which one is it, 'axle_a', 'axle_b', 'arm'"
    assert asked == {
        f"wheel_speed_rad_s.{side}=NAME": f"no source sends the speed of the wheel '{side}': {listing}?"
        for side in ("left", "right")
    }
    answers = [("--signal", f"wheel_speed_rad_s.{side}={name}") for side, name in (("left", CAR[0]), ("right", CAR[1]))]
    write_drive(folder / "car.mcap", [*CAR[:2], "arm"])
    proposed = set_up(*words, status=1)["asked"]
    assert [(question["option"], question["example"]) for question in proposed] == answers
    set_up(*words, *(word for answer in answers for word in answer), status=0)
    assert written_source().joints == {"left": CAR[0], "right": CAR[1]}


def test_a_topic_with_a_speed_is_wired_only_where_it_is_named(folder, set_up):
    write_drive(folder / "car.mcap", CAR)
    words = ("car.mcap", *BATTERY, *SIZES, "--wheels", "2")
    assert any("--signal twist=/gnss/vel" in note for note in set_up(*words, status=0)["assumed"])
    assert written_source().twist == ""
    found = set_up(*words, "--signal", "twist=/gnss/vel", status=0)
    assert found["recognised"]["twist"] == written_source().twist == "/gnss/vel"
    assert "/gnss/vel" not in found["unused"]


def test_a_chosen_topic_of_joints_gives_the_joints(folder, set_up):
    topics = {f"/{name}": (JOINTS, joint_states([f"{name}_left", f"{name}_right"], np.zeros((20, 2)))) for name in "ab"}
    write_mcap(folder / "two.mcap", topics)
    set_up("two.mcap", *SIZES, "--signal", "joint_states=/b", "--signal", "wheel_speed_rad_s.left=b_left", status=1)
    assert written_source().joints["left"] == "b_left"


def test_messages_of_a_serial_line_are_heard_and_their_names_asked(set_up):
    ours, theirs = os.openpty()
    send = partial(os.write, ours)
    with sending(lambda k: send(encode(SerialFrame(1, k % 256, 1000 * k, (-4.0, 26.0))))):
        found = set_up(os.ttyname(theirs), *BATTERY, "--robot", "rlma", "--seconds", "2", status=1)
    assert [question["text"] for question in found["asked"]] == ["message 1 has 2 values: what are they, in order?"]
    names = "1=battery_current_A,battery_voltage_V"
    found = set_up(os.ttyname(theirs), *BATTERY, "--message", names, status=0)
    assert set(found["recognised"]) == {"battery_current_A", "battery_voltage_V"}


@pytest.mark.parametrize(
    ("line", "signals"),
    [
        ("I_mA={:.0f} U={:.3f}V\n", {"battery_current_A": ("I_mA", 1e-3), "battery_voltage_V": ("U [V]", 1.0)}),
        (
            "Bus voltage [V],I_mA\n{1:.3f},{0:.0f}\n",
            {"battery_current_A": ("2", 1e-3), "battery_voltage_V": ("1", 1.0)},
        ),
        (
            "I\t{0:.0f}\r\nV\t{2:.0f}\r\nSOC\t845\r\nChecksum\tx\r\n",
            {"battery_current_A": ("I", 1e-3), "battery_voltage_V": ("V", 1e-3), "bms_soc": ("SOC", 1e-3)},
        ),
    ],
)
def test_numbers_that_a_board_prints_are_recognised(set_up, line, signals):
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    printed = [line.format(-1000.0 * k, 26.0 - 0.01 * k, 26000.0 - 10.0 * k).encode() for k in range(5)]
    with sending(lambda k: os.write(ours, printed[k % 5])):
        set_up(os.ttyname(theirs), *BATTERY, "--current-sign", "charge", "--seconds", "2", status=0)
    (source,) = SETUP_FILE.load("robot.toml").source
    assert isinstance(source, SerialSource)
    wired = {
        s: (given, 1.0) if isinstance(given, str) else (given.name, given.scale) for s, given in source.signals.items()
    }
    assert wired == signals


def test_numbers_without_names_are_listed_with_their_ranges(refused, folder):
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    with sending(lambda k: os.write(ours, f"{k % 2},13.5\n".encode())):
        text = refused("setup", os.ttyname(theirs), *BATTERY, "--seconds", "2")
    assert "among 1 (0 to 1), 2 (13.5 to 13.5); wire some: --signal battery_current_A=NAME" in text


def test_what_was_there_is_kept_and_said(folder, capsys):
    (folder / "bus.dbc").write_text(database({"BMS": {"Pack_V": "V", "Pack_I": "A"}}))
    (folder / "robot.toml").write_text("# mine\n")
    assert main(["setup", "bus.dbc", *BATTERY, "--current-sign", "charge"]) == 0
    printed = capsys.readouterr().out
    assert "robot.toml: 2 signals recognised, 0 asked" in printed
    assert "robot.toml of before is robot.toml.bak" in printed
    assert (folder / "robot.toml.bak").read_text() == "# mine\n"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["nothing.mcap"], "'nothing.mcap' is neither a file nor another source; give a CAN database"),
        (["day.csv"], "day.csv is a recording neither of a CAN bus nor of ROS"),
        (["."], "What is in a log: ohmward doctor ."),
        (["can0"], "frames have no names without the database of the bus: --dbc robot.dbc"),
        (["bus.dbc"], "neither a battery nor a robot to estimate with"),
        (
            ["bus.dbc", *BATTERY, "--signal", "battery_current_A=Nothing"],
            "there is no 'Nothing'; there are",
        ),
        (["bus.dbc", *BATTERY, "--signal", "imu=/x"], "--signal imu=/x: there is no such topic of type sensor_msgs"),
        (["bus.dbc", *BATTERY, "--unit", "current=mV"], "--unit current=mV: no unit of the current"),
    ],
)
def test_what_cannot_be_is_refused_with_the_fix(bus_database, refused, words, message):
    Path("day.csv").write_text("time_s,voltage_V,current_A\n0,13,0\n")
    assert message in refused("setup", *words)


def test_keys_of_setup_are_all_listed(folder, set_up):
    (folder / "bus.dbc").write_text(database({"BMS": {"Pack_V": "V", "Pack_I": "A"}}))
    found = set_up("bus.dbc", *BATTERY, status=1)
    assert listed("setup") >= set(found) | set(found["asked"][0]) | set(found["signals"]["battery_current_A"])


def test_questions_are_answered_on_a_terminal(folder, monkeypatch, capsys):
    (folder / "bus.dbc").write_text(database({"BMS": {"Pack_V": "V", "Pack_I": "A"}}))
    answers = iter(["nmc", "12", "7", "discharge"])

    class Terminal:
        def isatty(self):
            return True

        def readline(self):
            return next(answers, "") + "\n"

    monkeypatch.setattr("sys.stdin", Terminal())
    began_s = time.monotonic()
    assert main(["setup", "bus.dbc"]) == 0
    assert time.monotonic() - began_s < 60.0
    source = written_source()
    assert source.signals["battery_current_A"].scale == -1.0
