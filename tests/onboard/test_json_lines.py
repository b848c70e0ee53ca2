"""JSON lines from sockets, pipes and files, whole, broken and endless."""

import asyncio
import json
import random
import subprocess
import sys
import time
from contextlib import suppress
from itertools import permutations
from pathlib import Path
from typing import Any

import pytest

from ohmward.errors import InputError, OhmwardError
from ohmward.onboard.clock import Arrival, Arrivals
from ohmward.onboard.feed import Feed
from ohmward.onboard.line_reader import MOST_KNOWN, MOST_STRANGERS
from ohmward.onboard.message import ScaledSignal, Wiring
from ohmward.onboard.robot_state import RobotState
from ohmward.onboard.sinks.json_lines import JsonLinesSink
from ohmward.onboard.sources import json_lines
from ohmward.onboard.sources.json_lines import LONGEST_LINE, JsonLinesSource
from onboard.servers import free_port, wait_for_port

LINES = b'{"time_s": 1, "battery_current_A": -2.5}\nno json\n{"cell_voltage_V": [3.3, null]}\n'


async def listening(source, *streams):
    got: list[Any] = []
    task = asyncio.create_task(source.run(got.append))
    await asyncio.sleep(0.1)
    for stream in streams:
        if source.address.startswith("127"):
            await asyncio.to_thread(wait_for_port, int(source.address.rpartition(":")[2]))
            _, writer = await asyncio.open_connection("127.0.0.1", int(source.address.rpartition(":")[2]))
        else:
            _, writer = await asyncio.open_unix_connection(source.address)
        writer.write(stream)
        writer.close()
        await writer.wait_closed()
    await asyncio.sleep(0.2)
    task.cancel()
    with suppress(asyncio.CancelledError):
        await task
    return got


@pytest.mark.parametrize("kind", ["port", "socket"])
def test_it_listens_to_whoever_connects(kind, tmp_path):
    address = f"127.0.0.1:{free_port()}" if kind == "port" else str(tmp_path / "socket")
    for _ in range(2):  # the socket of before is in nobody's way
        got = asyncio.run(listening(JsonLinesSource(address, listen=True), LINES, LINES))
        assert [message.values.get("battery_current_A") for message in got] == [-2.5, None, -2.5, None]
        assert list(got[1].values) == ["cell_voltage_V.0", "cell_voltage_V.1"]


def test_devices_whose_clocks_differ_keep_the_times_of_their_samples():
    """Two connections send in turns, an hour apart by their clocks; the first connects again."""
    source, arrivals, arrived = JsonLinesSource(f"127.0.0.1:{free_port()}", listen=True), Arrivals(), list[Arrival]()

    async def run():
        task = asyncio.create_task(source.run(lambda message: arrived.extend(arrivals.put(message))))
        port = int(source.address.rpartition(":")[2])
        await asyncio.to_thread(wait_for_port, port)
        writers = [(await asyncio.open_connection("127.0.0.1", port))[1] for _ in range(2)]
        for k in range(40):
            if k == 30:
                writers[0].close()
                await writers[0].wait_closed()
                await asyncio.sleep(0.05)
                writers[0] = (await asyncio.open_connection("127.0.0.1", port))[1]
            for writer, ahead_s in zip(writers, (0.0, 3600.0), strict=True):
                writer.write(b'{"time_s": %f, "battery_current_A": 1}\n' % (time.monotonic() + ahead_s))
            await asyncio.sleep(0.01)
        for writer in writers:
            writer.close()
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        return arrived + arrivals.flush()

    found = asyncio.run(run())
    assert len(found) == 80
    assert not any(arrival.clock_was_set for arrival in found)
    assert [a.time_s for a in found] == pytest.approx([a.message.received_s for a in found], abs=0.2)
    assert len({arrival.message.publisher for arrival in found}) == 2


