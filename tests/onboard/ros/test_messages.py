"""Messages against rosbags: the same bytes, types, hashes; signs and conditions of the conventions."""

import asyncio
import math
from contextlib import suppress
from functools import cache

import numpy as np
import pytest

from ohmward.battery.chemistries import generic_battery
from ohmward.battery.file import save_battery
from ohmward.battery.soc.sample import SocEstimate
from ohmward.energy.points import Quantiles
from ohmward.energy.range_step import RangeEstimate
from ohmward.onboard.feed import Feed
from ohmward.onboard.robot_state import Diagnostic, Level, RobotState
from ohmward.onboard.ros import messages, types
from ohmward.onboard.ros.cdr import read, serialize
from ohmward.onboard.sinks.ros2 import Ros2Sink, Translation
from ohmward.optional import require
from ohmward.traction import RLMA
from ohmward.traction.odometry.estimator import Odometry
from ohmward.traction.speed_observer.estimator import SlipEstimator

typesys = pytest.importorskip("rosbags.typesys")
STORES = [name for name in typesys.Stores if name.value.startswith("ros2") or name.value == "latest"]
STORE = typesys.get_typestore(typesys.Stores.LATEST)


def charge(soc: float = 0.5, offset_A: float = 0.0) -> SocEstimate:
    return SocEstimate(soc, 0.02, 13.2, 0.01, 0.0, offset_A, 0.01, 0.9, 0.03, 1.2, 0.1, 0)


def at(time_s: float, state: RobotState) -> RobotState:
    """The state at another time, with evidence 0.1 s old; dates are seconds after 1.7e9."""
    old_s = time_s - 0.1
    aged = state._replace(battery_time_s=old_s, drive_time_s=old_s)
    return aged._replace(time_s=time_s, unix_s=1.7e9 + time_s, battery_unix_s=1.7e9 + old_s, drive_unix_s=1.7e9 + old_s)


@cache
def driven() -> RobotState:
    """A robot after a second of driving and turning."""
    slip, odometry = SlipEstimator(RLMA), Odometry(RLMA)
    speeds = np.full(len(RLMA.places), 4.0)
    for k in range(50):
        found = slip.update(0.02 * k, speeds, np.full(RLMA.driven, 1.0), yaw_rate_rad_s=0.4)
        pose = odometry.update(0.02 * k, speeds, 0.4, observed=found)
    told = (Diagnostic("source can0", Level.WARN, "no message for 2 s", {"silent_s": 2.0, "bus": "can0"}),)
    sample = {"battery_voltage_V": 13.2, "battery_current_A": -3.0, "cell_voltage_V.1": 3.31}
    return at(5.0, RobotState(5.0, 1.7e9, sample, charge(), None, found, pose, None, told))


def of_rosbags(type_: str, message: dict):
    """The message as an object of rosbags."""
    fields = {}
    for name, (kind, detail) in STORE.fielddefs[type_][1]:
        value = message[name]
        if kind.name == "NAME":
            fields[name] = of_rosbags(detail, value)
        elif kind.name in ("ARRAY", "SEQUENCE"):
            item_kind, item = detail[0]
            if item_kind.name == "NAME":
                fields[name] = [of_rosbags(item, one) for one in value]
            else:
                fields[name] = value if item[0] == "string" else np.array(value, item[0])
        else:
            fields[name] = value
    return STORE.types[type_](**fields)


def every_message() -> dict[str, dict]:
    state, battery = driven(), generic_battery("lfp", 12.0, 4, "test")
    return {
        types.BATTERY_STATE: messages.battery_state(state, state.sample, battery, "base_link"),
        types.ODOMETRY: messages.odometry(state, "odom", "base_link"),
        types.TWIST: messages.twist(state, "base_link"),
        types.DIAGNOSTICS: messages.diagnostics(state, "robot 1", state.unix_s),
        types.TF: messages.transform(state, "odom", "base_link"),
        types.JOINT_STATE: {
            "header": messages.header(1.7e9, ""), "name": ["left_wheel", "r"], "position": [], "velocity": [1.0, 2.0],
            "effort": [],
        },
    }  # fmt: skip


