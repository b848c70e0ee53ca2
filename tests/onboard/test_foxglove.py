"""The server for Foxglove, as a viewer sees it: channels with definitions, and messages that rosbags decodes."""

import asyncio
import json

import pytest

from ohmward.errors import InputError, OhmwardError
from ohmward.onboard.feed import Feed
from ohmward.onboard.ros import types
from ohmward.onboard.sinks.foxglove import FoxgloveSink
from onboard.ros.test_messages import at, driven
from onboard.servers import free_port

pytest.importorskip("foxglove")
typesys = pytest.importorskip("rosbags.typesys")


@pytest.mark.parametrize("type_", types.HASHES)
def test_definitions_are_those_that_other_readers_expect(type_):
    store = typesys.get_typestore(typesys.Stores.EMPTY)
    store.register(typesys.get_types_from_msg(types.definition_text(type_), type_))
    assert store.hash_rihs01(type_) == types.HASHES[type_]


def test_a_viewer_gets_channels_and_messages():
    client = pytest.importorskip("websockets.asyncio.client")
    port = free_port()
    sink = FoxgloveSink(port=port, interval_s=0.0)

    async def view() -> tuple[dict, bytes]:
        feed = Feed()
        serving = asyncio.create_task(sink.run(feed))
        feed.put(at(0.0, driven()))
        await asyncio.sleep(0.3)
        async with client.connect(f"ws://127.0.0.1:{port}", subprotocols=["foxglove.sdk.v1"]) as socket:
            channels: dict[str, dict] = {}
            while "/battery_state" not in channels:
                told = json.loads(await asyncio.wait_for(socket.recv(), 60.0))
                channels |= {channel["topic"]: channel for channel in told.get("channels", [])}
            wanted = [{"id": 1, "channelId": channels["/battery_state"]["id"]}]
            await socket.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
            await asyncio.sleep(0.2)
            feed.put(at(10.0, driven()))
            while not isinstance(message := await asyncio.wait_for(socket.recv(), 60.0), bytes):
                pass
        feed.end()
        await serving
        return channels, message

    channels, message = asyncio.run(view())
    assert {"/battery_state", "/diagnostics", "/ohmward/odometry", "/ohmward/twist"} <= set(channels)
    about = channels["/battery_state"]
    assert (about["encoding"], about["schemaName"], about["schemaEncoding"]) == ("cdr", types.BATTERY_STATE, "ros2msg")
    store = typesys.get_typestore(typesys.Stores.LATEST)
    decoded = store.deserialize_cdr(message[13:], types.BATTERY_STATE)  # after opcode, subscription and time
    assert decoded.percentage == 0.5


def test_what_would_be_open_to_everybody_is_refused():
    with pytest.raises(InputError, match=r"host must be a loopback address.*ssh -L 8765"):
        FoxgloveSink(host="0.0.0.0")


def test_a_stranger_is_no_line_in_the_log(caplog):
    async def knock() -> None:
        port = free_port()
        serving = asyncio.create_task(FoxgloveSink(port=port).run(Feed()))
        await asyncio.sleep(0.3)
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(b"GET / HTTP/1.1\r\n\r\n")
        await reader.read()
        writer.close()
        serving.cancel()
        await asyncio.gather(serving, return_exceptions=True)

    asyncio.run(knock())
    assert not caplog.records


def test_a_port_that_is_taken_is_named():
    async def twice() -> None:
        port = free_port()
        first = asyncio.create_task(FoxgloveSink(port=port).run(Feed()))
        await asyncio.sleep(0.3)
        try:
            with pytest.raises(OhmwardError, match=rf"port {port} cannot be used"):
                await FoxgloveSink(port=port).run(Feed())
        finally:
            first.cancel()
            await asyncio.gather(first, return_exceptions=True)

    asyncio.run(twice())
