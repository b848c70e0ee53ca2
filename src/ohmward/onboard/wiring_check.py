"""Check of the wiring of a robot before its estimates are trusted: every signal seen, units plausible, signs agree."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.logs.sign import WRONG_SIGN, sign_evidence
from ohmward.onboard.message import Message
from ohmward.onboard.message_parts import no_such_part, wheel_number
from ohmward.onboard.robot_state import Diagnostic, Level
from ohmward.onboard.sensor_watch import NOT_COUNTED, SCALES, doubled, implausible, missing, no_number
from ohmward.quantities import limits_of, quantity_of
from ohmward.traction.drive_checks import FEWEST, brakes_all_the_way, only_brakes
from ohmward.traction.motion_check import MotionCheck, contradiction, wrong_sign, wrong_signs
from ohmward.traction.robot.robot import Robot

#: A wheel that turns slower than this tells nothing about its sign [rad/s].
TURNING_RAD_S = 0.5

#: Contradictions [rad/s] below this are the noise of encoders and gyro, and a little slip.
LEAST_RAD_S = 0.1

#: Wheels and gyro differ by no more than this factor by radius and track.
MOST_FASTER = 1.5


class SignalRecord(NamedTuple):
    """A signal as it came: its sources, times and values (K,)."""

    sources: tuple[str, ...]
    time_s: np.ndarray
    values: np.ndarray

    @property
    def rate_hz(self) -> float:
        """Values per second; nan where there are fewer than two."""
        span_s = float(self.time_s[-1] - self.time_s[0]) if len(self.time_s) > 1 else math.nan
        return (len(self.time_s) - 1) / span_s if span_s > 0.0 else math.nan

    @property
    def median(self) -> float:
        """Median of the numbers; nan without any."""
        finite = self.values[np.isfinite(self.values)]
        return float(np.median(finite)) if len(finite) else math.nan

    @property
    def largest(self) -> float:
        """Largest magnitude; nan without any."""
        finite = self.values[np.isfinite(self.values)]
        return float(np.abs(finite).max()) if len(finite) else math.nan


class Recorder:
    """Everything that the sources send, by signal."""

    def __init__(self) -> None:
        self._rows: dict[str, list[tuple[str, float, float]]] = defaultdict(list)

    def put(self, message: Message) -> None:
        """Take a message in."""
        for signal, value in message.values.items():
            self._rows[signal].append((message.source, message.received_s, value))

    def signals(self) -> dict[str, SignalRecord]:
        """Records of all signals that have come."""
        return {signal: self.record(rows) for signal, rows in sorted(self._rows.items())}

    @staticmethod
    def record(rows: Sequence[tuple[str, float, float]]) -> SignalRecord:
        """The record of a signal from its sources, times and values."""
        sources, times, values = zip(*rows, strict=True)
        return SignalRecord(tuple(sorted(set(sources))), np.array(times), np.array(values, dtype=float))


def check_wiring(
    found: Mapping[str, SignalRecord],
    promised: Mapping[str, tuple[str, ...]],
    battery: Battery | None,
    robot: Robot | None,
    counted: bool = False,
) -> list[Diagnostic]:
    """Findings about every signal, what is wrong first.

    promised: signals that each source says it sends.  counted: True where counts per turn of the encoders are given.
    """
    wheels = list(_wheel_signs(found, robot)) if robot else []
    wrong = {finding.name for finding in wheels if finding.level == Level.ERROR}
    findings = [
        *_missing(found, promised),
        *_needed(found, promised, battery, robot),
        *(finding for signal, record in found.items() for finding in _signal(signal, record, battery, robot)),
        *_current_sign(found, battery),
        *wheels,
        *(_motor_signs(found, robot, wrong) if robot else ()),
    ]
    if any(signal.startswith("wheel_counts") for signal in found) and not counted:
        findings.append(Diagnostic("wheel_counts", Level.ERROR, NOT_COUNTED))
    return sorted(findings, key=lambda finding: -finding.level)


def _missing(found: Mapping[str, SignalRecord], promised: Mapping[str, tuple[str, ...]]) -> Iterator[Diagnostic]:
    for source, signals in promised.items():
        if not any(source in record.sources for record in found.values()):
            yield Diagnostic(source, Level.ERROR, "sent nothing; is the other side on, and connected?")
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
    """Signals that the estimators cannot do without, and that no source sends or promises."""
    wired = [*found, *(signal for signals in promised.values() for signal in signals)]
    cells = any(signal.startswith("cell_voltage_V.") for signal in wired)
    if battery and "battery_current_A" not in wired:
        yield Diagnostic("battery_current_A", Level.ERROR, "no source sends it; the charge cannot be counted without")
    if battery and "battery_voltage_V" not in wired and not cells:
        yield Diagnostic("battery_voltage_V", Level.ERROR, "no source sends it; the charge cannot be told without")
    if robot:
        places = [place.name for place in robot.places]
        measured = {
            wheel_number(signal, places) for signal in wired if signal.startswith(("wheel_speed", "wheel_counts"))
        }
        for place in places[: robot.driven]:
            if places.index(place) not in measured:
                signal = f"wheel_speed_rad_s.{place}"
                yield Diagnostic(
                    signal, Level.ERROR, "no source sends it; the wheel is driven and its slip unknown without"
                )


def _signal(signal: str, record: SignalRecord, battery: Battery | None, robot: Robot | None) -> Iterator[Diagnostic]:
    """Findings about one signal alone."""
    quantity = quantity_of(signal)
    if absent := no_such_part(signal, robot):
        yield Diagnostic(signal, Level.ERROR, absent)
        return
    if len(record.sources) > 1:
        yield Diagnostic(signal, Level.ERROR, doubled(record.sources))
    finite = float(np.isfinite(record.values).mean())
    if finite < 1.0:
        yield Diagnostic(signal, Level.ERROR, no_number(f"in {1 - finite:.0%} of its values"))
        if finite == 0.0:
            return
    if record.rate_hz < quantity.least_hz:
        text = f"comes {record.rate_hz:.2g} times a second; at least {quantity.least_hz:g} are needed"
        yield Diagnostic(signal, Level.ERROR, text)
    low, high = limits_of(quantity.name, battery, robot)
    lowest, highest = float(np.nanmin(record.values)), float(np.nanmax(record.values))
    if low <= lowest and highest <= high:
        often = "once" if math.isnan(record.rate_hz) else f"{record.rate_hz:.3g} Hz"
        yield Diagnostic(signal, Level.OK, f"{often} from {record.sources[0]}, {lowest:.4g} to {highest:.4g}")
    else:
        yield Diagnostic(signal, Level.ERROR, implausible(signal, lowest, highest, (low, high)))


def _current_sign(found: Mapping[str, SignalRecord], battery: Battery | None) -> Iterator[Diagnostic]:
    """The sign of the current, by the voltage that answers it."""
    current, voltage = found.get("battery_current_A"), found.get("battery_voltage_V")
    if battery is None or current is None or voltage is None or len(voltage.values) < 2:
        return
    answered_V = np.interp(current.time_s, voltage.time_s, voltage.values)
    evidence = sign_evidence(current.time_s, current.values, answered_V)
    if evidence.verdict == "discharge":
        text = f"{WRONG_SIGN} ({evidence}); current > 0 must charge: scale = -1"
        yield Diagnostic("battery_current_A", Level.ERROR, text)
    elif evidence.verdict == "undecidable":
        yield Diagnostic("battery_current_A", Level.WARN, f"its sign cannot be told yet ({evidence}); drive a little")
    else:
        yield Diagnostic("battery_current_A", Level.OK, f"sign agrees with the voltage ({evidence})")


def _wheel_signs(found: Mapping[str, SignalRecord], robot: Robot) -> Iterator[Diagnostic]:
    """The signs of wheels and gyro by their contradictions, and the unit of the gyro."""
    rows, values, names = _motion(found, robot)
    if len(names) < 2:
        return
    moving = np.abs(values).max(axis=0) > TURNING_RAD_S
    if moving.sum() < FEWEST:
        yield Diagnostic("signs of wheels and gyro", Level.WARN, "cannot be told at rest; drive a little, with a turn")
        return
    values = values[:, moving]
    if wrong := wrong_signs(rows, values, LEAST_RAD_S**2):
        yield Diagnostic(names[wrong[0]], Level.ERROR, wrong_sign("it", "scale = -1"))
        return
    faster = _faster_than_gyro(rows, values, names)
    if math.isfinite(faster) and not 1.0 / MOST_FASTER < faster < MOST_FASTER:
        near = [(scale, name) for scale, name in SCALES["rad_s"] if 1.0 / MOST_FASTER < scale * faster < MOST_FASTER]
        fix = f"{near[0][1]}? then scale = {near[0][0]:.4g}" if near else "check their units, the radius and the track"
        text = f"the wheels turn the robot {faster:.3g} times as fast as the gyro; {fix}"
        yield Diagnostic("signs of wheels and gyro", Level.ERROR, text)
    elif (differ_rad_s := math.sqrt(contradiction(rows, values))) > TURNING_RAD_S:
        text = f"differ by {differ_rad_s:.2g} rad/s; do the wheels slip, are two of them exchanged?"
        yield Diagnostic("signs of wheels and gyro", Level.WARN, text)
    else:
        yield Diagnostic("signs of wheels and gyro", Level.OK, "agree")


def _faster_than_gyro(rows: np.ndarray, values: np.ndarray, names: list[str]) -> float:
    """Yaw rate by the wheels over that of the gyro, nan where they do not tell it or the robot has hardly turned."""
    if "yaw_rate_rad_s" not in names:
        return math.nan
    gyro = names.index("yaw_rate_rad_s")
    wheels = [k for k in range(len(names)) if k != gyro]
    if np.linalg.matrix_rank(rows) > np.linalg.matrix_rank(rows[wheels]):
        return math.nan
    motion = np.linalg.lstsq(rows[wheels], values[wheels], rcond=None)[0]
    power = float(np.sum(values[gyro] ** 2))
    enough = power > len(values[gyro]) * LEAST_RAD_S**2
    return float(np.sum(rows[gyro] @ motion * values[gyro]) / power) if enough else math.nan


def _motion(found: Mapping[str, SignalRecord], robot: Robot) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Rows of G of the wheels and the gyro that report, their values (rows, T) at common times, and their names."""
    check, places = MotionCheck(robot), [place.name for place in robot.places]
    chosen = {
        signal: check.rows[-1 if signal == "yaw_rate_rad_s" else wheel_number(signal, places)]
        for signal in found
        if signal == "yaw_rate_rad_s" or (signal.startswith("wheel_speed") and wheel_number(signal, places) is not None)
    }
    if not chosen:
        return np.empty((0, 0)), np.empty((0, 0)), []
    time_s = max((found[signal].time_s for signal in chosen), key=len)
    scales = {signal: check.scale if signal == "yaw_rate_rad_s" else 1.0 for signal in chosen}
    values = [scales[s] * np.interp(time_s, found[s].time_s, found[s].values) for s in chosen]
    return np.array(list(chosen.values())), np.nan_to_num(np.array(values)), list(chosen)


def _motor_signs(found: Mapping[str, SignalRecord], robot: Robot, wrong: set[str]) -> Iterator[Diagnostic]:
    """The sign of each motor's current; wrong: signals whose own sign is wrong."""
    places = [place.name for place in robot.places]
    speeds = {wheel_number(s, places): r for s, r in found.items() if s.startswith("wheel_speed") and s not in wrong}
    for signal, current in found.items():
        if not signal.startswith("motor_current_A") or (k := wheel_number(signal, places)) is None or k not in speeds:
            continue
        speed = np.interp(current.time_s, speeds[k].time_s, speeds[k].values)
        pitch = found.get("pitch_rad")
        pitch_rad = np.interp(current.time_s, pitch.time_s, pitch.values) if pitch else np.zeros_like(speed)
        if np.sum((np.abs(speed) > TURNING_RAD_S) & np.isfinite(current.values)) < FEWEST:
            yield Diagnostic(signal, Level.WARN, "its sign cannot be told at rest; drive a little")
        elif only_brakes(robot, current.time_s, speed, current.values, pitch_rad):
            yield Diagnostic(signal, Level.ERROR, brakes_all_the_way("it", "scale = -1"))
