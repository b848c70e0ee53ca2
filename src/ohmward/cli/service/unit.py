"""Unit of systemd for `ohmward run`, and what would keep it from running."""

from __future__ import annotations

import stat
import sys
import unicodedata
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

from ohmward.errors import InputError
from ohmward.onboard.robot_setup import SETUP_FILE, Setup

#: Where the unit keeps its state: `StateDirectory` of ohmward.service, seen from outside and from inside.
STATE = Path("/var/lib/ohmward")

#: Where the unit reads its secrets from: `EnvironmentFile` of ohmward.service.
SECRETS = "/etc/ohmward/environment"

#: Folders that `ProtectHome=yes` and `PrivateTmp=yes` hide.
_HIDDEN = (Path("/home"), Path("/root"), Path("/run/user"), Path("/tmp"), Path("/var/tmp"))


def unit(setup: Path) -> str:
    """The unit that runs a setup with the Python that runs now.

    Raises:
        InputError: a path holds a control character, such as a line break, which would write lines of its own.
    """
    script = Path(sys.executable).with_name("ohmward")
    program = [str(script)] if script.exists() else [sys.executable, "-m", "ohmward.cli"]
    words = [*program, "run", str(setup)]
    for word in words:
        if any(unicodedata.category(character) == "Cc" for character in word):
            raise InputError(f"{word!r} holds a control character, which no unit of systemd can; rename it")
    text = files("ohmward.cli.service").joinpath("ohmward.service").read_text(encoding="utf-8")
    return Template(text).substitute(command=" ".join(map(_quoted, words)), setup=str(setup).replace("%", "%%"))


def _quoted(word: str) -> str:
    """A word of ExecStart: specifiers and variables stay as they are written."""
    escaped = word.replace("\\", "\\\\").replace('"', '\\"').replace("%", "%%").replace("$", "$$")
    return f'"{escaped}"' if any(c.isspace() or c in "\"'\\;" for c in word) else escaped


def obstacles(setup: Path) -> list[str]:
    """Sentences with the fix: what the service could not read or write."""
    found = []
    python = [path for path in (Path(sys.executable), Path(sys.executable).resolve()) if is_hidden(path)]
    if python:
        found.append(
            f"a service does not see {python[0]}, which runs this, nor anything in homes and /tmp; install from "
            "the clone with a system Python: sudo python3 -m venv /opt/ohmward && sudo /opt/ohmward/bin/pip install ."
        )
    if is_hidden(setup):
        found.append(f"a service does not see {setup}, nor anything in homes and /tmp; move it to /etc/ohmward")
    if not setup.exists():
        return [*found, f"there is no {setup}; `ohmward run --example` prints one"]
    if not setup.stat().st_mode & stat.S_IROTH:
        found.append(f"the service has a user of its own, which may not read {setup}; chmod 644 {setup}")
    try:
        content = SETUP_FILE.load(setup)
    except InputError as error:
        return [*found, str(error)]
    return [*found, *_paths(content, setup.parent), *_secrets(content)]


def is_hidden(path: Path) -> bool:
    """True where the service does not see a path."""
    return any(folder in path.absolute().parents for folder in _HIDDEN)


def _paths(content: Setup, folder: Path) -> list[str]:
    """Paths of a setup that mean another place in the service, whose folder is that of its state."""
    found = []
    for key in ("battery", "robot"):
        given = getattr(content, key)
        if given and not Path(given).is_absolute() and (folder / given).is_file():
            found.append(f'{key} = "{given}" would be looked for in {STATE}; write {key} = "{folder / given}"')
    for key in ("state", "consumption"):
        given = getattr(content, key)
        if given and Path(given).is_absolute() and STATE not in (Path(given), *Path(given).parents):
            found.append(f'{key} = "{given}": the service writes in {STATE} alone; write {key} = "{Path(given).name}"')
    return found


def _secrets(content: Setup) -> list[str]:
    """Secrets in files of mode 600, which only their owner may read and not the service's user."""
    parts: tuple[Any, ...] = (*content.source, *content.sink)
    return [
        f'{part.name}: {key} = "{value}" is a file of another user; write NAME=SECRET into {SECRETS} (chmod 600), '
        f'which systemd reads, and {key} = "NAME"'
        for part in parts
        for key, value in vars(part).items()
        if isinstance(value, str) and value.startswith("file:")
    ]
