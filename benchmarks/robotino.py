"""Slip of Festo's Robotino on floors, from encoders and motor currents alone, against an overhead camera.

Radius, motor and the table's floor are calibrated on the table; the gray floor is learnt from the gray runs of even
number. What is judged: the gray runs of odd number, the runs along the seam of both floors, floors that were never
met, three floors of which each is learnt from every other run, and a floor of an earlier campaign (`robotino_blue`).
Every constant is one of the package or a measured one of the robot (`README` of the data).
"""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from figure import Figure, at_least, at_most, data_file, rms
from ohmward.filters.consistency import BAND_95
from ohmward.logs import read_drive
from ohmward.traction import ROBOTINO, Robot
from ohmward.traction.calibration import (
    CalibrationDrive,
    calibrate_motor,
    calibrate_radius,
    learn_floor,
    motion_from_pose,
    with_parameters,
)
from ohmward.traction.calibration.stretches import local_slope, travel_speed
from ohmward.traction.robot.robot import motion_from_wheels
from ohmward.traction.terrain.floor import Floor
from ohmward.traction.terrain.slip_on_floors import FloorRun, SlipOnFloors, slip_on_floors
from robotino_blue import FIRST_ROW, blue_drives
from robotino_live import live

FOLDER = "robotino_slip_tpu"
#: The camera: metres per pixel, and how the mark on the robot is turned against the picture. Rows count downwards.
PIXEL_M, MARK_DEG = (1.84046e-3, -1.83716e-3), 91.4
GRAVITY = 9.80665
#: Runs are judged from here [s] to so long before their end: the robot starts from rest.
START_S, STOP_S = 1.0, 0.3
#: A crossing counts as found within [s]; those nearer to the ends of a run leave no room for it.
FOUND_S = 1.0
#: A wheel is across when it stands so far [m] beyond the seam; the rollers' contact moves by about as much.
ACROSS_M = 0.008
#: Standard deviation [m/s] of the camera's speed: a pixel over its window of 0.6 s is 0.003, the mark's angle as much.
CAMERA_STD_M_S = 0.01
SENSORS = "encoders + currents"


class Run(NamedTuple):
    """A run: its drive, with the motion that the camera saw, and the pose (T, 3) in metres and radians."""

    drive: CalibrationDrive
    pose: np.ndarray


class Judged(NamedTuple):
    """Mean slip of one run by the camera and as estimated, the estimate's sigma, and the error over time (RMS)."""

    true: float
    found: float
    std: float
    rms: float
    crossings: int
    seconds: float


def rows() -> Iterator[Figure]:
    """All figures; raises FileNotFoundError where the data are absent."""
    table, gray, uniform = (runs(name) for name in ("table", "gray", "gray_uniform_wheel_load"))
    robot = calibrated(weighed("wheel_load_nonuniform_load.csv"), table)
    even = {number: run for number, run in gray.items() if number % 2 == 0}
    odd = {number: run for number, run in gray.items() if number % 2 == 1}
    floors = floor_of("table", table, robot), floor_of("gray", even, robot)
    estimator = slip_on_floors(robot, floors)
    yield from _learnt(judge(estimator, odd), judge(estimator, table))
    yield from _unseen(robot, floors, gray, uniform, table)
    yield from _three_floors(robot, {"table": table, "gray": gray, "green": runs("green_odd")})
    yield from _filters(robot, floors, odd)
    seam = runs("two_table_gray")
    yield from _crossings(estimator, seam, odd, table)
    yield from _live(estimator, odd, table, seam)


def runs(name: str) -> dict[int, Run]:
    """The runs of a file by number, read as `ohmward slip --where exp=N --motor-shaft` reads them."""
    path = data_file(f"{FOLDER}/{name}.parquet")
    import pyarrow.parquet as pq

    numbers = sorted(set(pq.read_table(path, columns=["exp"])["exp"].to_pylist()))
    return {int(number): read_run(path, number) for number in numbers}


