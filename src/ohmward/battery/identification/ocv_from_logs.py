"""Open-circuit voltage from low-rate discharges and charges, and where there are none, from the ends of rests."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from ohmward.battery.identification.record import LOW_RATE, SETTLED_REST_S, Phase, Record, settled_ends
from ohmward.battery.models.ocv import LEAST_SPAN, OCV_GRID, OcvCurve, monotone
from ohmward.errors import InputError
from ohmward.logs.log import Note
from ohmward.optional import require

#: Branches whose temperatures differ by less belong together.
SAME_TEMPERATURE_K = 5.0
#: Smallest shares of the capacity: of a complete branch, of one that also ends at a voltage limit, of one that is used.
_COMPLETE_SHARE = 0.93
_LIMIT_SHARE = 0.8
_SHORTEST_SHARE = 0.3
#: A branch ends at a limit if its last voltage is this close to the highest or lowest of the log, relatively.
_LIMIT_TOLERANCE = 0.002
#: Opposite branches of which one moves less than this share of the other do not both run from full to empty.
_AGREEING_SHARE = 0.97
#: An alignment of the branches is wrong where their gap is this many times as uneven along SoC as with another one.
_UNEVEN = 2.0
#: SoC at which that is compared: the ends of the curve are steep.
_MIDDLE = np.linspace(0.1, 0.9, 81)
#: Relative difference of a branch's charge to the capacity that deserves a warning.
CAPACITY_WARNING = 0.03
#: Points of the grid over which slopes are averaged: 10 % of SoC.
_SMOOTHING_POINTS = 21


class OcvBranch(NamedTuple):
    """One low-rate discharge or charge on its own axis of SoC."""

    log_name: str
    direction: Literal["discharge", "charge"]
    soc: np.ndarray  #: (N,) state of charge
    voltage_V: np.ndarray  #: (N,) voltage there, both in order of time
    current_A: float  #: mean current, > 0 charges
    moved_Ah: float  #: charge of the whole branch, >= 0
    temperature_degC: float | None  #: median during the branch, or None
    complete: bool  #: True where it runs from full to empty or back, and so defines the axis by itself


def find_branches(record: Record, capacity_Ah: float, initial_soc: float | None = None) -> tuple[OcvBranch, ...]:
    """The low-rate branches of a record. A branch of at least 93 % of the capacity runs from full to empty or back.

    So does one of at least 80 % that follows such a branch and ends at the voltage limit: low rates end where the
    battery is full or empty, and counters may err. A shorter branch starts where the one before it ended, or at
    `initial_soc`.

    Raises:
        InputError: a branch is shorter and its start is unknown.
    """
    branches: list[OcvBranch] = []
    for phase in record.phases:
        moved_Ah = float(record.charge.moved_Ah[phase.first + 1 : phase.last + 1].sum())
        slow = phase.kind != "rest" and abs(phase.current_A) < LOW_RATE * capacity_Ah
        if slow and abs(moved_Ah) > _SHORTEST_SHARE * capacity_Ah:
            before = branches[-1] if branches else None
            branches.append(_branch(record, phase, moved_Ah, capacity_Ah, before, initial_soc))
    return tuple(branches)


def reconcile_branches(branches: Sequence[OcvBranch]) -> tuple[OcvBranch, ...]:
    """The branches; one that moved clearly less than its opposite at that temperature ended before full or empty.

    In the cold a charge reaches its limit early. Such a branch keeps its start and gets the scale of the opposite one,
    unless the gap between both is far more even with the branch stretched to the whole axis: then its charge was
    counted wrongly.
    """
    found = []
    for branch in branches:
        longer = _longer(branch, branches) if branch.complete else []
        if longer:
            share = branch.moved_Ah / longer[0].moved_Ah
            soc = branch.soc[0] + share * (branch.soc - branch.soc[0])
            # without its last part: there the voltage already runs to the limit, as if the battery were full or empty
            inside = np.abs(soc - soc[-1]) >= 1 - share
            from_start = branch._replace(soc=soc[inside], voltage_V=branch.voltage_V[inside], complete=False)
            if _unevenness_V(from_start, longer[0]) < _UNEVEN * _unevenness_V(branch, longer[0]):
                branch = from_start
        found.append(branch)
    return tuple(found)


def branch_axis_std(branches: Sequence[OcvBranch]) -> float:
    """Standard deviation of the SoC axis in its middle that the branches leave open, 0 where their charges agree.

    Where two differ by x, one is stretched or ends early: that moves its middle by x/2, and the mean of both branches
    by x/4. Full and empty are known from the voltage.
    """
    pairs = [(branch, opposite) for branch in branches for opposite in _longer(branch, branches)]
    return 0.25 * max((1 - shorter.moved_Ah / longer.moved_Ah for shorter, longer in pairs), default=0.0)


def ocv_from_branches(branches: Sequence[OcvBranch], reference_degC: float) -> OcvCurve:
    """Mean of the charge and the discharge branch, half their distance, and their change with temperature.

    Branches within 5 K belong together; the group nearest to `reference_degC` gives the curve, all give the change
    with temperature. With one direction only, its voltage is the curve and the hysteresis is 0.
    """
    groups = _by_temperature(branches, reference_degC)
    curves = {degC: _mean_and_hysteresis(group) for degC, group in groups.items()}
    nearest = min(curves, key=lambda degC: abs(degC - reference_degC))
    mean_V, hysteresis_V = curves[nearest]
    return OcvCurve(
        voltage_V=tuple(mean_V),
        hysteresis_V=tuple(hysteresis_V),
        temperature_V_per_K=tuple(_temperature_slope({degC: mean for degC, (mean, _) in curves.items()})),
        reference_degC=nearest,
    )


def smooth(values: np.ndarray, points: int = _SMOOTHING_POINTS) -> np.ndarray:
    """(N,) moving average over `points`, fewer at the ends."""
    kernel = np.ones(points)
    return np.convolve(values, kernel, "same") / np.convolve(np.ones_like(values), kernel, "same")


def _longer(branch: OcvBranch, branches: Sequence[OcvBranch]) -> list[OcvBranch]:
    """Complete branches of the other direction at the same temperature that moved clearly more."""
    return [
        other
        for other in branches
        if other.complete
        and other.direction != branch.direction
        and branch.moved_Ah < _AGREEING_SHARE * other.moved_Ah
        and abs((other.temperature_degC or 0.0) - (branch.temperature_degC or 0.0)) < SAME_TEMPERATURE_K
    ]


def _unevenness_V(branch: OcvBranch, other: OcvBranch) -> float:
    """Standard deviation [V] of the gap between two branches along the middle of SoC."""
    gap_V = _interpolated(branch, _MIDDLE) - _interpolated(other, _MIDDLE)
    return float(np.nanstd(gap_V))


def _branch(
    record: Record,
    phase: Phase,
    moved_Ah: float,
    capacity_Ah: float,
    before: OcvBranch | None,
    initial_soc: float | None,
) -> OcvBranch:
    rows = slice(phase.first, phase.last + 1)
    complete = abs(moved_Ah) >= _COMPLETE_SHARE * capacity_Ah or (
        abs(moved_Ah) >= _LIMIT_SHARE * capacity_Ah
        and before is not None
        and before.complete
        and _ends_at_limit(record.log.voltage_V, phase.last, moved_Ah)
    )
    if complete:
        start, scale_Ah = (1.0 if moved_Ah < 0 else 0.0), abs(moved_Ah)
    elif before is not None:
        start, scale_Ah = float(before.soc[-1]), before.moved_Ah
    elif initial_soc is not None:
        start, scale_Ah = initial_soc, capacity_Ah
    else:
        raise InputError(
            f"log {record.log.name!r}: its low-rate test moves less than {_COMPLETE_SHARE:.0%} of the given capacity, "
            "so where it starts is not known; give the SoC it starts at (--initial-soc 0.5, or "
            f"initial_soc={{{record.log.name!r}: 0.5}}), or check the capacity"
        )
    total_Ah = np.cumsum(record.charge.moved_Ah[rows]) - record.charge.moved_Ah[phase.first]
    voltage_V, degC = record.log.voltage_V[rows], record.log.temperature_degC
    known = np.isfinite(voltage_V)
    return OcvBranch(
        log_name=record.log.name,
        direction="discharge" if moved_Ah < 0 else "charge",
        soc=(start + total_Ah / scale_Ah)[known],
        voltage_V=voltage_V[known],
        current_A=phase.current_A,
        moved_Ah=abs(moved_Ah),
        temperature_degC=None if degC is None else float(np.nanmedian(degC[rows])),
        complete=complete,
    )


def _ends_at_limit(voltage_V: np.ndarray, last: int, moved_Ah: float) -> bool:
    """True where the voltage at sample `last` is the highest after a charge, the lowest after a discharge."""
    limit_V = np.nanmax(voltage_V) if moved_Ah > 0 else np.nanmin(voltage_V)
    return bool(abs(voltage_V[last] - limit_V) <= _LIMIT_TOLERANCE * limit_V)


def _by_temperature(branches: Sequence[OcvBranch], otherwise_degC: float) -> dict[float, list[OcvBranch]]:
    """Branches grouped by temperature within 5 K; the key is that of the group's first."""
    groups: dict[float, list[OcvBranch]] = {}
    for branch in branches:
        degC = otherwise_degC if branch.temperature_degC is None else branch.temperature_degC
        near = [key for key in groups if abs(key - degC) < SAME_TEMPERATURE_K]
        groups.setdefault(near[0] if near else degC, []).append(branch)
    return groups


