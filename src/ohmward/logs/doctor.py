"""Examine a log before trusting it: its numbers, everything suspicious in it, and advice."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.clean import YEAR_S
from ohmward.logs.drive_log import DriveLog
from ohmward.logs.log import SECONDS_PER_HOUR, Log, LogSource, as_log
from ohmward.logs.table import counted
from ohmward.quantities import QUANTITIES
from ohmward.runs import runs
from ohmward.signals.checks import Finding, Severity, beyond_limits, in_order, no_numbers, too_seldom
from ohmward.signals.current_sign import SignEvidence, check_current_sign, lost_sign, sign_evidence, turned_sign
from ohmward.signals.current_size import check_hidden_charge
from ohmward.signals.survey import Sampling, Signal, find_gaps, sampling_of, signal_of

# A rest: less than this fraction of the largest current, for at least this time.
_REST_FRACTION = 0.05
_REST_LEAST_S = 10.0
_PULSE_MOST_S = 120.0
#: Lowest sampling rate of a log [Hz]; a robot's estimators need the battery's signals faster.
_SLOWEST_LOG_HZ = 0.1


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
    """Result of `survey`."""

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
    """Statistics of a drive; signals of the wheels [rad/s] and motors [A] by the places of the wheels."""

    samples: int
    duration_s: float
    sampling: Sampling
    wheels: dict[str, Signal]
    motors: dict[str, Signal]
    body: dict[str, Signal]  #: of the body sensors, in the units given by their names


def survey(log: Log, evidence: SignEvidence) -> Survey:
    """Statistics of a log, with the evidence of the sign of its current; InputError without any current or voltage."""
    for name, values in (("current_A", log.current_A), ("voltage_V", log.voltage_V)):
        if np.isnan(values).all():
            raise InputError(f"log {log.name!r}: {name} has no value; a log needs both current and voltage")
    edges = evidence.edges
    resistance_ohm = float(edges.resistance_ohm) if np.isfinite(edges.resistance_ohm) else None
    resting = _resting(log)
    between_rests = [(first, stop) for first, stop in runs(~resting) if first > 0 and stop < resting.size]
    working_s = [float(log.time_s[stop] - log.time_s[first - 1]) for first, stop in between_rests]
    temperature = log.temperature_degC
    return Survey(
        samples=len(log),
        duration_s=log.duration_s,
        sampling=sampling_of(log.time_s),
        current=signal_of(log.current_A, resting),
        voltage=signal_of(log.voltage_V, resting),
        temperature=None if temperature is None or np.isnan(temperature).all() else signal_of(temperature, resting),
        sign=Sign(evidence.verdict, edges.edges, resistance_ohm, float(edges.t_value)),
        activity=Activity(
            rests=len(runs(resting)),
            pulses=sum(duration_s <= _PULSE_MOST_S for duration_s in working_s),
            rest_current_A=float(np.nanmedian(log.current_A[resting])) if resting.any() else None,
            charge_in_Ah=_charge_Ah(log, 1.0),
            charge_out_Ah=_charge_Ah(log, -1.0),
        ),
    )


def _resting(log: Log) -> np.ndarray:
    """(T,) mask of the samples at rest."""
    size = np.abs(log.current_A)
    resting = size <= _REST_FRACTION * np.nanmax(size)
    for first, stop in runs(resting):
        if log.time_s[stop - 1] - log.time_s[first] < _REST_LEAST_S:
            resting[first:stop] = False
    return resting


def _charge_Ah(log: Log, sign: float) -> float:
    """Charge [Ah] that went in (sign 1) or out (sign -1), trapezoids over the samples that have a current.

    Gaps are left out: the current is unknown there.
    """
    known = np.isfinite(log.current_A)
    if known.sum() < 2:
        return 0.0
    one_way = np.maximum(sign * log.current_A[known], 0.0)
    time_s = log.time_s[known]
    step_s = np.diff(time_s)
    step_s[find_gaps(time_s)] = 0.0
    return float(0.5 * (one_way[1:] + one_way[:-1]) @ step_s) / SECONDS_PER_HOUR


#: A battery is seldom warmer than this throughout a log [degC].
_WARM_DEGC = 45.0

S = TypeVar("S", Survey, DriveSurvey)


@dataclass(frozen=True)
class Findings(Generic[S]):
    """The examination of one log, or drive; `dataclasses.asdict` makes it ready for JSON."""

    name: str
    survey: S
    findings: tuple[Finding, ...]
    notes: tuple[str, ...]

    @property
    def worst(self) -> Severity:
        """The highest severity among the findings, that of the first one; "info" without findings."""
        return self.findings[0].severity if self.findings else "info"


def examine(log: LogSource) -> Findings[Survey]:
    """Survey a log, also given as a path or DataFrame, and list everything suspicious in it, errors first.

    >>> found = ow.examine("day.csv")
    >>> found.survey.samples
    33744
    """
    log = as_log(log)
    evidence = sign_evidence(log.time_s, log.current_A, log.voltage_V)
    found = survey(log, evidence)
    hidden = check_hidden_charge(log.time_s, log.current_A, log.voltage_V)
    turned = turned_sign(log.time_s, log.current_A, log.voltage_V)
    lost = filter(None, (lost_sign(log.current_A, log.voltage_V) or turned,))
    findings = in_order((*_faults_of_battery(found, evidence), *hidden, *lost))
    return Findings(log.name, found, findings, tuple(map(str, log.notes)))


def examine_drive(log: DriveLog, places: Sequence[str]) -> Findings[DriveSurvey]:
    """Survey a drive, and list everything that prevents estimates of speed, slip and pose, errors first.

    Channels that were never measured are left out.

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
        kind: {name: signal_of(values, ~moving) for name, values in of_kind.items() if np.isfinite(values).any()}
        for kind, of_kind in columns.items()
    }
    found = DriveSurvey(len(log), log.duration_s, sampling_of(log.time_s), **known)
    return Findings(log.name, found, in_order(_faults_of_drive(found)), tuple(map(str, log.notes)))