@pytest.mark.parametrize("type_", every_message())
def test_the_bytes_are_those_of_rosbags(type_):
    message = every_message()[type_]
    assert serialize(type_, message) == bytes(STORE.serialize_cdr(of_rosbags(type_, message), type_))


@pytest.mark.parametrize("store", STORES)
@pytest.mark.parametrize("type_", types.HASHES)
def test_types_and_hashes_are_those_of_every_distribution(type_, store):
    found = typesys.get_typestore(store)
    assert found.hash_rihs01(type_) == types.HASHES[type_]
    assert [name for name, _ in found.fielddefs[type_][1]] == [name for name, _ in types.DEFINITIONS[type_]]


def test_numbers_are_read_back():
    message = every_message()[types.JOINT_STATE]
    layout, numbers = read(types.JOINT_STATE, serialize(types.JOINT_STATE, message))
    assert [numbers["velocity[0]"], numbers["velocity[1]"]] == [1.0, 2.0]
    assert [layout.texts["name[0]"], layout.texts["name[1]"]] == ["left_wheel", "r"]
    assert numbers["header.stamp.sec"] == 1_700_000_000


def test_cut_and_damaged_messages_are_refused_with_one_error():
    whole = serialize(types.BATTERY_STATE, every_message()[types.BATTERY_STATE])
    for cut in range(len(whole)):
        with pytest.raises(ValueError):
            read(types.BATTERY_STATE, whole[:cut])
    rng = np.random.default_rng(1)
    for _ in range(2000):
        damaged = bytearray(whole)
        for at in rng.integers(0, len(whole), 3):
            damaged[at] = rng.integers(256)
        with suppress(ValueError):
            read(types.BATTERY_STATE, bytes(damaged))


@pytest.mark.parametrize(
    ("current_A", "full", "offset_A", "status"),
    [
        *((-3.0, 0.0, 0.0, 2), (3.0, 0.0, 0.0, 1), (0.05, 0.0, 0.0, 3)),
        *((0.5, 0.0, 0.48, 3), (1.0, 1.0, 0.0, 4), (math.nan, 0.0, 0.0, 0)),
        *((-3.0, 1.0, 0.0, 2), (math.nan, 1.0, 0.0, 4)),
    ],
)
def test_the_status_follows_current_offset_and_charger(current_A, full, offset_A, status):
    state = driven()._replace(battery=charge(0.5, offset_A))
    measured = {"battery_current_A": current_A, "battery_full": full}
    found = messages.battery_state(state, measured, generic_battery("lfp", 12.0, 4, "test"), "base_link")
    assert found["power_supply_status"] == status


def sent(translation: Translation, state: RobotState) -> dict[str, dict[str, float]]:
    """Numbers of the messages about a state, by type."""
    return {type_: read(type_, payload)[1] for _, type_, payload in translation.messages(state)}


def test_a_battery_that_is_silent_is_unknown(tmp_path):
    """Its voltage falls silent first, then everything, and it comes back."""
    save_battery(generic_battery("lfp", 12.0, 4, "test"), tmp_path / "battery.toml")
    translation, state = Translation(Ros2Sink(battery=str(tmp_path / "battery.toml"))), driven()
    silent = [Diagnostic(name, Level.STALE, "silent") for name in ("battery_voltage_V", *state.sample)]
    half = sent(translation, at(5.0, state)._replace(diagnostics=tuple(silent[:1])))[types.BATTERY_STATE]
    assert math.isnan(half["voltage"]) and half["current"] == pytest.approx(-3.0)
    assert (half["percentage"], half["present"], half["power_supply_status"]) == (0.5, 1.0, 2.0)
    dead = at(12.0, state)._replace(sample={}, silent=("battery",), diagnostics=tuple(silent))
    none = sent(translation, dead)[types.BATTERY_STATE]
    assert all(math.isnan(none[name]) for name in ("voltage", "current", "percentage", "charge", "cell_voltage[1]"))
    assert (none["present"], none["power_supply_status"]) == (0.0, 0.0)
    back = sent(translation, at(13.0, state))[types.BATTERY_STATE]
    assert back["voltage"] == pytest.approx(13.2) and back["present"] == 1.0