def _mean_and_hysteresis(branches: Sequence[OcvBranch]) -> tuple[np.ndarray, np.ndarray]:
    """(201,) mean curve and hysteresis [V], which closes to 0 where only one direction was measured."""
    discharge = _on_grid([branch for branch in branches if branch.direction == "discharge"])
    charge = _on_grid([branch for branch in branches if branch.direction == "charge"])
    if np.isnan(discharge).all() or np.isnan(charge).all():
        mean_V = discharge if np.isnan(charge).all() else charge
        return monotone(_held(mean_V)), np.zeros_like(OCV_GRID)
    hysteresis_V = np.maximum(_closing(0.5 * (charge - discharge)), 0.0)
    mean_V = np.where(np.isnan(charge), discharge + hysteresis_V, charge - hysteresis_V)
    both = ~np.isnan(charge) & ~np.isnan(discharge)
    mean_V[both] = 0.5 * (charge + discharge)[both]
    return monotone(_held(mean_V)), hysteresis_V


def _on_grid(branches: Sequence[OcvBranch]) -> np.ndarray:
    """(201,) mean voltage of the branches of one direction, nan where none was measured."""
    rows = np.reshape([_interpolated(branch) for branch in branches], (len(branches), OCV_GRID.size))
    known = np.count_nonzero(~np.isnan(rows), axis=0)
    return np.where(known > 0, np.nansum(rows, axis=0) / np.maximum(known, 1), np.nan)


