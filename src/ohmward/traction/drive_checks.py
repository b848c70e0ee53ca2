"""Checks of the recording of a drive for faults, before an estimate is made from it.

Each check looks for one fault of real robots, and names the wheel, the evidence and the cure. Sensors that are stuck
are left out, and signs that the other sensors show are corrected.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.drive_log import DriveLog
from ohmward.logs.log import Note
from ohmward.quantities import QUANTITIES, limits_of
from ohmward.runs import from_to, long_runs, repeats, runs, window_starts
from ohmward.signals.checks import beyond_limits, scales_of, stuck
from ohmward.traction.motion.outside_speed import STUCK_SHARE, TURNS_M_S
from ohmward.traction.motion.sample import STOPPED, require_wheels
from ohmward.traction.motion.stuck_sensors import COMPARABLE, COMPARABLE_S, LEAST_RANGE_RAD_S, watch_log
from ohmward.traction.motion_check import (
    FEWEST_VALUES,
    MOST_FASTER,
    check_signs,
    check_units,
    faster_than_gyro,
    fitting_units,
    motion_of,
)
from ohmward.traction.robot.robot import GRAVITY, Robot
from ohmward.traction.speed_observer.make_observer import (
    WHEEL_TURNS_RAD_S,
    speed_and_wheels_m_s,
    yaw_rate_of_wheels,
)
from ohmward.traction.wheel_signs import (
    FEWEST_BACK,
    SIZE_SHARE,
    WORKS_A,
    sides_of,
    with_wheel_signs,
)

#: One side is mirrored if the sides turn against each other in this share of their motion, for this many turns.
SPINS_SHARE, FEWEST_SPINS = 0.9, 3.0
#: A robot that spins on the spot turns its sides equally fast; one with a mirrored side drives curves too, in which the
#: speeds of the sides differ by more than this share of their sum in that share of the samples.
UNLIKE, UNLIKE_SHARE = 0.1, 0.1
#: Number of counts from which another wheel changes its speed: one more or less comes and goes at a steady speed.
MORE_THAN_ONE = 1.5
#: Number of times that another wheel changes its speed by as much while an encoder repeats its own to the last digit.
FEWEST_JUMPS = 3

#: A motor only brakes if its currents in the direction of its wheel add up to less than this share of their sizes.
BRAKES = -0.3

#: Correlation of a motor's current with its wheel's acceleration, over this time [s], below which its sign is wrong.
OPPOSES, AVERAGED_S = -0.5, 0.5

#: Largest energy that a motor with the right sign takes, over what the robot gives up while it brakes: mass and torque
#: constant of a robot file may be wrong.
TAKES = 2.0

#: Size of a spike over the usual speed of a wheel.
SPIKE = 10.0

#: A robot is stuck if the speed from outside is below `STUCK_SHARE` of the wheels' for this time [s] and this many
#: samples in a row; a starting robot is not, however late that speed comes.
ROBOT_STUCK_S, FEWEST_STUCK = 3.0, 3

#: Speed of the wheels over that from outside, either way: beyond these a unit is doubtful, also if nine of ten samples
#: are, as slip comes and goes; and certainly wrong, as it is over the turn of the gyro. Nearly always beyond the last
#: one, where no wheel scrubs, the radius or the scale of that speed is wrong.
RATIO_DOUBTFUL, RATIO_ALWAYS, RATIO_MEANINGLESS, RATIO_STEADY = 2.0, 1.4, 5.0, 1.05
#: Relative difference up to which that ratio is the one of another unit, or of the gear.
RATIO_ALIKE = 0.1


def check_drive(robot: Robot, log: DriveLog) -> DriveLog:
    """The log as `mended`, its notes after a warning for each fault that was found.

    Raises:
        InputError: other wheels than the robot's, or the speed of the wheels and that from outside, or the turn by
            the gyro, cannot be of one robot in these units.
    """
    log = mended(robot, log)
    return replace(log, notes=(*found_faults(robot, log), *log.notes))


def found_faults(robot: Robot, log: DriveLog) -> list[Note]:
    """A warning for each fault of a log that was `mended`.  Raises: see `check_drive`."""
    checks = (
        _stuck_encoders,
        _spikes,
        _beyond_limits,
        _contradictions,
        _clipped_gyro,
        _mirrored_side,
        _wrong_current_signs,
        _blocked_wheels,
        _stuck_robot,
        _wrong_units,
    )
    found: list[str] = []
    for check in checks:
        try:
            found += check(robot, log)
        except InputError as error:  # another fault may be the cause
            raise InputError("; ".join([str(error), *found]), error.options) from None
    return [Note(text, "warning") for text in found]


def mended(robot: Robot, log: DriveLog) -> DriveLog:
    """The log without sensors that are stuck, and with the signs of wheel speeds, currents and the outside speed.

    Raises:
        InputError: other wheels than the robot's.
    """
    require_wheels(robot, log)
    log = without_dead_currents(robot, with_wheel_signs(robot, without_stuck(robot, log)))
    return with_signed_speed(robot, with_current_signs(robot, log))


def without_dead_currents(robot: Robot, log: DriveLog) -> DriveLog:
    """The log without motor currents that never change although their wheels turn: those motors count as unknown."""
    for k, name in enumerate(_names(robot)[: robot.driven]):
        current = log.motor_current_A[:, k]
        turning = current[np.isfinite(current) & (np.abs(log.wheel_speed_rad_s[:, k]) > WHEEL_TURNS_RAD_S)]
        if turning.size >= FEWEST_VALUES and np.ptp(turning) == 0:
            currents = np.where(np.arange(robot.driven) == k, np.nan, log.motor_current_A)
            text = (
                f"the motor current of {name} is {turning[0]:.3g} A without any change while its wheel turns: a dead "
                "sensor, or a motor that is off; it is left out, and the motor counts as unknown"
            )
            log = replace(log, motor_current_A=currents, notes=(*log.notes, Note(text, "warning")))
    return log


def with_current_signs(robot: Robot, log: DriveLog) -> DriveLog:
    """The log with the other sign of motor currents that certainly have the wrong one; otherwise unchanged.

    They only brake, and are the more negative the more their wheels accelerate, while the gyro shows the turn that the
    wheels make, so that it is not the encoders that count the other way.
    """
    motion = motion_of(robot, log.wheel_speed_rad_s.T, log.yaw_rate_rad_s)
    if not 1.0 / MOST_FASTER < faster_than_gyro(robot, motion) < MOST_FASTER:
        return log
    wrong = [k for k in braking_motors(robot, log) if _accelerates(log, k) < OPPOSES]
    if not wrong:
        return log
    signs = np.where(np.isin(np.arange(robot.driven), wrong), -1.0, 1.0)
    names = " and ".join(_names(robot)[k] for k in wrong)
    note = Note(f"the motor current of {names} is read with the other sign, as gyro and wheels agree", "warning")
    return replace(log, motor_current_A=signs * log.motor_current_A, notes=(*log.notes, note))


def braking_motors(robot: Robot, log: DriveLog) -> list[int]:
    """Driven wheels whose motors brake all the way, by their currents."""
    pitch_rad = np.zeros(len(log)) if log.pitch_rad is None else log.pitch_rad
    values = zip(log.wheel_speed_rad_s.T, log.motor_current_A.T, strict=False)
    return [k for k, of_one in enumerate(values) if only_brakes(robot, log.time_s, *of_one, pitch_rad)]


def _accelerates(log: DriveLog, k: int) -> float:
    """Correlation of a motor's current with the acceleration of its wheel, both averaged; nan where one is constant."""
    speed, current = log.wheel_speed_rad_s[:, k], log.motor_current_A[:, k]
    rows = np.isfinite(speed) & np.isfinite(current)
    time_s, speed, current = log.time_s[rows], speed[rows], current[rows]
    starts = window_starts(time_s, AVERAGED_S, time_s[0])
    mean_A = np.add.reduceat(current, starts)[:-1] / np.diff(starts)
    with np.errstate(invalid="ignore", divide="ignore"):
        return float(np.corrcoef(mean_A, np.diff(speed[starts]) / np.diff(time_s[starts]))[0, 1])