def _faults_of_drive(s: DriveSurvey) -> Iterator[Finding]:
    """Faults that prevent estimates of speed, slip and pose."""
    still = {name: wheel.minimum for name, wheel in s.wheels.items() if wheel.minimum == wheel.maximum}
    if len(still) == len(s.wheels) and not any(still.values()):
        yield Finding("error", "no wheel ever turns", "check the columns of the wheels and the encoders")
        still = {}
    for name, speed_rad_s in still.items():
        yield Finding("warning", f"the wheel {name} never changes ({speed_rad_s:g} rad/s)", "check its encoder")
    if s.wheels and s.sampling.median_s:
        wheel = QUANTITIES["wheel_speed_rad_s"]
        yield from too_seldom(wheel, 1.0 / s.sampling.median_s, wheel.least_hz, "a sample ")
    yield from _gaps(s.sampling)
    if not s.motors and "speed_m_s" not in s.body:
        yield Finding(
            "warning",
            "neither motor currents nor a speed from outside",
            "a wheel that slips looks like one that rolls; log the motors' currents, or a speed from GNSS or cameras; "
            "one in the log is read if its column or topic is named",
        )
    if "yaw_rate_rad_s" not in s.body:
        yield Finding("info", "no gyro", "the heading then follows from the wheels, and drifts; log the yaw rate")