def _interpolated(branch: OcvBranch, grid: np.ndarray = OCV_GRID) -> np.ndarray:
    order = np.argsort(branch.soc, kind="stable")
    return np.interp(grid, branch.soc[order], branch.voltage_V[order], left=np.nan, right=np.nan)


def _closing(hysteresis_V: np.ndarray) -> np.ndarray:
    """(201,) hysteresis, closing to 0 at an end of SoC that one of the branches did not reach."""
    known = ~np.isnan(hysteresis_V)
    soc = [-1e-9, *OCV_GRID[known], 1 + 1e-9]
    return np.interp(OCV_GRID, soc, [0.0, *hysteresis_V[known], 0.0])


def _held(values: np.ndarray) -> np.ndarray:
    """The values with each unknown one replaced by its nearest known neighbours."""
    known = ~np.isnan(values)
    return np.interp(OCV_GRID, OCV_GRID[known], values[known])


def _temperature_slope(curves: dict[float, np.ndarray]) -> np.ndarray:
    """(201,) [V/K] slope of the curves over temperature, smoothed over 10 % of SoC; 0 with one temperature."""
    if len(curves) < 2:
        return np.zeros_like(OCV_GRID)
    degC = np.array(list(curves))
    centred = degC - degC.mean()
    return smooth(centred @ np.array(list(curves.values())) / (centred @ centred))


def branch_note(branch: OcvBranch, capacity_Ah: float) -> Note:
    """Note on the SoC axis of a branch, a warning where its charge is not the given capacity."""
    what = f"low-rate {branch.direction} in {branch.log_name!r} at {abs(branch.current_A):.3g} A"
    if not branch.complete:
        return Note(f"{what} covers SoC {branch.soc.min():.3f} to {branch.soc.max():.3f}")
    error = branch.moved_Ah / capacity_Ah - 1.0
    text = f"{what} moved {branch.moved_Ah:.4g} Ah ({error:+.1%} of the given capacity): its SoC runs from 0 to 1"
    if abs(error) <= CAPACITY_WARNING:
        return Note(text)
    return Note(f"{text}; is {capacity_Ah:g} Ah the capacity that estimators should use?", "warning")


