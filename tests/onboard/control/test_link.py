"""Robot and operator over a real connection, the loop in its thread, drives on python-can's virtual bus."""

import asyncio
import gc
import json
import subprocess
import sys
import threading
import time
from contextlib import suppress
from dataclasses import replace
from itertools import count, pairwise
from pathlib import Path
from typing import Any

import can
import cantools
import pytest

from ohmward.errors import InputError, OhmwardError
from ohmward.onboard.control.drive_control import DriveControl
from ohmward.onboard.control.loop import ControlLoop
from ohmward.onboard.control.operator_command import SAFE_STOP_S, DriveLimits, OperatorCommand, Signing
from ohmward.onboard.control.operator_link import OperatorLink
from ohmward.onboard.control.outputs import CanOutput, MqttOutput, RosOutput
from ohmward.onboard.feed import Feed
from ohmward.onboard.line_reader import MOST_STRANGERS
from ohmward.onboard.message import Signals
from ohmward.onboard.robot_setup import Setup
from ohmward.onboard.ros import types
from ohmward.onboard.ros.cdr import serialize
from ohmward.onboard.ros.transport import RosNetwork
from ohmward.onboard.sinks.control import ControlSink
from ohmward.onboard.sinks.mqtt import MqttSink
from ohmward.onboard.sinks.server import InfluxSink
from ohmward.onboard.sources.mqtt import MqttSource
from ohmward.onboard.sources.simulation import SimulationSource
from ohmward.onboard.store.delivery import Spool
from ohmward.onboard.store.rows import Row
from ohmward.onboard.trial import try_setup
from ohmward.traction.robot.packaged import RLMA
from onboard.control.test_drive_control import state
from onboard.servers import free_port, mosquitto, wait_for_port

DBC = str(Path(__file__).parents[1] / "robot.dbc")
TORQUE: Signals = {"torque_Nm.front_left": "Torque.Left", "torque_Nm.front_right": "Torque.Right"}
SIGNALS: Signals = TORQUE | {"enable": "Torque.Enable", "counter": "Torque.Counter"}
OTHER_NODE = Path(__file__).parents[1] / "ros" / "other_node.py"
CHANNELS = count()
#: The machine of the tests may be busy with others: its scheduler may take so long besides, in one of a few tries.
BUSY_S, TRIES = 0.05, 5


class Drives:
    """Motor drives on the bus: every frame with the time at which it came."""

    def __init__(self, channel: str):
        self.bus = can.Bus(interface="virtual", channel=channel)
        self.frames: list[tuple[float, dict[str, Any]]] = []
        self._database: Any = cantools.database.load_file(DBC)
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def _listen(self) -> None:
        while not self._end.is_set():
            if message := self.bus.recv(0.1):
                found: Any = self._database.decode_message(message.arbitration_id, bytes(message.data))
                self.frames.append((time.monotonic(), found))

    def driving(self) -> bool:
        return bool(self.frames and self.frames[-1][1]["Enable"] == 1 and self.frames[-1][1]["Left"] > 0.0)

    def stopped_s(self, after_s: float) -> float:
        """Time after `after_s` of the first frame without enable and torque."""
        for at_s, frame in self.frames:
            if at_s >= after_s and (frame["Enable"], frame["Left"], frame["Right"]) == (0, 0, 0):
                return at_s - after_s
        return 1e9

    def close(self) -> None:
        self._end.set()
        self._thread.join()
        self.bus.shutdown()


@pytest.fixture
def rig():
    """The sink of a robot, and its drives."""
    channel = f"drives{next(CHANNELS)}"
    drives = Drives(channel)
    output = CanOutput(
        "virtual", channel, dbc=DBC, signals=TORQUE | {"enable": "Torque.Enable", "counter": "Torque.Counter"}
    )
    yield ControlSink("rlma", can=output, operator=f"127.0.0.1:{free_port()}"), drives
    drives.close()


@pytest.fixture
def patient_rig(rig, monkeypatch):
    """The same without time-outs that a busy machine reaches by itself: for what must not stop a robot."""
    monkeypatch.setattr("ohmward.onboard.control.drive_control.SAFE_STOP_S", 10.0)
    sink, drives = rig
    return replace(sink, limits=DriveLimits(estimate_timeout_s=1.0, operator_timeout_s=1.0)), drives