def test_a_battery_that_is_silent_has_no_sensors_even_before_they_are_looked_at():
    """Their conditions are a look behind; the thermometer of another device goes on."""
    translation, state = Translation(Ros2Sink()), driven()
    sample = {**state.sample, "battery_full": 1.0, "battery_temperature_degC": 21.0}
    assert sent(translation, state._replace(sample=sample))[types.BATTERY_STATE]["present"] == 1.0
    dead = at(12.0, state)._replace(sample={}, silent=("battery",))
    none = sent(translation, dead)[types.BATTERY_STATE]
    assert all(math.isnan(none[name]) for name in ("voltage", "current", "percentage"))
    assert (none["present"], none["power_supply_status"], none["temperature"]) == (0.0, 0.0, 21.0)


@pytest.mark.parametrize(
    ("soc", "std", "silent", "percentage"),
    [(0.5, 0.1, False, 0.304), (0.5, 0.1, True, 0.304), (0.1, 0.2, False, 0.0), (None, 0.0, True, 0.0)],
)
def test_a_cautious_percentage_is_the_low_end_of_the_band_and_never_nan_for_silence(soc, std, silent, percentage):
    known = None if soc is None else charge(soc)._replace(soc_std=std)
    state = driven()._replace(battery=known, silent=("battery",) if silent else ())
    found = sent(Translation(Ros2Sink(percentage="low")), state)[types.BATTERY_STATE]
    assert found["percentage"] == pytest.approx(percentage, abs=1e-3)


@pytest.mark.parametrize(
    ("probability", "silent", "percentage"), [(0.97, (), 0.97), (math.nan, (), math.nan), (0.97, ("battery",), 0.0)]
)
def test_home_is_a_battery_that_is_low_where_the_robot_must_turn(probability, silent, percentage):
    nothing = Quantiles(1.0, 1.0, 1.0)
    reach = RangeEstimate(nothing, nothing, nothing, nothing, probability, 9.0, 0)
    state = driven()._replace(range=reach, silent=silent)
    found = sent(Translation(Ros2Sink(battery_state="", home="ohmward/home")), state)[types.BATTERY_STATE]
    assert found["percentage"] == pytest.approx(percentage, nan_ok=True) and found["design_capacity"] != 0.0


def test_a_charger_that_said_full_once_is_not_believed_after_a_discharge():
    translation, state = Translation(Ros2Sink()), driven()
    currents = [(1.0, {"battery_full": 1.0}, 4.0), (0.5, {}, 4.0), (-3.0, {}, 2.0), (0.5, {}, 1.0)]
    for k, (current_A, more, status) in enumerate(currents):
        sample = {"battery_current_A": current_A} | more
        found = sent(translation, at(5.0 + k, state)._replace(sample=sample))
        assert found[types.BATTERY_STATE]["power_supply_status"] == status


def test_a_drive_that_is_silent_sends_no_pose_and_says_so():
    dead = at(9.0, driven())._replace(slip=None, pose=None, silent=("battery", "drive"))
    assert not sent(Translation(Ros2Sink()), dead).keys() & {types.ODOMETRY, types.TWIST}
    status = {one["name"]: one for one in messages.diagnostics(dead, "robot 1", dead.unix_s)["status"]}
    for name, sensors, known in (("drive", "wheels", "unknown: "), ("charge", "battery", "50 ± 4 %: ")):
        assert status[f"ohmward: {name}"]["level"] == Level.STALE
        assert f"{known}the sensors of the {sensors} are silent" in status[f"ohmward: {name}"]["message"]


def test_what_is_not_known_is_nan_and_the_share_is_one_of_one():
    bare = messages.battery_state(RobotState(1.0, 1.0), {}, None, "base_link")
    unknown = ("voltage", "temperature", "current", "charge", "capacity", "design_capacity", "percentage")
    assert all(math.isnan(bare[name]) for name in unknown)
    state = driven()
    known = messages.battery_state(state, state.sample, generic_battery("lfp", 12.0, 4, "test"), "base_link")
    assert known["percentage"] == 0.5
    assert known["capacity"] == pytest.approx(0.9 * 12.0)
    assert known["charge"] == pytest.approx(0.5 * 0.9 * 12.0)
    assert math.isnan(known["cell_voltage"][0]) and known["cell_voltage"][1] == 3.31 and len(known["cell_voltage"]) == 4
    assert known["power_supply_technology"] == 4


