"""Atomic writing of files: a file is either complete or unchanged."""

from __future__ import annotations

import errno
import os
import secrets
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from glob import escape
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO, TextIO

from ohmward.errors import OhmwardError

try:
    import fcntl
except ImportError:  # Windows: files left behind by a killed process stay
    fcntl = None  # type: ignore[assignment]


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary file beside `path` to write to; synced and renamed to `path` on success, removed on an error.

    An existing file keeps its mode, and a link the file that it points at.
    A temporary file left behind by a killed process is removed at the next write of `path`.

    Raises:
        OhmwardError: the operating system refused (disk full, no permission, no such folder); `path` is unchanged.
    """
    path = Path(os.path.realpath(path))
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(4)}.part")
    try:
        with _locked(temporary):
            _remove_abandoned(path)
            yield temporary
            _sync(temporary)
            if path.exists():
                with suppress(OSError):  # a file system without modes
                    shutil.copymode(path, temporary)
            temporary.replace(path)
        _sync(path.parent)
    except OSError as error:
        raise _refused(path, error) from error
    finally:
        temporary.unlink(missing_ok=True)


#: Suffix of the backup of a file: battery.toml.bak.
BACKUP_SUFFIX = ".bak"


def back_up(path: Path) -> Path | None:
    """Back up a file beside it before it is overwritten; returns the path of the backup, None where there is no file.

    Raises:
        OhmwardError: it cannot be written.
    """
    if not path.exists():
        return None
    backup = path.with_name(path.name + BACKUP_SUFFIX)
    text = path.read_bytes()
    with replacing(backup) as temporary:
        temporary.write_bytes(text)
    with suppress(OSError):  # a file system without modes
        shutil.copymode(path, backup)
    return backup


def write_text(path: Path, text: str | Iterable[str]) -> None:
    """Write a text, or its pieces, in UTF-8 with line feeds; the file is complete or unchanged.

    Raises:
        OhmwardError: see `replacing`.
    """
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8", newline="\n") as file:
        file.writelines([text] if isinstance(text, str) else text)


def require_writable(path: Path) -> None:
    """Raise OhmwardError unless a file can be written, in folders that may be missing; leaves nothing behind."""
    found = next(place for place in (path, *path.absolute().parents) if place.exists())
    try:
        if found == path:
            path.open("ab").close()
        else:
            TemporaryFile(dir=found).close()
    except OSError as error:
        raise _refused(path, error) from error


def open_to_append(path: Path) -> TextIO:
    """A file of lines, opened to append to; an unfinished last line is terminated.

    Raises:
        OSError: it cannot be opened.
    """
    file = path.open("a", encoding="utf-8")
    if path.is_file() and path.stat().st_size and _last_byte(path) != b"\n":
        file.write("\n")
    return file


#: File by which a process holds a folder.
LOCK = "lock"


def held_folder(path: Path, setting: str) -> TextIO:
    """Make a folder, and hold it for this process for as long as the returned file is open.

    setting: names the folder in a setup.

    Raises:
        OhmwardError: it cannot be made, or another process holds it.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
        file = (path / LOCK).open("a", encoding="utf-8")
        if fcntl:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        file.close()
        fix = f"end it, or give this one a folder of its own: {setting} = ..."
        raise OhmwardError(f"another process uses the folder {str(path)!r}; {fix}") from error
    except OSError as error:
        reason = error.strerror or error
        raise OhmwardError(
            f"{setting} = {str(path)!r} cannot be used ({reason}); choose a folder that takes files"
        ) from error
    return file


def _last_byte(path: Path) -> bytes:
    with path.open("rb") as file:
        file.seek(-1, os.SEEK_END)
        return file.read()


@contextmanager
def _locked(temporary: Path) -> Iterator[None]:
    """Create the temporary file, locked for as long as its writer runs where the system has locks."""
    with temporary.open("xb") as file:
        if not fcntl:
            file.close()  # an open file could not be renamed
        with suppress(OSError):  # a file system without locks
            _lock(file)
        yield


def _lock(file: IO[bytes]) -> None:
    """Lock an open file.

    Raises:
        OSError: another process holds the lock, or the system has none.
    """
    if not fcntl:
        raise OSError(errno.ENOTSUP, "no locks")
    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


def _remove_abandoned(path: Path) -> None:
    """Remove temporary files of `path` that no process has locked."""
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
