"""Make the pictures of the README and the documentation: `python docs/make_pictures.py`.

Everything in them is simulated and says so. The battery is identified from its simulated pulse test, as a user would,
and two estimators run over the simulated day. The drive home is simulated in closed loop, and an observer is chosen for
its log as `ohmward slip` does. The range is that of a robot from the benchmark's world of robots, which has driven on
two days before.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ohmward import Battery, Log, SocEstimate, SocEstimator, identify, make_estimator, make_robot_day
from ohmward.energy import (
    BatteryState,
    Consumption,
    begin_drive,
    cut_drive,
    learn,
    prior_from_robot,
    range_left,
    start,
    stretch_of,
    with_terrain,
)
from ohmward.filters.consistency import BAND_95
from ohmward.logs import DriveLog
from ohmward.report import TIME, Band, Figure, Series
from ohmward.traction import RLMA, hard_terrain
from ohmward.traction.speed_observer.estimator import SlipRun, observe
from ohmward.traction.speed_observer.make_observer import make_observer
from ohmward_lab.simulate.closed_loop import ClosedLoopRun, drive_log, run
from ohmward_lab.simulate.robot_drive import robot_drive

sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))
import energy_world
from svg import to_svg

PICTURES = Path(__file__).parent / "pictures"


def main() -> None:
    """Write every picture."""
    day = robot_day()
    drive = drive_home(run(robot_drive()))
    left = range_of_a_day()
    PICTURES.mkdir(exist_ok=True)
    (PICTURES / "robot-day.svg").write_text(to_svg(soc_figure(*day), error_figure(*day)), encoding="utf-8")
    (PICTURES / "drive-home.svg").write_text(to_svg(speed_figure(*drive), slip_figure(*drive)), encoding="utf-8")
    (PICTURES / "range-left.svg").write_text(to_svg(range_figure(left)), encoding="utf-8")


def robot_day() -> tuple[Log, SocEstimate, SocEstimate]:
    """The log of the day, what the filter makes of it, and what coulomb counting does."""
    day = make_robot_day("lfp")
    battery = identify(day.pulse_test, capacity_Ah=12.0, chemistry="lfp", n_series=4)
    return day.mission, estimate(day.mission, battery, "ekf"), estimate(day.mission, battery, "coulomb")


def estimate(log: Log, battery: Battery, name: str) -> SocEstimate:
    """State of charge along the day, started at the right value by the estimator called `name`."""
    return SocEstimator(make_estimator(name, battery), initial_soc=1.0).run(log).estimates


def drive_home(drive: ClosedLoopRun) -> tuple[DriveLog, SlipRun]:
    """The log of the drive home, and what the observer makes of it."""
    log = drive_log(drive)
    return log, observe(make_observer(RLMA, log, hard_terrain("dry asphalt")).observer, log)


class RangeOfADay(NamedTuple):
    """Along a day, (T,): distance driven [m], quantiles of the range left [m], and the range that really was left."""

    driven_m: np.ndarray
    p10_m: np.ndarray
    p50_m: np.ndarray
    p90_m: np.ndarray
    truth_m: np.ndarray


def range_of_a_day(seed: int = 1, asked_every_s: int = 180) -> RangeOfADay:
    """The range as a robot foresees it every three minutes until its battery is down to the reserve."""
    rng = np.random.default_rng(seed)
    world, course = energy_world.draw_world(rng), energy_world.draw_course(rng)
    consumption = start(prior_from_robot(RLMA))
    for _ in range(2):
        consumption = learn_drive(begin_drive(consumption, days=1.0), energy_world.drive(rng, world, course, 1800.0))
    consumption = begin_drive(consumption, days=1.0)
    for leg in course.legs:
        consumption = with_terrain(consumption, leg.terrain)
    today = energy_world.drive(rng, world, course, 8 * 3600.0)
    ones = np.ones(1)
    soc = energy_world.soc_along(today.power_W[None], 0.9 * ones, ones, ones)[0]
    driven_m = np.cumsum(today.speed_m_s) * energy_world.DT_S
    empty = int(np.argmax(soc <= energy_world.RESERVE_SOC))
    loop = [stretch_of(leg) for leg in course.legs]
    rows = []
    for k in range(asked_every_s, empty, asked_every_s):
        known = learn_drive(consumption, energy_world.Record(*(column[:k] for column in today)))
        estimated = max(soc[k] + 0.01 * rng.standard_normal(), energy_world.RESERVE_SOC + 1e-3)
        state = BatteryState(estimated, 0.01, reserve_soc=energy_world.RESERVE_SOC)
        left = range_left(known, loop, energy_world.BATTERY, state).distance_m
        rows.append((driven_m[k], left.p10, left.p50, left.p90, driven_m[empty] - driven_m[k]))
    return RangeOfADay(*np.array(rows).T)


def learn_drive(consumption: Consumption, seen: energy_world.Record) -> Consumption:
    """The consumption after all stretches of a drive, as its sensors saw it."""
    columns = seen.time_s, seen.seen_speed_m_s, seen.seen_power_W, seen.terrain, seen.seen_grade_rad
    for driven in cut_drive(*columns):
        consumption = learn(consumption, driven.stretch, driven.energy_J)
    return consumption


def range_figure(day: RangeOfADay) -> Figure:
    """Range left with its band from P10 to P90, and the truth."""
    km = 1e-3
    return Figure(
        "A simulated robot on grass, gravel and asphalt, 24 V battery of 5 Ah",
        "Distance driven [km]",
        "Range left [km]",
        [
            Series(km * day.driven_m, km * day.truth_m, "truth", "dashed", "reference"),
            Series(km * day.driven_m, km * day.p50_m, "ohmward", role="estimate"),
        ],
        [Band(km * day.driven_m, km * day.p10_m, km * day.p90_m, "P10 to P90")],
        height_px=220,
    )


def soc_figure(log: Log, filtered: SocEstimate, counted: SocEstimate) -> Figure:
    """Truth, estimate with its band, coulomb counting."""
    t, soc, std = log.time_s, 100 * filtered.soc, 100 * filtered.soc_std
    return Figure(
        "A simulated robot day, 12 V LFP battery, low-cost current sensor",
        TIME,
        "State of charge [%]",
        [
            Series(t, 100 * log.extra["soc_true"], "truth", "dashed", "reference"),
            Series(t, 100 * counted.soc, "coulomb counting", role="comparison"),
            Series(t, soc, "ohmward", role="estimate"),
        ],
        [Band(t, soc - BAND_95 * std, np.minimum(soc + BAND_95 * std, 100.0), "its 95 % band")],
        height_px=260,
    )


def error_figure(log: Log, filtered: SocEstimate, counted: SocEstimate) -> Figure:
    """Error of both, and the band that the filter claimed."""
    t, truth, std = log.time_s, log.extra["soc_true"], 100 * filtered.soc_std
    return Figure(
        "Error",
        TIME,
        "Estimate - truth [points]",
        [
            Series(t, 100 * (counted.soc - truth), "coulomb counting", role="comparison"),
            Series(t, 100 * (filtered.soc - truth), "ohmward", role="estimate"),
        ],
        [Band(t, -BAND_95 * std, BAND_95 * std, "claimed 95 % band")],
        height_px=150,
    )


def speed_figure(log: DriveLog, track: SlipRun) -> Figure:
    """Truth, estimate with its band, and what the driven wheels alone would say."""
    t, e = log.time_s, track.estimates
    wheels = RLMA.wheel.radius_m * e.wheel_speed_rad_s.mean(axis=1)
    return Figure(
        "A simulated drive: a stop and a start on wet tiles, then a ramp",
        TIME,
        "Speed [m/s]",
        [
            Series(t, log.extra["speed_true_m_s"], "truth", "dashed", "reference"),
            Series(t, wheels, "driven wheels", role="comparison"),
            Series(t, e.speed_m_s, "ohmward", role="estimate"),
        ],
        [band(t, e.speed_m_s, e.speed_std_m_s)],
        height_px=220,
    )


def slip_figure(log: DriveLog, track: SlipRun) -> Figure:
    """Slip speed of one wheel and its band, beside the truth."""
    t, e = log.time_s, track.estimates
    ratio, rim = log.extra["front_left_slip_true"], RLMA.wheel.radius_m * e.wheel_speed_rad_s[:, 0]
    truth = ratio * np.maximum(np.abs(rim), np.abs(log.extra["speed_true_m_s"]))
    return Figure(
        "Front left wheel",
        TIME,
        "Slip speed [m/s]",
        [
            Series(t, truth, "truth", "dashed", "reference"),
            Series(t, e.slip_speed_m_s[:, 0], "ohmward", role="estimate"),
        ],
        [band(t, e.slip_speed_m_s[:, 0], e.slip_speed_std_m_s[:, 0])],
        height_px=150,
    )


def band(t: np.ndarray, mean: np.ndarray, std: np.ndarray) -> Band:
    """The 95 % band that an estimate claims."""
    return Band(t, mean - BAND_95 * std, mean + BAND_95 * std, "its 95 % band")


if __name__ == "__main__":
    main()