def test_odometry_has_its_pose_and_covariance_in_their_places():
    state = driven()
    message = messages.odometry(state, "odom", "base_footprint")
    assert (message["header"]["frame_id"], message["child_frame_id"]) == ("odom", "base_footprint")
    assert state.pose is not None
    q, covariance = message["pose"]["pose"]["orientation"], np.reshape(message["pose"]["covariance"], (6, 6))
    assert 2 * math.atan2(q["z"], q["w"]) == pytest.approx(state.pose.yaw_rad)
    np.testing.assert_allclose(covariance[np.ix_((0, 1, 5), (0, 1, 5))], state.pose.pose_cov)
    assert np.linalg.eigvalsh(covariance).min() >= -1e-9


def test_diagnostics_name_what_is_wrong():
    status = {one["name"]: one for one in messages.diagnostics(driven(), "robot 1", 1.7e9)["status"]}
    assert set(status) == {"ohmward: charge", "ohmward: drive", "ohmward: source can0"}
    assert status["ohmward: source can0"]["level"] == 1
    assert status["ohmward: charge"]["hardware_id"] == "robot 1"
    assert {"key": "soc_std", "value": "0.02"} in status["ohmward: charge"]["values"]


def test_the_transform_is_the_pose_where_it_is_asked_for():
    state = at(5.0, driven())
    assert types.TF not in sent(Translation(Ros2Sink()), state)
    found = sent(Translation(Ros2Sink(publish_tf=True)), state)[types.TF]
    assert state.pose is not None
    assert found["transforms[0].transform.translation.x"] == pytest.approx(state.pose.x_m)
    yaw_rad = 2 * math.atan2(found["transforms[0].transform.rotation.z"], found["transforms[0].transform.rotation.w"])
    assert yaw_rad == pytest.approx(state.pose.yaw_rad)
    assert dict(Ros2Sink(publish_tf=True).advertised())["/tf"] == types.TF


def test_after_a_restart_there_is_no_battery_state_before_its_first_sample():
    """A bag in a loop: what was measured before is not sent again, without a date."""
    translation = Translation(Ros2Sink(interval_s=0.0, slow_s=0.0))
    assert types.BATTERY_STATE in sent(translation, at(50.0, driven()))
    again = driven()._replace(restarts=1)
    nothing = at(1.0, again)._replace(battery_time_s=math.nan, battery_unix_s=math.nan, battery=None, sample={})
    assert types.BATTERY_STATE not in sent(translation, nothing)
    assert types.BATTERY_STATE in sent(translation, at(2.0, again))


def test_dates_are_those_of_the_samples_and_never_go_back():
    """States of a battery and of a drive, whose evidence is older than the state and than that of the state before."""
    translation, dates = Translation(Ros2Sink(interval_s=0.0, slow_s=0.0)), []
    for time_s, drive_s in ((5.0, 4.9), (5.1, 4.9), (5.2, 4.8), (5.3, 5.25)):
        state = at(time_s, driven())._replace(drive_time_s=drive_s, drive_unix_s=1.7e9 + drive_s)
        if (found := sent(translation, state)).get(types.ODOMETRY):
            dates.append(
                1e-9 * found[types.ODOMETRY]["header.stamp.nanosec"] + found[types.ODOMETRY]["header.stamp.sec"]
            )
    assert np.array(dates) - 1.7e9 == pytest.approx([4.9, 5.25], abs=1e-6)


class Recorder:
    """A transport that records the stamps on each topic, seconds after 1.7e9."""

    def __init__(self):
        self.stamps: dict[str, list[float]] = {}

    def advertise(self, topic, type_):
        self.stamps[topic] = []

    def check(self):
        pass

    def publish(self, topic, type_, payload):
        numbers = read(type_, payload)[1]
        path = "transforms[0].header.stamp" if type_ == types.TF else "header.stamp"
        self.stamps[topic].append(round(numbers[f"{path}.sec"] - 1.7e9 + 1e-9 * numbers[f"{path}.nanosec"], 3))