def weighed(name: str) -> Robot:
    """The robot with its wheels' loads as weighed."""
    with data_file(f"{FOLDER}/{name}").open(encoding="utf-8", newline="") as file:
        grams = np.array([[float(v) for v in row[1:4]] for row in list(csv.reader(file))[3:]])
    load_N = grams.mean(axis=0) * 1e-3 * GRAVITY
    return replace(ROBOTINO, mass_kg=float(load_N.sum()) / GRAVITY, wheel_load_N=tuple(load_N.tolist()))


def calibrated(robot: Robot, table: Mapping[int, Run]) -> Robot:
    """Radius and motor from the runs on the table."""
    drives = [run.drive for run in table.values()]
    robot = with_parameters(robot, [calibrate_radius(drives, robot)])
    return with_parameters(robot, calibrate_motor(drives, robot))


def floor_of(name: str, of: Mapping[int, Run], robot: Robot) -> Floor:
    """The floor of these runs."""
    return learn_floor(name, [run.drive for run in of.values()], robot)


def judge(estimator: SlipOnFloors, of: Mapping[int, Run], held_back: bool = False) -> list[Judged]:
    """Each run against the camera; its second half where the camera was `held_back` from that alone."""
    robot = estimator.wheels.robot
    return [
        _judged(estimator.run(run.drive.log), run, robot, half_time_s(run) if held_back else START_S)
        for run in of.values()
    ]


def seam_crossings(of: Sequence[Run]) -> list[list[float]]:
    """Times [s] at which a wheel crossed the seam, for each run.

    The seam is a straight line x = const of the camera; where it lies is found once for all runs, as the line for which
    the number of wheels beyond it explains the currents best. It is the truth's only parameter.
    """
    places = [_wheel_x(run) for run in of]
    current = np.concatenate([np.abs(run.drive.log.motor_current_A).sum(axis=1) for run in of])
    x = np.concatenate(places)
    candidates = np.quantile(x, np.linspace(0.05, 0.95, 181))
    best = max(candidates, key=lambda seam: np.corrcoef((x > seam).sum(axis=1), current)[0, 1])
    return [crossing_times(run.drive.log.time_s, place - best) for run, place in zip(of, places, strict=True)]


def read_run(path: Path, number: float) -> Run:
    """One run of a file."""
    log = read_drive(
        path,
        [p.name for p in ROBOTINO.places],
        ROBOTINO.driven,
        gear_ratio=ROBOTINO.motor.gear_ratio,
        at_motor_shaft=True,
        where={"exp": number},
    )
    pose = np.column_stack(
        [
            PIXEL_M[0] * log.extra["xpos"],
            PIXEL_M[1] * log.extra["ypos"],
            np.unwrap(np.radians(log.extra["ang"] + MARK_DEG)),
        ]
    )
    return Run(CalibrationDrive(log, motion_from_pose(log.time_s, *pose.T)), pose)


def _judged(track: FloorRun, run: Run, robot: Robot, start_s: float = START_S) -> Judged:
    time_s = track.time_s
    rim, body = travel_speed(_smooth_rim(run, robot)), travel_speed(run.drive.motion)
    part = (time_s > start_s) & (time_s < time_s[-1] - STOP_S) & np.isfinite(track.travel_slip)
    error = track.travel_slip[part] - (1 - body[part] / rim[part])
    return Judged(
        true=float(1 - body[part].mean() / rim[part].mean()),
        found=float(track.travel_slip[part].mean()),
        std=float(track.travel_slip_std[part].mean()),
        rms=rms(error),
        crossings=len(track.crossings),
        seconds=run.drive.log.duration_s,
    )


def _smooth_rim(run: Run, robot: Robot) -> np.ndarray:
    """Motion of the rims (T, 3) over the same window as the camera's."""
    log = run.drive.log
    turned = motion_from_wheels(robot, log.wheel_speed_rad_s) * np.diff(log.time_s, prepend=log.time_s[0])[:, None]
    return np.column_stack([local_slope(log.time_s, way) for way in np.cumsum(turned, axis=0).T])