async def feed_states(feed, ended):
    while not ended.is_set():
        feed.put(state(time.monotonic()))
        await asyncio.sleep(0.01)


async def until(condition, within_s=60.0):
    end_s = time.monotonic() + within_s
    while not condition():
        assert time.monotonic() < end_s, "in vain"
        await asyncio.sleep(0.005)


async def cancelled(*tasks):
    for task in tasks:
        task.cancel()
        with suppress(asyncio.CancelledError, OhmwardError):
            await task


class Bench:
    """A robot under control and its operator, who drives."""

    def __init__(self, sink, token=""):
        self.feed, self.ended = Feed(), asyncio.Event()
        self.link = OperatorLink("127.0.0.1", int(sink.operator.rpartition(":")[2]), token)
        self.beats: list[dict[str, Any]] = []
        self.feeding = asyncio.create_task(feed_states(self.feed, self.ended))
        self.running = asyncio.create_task(sink.run(self.feed))
        self.operating: asyncio.Task[None] | None = None
        self.answers, self.hangs = asyncio.Event(), False
        self.answers.set()

    async def _operate(self) -> None:
        while not self.beats:
            with suppress(OhmwardError):  # frames of a robot that ran before may be on the bus before it listens
                await self._answer_beats()
            await asyncio.sleep(0.01)

    async def _answer_beats(self) -> None:
        async for beat in self.link.beats():
            self.beats.append(beat)
            self.hangs = not self.answers.is_set()
            await self.answers.wait()

    def _phase(self) -> str:
        return str(self.beats[-1]["phase"])

    async def drive(self, drives) -> None:
        """Arm and drive; again where the machine was busy and the robot stopped for it."""
        await until(lambda: drives.frames)
        self.operating = asyncio.create_task(self._operate())
        await until(lambda: self.beats)
        while not drives.driving():
            self.link.command = OperatorCommand()
            await until(lambda: self._phase() == "disarmed")
            self.link.command = OperatorCommand(armed=True)
            await until(lambda: self._phase() != "disarmed")
            self.link.command = OperatorCommand(armed=True, speed_m_s=0.3)
            await until(lambda: drives.driving() or self._phase() == "stopped")

    async def close(self) -> None:
        self.ended.set()
        self.feed.end()
        if self.operating:
            await cancelled(self.operating)
        await self.feeding
        with suppress(OhmwardError):
            await self.running


def stops_in_time(rig, act):
    """True where the drives stop in time in one of a few tries: a busy machine may be late, a wrong robot always is."""
    return any(stop_delay_s(rig, act) <= SAFE_STOP_S + BUSY_S for _ in range(TRIES))


def stop_delay_s(rig, act):
    """Drive, do `act(bench)`, which returns the time of the fault, and wait for the stop; its delay."""
    sink, drives = rig
    drives.frames.clear()

    async def run():
        bench = Bench(sink)
        try:
            await bench.drive(drives)
            fault_s = await act(bench)
            await until(lambda: drives.stopped_s(fault_s) < 1e9)
            return drives.stopped_s(fault_s)
        finally:
            await bench.close()

    gc.disable()
    try:
        return asyncio.run(run())
    finally:
        gc.enable()


async def estimates_end(bench):
    bench.ended.set()
    await asyncio.sleep(0)
    return time.monotonic()


async def operator_hangs(bench):
    """The connection stays, nothing comes: the operator's computer has frozen, or the radio is gone."""
    bench.answers.clear()
    await until(lambda: bench.hangs)
    return time.monotonic()


async def operator_leaves(bench):
    fault_s = time.monotonic()
    await cancelled(bench.operating)
    return fault_s


async def operator_stops(bench):
    bench.link.command = OperatorCommand()
    return time.monotonic()


async def loop_of_process_hangs(bench):
    """The whole process but the controller's thread is held up."""
    fault_s = time.monotonic()
    time.sleep(0.3)
    return fault_s