def without_stuck(robot: Robot, log: DriveLog) -> DriveLog:
    """The log without what a stuck gyro and a stuck speed from outside show, from the first doubtful value on.

    A gyro that never shows another number is stuck even if it is 0, and wheels that slip are not the cause.
    """
    rate_rows, repeated = _repeated_rates(log, False, STOPPED.contradicts_s, STOPPED.values)
    if not repeated and log.speed_m_s is None:
        return log
    watch, (gyro, speed) = watch_log(robot, log), np.zeros((2, len(log)), dtype=bool)
    for first, stop in repeated:
        never_moves = stop - first >= rate_rows.size - 1
        faulty = watch.gyro_suspected if never_moves else watch.gyro_stuck
        gyro[rate_rows[first - 1 : stop]] |= faulty[rate_rows[first:stop]].any()
    log = _left_out(log, "yaw_rate_rad_s", gyro, "the gyro is ", "the robot")
    if log.speed_m_s is None:
        return log
    rows = np.flatnonzero(np.isfinite(log.speed_m_s))
    same = repeats(log.speed_m_s[rows])
    for first, stop in runs(watch.speed_doubted[rows]):
        speed[rows[first - int(same[first]) : stop]] |= watch.speed_stuck[rows[first:stop]].any()
    return _left_out(log, "speed_m_s", speed, "the speed from outside is ", "the wheels' speed")


