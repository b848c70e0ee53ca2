"""A log in numbers: sampling, ranges, resolution, noise, rests, pulses, charge."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.clean import find_gaps
from ohmward.logs.drive_log import DriveLog
from ohmward.logs.log import SECONDS_PER_HOUR, Log
from ohmward.logs.sign import resolution, sign_evidence, spread
from ohmward.runs import runs

# A rest: less than this fraction of the largest current, for at least this time.
_REST_FRACTION = 0.05
_REST_LEAST_S = 10.0
_PULSE_MOST_S = 120.0
# Fewer second differences than these give no robust standard deviation.
_NOISE_LEAST = 20


@dataclass(frozen=True)
class Sampling:
    """Intervals between samples [s]; a gap is more than ten times the usual interval."""

    median_s: float
    shortest_s: float
    longest_s: float
    irregularity: float
    gaps: int
    longest_gap_s: float


@dataclass(frozen=True)
class Signal:
    """Range, resolution and white noise of one quantity, in its own unit.

    missing counts NaN samples, levels distinct values; the resolution is the smallest step between two levels.
    """

    minimum: float
    maximum: float
    missing: int
    levels: int
    resolution: float
    noise_std: float


@dataclass(frozen=True)
class Activity:
    """Rests, pulses between rests, the current at rest [A] (None without a rest), charge in and out [Ah]."""

    rests: int
    pulses: int
    rest_current_A: float | None
    charge_in_Ah: float
    charge_out_Ah: float


@dataclass(frozen=True)
class Sign:
    """The response of the voltage to the current; verdict "charge" agrees with current > 0 charges."""

    verdict: str
    edges: int
    resistance_ohm: float | None
    t_value: float


@dataclass(frozen=True)
class Survey:
    """Everything that `survey` finds."""

    samples: int
    duration_s: float
    sampling: Sampling
    current: Signal
    voltage: Signal
    temperature: Signal | None
    sign: Sign
    activity: Activity


@dataclass(frozen=True)
class DriveSurvey:
    """The numbers of a drive; signals of the wheels [rad/s] and motors [A] by the places of the wheels."""

    samples: int
    duration_s: float
    sampling: Sampling
    wheels: dict[str, Signal]
    motors: dict[str, Signal]
    body: dict[str, Signal]  #: of the sensors of the body, in the units of their names


def survey_drive(log: DriveLog, places: Sequence[str]) -> DriveSurvey:
    """The numbers of a drive; what was never measured is left out.

    places: names of the wheels, driven ones first.
    """
    speeds = log.wheel_speed_rad_s
    moving = np.nan_to_num(np.abs(speeds)).max(axis=1, initial=0.0) > 0.0
    columns = {
        "wheels": dict(zip(places, speeds.T, strict=True)),
        "motors": dict(zip(places, log.motor_current_A.T, strict=False)),
        "body": {name: getattr(log, name) for name in log.channels},
    }
    known = {
        kind: {name: _signal(values, ~moving) for name, values in of_kind.items() if np.isfinite(values).any()}
        for kind, of_kind in columns.items()
    }
    return DriveSurvey(len(log), log.duration_s, _sampling(log.time_s), **known)


def survey(log: Log) -> Survey:
    """The numbers of a log.

    Raises:
        InputError: the log has no current or no voltage at all.
    """
    for name, values in (("current_A", log.current_A), ("voltage_V", log.voltage_V)):
        if np.isnan(values).all():
            raise InputError(f"log {log.name!r}: {name} has no value; a log needs both current and voltage")
    resting = _resting(log)
    temperature = log.temperature_degC
    return Survey(
        samples=len(log),
        duration_s=log.duration_s,
        sampling=_sampling(log.time_s),
        current=_signal(log.current_A, resting),
        voltage=_signal(log.voltage_V, resting),
        temperature=None if temperature is None or np.isnan(temperature).all() else _signal(temperature, resting),
        sign=_sign(log),
        activity=_activity(log, resting),
    )


def noise_std(values: np.ndarray) -> float:
    """White-noise standard deviation from second differences, blind to slow changes and, being robust, to a few steps.

    For white noise, x[i-1] - 2 x[i] + x[i+1] has six times its variance. Not below rounding, resolution / sqrt(12).

    values: (T,), NaN allowed.
    """
    second = np.diff(values, n=2)
    known = values[np.isfinite(values)]
    return max(spread(second[np.isfinite(second)]) / np.sqrt(6.0), resolution(known) / np.sqrt(12.0))


def _sampling(time_s: np.ndarray) -> Sampling:
    dt = np.diff(time_s)
    if not dt.size:
        return Sampling(0.0, 0.0, 0.0, 0.0, 0, 0.0)
    median = float(np.median(dt))
    gaps = find_gaps(time_s)
    return Sampling(
        median_s=median,
        shortest_s=float(dt.min()),
        longest_s=float(dt.max()),
        irregularity=float(np.mean(np.abs(dt - median) > 0.1 * median)),
        gaps=int(gaps.size),
        longest_gap_s=float(dt[gaps].max(initial=0.0)),
    )


def _signal(values: np.ndarray, resting: np.ndarray) -> Signal:
    """The noise is that at rest where there is enough of it, because a working current is not noise."""
    known = values[np.isfinite(values)]
    at_rest = np.where(resting, values, np.nan)
    enough = np.isfinite(np.diff(at_rest, n=2)).sum() >= _NOISE_LEAST
    return Signal(
        minimum=float(known.min()),
        maximum=float(known.max()),
        missing=int(values.size - known.size),
        levels=int(np.unique(known).size),
        resolution=resolution(known),
        noise_std=float(noise_std(at_rest if enough else values)),
    )


def _sign(log: Log) -> Sign:
    evidence = sign_evidence(log.time_s, log.current_A, log.voltage_V)
    resistance = evidence.edges.resistance_ohm
    known = float(resistance) if np.isfinite(resistance) else None
    return Sign(evidence.verdict, evidence.edges.edges, known, float(evidence.edges.t_value))


def _activity(log: Log, resting: np.ndarray) -> Activity:
    return Activity(
        rests=len(runs(resting)),
        pulses=_pulses(log.time_s, resting),
        rest_current_A=float(np.nanmedian(log.current_A[resting])) if resting.any() else None,
        charge_in_Ah=_charge_Ah(log, 1.0),
        charge_out_Ah=_charge_Ah(log, -1.0),
    )


def _resting(log: Log) -> np.ndarray:
    """(T,) mask of the samples at rest."""
    size = np.abs(log.current_A)
    resting = size <= _REST_FRACTION * np.nanmax(size)
    for first, stop in runs(resting):
        if log.time_s[stop - 1] - log.time_s[first] < _REST_LEAST_S:
            resting[first:stop] = False
    return resting


def _pulses(time_s: np.ndarray, resting: np.ndarray) -> int:
    """Number of flows of current of two minutes at most between two rests."""
    inside = [(first, stop) for first, stop in runs(~resting) if first > 0 and stop < resting.size]
    return sum(bool(time_s[stop] - time_s[first - 1] <= _PULSE_MOST_S) for first, stop in inside)


def _charge_Ah(log: Log, sign: float) -> float:
    """Charge [Ah] that went in (sign 1) or out (sign -1), trapezoids over the samples that have a current."""
    known = np.isfinite(log.current_A)
    if known.sum() < 2:
        return 0.0
    one_way = np.maximum(sign * log.current_A[known], 0.0)
    return float(0.5 * (one_way[1:] + one_way[:-1]) @ np.diff(log.time_s[known])) / SECONDS_PER_HOUR