def _learnt(odd: list[Judged], table: list[Judged]) -> Iterator[Figure]:
    data, method = "Robotino, gray floor, runs not learnt from", f"UKF on learnt floors, {SENSORS}"
    error = _errors(odd)
    yield at_most(data, method, "mean slip of a run, mean absolute error", float(np.abs(error).mean()), 0.03)
    yield at_most(data, method, "mean slip of all runs, error", abs(float(error.mean())), 0.03)
    yield at_least(data, method, "runs within 0.03", float((np.abs(error) <= 0.03).mean()), form=".1%")
    yield at_least(data, method, "runs in the 95 % band", _covered(odd), form=".1%")
    data = "Robotino, table"
    yield at_most(data, method, "mean slip of a run, mean absolute error", float(np.abs(_errors(table)).mean()), 0.03)


def _unseen(
    robot: Robot, floors: tuple[Floor, Floor], gray: Mapping, uniform: Mapping, table: Mapping
) -> Iterator[Figure]:
    other = weighed("wheel_load_uniform_load.csv")
    other = replace(other, wheel=robot.wheel, motor=robot.motor)
    cases = (
        ("gray floor, only the table known", slip_on_floors(robot, floors[:1]), gray),
        ("gray floor, other loads, only the table known", slip_on_floors(other, floors[:1]), uniform),
        ("table, only the gray floor known", slip_on_floors(robot, floors[1:]), table),
        ("gray floor known, other loads", slip_on_floors(other, floors), uniform),
    )
    for data, estimator, of in cases:
        judged = judge(estimator, of)
        data, method = f"Robotino, {data}", f"UKF on learnt floors, {SENSORS}"
        yield at_least(data, method, "runs in the 95 % band", _covered(judged), 0.85, form=".1%")
        yield at_most(data, method, "half width of the band", BAND_95 * float(np.mean([j.std for j in judged])))
        yield at_most(data, method, "mean slip of a run, mean absolute error", float(np.abs(_errors(judged)).mean()))


def _three_floors(robot: Robot, floors: Mapping[str, Mapping[int, Run]]) -> Iterator[Figure]:
    """Floors learnt from every other run, all in one file or each left out in turn; the other runs are judged."""
    learnt = {name: floor_of(name, _every_other(of, 0), robot) for name, of in floors.items()}
    known, method = slip_on_floors(robot, tuple(learnt.values())), f"UKF on learnt floors, {SENSORS}"
    for name, of in floors.items():
        others = _every_other(of, 1)
        data = f"Robotino, {name}, one of three floors learnt from every other run"
        yield from _band(data, method, judge(known, others), within=0.9)
        told = slip_on_floors(robot, (learnt[name],), known_only=True)
        yield from _band(data, f"{method}, told the floor", judge(told, others))
        unseen = slip_on_floors(robot, tuple(floor for key, floor in learnt.items() if key != name))
        data_unseen = f"Robotino, {name}, only the two other floors learnt"
        yield from _band(data_unseen, method, judge(unseen, others), covered=0.85)
        seen = "judged after half of the run, forward speed of the camera"
        for of_data, estimator in ((data, known), (data_unseen, unseen)):
            yield from _band(f"{of_data}, {seen} never", method, judge(estimator, others, held_back=True))
            shown = {number: with_camera(run) for number, run in others.items()}
            yield from _band(f"{of_data}, {seen} before", method, judge(estimator, shown, held_back=True))
    data = "Robotino, blue floor of 2021, time from the ticks, only the three other floors learnt"
    yield from _band(data, method, judged_blue(known), covered=0.85)


def judged_blue(estimator: SlipOnFloors) -> list[Judged]:
    """Each straight drive of the campaign of 2021 against the way that the camera saw."""
    found = []
    for log, way_m in blue_drives(estimator.wheels.robot, PIXEL_M):
        track = estimator.run(log)
        time_s, part = log.time_s[FIRST_ROW:], slice(FIRST_ROW, None)
        rim = motion_from_wheels(estimator.wheels.robot, log.wheel_speed_rad_s[part])
        true = 1 - way_m / float(np.trapezoid(travel_speed(rim), time_s))
        slip, std = (float(np.nanmean(v[part])) for v in (track.travel_slip, track.travel_slip_std))
        found.append(Judged(true, slip, std, abs(slip - true), len(track.crossings), log.duration_s))
    return found


def half_time_s(run: Run) -> float:
    """Middle [s] of the part of a run that is judged."""
    return (START_S + float(run.drive.log.time_s[-1]) - STOP_S) / 2


