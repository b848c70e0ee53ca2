"""Blind benchmark [K] of state-of-charge estimators: the submission, and a rehearsal on open logs.

The model receives rows at 1 Hz one after the other and is scored by its root mean square error over each run: drives
from full, charges, restarts in mid-drive and an offset of the current sensor. Each run is preceded by an hour of copies
of its first row, which are not scored; in a restart their current is zero. The score is the weighted mean of the cases.

[K] P. Kollmeyer et al., A blind modeling tool for standardized evaluation of battery state of charge estimation
algorithms, IEEE Transportation Electrification Conference, 2022.
"""

from __future__ import annotations

import io
import math
import zipfile
from collections.abc import Callable, Iterator, Sequence
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.log import Log

#: Module that the benchmark imports, and its interval [s].
MODULE, INTERVAL_S = "Model", 1.0
#: Copies of the first row before each run.
PADDING_ROWS = 3600
#: Offset of the current sensor, as a share of the capacity per hour: 0.3 A on the benchmark's 4.6 Ah.
OFFSET_C = 0.3 / 4.6
#: State of charge below which a restart begins, and its weight within the case.
RESTARTS = {0.9: 3.0, 0.6: 2.0, 0.3: 1.0}
#: Weights of the cases; a case without a run is left out.
WEIGHTS = {"drives": 0.7, "charges": 0.1, "restarts": 0.1, "offset": 0.1}
#: Longest gap [s] over which rows are interpolated.
_INTERPOLATED_S = 60.0

Model = Callable[..., tuple[np.ndarray, Any]]


class BlindRun(NamedTuple):
    """One run: rows at the benchmark's interval, and the truth."""

    name: str
    rows: np.ndarray  #: (T, 3) current [A], > 0 charges; voltage [V]; temperature [degC]
    soc: np.ndarray  #: (T,) state of charge in [0, 1], nan where it is not known

    @property
    def charges(self) -> bool:
        """True where more charge goes in than out."""
        return float(np.nansum(self.rows[:, 0])) > 0.0


class BlindScore(NamedTuple):
    """Score of a model in one run of one case."""

    case: str  #: of `WEIGHTS`
    run: str  #: name of the run, and how it was modified
    weight: float  #: within the case
    rmse: float  #: in [0, 1]


def submission(text: str) -> bytes:
    """The archive to submit: the file of the model, without a folder."""
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as files:
        files.writestr(zipfile.ZipInfo(f"{MODULE}.py"), text, zipfile.ZIP_DEFLATED)
    return archive.getvalue()


def model_of(text: str) -> Model:
    """The function `Model` of the file."""
    module = ModuleType(MODULE)
    exec(compile(text, f"{MODULE}.py", "exec"), module.__dict__)  # the text is our own
    return module.Model


def blind_run(log: Log, soc: np.ndarray) -> BlindRun:
    """A log at the interval of the benchmark, interpolated.

    soc: (T,) truth, nan where it is not known.

    Raises:
        InputError: the log has gaps of more than a minute, or no truth.
    """
    if not np.isfinite(soc).any():
        raise InputError(f"{log.name}: the column of the true state of charge has no value")
    longest_s = float(np.max(np.diff(log.time_s), initial=0.0))
    if longest_s > _INTERPOLATED_S:
        raise InputError(
            f"{log.name}: a gap of {longest_s:.0f} s; the benchmark has a row every second, cut the log there"
        )
    time_s = np.arange(log.time_s[0], log.time_s[-1] + 0.5 * INTERVAL_S, INTERVAL_S)
    degC = np.full(len(log), math.nan) if log.temperature_degC is None else log.temperature_degC
    columns = [np.interp(time_s, log.time_s, column) for column in (log.current_A, log.voltage_V, degC)]
    return BlindRun(log.name, np.stack(columns, axis=1), np.interp(time_s, log.time_s, soc))


def rehearse(model: Model, run: BlindRun, capacity_Ah: float) -> Iterator[BlindScore]:
    """Scores of a model in every case that a run allows, one by one.

    capacity_Ah: the offset of the current sensor is a share of it.
    """
    yield BlindScore("charges" if run.charges else "drives", run.name, 1.0, _rmse(model, run))
    if run.charges:
        return
    for level, weight in RESTARTS.items():
        if (late := _from_below(run, level)) is not None:
            yield BlindScore("restarts", f"{run.name} from {level:.0%}", weight, _rmse(model, late, restarted=True))
    for sign in (1.0, -1.0):
        offset_A = sign * OFFSET_C * capacity_Ah
        off = run._replace(rows=run.rows + np.array([offset_A, 0.0, 0.0]))
        yield BlindScore("offset", f"{run.name} {offset_A:+.2g} A", 1.0, _rmse(model, off))


def case_rmse(scores: Sequence[BlindScore], case: str) -> float:
    """Weighted mean of the errors of a case, nan without a run."""
    own = [score for score in scores if score.case == case]
    total = sum(score.weight for score in own)
    return sum(score.weight * score.rmse for score in own) / total if own else math.nan


def weighted_rmse(scores: Sequence[BlindScore]) -> float:
    """The score: weighted mean of the cases that have a run."""
    found = {case: weight for case, weight in WEIGHTS.items() if any(score.case == case for score in scores)}
    return sum(weight * case_rmse(scores, case) for case, weight in found.items()) / sum(found.values())


def _from_below(run: BlindRun, level: float) -> BlindRun | None:
    """The run from where its state of charge falls below a level; None where it starts below, or never does."""
    below = np.flatnonzero(run.soc < level)
    if not below.size or below[0] == 0:
        return None
    return run._replace(rows=run.rows[below[0] :], soc=run.soc[below[0] :])


def _rmse(model: Model, run: BlindRun, restarted: bool = False) -> float:
    first = run.rows[0].copy()
    if restarted:
        first[0] = 0.0
    _, z = model(np.tile(first, (PADDING_ROWS, 1)))
    error = model(run.rows, z)[0] - run.soc
    return float(np.sqrt(np.nanmean(error**2)))
