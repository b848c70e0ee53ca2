"""Estimators over one log, side by side, from the same start."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import permutations
from typing import TYPE_CHECKING, Any

import numpy as np

from ohmward.battery.battery import Battery, require_battery
from ohmward.battery.soc.estimator import SocEstimator, SocRun, samples_of
from ohmward.battery.soc.registry import available
from ohmward.battery.soc.sample import INITIAL_SOC_STD, SocSample
from ohmward.battery.soc.score import REFERENCE_MARGIN, score, soc_reference, soc_scores, voltage_errors_V
from ohmward.errors import InputError
from ohmward.logs.log import Log, LogSource, as_log
from ohmward.optional import require
from ohmward.rich_display import RichDisplay
from ohmward.trace import Kernel
from ohmward.trace.kernel import WORTH_STEPS

if TYPE_CHECKING:
    from pandas import DataFrame

#: Called with the name of an estimator and the share of the log that it has done.
Progress = Callable[[str, float], None]


@dataclass(frozen=True, eq=False)
class Comparison(RichDisplay):
    """Runs of several estimators over the same log, by their names."""

    log: Log
    runs: Mapping[str, SocRun]
    truth: np.ndarray | None = None  #: (T,) state of charge in [0, 1], nan where it is not known

    @cached_property
    def step_s(self) -> dict[str, float]:
        """Computing time of a step of each estimator [s], without compilation; measured when it is first asked for."""
        samples = samples_of(self.log)
        return {name: seconds_per_step(run.kernel, run.end, samples) for name, run in self.runs.items()}

    def figures(self) -> dict[str, dict[str, Any]]:
        """Figures of each estimator by name: SoC at the end, errors of the voltage, errors of SoC where it is known."""
        return {name: {"us_per_step": 1e6 * self.step_s[name]} | self._figures(run) for name, run in self.runs.items()}

    def soc_rms_differences(self) -> dict[str, dict[str, float]]:
        """Root mean square difference of the state of charge between every two estimators."""
        differences: dict[str, dict[str, float]] = {name: {} for name in self.runs}
        for (name, one), (other, two) in permutations(self.runs.items(), 2):
            differences[name][other] = float(np.sqrt(np.mean((one.soc - two.soc) ** 2)))
        return differences

    def to_pandas(self) -> DataFrame:
        """A row for each estimator, the best first where the truth is known; see `figures`.

        Raises:
            MissingPackageError: pandas is not installed.
        """
        pandas = require("pandas", "to_pandas")
        rows = {name: {key: x for key, x in row.items() if key != "flags"} for name, row in self.figures().items()}
        frame = pandas.DataFrame.from_dict(rows, orient="index", dtype=float)
        return frame.rename_axis("estimator") if self.truth is None else frame.sort_values("soc_rmse")

    def _figures(self, run: SocRun) -> dict[str, Any]:
        log, estimates = self.log, run.estimates
        error_V = voltage_errors_V(log, estimates)
        voltage = score(error_V, np.zeros(error_V.size))
        return {
            "seconds": run.seconds,
            "soc_final": float(estimates.soc[-1]),
            "soc_std_final": float(estimates.soc_std[-1]),
            "voltage_error_mean_V": voltage.mean if voltage else None,
            "voltage_error_std_V": voltage.std if voltage else None,
            "voltage_max_error_V": voltage.max_error if voltage else None,
            "voltage_rmse_V": voltage.rmse if voltage else None,
            "flags": run.counts(),
            **soc_scores(log, estimates, self.truth),
        }

    def __repr__(self) -> str:
        known = " with the truth" if self.truth is not None else ""
        return f"Comparison({', '.join(self.runs)} over {self.log.name!r}{known})"


def compare(
    battery: Battery,
    log: LogSource,
    filters: Sequence[str] | str | None = None,
    *,
    truth: str | np.ndarray | None = None,
    initial_soc: float | None = None,
    initial_soc_std: float = INITIAL_SOC_STD,
    progress: Progress | None = None,
) -> Comparison:
    """Run estimators over the same log from the same start.

    >>> battery = ow.load_battery("battery.toml")
    >>> compared = ow.compare(battery, "day.csv", ["gsf", "textbook-ukf", "coulomb"], truth="soc_true")
    >>> compared.to_pandas()[["soc_rmse", "coverage_95"]].shape
    (3, 2)
    >>> compared.plot().save("compared.svg")

    log: a Log, or a path or DataFrame of one.
    filters: names of estimators, or of one, see `ohmward.available`; by default all that the battery's file allows.
    truth: name of a column of the log, a share, a percentage or a counter of ampere hours that starts at `initial_soc`;
        or (T,) in [0, 1].
    initial_soc, initial_soc_std: of the start; None takes it from the first voltage.
    progress: called now and then with (name of the estimator, share done).

    Raises:
        InputError: no such estimator or column, a truth of another length, or a file whose models no estimator takes.
    """
    require_battery(battery)
    log = as_log(log)
    names = (filters,) if isinstance(filters, str) else tuple(filters or available(battery))
    if not names:
        raise InputError(
            f"battery {battery.name!r}: no estimator works with the models in its file; "
            "identify it with model='thevenin' (--model thevenin)"
        )
    if isinstance(truth, str):
        truth = soc_reference(log, truth, battery.capacity_Ah, initial_soc).soc
    if truth is not None and np.shape(truth) != log.time_s.shape:
        raise InputError(f"truth must have a value for each of the {len(log)} samples, got shape {np.shape(truth)}")
    if truth is not None and (most := np.nanmax(np.abs(truth), initial=0.0)) > 1.0 + REFERENCE_MARGIN:
        raise InputError(f"truth must be a share, between 0 and 1, got {most:g}; divide percent by 100")
    runs = {}
    for name in names:
        report = None if progress is None else partial(_share, progress, name)
        runs[name] = SocEstimator(battery, initial_soc, initial_soc_std, filter=name).run(log, report)
    return Comparison(log, runs, truth)


def seconds_per_step(kernel: Kernel, state: Any, samples: SocSample) -> float:
    """Computing time of a step [s], without compilation: of as many steps as are run in machine code, the faster time.

    samples: (T, ...), repeated or cut to that number.
    """
    steps = SocSample(*(np.resize(column, WORTH_STEPS) for column in samples))
    least_s = math.inf
    for _ in range(2):  # the first may compile
        began = time.perf_counter()
        kernel.scan(state, steps)
        least_s = min(least_s, time.perf_counter() - began)
    return least_s / WORTH_STEPS


def _share(progress: Progress, name: str, done: int, steps: int) -> None:
    progress(name, done / steps)
