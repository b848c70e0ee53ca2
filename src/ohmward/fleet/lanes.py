"""Many logs of one battery type through one estimator, a log in each lane.

The logs are sorted by length, the longest first, so those that are still running are always the first lanes. After the
end of a log, the next part runs without it. Parts are few, so a lane runs on for a while after the end of its log, on
samples without a measurement, and its estimates there are dropped.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from ohmward.battery.soc.estimator import (
    SocEstimator,
    after_long_gaps,
    declared_full_at,
    exchange_in,
    model_of,
    on_day,
    samples_of,
)
from ohmward.battery.soc.sample import INITIAL_SOC_STD, Estimator, SocEstimate, SocSample
from ohmward.battery.soc.voltage_faults import wrong_starts
from ohmward.filters.estimator import row_of
from ohmward.logs.log import Log
from ohmward.trace.structure import pick_lanes, side_by_side

#: Most parts in which a batch of logs is run.
_PARTS = 16


def estimate_logs(
    estimator: Estimator,
    logs: Sequence[Log],
    initial_soc: float | None = None,
    initial_soc_std: float = INITIAL_SOC_STD,
    lowering: str | None = None,
) -> list[SocEstimate]:
    """Estimates for each log, every field (T,), equal to those of `SocEstimator.run` up to rounding.

    initial_soc: of every log; None takes it from each log's first voltage.
    lowering: see `ohmward.trace.Kernel`.
    """
    together = {i: log for i, log in enumerate(logs) if _in_one_piece(estimator, log)}
    found = _side_by_side(estimator, [*together.values()], initial_soc, initial_soc_std, lowering) if together else []
    of_one = {
        i: e
        for (i, log), e in zip(together.items(), found, strict=True)
        if exchange_in(estimator, samples_of(log), e.innovation_V, e.flags) is None
    }

    def run(log: Log) -> SocEstimate:
        return SocEstimator(estimator, initial_soc, initial_soc_std, lowering).run(log).estimates

    return [of_one[i] if i in of_one else run(log) for i, log in enumerate(logs)]


def _in_one_piece(estimator: Estimator, log: Log) -> bool:
    """True for a log without reports of full charge, long gaps or a wrong start: its estimates are plain steps."""
    if declared_full_at(estimator, log) or after_long_gaps(estimator, np.diff(log.time_s)):
        return False
    model = model_of(estimator)
    return model is None or not wrong_starts(samples_of(log), model, waits_s=math.inf)[0]


def _side_by_side(
    estimator: Estimator,
    logs: Sequence[Log],
    initial_soc: float | None,
    initial_soc_std: float,
    lowering: str | None,
) -> list[SocEstimate]:
    """Estimates for each log, every field (T,), a log in each lane."""
    samples = [samples_of(log) for log in logs]
    order = np.argsort([-len(log) for log in logs], kind="stable")
    lengths = np.array([len(logs[i]) for i in order])
    columns = []  # tables (T, B) with a log in each column, contiguous in memory; nan after its end
    for k in range(len(SocSample._fields)):
        table = np.full((len(logs), lengths[0]), np.nan)
        for row, i in zip(table, order, strict=True):
            row[: len(logs[i])] = samples[i][k]
        columns.append(table.T)
    firsts = [row_of(samples[i], 0) for i in order]
    on_days = [on_day(estimator, logs[i].begin_unix_s) for i in order]
    states = [e.init(first, initial_soc, initial_soc_std) for e, first in zip(on_days, firsts, strict=True)]
    kernel = SocEstimator(estimator, lowering=lowering).kernel
    state = side_by_side(states)
    parts = []
    for first, last, lanes in _parts(lengths):
        part = SocSample(*(column[first:last, :lanes] for column in columns))
        state, estimates = kernel.scan_lanes(pick_lanes(state, slice(lanes)), part)
        parts.append(estimates)
    results: list[Any] = [None] * len(logs)
    for lane, (i, length) in enumerate(zip(order, lengths, strict=True)):
        fields = []
        for pieces in zip(*parts, strict=True):  # (T_k, B_k) each
            whole = [piece[:, lane] for piece in pieces if lane < piece.shape[1]]
            fields.append((whole[0] if len(whole) == 1 else np.concatenate(whole))[:length])
        results[i] = SocEstimate(*fields)
    return results


def _parts(lengths: np.ndarray) -> Iterator[tuple[int, int, int]]:
    """First and last step of each part, and the number of lanes that still run; lengths (B,) in descending order."""
    longest = int(lengths[0])
    width = -(-longest // _PARTS)
    first = 0
    while first < longest:
        lanes = int(np.count_nonzero(lengths > first))
        last = min(first + width, longest)
        while last < longest and np.count_nonzero(lengths > last) == lanes:
            last = min(last + width, longest)
        yield first, last, lanes
        first = last
