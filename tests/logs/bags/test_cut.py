"""Recordings that were cut off or damaged: everything before is read, and nothing crashes."""

import io
import time
from pathlib import Path

import numpy as np
import pytest

from ohmward.errors import OhmwardError
from ohmward.logs import read_log
from ohmward.logs.bags.bag_table import open_recording
from ohmward.logs.bags.mcap_file import open_mcap
from ohmward.logs.read import open_table

from .examples import COMPRESSIONS, FORMATS, N, truth


def file_of(path: Path) -> Path:
    """The recording itself, which of rosbag2 is in a folder."""
    return next(file for file in path.iterdir() if file.suffix != ".yaml") if path.is_dir() else path


def messages_of_whole_chunks(content: bytes) -> int:
    """Number of messages in the whole chunks of a cut MCAP file, by the package mcap."""
    reading = pytest.importorskip("mcap.stream_reader")
    records = pytest.importorskip("mcap.records")
    count = 0
    try:
        for record in reading.StreamReader(io.BytesIO(content), skip_magic=False, emit_chunks=False).records:
            count += isinstance(record, records.Message)
    except Exception:  # at the cut
        pass
    return count


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_an_mcap_file_cut_at_any_byte_gives_all_whole_chunks_before_the_cut(bags, tmp_path, compression):
    content = (bags / f"{compression}.mcap").read_bytes()
    path = tmp_path / "cut.mcap"
    rng = np.random.default_rng(2)
    cuts = [8, 9, len(content) - 1, len(content) - 9, *rng.integers(8, len(content), 60)]
    for cut in map(int, cuts):
        path.write_bytes(content[:cut])
        recording = open_mcap(path)
        found = sum(1 for _ in recording.messages())
        assert found == messages_of_whole_chunks(content[:cut])
        assert any("cut off" in text for text in recording.notes) == (cut < content.rindex(b"\x0f\x04"))


def test_a_cut_file_is_a_log_with_a_warning(bags, tmp_path):
    content = (bags / "ZSTD.mcap").read_bytes()
    path = tmp_path / "cut.mcap"
    path.write_bytes(content[: len(content) // 2])
    log = read_log(path, current_sign="charge")
    assert 0.3 * N < len(log) < 0.7 * N
    np.testing.assert_array_equal(log.current_A, truth()["current"][: len(log)])
    assert any("cut off" in note.text and note.level == "warning" for note in log.notes)


@pytest.mark.parametrize("name", ["one.bag", "folder.db3"])
def test_older_bags_that_were_cut_give_what_is_whole(bags, tmp_path, name):
    source = file_of(bags / name)
    content = source.read_bytes()
    path = tmp_path / source.name
    counts = []
    for share in (0.3, 0.6, 0.9):
        path.write_bytes(content[: int(share * len(content))])
        counts.append(sum(1 for _ in open_recording(path).messages()))
    assert counts == sorted(counts)
    assert counts[-1] > 0.5 * N or name == "one.bag"  # whose writer makes one chunk of all


@pytest.mark.parametrize("name", FORMATS)
def test_damaged_files_are_read_or_refused_and_nothing_else(bags, tmp_path, name):
    """Bytes at random places are wrong: a log, or a sentence; no other error, no hang."""
    source = (
        next(p for p in sorted((bags / name).iterdir()) if p.suffix != ".yaml") if "folder" in name else bags / name
    )
    content = source.read_bytes()[:120_000]
    path = tmp_path / source.name
    rng = np.random.default_rng(3)
    began_s = time.monotonic()
    for _ in range(60):
        damaged = bytearray(content)
        for at in rng.integers(0, min(len(content), rng.choice([300, len(content)])), 8):
            damaged[at] = rng.integers(256)
        path.write_bytes(damaged)
        try:
            file = open_table(path).part("battery")
            file.load(file.names)
        except OhmwardError:
            pass
    assert time.monotonic() - began_s < 60.0
