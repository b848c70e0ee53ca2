"""Folder of what survives a loss of power: snapshots, the consumption table, a learnt battery file.

snapshot.json            every few seconds, with the previous one beside it
consumption.toml         every minute and at the end
battery.toml             with `learn`: the battery file in use, as learnt up to the last day
battery-learnt.toml      with `learn`: as learnt up to now; in use after an absence of more than an hour
battery-given.txt        digest of the battery file that both began with

Snapshot file: the newest state of the estimators on the disk, and the one before it.

Power may be lost at any instant. The text goes to a temporary file, which is synced to the disk and renamed in one
step; the previous snapshot keeps a name of its own, in case a disk tears its last write nevertheless. A checksum shows
which files are intact.
"""

from __future__ import annotations

import asyncio
import hashlib
import json
import math
import os
from collections.abc import Awaitable, Callable, Mapping
from contextlib import suppress
from copy import copy
from dataclasses import replace
from pathlib import Path
from typing import Any

from ohmward.atomic import back_up, held_folder, write_text
from ohmward.battery.battery import Battery
from ohmward.battery.file import load_battery, save_battery
from ohmward.battery.learning.on_board import learnt_on_board
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.energy.consumption import Consumption
from ohmward.energy.consumption_file import load_consumption, save_consumption
from ohmward.errors import InputError, OhmwardError
from ohmward.onboard.clock import SystemClock
from ohmward.onboard.estimation import Estimation
from ohmward.onboard.part import LOG
from ohmward.onboard.resume import DRIVE_S, remember, resume
from ohmward.quantities import FIRST_DATE_S
from ohmward.trace.snapshot import require_seal, require_version, sealed, typed

NAME, PREVIOUS = "snapshot.json", "snapshot-previous.json"

#: Time between two snapshots: the most that a loss of power costs, and what an SD card can bear for years.
SNAPSHOT_S = 5.0

#: Time between two consumption tables, and between two learnt battery files.
TABLE_S, LEARNT_S = 60.0, 3600.0

#: What identifies a computer: its board, which a copied disk does not bring along, and its system.
_COMPUTER = (Path("/proc/device-tree/serial-number"), Path("/sys/class/dmi/id/product_uuid"), Path("/etc/machine-id"))

IN_USE, LEARNT, CONSUMPTION = "battery.toml", "battery-learnt.toml", "consumption.toml"
GIVEN = "battery-given.txt"


