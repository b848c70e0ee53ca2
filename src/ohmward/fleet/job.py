"""Job of a fleet: an estimator for all of its logs, and a row of figures for each of them."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ohmward.battery.file import BATTERY_FILE
from ohmward.battery.log_check import check_log
from ohmward.battery.soc.fit_check import misfits
from ohmward.battery.soc.registry import DEFAULT, make_estimator
from ohmward.battery.soc.sample import SocEstimate, SocFlag
from ohmward.battery.soc.score import soc_figures
from ohmward.errors import OhmwardError
from ohmward.fleet.lanes import estimate_logs
from ohmward.fleet.reading import read_one_of
from ohmward.logs import Log, write_table
from ohmward.logs.log import ReadOptions


@dataclass(frozen=True)
class Job:
    """An estimator and its settings, the same for every log."""

    battery: str  #: text of the battery file, which travels with the job to where the file is not
    filter: str = DEFAULT  #: name of the estimator
    initial_soc: float | None = None  #: at the start of every log; None takes it from the first voltage
    initial_soc_std: float = 0.03  #: its standard deviation
    reading: ReadOptions = field(default_factory=ReadOptions)  #: options of the reader
    estimates: str | None = None  #: folder for the estimates of every log, one Parquet file each; None writes none

    @property
    def digest(self) -> str:
        """Digest of the settings: another one for every job with other results."""
        return hashlib.sha256(json.dumps(asdict(self)).encode()).hexdigest()[:16]

    def run(self, paths: Sequence[str]) -> list[dict[str, Any]]:
        """Rows of the logs, in the order of the paths; a log that cannot be used has its reason in `error`."""
        battery = BATTERY_FILE.parse(self.battery)
        estimator = make_estimator(self.filter, battery)
        logs: dict[str, Log] = {}
        rows: dict[str, dict[str, Any]] = {}
        for path in paths:
            try:
                logs[path] = check_log(read_one_of(path, self.reading, paths, battery, ()), battery)
            except OhmwardError as error:
                rows[path] = failed(path, str(error))
        estimates = estimate_logs(estimator, list(logs.values()), self.initial_soc, self.initial_soc_std)
        for (path, log), found in zip(logs.items(), estimates, strict=True):
            self._write(path, log, found)
            wrong = misfits(battery, log, estimator, found)
            fit = {"fits": not wrong, "misfit": wrong[0].text if wrong else None}
            rows[path] = {"path": path, "error": None, **fit, **summary(log, found)}
        return [rows[path] for path in paths]

    def _write(self, path: str, log: Log, found: SocEstimate) -> None:
        """Write the estimates of one log, where they are wanted."""
        if not self.estimates:
            return
        table = {"time_s": log.time_s, "soc": found.soc, "soc_std": found.soc_std, "flags": found.flags.astype(int)}
        write_table(table, Path(self.estimates) / f"{Path(path).stem}.estimates.parquet")


def failed(path: str, reason: str) -> dict[str, Any]:
    """Row of a log that could not be used."""
    return {"path": path, "error": reason}


def summary(log: Log, found: SocEstimate) -> dict[str, Any]:
    """Figures of one log; None for one that this estimator does not know."""
    incidents = found.flags.astype(int) & ~int(SocFlag.REST | SocFlag.ANCHORED)
    head = {"samples": len(log), "duration_s": log.duration_s}
    figures = head | soc_figures(log, found) | {"flagged_share": float(np.mean(incidents != 0))}
    return {name: None if value != value else value for name, value in figures.items()}