def _repeated_rates(
    log: DriveLog, clips: bool, least_s: float, fewest: int
) -> tuple[np.ndarray, list[tuple[int, int]]]:
    """Rows (N,) with a yaw rate, and runs of these that repeat one, at the end of the gyro's range or within it."""
    if log.yaw_rate_rad_s is None:
        return np.empty(0, dtype=int), []
    rows = np.flatnonzero(np.isfinite(log.yaw_rate_rad_s))
    rate = log.yaw_rate_rad_s[rows]
    same = repeats(rate) & ((np.abs(rate) >= LEAST_RANGE_RAD_S) == clips)
    return rows, long_runs(same, log.time_s[rows], least_s, fewest)


def _left_out(log: DriveLog, name: str, dead: np.ndarray, what: str, mover: str) -> DriveLog:
    """The log without the values of a sensor that is stuck in these samples (T,), and with a note."""
    if not dead.any():
        return log
    text = f"{stuck(what, f' {from_to(log.time_s[dead])}', mover)}; its values there are left out"
    values: dict[str, Any] = {name: np.where(dead, np.nan, getattr(log, name))}
    return replace(log, **values, notes=(*log.notes, Note(text, "warning")))


def with_signed_speed(robot: Robot, log: DriveLog) -> DriveLog:
    """The log with the wheels' sign on an unsigned speed from outside, and a note; otherwise the log unchanged.

    Where the wheels stand and the robot does not, the sign is unknown, and the speed is left out.
    """
    if log.speed_m_s is None:
        return log
    speed, wheels = speed_and_wheels_m_s(robot, log)
    back = wheels < -TURNS_M_S
    if back.sum() < FEWEST_BACK or (speed < -TURNS_M_S).any() or np.mean(speed[back] <= 0.0) > 0.05:
        return log
    if np.median(speed[back]) < SIZE_SHARE * np.median(-wheels[back]):
        return log
    turn, size = np.abs(wheels) > TURNS_M_S, np.abs(speed)
    signed = np.full(len(log), np.nan)
    signed[np.isfinite(log.speed_m_s)] = np.where(
        turn, size * np.sign(wheels), np.where(size > TURNS_M_S, np.nan, speed)
    )
    text = (
        f"the speed from outside is never negative while the wheels turn back ({back.sum()} samples): read as its size "
        "with the sign of the wheels; if the robot never drove back, the signs of the encoders are wrong"
    )
    return replace(log, speed_m_s=signed, notes=(*log.notes, Note(text, "warning")))