class StateFolder:
    """The folder of one robot.

    Args:
        path: of the folder; created if missing.
        consumption: path of the consumption table; by default in the folder.
        learn: keep a learnt battery file.
        clock: of this machine.
        live: True for the state of a robot, False for a replay or a simulation.

    Raises:
        OhmwardError: it cannot be created, another process uses it, or a replay would overwrite the state of a robot.
    """

    def __init__(
        self,
        path: Path,
        consumption: Path | None = None,
        learn: bool = False,
        clock: SystemClock | None = None,
        live: bool = True,
    ):
        self.path, self.learn, self.clock, self.live = path, learn, clock or SystemClock(), live
        self.consumption_path = consumption or path / CONSUMPTION
        self._held = held_folder(path, "state")
        self.before, note = read_snapshot(path)
        self.notes = [note] if note else []
        if self.before and self.before.get("live", True) != live:
            self._start_over()
        self._leave_other_computer()
        self.away_s = self._away_s()
        self._swaps = 0

    def battery(self, given: str) -> Battery:
        """The battery to use: from the learnt file, unless the given one has changed since.

        Raises:
            InputError: it cannot be read.
            OhmwardError: the folder cannot be written.
        """
        in_use, learnt, source = self.path / IN_USE, self.path / LEARNT, Path(given)
        battery = load_battery(source)
        if not self.learn:
            return battery
        digest = hashlib.sha256(source.read_bytes()).hexdigest()
        noted = self.path / GIVEN
        before = noted.read_text(encoding="ascii", errors="replace") if noted.exists() else ""
        if before not in ("", digest):
            self._forget_learnt()
            self.notes.append(f"{given} has changed: it is used, and what was learnt with the one before is forgotten")
        if before != digest:  # a disk that is full by now is no reason to refuse
            write_text(noted, digest)
        if learnt.exists() and self.before and not self.away_s <= DRIVE_S:
            learnt.replace(in_use)
        if not in_use.exists():
            return battery
        try:
            return load_battery(in_use)
        except InputError as error:
            self.notes.append(f"{error}; {given} is used")
            return battery

    def consumption(self) -> tuple[Consumption | None, float]:
        """The consumption as learnt on earlier days, None before the first, and the days since then.

        Raises:
            InputError: the table cannot be read.
        """
        if not self.consumption_path.exists():
            return None, 0.0
        table = load_consumption(self.consumption_path)
        return table, table.days_until(self.clock.unix_s()) or 0.0

    def begin(self, estimation: Estimation) -> None:
        """Continue the estimators from the last snapshot."""
        self.notes += resume(estimation, self.before, self.away_s, self.clock.now_s())
        for note in self.notes:
            LOG.warning("state: %s", note)

    def writer(self, estimation: Estimation, now_s: Callable[[], float]) -> Callable[[], Awaitable[None]]:
        """The task that writes everything periodically, and once more when it is cancelled."""

        async def write() -> None:
            table_s = learnt_s = self.clock.now_s()
            try:
                while True:  # at once: a disk that is still full after a restart is no recovery
                    self._follow_swaps(estimation)
                    await asyncio.to_thread(write_snapshot, self.path, self._content(estimation, now_s()))
                    if self.clock.now_s() - table_s > TABLE_S:
                        table_s = self.clock.now_s()
                        await asyncio.to_thread(self._write_table, estimation)
                    if self.learn and self.clock.now_s() - learnt_s > LEARNT_S:
                        learnt_s = self.clock.now_s()
                        await asyncio.to_thread(self._write_learnt, estimation.battery, copy(estimation.soc))
                    await asyncio.sleep(SNAPSHOT_S)
            finally:
                self.write(estimation, now_s())

        return write

    def write(self, estimation: Estimation, now_s: float) -> None:
        """Write everything once."""
        self._follow_swaps(estimation)
        write_snapshot(self.path, self._content(estimation, now_s))
        self._write_table(estimation)
        if self.learn:
            self._write_learnt(estimation.battery, estimation.soc)

    def close(self) -> None:
        """Release the folder."""
        self._held.close()

    def _follow_swaps(self, estimation: Estimation) -> None:
        """Forget what was learnt of a battery that has been swapped for another."""
        if estimation.swaps != self._swaps:
            self._swaps = estimation.swaps
            self._forget_learnt()

    def _forget_learnt(self) -> None:
        for name in (IN_USE, LEARNT):
            (self.path / name).unlink(missing_ok=True)

    def _start_over(self) -> None:
        """Discard a replay's state on a robot; refuse to overwrite a robot's state in a replay."""
        if not self.live:
            raise OhmwardError(
                f"state = {str(self.path)!r} is that of a robot, which a replay or a simulation would overwrite; "
                "leave state out, or name another folder"
            )
        self.before = {}
        self.notes.append(f"{self.path} is the state of a replay or a simulation: the robot starts afresh")

    def _leave_other_computer(self) -> None:
        """Discard the state of another computer, and with it what was learnt of a battery: its disk was copied."""
        before, now = self.before.get("computer"), computer()
        shared = [key for key in now if isinstance(before, dict) and key in before]
        if not (isinstance(before, dict) and shared) or before[shared[0]] == now[shared[0]]:
            return
        self.before = {}
        backups = [back_up(self.path / name) for name in (IN_USE, LEARNT)]
        self._forget_learnt()
        fix = "".join(f"; if only the computer is new: battery = {str(path)!r}" for path in backups[-1:] if path)
        self.notes.append(f"{self.path} is of another computer, as on a copied disk: the battery starts afresh{fix}")

    def _content(self, estimation: Estimation, now_s: float) -> dict[str, object]:
        origin = {"boot": boot_id(), "monotonic_s": self._since_boot_s(), "unix_s": self.clock.unix_s()}
        found = remember(estimation, now_s)
        return found | origin | {"live": self.live, "computer": computer()} if found else {}

    def _write_table(self, estimation: Estimation) -> None:
        if estimation.range and estimation.range.state.finished_m > 0.0:
            table = replace(estimation.range.consumption, last_drive_unix_s=self.clock.unix_s())
            save_consumption(table, self.consumption_path)

    def _write_learnt(self, battery: Battery | None, soc: SocEstimator | None) -> None:
        if battery and soc and soc.state is not None:
            try:
                learnt = learnt_on_board(battery, soc)
            except InputError as error:  # a filter that carries no corrections
                LOG.info("nothing is learnt on board: %s", error)
                return
            save_battery(learnt, self.path / LEARNT)

    def _since_boot_s(self) -> float:
        return self.clock.now_s() + self.clock.suspended_s()

    def _away_s(self) -> float:
        """Time since the last snapshot; nan if unknown, as on a computer whose clock stood still while it was off."""
        if not self.before:
            return math.nan
        try:
            if self.before.get("boot") == boot_id() != "":
                return max(self._since_boot_s() - typed(float, "monotonic_s", self.before.get("monotonic_s")), 0.0)
            before_s = typed(float, "unix_s", self.before.get("unix_s"))
        except InputError as error:
            self.notes.append(str(error))
            return math.nan
        away_s = self.clock.unix_s() - before_s
        is_known = self.clock.is_set() and before_s >= FIRST_DATE_S
        return away_s if is_known and 0.0 < away_s < math.inf else math.nan


def computer() -> dict[str, str]:
    """Digests of what identifies this computer, the surest first; empty if the system tells nothing."""
    found = {}
    for path in _COMPUTER:
        with suppress(OSError):
            found[path.name] = hashlib.sha256(path.read_bytes().strip(b"\0\n")).hexdigest()[:16]
    return found


def boot_id() -> str:
    """Identifier of this boot of the machine; empty if the system has none."""
    try:
        return Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii").strip()
    except OSError:
        return ""


def write_snapshot(folder: Path, content: Mapping[str, Any]) -> None:
    """Write a snapshot; the previous one stays beside it, and both stay where the new one is empty.

    Raises:
        OhmwardError: the operating system refused; the snapshots are unchanged.
    """
    if not content:
        return
    newest, previous = folder / NAME, folder / PREVIOUS
    link = folder / f".{PREVIOUS}.link"
    with suppress(OSError):  # some file systems have no links; the newest is still written in one step
        link.unlink(missing_ok=True)
        os.link(newest, link)
        link.replace(previous)
    write_text(newest, json.dumps(sealed(content), allow_nan=False))


def read_snapshot(folder: Path) -> tuple[dict[str, Any], str]:
    """The newest intact snapshot, empty without one, and what is wrong with newer ones."""
    notes: list[str] = []
    for name in (NAME, PREVIOUS):
        try:
            return _read(folder / name), "; ".join(notes)
        except FileNotFoundError:
            continue
        except (InputError, OSError, ValueError, RecursionError) as error:
            notes.append(f"{folder / name} cannot be used ({error})")
    return {}, "; ".join(notes)


def _read(path: Path) -> dict[str, Any]:
    found = json.loads(path.read_text(encoding="utf-8"))
    require_version(found)
    require_seal(found)
    return found