@pytest.mark.parametrize(
    "act",
    [estimates_end, operator_hangs, operator_leaves, operator_stops, loop_of_process_hangs],
    ids=lambda a: a.__name__,
)
def test_the_drives_are_told_to_stop_within_100_ms(rig, act):
    assert stops_in_time(rig, act)


def test_an_exception_of_the_controller_stops_the_drives(rig, monkeypatch):
    async def act(bench):
        monkeypatch.setattr("ohmward.onboard.control.wheel_control.WheelControl.step", lambda *_: 1 / 0)
        return time.monotonic()

    assert stop_delay_s(rig, act) < 1e9


def test_the_end_of_the_process_is_a_stop(rig):
    async def act(bench):
        bench.ended.set()
        fault_s = time.monotonic()
        bench.feed.end()
        return fault_s

    assert stops_in_time(rig, act)


def test_heartbeats_count_up_at_the_rate_of_the_loop(rig):
    async def act(bench):
        await until(lambda: len(rig[1].frames) > 50)
        bench.link.command = OperatorCommand()
        return time.monotonic()

    stop_delay_s(rig, act)
    counters = [frame["Counter"] for _, frame in rig[1].frames]
    assert all((after - before) % 256 == 1 for before, after in pairwise(counters))


def test_answers_that_were_held_up_are_no_heartbeat():
    """A burst of old answers is as old as the beats that they answer."""
    control = DriveControl(RLMA, DriveLimits())
    old = OperatorCommand(armed=True, given_s=1.0)
    assert control.step(1.2, state(1.2), old).reason == "nothing from the operator for 200 ms"


def test_a_second_operator_does_not_drive_but_may_stop(patient_rig):
    async def act(bench):
        other = OperatorLink("127.0.0.1", bench.link.port)
        other.command = OperatorCommand(armed=True, speed_m_s=-0.3)
        beats = other.beats()
        for _ in range(20):
            beat = await anext(beats)
        assert beat["driver"] is False and beat["phase"] == "armed"
        other.stop = True
        fault_s = time.monotonic()
        async for beat in beats:
            if beat["reason"] == "stopped by an operator":
                break
        await beats.aclose()
        return fault_s

    assert stops_in_time(patient_rig, act)


def test_another_token_is_refused_on_both_sides(rig, monkeypatch):
    sink, drives = rig
    monkeypatch.setenv("DRIVE_TOKEN", "right-one")
    sink = ControlSink("rlma", can=sink.can, operator=sink.operator, token="DRIVE_TOKEN")

    async def run():
        wrong = Bench(sink, "wrong-one")
        with pytest.raises(OhmwardError, match="another token") as found:
            await until(lambda: drives.frames)
            async for _ in wrong.link.beats():
                pass
        assert "wrong-one" not in str(found.value) and "right-one" not in str(found.value)
        await wrong.close()
        drives.frames.clear()
        right = Bench(sink, "right-one")
        await right.drive(drives)
        await right.close()

    asyncio.run(run())


def test_a_line_of_another_sender_connection_or_time_is_refused():
    robot, operator = (Signing("token", "nonce", "operator") for _ in range(2))
    line = operator.line({"armed": True})
    assert robot.read(line) == {"armed": True, "n": 1}
    assert robot.read(line) is None  # again
    assert robot.read(operator.line({"x": 1}).replace(b"1", b"2")) is None  # changed
    for other in (("other", "nonce", "operator"), ("token", "later", "operator"), ("token", "nonce", "robot")):
        assert Signing(*other).read(operator.line({})) is None
    for junk in (b"", b"\n", b"x" * 5000, b"\xff\xfe \x00\n"):
        assert robot.read(junk) is None


def test_a_bus_that_takes_no_frame_is_a_stop_and_then_an_error():
    def send(numbers):
        raise OSError("no buffer space")

    loop = ControlLoop(DriveControl(RLMA, DriveLimits()), 0.01)
    loop.drive(send)
    loop.join(5.0)
    with pytest.raises(OhmwardError, match=r"the drives take no command \(no buffer space\)"):
        loop.check()
    assert loop.control.reason.startswith("the drives take no command")


