"""CAN on python-can's virtual bus, decoded by a real database."""

import asyncio
import math
import random
import subprocess
import tomllib
from contextlib import suppress
from itertools import count
from pathlib import Path

import can
import cantools
import pytest

from ohmward import generic_battery
from ohmward.errors import InputError, OhmwardError
from ohmward.onboard.can_bus import CanDatabase, CanDecoder, CanEncoder
from ohmward.onboard.estimation import Estimation
from ohmward.onboard.feed import Feed
from ohmward.onboard.message import Message, ScaledSignal, Signals, Wiring
from ohmward.onboard.process import Process
from ohmward.onboard.robot_state import Level, RobotState
from ohmward.onboard.sinks.can import CanSink
from ohmward.onboard.sources.can import CanSource

DBC = str(Path(__file__).parent / "robot.dbc")
BMS: Signals = {
    "battery_current_A": "BMS.Current",
    "battery_voltage_V": "BMS.Voltage",
    "battery_temperature_degC": "BMS.Temperature",
}
NUMBERS = count()


@pytest.fixture
def channel():
    return f"test{next(NUMBERS)}"


@pytest.fixture(scope="module")
def database():
    return cantools.database.load_file(DBC)


def frame(database, name, **signals):
    message = database.get_message_by_name(name)
    return can.Message(
        arbitration_id=message.frame_id, is_extended_id=message.is_extended_frame, data=message.encode(signals)
    )


async def while_running(source, put, act):
    task = asyncio.create_task(source.run(put))
    await asyncio.sleep(0.3)
    try:
        await act()
        await asyncio.sleep(0.3)
    finally:
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task


def test_frames_become_messages(database, channel):
    got: list[Message] = []

    async def act():
        with can.Bus(interface="virtual", channel=channel) as bus:
            bus.send(frame(database, "BMS", Current=-3.21, Voltage=25.125, Temperature=-7, Cell=3300))
            bus.send(frame(database, "Wheels", Left=1, Right=1, LeftCurrent=0, RightCurrent=0))  # not wired
            bus.send(can.Message(arbitration_id=256, is_extended_id=True, data=bytes(8)))  # another identifier
            bus.send(can.Message(arbitration_id=256, is_extended_id=False, is_remote_frame=True, dlc=8))
            bus.send(can.Message(arbitration_id=256, is_extended_id=False, data=b"\1\2"))  # cut off

    source = CanSource(dbc=DBC, interface="virtual", channel=channel, signals=BMS)
    asyncio.run(while_running(source, got.append, act))
    (message,) = got
    assert message.values == pytest.approx(
        {"battery_current_A": -3.21, "battery_voltage_V": 25.125, "battery_temperature_degC": -7.0}
    )
    assert message.source == "can" and math.isfinite(message.stamp_s)


def test_multiplexed_signals_come_one_page_at_a_time(database):
    decoder = CanDecoder(
        CanDatabase(DBC), Wiring({"cell_voltage_V.0": "Multi.CellA", "cell_voltage_V.1": "Multi.CellB"})
    )
    message = database.get_message_by_name("Multi")
    assert decoder.values(300, False, message.encode({"Page": 0, "CellA": 3.3})) == {
        "cell_voltage_V.0": pytest.approx(3.3)
    }
    assert decoder.values(300, False, message.encode({"Page": 1, "CellB": 3.4})) == {
        "cell_voltage_V.1": pytest.approx(3.4)
    }
    assert decoder.values(300, False, b"\7\0\0\0") is None


def test_bits_of_any_kind_are_no_fault():
    """Random identifiers and data: never an exception, and numbers or nothing."""
    decoder = CanDecoder(CanDatabase(DBC), Wiring(BMS | {"cell_voltage_V.0": "Multi.CellA"}))
    random.seed(1)
    for _ in range(10_000):
        identifier = random.choice([256, 257, 300, random.getrandbits(29)])
        values = decoder.values(identifier, bool(random.getrandbits(1)), random.randbytes(random.randrange(9)))
        assert values is None or all(math.isfinite(value) for value in values.values())


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"dbc": "nowhere.dbc", "signals": BMS}, "nowhere.dbc: cannot be read .* check the path"),
        ({"dbc": __file__, "signals": BMS}, "no CAN database .* give a DBC file"),
        (
            {"dbc": DBC, "signals": {"battery_current_A": "BMS.Curent"}},
            r"'BMS.Curent' is not in robot.dbc; .*BMS.Current",
        ),
        ({"dbc": DBC, "signals": {"cell_voltage_V.0": "BMS.Cell"}}, r"BMS.Cell is in mV; .*\n.* scale = 0.001"),
    ],
)
def test_a_wrong_database_is_named_with_the_fix(settings, message, channel):
    source = CanSource(interface="virtual", channel=channel, **settings)
    with pytest.raises(InputError, match=message):
        asyncio.run(source.run(print))


def test_every_unit_that_differs_is_named_with_a_line_to_paste(tmp_path, channel):
    text = Path(DBC).read_text().replace('"rad/s"', '"rpm"')
    (tmp_path / "rpm.dbc").write_text(text)
    signals: Signals = {"cell_voltage_V.0": "BMS.Cell", "wheel_speed_rad_s.left": "Wheels.Left"}
    source = CanSource(interface="virtual", channel=channel, dbc=str(tmp_path / "rpm.dbc"), signals=signals)
    with pytest.raises(InputError, match=r"BMS.Cell is in mV, Wheels.Left is in rpm; write below signals") as found:
        asyncio.run(source.run(print))
    pasted = tomllib.loads("\n".join(str(found.value).splitlines()[1:]))
    assert pasted["wheel_speed_rad_s.left"] == {"name": "Wheels.Left", "scale": pytest.approx(math.pi / 30)}
    assert set(pasted) == set(signals)


