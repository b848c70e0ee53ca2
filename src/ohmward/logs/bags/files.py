"""The format of a recording, told by its first bytes, and folders of `ros2 bag record`."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path

from ohmward.errors import InputError
from ohmward.logs.bags import mcap_file, rosbag1_file, sqlite_file
from ohmward.logs.bags.mcap_file import open_mcap
from ohmward.logs.bags.recording import Recorded, Recording
from ohmward.logs.bags.rosbag1_file import open_rosbag1
from ohmward.logs.bags.sqlite_file import open_sqlite

#: Endings of recordings.
ENDINGS = (".mcap", ".db3", ".bag")

_OPENERS = {
    mcap_file.MAGIC: open_mcap,
    rosbag1_file.MAGIC: open_rosbag1,
    sqlite_file.MAGIC: open_sqlite,
}
_METADATA = "metadata.yaml"


def is_recording(path: Path) -> bool:
    """True where a file begins as a recording does, or a folder holds one of `ros2 bag record`."""
    return bool(parts_of(path)) if path.is_dir() else _magic(path) is not None


def open_recording(path: Path) -> Recording:
    """The messages of a file, or of the files of a folder one after the other."""
    files = parts_of(path) if path.is_dir() else [path]
    parts = [_OPENERS[magic](file) for file in files if (magic := _magic(file))]
    if len(parts) == 1:
        return parts[0]

    def read(recording: Recording, names: Collection[str] | None) -> Iterator[Recorded]:
        for part in parts:
            for message in part.messages(names):
                recording.topics.setdefault(message.topic.name, message.topic)
                yield message
            recording.notes |= {f"{part.source}: {text}": note for text, note in part.notes.items()}

    return Recording(path.name, read)


def parts_of(folder: Path) -> list[Path]:
    """The files of a recording in a folder, in the order in which they were written; none where it is no such folder.

    Raises:
        InputError: files that are compressed as a whole.
    """
    try:
        files = sorted((path for path in folder.iterdir() if path.name.endswith(ENDINGS[:2])), key=_part)
        packed = [path for path in folder.iterdir() if path.name.endswith(tuple(f"{end}.zstd" for end in ENDINGS))]
        described = (folder / _METADATA).exists()
    except OSError as error:
        raise InputError(f"{folder}: cannot be read ({error.strerror}); check its permissions") from error
    if packed and described:
        raise InputError(f"{packed[0]} is compressed as a whole; unpack it first: zstd -d --rm {packed[0]}")
    whole = described or all(path.stem.startswith(folder.resolve().name) for path in files)
    return [path for path in files if _magic(path)] if whole else []


def _part(path: Path) -> tuple[int, str]:
    """Number of a file among those of a recording: `run_10.mcap` comes after `run_9.mcap`."""
    number = path.stem.rpartition("_")[2]
    return (int(number) if number.isdecimal() else -1, path.name)


def _magic(path: Path) -> bytes | None:
    """The first bytes of a file, as far as they tell a format; None for a database of something else."""
    with path.open("rb") as stream:
        head = stream.read(max(map(len, _OPENERS)))
    magic = next((magic for magic in _OPENERS if head.startswith(magic)), None)
    return None if magic == sqlite_file.MAGIC and not sqlite_file.is_bag(path) else magic
