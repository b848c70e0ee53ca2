"""Examine a log before trusting it: its numbers, everything suspicious in it, and advice."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Generic, Literal, TypeVar

from ohmward.logs.clean import lacking
from ohmward.logs.drive_log import DriveLog
from ohmward.logs.log import LogSource, as_log
from ohmward.logs.note import counted
from ohmward.logs.plausible import YEAR_S
from ohmward.logs.sign import OTHER_SIGN, WRONG_SIGN
from ohmward.logs.survey import DriveSurvey, Survey, survey, survey_drive
from ohmward.quantities import COLDEST_DEGC, HOTTEST_DEGC

S = TypeVar("S", Survey, DriveSurvey)
Severity = Literal["info", "warning", "error"]

#: Longest interval [s] of a drive that shows slip.
SLOW_DRIVE_S = 0.2


@dataclass(frozen=True)
class Finding:
    """One thing that was noticed, and the advice that goes with it; an error makes results wrong."""

    severity: Severity
    text: str
    advice: str


@dataclass(frozen=True)
class Findings(Generic[S]):
    """The examination of one log, or drive; `dataclasses.asdict` makes it ready for JSON."""

    name: str
    survey: S
    findings: tuple[Finding, ...]
    notes: tuple[str, ...]

    @property
    def worst(self) -> Severity:
        """The highest severity among the findings; "info" without findings."""
        severities = {finding.severity for finding in self.findings}
        return "error" if "error" in severities else "warning" if "warning" in severities else "info"


def examine(log: LogSource) -> Findings[Survey]:
    """Survey a log, or that of a path or DataFrame, and list everything suspicious in it, errors first."""
    log = as_log(log)
    found = survey(log)
    findings = [finding for check in _CHECKS for finding in check(found)]
    return Findings(
        name=log.name,
        survey=found,
        findings=_in_order(findings),
        notes=tuple(str(note) for note in log.notes),
    )


def examine_drive(log: DriveLog, places: Sequence[str]) -> Findings[DriveSurvey]:
    """Survey a drive, and list everything in it that keeps speed, slip and pose from being known, errors first.

    places: names of the wheels, driven ones first.
    """
    found = survey_drive(log, places)
    findings = [finding for check in _DRIVE_CHECKS for finding in check(found)]
    return Findings(log.name, found, _in_order(findings), tuple(str(note) for note in log.notes))


def _in_order(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Errors, then warnings, then the rest."""
    order = ("error", "warning", "info")
    return tuple(sorted(findings, key=lambda finding: order.index(finding.severity)))


def _check_wheels(s: DriveSurvey) -> Iterator[Finding]:
    if all(wheel.minimum == wheel.maximum == 0.0 for wheel in s.wheels.values()):
        yield Finding("error", "no wheel ever turns", "check the columns of the wheels and the encoders")
        return
    for name, wheel in s.wheels.items():
        if wheel.minimum == wheel.maximum:
            yield Finding("warning", f"the wheel {name} never changes ({wheel.minimum:g} rad/s)", "check its encoder")


def _check_drive_sampling(s: DriveSurvey) -> Iterator[Finding]:
    if s.sampling.median_s > SLOW_DRIVE_S:
        yield Finding(
            "warning",
            f"one sample every {s.sampling.median_s:g} s",
            "a wheel slips for tenths of a second; log the wheels at 20 Hz or faster",
        )


def _check_slip_sensors(s: DriveSurvey) -> Iterator[Finding]:
    if not s.motors and "speed_m_s" not in s.body:
        yield Finding(
            "warning",
            "neither motor currents nor a speed from outside",
            "a wheel that slips cannot be told from one that rolls; log the motors' currents, or GNSS or visual speed",
        )
    if "yaw_rate_rad_s" not in s.body:
        yield Finding("info", "no gyro", "the heading then follows from the wheels, and drifts; log the yaw rate")


def _check_voltage(s: Survey) -> Iterator[Finding]:
    low, high = s.voltage.minimum, s.voltage.maximum
    if high > 1500.0:
        yield Finding("error", f"voltages up to {high:g} V", "millivolts? use --unit voltage=mV")
    elif low < 0.0:
        yield Finding("error", f"negative voltages down to {low:g} V", "check the column and the wiring of the sensor")
    elif high <= 0.5:
        yield Finding("error", f"voltages of {high:g} V at most", "another quantity or unit? use --column voltage=NAME")
    elif low == high:
        yield Finding("error", f"the voltage never changes ({low:g} V)", "the sensor or the column is dead; check both")