#: Points of the curve.
_RESTED_CURVE_POINTS = 101
#: Rests whose SoC differs by less are one point.
_SAME_SOC = 0.01
#: Fewest points that make a curve.
_FEWEST_POINTS = 2
#: Largest drop of the curve below a straight line on the way to SoC 0, over the voltage.
_LARGEST_DROP = 0.1


class RestPoint(NamedTuple):
    """Voltage at the end of a rest."""

    #: at the last sample of the rest
    soc: float
    voltage_V: float
    duration_s: float  #: of the rest


def rest_points(record: Record, soc: np.ndarray) -> tuple[RestPoint, ...]:
    """The end of each rest of at least 10 minutes, and of the rest with which the log starts.

    soc: (T,) state of charge along the record.
    """
    return tuple(
        RestPoint(float(soc[at]), float(record.log.voltage_V[at]), p.duration_s) for p, at in settled_ends(record)
    )


def ocv_from_rests(points: Sequence[RestPoint], empty_V: float, reference_degC: float) -> OcvCurve:
    """Monotone cubic through the ends of the rests.

    empty_V: lowest voltage of the logs [V]; the curve ends there at SoC 0 when no rest came near.

    Raises:
        InputError: fewer than 2 rests, or all at nearly the same SoC.
    """
    PchipInterpolator = require("scipy.interpolate", "identification").PchipInterpolator

    soc, voltage_V = _merged(points)
    if soc.size < _FEWEST_POINTS or np.ptp(soc) < LEAST_SPAN:
        span = np.ptp(soc) if soc.size else 0.0
        raise InputError(
            f"only {soc.size} rests of {SETTLED_REST_S:g} s or more, over {span:.0%} of SoC: the open-circuit "
            "voltage cannot be separated from the voltage under load; give it (--ocv, ocv=), add a log with a low-rate "
            "discharge and charge, or one with rests at several states of charge, or name the chemistry and the SoC at "
            "the start (--chemistry nmc --initial-soc 0.9)"
        )
    soc, voltage_V = _with_ends(soc, voltage_V, empty_V)
    grid = np.linspace(0.0, 1.0, _RESTED_CURVE_POINTS)
    return OcvCurve(tuple(monotone(PchipInterpolator(soc, voltage_V)(grid))), reference_degC=reference_degC)


def _merged(points: Sequence[RestPoint]) -> tuple[np.ndarray, np.ndarray]:
    """SoC and voltage of the rests, both rising; within 1 % of SoC averaged, longer rests counting more."""
    ordered = sorted(points, key=lambda p: p.soc)
    groups: list[list[RestPoint]] = []
    for point in ordered:
        if groups and point.soc - groups[-1][0].soc < _SAME_SOC:
            groups[-1].append(point)
        else:
            groups.append([point])
    soc, voltage_V = [], []
    for group in groups:
        socs, voltages_V, durations_s = zip(*group, strict=True)
        soc.append(np.mean(socs))
        voltage_V.append(np.average(voltages_V, weights=durations_s))
    return np.array(soc), monotone(np.array(voltage_V))


def _with_ends(soc: np.ndarray, voltage_V: np.ndarray, empty_V: float) -> tuple[np.ndarray, np.ndarray]:
    """The points with one at SoC 0 and one at SoC 1: straight on from the last two, and down to `empty_V` at 0."""
    slope = np.diff(voltage_V) / np.diff(soc)
    if soc[0] > 0:
        straight_V = voltage_V[0] - slope[0] * soc[0]
        lowest_V = max(empty_V, straight_V - voltage_V[0] * _LARGEST_DROP)
        bottom_V = straight_V if soc[0] < _SAME_SOC else min(straight_V, lowest_V)
        soc, voltage_V = np.append(0.0, soc), np.append(bottom_V, voltage_V)
    if soc[-1] < 1:
        top_V = voltage_V[-1] + slope[-1] * (1 - soc[-1])
        soc, voltage_V = np.append(soc, 1.0), np.append(voltage_V, top_V)
    return soc, voltage_V
