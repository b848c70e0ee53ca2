"""Logs as they are named on a command line: files, rows of files, patterns and folders."""

from __future__ import annotations

import glob
from collections.abc import Sequence
from pathlib import Path

from ohmward.cli.parser import split_selection
from ohmward.errors import InputError

#: Endings of logs in a folder.
_ENDINGS = (".csv", ".csv.gz", ".tsv", ".parquet")


def log_files(words: Sequence[str]) -> list[str]:
    """The logs that the words name, each once: patterns and folders in the order of their names.

    Raises:
        InputError: a word names nothing.
    """
    return list(dict.fromkeys(text for word in words for text in _named(word)))


def _named(word: str) -> list[str]:
    """A file or rows of it as they are; the files of a folder or of a pattern."""
    if split_selection(word)[0].is_file():
        return [word]
    if Path(word).is_dir():
        found = [str(path) for path in sorted(Path(word).rglob("*")) if path.name.lower().endswith(_ENDINGS)]
        if not found:
            raise InputError(f"the folder {word!r} holds no log ({', '.join(_ENDINGS)}); name the files")
        return found
    found = sorted(path for path in glob.glob(word, recursive=True) if Path(path).is_file())  # noqa: PTH207 absolute too
    if not found:
        raise InputError(f"no file matches {word!r}; check the path, and quote a pattern for the shell")
    return found
