"""Check of the wiring: every signal seen, units plausible, and signals that measure the same agree.

The current is compared with the voltage that responds to it, the wheels with each other and with the gyro: by
`ohmward run --check` for all that came, and in the running process for the last seconds.
"""

from __future__ import annotations

import math
from collections import defaultdict, deque
from collections.abc import Iterator, Mapping
from functools import partial
from typing import NamedTuple

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.models.temperature import ROOM_DEGC
from ohmward.battery.models.thevenin import CircuitInput, ohmic_resistance
from ohmward.battery.soc.clean_sample import is_temperature
from ohmward.battery.soc.voltage_faults import JUMP_SHARE
from ohmward.onboard.message import no_such_part, sender, unmeasured_wheels, wheel_number
from ohmward.onboard.robot_state import Diagnostic, Level
from ohmward.quantities import EVENTS, limits_of, quantity_of
from ohmward.signals.checks import NOT_COUNTED, NOTHING_CAME, beyond_limits, doubled, missing, no_numbers, too_seldom
from ohmward.signals.current_sign import check_current_sign, sign_evidence
from ohmward.signals.current_size import check_size, check_wrapped
from ohmward.traction.drive_checks import brakes_all_the_way, only_brakes
from ohmward.traction.motion_check import (
    FEWEST_VALUES,
    TURNING_RAD_S,
    check_signs,
    check_units,
    contradiction,
    faster_than_gyro,
    motion_of,
)
from ohmward.traction.robot.chassis import Steered
from ohmward.traction.robot.robot import Robot

#: In the running process the values of the last seconds are compared, or this many if those last longer.
CHECKED_S, FEWEST_RECENT = 30.0, 60

#: Least time between two of them [s].
_SPACING_S = 0.05

#: Usual resistance: weight of the newest, largest factor from it of one that shows the current to be right, and longest
#: interval between samples that show it [s].
_RESISTANCE_WEIGHT, _CERTAINLY_ALIKE, _ALIKE_S = 0.2, 2.5, 10.0
#: Checks in a row that show about the same resistance until it counts as lasting.
_LASTING_CHECKS = 20


class SignalRecord(NamedTuple):
    """A signal as it came: its sources, times and values (K,), and who sends it there, see `sender`."""

    sources: tuple[str, ...]
    time_s: np.ndarray
    values: np.ndarray
    senders: tuple[str, ...] = ()

    @property
    def rate_hz(self) -> float:
        """Values per second; nan if there are fewer than two."""
        span_s = float(self.time_s[-1] - self.time_s[0]) if len(self.time_s) > 1 else math.nan
        return (len(self.time_s) - 1) / span_s if span_s > 0.0 else math.nan

    @property
    def median(self) -> float:
        """Median of the numbers; nan without any."""
        finite = self.values[np.isfinite(self.values)]
        return float(np.median(finite)) if len(finite) else math.nan

    @property
    def largest(self) -> float:
        """Largest magnitude; nan without any number."""
        finite = self.values[np.isfinite(self.values)]
        return float(np.abs(finite).max()) if len(finite) else math.nan


class Recorder:
    """Values by signal, as they came.

    Args:
        recent: keep only those of the last seconds.
    """

    def __init__(self, recent: bool = False) -> None:
        self._recent = recent
        most = int(CHECKED_S / _SPACING_S) if recent else None
        self._rows: dict[str, deque[tuple[str, float, float, str]]] = defaultdict(partial(deque, maxlen=most))

    def put(self, source: str, time_s: float, values: Mapping[str, float], publisher: str = "") -> None:
        """Take the values of a message."""
        for signal, value in values.items():
            rows = self._rows[signal]
            if not (self._recent and rows and time_s - rows[-1][1] < _SPACING_S):
                rows.append((source, time_s, value, sender(source, publisher)))

    def signals(self) -> dict[str, SignalRecord]:
        """Records of all signals that have come."""
        found = {}
        for signal, rows in sorted(self._rows.items()):
            sources, times, values, senders = zip(*rows, strict=True)
            time_s, first = np.array(times), 0
            if self._recent:
                first = max(min(int(np.searchsorted(time_s, time_s[-1] - CHECKED_S)), len(times) - FEWEST_RECENT), 0)
            numbers = np.array(values, dtype=float)
            of_each = [tuple(sorted(set(names))) for names in (sources, senders)]
            found[signal] = SignalRecord(of_each[0], time_s[first:], numbers[first:], of_each[1])
        return found


