"""Logs as they are named on a command line: files, rows of files, patterns and folders."""

from __future__ import annotations

import glob
from collections.abc import Sequence
from pathlib import Path

from ohmward.errors import InputError
from ohmward.logs.bags.bag_table import ENDINGS as RECORDINGS
from ohmward.logs.bags.bag_table import parts_of
from ohmward.logs.selection import split_selection

#: Endings of logs in a folder.
_ENDINGS = (".csv", ".csv.gz", ".tsv", ".parquet", ".ulg", *RECORDINGS)


def log_files(words: Sequence[str]) -> list[str]:
    """The logs that the words name, each once: patterns and folders in the order of their names.

    Raises:
        InputError: a word names nothing.
    """
    return list(dict.fromkeys(text for word in words for text in _named(word)))


def _named(word: str) -> list[str]:
    """A file, a recording's folder or rows of one as they are; the files of a folder or of a pattern."""
    path = split_selection(word)[0]
    if path.is_file() or (path.is_dir() and parts_of(path)):
        return [word]
    if path.is_dir():
        files = [file for file in sorted(path.rglob("*")) if file.name.lower().endswith(_ENDINGS)]
        if not files:
            raise InputError(f"the folder {word!r} holds no log ({', '.join(_ENDINGS)}); name the files")
        return list(dict.fromkeys(_recording_of(file, path) for file in files))
    found = sorted(name for name in glob.glob(word, recursive=True) if Path(name).is_file())  # noqa: PTH207 absolute too
    if not found:
        raise InputError(f"no file matches {word!r}; check the path, and quote a pattern for the shell")
    return found


def _recording_of(file: Path, folder: Path) -> str:
    """The folder of the recording that a file is a part of, else the file."""
    inner = file.parent != folder and file.name.endswith(RECORDINGS) and file in parts_of(file.parent)
    return str(file.parent if inner else file)