def stamps_of(
    *states: RobotState, recorder: Recorder | None = None, feed: Feed | None = None
) -> dict[str, list[float]]:
    """Stamps on each topic of the node of ROS while these states come."""
    recorder, feed = recorder or Recorder(), feed or Feed()

    async def run() -> None:
        sink = Ros2Sink(interval_s=0.0, publish_tf=True)
        task = asyncio.create_task(sink.run_on(recorder, feed))  # type: ignore[arg-type]
        for state in states:
            feed.put(state)
            await asyncio.sleep(0.02)
        feed.end()
        await task

    asyncio.run(run())
    return recorder.stamps


class WithoutTransforms(Recorder):
    """A transport on a computer without the package of /tf."""

    def advertise(self, topic, type_):
        if type_ == types.TF:
            require("no_such_package_of_messages", "rclpy")
        super().advertise(topic, type_)


def test_without_the_package_of_a_message_the_others_are_sent():
    feed = Feed()
    found = stamps_of(at(5.0, driven()), recorder=WithoutTransforms(), feed=feed)
    assert found["ohmward/odometry"] and "/tf" not in found
    assert feed.trouble.startswith("/tf is not sent: rclpy needs no_such_package_of_messages, which is not installed")


def test_conditions_of_robots_in_namespaces_have_different_names():
    names = [
        one["name"]
        for namespace in ("", "/r1", "r2/")
        for one in messages.diagnostics(driven(), "", 1.7e9, Ros2Sink(namespace=namespace).full_name)["status"][:1]
    ]
    assert names == ["ohmward: charge", "/r1/ohmward: charge", "/r2/ohmward: charge"]


def silent_at(time_s: float) -> RobotState:
    """A state without news: the battery has reported once, the drive never."""
    state = at(time_s, driven())
    state = state._replace(slip=None, pose=None, drive_time_s=math.nan, drive_unix_s=math.nan)
    return state._replace(silent=("battery",), battery_time_s=1.0, battery_unix_s=1.7e9 + 1.0)


def test_no_stamp_goes_back_when_queued_messages_come_after_states_without_news():
    """Silence until 101 s, then what was measured from 90 to 99.5 s at once, then news."""
    queue = [at(90.0 + 0.5 * k, driven()) for k in range(20)]
    found = stamps_of(at(1.1, driven()), silent_at(100.0), silent_at(101.0), *queue, at(102.0, driven()))
    assert found.pop("/diagnostics") == [1.1, 100.0, 101.0, *[101.0] * 20, 102.0]
    assert found.pop("battery_state") == [1.0, 100.0, 101.0, 101.9]
    assert found.keys() == {"ohmward/odometry", "ohmward/twist", "/tf"}
    for stamps in found.values():
        assert stamps == [1.0, *[89.9 + 0.5 * k for k in range(20)], 101.9]


@pytest.mark.parametrize("restarts", [0, 1])
def test_stamps_go_back_only_where_everything_restarts(restarts):
    """A bag in a loop; otherwise the second time is late."""
    states = [at(float(k), driven()) for k in (1, 2, 3)]
    found = stamps_of(*states, *(state._replace(restarts=restarts) for state in states))
    again = [0.9, 1.9, 2.9] * restarts
    assert found["ohmward/odometry"] == found["battery_state"] == [0.9, 1.9, 2.9, *again]
    assert found["/diagnostics"] == [1.0, 2.0, 3.0, *([1.0, 2.0, 3.0] if restarts else [3.0] * 3)]


def test_stamps_follow_a_clock_that_was_set_back():
    """Later states with dates an hour earlier."""
    later = at(5.0, driven())
    dates = {name: getattr(later, name) - 3600.0 for name in ("unix_s", "battery_unix_s", "drive_unix_s")}
    found = stamps_of(at(1.0, driven()), later._replace(**dates))
    assert found["/diagnostics"] == [1.0, 5.0 - 3600.0]
    assert found["battery_state"] == found["/tf"] == [0.9, 4.9 - 3600.0]