def check_wiring(
    found: Mapping[str, SignalRecord],
    promised: Mapping[str, tuple[str, ...]],
    battery: Battery | None,
    robot: Robot | None,
    counted: bool = False,
) -> list[Diagnostic]:
    """Findings about every signal, errors first.

    promised: signals that each source declares.  counted: True if counts per turn of the encoders are given.
    """
    wheels = list(check_wheels(found, robot)) if robot else []
    wrong = {finding.name for finding in wheels if finding.level == Level.ERROR}
    findings = [
        *_missing(found, promised),
        *_needed(found, promised, battery, robot),
        *(finding for signal, record in found.items() for finding in _signal(signal, record, battery, robot)),
        *(CurrentCheck(battery).findings(found) if battery else ()),
        *wheels,
        *(_motor_signs(found, robot, wrong) if robot else ()),
    ]
    if any(signal.startswith("wheel_counts") for signal in found) and not counted:
        findings.append(Diagnostic("wheel_counts", Level.ERROR, NOT_COUNTED))
    return sorted(findings, key=lambda finding: -finding.level)


def _missing(found: Mapping[str, SignalRecord], promised: Mapping[str, tuple[str, ...]]) -> Iterator[Diagnostic]:
    for source, signals in promised.items():
        if not any(source in record.sources for record in found.values()):
            yield Diagnostic(source, Level.ERROR, NOTHING_CAME)
            continue
        for signal in signals:
            if signal not in found:
                yield Diagnostic(signal, Level.ERROR, missing(f"never came from {source}"))


def _needed(
    found: Mapping[str, SignalRecord],
    promised: Mapping[str, tuple[str, ...]],
    battery: Battery | None,
    robot: Robot | None,
) -> Iterator[Diagnostic]:
    """Findings about signals that the estimators need, but no source sends or declares.

    None while a source that may send any signal has sent nothing.
    """
    heard = {source for record in found.values() for source in record.sources}
    if any(source not in heard and not signals for source, signals in promised.items()):
        return
    wired = [*found, *(signal for signals in promised.values() for signal in signals)]
    cells = any(signal.startswith("cell_voltage_V.") for signal in wired)
    if battery and "battery_current_A" not in wired:
        yield Diagnostic("battery_current_A", Level.ERROR, "no source sends it; the charge needs it")
    if battery and "battery_voltage_V" not in wired and not cells:
        yield Diagnostic("battery_voltage_V", Level.ERROR, "no source sends it; the charge needs it")
    if robot:
        for place in unmeasured_wheels(wired, robot):
            signal = f"wheel_speed_rad_s.{place}"
            yield Diagnostic(
                signal, Level.ERROR, "no source sends it; the wheel is driven and its slip unknown without"
            )


def _signal(signal: str, record: SignalRecord, battery: Battery | None, robot: Robot | None) -> Iterator[Diagnostic]:
    quantity = quantity_of(signal)
    if absent := no_such_part(signal, robot):
        yield Diagnostic(signal, Level.ERROR, absent)
        return
    if len(record.senders) > 1 and signal not in EVENTS:
        yield Diagnostic(signal, Level.ERROR, doubled(record.senders))
    finite = record.values[np.isfinite(record.values)]
    limits = limits_of(quantity.name, battery, robot)
    faults = [
        *no_numbers(record.values.size - finite.size, record.values.size),
        *too_seldom(quantity, record.rate_hz, quantity.least_hz),
        *(beyond_limits(quantity, finite.min(), finite.max(), limits, "setup") if finite.size else ()),
    ]
    yield from (Diagnostic(signal, Level.ERROR, str(finding)) for finding in faults)
    if not faults:
        often = "once" if math.isnan(record.rate_hz) else f"{record.rate_hz:.3g} Hz"
        text = f"{often} from {record.sources[0]}, {finite.min():.4g} to {finite.max():.4g}"
        yield Diagnostic(signal, Level.OK, text)