def test_settings_are_checked():
    with pytest.raises(InputError, match="dbc is missing"):
        CanSource(signals=BMS)
    with pytest.raises(InputError, match="signals is empty"):
        CanSource(dbc=DBC)
    with pytest.raises(InputError, match="not a quantity; did you mean battery_current_A"):
        CanSource(dbc=DBC, signals={"battery_curent_A": "BMS.Current"})
    with pytest.raises(InputError, match=r"has no 'sox'; it has .*soc"):
        CanSink(dbc=DBC, signals={"battery.sox": "State.SoC"})


def test_a_bus_that_is_not_there_is_one_line_with_the_fix():
    source = CanSource(dbc=DBC, signals=BMS, channel="nocan7")
    with pytest.raises(
        OhmwardError, match=r"socketcan nocan7 cannot be opened .* ip link set nocan7 up type can"
    ) as found:
        asyncio.run(source.run(print))
    assert "\n" not in str(found.value)


def test_bus_off_is_named_and_over_once_the_bus_is_back(database, channel, monkeypatch):
    """The estimate goes on with the other source, the fault is named, and frames come again by themselves."""
    monkeypatch.setattr("ohmward.onboard.part.FIRST_WAIT_S", 0.1)
    states: list[RobotState] = []
    source = CanSource(dbc=DBC, interface="virtual", channel=channel, signals=BMS)
    process = Process(Estimation(generic_battery("nmc", 10.0, 7)), [source], [])
    process._pass_on = states.append  # type: ignore[method-assign, assignment]
    named = []

    async def run():
        running = asyncio.create_task(process.run())
        with can.Bus(interface="virtual", channel=channel) as bus:
            await asyncio.sleep(0.3)
            bus.send(frame(database, "BMS", Current=-3, Voltage=26, Temperature=20, Cell=0))
            while not [state for state in states if state.sample]:  # the first one waits until its clock is known
                await asyncio.sleep(0.02)
            bus.send(can.Message(is_error_frame=True, arbitration_id=0x40, data=bytes(8)))
            await asyncio.sleep(0.1)
            named.append(process.diagnostics["source can"])
            before = len([state for state in states if state.sample])
            for _ in range(100):
                await asyncio.sleep(0.05)
                bus.send(frame(database, "BMS", Current=-3, Voltage=26, Temperature=20, Cell=0))
                if len([state for state in states if state.sample]) > before:
                    break
            named.append(process.diagnostics["source can"])
        process.stop()
        await running
        return before

    before = asyncio.run(run())
    assert "bus-off" in named[0].message and named[0].level == Level.ERROR
    assert named[1].level == Level.OK
    assert len([state for state in states if state.sample]) > before > 0


def some_state(soc):
    battery = Estimation(generic_battery("nmc", 10.0, 7))
    (state,) = battery.put(0.0, {"battery_current_A": -1.0, "battery_voltage_V": 26.0})
    assert state.battery
    return state._replace(battery=state.battery._replace(soc=soc))


def test_states_go_out_as_frames(database, channel):
    sink = CanSink(
        dbc=DBC, interface="virtual", channel=channel, signals={"battery.soc": ScaledSignal("State.SoC", 0.01)}
    )
    feed = Feed()
    with can.Bus(interface="virtual", channel=channel) as bus:

        async def run():
            feed.put(some_state(0.42))
            feed.end()
            await sink.run(feed)

        asyncio.run(run())
        message = bus.recv(1.0)
    assert message is not None and message.is_extended_id
    assert database.decode_message(message.arbitration_id, message.data)["SoC"] == 42.0


def test_numbers_saturate_and_unknown_ones_keep_the_message_back(database):
    encoder = CanEncoder(CanDatabase(DBC), {"a": "Torque.Left", "b": "Torque.Right", "c": "State.Speed"})
    assert encoder.frames({"a": 1.0, "b": math.nan}) == []
    ((identifier, extended, data),) = encoder.frames({"a": 1e9, "b": -7.5})
    assert (identifier, extended) == (512, False)
    assert database.decode_message(512, data) == {"Left": 50.0, "Right": -7.5, "Enable": 0, "Counter": 0}


@pytest.fixture
def vcan():
    """A virtual interface of the kernel, where it has them and we may make one."""
    name = f"vohm{next(NUMBERS)}"
    try:
        subprocess.run(["ip", "link", "add", "dev", name, "type", "vcan"], check=True, capture_output=True)
        subprocess.run(["ip", "link", "set", name, "up"], check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError) as error:
        pytest.skip(f"the kernel has no vcan, or we may not make one: {error}")
    yield name
    subprocess.run(["ip", "link", "del", name], check=False, capture_output=True)


def test_socketcan_carries_measurements_in_and_states_out(database, vcan):
    got: list[Message] = []
    sink = CanSink(dbc=DBC, channel=vcan, signals={"battery.soc": ScaledSignal("State.SoC", 0.01)})
    feed = Feed()

    async def act():
        with can.Bus(interface="socketcan", channel=vcan) as bus:
            bus.send(frame(database, "BMS", Current=-3.21, Voltage=25.125, Temperature=-7, Cell=3300))
            feed.put(some_state(0.42))
            feed.end()
            await sink.run(feed)
            message = bus.recv(1.0)
            assert message is not None
            assert database.decode_message(message.arbitration_id, bytes(message.data))["SoC"] == 42.0

    asyncio.run(while_running(CanSource(dbc=DBC, channel=vcan, signals=BMS), got.append, act))
    assert got[0].values["battery_current_A"] == pytest.approx(-3.21)
