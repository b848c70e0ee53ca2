"""Jobs of a fleet: an estimator for all of its logs side by side, or for those of each robot one after the other.

For a robot, the estimator begins each log with its estimates of charge, capacity, resistance and sensor offset at the
end of the previous one; the pause between them makes the charge less certain.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Collection, Sequence
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.chemistries import Normal
from ohmward.battery.file import BATTERY_FILE, save_battery
from ohmward.battery.health.ageing import logarithm
from ohmward.battery.health.capacity_over_logs import capacity_over_logs, shows_capacity
from ohmward.battery.learning.on_board import learnt_on_board
from ohmward.battery.log_check import check_log, read_log_of
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.battery.soc.exchange_watch import exchange_notes
from ohmward.battery.soc.fit_check import misfits
from ohmward.battery.soc.registry import DEFAULT, make_estimator
from ohmward.battery.soc.sample import INITIAL_SOC_STD, STD_OF, Estimator, SocEstimate, SocFlag
from ohmward.battery.soc.score import soc_figures
from ohmward.errors import InputError, OhmwardError
from ohmward.fleet.lanes import estimate_logs
from ohmward.fleet.run import digest_of, failed, file_name, fingerprint
from ohmward.logs import Log, write_table
from ohmward.logs.log import ReadOptions
from ohmward.logs.selection import split_selection
from ohmward.memory import reuse_freed


@dataclass(frozen=True)
class Job:
    """An estimator and its settings, the same for every log."""

    battery: str  #: text of the battery file, so that the job runs on machines without the file
    filter: str = DEFAULT  #: name of the estimator
    initial_soc: float | None = None  #: at the start of every log; None takes it from the first voltage
    initial_soc_std: float = INITIAL_SOC_STD  #: its standard deviation
    reading: ReadOptions = field(default_factory=ReadOptions)  #: options of the reader
    estimates: str | None = None  #: folder for the estimates of every log, one Parquet file each; None writes none

    @property
    def digest(self) -> str:
        """Digest of the settings, different for every job with other results."""
        return digest_of(asdict(self))

    def run(self, paths: Sequence[str]) -> list[dict[str, Any]]:
        """Rows of the logs, in the order of the paths; a log that cannot be used has its reason in `error`."""
        reuse_freed()
        battery = BATTERY_FILE.parse(self.battery)
        estimator = make_estimator(self.filter, battery)
        rows: dict[str, dict[str, Any]] = {}
        logs = self.read(paths, battery, rows, ())
        estimates = estimate_logs(estimator, list(logs.values()), self.initial_soc, self.initial_soc_std)
        for (path, log), found in zip(logs.items(), estimates, strict=True):
            rows[path] = _row(path, log, battery, estimator, found) | _written(self.estimates, path, log, found)
        return [rows[path] for path in paths]

    def read(
        self, texts: Sequence[str], battery: Battery, rows: dict[str, dict[str, Any]], extra: Collection[str] | None
    ) -> dict[str, Log]:
        """The logs that can be used, by their names; `rows` gets the others, each with its reason."""
        logs: dict[str, Log] = {}
        for text in texts:
            try:
                logs[text] = check_log(read_log_of(battery, text, self.reading, extra), battery)
            except OhmwardError as error:
                rows[text] = failed(text, str(error))
        return logs


def _row(text: str, log: Log, battery: Battery, estimator: Estimator, found: SocEstimate) -> dict[str, Any]:
    """Row of a log: its figures, None for those that the estimator does not have, and whether the battery file fits."""
    wrong = (*exchange_notes(log.time_s, found.flags), *misfits(battery, log, estimator, found))
    fit = {"error": None, "fits": not wrong, "misfit": wrong[0].text if wrong else None}
    incidents = found.flags.astype(int) & ~int(SocFlag.REST | SocFlag.ANCHORED)
    figures = {"samples": len(log), "duration_s": log.duration_s, **soc_figures(log, found)}
    figures |= {"flagged_share": float(np.mean(incidents != 0))}
    if not shows_capacity(battery, logarithm(Normal(found.soh_capacity[-1], found.soh_capacity_std[-1]), 1.0)):
        figures["soh_capacity"] = None
    return {"path": text, **fit, **{name: None if value != value else value for name, value in figures.items()}}


def _written(folder: str | None, text: str, log: Log, found: SocEstimate) -> dict[str, Any]:
    """Write the estimates of a log; the path of their file, for its row."""
    if not folder:
        return {}
    path, where = split_selection(text)
    name = file_name("-".join([path.stem, *where.values()]))
    unique = hashlib.sha256(text.encode()).hexdigest()[:8]  # logs of two folders, or of two columns, may share the name
    file = Path(folder) / f"{name}-{unique}.estimates.parquet"
    table = {"time_s": log.time_s, "soc": found.soc, "soc_std": found.soc_std, "flags": found.flags.astype(int)}
    write_table(table, file)
    return {"estimates": str(file)}


#: Assumed pause between two logs without a wall clock [s]: so long that no charge is counted over it.
UNKNOWN_PAUSE_S = 3600.0
#: Logs of one robot that overlap by more than this [s] are not of one battery.
_OVERLAP_S = 1.0


@dataclass(frozen=True)
class RobotJob:
    """An estimator and its settings, the same for every robot; its items are robots."""

    settings: Job  #: of every log; the initial state of charge is that of the first log of each robot
    robots: dict[str, list[str]]  #: robot -> its logs; "" -> those of no robot
    batteries: str | None = None  #: folder for the learnt battery file of each robot; None writes none

    @property
    def digest(self) -> str:
        """Digest of the settings, different for every job with other results; the logs are part of the items."""
        return digest_of([asdict(self.settings), self.batteries])

    @property
    def estimates(self) -> str | None:
        """Folder for the estimates of every log."""
        return self.settings.estimates

    @property
    def items(self) -> list[str]:
        """An item for each robot, which changes when its logs do."""
        return [f"{robot} {fingerprint(logs)}" for robot, logs in sorted(self.robots.items())]

    def run(self, paths: Sequence[str]) -> list[dict[str, Any]]:
        """Rows of robots, in the order of the items; if none of a robot's logs can be used, its row has an `error`."""
        return [self._robot(item) for item in paths]

    def _robot(self, item: str) -> dict[str, Any]:
        robot = item.rpartition(" ")[0]
        texts, job = self.robots[robot], self.settings
        battery = BATTERY_FILE.parse(job.battery)
        rows: dict[str, dict[str, Any]] = {}
        logs = self._read(texts, battery, rows)
        capacities: list[tuple[float, float, float]] = []
        estimator = SocEstimator(make_estimator(job.filter, battery), job.initial_soc, job.initial_soc_std)
        for text, log, start_s in logs:
            # the clock of the robot, on which the estimator counts the pause since the log before
            on_clock = replace(log, time_s=log.time_s - log.time_s[0] + start_s)
            found = estimator.run(on_clock).estimates
            last_stds = {std: float(getattr(found, std)[-1]) for std in STD_OF.values()}
            stds = {std: value if math.isfinite(value) else None for std, value in last_stds.items()}
            warnings = [note.text for note in log.notes if note.level == "warning"]
            begin_s = log.begin_unix_s
            begins = None if begin_s is None else datetime.fromtimestamp(begin_s, UTC).isoformat(timespec="seconds")
            rows[text] = {"begins": begins, **_row(text, log, battery, estimator.settings, found)}
            rows[text] |= stds | {"throughput_Ah": log.throughput_Ah(), "warnings": warnings}
            rows[text] |= _written(job.estimates, text, log, found)
            capacities.append((start_s + log.duration_s, float(found.soh_capacity[-1]), last_stds["soh_capacity_std"]))
        change = _given_all_logs([rows[text] for text, *_ in logs], capacities, battery)
        of_robot = {"robot": robot or None}
        ordered = [of_robot | rows[text] for text in dict.fromkeys([*(text for text, *_ in logs), *texts])]
        error = None if logs else f"none of its {len(texts)} logs could be used: {ordered[0]['error']}"
        learnt = self._learn(robot, battery, estimator)
        return {"path": item, "robot": robot, "error": error, "logs": ordered, **change, **learnt}

    def _read(
        self, texts: Sequence[str], battery: Battery, rows: dict[str, dict[str, Any]]
    ) -> list[tuple[str, Log, float]]:
        """The logs that can be used, in order of time, each with its name and its start since the first log [s].

        `rows` gets the others, each with its reason.
        """
        read = self.settings.read(texts, battery, rows, None)
        if all(log.start_unix_s is None for log in read.values()):
            # in the order in which they are given, with an assumed pause between them
            starts_s = accumulate((log.duration_s + UNKNOWN_PAUSE_S for log in read.values()), initial=0.0)
            return [(text, log, start_s) for (text, log), start_s in zip(read.items(), starts_s, strict=False)]
        for text, log in read.items():
            if log.start_unix_s is None:
                why = next((f" ({note.text})" for note in log.notes if "date is left out" in note.text), "")
                rows[text] = failed(text, f"{log.name}: no wall clock, but other logs of this robot have one{why}")
        dated = sorted((first, text, log) for text, log in read.items() if (first := log.begin_unix_s) is not None)
        usable: list[tuple[str, Log, float]] = []
        end_s, before = -math.inf, ""
        for first_s, text, log in dated:
            if first_s < end_s - _OVERLAP_S:
                why = "recorded twice, or of another robot (--by)?"
                rows[text] = failed(text, f"{log.name}: overlaps in time with {before} of this robot: {why}")
                continue
            usable.append((text, log, first_s - dated[0][0]))
            end_s, before = first_s + log.duration_s, log.name
        return usable

    def _learn(self, robot: str, battery: Battery, estimator: SocEstimator) -> dict[str, Any]:
        """Write the battery file that the estimator has learnt for the robot; None for one that learns nothing."""
        if self.batteries is None:
            return {"battery": None}
        path = Path(self.batteries) / f"{file_name(robot)}.toml"
        try:
            save_battery(replace(learnt_on_board(battery, estimator), name=robot), path)
        except InputError:
            return {"battery": None}
        return {"battery": str(path)}


def _given_all_logs(
    rows: Sequence[dict[str, Any]], capacities: Sequence[tuple[float, float, float]], battery: Battery
) -> dict[str, float | None]:
    """Write the capacity that all logs of a robot show into the rows of its logs; its change over them for the robot.

    capacities: at the end of each log its time, and the filter's mean and standard deviation of the capacity over the
        battery file's.
    """
    change: dict[str, float | None] = {"soh_change": None, "soh_change_std": None}
    if not rows or not np.isfinite(capacities).all():
        return change
    found = capacity_over_logs(battery, *zip(*capacities, strict=True))
    is_known = shows_capacity(battery, logarithm(Normal(found.mean[-1], found.std[-1]), 1.0))
    for row, mean, std in zip(rows, found.mean, found.std, strict=True):
        row |= {"soh_capacity": float(mean) if is_known else None, "soh_capacity_std": float(std)}
    if is_known and len(rows) > 1:
        change |= {"soh_change": found.change.mean, "soh_change_std": found.change.std}
    return change
