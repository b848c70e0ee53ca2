"""Samples of a log for learning: sanitised, cut into parts that are solved at once, and the rows whose voltage is used.

Charge is summed over every sample, the voltages of the RC pairs over steps of some seconds with their mean current. The
voltage is compared in only a few of them, since its errors persist for minutes.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain, pairwise
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.charge_count import begins_interval, find_gaps
from ohmward.battery.models.noise import USUAL_C, CurrentSensor, path_std_A
from ohmward.battery.models.temperature import ROOM_DEGC
from ohmward.battery.soc.clean_sample import CURRENT_GAP_S, sample_limits
from ohmward.errors import InputError
from ohmward.logs.log import SECONDS_PER_HOUR, Log
from ohmward.runs import runs

#: Step over which charge and overpotentials are summed [s], a tenth of a usual fast time constant of a cell, and steps
#: to a row.
STEP_S, ROW_STEPS = 2.0, 3
#: Most steps and most gaps of a part; a log with more is solved part by part.
_MOST_SAMPLES, _MOST_GAPS = 60_000, 30
#: Fewest samples of a log, and of a part.
_FEWEST = 2
#: A cut at a gap costs nothing: the nearest gap within this share of the length of a part is used.
_NEAR = 0.25
#: Largest standard deviation of an uncounted change of SoC.
_MOST_UNKNOWN = 0.5
#: Number of steps in which the charge that samples leave open between them is modelled.
_PATH_STEPS = 20
#: Shortest rest, length of the pieces of a longer one [s], and largest change of its current from step to step, in
#: standard deviations of the noise.
_OFFSET_REST_S, _PIECE_S, _STEP_SIGMAS = 20.0, 600.0, 5.0
#: Smallest standard deviation of SoC for which that is done.
_LEAST_PATH = 1e-3


class Jump(NamedTuple):
    """A change of SoC that no current shows: the first sample after it, and its standard deviation."""

    sample: int
    std: float


class DeclaredRest(NamedTuple):
    """A rest whose true current is declared: its last sample, and by how much the sensor exceeds it on average [A]."""

    sample: int
    excess_A: float


class Samples(NamedTuple):
    """Samples of a part of a log, (T,) each; values of an interval are those of the one that ends at the sample."""

    name: str
    time_s: np.ndarray
    dt_s: np.ndarray  #: length of the interval, 0 for the first and after a gap
    moved_Ah: np.ndarray  #: its charge by the sensor, > 0 charges
    mean_current_A: np.ndarray  #: its mean current
    #: at the sample
    current_A: np.ndarray
    temperature_degC: np.ndarray
    voltage_V: np.ndarray  #: measured, nan where it was not, or where the battery gases
    gaps: np.ndarray  #: indices of the first samples after a gap
    jumps: tuple[Jump, ...]  #: changes of SoC that the current does not show, gaps among them
    rests: tuple[DeclaredRest, ...]  #: rests whose true current the battery file declares
    rows: np.ndarray  #: (N,) indices of the samples whose voltage is compared
    row_s: float  #: time for which each of them stands [s]

    @property
    def hours(self) -> float:
        """Length of the part."""
        return float(self.time_s[-1] - self.time_s[0]) / SECONDS_PER_HOUR


def samples_of(log: Log, battery: Battery) -> Iterator[Samples]:
    """The parts of a log, one after the other; the charge between the samples that are left out is added up.

    Raises:
        InputError: no current or no voltage that such a battery can have.
    """
    limits, gassing_V = sample_limits(battery.thevenin), battery.thevenin.gassing_V
    known, credible = limits.is_current(log.current_A), limits.is_voltage(log.voltage_V)
    if np.count_nonzero(known & credible) < _FEWEST:
        raise InputError(
            f"log {log.name!r}: fewer than {_FEWEST} samples have a current and a voltage that a battery of "
            f"{battery.capacity_Ah:g} Ah and {limits.highest_ocv_V:.3g} V can show; check columns and units"
        )
    if gassing_V is not None:
        credible &= log.voltage_V < gassing_V
    time_s, current_A = log.time_s[known], log.current_A[known]
    dt_s = np.diff(time_s, prepend=time_s[0])
    gap = find_gaps(time_s)
    mean_A = 0.5 * (current_A + np.concatenate([current_A[:1], current_A[:-1]]))
    # as the filter does
    counted_s = np.where(gap, np.minimum(dt_s, CURRENT_GAP_S), dt_s)
    total_Ah = np.cumsum(mean_A * counted_s) / SECONDS_PER_HOUR
    path = np.cumsum(np.where(gap, 0.0, _path_variance(dt_s, current_A, battery)))
    temperature_degC = log.temperature_along(ROOM_DEGC)[known]
    voltage_V = np.where(credible, log.voltage_V, np.nan)[known]
    thinned = np.flatnonzero(begins_interval(np.floor((time_s - time_s[0]) / STEP_S), gap))
    for part in _parts(thinned.size, np.flatnonzero(gap[thinned])):
        used = thinned[part]
        gaps = 1 + np.flatnonzero(gap[used[1:]])
        part_s, moved_Ah, path_variance = (
            np.diff(column[used], prepend=column[used[0]]) for column in (time_s, total_Ah, path)
        )
        mean_A = SECONDS_PER_HOUR * moved_Ah / np.where(part_s > 0.0, part_s, 1.0)
        mean_A[gaps] = 0.0
        usual_s = float(np.median(part_s[1:]))
        # in a gap the battery was used as usual or not at all, or was charged
        at_gaps = [Jump(int(k), min(USUAL_C * part_s[k] / SECONDS_PER_HOUR, _MOST_UNKNOWN)) for k in gaps]
        every = ROW_STEPS if usual_s < ROW_STEPS * STEP_S else 1
        rows = np.flatnonzero(np.isfinite(voltage_V[used]))[::every]
        yield Samples(
            name=log.name,
            time_s=time_s[used],
            dt_s=part_s,
            moved_Ah=moved_Ah,
            mean_current_A=mean_A,
            current_A=current_A[used],
            temperature_degC=temperature_degC[used],
            voltage_V=voltage_V[used],
            gaps=gaps,
            jumps=(*at_gaps, *_path_jumps(path_variance)),
            rests=tuple(_declared_rests(current_A[used], time_s[used], battery)),
            rows=rows,
            row_s=every * usual_s,
        )


def _path_variance(dt_s: np.ndarray, current_A: np.ndarray, battery: Battery) -> np.ndarray:
    """(T,) variance of SoC from the unknown current between two samples, and from the noise of its sensor."""
    change_A = np.diff(current_A, prepend=current_A[0])
    noise_A2 = battery.sensor.noise_std_A**2 / np.maximum(dt_s, 1.0)
    charge_Ah2 = (path_std_A(change_A, dt_s) ** 2 + noise_A2) * (dt_s / SECONDS_PER_HOUR) ** 2
    return np.asarray(charge_Ah2 / battery.capacity_Ah**2)


def _parts(size: int, gaps: np.ndarray) -> Iterator[slice]:
    """Parts of a limited number of samples and gaps, as even as possible; cut at a gap where one is near."""
    count = max(-(-size // _MOST_SAMPLES), -(-gaps.size // _MOST_GAPS), 1)
    edges = np.linspace(0, size, count + 1).astype(int)
    if gaps.size and count > 1:
        inner = edges[1:-1]
        nearest = gaps[np.abs(gaps - inner[:, None]).argmin(axis=1)]
        near = np.abs(nearest - inner) < _NEAR * size / count
        inner[near] = nearest[near]
    for first, last in pairwise(np.unique(edges).tolist()):
        if last - first >= _FEWEST:
            yield slice(first, last)


def _path_jumps(path: np.ndarray) -> list[Jump]:
    """Changes of SoC that the samples leave open, in steps of about equal variance; a long interval may be several."""
    variance = np.cumsum(path)
    if variance[-1] < _LEAST_PATH**2:
        return []
    inside = np.searchsorted(variance, variance[-1] * np.arange(1, _PATH_STEPS) / _PATH_STEPS)
    at = np.unique([*inside, len(path) - 1])
    std = np.sqrt(np.diff(variance[at], prepend=0.0))
    return [Jump(int(k), float(s)) for k, s in zip(at, std, strict=True)]


def _declared_rests(current_A: np.ndarray, time_s: np.ndarray, battery: Battery) -> list[DeclaredRest]:
    """Rests in which the current is steady, and equals the declared one to within noise and offset of the sensor.

    A steady current that differs from that of most rests is a small load, not the sensor's offset. Most files do not
    declare what a robot draws at rest: assuming about 0 made files certain of a wrong capacity.
    """
    if battery.idle_current_A is None:
        return []
    sensor = battery.sensor
    excess_A = current_A - battery.idle_current_A
    near = np.abs(excess_A - sensor.offset_A) < 3.0 * sensor.noise_std_A + 2.0 * sensor.offset_std_A
    steady = np.abs(np.diff(excess_A, prepend=np.nan)) <= _STEP_SIGMAS * sensor.noise_std_A
    pieces = [_pieces(first, stop, excess_A, time_s, sensor) for first, stop in runs(near & steady)]
    rests = list(chain.from_iterable(pieces))
    usual_A = float(np.median([rest.excess_A for rest in rests])) if rests else 0.0
    walk_A2: Any = sensor.offset_walk_variance(float(time_s[-1] - time_s[0]))
    apart_A = 3.0 * float(np.hypot(sensor.noise_std_A, np.sqrt(walk_A2)))
    return [rest for rest in rests if abs(rest.excess_A - usual_A) <= apart_A]


def _pieces(
    first: int, stop: int, excess_A: np.ndarray, time_s: np.ndarray, sensor: CurrentSensor
) -> Iterator[DeclaredRest]:
    """Pieces of a rest from the sample `first` to before `stop` in which the current does not drift."""
    pieces = max(1, int((time_s[stop - 1] - time_s[first]) / _PIECE_S))
    for piece in np.array_split(np.arange(first, stop), pieces):
        earlier, later = np.array_split(excess_A[piece], 2)
        if not later.size or time_s[piece[-1]] - time_s[piece[0]] < _OFFSET_REST_S:
            continue
        # the taper at the end of a charge is as small, but it falls
        by_chance_A = sensor.noise_std_A * max(1.0, 3.0 * np.sqrt(2.0 / later.size))
        if abs(later.mean() - earlier.mean()) <= by_chance_A:
            yield DeclaredRest(int(piece[-1]), float(excess_A[piece].mean()))