def _faults_of_battery(s: Survey, evidence: SignEvidence) -> Iterator[Finding]:
    """Faults that prevent the identification of a model, or an estimate of the charge."""
    for name, signal in (("voltage", s.voltage), ("current", s.current), ("temperature", s.temperature)):
        if signal is None:
            yield Finding("info", "no temperature", "resistance and capacity depend on it; record it if you can")
            continue
        quantity = next(q for q in QUANTITIES.values() if q.owner == "battery" and q.channel == name)
        what = f"the {name} "
        yield from beyond_limits(quantity, signal.minimum, signal.maximum, quantity.limits, "log", what)
        if signal is s.temperature and signal.minimum > _WARM_DEGC:
            yield Finding(
                "warning",
                f"the temperature never falls below {signal.minimum:.4g} degC",
                "seldom so in a battery; degrees Fahrenheit? use --unit temperature=degF",
            )
        if quantity.required:
            yield from no_numbers(signal.missing, s.samples, f"{name}: ")
    low_V, high_V = s.voltage.minimum, s.voltage.maximum
    if low_V >= 0.0 and high_V <= 0.5:
        text = f"voltages of {high_V:g} V at most"
        yield Finding("error", text, "another quantity or unit? use --column voltage=NAME")
    elif low_V == high_V:
        text = f"the voltage never changes ({low_V:g} V)"
        yield Finding("error", text, "the sensor or the column is dead; check both")
    yield from _faults_of_current(s)
    yield from check_current_sign(evidence, "log")
    yield from _faults_of_sampling(s)
    yield from _gaps(s.sampling)
    offset = s.activity.rest_current_A
    drift_Ah = abs(offset or 0.0) * s.duration_s / SECONDS_PER_HOUR
    if offset is not None and drift_Ah > 0.01 * (s.activity.charge_in_Ah + s.activity.charge_out_Ah):
        yield Finding(
            "warning",
            f"the current at rest reads {offset:g} A, which adds up to {drift_Ah:.2g} Ah over the log",
            "an idle draw, or an offset of the sensor, by which coulomb counting drifts; let the filter estimate it",
        )
    finer = "use a finer sensor or range; small changes cannot be seen"
    # a pulse test has few levels of current by design
    if s.current.levels >= 8 and s.current.resolution > 0.02 * s.current.largest:
        yield Finding("warning", f"the current has steps of {s.current.resolution:g} A, over 2 % of its largest", finer)
    if s.voltage.resolution > 0.02 * (s.voltage.maximum - s.voltage.minimum):
        yield Finding("warning", f"the voltage has steps of {s.voltage.resolution:g} V, over 2 % of its range", finer)


def _faults_of_current(s: Survey) -> Iterator[Finding]:
    if s.current.maximum - s.current.minimum <= 0.01 * s.current.largest:
        yield Finding(
            "error",
            f"the current never changes ({s.current.maximum:g} A): resistances cannot be identified",
            "record pulses with rests between them, or check the current column",
        )
    elif s.sign.edges == 0:
        yield Finding(
            "warning",
            "the current has no edges: resistances cannot be separated from the open-circuit voltage",
            "record a log with steps of the current, for example a pulse test",
        )


def _faults_of_sampling(s: Survey) -> Iterator[Finding]:
    if s.samples < 100:
        yield Finding("warning", f"only {counted(s.samples, 'sample')}", "longer logs give estimates worth having")
    if s.sampling.median_s:
        rate_hz = 1.0 / s.sampling.median_s
        yield from too_seldom(QUANTITIES["battery_voltage_V"], rate_hz, _SLOWEST_LOG_HZ, "a sample ")
    if s.sampling.irregularity > 0.05:
        yield Finding(
            "info",
            f"{s.sampling.irregularity:.0%} of the intervals differ from the median by more than a tenth",
            "nothing to do: time comes with every sample and is used",
        )


def _gaps(sampling: Sampling) -> Iterator[Finding]:
    """A finding on the gaps in a log or drive."""
    if sampling.longest_gap_s > YEAR_S:
        yield Finding(
            "error",
            f"a gap of {sampling.longest_gap_s / YEAR_S:.1f} years",
            "the clock was set while the log ran; keep one side of the gap",
        )
    elif sampling.gaps:
        yield Finding(
            "warning" if sampling.longest_gap_s > 60.0 else "info",
            f"{counted(sampling.gaps, 'gap')} without samples, the longest {sampling.longest_gap_s:g} s",
            "charge that flowed there is not counted; estimates are less sure after a gap",
        )
