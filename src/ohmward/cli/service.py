"""`ohmward service`: the process on the robot as a service of systemd."""

from __future__ import annotations

import argparse
import os
import shutil
import stat
import subprocess
import sys
import unicodedata
import warnings
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

from ohmward.atomic import write_text
from ohmward.cli.outcome import Outcome
from ohmward.cli.wording import paragraphs
from ohmward.errors import InputError
from ohmward.onboard.robot_setup import SETUP_FILE, Setup

#: Folder of this machine's units, and name of the unit.
UNITS = Path("/etc/systemd/system")
NAME = "ohmward.service"


def run(args: argparse.Namespace) -> Outcome:
    """Print the unit, or write it where systemd finds it."""
    setup = Path(args.setup).absolute()
    found = obstacles(setup)
    if args.print:
        for sentence in found:
            warnings.warn(sentence, stacklevel=1)
        return Outcome({}, unit(setup).rstrip())
    _check_machine()
    if found:
        raise InputError("; ".join(found))
    return install(unit(setup), UNITS / NAME, replace=args.replace)


def _check_machine() -> None:
    """Raise InputError unless a unit can be written here."""
    if not UNITS.is_dir():
        raise InputError(f"this machine has no {UNITS}: no systemd; `--print` prints the unit for one that has")
    if os.geteuid() != 0:
        raise InputError(
            f"only root writes into {UNITS}; sudo ohmward service install, or `ohmward service install --print > "
            f"{NAME}` and copy it there"
        )


def install(text: str, path: Path, *, replace: bool) -> Outcome:
    """Write the unit; a previous one is kept beside it.

    Raises:
        InputError: a different unit is there, and `replace` is False.
    """
    notes = []
    if path.exists() and (before := path.read_text(encoding="utf-8")) != text:
        if not replace:
            raise InputError(f"{path} is there already and differs; --replace replaces it, or remove it yourself")
        set_aside = path.with_name(f"{path.name}.before")
        write_text(set_aside, before)
        notes.append(f"{path} was there and differed: it is {set_aside} now")
    write_text(path, text)
    path.chmod(0o644)
    notes += [f"systemd-analyze verify: {line}" for line in verify(path)]
    done = [
        f"{path} is written. Then:",
        "  sudo systemctl daemon-reload",
        "  sudo systemctl enable --now ohmward      start now and at every boot",
        "  systemctl status ohmward                 charge, and what is not in order",
        "  journalctl -u ohmward -f                 its log",
    ]
    return Outcome({}, paragraphs("\n".join(done), "\n".join(notes)), notes, has_notes=True)


def verify(path: Path) -> list[str]:
    """Faults that systemd finds in the unit; [] also where there is no systemd-analyze."""
    if not (program := shutil.which("systemd-analyze")):
        return []
    done = subprocess.run([program, "verify", str(path)], capture_output=True, text=True, timeout=60, check=False)
    return [line for line in done.stderr.splitlines() if NAME in line]


#: Folder of the unit's state, seen from outside and from inside: `StateDirectory` of ohmward.service.
STATE = Path("/var/lib/ohmward")

#: File from which the unit reads its secrets: `EnvironmentFile` of ohmward.service.
SECRETS = "/etc/ohmward/environment"

#: Folders that `ProtectHome=yes` and `PrivateTmp=yes` hide.
_HIDDEN = (Path("/home"), Path("/root"), Path("/run/user"), Path("/tmp"), Path("/var/tmp"))


def unit(setup: Path) -> str:
    """The unit that runs a setup with the current Python.

    Raises:
        InputError: a path holds a control character, such as a line break, which would add lines to the unit.
    """
    script = Path(sys.executable).with_name("ohmward")
    program = [str(script)] if script.exists() else [sys.executable, "-m", "ohmward"]
    words = [*program, "run", str(setup)]
    for word in words:
        if any(unicodedata.category(character) == "Cc" for character in word):
            raise InputError(f"{word!r} holds a control character, which no unit of systemd can; rename it")
    text = files("ohmward.cli").joinpath("ohmward.service").read_text(encoding="utf-8")
    return Template(text).substitute(command=" ".join(map(_quoted, words)), setup=str(setup).replace("%", "%%"))


def _quoted(word: str) -> str:
    """A word of ExecStart, escaped so that systemd leaves specifiers and variables as they are written."""
    escaped = word.replace("\\", "\\\\").replace('"', '\\"').replace("%", "%%").replace("$", "$$")
    return f'"{escaped}"' if any(c.isspace() or c in "\"'\\;" for c in word) else escaped


def obstacles(setup: Path) -> list[str]:
    """Sentences on what the service could not read or write, each with the fix."""
    found = []
    python = [path for path in (Path(sys.executable), Path(sys.executable).resolve()) if is_hidden(path)]
    if python:
        found.append(
            f"a service does not see {python[0]}, which runs this, nor anything in homes and /tmp; install "
            "from the clone with a system Python: sudo python3 -m venv /opt/ohmward && "
            "sudo /opt/ohmward/bin/pip install '.[page]'"
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
    """Paths of a setup that fail in the service, which runs in the folder of its state and writes only there."""
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
