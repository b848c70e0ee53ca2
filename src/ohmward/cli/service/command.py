"""`ohmward service`: the process on the robot as a service of systemd."""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import warnings
from pathlib import Path

from ohmward.atomic import write_text
from ohmward.cli import wording
from ohmward.cli.outcome import Outcome
from ohmward.cli.service.unit import obstacles, unit
from ohmward.errors import InputError

#: Folder of the units that belong to this machine, and the unit.
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
    """Write the unit; what was there before stays, beside it.

    Raises:
        InputError: another unit is there, and nobody said to replace it.
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
    said = [
        f"{path} is written. Then:",
        "  sudo systemctl daemon-reload",
        "  sudo systemctl enable --now ohmward      begin now and at every start of the machine",
        "  systemctl status ohmward                 charge, and what is not in order",
        "  journalctl -u ohmward -f                 its log",
    ]
    return Outcome({}, wording.paragraphs("\n".join(said), "\n".join(notes)), notes)


def verify(path: Path) -> list[str]:
    """Faults of the unit as systemd finds them; [] also where there is no systemd-analyze."""
    if not (program := shutil.which("systemd-analyze")):
        return []
    done = subprocess.run([program, "verify", str(path)], capture_output=True, text=True, timeout=60, check=False)
    return [line for line in done.stderr.splitlines() if NAME in line]