def _stuck_encoders(robot: Robot, log: DriveLog) -> Iterator[str]:
    """Encoders that repeat a number to the last digit while the other wheels change theirs.

    A wheel may stand for a while when a robot turns about it; one that never turns is unplugged, except on an omni
    robot.
    """
    for k, name in enumerate(_names(robot)):
        rows = np.flatnonzero(np.isfinite(log.wheel_speed_rad_s[:, k]))
        speed, others = log.wheel_speed_rad_s[rows, k], np.delete(log.wheel_speed_rad_s[rows], k, axis=1)
        changes = np.nan_to_num(np.abs(np.diff(others, axis=0, prepend=others[:1])))
        count = np.min(changes, axis=0, where=changes > 0.0, initial=np.inf)
        count = np.where(np.count_nonzero(changes, axis=0) >= FEWEST_VALUES, count, 0.0)
        change = np.where(changes > MORE_THAN_ONE * count, changes, 0.0).max(axis=1, initial=0.0)
        turning = np.nan_to_num(np.abs(others)).max(axis=1, initial=0.0) > STOPPED.moves_rad_s
        for first, stop in long_runs(repeats(speed), log.time_s[rows], STOPPED.contradicts_s, STOPPED.values):
            may_stand = speed[first] == 0 and (stop - first < rows.size - 1 or robot.chassis.rollers)
            # others flicker, or go at one commanded speed after another
            jumps = np.count_nonzero(change[first:stop] > max(UNLIKE * abs(speed[first]), STOPPED.moves_rad_s))
            moving = (change[first:stop] > 0).mean() > 0.5 or jumps >= FEWEST_JUMPS
            if not may_stand and moving and turning[first:stop].mean() > 0.5:
                what, when = f"the encoder of {name} is ", f" {from_to(log.time_s[rows[first:stop]])}"
                fault = stuck(f"{what}at {speed[first]:.4g} rad/s, ", when, "another wheel")
                yield f"{fault}, or cut this part out"
                break


def _spikes(robot: Robot, log: DriveLog) -> Iterator[str]:
    """Single samples far beyond what the wheel ever does."""
    for k, name in enumerate(_names(robot)):
        speed = log.wheel_speed_rad_s[:, k]
        speed = speed[np.isfinite(speed)]
        if speed.size < FEWEST_VALUES:
            continue
        usual = max(float(np.quantile(np.abs(speed), 0.95)), WHEEL_TURNS_RAD_S)
        before, after = np.diff(speed)[:-1], -np.diff(speed)[1:]
        spikes = (before * after > 0) & (np.minimum(np.abs(before), np.abs(after)) > SPIKE * usual)
        if spikes.any():
            yield (
                f"the encoder of {name} jumps to {np.abs(speed).max():.4g} rad/s in {spikes.sum()} samples, usual are "
                f"{usual:.3g} rad/s: a counter that rolled over? If the file has the counts, read those with --unit "
                "wheel_speed=counts (units={'wheel_speed': 'counts'})"
            )


def _contradictions(robot: Robot, log: DriveLog) -> Iterator[str]:
    """Wrong signs and units, by which wheels and gyro contradict each other."""
    motion = motion_of(robot, log.wheel_speed_rad_s.T, log.yaw_rate_rad_s)
    signs = [str(finding) for _, finding in check_signs(robot, motion, "log")]
    found = signs or [str(finding) for finding in check_units(robot, motion, "log")]
    faster = faster_than_gyro(robot, motion)
    of_wheels, of_gyro = fitting_units(robot, faster)
    if found and of_wheels and not (of_gyro or 1 / RATIO_MEANINGLESS < abs(faster) < RATIO_MEANINGLESS):
        likely = ("--unit", f"wheel_speed={of_wheels[0].symbol}") if len(of_wheels) == 1 else ()
        raise InputError(f"{log.name}: {found[-1]}", likely)
    yield from found


def _clipped_gyro(robot: Robot, log: DriveLog) -> Iterator[str]:
    """Turns faster than the range of the gyro, at whose end it repeats itself."""
    rows, clipped_runs = _repeated_rates(log, True, COMPARABLE_S, COMPARABLE)
    clipped = sum(stop - first for first, stop in clipped_runs)
    if clipped:
        assert log.yaw_rate_rad_s is not None
        most = math.degrees(float(np.abs(log.yaw_rate_rad_s[rows]).max()))
        text = f"the gyro clips at {most:.4g} deg/s in {clipped} samples, where the wheels give the turn"
        yield f"{text}; set a larger range"


def _beyond_limits(robot: Robot, log: DriveLog) -> Iterator[str]:
    """Wheels and motors whose values, apart from single ones, are beyond the limits of such a robot."""
    for quantity, part, values in (
        (QUANTITIES["wheel_speed_rad_s"], "wheel", log.wheel_speed_rad_s),
        (QUANTITIES["motor_current_A"], "motor", log.motor_current_A),
    ):
        limits = limits_of(quantity.name, robot=robot)
        beyond: dict[str, tuple[float, float]] = {}
        for name, of_one in zip(_names(robot), values.T, strict=False):
            known = of_one[np.isfinite(of_one)]
            low, high = np.quantile(known, [0.01, 0.99]) if known.size >= FEWEST_VALUES else (0.0, 0.0)
            if low < limits.lowest or high > limits.highest:
                beyond[name] = low, high
        if beyond:
            lowest, highest = min(low for low, _ in beyond.values()), max(high for _, high in beyond.values())
            what = f"the {part} of {', '.join(beyond)} "
            radius_m = robot.wheel.radius_m
            found = beyond_limits(quantity, lowest, highest, limits, "log", what, radius_m=radius_m)
            yield from map(str, found)


