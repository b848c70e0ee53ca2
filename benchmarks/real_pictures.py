"""Pictures of docs/traction-data.md from measured data: `python benchmarks/real_pictures.py`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

import real_car
import real_sand
from figure import HERE
from ohmward.filters.consistency import BAND_95
from ohmward.report import TIME, Band, Figure, Series
from ohmward.traction.dynamics.slip import slip_ratio
from ohmward.traction.friction.law import Contact, SoftGround, contact
from ohmward.traction.friction.terrain import SOILS
from ohmward.traction.speed_observer.estimate import SlipEstimate
from ohmward_lab.traction.friction_fit import drawbar_N, fit_law
from svg import to_svg

SLIP, PULL = "Slip ratio [-]", "Drawbar pull [N]"
PICTURES = HERE.parent / "docs" / "pictures"


def main() -> None:
    """Write them; what is drawn is credited in docs/data.md."""
    trials = real_sand.recording()
    write(PICTURES / "sand-wheel.svg", sand_figure(trials))
    write(PICTURES / "sand-wheel-driving.svg", driving_figure(trials))
    write(PICTURES / "car-without-slip.svg", *car_figures())


def write(path: Path, *figures: Figure) -> None:
    path.write_text(to_svg(*figures), encoding="utf-8")


def sand_figure(trials: real_sand.Trials) -> Figure:
    """The whole range."""
    at, slip = trials.data.contact, slip_of(trials.data.contact)
    groups = [trials.group == group for group in np.unique(trials.group)]
    by_sinkage = real_sand.pull_N(real_sand.fit_sinkage(trials), trials)
    known = Series(
        np.array([slip[g].mean() for g in groups]),
        np.array([by_sinkage[g].mean() for g in groups]),
        "shear, and resistance by the measured sinkage",
        role="estimate",
    )
    measured = Series(slip, trials.data.force_N, "measured", "points", "reference")
    title = "A wheel in sand: 27 trials, nine slips"
    return Figure(title, SLIP, PULL, [measured, known, book("LETE sand", contacts(0.0, at))], height_px=260)


def driving_figure(trials: real_sand.Trials) -> Figure:
    """Driving alone."""
    driving = trials.pick(trials.group >= 0.01)
    at = contacts(0.01, driving.data.contact)
    fit = fit_law(driving.data, real_sand.FAMILIES[-1])
    series = [
        Series(slip_of(driving.data.contact), driving.data.force_N, "measured", "points", "reference"),
        Series(slip_of(at), fit.force_N(at), "soft ground, fitted", role="estimate"),
        book("LETE sand", at),
    ]
    return Figure("A wheel in sand: driving", SLIP, PULL, series, height_px=220)


def slip_of(at: Contact) -> np.ndarray:
    return np.asarray(slip_ratio(at.rim_speed_m_s, at.travel_speed_m_s, floor_m_s=1e-6))


def contacts(least_rim_m_s: float, like: Contact) -> Contact:
    """Rim speeds along the range of the trials, at their mean travel speed and load."""
    travel, load = float(np.mean(like.travel_speed_m_s)), float(np.mean(like.load_N))
    rim = np.concatenate([np.linspace(least_rim_m_s, 0.012, 60), np.geomspace(0.0121, 0.1, 60)])
    return contact(rim, np.full(rim.shape, travel), np.full(rim.shape, load))


def book(name: str, at: Contact) -> Series:
    """Picture of a soil of public demonstrations."""
    ground = SoftGround(SOILS[name], real_sand.RADIUS_M, real_sand.WIDTH_M, real_sand.SPEED_FLOOR_M_S)
    force_N = drawbar_N(ground, 0.0, at) - ground.compaction_N(at.load_N)
    return Series(slip_of(at), force_N, f"{name} of public demonstrations", "dashed", "comparison")


def car_figures() -> Iterator[Figure]:
    """Error of the speed, and the slip of a wheel, with what the observer claims."""
    drive, truth = real_car.recording()
    case = next(real_car.cases(drive, drive.time_s[len(drive) // 2]))
    estimates: SlipEstimate = real_car.observed(case)
    t, std = drive.time_s, estimates.speed_std_m_s
    error = estimates.speed_m_s - truth.speed_m_s
    yield Figure(
        "A car that does not slip, 8 to 20 m/s: wheels and gyro, radius calibrated",
        TIME,
        "Speed - reference [m/s]",
        [Series(t, error, "error", role="estimate")],
        [Band(t, -BAND_95 * std, BAND_95 * std, "claimed 95 % band")],
        height_px=180,
    )
    slip, slip_std = estimates.slip_speed_m_s[:, 0], BAND_95 * estimates.slip_speed_std_m_s[:, 0]
    yield Figure(
        "Slip of the front left wheel",
        TIME,
        "Slip speed [m/s]",
        [Series(t, slip, "estimate", role="estimate")],
        [Band(t, slip - slip_std, slip + slip_std, "95 % band")],
        height_px=180,
    )


if __name__ == "__main__":
    main()
