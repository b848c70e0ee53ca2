"""Several sources of a log that are not one file: standard input, pipes, a folder of files."""

from __future__ import annotations

import atexit
import re
import shutil
import stat
import sys
import tempfile
from collections.abc import Callable, Collection, Sequence
from pathlib import Path

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.columns import listed
from ohmward.logs.note import Note, counted
from ohmward.logs.table import Progress, Table, TableFile, row_numbers

STANDARD_INPUT = "-"
#: Name of what came through standard input or a pipe.
_STREAM = "standard input"


def is_stream(path: Path) -> bool:
    """True for `-` and for pipes, which can be read but once."""
    if str(path) == STANDARD_INPUT:
        return True
    try:
        mode = path.stat().st_mode
    except OSError:
        return False
    return stat.S_ISFIFO(mode) or stat.S_ISCHR(mode) or stat.S_ISSOCK(mode)


def stored(path: Path) -> Path:
    """A file with the bytes of a stream, which lasts as long as the process.

    Raises:
        InputError: nothing came.
    """
    folder = Path(tempfile.mkdtemp(prefix="ohmward-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    copy = folder / _STREAM
    with copy.open("wb") as target:
        if str(path) == STANDARD_INPUT:
            shutil.copyfileobj(sys.stdin.buffer, target)
        else:
            with path.open("rb") as source:
                shutil.copyfileobj(source, target)
    if not copy.stat().st_size:
        raise InputError(f"{_STREAM} is empty; a log needs a header line and rows below it")
    return copy


def open_folder(folder: Path, endings: Sequence[str], open_file: Callable[[Path], TableFile]) -> TableFile:
    """The files of a folder as one log, in the order of their names, numbers in them counted.

    endings: of the files that are logs.  open_file: opens one of them.

    Raises:
        InputError: no file, or files with other columns.
    """
    paths = sorted((path for path in folder.iterdir() if path.name.lower().endswith(tuple(endings))), key=_natural)
    if not paths:
        raise InputError(f"{folder} is a folder; name one log file in it: none is called {', '.join(endings)}")
    files = [open_file(path) for path in paths]
    name = folder.resolve().name
    first = files[0]
    for file in files[1:]:
        if file.names != first.names:
            other = sorted(set(file.names) ^ set(first.names))
            raise InputError(
                f"{folder}: the files of this folder are not one log: {file.source} has other columns than "
                f"{first.source} ({listed(other)}); name one log file"
            )

    def load(names: Collection[str], progress: Progress | None = None) -> Table:
        tables = [file.load(names, progress) for file in files]
        columns = {name: np.concatenate([table.columns[name] for table in tables]) for name in tables[0].columns}
        rows = sum(table.line.size for table in tables)
        note = Note(f"{counted(len(files), 'file')} as one log, {first.source} to {files[-1].source}")
        notes = tuple(dict.fromkeys(note for table in tables for note in table.notes))
        return Table(name, columns, row_numbers(1, rows), "row", (note, *notes))

    return first._replace(source=name, load=load)


def _natural(path: Path) -> list[tuple[int, int | str]]:
    """Key by which part 9 comes before part 10."""
    return [(1, int(part)) if part.isdecimal() else (0, part) for part in re.split(r"(\d+)", path.name)]