def _mirrored_side(robot: Robot, log: DriveLog) -> Iterator[str]:
    """Sides that turn against each other nearly always, so that a robot without a gyro only spins on the spot.

    If their speeds are equal all the time, it may do just that.
    """
    sides = sides_of(robot)
    if log.yaw_rate_rad_s is not None or log.speed_m_s is not None or sides is None:
        return
    with np.errstate(invalid="ignore"):
        known = np.isfinite(log.wheel_speed_rad_s)
        by_side = [np.where(known[:, sides == side], log.wheel_speed_rad_s[:, sides == side], 0.0) for side in (1, -1)]
    left, right = (values.sum(axis=1) for values in by_side)
    motion = np.abs(left) + np.abs(right)
    turn = np.minimum(np.abs(left), np.abs(right)) > WHEEL_TURNS_RAD_S
    against = turn & (left * right < 0)
    if turn.sum() < FEWEST_VALUES or motion[against].sum() < SPINS_SHARE * motion[turn].sum():
        return
    yaw = np.nan_to_num(yaw_rate_of_wheels(robot, log.wheel_speed_rad_s))
    turns = float(np.abs(yaw) @ np.diff(log.time_s, prepend=log.time_s[0])) / (2 * math.pi)
    if turns < FEWEST_SPINS:
        return
    unlike = np.abs(np.abs(left) - np.abs(right))[turn] > UNLIKE * motion[turn]
    cause = ": the" if unlike.mean() > UNLIKE_SHARE else "; if it did not, the"
    yield (
        f"the wheels of both sides turn against each other nearly always, as if the robot turned {turns:.0f} times on "
        f"the spot{cause} encoders of one side are mounted mirrored: change the signs of that side in the file"
    )


def _wrong_current_signs(robot: Robot, log: DriveLog) -> Iterator[str]:
    for k in braking_motors(robot, log):
        yield brakes_all_the_way(f"the motor of {_names(robot)[k]}", "change the sign in the file")


def brakes_all_the_way(which: str, fix: str) -> str:
    """Sentence on a motor that only brakes."""
    return (
        f"{which} brakes all the way, but the robot does not slow down: wrong sign of its current or of its encoder, "
        f"or the whole drive goes downhill; a positive current must drive forward: {fix}"
    )


def only_brakes(
    robot: Robot, time_s: np.ndarray, speed_rad_s: np.ndarray, current_A: np.ndarray, pitch_rad: np.ndarray
) -> bool:
    """True for a motor that seems to brake all the time, and to take energy that the robot does not give up.

    Each driven wheel gives up an equal share of it, computed from the speed of its rim and the pitch.

    time_s, speed_rad_s, current_A, pitch_rad: (T,) of the motor and its wheel; nan where not known.
    """
    rows = np.isfinite(current_A) & (np.abs(speed_rad_s) > WHEEL_TURNS_RAD_S)
    forward_A = (current_A * np.sign(speed_rad_s))[rows]
    if forward_A.size < FEWEST_VALUES or not forward_A.sum() < BRAKES * np.abs(forward_A).sum():
        return False
    mass_kg, rim_m_s, brakes = robot.mass_kg / robot.driven, robot.wheel.radius_m * speed_rad_s[rows], forward_A < 0
    dt_s = np.diff(time_s, prepend=time_s[0])[rows]
    kinetic_J = np.diff(0.5 * mass_kg * rim_m_s**2, prepend=np.nan)
    potential_J = mass_kg * GRAVITY * np.sin(np.nan_to_num(pitch_rad[rows])) * rim_m_s * dt_s
    taken_J = -robot.motor.wheel_constant_Nm_per_A * current_A[rows] * speed_rad_s[rows] * dt_s
    return bool(np.sum(taken_J[brakes]) > TAKES * -np.nansum((kinetic_J + potential_J)[brakes]))


