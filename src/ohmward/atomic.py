"""Files that are either whole or not there."""

from __future__ import annotations

import errno
import os
import secrets
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from glob import escape
from pathlib import Path
from typing import IO

from ohmward.errors import OhmwardError

try:
    import fcntl
except ImportError:  # Windows: what a killed process left there stays
    fcntl = None  # type: ignore[assignment]


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary file beside `path` to write to; on success it is synced and takes the name, on an error it goes.

    One that a killed process has left there goes with the next write of `path`.

    Raises:
        OhmwardError: the operating system refused (disk full, no permission, no such folder); `path` is as it was.
    """
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(4)}.part")
    try:
        with _locked(temporary):
            _remove_abandoned(path)
            yield temporary
            _sync(temporary)
            temporary.replace(path)
        _sync(path.parent)
    except OSError as error:
        raise _refused(path, error) from error
    finally:
        temporary.unlink(missing_ok=True)


#: What the file before is called: battery.toml.bak.
BACKUP_SUFFIX = ".bak"


def back_up(path: Path) -> Path | None:
    """Keep what a file holds beside it, before it is written over; the path of that, None where there is no file.

    Raises:
        OhmwardError: it cannot be written.
    """
    if not path.exists():
        return None
    backup = path.with_name(path.name + BACKUP_SUFFIX)
    text = path.read_bytes()
    with replacing(backup) as temporary:
        temporary.write_bytes(text)
    return backup


def write_text(path: Path, text: str | Iterable[str]) -> None:
    """Write a text, or its pieces, in UTF-8 with line feeds; the file is whole or as it was.

    Raises:
        OhmwardError: see `replacing`.
    """
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8", newline="\n") as file:
        file.writelines([text] if isinstance(text, str) else text)


@contextmanager
def _locked(temporary: Path) -> Iterator[None]:
    """The new file, locked as long as its writer lives where the system has locks."""
    with temporary.open("xb") as file:
        if not fcntl:
            file.close()  # an open file could not be renamed
        with suppress(OSError):  # a file system without locks
            _lock(file)
        yield


def _lock(file: IO[bytes]) -> None:
    """Lock an open file.

    Raises:
        OSError: another one holds it, or there are no locks here.
    """
    if not fcntl:
        raise OSError(errno.ENOTSUP, "no locks")
    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


def _remove_abandoned(path: Path) -> None:
    """Remove temporary files of `path` that nobody holds."""
    for left in path.parent.glob(f".{escape(path.name)}.????????.part"):
        with suppress(OSError), left.open("rb") as file:
            _lock(file)
            left.unlink()


def _sync(path: Path) -> None:
    """Wait until the file or folder is on the disk; not every system can sync a folder."""
    if path.is_dir() and os.name == "nt":
        return
    handle = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _refused(path: Path, error: OSError) -> OhmwardError:
    return OhmwardError(f"{path}: cannot be written ({error.strerror or error}); free space or choose another folder")
