"""Machine code on disk for later processes, in entries that only their user can have written.

Whoever can write an entry decides what runs here; its checksum detects damage, not malice. So the folder belongs to the
user and is made for the user alone (mode 700), a folder or entry that others own or may write is not used, and links
are not followed. Entries are written to a temporary file and renamed, so several processes may write at once. Without
such a folder, there is one warning and every process compiles for itself.
"""

from __future__ import annotations

import hashlib
import os
import secrets
import stat
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import NamedTuple

#: Largest number of entries, about 40 kB each; beyond it the oldest are removed. The parameters of a battery are
#: constants of its program, so every battery has its own entry.
MOST_ENTRIES = 1000

#: Bytes of a SHA-256.
_DIGEST = 32

#: Write permission of the group and of everybody.
_OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH

#: Systems with owners and modes open files relative to a folder that was checked; on others the user's own folder of
#: application data is protected by its access list.
_POSIX = os.name == "posix"
_NO_LINK = os.O_NOFOLLOW if _POSIX else os.O_BINARY  # type: ignore[attr-defined,unused-ignore]


class UnsafeFolderError(OSError):
    """Others own or may write the folder or an entry."""


class OpenFolder(NamedTuple):
    """A folder that was checked."""

    path: Path  #: its name
    handle: int | None  #: descriptor of the open folder, so that it cannot be exchanged; None where the system has none

    def place(self, name: str) -> str:
        """Path of an entry for calls that take `dir_fd`."""
        return name if self.handle is not None else str(self.path / name)


def folder() -> Path:
    """Folder of compiled programs: OHMWARD_CACHE, else one in the user's cache folder.

    Raises:
        OSError: OHMWARD_CACHE is not set and the user has no home.
    """
    if named := os.environ.get("OHMWARD_CACHE"):
        return Path(named)
    try:
        base = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA") or Path.home() / ".cache"
    except RuntimeError as error:
        raise FileNotFoundError(0, "this user has no home folder") from error
    return Path(base) / "ohmward"


def cached(key: str, make: Callable[[], bytes]) -> bytes:
    """Code of a key: from an intact, safe entry of the folder, else from `make` and then stored as the entry."""
    name = f"{key}.o"
    try:
        with _opened(folder()) as cache_folder:
            found = _read(cache_folder, name)
    except OSError as error:
        _warn(error)
        return make()
    if found is not None:
        return found
    code = make()
    try:
        with _opened(folder()) as cache_folder:
            _write(cache_folder, name, hashlib.sha256(code).digest() + code)
            _prune(cache_folder)
    except OSError as error:
        _warn(error)
    return code


def is_cached(key: str) -> bool:
    """True where the folder has an intact, safe entry of a key."""
    try:
        with _opened(folder()) as cache_folder:
            return _read(cache_folder, f"{key}.o") is not None
    except OSError:
        return False


@contextmanager
def _opened(path: Path) -> Iterator[OpenFolder]:
    """The folder, made where it is missing, open and checked.

    Raises:
        OSError: it cannot be made or read. UnsafeFolderError: others own it or may write to it.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    path.mkdir(mode=0o700, exist_ok=True)
    if not _POSIX:
        yield OpenFolder(path, None)
        return
    handle = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        _require_own(handle)
        yield OpenFolder(path, handle)
    finally:
        os.close(handle)


def _require_own(handle: int) -> None:
    """Refuse an open file or folder that others own or may write.

    Raises:
        UnsafeFolderError: others own it or may write to it.
    """
    if not _POSIX:
        return
    found = os.fstat(handle)
    if found.st_uid != os.geteuid():
        raise UnsafeFolderError(0, "another user owns it")
    if found.st_mode & _OTHERS_WRITE:
        raise UnsafeFolderError(0, "other users may write to it")


def _read(cache_folder: OpenFolder, name: str) -> bytes | None:
    """Code of an entry; None where it is missing, damaged, a link, or not the user's own."""
    try:
        handle = os.open(cache_folder.place(name), os.O_RDONLY | _NO_LINK, dir_fd=cache_folder.handle)
    except OSError:
        return None
    with os.fdopen(handle, "rb") as file:
        try:
            _require_own(handle)
            content = file.read()
        except OSError:
            return None
    code = content[_DIGEST:]
    return code if hashlib.sha256(code).digest() == content[:_DIGEST] else None


def _write(cache_folder: OpenFolder, name: str, content: bytes) -> None:
    """Write an entry, which is then either complete or unchanged."""
    temporary = f"{name}.{secrets.token_hex(4)}.part"
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | _NO_LINK
    place, final = cache_folder.place(temporary), cache_folder.place(name)
    with os.fdopen(os.open(place, flags, 0o600, dir_fd=cache_folder.handle), "wb") as file:
        file.write(content)
    os.replace(place, final, src_dir_fd=cache_folder.handle, dst_dir_fd=cache_folder.handle)


def _prune(cache_folder: OpenFolder) -> None:
    """Remove the oldest entries when there are too many, a quarter of them at once."""
    entries = list(cache_folder.path.glob("*.o"))
    if len(entries) <= MOST_ENTRIES:
        return
    for old in sorted(entries, key=_written)[: len(entries) - 3 * MOST_ENTRIES // 4]:
        old.unlink(missing_ok=True)


def _written(path: Path) -> float:
    """Time at which a file was written; 0 for one that another process has removed."""
    try:
        return path.lstat().st_mtime
    except OSError:
        return 0.0


def _warn(error: OSError) -> None:
    """Warn once that every process has to compile its programs, and why."""
    try:
        place = f"in {folder()}"
    except OSError:
        place = "for this user"
    warn_once(
        f"compiled programs cannot be kept {place} ({error.strerror}); name a folder of your own, that nobody else may "
        "write to, in OHMWARD_CACHE; until then every start compiles again"
    )


@cache
def warn_once(what: str) -> None:
    """Warn, but only once in a process with the same text."""
    warnings.warn(what, RuntimeWarning, stacklevel=2)
