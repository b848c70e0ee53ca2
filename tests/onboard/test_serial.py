"""The serial line on a pseudo-terminal, with frames of the exported C."""

import asyncio
import ctypes
import math
import os
import random
import shutil
import struct
import subprocess
import time
import tty
from contextlib import suppress
from typing import Any

import pytest

from ohmward import generic_battery
from ohmward.embedded import battery_export, library, write_library
from ohmward.errors import InputError, OhmwardError
from ohmward.onboard.estimation import Estimation
from ohmward.onboard.message import Message, ScaledSignal
from ohmward.onboard.part import keep_running
from ohmward.onboard.robot_state import Level
from ohmward.onboard.serial_frame import MOST_VALUES, FrameClock, FrameReader, SerialFrame, decode, encode
from ohmward.onboard.sources.serial import PrintedLines, SerialSource

STRICT = ["-std=c99", "-Wall", "-Wextra", "-Wshadow", "-Wconversion", "-Wdouble-promotion", "-Wundef", "-pedantic"]
MESSAGES: dict[str, tuple[str, ...]] = {"1": ("battery_current_A", "battery_voltage_V"), "2": ("estimate.soc",)}


def frame(k=0, values=(1.5, -2.0)):
    return SerialFrame(1, k % 256, (1000 * k) % 2**32, tuple(values))


def some_frames(number, seed=0):
    rng = random.Random(seed)
    for k in range(number):
        floats = struct.unpack(
            "<4f", struct.pack("<4f", *(rng.choice([0.0, 1.0, rng.uniform(-9, 9)]) for _ in range(4)))
        )
        yield SerialFrame(rng.randrange(256), k % 256, rng.getrandbits(32), floats[: rng.randrange(5)])


@pytest.fixture(scope="module")
def encoder(tmp_path_factory):
    """`NAME_frame` of an exported library, compiled with every warning."""
    if not shutil.which("gcc"):
        pytest.skip("no C compiler here: gcc is not installed")
    folder = tmp_path_factory.mktemp("soc")
    write_library(library(battery_export(generic_battery("lfp", 12.0, 4), "textbook-ekf", "soc")), folder)
    command = ["gcc", *STRICT, "-Werror", "-shared", "-fPIC", "-o", "soc.so", "soc_frame.c", "soc.c", "-lm"]
    subprocess.run(command, cwd=folder, check=True)
    loaded = ctypes.CDLL(str(folder / "soc.so"))
    loaded.soc_frame.restype = ctypes.c_size_t

    def encoded(found: SerialFrame) -> bytes:
        values = (ctypes.c_float * max(len(found.values), 1))(*found.values)
        buffer = (ctypes.c_uint8 * 2048)()
        head = ctypes.c_uint8(found.number), ctypes.c_uint8(found.sequence), ctypes.c_uint32(found.time_us)
        length = loaded.soc_frame(buffer, *head, values, ctypes.c_size_t(len(found.values)))
        return bytes(buffer[:length])

    return encoded


def test_the_c_writes_the_bytes_of_the_desk(encoder):
    for found in some_frames(2000):
        assert encoder(found) == encode(found)
        assert b"\0" not in encode(found)[:-1]
    long = SerialFrame(9, 0, 1, tuple(float(k + 1) for k in range(MOST_VALUES)))
    assert encoder(long)[:-1].rstrip(b"\1") == encode(long)[:-1].rstrip(b"\1")  # an empty last block may be left out
    assert decode(encoder(long)[:-1]) == decode(encode(long)[:-1]) == long


def test_values_of_a_struct_go_in_the_order_of_the_readme(tmp_path):
    files = library(battery_export(generic_battery("lfp", 12.0, 4), "textbook-ekf", "soc"))
    assert "values[1] = sample->current_A;" in files["soc_frame.c"]
    assert "values[0] = output->soc;" in files["soc_frame.c"]