def with_camera(run: Run) -> Run:
    """The run with the camera's forward speed as an outside speed, in the first half alone."""
    log = run.drive.log
    shown = (log.time_s > START_S) & (log.time_s < half_time_s(run))
    speed = np.where(shown, run.drive.motion[:, 0], np.nan)
    outside = replace(log, speed_m_s=speed, speed_std_m_s=np.full(len(log), CAMERA_STD_M_S))
    return run._replace(drive=run.drive._replace(log=outside))


def _every_other(of: Mapping[int, Run], first: int) -> dict[int, Run]:
    return {number: of[number] for number in sorted(of)[first::2]}


def _band(
    data: str, method: str, judged: list[Judged], within: float | None = None, covered: float | None = None
) -> Iterator[Figure]:
    close = _share(np.abs(_errors(judged)) <= 0.05)
    yield at_least(data, method, "runs within 0.05", close, within, form=".1%")
    yield at_least(data, method, "runs in the 95 % band", _covered(judged), covered, form=".1%")
    yield at_most(data, method, "half width of the band", BAND_95 * float(np.mean([j.std for j in judged])))


def _filters(robot: Robot, floors: tuple[Floor, ...], odd: Mapping[int, Run]) -> Iterator[Figure]:
    rms = {m: _rms(judge(slip_on_floors(robot, floors, m), odd)) for m in ("ekf", "aekf", "ukf", "aukf")}
    data = "Robotino, gray floor, runs not learnt from"
    for method, value in rms.items():
        yield at_most(data, f"{method.upper()}, {SENSORS}", "slip over time, RMSE", value, form=".4f")
    quantity = "slip over time, ratio of RMSE"
    yield at_most(data, "AUKF over UKF", quantity, rms["aukf"] / rms["ukf"], 1.0, form=".4f")
    at_half_noise = {m: _rms(judge(_half_the_noise(slip_on_floors(robot, floors, m)), odd)) for m in ("ukf", "aukf")}
    quantity += ", noise given half as large"
    yield at_most(data, "AUKF over UKF", quantity, at_half_noise["aukf"] / at_half_noise["ukf"], form=".4f")


def _half_the_noise(estimator: SlipOnFloors) -> SlipOnFloors:
    wheels = estimator.wheels
    halved = replace(wheels, encoder_std_rad_s=wheels.encoder_std_rad_s / 2, current_std_A=wheels.current_std_A / 2)
    return replace(estimator, wheels=halved)


def _crossings(
    estimator: SlipOnFloors, seam: Mapping[int, Run], odd: Mapping[int, Run], table: Mapping[int, Run]
) -> Iterator[Figure]:
    found, false, silent = {}, 0, []
    for (number, run), crossed in zip(seam.items(), seam_crossings(list(seam.values())), strict=True):
        end = run.drive.log.time_s[-1] - FOUND_S
        alarms = [c.time_s for c in estimator.run(run.drive.log).crossings]
        false += sum(all(abs(a - t) > FOUND_S for t in crossed) for a in alarms)
        if due := [t for t in crossed if START_S <= t <= end]:
            found[number] = [any(abs(a - t) <= FOUND_S for a in alarms) for t in due]
        elif not crossed:
            silent.append(not alarms)
    data, method = "Robotino, along the seam of table and gray floor", f"CUSUM, {SENSORS}"
    every, odd_ones = "runs with every crossing found within 1 s", [f for k, f in found.items() if k % 2]
    yield at_least(data, method, every, _share(map(all, found.values())), 0.9, form=".1%")
    yield at_least(f"{data}, odd numbers", method, every, _share(map(all, odd_ones)), form=".1%")
    first = _share(f[0] for f in found.values())
    yield at_least(data, method, "runs whose first crossing is found within 1 s", first, form=".1%")
    yield at_least(data, method, "runs with a crossing found within 1 s", _share(map(any, found.values())), form=".1%")
    each = _share(f for run in found.values() for f in run)
    yield at_least(data, method, "crossings found within 1 s", each, form=".1%")
    yield at_least(data, method, "runs without a crossing and without an alarm", _share(silent), form=".1%")
    yield at_most(data, method, "alarms farther than 1 s from a crossing", float(false), form=".0f")
    for name, of in (("gray floor", odd), ("table", table)):
        judged = judge(estimator, of)
        yield at_most(
            f"Robotino, {name}", method, "runs with a false alarm", _share(j.crossings > 0 for j in judged), 0.05, ".1%"
        )


