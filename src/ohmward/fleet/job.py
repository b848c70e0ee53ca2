"""What is done with every log of a fleet, and what comes of it: one row for each log."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ohmward.battery.file import BATTERY_FILE
from ohmward.battery.soc.registry import DEFAULT
from ohmward.battery.soc.sample import SocEstimate, SocFlag
from ohmward.battery.soc.score import score
from ohmward.errors import OhmwardError
from ohmward.fleet.lanes import estimate_logs
from ohmward.logs import Log, read_log, write_table
from ohmward.published.registry import make_estimator


@dataclass(frozen=True)
class ReadOptions:
    """How to read the logs, as `read_log` takes it.

    Attributes:
        current_sign: "auto", "charge" or "discharge".
        columns, units: quantity and column, quantity and unit.
        sort_time: sort rows that are out of order.
    """

    current_sign: str = "auto"
    columns: tuple[tuple[str, str], ...] = ()
    units: tuple[tuple[str, str], ...] = ()
    sort_time: bool = False


@dataclass(frozen=True)
class Job:
    """The same for every log.

    Attributes:
        battery: text of the battery file, which travels with the job to where the file is not.
        filter: name of the estimator.
        initial_soc, initial_soc_std: at the start of every log; None takes it from the first voltage.
        reading: how to read the logs.
        estimates: folder for the estimates of every log, one Parquet file each; None writes none.
    """

    battery: str
    filter: str = DEFAULT
    initial_soc: float | None = None
    initial_soc_std: float = 0.03
    reading: ReadOptions = field(default_factory=ReadOptions)
    estimates: str | None = None

    @property
    def digest(self) -> str:
        """Another one for every job with other results."""
        return hashlib.sha256(json.dumps(asdict(self)).encode()).hexdigest()[:16]

    def run(self, paths: Sequence[str]) -> list[dict[str, Any]]:
        """A row for each log, in the order of the paths; a log that cannot be used has its reason in `error`."""
        estimator = make_estimator(self.filter, BATTERY_FILE.parse(self.battery))
        logs: list[Log] = []
        rows: list[dict[str, Any]] = []
        for path in paths:
            try:
                logs.append(self._read(path))
                rows.append({"path": path, "error": None, "log": len(logs) - 1})
            except OhmwardError as error:
                rows.append(failed(path, str(error)))
        estimates = estimate_logs(estimator, logs, self.initial_soc, self.initial_soc_std)
        return [self._finished(row, logs, estimates) for row in rows]

    def _read(self, path: str) -> Log:
        how = self.reading
        columns, units = dict(how.columns), dict(how.units)
        return read_log(
            path,
            current_sign=how.current_sign,  # type: ignore[arg-type]
            columns=columns,
            units=units,
            extra=(),
            sort_time=how.sort_time,
        )

    def _finished(self, row: dict[str, Any], logs: list[Log], estimates: list[SocEstimate]) -> dict[str, Any]:
        number = row.pop("log", None)
        if number is None:
            return row
        log, found = logs[number], estimates[number]
        if self.estimates:
            write_table(_table(log, found), Path(self.estimates) / f"{Path(row['path']).stem}.estimates.parquet")
        return row | summary(log, found)


def failed(path: str, why: str) -> dict[str, Any]:
    """The row of a log that could not be used."""
    return {"path": path, "error": why}


def summary(log: Log, found: SocEstimate) -> dict[str, Any]:
    """The figures of one log; None for one that this estimator does not know."""
    flags = found.flags.astype(int)
    voltage = score(found.voltage_V, log.voltage_V)
    figures = {
        "samples": len(log),
        "duration_s": log.duration_s,
        "soc_initial": float(found.soc[0]),
        "soc_final": float(found.soc[-1]),
        "soc_std_final": float(found.soc_std[-1]),
        "soc_min": float(np.min(found.soc)),
        "soc_max": float(np.max(found.soc)),
        "voltage_rmse_V": voltage.rmse if voltage else None,
        "current_offset_A": float(found.current_offset_A[-1]),
        "soh_capacity": float(found.soh_capacity[-1]),
        "resistance_ratio": float(found.resistance_ratio[-1]),
        "flagged_share": float(np.mean((flags & ~int(SocFlag.REST)) != 0)),
    }
    return {name: None if value != value else value for name, value in figures.items()}


def _table(log: Log, found: SocEstimate) -> dict[str, np.ndarray]:
    return {"time_s": log.time_s, "soc": found.soc, "soc_std": found.soc_std, "flags": found.flags.astype(int)}
