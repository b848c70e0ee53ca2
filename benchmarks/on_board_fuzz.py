"""Inputs of any kind for what listens on board: no crash, no hang, no memory.

Each input is a good one with bits flipped, pieces cut out, doubled or exchanged with another's, or nothing but random
bytes. `make soak` takes a million of each (`python benchmarks/on_board.py fuzz-serial`); the tests take ten thousand.
"""

from __future__ import annotations

import random
import shutil
import sqlite3
import sys
import time
from atexit import register
from collections.abc import Callable
from contextlib import closing, suppress
from pathlib import Path
from tempfile import mkdtemp
from typing import NamedTuple

import numpy as np

from ohmward.errors import InputError, OhmwardError
from ohmward.logs import write_table
from ohmward.logs.read import open_table
from ohmward.onboard.can_bus import CanDatabase, CanDecoder
from ohmward.onboard.control.operator_command import Signing, command_of
from ohmward.onboard.message import Signals, Wiring
from ohmward.onboard.mqtt_broker import Payload
from ohmward.onboard.robot_setup import SETUP_FILE
from ohmward.onboard.robot_state import RobotState
from ohmward.onboard.ros.cdr import serialize
from ohmward.onboard.ros.messages import battery_state
from ohmward.onboard.ros.types import BATTERY_STATE, JOINT_STATE
from ohmward.onboard.serial_frame import FrameClock, FrameReader, SerialFrame, encode
from ohmward.onboard.sources.json_lines import JsonLinesSource
from ohmward.onboard.sources.mqtt import MqttSource
from ohmward.onboard.sources.ros2 import Ros2Source
from ohmward.onboard.sources.serial import SerialSource
from on_board_day import resident_MB

DBC = str(Path(__file__).parents[1] / "tests" / "onboard" / "robot.dbc")

#: Inputs before the memory is looked at first: caches are filled by then.
_WARM = 2_000

Take = Callable[[bytes], object]


class Fuzzed(NamedTuple):
    """What inputs of any kind did to a listener.

    inputs: number of them.  slowest_s: most processor time that one took.  seconds: all of them together.
    grown_MB: memory of the process, after the first ones.  crashes: inputs whose exception was let out.
    """

    inputs: int
    slowest_s: float
    grown_MB: float
    seconds: float
    crashes: int = 0


def serial() -> tuple[Take, list[bytes]]:
    """Bytes of a serial line, in pieces."""
    names = {1: ("battery_current_A", "battery_voltage_V"), 2: ("estimate.soc",)}
    source = SerialSource("line", {str(number): found for number, found in names.items()})
    reader, clock, wiring = (
        FrameReader(),
        FrameClock(),
        Wiring({name: name for found in names.values() for name in found}),
    )

    def take(data: bytes) -> None:
        for frame in reader.feed(data):
            source.message(frame, names, wiring, clock, 1.0)

    good = [SerialFrame(1, k, 1000 * k, (1.5 * k, 0.0)) for k in range(8)] + [SerialFrame(2, 9, 2**32 - 1, (0.5,))]
    return take, [encode(frame) for frame in good]


def can() -> tuple[Take, list[bytes]]:
    """Identifier and data of frames."""
    signals: Signals = {"battery_current_A": "BMS.Current", "cell_voltage_V.0": "Multi.CellA"}
    decoder = CanDecoder(CanDatabase(DBC), Wiring(signals))

    def take(data: bytes) -> None:
        decoder.values(int.from_bytes(data[:2], "big"), bool(data[2:3] > b"\x80"), data[3:11])

    return take, [b"\x01\x00\x00" + bytes(8), b"\x01\x2c\x00" + bytes(4), b"\x01\x01\x00" + b"\xff" * 8]


_OBJECTS = [
    b'{"time_s": 1.5, "battery_current_A": -3.2, "battery_voltage_V": 25.6}',
    b'{"wheel_speed_rad_s": [1.0, 2.0, null], "cell_voltage_V.3": 3.3, "x": {"y": []}}',
    b"1e999",
    b'{"time_s": 1, "battery_full": true, "speed_m_s": 1' + b"0" * 400 + b"}",
    b"[" * 3000,
]


def mqtt() -> tuple[Take, list[bytes]]:
    """Payloads of a topic."""
    signals: Signals = {"battery_current_A": "bms#battery_current_A", "battery_voltage_V": "bms"}
    source, wiring = MqttSource(signals=signals, topics=("bms",)), Wiring(signals)
    return lambda data: source.message(Payload("bms", data, 1.0), wiring), _OBJECTS


def json_lines() -> tuple[Take, list[bytes]]:
    """Lines."""
    source, wiring = JsonLinesSource(), Wiring({})
    return lambda data: source.message(data, wiring, 1.0), _OBJECTS


def operator() -> tuple[Take, list[bytes]]:
    """Lines of an operator, signed by somebody who has the token."""
    robot, answers = Signing("token", "nonce", "operator"), Signing("token", "nonce", "operator")

    def take(data: bytes) -> None:
        found = robot.read(answers.line({}) if data[:1] == b"\0" else data)
        command_of(found or {"armed": data[:1], "speed_m_s": data[1:2].hex()}, 1.0)

    return take, [Signing("token", "nonce", "operator").line({"armed": True, "speed_m_s": 0.3, "t": 1.0})]