def _live(
    estimator: SlipOnFloors, odd: Mapping[int, Run], table: Mapping[int, Run], seam: Mapping[int, Run]
) -> Iterator[Figure]:
    method, robot = f"UKF on learnt floors, live, {SENSORS}", estimator.wheels.robot
    for place, data, of in (("gray", "gray floor, runs not learnt from", odd), ("table", "table", table)):
        logs, data = {number: run.drive.log for number, run in of.items()}, f"Robotino, {data}"
        tracks = live(estimator, logs)
        judged = [_judged(tracks[number], run, robot) for number, run in of.items()]
        quantity = "mean slip of a run, mean absolute error"
        yield at_most(data, method, quantity, float(np.abs(_errors(judged)).mean()))
        whole = (np.nan_to_num(estimator.run(log).travel_slip - tracks[k].travel_slip) for k, log in logs.items())
        yield at_most(data, method, "slip, largest difference from a run at once", max(np.abs(d).max() for d in whole))
        right = estimator.recognition.names.index(place)
        shown = [t.floor_probability[(t.time_s > START_S) & np.isfinite(t.travel_slip)] for t in tracks.values()]
        share = _share(np.concatenate(shown).argmax(axis=-1).ravel() == right)
        yield at_least(data, method, "floor under a wheel recognised, share of the time", share, form=".1%")
    yield from _delays(estimator, seam)


def _delays(estimator: SlipOnFloors, seam: Mapping[int, Run]) -> Iterator[Figure]:
    tracks, delay, said = live(estimator, {number: run.drive.log for number, run in seam.items()}), [], []
    for track, crossed in zip(tracks.values(), seam_crossings(list(seam.values())), strict=True):
        for t in (t for t in crossed if START_S <= t <= track.time_s[-1] - FOUND_S):
            after = [c.time_s - t for c in track.crossings if abs(c.time_s - t) <= FOUND_S]
            delay += [min(after, key=abs)] if after else []
            said.append(np.median(track.crossing_delay_s[np.searchsorted(track.time_s, t)]))
    data, method = "Robotino, along the seam of table and gray floor", f"CUSUM, live, {SENSORS}"
    yield at_most(data, method, "delay of a crossing that is found [s], median", float(np.median(delay)))
    yield at_most(data, method, "delay of a crossing that is found [s], 90 %", float(np.quantile(delay, 0.9)))
    yield at_most(data, method, "delay as it says it [s], median over wheels and crossings", float(np.median(said)))


def _errors(judged: Sequence[Judged]) -> np.ndarray:
    return np.array([j.found - j.true for j in judged])


def _covered(judged: Sequence[Judged]) -> float:
    return _share(abs(j.found - j.true) <= BAND_95 * j.std for j in judged)


def _rms(judged: Sequence[Judged]) -> float:
    return float(np.sqrt(np.mean([j.rms**2 for j in judged])))


def _share(of) -> float:
    return float(np.mean([bool(v) for v in of]))


def _wheel_x(run: Run) -> np.ndarray:
    """Place of each wheel along x of the camera (T, 3) [m]."""
    bearing = np.radians(ROBOTINO.chassis.bearings_deg)  # type: ignore[union-attr]
    return run.pose[:, :1] + ROBOTINO.chassis.arm_m * np.cos(run.pose[:, 2:] + bearing)  # type: ignore[union-attr]


def crossing_times(time_s: np.ndarray, beyond_m: np.ndarray) -> list[float]:
    """Time at which a wheel (T, 3) last passed the seam before it stood clearly on the other side."""
    times = []
    for x in beyond_m.T:
        side, passed = np.sign(x[0]), time_s[0]
        for t, before, now in zip(time_s[1:], x[:-1], x[1:], strict=True):
            passed = t if np.sign(now) != np.sign(before) else passed
            if side * now < -ACROSS_M:
                times.append(float(passed))
                side = np.sign(now)
    return sorted(times)