class CurrentCheck:
    """Check of the sign and the size of a battery's current, by the voltage that responds to it.

    Args:
        battery: battery of the file.
        recent: the records are of the last seconds, again and again: what only noise may show must be shown twice.

    Attributes:
        usual_ohm: resistance that the samples checked so far have shown, nan before the first.
    """

    def __init__(self, battery: Battery, recent: bool = False):
        self.usual_ohm, self._recent = math.nan, recent
        self._contradicted_s = math.nan  # when small changes first showed a wrong sign
        self._alike = 0
        self._limits_V = limits_of("battery_voltage_V", battery)
        self._model = battery.thevenin

    def findings(self, found: Mapping[str, SignalRecord]) -> list[Diagnostic]:
        """Findings about a current with recorded voltages; OK only where it is known to be right."""
        current, voltage = found.get("battery_current_A"), found.get("battery_voltage_V")
        if current is None or voltage is None or len(voltage.values) < 2:
            return []
        answered_V = np.interp(current.time_s, voltage.time_s, voltage.values)
        jumps = np.flatnonzero(np.abs(np.diff(answered_V)) > JUMP_SHARE * self._limits_V.highest)
        if jumps.size:  # no current makes such a step: another battery, or a fault of the voltage
            current = current._replace(time_s=current.time_s[jumps[-1] + 1 :], values=current.values[jumps[-1] + 1 :])
            answered_V = answered_V[jumps[-1] + 1 :]
        evidence = sign_evidence(current.time_s, current.values, answered_V)
        if evidence.verdict != "undecidable" and evidence.changes >= 0:
            self._contradicted_s = math.nan
        elif self._recent and evidence.changes < 0:
            if math.isnan(self._contradicted_s):
                self._contradicted_s = current.time_s[-1]
            if current.time_s[0] < self._contradicted_s:
                return []
        measured_ohm = abs(evidence.edges.resistance_ohm) if evidence.edges.sign else math.nan
        if not (
            current.rate_hz * _ALIKE_S >= 1.0 and self._limits_V.lowest <= voltage.median <= self._limits_V.highest
        ):
            measured_ohm = math.nan
        temperature = found.get("battery_temperature_degC")
        degC = temperature.median if temperature else math.nan
        known = bool(is_temperature(degC))
        file_ohm = float(ohmic_resistance(0.5, CircuitInput(0.0, degC if known else ROOM_DEGC), self._model))
        lasts = known and self._alike >= _LASTING_CHECKS
        findings = [
            *check_wrapped(current.values, answered_V),
            *check_current_sign(evidence, "setup"),
            *check_size(measured_ohm, file_ohm, self.usual_ohm, lasts),
        ]
        levels = {"error": Level.ERROR, "info": Level.WARN}
        if findings:
            return [Diagnostic("battery_current_A", levels[f.severity], str(f)) for f in findings]
        if math.isfinite(measured_ohm):
            ratio = measured_ohm / self.usual_ohm if math.isfinite(self.usual_ohm) else 1.0
            if not 1.0 / _CERTAINLY_ALIKE <= ratio <= _CERTAINLY_ALIKE:
                self._alike = 0
                return []
            self._alike += 1
            self.usual_ohm = measured_ohm * ratio ** (_RESISTANCE_WEIGHT - 1.0)
        return [Diagnostic("battery_current_A", Level.OK, f"sign agrees with the voltage ({evidence})")]