def test_any_number_of_connections_leaves_room_for_one_that_sends():
    """Idle ones go first; of those that have sent, the one that has been silent for longest."""
    source, got = JsonLinesSource(f"127.0.0.1:{free_port()}", listen=True), list[Any]()

    async def run():
        task = asyncio.create_task(source.run(got.append))
        port = int(source.address.rpartition(":")[2])
        await asyncio.to_thread(wait_for_port, port)
        sending = [await asyncio.open_connection("127.0.0.1", port) for _ in range(MOST_KNOWN + 20)]
        for _, writer in sending:
            writer.write(LINES.splitlines(keepends=True)[0])
        await asyncio.sleep(0.3)
        idle = [await asyncio.open_connection("127.0.0.1", port) for _ in range(300)]
        await asyncio.sleep(0.3)
        at_once = sum(not reader.at_eof() for reader, _ in sending + idle)
        before = len(got)
        for _, writer in sending[-20:]:
            writer.write(LINES.splitlines(keepends=True)[0])
        await asyncio.sleep(0.3)
        for _, writer in sending + idle:
            writer.close()
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        return at_once, len(got) - before

    at_once, later = asyncio.run(run())
    assert at_once <= MOST_STRANGERS + MOST_KNOWN + 10
    assert later == 20


def test_a_line_without_end_is_left_out():
    """A hundred times the longest line, without a break, then a good one."""
    source = JsonLinesSource(f"127.0.0.1:{free_port()}", listen=True)
    got = asyncio.run(listening(source, b"[" * 100 * LONGEST_LINE + b"\n" + LINES))
    assert len(got) == 2


@pytest.mark.parametrize("piped", [True, False])
def test_standard_input_may_be_a_pipe_or_a_file(piped, tmp_path):
    program = """
import asyncio, json
from ohmward.onboard.sources.json_lines import JsonLinesSource
from ohmward.onboard.part import EndedError
try:
    asyncio.run(JsonLinesSource().run(lambda message: print(json.dumps(message.values))))
except EndedError as end:
    print(end)
"""
    (tmp_path / "lines").write_bytes(LINES)
    with (tmp_path / "lines").open("rb") as file:
        source = {"input": LINES} if piped else {"stdin": file}
        out = subprocess.run([sys.executable, "-c", program], capture_output=True, check=True, timeout=60, **source)
    first, second, end = out.stdout.decode().splitlines()
    assert json.loads(first) == {"battery_current_A": -2.5}
    assert json.loads(second)["cell_voltage_V.0"] == 3.3
    assert end == "standard input has ended"


def test_standard_input_may_be_nothing():
    program = "import asyncio, ohmward.onboard.sources as s; asyncio.run(s.JsonLinesSource().run(print))"
    out = subprocess.run(
        [sys.executable, "-c", program], stdin=subprocess.DEVNULL, stderr=subprocess.PIPE, timeout=60, check=False
    )
    assert out.stderr.decode().strip().endswith("EndedError: standard input has ended")


def test_a_folder_that_is_not_there_is_made(tmp_path):
    async def write(path):
        feed = Feed()
        feed.put(RobotState(1.0, 2.0))
        feed.end()
        await JsonLinesSink(str(path)).run(feed)

    asyncio.run(write(tmp_path / "my states" / "states.jsonl"))
    assert json.loads((tmp_path / "my states" / "states.jsonl").read_text())["time_s"] == 1.0
    with pytest.raises(OhmwardError, match=r"states.jsonl/x cannot be written \(.*\); check the path"):
        asyncio.run(write(tmp_path / "my states" / "states.jsonl" / "x"))


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_disk_is_named_in_one_line():
    async def run():
        feed.put(RobotState(1.0, 2.0))
        feed.end()
        await JsonLinesSink("/dev/full").run(feed)

    feed = Feed()
    with pytest.raises(OhmwardError, match=r"/dev/full cannot be written .*No space left"):
        asyncio.run(run())
    assert asyncio.run(feed.batch()) == [RobotState(1.0, 2.0)]  # for when there is room again