def test_the_check_sends_nothing_to_the_drives(rig):
    sink, drives = rig
    trial = try_setup(Setup(robot="rlma", source=(SimulationSource(),), sink=(sink,)), 1.5)
    assert drives.frames == []
    assert [found.message for found in trial.findings if found.name == "sink control"] == ["running"]


def test_the_check_publishes_nothing(tmp_path):
    """A status of the check would take the place of that of the process that runs."""
    with mosquitto(tmp_path) as broker:
        sinks = (
            MqttSink(port=broker.port, topic="robot"),
            ControlSink("rlma", mqtt=MqttOutput(port=broker.port, topic="drives"), operator=f"127.0.0.1:{free_port()}"),
        )

        async def published():
            async with MqttSource(host="127.0.0.1", port=broker.port, topics=("#",)).connected() as (client, received):
                client.subscribe("#")
                setup = Setup(robot="rlma", source=(SimulationSource(),), sink=sinks)
                trial = await asyncio.to_thread(try_setup, setup, 1.5)
                with pytest.raises(TimeoutError):
                    await asyncio.wait_for(received.take(), 0.3)
                return trial

        trial = asyncio.run(published())
    assert {f.message for f in trial.findings if f.name in ("sink mqtt", "sink control")} == {"running"}


def test_the_check_leaves_rows_that_wait_for_a_server(tmp_path, monkeypatch):
    sent: list[Any] = []
    monkeypatch.setattr("ohmward.onboard.sinks.server.write_lines", lambda *request: sent.append(request))
    spool = Spool(tmp_path / "spool", 10)
    spool.put([Row("battery", 1, {"soc": 0.5})])
    spool.close()
    sink = InfluxSink("http://127.0.0.1:1/write?db=robots", spool=str(tmp_path / "spool"))
    try_setup(Setup(robot="rlma", source=(SimulationSource(),), sink=(sink,)), 1.5)
    assert sent == []


@pytest.mark.parametrize("same_port", [True, False])
def test_a_second_process_sends_no_frame(patient_rig, monkeypatch, same_port):
    """Neither one that finds the operator's port taken, nor one that hears the first on the bus."""
    sink, drives = patient_rig
    second = sink if same_port else replace(sink, operator=f"127.0.0.1:{free_port()}")

    async def run():
        bench = Bench(sink)
        await bench.drive(drives)
        monkeypatch.setattr("ohmward.onboard.control.outputs.LISTEN_S", 5.0)
        before = len(drives.frames)
        with pytest.raises(OhmwardError, match="cannot be listened at" if same_port else "somebody else sends Torque"):
            await asyncio.wait_for(second.run(Feed()), 60.0)
        assert bench.beats[-1]["phase"] == "armed"
        await bench.close()
        return before

    before = asyncio.run(run())
    counters = [frame["Counter"] for _, frame in drives.frames]
    assert len(counters) > before
    assert all((after - before) % 256 == 1 for before, after in pairwise(counters))


async def strangers(port, number):
    """Connections that say nothing."""
    return [await asyncio.open_connection("127.0.0.1", port) for _ in range(number)]


def handles():
    """File handles of this process."""
    return len(list(Path("/proc/self/fd").iterdir()))


def test_strangers_hear_nothing_of_the_robot_and_go_soon(rig, monkeypatch):
    """No beat before the first signed line, which must come in time."""
    monkeypatch.setattr("ohmward.onboard.control.operator_link.FIRST_LINE_S", 0.5)
    sink, drives = rig

    async def run():
        bench = Bench(sink)
        await bench.drive(drives)
        ((reader, writer),) = await strangers(bench.link.port, 1)
        heard = await asyncio.wait_for(reader.read(), 60.0)
        writer.close()
        await bench.close()
        return heard

    hello, _, more = asyncio.run(run()).partition(b"\n")
    assert hello.startswith(b"ohmward-drive/1 ") and more == b""


