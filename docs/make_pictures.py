"""Make the pictures of the README and the documentation: `python docs/make_pictures.py`.

Everything in them is simulated and says so. The battery is identified from its simulated pulse test, as a user would,
and two estimators run over the simulated day.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ohmward import Battery, Estimate, Log, SocEstimator, identify, make_estimator, make_robot_day
from ohmward.battery.score import BAND_95
from ohmward.report import TIME, Band, Figure, Series
from ohmward.report.svg import to_svg

PICTURES = Path(__file__).parent / "pictures"


def main() -> None:
    """Write every picture."""
    day = robot_day()
    PICTURES.mkdir(exist_ok=True)
    (PICTURES / "robot-day.svg").write_text(to_svg(soc_figure(*day), error_figure(*day)), encoding="utf-8")


def robot_day() -> tuple[Log, Estimate, Estimate]:
    """The log of the day, what the filter makes of it, and what coulomb counting does."""
    day = make_robot_day("lfp")
    battery = identify(day.pulse_test, capacity_Ah=12.0, chemistry="lfp", n_series=4)
    return day.mission, estimate(day.mission, battery, "ekf"), estimate(day.mission, battery, "coulomb")


def estimate(log: Log, battery: Battery, name: str) -> Estimate:
    """State of charge along the day, started at the right value by the estimator called `name`."""
    return SocEstimator(make_estimator(name, battery), initial_soc=1.0).run(log).estimates


def soc_figure(log: Log, filtered: Estimate, counted: Estimate) -> Figure:
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


def error_figure(log: Log, filtered: Estimate, counted: Estimate) -> Figure:
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


if __name__ == "__main__":
    main()
