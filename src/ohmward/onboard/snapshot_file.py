"""Snapshot file: the newest state of the estimators on the disk, and the one before it.

Power may be lost at any instant. The text goes to a temporary file, which is synced to the disk and takes the name in
one step; the one before keeps a name of its own, for a disk that tears its last write in spite of that. A checksum
tells which files are whole.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from ohmward.atomic import write_text
from ohmward.errors import InputError
from ohmward.trace.snapshot import require_seal, require_version, sealed

NAME, PREVIOUS = "snapshot.json", "snapshot-previous.json"


class FoundSnapshot(NamedTuple):
    """Content of the newest snapshot that is whole, None without one; note: what is wrong with a newer one."""

    content: dict[str, Any] | None
    note: str = ""


def write_snapshot(folder: Path, content: Mapping[str, Any]) -> None:
    """Write a snapshot; the one before stays beside it.

    Raises:
        OhmwardError: the operating system refused; the snapshots are as they were.
    """
    newest, previous = folder / NAME, folder / PREVIOUS
    link = folder / f".{PREVIOUS}.link"
    with suppress(OSError):  # some file systems know no links; the newest alone is written in one step too
        link.unlink(missing_ok=True)
        os.link(newest, link)
        link.replace(previous)
    write_text(newest, json.dumps(sealed(content), allow_nan=False))


def read_snapshot(folder: Path) -> FoundSnapshot:
    """The newest snapshot that is whole."""
    notes: list[str] = []
    for name in (NAME, PREVIOUS):
        try:
            return FoundSnapshot(_read(folder / name), "; ".join(notes))
        except FileNotFoundError:
            continue
        except (InputError, OSError, ValueError, RecursionError) as error:
            notes.append(f"{folder / name} cannot be used ({error})")
    return FoundSnapshot(None, "; ".join(notes))


def _read(path: Path) -> dict[str, Any]:
    found = json.loads(path.read_text(encoding="utf-8"))
    require_version(found)
    require_seal(found)
    return found