def setup() -> tuple[Take, list[bytes]]:
    """Setups in TOML; whatever is wrong with one is an `InputError`."""

    def take(data: bytes) -> None:
        with suppress(InputError):
            SETUP_FILE.parse(data.decode(errors="replace"))

    good = b'format = "ohmward-setup/1"\nrobot = "rlma"\ndelay_s = 0.1\n'
    parts = [
        b'[[source]]\nkind = "can"\ndbc = "a.dbc"\n[source.signals]\nbattery_current_A = {name = "B.C", scale = 2.0}',
        b'[[source]]\nkind = "serial"\nport = "/dev/x"\nmessages = {1 = ["battery_voltage_V"]}\n',
        b'[[source]]\nkind = "mqtt"\ntopics = ["a/+"]\npassword = "X"\nusername = "u"\n',
        b'[[sink]]\nkind = "mqtt"\nport = 1\n',
        b'[[sink]]\nkind = "control"\nrobot = "rlma"\n[sink.mqtt]\ntopic = "d"\n[sink.limits]\nslip = 0.2\n',
        b'[[sink]]\nkind = "json-lines"\ninterval_s = 1.0\n',
    ]
    return take, [good + part for part in parts]


def ros2() -> tuple[Take, list[bytes]]:
    """Messages of ROS 2; one that cannot be read is None."""
    source = Ros2Source(battery_state="/battery", joint_states="/joints")

    def take(data: bytes) -> None:
        source.message(BATTERY_STATE, data, 1.0)
        source.message(JOINT_STATE, data, 1.0)

    return take, [_battery_message(k) for k in range(4)]


def bags() -> tuple[Take, list[bytes]]:
    """Recordings: MCAP and SQLite; whatever is wrong with one is an `OhmwardError`."""
    folder = Path(mkdtemp())
    register(shutil.rmtree, folder)
    path = folder / "run"

    def take(data: bytes) -> None:
        path.write_bytes(data)
        with suppress(OhmwardError):
            file = open_table(path).part("battery")
            file.load(file.names)

    write_table({"time_s": np.arange(20.0), "current_A": np.ones(20), "voltage_V": np.ones(20)}, folder / "run.mcap")
    with closing(sqlite3.connect(folder / "run.db3")) as database:
        database.execute("CREATE TABLE topics (id, name, type, serialization_format)")
        database.execute("CREATE TABLE messages (topic_id, timestamp, data)")
        database.execute("INSERT INTO topics VALUES (1, '/battery', 'sensor_msgs/msg/BatteryState', 'cdr')")
        rows = [(1, k, _battery_message(k)) for k in range(20)]
        database.executemany("INSERT INTO messages VALUES (?, ?, ?)", rows)
        database.commit()
    return take, [(folder / name).read_bytes() for name in ("run.mcap", "run.db3")]


def _battery_message(k: int) -> bytes:
    """The state of a battery with k cells."""
    state = RobotState(float(k), 1.7e9 + k)
    measured = {"battery_current_A": -1.0, **{f"cell_voltage_V.{cell}": 3.3 for cell in range(k)}}
    return serialize(BATTERY_STATE, battery_state(state, measured, None, "base_link"))


LISTENERS: dict[str, Callable[[], tuple[Take, list[bytes]]]] = {
    "serial": serial,
    "can": can,
    "mqtt": mqtt,
    "json-lines": json_lines,
    "operator": operator,
    "setup": setup,
    "ros2": ros2,
    "bags": bags,
}


def damaged(good: list[bytes], rng: random.Random) -> bytes:
    """One of the good inputs, changed in up to four places, or random bytes."""
    found = bytearray(rng.choice(good) if rng.random() < 0.95 else rng.randbytes(rng.randrange(200)))
    for _ in range(rng.randrange(5)):
        at = rng.randrange(len(found) + 1)
        match rng.randrange(4):
            case 0 if at < len(found):
                found[at] ^= 1 << rng.randrange(8)
            case 1:
                del found[at : at + rng.randrange(1, 16)]
            case 2:
                found[at:at] = rng.randbytes(rng.randrange(1, 8))
            case 3:
                other = rng.choice(good)
                cut = rng.randrange(len(other) + 1)
                found[at : at + 8] = other[cut : cut + rng.randrange(1, 32)]
    return bytes(found)


def fuzz(name: str, inputs: int, seed: int = 1) -> Fuzzed:
    """Feed a listener; an input whose exception it lets out stands on standard error."""
    take, good = LISTENERS[name]()
    rng, slowest_s, first_MB, crashes, began_s = random.Random(seed), 0.0, 0.0, 0, time.perf_counter()
    for k in range(inputs):
        if k == min(_WARM, inputs // 2):
            first_MB = resident_MB()
        data = damaged(good, rng)
        from_s = time.thread_time()
        try:
            take(data)
        except Exception as error:
            print(f"{name}, input {k}, {error!r}: {data!r}", file=sys.stderr)
            crashes += 1
        slowest_s = max(slowest_s, time.thread_time() - from_s)
    return Fuzzed(inputs, slowest_s, resident_MB() - first_MB, time.perf_counter() - began_s, crashes)