def test_frames_come_back_from_pieces_of_any_size():
    frames = [found._replace(number=k % 2, sequence=k // 2 % 256) for k, found in enumerate(some_frames(500))]
    data = b"".join(map(encode, frames))
    rng, reader, got = random.Random(3), FrameReader(), []
    while data:
        cut = rng.randrange(1, 40)
        got += reader.feed(data[:cut])
        data = data[cut:]
    assert got == frames
    assert reader.faulty == reader.lost == 0


def damaged(data: bytes, rng: random.Random) -> bytes:
    """A frame with flipped bits, bytes that are missing or bytes too many."""
    found = bytearray(data)
    kind = rng.randrange(3)
    at = rng.randrange(len(found))
    if kind == 0:
        for _ in range(rng.randrange(1, 5)):
            found[rng.randrange(len(found))] ^= 1 << rng.randrange(8)
    elif kind == 1:
        del found[at : at + rng.randrange(1, 8)]
    else:
        found[at:at] = rng.randbytes(rng.randrange(1, 8))
    return bytes(found)


def test_flipped_bits_and_cut_frames_give_no_wrong_number():
    """Of 20 000 frames a third is damaged: the others come through, and what comes through is right."""
    rng, reader = random.Random(4), FrameReader()
    sent, whole, got = set(), 0, []
    for k in range(20_000):
        one = frame(k, (rng.uniform(-100, 100), float(k)))
        one = decode(encode(one)[:-1]) or one
        sent.add(one)
        damage = rng.random() < 1 / 3
        whole += not damage
        got += reader.feed(damaged(encode(one), rng) if damage else encode(one))
    assert set(got) <= sent
    assert len(got) >= 0.6 * whole  # a damaged end takes the frame behind it along
    assert reader.faulty > 4000 and reader.lost > 4000


def test_bytes_of_any_kind_are_no_fault_and_take_no_memory():
    rng, reader = random.Random(5), FrameReader()
    for _ in range(10_000):
        assert reader.feed(rng.randbytes(rng.randrange(64))) == []
    reader.feed(b"\1" * 10_000_000)
    assert len(reader._rest) < 2000
    assert reader.feed(b"\0" + encode(frame())) == [frame()]


def test_a_timer_that_overflows_goes_on():
    clock = FrameClock()
    assert [clock.stamp_s(time % 2**32) for time in (2**32 - 1000, 2**32 + 1000, 2**32 + 3000)] == pytest.approx(
        [0.0, 0.002, 0.004]
    )


async def while_reading(port, act, messages=MESSAGES, **settings):
    got: list[Message] = []
    task = asyncio.create_task(SerialSource(port, messages, **settings).run(got.append))
    await asyncio.sleep(0.2)
    act()
    for _ in range(100):
        await asyncio.sleep(0.02)
        if len(got) >= 3:
            break
    task.cancel()
    with suppress(asyncio.CancelledError):
        await task
    return got


@pytest.fixture
def line():
    """Our end of a serial line, which a test may close, and the path of the other."""
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    with os.fdopen(ours, "wb", buffering=0) as end, os.fdopen(theirs, "rb", buffering=0):
        yield end, os.ttyname(theirs)


def test_a_line_brings_samples_and_estimates(line, encoder):
    ours, port = line

    def send():
        ours.write(b"\x07half a frame\0" + encoder(SerialFrame(1, 0, 5000, (-2.5, 13.25))))
        ours.write(encoder(SerialFrame(2, 1, 6000, (0.75,))) + encoder(SerialFrame(7, 2, 6500, (1.0,))))
        ours.write(encoder(SerialFrame(1, 3, 15000, (math.nan, 13.25))))

    got = asyncio.run(while_reading(port, send))
    assert [dict(message.values) for message in got[:2]] == [
        {"battery_current_A": -2.5, "battery_voltage_V": 13.25},
        {"estimate.soc": 0.75},
    ]
    assert math.isnan(got[2].values["battery_current_A"])
    assert got[2].stamp_s - got[0].stamp_s == pytest.approx(0.01)


#: Lines that a board prints, with what may stand between them, and its names of current and voltage.
PRINTED = {
    "JSON": (b'{"I": -2.5, "U": 13.25}\r\n', "I", "U"),
    "pairs with units": (b"t=12 I=-2.5A U=13.25V\n", "I [A]", "U [V]"),
    "a value a line": (b"I: -2.5\nU: 13.25 V\n", "I", "U [V]"),
    "Teleplot": (">I:-2.5§A\r\n>U:13.25\r\n".encode(), "I [A]", "U"),
    "log of ESP-IDF": (b"I (1234) bms: I=-2.5 U=13.25\r\n", "I", "U"),
    "rows": (b"7,-2.5,13.25,\r\n", "2", "3"),
    "rows, carriage return alone": (b"-2.5 13.25\r", "1", "2"),
    "VE.Direct": (b"\r\nPID\t0xA389\r\nI\t-2.5\r\nV\t13.25\r\nChecksum\t\x9e", "I", "V"),
}


@pytest.mark.parametrize(("text", "current", "voltage"), PRINTED.values(), ids=PRINTED)
def test_printed_numbers_are_samples(line, text, current, voltage):
    ours, port = line
    signals: dict[str, str | ScaledSignal] = {"battery_current_A": current, "battery_voltage_V": voltage}
    # from the middle of a line on; later the board is reset within one
    cut = text[len(text) // 2 :] + 3 * text + text[: len(text) // 2] + b"\xff\x00boot\r\n" + text
    got = asyncio.run(while_reading(port, lambda: ours.write(cut), {}, signals=signals))
    assert len(got) >= 3
    numbers = {(name, value) for message in got for name, value in message.values.items() if not math.isnan(value)}
    assert numbers == {("battery_current_A", -2.5), ("battery_voltage_V", 13.25)}


NOISE = {"mixed": bytes(random.Random(6).choices(b"xx\x80\xffU", k=60_000)), "x": 60_000 * b"x", "a=x": 20_000 * b"a=x"}


@pytest.mark.parametrize("noise", NOISE.values(), ids=NOISE)
def test_noise_of_a_wrong_baud_rate_takes_time_by_its_length(noise):
    """As one line about as much as in a hundred; a search that begins anew at every byte takes a hundred times that."""
    lines, times = PrintedLines(), []
    for length in (600, 60_000):
        cut = [noise[at : at + length] + b"\n" for at in range(0, len(noise), length)]
        began_s = time.process_time()
        assert [lines.feed(line) for line in cut] == [[]] * len(cut)
        times.append(time.process_time() - began_s)
    assert times[1] < 10 * times[0]


def test_rows_that_have_lost_bytes_are_left_out():
    lines = PrintedLines()
    assert lines.feed(b"13.2,25\nms,I,U,T\n7,-2.5,13.2,25\n8,-2.5,13.2") == [
        {"1": 7.0, "2": -2.5, "3": 13.2, "4": 25.0}
    ]
    assert lines.feed(b"\n") == [] and lines.feed(b"9,-2.5,13.2,25\n") == []  # which of the two is right is not known
    assert lines.feed(b"10,-2.5,,25\n")[0]["2"] == -2.5
    assert lines.headers[4] == ["ms", "I", "U", "T"]
    lines.feed(b"x" * 10_000_000)
    assert len(lines._rest) < 100_000


def test_estimates_of_the_microcontroller_go_on_with_the_states():
    estimation = Estimation(generic_battery("nmc", 10.0, 4))
    (state,) = estimation.put(1.0, {"estimate.soc": 0.75})
    assert state.sample == {"estimate.soc": 0.75} and state.time_s == 1.0


def test_a_plug_that_is_pulled_is_named(line):
    ours, port = line
    told: list[Any] = []

    async def run():
        source = SerialSource(port, MESSAGES)
        task = asyncio.create_task(keep_running("source serial", lambda: source.run(print), told.append, 0.1))
        await asyncio.sleep(0.3)
        ours.close()
        await asyncio.sleep(0.5)
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task

    asyncio.run(run())
    assert any(said.level == Level.ERROR and "is it plugged in?" in said.message for said in told)


def test_settings_and_ports_are_checked():
    refused: list[tuple[dict[str, Any], str]] = [
        ({"messages": {"300": ("soc",)}}, "not the number of a message"),
        ({"messages": {"1": ("battery_curent_A",)}}, "did you mean battery_current_A"),
        ({"messages": MESSAGES, "signals": {"battery_current_A": "I"}}, "'I' is no value of the messages"),
        ({"messages": MESSAGES, "baud": 3}, "baud must be between"),
    ]
    for settings, message in refused:
        with pytest.raises(InputError, match=message):
            SerialSource("/dev/ttyACM0", **settings)
    with pytest.raises(OhmwardError, match=r"/dev/ttyNONE cannot be opened \(No such file or directory\); .*"):
        asyncio.run(SerialSource("/dev/ttyNONE", MESSAGES).run(print))


def test_names_of_signals_and_names_that_are_quantities_stand_beside_each_other():
    messages: dict[str, tuple[str, ...]] = {"1": ("mA", "battery_voltage_V", "spare")}
    wiring = SerialSource("p", messages, signals={"battery_current_A": ScaledSignal("mA", 0.001)})._wiring()
    numbers = {"mA": -3200.0, "battery_voltage_V": 13.1, "spare": 1.0}
    assert wiring.values(numbers) == pytest.approx({"battery_current_A": -3.2, "battery_voltage_V": 13.1})
