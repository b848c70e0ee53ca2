"""The default beside PyBatterySE on the cells that PyBatterySE was written for, see `lives.py`."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from importlib import import_module
from typing import NamedTuple

import numpy as np

import measured_cells as cells
from figure import table as markdown_table
from figure import verdict
from lives_table import COVERAGE_BAR, FOUND_S, SETTLED_S, disturbed
from measured_lives import LOW, ONE_PERCENT, RIGHT, TUE_SPLITS, Start, short
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.battery.soc.score import Score, score

#: For each cell, the records that identify, and those that are estimated.
SPLITS = [TUE_SPLITS[k] for k in (0, 2, 5)]

#: State of charge and its standard deviation, (T,) each.
Estimate = tuple[np.ndarray, np.ndarray]


class PeerRow(NamedTuple):
    """One record from one start: the default's score, and PyBatterySE's or why it has none."""

    cell: str
    tested: str
    record: str
    start: str
    ours: Score
    theirs: Score | str

    @property
    def met(self) -> bool:
        """True where the default's RMSE is no larger and its band covers."""
        better = isinstance(self.theirs, str) or self.ours.rmse <= self.theirs.rmse
        return better and self.ours.coverage_95 >= COVERAGE_BAR


def rows() -> Iterator[PeerRow]:
    """Every record from every start; none, and a message, where the package is not installed.

    Raises:
        FileNotFoundError: data are absent.
    """
    try:
        peer = import_module("peers.in_pybatteryse")
    except ModuleNotFoundError as missing:
        print(f"PyBatterySE is not compared with: {missing}; pip install pybatteryse", file=sys.stderr)
        return
    for cell, tests, records in SPLITS:
        battery = cells.tue_battery(cell, *tests)
        for record in records:
            recording = cells.tue(cell, record)
            words = f"TUE {cell}".replace("_", " "), " + ".join(map(short, tests)), short(record)
            fifty_mA = Start("right, +50 mA", offset_C=0.05 / battery.capacity_Ah)
            for start in (RIGHT, LOW, fifty_mA, ONE_PERCENT):
                log = disturbed(recording.log, start.offset_C * battery.capacity_Ah)
                told = float(np.clip(recording.truth[0] + (start.error or 0.0), 0.0, 1.0))
                run = SocEstimator(battery, told).run(log).estimates
                ours = _scored(run.soc, run.soc_std, recording, start)
                theirs = _theirs(partial(peer.estimate, cell, tests, log, told), recording, start)
                yield PeerRow(*words, start.words, ours, theirs)


def _theirs(estimate: Callable[[], Estimate], recording: cells.Recording, start: Start) -> Score | str:
    """Score of the peer, or why it has none."""
    try:
        return _scored(*estimate(), recording, start)
    except KeyError as missing:
        return f"KeyError: {missing}"


def _scored(soc: np.ndarray, std: np.ndarray, recording: cells.Recording, start: Start) -> Score:
    """RMSE of a right start from the beginning, of others after FOUND_S; the band after SETTLED_S."""
    since_s = recording.log.time_s - recording.log.time_s[0]
    found = since_s >= (0.0 if start.error == 0.0 else FOUND_S)
    settled = since_s >= SETTLED_S
    error, band = (score(soc[part], recording.truth[part], std[part]) for part in (found, settled))
    assert error is not None and band is not None
    return band._replace(rmse=error.rmse)


def table(found: Sequence[PeerRow]) -> list[str]:
    """The rows in Markdown."""
    header = ("cell", "identified from", "record", "start", "default: RMSE", "covered", "PyBatterySE: RMSE", "covered")
    rows = []
    for row in found:
        theirs = (row.theirs, "") if isinstance(row.theirs, str) else _figures(row.theirs)
        rows.append((*row[:4], *_figures(row.ours), *theirs, verdict(row.met)))
    return markdown_table((*header, ""), rows)


def _figures(found: Score) -> tuple[str, str]:
    return f"{100 * found.rmse:.2f}", f"{100 * found.coverage_95:.0f} %"
