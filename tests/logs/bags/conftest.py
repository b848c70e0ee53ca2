"""Recordings that the packages of others have written: rosbags (rosbag1, rosbag2) and mcap."""

from pathlib import Path

import pytest

from .examples import COMPRESSIONS, START_NS, STEP_NS, TYPE, payloads, store, write_mcap


@pytest.fixture(scope="session")
def bags(tmp_path_factory) -> Path:
    """A folder with the same messages in every format."""
    folder = tmp_path_factory.mktemp("bags")
    rosbag2, rosbag1 = pytest.importorskip("rosbags.rosbag2"), pytest.importorskip("rosbags.rosbag1")
    messages, of_ros1 = payloads(), payloads(ros1=True)
    for name, plugin in (("folder.mcap", "MCAP"), ("folder.db3", "SQLITE3")):
        with rosbag2.Writer(folder / name, version=8, storage_plugin=rosbag2.StoragePlugin[plugin]) as writer:
            topic = writer.add_connection("/battery_state", TYPE, typestore=store())
            for k, message in enumerate(messages):
                writer.write(topic, START_NS + k * STEP_NS + 1000, message)
    with rosbag1.Writer(folder / "one.bag") as writer:
        topic = writer.add_connection("/battery_state", TYPE, typestore=store(ros1=True))
        for k, message in enumerate(of_ros1):
            writer.write(topic, START_NS + k * STEP_NS + 1000, message)
    for compression in COMPRESSIONS:
        write_mcap(folder / f"{compression}.mcap", {"/battery_state": (TYPE, messages)}, compression)
    return folder
