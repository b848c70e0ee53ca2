"""Trial of a setup before its estimates are trusted: every signal seen, units plausible, signs agree.

Its sources are run and its sinks opened, but nothing is estimated or sent.
"""

from __future__ import annotations

import asyncio
import math
from collections import defaultdict
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.file import load_battery
from ohmward.onboard.assembly import sinks_of
from ohmward.onboard.control.simulated_drives import connect_simulated_drives
from ohmward.onboard.feed import Feed
from ohmward.onboard.message import Message, no_such_part, unmeasured_wheels, wheel_number
from ohmward.onboard.part import ActingSink, is_live, keep_running
from ohmward.onboard.robot_setup import Setup
from ohmward.onboard.robot_state import Diagnostic, Level
from ohmward.quantities import limits_of, quantity_of
from ohmward.signals.checks import NOT_COUNTED, beyond_limits, doubled, missing, no_numbers, too_seldom
from ohmward.signals.current_sign import check_current_sign, sign_evidence
from ohmward.signals.current_size import check_wrapped
from ohmward.traction.drive_checks import brakes_all_the_way, only_brakes
from ohmward.traction.motion_check import (
    FEWEST_VALUES,
    TURNING_RAD_S,
    check_signs,
    check_units,
    contradiction,
    motion_of,
)
from ohmward.traction.robot.chassis import Steered
from ohmward.traction.robot.packaged import load_robot
from ohmward.traction.robot.robot import Robot


class SignalRecord(NamedTuple):
    """A signal as it came: its sources, times and values (K,)."""

    sources: tuple[str, ...]
    time_s: np.ndarray
    values: np.ndarray

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
        found = {}
        for signal, rows in sorted(self._rows.items()):
            sources, times, values = zip(*rows, strict=True)
            found[signal] = SignalRecord(tuple(sorted(set(sources))), np.array(times), np.array(values, dtype=float))
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
    wheels = list(_wheel_signs(found, robot)) if robot else []
    wrong = {finding.name for finding in wheels if finding.level == Level.ERROR}
    findings = [
        *_missing(found, promised),
        *_needed(found, promised, battery, robot),
        *(finding for signal, record in found.items() for finding in _signal(signal, record, battery, robot)),
        *_current(found, battery),
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
    """Findings about signals that the estimators need, but no source sends or declares."""
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
    if len(record.sources) > 1:
        yield Diagnostic(signal, Level.ERROR, doubled(record.sources))
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


def _current(found: Mapping[str, SignalRecord], battery: Battery | None) -> Iterator[Diagnostic]:
    """Findings about the size and the sign of the current, from the voltage that responds to it."""
    current, voltage = found.get("battery_current_A"), found.get("battery_voltage_V")
    if battery is None or current is None or voltage is None or len(voltage.values) < 2:
        return
    answered_V = np.interp(current.time_s, voltage.time_s, voltage.values)
    evidence = sign_evidence(current.time_s, current.values, answered_V)
    findings = [*check_wrapped(current.values, answered_V), *check_current_sign(evidence, "setup")]
    levels = {"error": Level.ERROR, "info": Level.WARN}
    for finding in findings:
        yield Diagnostic("battery_current_A", levels[finding.severity], str(finding))
    if not findings:
        yield Diagnostic("battery_current_A", Level.OK, f"sign agrees with the voltage ({evidence})")


def _wheel_signs(found: Mapping[str, SignalRecord], robot: Robot) -> Iterator[Diagnostic]:
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


#: Longest wait for the first message of a simulated robot, which is compiled first.
COMPILED_S = 60.0


class Trial(NamedTuple):
    """Result of a trial."""

    signals: Mapping[str, SignalRecord]  #: as they came
    findings: list[Diagnostic]  #: about parts and signals, errors first

    @property
    def passed(self) -> bool:
        """True if nothing is wrong; what could not be checked counts as right."""
        return all(finding.level < Level.ERROR for finding in self.findings)


def try_setup(setup: Setup, seconds: float) -> Trial:
    """Listen for `seconds`, and check the received signals.

    Raises:
        InputError: a file cannot be read.
    """
    battery = load_battery(Path(setup.battery)) if setup.battery else None
    robot = load_robot(setup.robot) if setup.robot else None
    recorder = Recorder()
    found_live = asyncio.run(_listen(setup, recorder, seconds))
    promised = {source.name: tuple(getattr(source, "signals", ())) for source in setup.source}
    found = recorder.signals()
    checked = check_wiring(found, promised, battery, robot, setup.counts_per_turn is not None)
    return Trial(found, sorted([*found_live.values(), *checked], key=lambda finding: -finding.level))


async def _listen(setup: Setup, recorder: Recorder, seconds: float) -> dict[str, Diagnostic]:
    """Run sources and sinks for `seconds`, or until every source has ended; return the worst condition of each."""
    found_live: dict[str, Diagnostic] = {}

    def report(diagnostic: Diagnostic) -> None:
        worst = found_live.get(diagnostic.name)
        if worst is None or diagnostic.level >= worst.level:
            found_live[diagnostic.name] = diagnostic

    begun = asyncio.Event()

    def put(message: Message) -> None:
        begun.set()
        recorder.put(message)

    simulated, driving = connect_simulated_drives(setup.source, sinks_of(setup))
    # a sink opens what it sends to, and gets no state
    trials = {
        sink.name: sink.try_out if isinstance(sink, ActingSink) else partial(sink.run, Feed()) for sink in driving
    }
    sinks = [asyncio.create_task(keep_running(f"sink {name}", run, report)) for name, run in trials.items()]
    sources = [
        asyncio.create_task(keep_running(f"source {source.name}", partial(source.run, put), report))
        for source in simulated
    ]
    if not all(map(is_live, simulated)):
        first = asyncio.create_task(begun.wait())
        await asyncio.wait([first, *sources], timeout=COMPILED_S, return_when=asyncio.FIRST_COMPLETED)
        first.cancel()
    if sources:
        await asyncio.wait(sources, timeout=seconds)
    for task in (*sources, *sinks):
        task.cancel()
    await asyncio.gather(*sources, *sinks, return_exceptions=True)
    return found_live
