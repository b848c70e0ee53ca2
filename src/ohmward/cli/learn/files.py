"""Battery files that a run of `ohmward learn` reads and writes: one, or one for each serial number."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass, field, replace
from pathlib import Path

from ohmward.battery.battery import Battery
from ohmward.battery.file import load_battery, replace_battery
from ohmward.cli.outcome import check_output
from ohmward.errors import InputError


@dataclass
class BatteryFiles:
    """The batteries of a run by the files that they are written to."""

    start: Battery  #: what is known of each battery that has no file yet
    output: Path | None  #: the file, or the folder of one file for each serial number; None writes none
    #: each battery by its file, when it was opened and now; "" is the file of a run without output
    before: dict[str, Battery] = field(default_factory=dict)
    after: dict[str, Battery] = field(default_factory=dict)

    @property
    def one_for_each(self) -> bool:
        """True where each serial number has a file of its own."""
        return self.output is not None and self.output.is_dir()

    def open(self, serial_number: str) -> str:
        """Key of the battery with this serial number, "" where a log has none; its file is read if there is one.

        Raises:
            InputError: the log is of another battery than the file, or has no serial number to choose a file by.
        """
        key = self._key(serial_number)
        self._load(key, serial_number)
        own = self.after[key].serial_number
        if serial_number and own and serial_number != own:
            raise InputError(
                f"this is not the battery of the file: the log is of serial number {serial_number}, the file of {own}; "
                "a folder as --output takes a file for each"
            )
        if serial_number and not own:
            self.after[key] = replace(self.after[key], serial_number=serial_number)
        return key

    def restore(self, key: str, battery: Battery) -> None:
        """Put the battery of an interrupted run in its place."""
        self._load(key, battery.serial_number)
        self.after[key] = battery

    def _key(self, serial_number: str) -> str:
        """Path of the file of the battery with this serial number."""
        if not self.one_for_each:
            return "" if self.output is None else str(self.output)
        assert self.output is not None
        if not serial_number:
            raise InputError("the log has no serial number, by which the file in the folder could be chosen")
        return str(self.output / f"{re.sub(r'[^A-Za-z0-9._-]', '_', serial_number)}.toml")

    def _load(self, key: str, serial_number: str) -> None:
        """Take up the battery of a file, once; in a folder the file that is there goes on from where it stands."""
        if key in self.after:
            return
        if self.one_for_each:
            known = load_battery(key) if Path(key).exists() else replace(self.start, serial_number=serial_number)
        else:
            known = self.start
        self.before[key] = self.after[key] = known

    def write(self) -> dict[str, str | None]:
        """Write every file whose battery has changed or that is not there; each with the path of the one before."""
        written: dict[str, str | None] = {}
        for key, battery in self.after.items():
            if key and (battery != self.before[key] or not Path(key).exists()):
                backup = replace_battery(battery, key)
                written[key] = None if backup is None else str(backup)
        return written


def open_files(start: Battery, output: str | None, inputs: list[str]) -> BatteryFiles:
    """The files of a run; output: a .toml file, or a folder, which is made where it ends with a separator.

    Raises:
        InputError: neither; or the file cannot be written.
    """
    if output is None:
        return BatteryFiles(start, None)
    path = Path(output)
    if output.endswith((os.sep, "/")) and not path.exists():
        path.mkdir(parents=True)
    if not path.is_dir():
        check_output("--output", output, (".toml",), inputs)
    return BatteryFiles(start, path)