def _check_current(s: Survey) -> Iterator[Finding]:
    if _largest_A(s) > 1500.0:
        yield Finding("warning", f"currents up to {_largest_A(s):g} A", "milliamperes? use --unit current=mA")
    if s.current.maximum - s.current.minimum <= 0.01 * _largest_A(s):
        yield Finding(
            "error",
            f"the current never changes ({s.current.maximum:g} A): resistances cannot be identified",
            "record pulses with rests between them, or check the current column",
        )
    elif s.sign.edges == 0:
        yield Finding(
            "warning",
            "the current has no edges: resistances cannot be told from the open-circuit voltage",
            "record a log with steps of the current, for example a pulse test",
        )


def _check_sign(s: Survey) -> Iterator[Finding]:
    if s.sign.verdict == "discharge":
        yield Finding("error", WRONG_SIGN, OTHER_SIGN)
    elif s.sign.verdict == "undecidable":
        yield Finding(
            "info", "the data do not show the sign of the current", "make sure that current > 0 charges the battery"
        )


def _check_sampling(s: Survey) -> Iterator[Finding]:
    if s.samples < 100:
        yield Finding("warning", f"only {counted(s.samples, 'sample')}", "longer logs give estimates worth having")
    if s.sampling.median_s > 10.0:
        yield Finding(
            "warning",
            f"one sample every {s.sampling.median_s:g} s",
            "ohmic resistance and fast time constants blur into one; sample at 1 Hz or faster",
        )
    if s.sampling.irregularity > 0.05:
        yield Finding(
            "info",
            f"{s.sampling.irregularity:.0%} of the intervals differ from the median by more than a tenth",
            "nothing to do: time comes with every sample and is used",
        )


def _check_gaps(s: Survey | DriveSurvey) -> Iterator[Finding]:
    if s.sampling.longest_gap_s > YEAR_S:
        yield Finding(
            "error",
            f"a gap of {s.sampling.longest_gap_s / YEAR_S:.1f} years",
            "the clock was set while the log ran; keep one side of the gap",
        )
    elif s.sampling.gaps:
        yield Finding(
            "warning" if s.sampling.longest_gap_s > 60.0 else "info",
            f"{counted(s.sampling.gaps, 'gap')} without samples, the longest {s.sampling.longest_gap_s:g} s",
            "charge that flowed there is only guessed; estimates are less sure after a gap",
        )


def _check_missing(s: Survey) -> Iterator[Finding]:
    for name, signal in (("current", s.current), ("voltage", s.voltage)):
        if signal.missing:
            yield Finding(
                "warning",
                lacking(signal.missing, s.samples, name),
                "estimators skip them; find out why the sensor was silent",
            )


def _check_offset(s: Survey) -> Iterator[Finding]:
    offset = s.activity.rest_current_A
    drift_Ah = abs(offset or 0.0) * s.duration_s / 3600.0
    throughput_Ah = s.activity.charge_in_Ah + s.activity.charge_out_Ah
    if offset is not None and drift_Ah > 0.01 * throughput_Ah:
        yield Finding(
            "warning",
            f"the current at rest reads {offset:g} A, which adds up to {drift_Ah:.2g} Ah over the log",
            "an idle draw, or an offset of the sensor, by which coulomb counting drifts; let the filter estimate it",
        )


def _check_resolution(s: Survey) -> Iterator[Finding]:
    finer = "use a finer sensor or range; small changes cannot be seen"
    # a pulse test has few levels of current by intention
    if s.current.levels >= 8 and s.current.resolution > 0.02 * _largest_A(s):
        yield Finding("warning", f"the current has steps of {s.current.resolution:g} A, over 2 % of its largest", finer)
    if s.voltage.resolution > 0.02 * (s.voltage.maximum - s.voltage.minimum):
        yield Finding("warning", f"the voltage has steps of {s.voltage.resolution:g} V, over 2 % of its range", finer)


def _check_temperature(s: Survey) -> Iterator[Finding]:
    if s.temperature is None:
        yield Finding("info", "no temperature", "resistance and capacity depend on it; record it if you can")
    elif s.temperature.maximum > HOTTEST_DEGC or s.temperature.minimum < COLDEST_DEGC:
        yield Finding(
            "error",
            f"temperatures from {s.temperature.minimum:g} to {s.temperature.maximum:g} degC",
            "kelvin or degrees Fahrenheit? use --unit temperature=K",
        )


def _largest_A(s: Survey) -> float:
    return max(abs(s.current.minimum), abs(s.current.maximum))


_CHECKS: tuple[Callable[[Survey], Iterator[Finding]], ...] = (
    _check_voltage,
    _check_current,
    _check_sign,
    _check_sampling,
    _check_gaps,
    _check_missing,
    _check_offset,
    _check_resolution,
    _check_temperature,
)
_DRIVE_CHECKS: tuple[Callable[[DriveSurvey], Iterator[Finding]], ...] = (
    _check_wheels,
    _check_drive_sampling,
    _check_gaps,
    _check_slip_sensors,
)