def test_lines_of_any_kind_are_no_fault():
    source, rng = JsonLinesSource(), random.Random(6)
    seeds = [
        LINES,
        b'{"a": {"b": [' * 900,
        b'{"time_s": 1e999, "battery_current_A": 1' + b"0" * 400 + b"}",
        b"\xff\xfe\x00",
    ]
    for _ in range(10_000):
        line = bytearray(rng.choice(seeds))
        for _ in range(rng.randrange(5)):
            line[rng.randrange(len(line))] = rng.getrandbits(8)
        source.message(bytes(line), Wiring({}), 1.0)


def test_addresses_are_checked():
    for settings, message in (
        ({"address": "host:99999"}, "address must be"),
        ({"listen": True}, "listen needs an address"),
    ):
        with pytest.raises(InputError, match=message):
            JsonLinesSource(**settings)
    with pytest.raises(OhmwardError, match=r"no connection to 127.0.0.1:\d+ .* is it listening\?"):
        asyncio.run(JsonLinesSource(f"127.0.0.1:{free_port()}").run(print))


def test_an_array_stands_behind_the_name_of_a_quantity_alone():
    line = b'{"wheel_speed_rad_s": [1, null], "cell_voltage_V.3": [3.3], "other": [1], "speed_m_s": [0.5]}'
    message = JsonLinesSource().message(line, Wiring({}), 1.0)
    assert message is not None
    assert list(message.values) == ["wheel_speed_rad_s.0", "wheel_speed_rad_s.1"]


def test_keys_that_are_nearly_quantities_are_named_once_and_invented_ones_do_not_fill_the_log(caplog):
    json_lines._name_misspelt.cache_clear()
    line = b'{"battery_curent_A": -3.2, "sequence": 3, "battery_voltage_V": 13}'
    for _ in range(3):
        message = JsonLinesSource().message(line, Wiring({}), 1.0)
        assert message and message.values == {"battery_voltage_V": 13.0}
    for k in range(300):
        JsonLinesSource().message(b'{"battery_curent%d_A": 1}' % k, Wiring({}), 1.0)
    for letters in permutations("abcdefgh", 3):
        JsonLinesSource().message(f'{{"battery_current_{"".join(letters)}": 1}}'.encode(), Wiring({}), 1.0)
    first, numbered, *others = caplog.records
    assert "'battery_curent_A' is no quantity and left out; did you mean battery_current_A?" in first.message
    assert "'battery_curent#_A' is no quantity" in numbered.message
    assert len(others) < 100


def test_a_line_that_cannot_be_read_is_shown(caplog):
    source = JsonLinesSource(f"127.0.0.1:{free_port()}", listen=True)
    asyncio.run(listening(source, b"time,current\n" + LINES))
    assert [r.message for r in caplog.records] == [
        "source json-lines: lines are no JSON object with a quantity (1 so far, such as 'time,current')",
        "source json-lines: lines are no JSON object with a quantity (2 so far, such as 'no json')",
    ]


def test_keys_of_signals_and_keys_that_are_quantities_stand_beside_each_other():
    source = JsonLinesSource(signals={"battery_current_A": ScaledSignal("mA", 0.001), "battery_voltage_V": "U"})
    line = b'{"t": 1, "mA": -3200, "U": 13.1, "battery_temperature_degC": 21, "wheel_speed_rad_s": [1, 2], "else": 4}'
    found = source.message(line, Wiring(source.signals), 5.0)
    assert found is not None
    wheels = {"wheel_speed_rad_s.0": 1.0, "wheel_speed_rad_s.1": 2.0}
    values = {"battery_current_A": -3.2, "battery_voltage_V": 13.1, "battery_temperature_degC": 21.0}
    assert found.values == pytest.approx(values | wheels)


def test_a_line_that_broke_off_in_the_file_is_ended_before_the_next(tmp_path):
    path = tmp_path / "states.jsonl"
    path.write_text('{"a": 1}\n{"half": ')
    with JsonLinesSink(str(path))._opened() as file:
        file.write('{"b": 2}\n')
    assert path.read_text() == '{"a": 1}\n{"half": \n{"b": 2}\n'