def test_any_number_of_strangers_leaves_room_for_the_operator(rig, monkeypatch, caplog):
    sink, drives = rig
    monkeypatch.setenv("DRIVE_TOKEN", "right-one")
    sink = replace(sink, token="DRIVE_TOKEN")
    open_before = handles()

    async def run():
        bench = Bench(sink, "right-one")
        await until(lambda: drives.frames)
        crowd = await strangers(bench.link.port, 300)
        await asyncio.sleep(0.3)
        served = handles() - open_before - len(crowd)
        await bench.drive(drives)
        await bench.close()
        for _, writer in crowd:
            writer.close()
        return served

    assert asyncio.run(run()) < MOST_STRANGERS + 20
    assert len([record for record in caplog.records if "connection" in record.message]) < 20


def test_settings_are_checked(rig):
    output = rig[0].can
    refused: list[tuple[dict[str, Any], str]] = [
        ({}, r"give one way to the drives: \[sink.can\], \[sink.ros\], \[sink.mqtt\] or \[sink.simulation\]"),
        ({"can": output, "operator": "0.0.0.0:4720"}, "can be reached from other machines; give a token"),
        ({"can": output, "operator": "nowhere"}, "operator must be HOST:PORT"),
        ({"can": output, "step_s": 0.5}, "step_s must be between"),
    ]
    for settings, message in refused:
        with pytest.raises(InputError, match=message):
            ControlSink("rlma", **settings)
    with pytest.raises(InputError, match='no "enable"'):
        CanOutput(dbc=DBC, signals=dict(TORQUE))
    wrong = CanOutput("virtual", "x", dbc=DBC, signals={"torque_Nm.nose": "Torque.Left", "enable": "Torque.Enable"})
    with pytest.raises(InputError, match=r"'torque_Nm.nose' is no number for the drives; there are: .*front_left"):
        asyncio.run(ControlSink("rlma", can=wrong).run(Feed()))


def test_torques_go_to_ros_as_arrays_and_to_mqtt_as_objects(tmp_path):
    """The same numbers by zenoh as rmw_zenoh carries them and by a real broker; zeros while nothing is armed."""
    port, numbers = free_port(), {"enable": 1.0, "counter": 3.0, "torque_Nm.left": 1.5, "torque_Nm.right": -2.0}
    router = subprocess.Popen([sys.executable, str(OTHER_NODE), "router", str(port)], stdout=subprocess.PIPE)
    wait_for_port(port)

    async def by_ros():
        got: list[bytes] = []
        network = RosNetwork(transport="zenoh", router=f"tcp/127.0.0.1:{port}", node="drives")
        listener = await asyncio.to_thread(network.open)
        listener.subscribe("/wheels/commands", types.FLOATS, lambda payload, _: got.append(payload))
        output = RosOutput("zenoh", router=network.router, topic="/wheels/commands", joints=("right", "left"))
        async with output.opened(list(numbers)) as send:
            end_s = time.monotonic() + 60.0
            while not got and time.monotonic() < end_s:
                send(numbers)
                await asyncio.sleep(0.02)
        await asyncio.to_thread(listener.close)
        return got[0]

    async def by_mqtt(broker):
        got: list[Any] = []
        drives = MqttSource(host="127.0.0.1", port=broker.port, topics=("drives",))
        async with drives.connected() as (listener, received):
            listener.subscribe("drives")
            async with MqttOutput("127.0.0.1", broker.port, topic="drives").opened(list(numbers)) as send:
                await asyncio.sleep(0.3)
                send(numbers)
                got += await received.take()
        return json.loads(got[0].payload)

    try:
        payload = asyncio.run(by_ros())
    finally:
        router.kill()
        router.wait()
    assert payload == serialize(types.FLOATS, {"layout": {"dim": [], "data_offset": 0}, "data": [-2.0, 1.5]})
    with mosquitto(tmp_path) as broker:
        assert asyncio.run(by_mqtt(broker)) == numbers


def test_a_joint_that_the_robot_does_not_have_is_named():
    output = RosOutput("zenoh", joints=("nose",))

    async def opened():
        async with output.opened(["torque_Nm.left"]):
            pass

    with pytest.raises(InputError, match=r"ros.joints: 'torque_Nm.nose' is no wheel; there are: torque_Nm.left"):
        asyncio.run(opened())