def _blocked_wheels(robot: Robot, log: DriveLog) -> Iterator[str]:
    """Motors that work for a while although their wheels do not turn."""
    for k, name in enumerate(_names(robot)[: robot.driven]):
        stands = np.abs(log.wheel_speed_rad_s[:, k]) < 0.25 * WHEEL_TURNS_RAD_S
        works = np.abs(log.motor_current_A[:, k]) > WORKS_A
        for first, stop in long_runs(stands & works, log.time_s, STOPPED.contradicts_s, STOPPED.values)[:1]:
            current_A = float(np.median(np.abs(log.motor_current_A[first:stop, k])))
            yield (
                f"the motor of {name} takes {current_A:.3g} A {from_to(log.time_s[first:stop])} and its wheel does "
                "not turn: blocked, or its encoder is unplugged"
            )


def _stuck_robot(robot: Robot, log: DriveLog) -> Iterator[str]:
    """Wheels that turn under a robot that stands, by a speed from outside, which may be infrequent."""
    speed, wheels = speed_and_wheels_m_s(robot, log)
    if not speed.size:
        return
    assert log.speed_m_s is not None
    turn = np.abs(wheels) > TURNS_M_S  # standing wheels are no evidence
    time_s = log.time_s[np.isfinite(log.speed_m_s)][turn]
    stands = np.abs(speed[turn]) < STUCK_SHARE * np.abs(wheels[turn])
    for first, stop in long_runs(stands, time_s, ROBOT_STUCK_S, FEWEST_STUCK):
        yield (
            f"the robot stands by the speed from outside {from_to(time_s[first:stop])} while its wheels turn: stuck, "
            "or that speed is dead; the robot is taken to stand between two of its samples, too"
        )


def _wrong_units(robot: Robot, log: DriveLog) -> Iterator[str]:
    """Wheels that are much slower or faster than the robot."""
    speed, wheels = speed_and_wheels_m_s(robot, log)
    rows = (np.abs(speed) > TURNS_M_S) & (np.abs(wheels) > 1e-3 * TURNS_M_S)
    if rows.sum() < FEWEST_VALUES:
        return
    low, slow, ratio, fast, high = np.quantile(np.abs(wheels[rows] / speed[rows]), [0.1, 0.25, 0.5, 0.75, 0.9])
    if 1 / RATIO_DOUBTFUL < ratio < RATIO_DOUBTFUL and low < RATIO_ALWAYS and high > 1 / RATIO_ALWAYS:
        apart = (ratio > RATIO_STEADY and slow > 1) or (ratio < 1 / RATIO_STEADY and fast < 1)
        if apart and not robot.chassis.scrubs:
            yield (
                f"the wheels say {ratio:.3g} times the speed that was measured from outside, nearly always: the "
                "radius of the robot file or the scale of that speed is wrong, and the wheels are believed; "
                "`ohmward calibrate` finds the radius where that speed is right, else leave it out"
            )
        return
    text = f"the wheels say {ratio:.3g} times the speed that was measured from outside"
    likely = [options for options, alike in _ratios(robot).items() if abs(ratio - alike) < RATIO_ALIKE * alike]
    if likely:
        text += f", as with {' or '.join(map(' '.join, likely))} left out"
    else:
        text += "; is it another unit (--unit wheel_speed=... or speed=...), or another radius in the robot file?"
    if not 1 / RATIO_MEANINGLESS < ratio < RATIO_MEANINGLESS:
        raise InputError(f"{log.name}: {text}", likely[0] if likely else ())
    yield text


def _ratios(robot: Robot) -> dict[tuple[str, ...], float]:
    """Options that a drive was read without -> speed of the wheels over that from outside, which that makes."""
    wheels = scales_of(QUANTITIES["wheel_speed_rad_s"], robot.wheel.radius_m)
    ratios = {f"wheel_speed={scale.symbol}": 1.0 / scale.factor for scale in wheels if scale.symbol}
    ratios |= {f"speed={scale.symbol}": scale.factor for scale in scales_of(QUANTITIES["speed_m_s"])}
    return {("--unit", text): ratio for text, ratio in ratios.items()} | {("--motor-shaft",): robot.motor.gear_ratio}


def _names(robot: Robot) -> list[str]:
    return [place.name.replace("_", " ") for place in robot.places]