def check_wheels(found: Mapping[str, SignalRecord], robot: Robot) -> Iterator[Diagnostic]:
    """Findings about the signs of wheels and gyro, which must agree, and the unit of the gyro."""
    speeds, yaw_rate, names = _at_common_times(found, robot)
    if len(names) < 2:
        return
    motion, together = motion_of(robot, speeds, yaw_rate), "signs of wheels and gyro"
    if motion.values.shape[1] < FEWEST_VALUES:
        yield Diagnostic(together, Level.WARN, "cannot be checked at rest; drive a little, with a turn")
        return
    signs = [(names[k], finding) for k, finding in check_signs(robot, motion, "setup")]
    faults = signs or [(together, finding) for finding in check_units(robot, motion, "setup")]
    yield from (Diagnostic(name, Level.ERROR, str(finding)) for name, finding in faults)
    if not faults and (differ_rad_s := math.sqrt(contradiction(motion.rows, motion.values))) > TURNING_RAD_S:
        text = f"differ by {differ_rad_s:.2g} rad/s; do the wheels slip, are two of them exchanged?"
        yield Diagnostic(together, Level.WARN, text)
    elif len(robot.places) in names and math.isnan(faster_than_gyro(robot, motion)):
        yield Diagnostic(together, Level.WARN, "agree, but the gyro cannot be checked without turns; turn a little")
    elif not faults:
        yield Diagnostic(together, Level.OK, "agree")


def _at_common_times(
    found: Mapping[str, SignalRecord], robot: Robot
) -> tuple[np.ndarray, np.ndarray | None, dict[int, str]]:
    """Speeds (wheels, T) and yaw rate (T,) at the times of the most frequent one; the signal of each row of G."""
    places = [place.name for place in robot.places]
    names = {k: s for s in found if s.startswith("wheel_speed") and (k := wheel_number(s, places)) is not None}
    if "yaw_rate_rad_s" in found:
        names[len(places)] = "yaw_rate_rad_s"
    if not names:
        return np.empty((0, 0)), None, {}
    time_s = max((found[signal].time_s for signal in names.values()), key=len)
    values = {k: np.interp(time_s, found[s].time_s, found[s].values) for k, s in names.items()}
    unknown = np.full(time_s.size, np.nan)
    speeds = np.array([values.get(k, unknown) for k in range(len(places))])
    if isinstance(robot.chassis, Steered) and (steering := found.get("steering_rad")):
        speeds = robot.chassis.wheel_speeds(speeds.T, np.interp(time_s, steering.time_s, steering.values)).T
        names |= {0: "steering_rad", 1: "steering_rad"}
    return speeds, values.get(len(places)), names


def _motor_signs(found: Mapping[str, SignalRecord], robot: Robot, wrong: set[str]) -> Iterator[Diagnostic]:
    """Findings about the sign of each motor's current; wrong: signals whose own sign is wrong."""
    places = [place.name for place in robot.places]
    speeds = {wheel_number(s, places): r for s, r in found.items() if s.startswith("wheel_speed") and s not in wrong}
    for signal, current in found.items():
        if not signal.startswith("motor_current_A") or (k := wheel_number(signal, places)) is None or k not in speeds:
            continue
        speed = np.interp(current.time_s, speeds[k].time_s, speeds[k].values)
        pitch = found.get("pitch_rad")
        pitch_rad = np.interp(current.time_s, pitch.time_s, pitch.values) if pitch else np.zeros_like(speed)
        if np.sum((np.abs(speed) > TURNING_RAD_S) & np.isfinite(current.values)) < FEWEST_VALUES:
            yield Diagnostic(signal, Level.WARN, "its sign cannot be checked at rest; drive a little")
        elif only_brakes(robot, current.time_s, speed, current.values, pitch_rad):
            yield Diagnostic(signal, Level.ERROR, brakes_all_the_way("it", "scale = -1"))
