"""Make the pictures of the README and the documentation: `python docs/make_pictures.py`.

Everything in them is simulated and says so. The battery is identified from its simulated pulse test, as a user would,
and two estimators run over the simulated day. The drive home is simulated in closed loop, and an observer is chosen for
its log as `ohmward slip` does.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from ohmward import Battery, Log, SocEstimate, SocEstimator, identify, make_estimator, make_robot_day
from ohmward.logs import DriveLog
from ohmward.report import TIME, Band, Figure, Series
from ohmward.simulate.closed_loop import drive_log, run
from ohmward.simulate.robot_drive import robot_drive
from ohmward.traction import RLMA, hard_terrain
from ohmward.traction.speed_observer.make_observer import make_observer
from ohmward.traction.speed_observer.track import Track, observe

sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))
from ohmward.filters.consistency import BAND_95
from svg import to_svg

PICTURES = Path(__file__).parent / "pictures"


def main() -> None:
    """Write every picture."""
    day = robot_day()
    drive = drive_home()
    PICTURES.mkdir(exist_ok=True)
    (PICTURES / "robot-day.svg").write_text(to_svg(soc_figure(*day), error_figure(*day)), encoding="utf-8")
    (PICTURES / "drive-home.svg").write_text(to_svg(speed_figure(*drive), slip_figure(*drive)), encoding="utf-8")


def robot_day() -> tuple[Log, SocEstimate, SocEstimate]:
    """The log of the day, what the filter makes of it, and what coulomb counting does."""
    day = make_robot_day("lfp")
    battery = identify(day.pulse_test, capacity_Ah=12.0, chemistry="lfp", n_series=4)
    return day.mission, estimate(day.mission, battery, "ekf"), estimate(day.mission, battery, "coulomb")


def estimate(log: Log, battery: Battery, name: str) -> SocEstimate:
    """State of charge along the day, started at the right value by the estimator called `name`."""
    return SocEstimator(make_estimator(name, battery), initial_soc=1.0).run(log).estimates


def drive_home() -> tuple[DriveLog, Track]:
    """The log of the drive home, and what the observer makes of it."""
    log = drive_log(run(robot_drive()))
    return log, observe(make_observer(RLMA, log, hard_terrain("dry asphalt")).observer, log)


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


def speed_figure(log: DriveLog, track: Track) -> Figure:
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


def slip_figure(log: DriveLog, track: Track) -> Figure:
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
