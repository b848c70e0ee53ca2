"""Figures of a mission: the plan ahead, where the energy of a drive went, the energy that each ground takes."""

from __future__ import annotations

import numpy as np

from ohmward.energy import BatteryState, Consumption, MissionForecast
from ohmward.energy.drive_record import DriveRecord, RecordedBalance, expected_J_per_m, usual_speed_m_s
from ohmward.energy.points import P90_SIGMA
from ohmward.figures.parts import arriving_figure
from ohmward.quantities import SECONDS_PER_HOUR
from ohmward.report import TIME, Band, Figure, Marker, Series
from ohmward.report.figure import Meaning

#: Parts of the power that are stacked in the picture, and their colours.
_STACK: dict[str, tuple[tuple[str, ...], Meaning]] = {
    "idle": (("idle",), "background"),
    "windings and gears": (("copper", "drive"), "comparison"),
    "slip": (("slip",), "alert"),
    "rolling": (("rolling",), "estimate"),
}
_SMOOTH_S = 2.0
_SPEEDS = 25
#: Shorter stretches are starts and stops: their energy per metre is meaningless.
_SHORTEST_DRAWN_M = 5.0


def plan_figures(forecast: MissionForecast, state: BatteryState) -> list[Figure]:
    """State of charge, energy and probability along the plan."""
    m = forecast.milestones
    x = np.array([0.0, *(one.distance_m for one in m)])
    now = state.soc + P90_SIGMA * state.soc_std * np.array([-1.0, 0.0, 1.0])
    soc = 100 * np.vstack([now, *(np.array(one.soc) for one in m)]).clip(0.0, 1.0)
    energy = np.vstack([np.zeros(3), *(np.array(one.energy_J) / SECONDS_PER_HOUR for one in m)])
    probability = np.array([1.0, *(one.probability for one in m)])
    turn = [Marker(forecast.point_of_return_m, "latest point of return", "alert")]
    reserve = Series(x, np.full(len(x), 100 * state.reserve_soc), "reserve", "dashed", "reference")
    label = "Distance [m]"
    return [
        Figure("State of charge", label, "State of charge [%]", [_line(x, soc), reserve], [_band(x, soc)], turn),
        Figure("Energy", label, "Energy [Wh]", [_line(x, energy)], [_band(x, energy)], turn, height_px=200),
        arriving_figure(label, x, probability, turn, 200),
    ]


def power_figure(balance: RecordedBalance) -> Figure:
    """Stacked losses, and the battery's power above them."""
    t = balance.time_s
    bands = []
    lower = np.zeros(len(t))
    for label, (names, role) in _STACK.items():
        losses_W = sum(getattr(balance.power, name) for name in names)
        upper = lower + np.maximum(_smooth(t, losses_W), 0.0)
        bands.append(Band(t, lower, upper, label, role))
        lower = upper
    line = Series(t, _smooth(t, balance.power.battery), "battery", role="reference")
    title = "Power: stacked losses; the rest up to the battery's line climbs, accelerates or is unexplained"
    return Figure(title, TIME, "Power [W]", [line], bands, height_px=320)


def speed_figure(record: DriveRecord) -> Figure:
    """Speed and battery power over time."""
    t = record.log.time_s
    series = [
        Series(t, record.battery_W, "battery", role="reference"),
        Series(t, record.speed_m_s, "speed", role="estimate", axis="right"),
    ]
    return Figure("Power and speed", TIME, "Power [W]", series, right_label="Speed [m/s]")


def terrain_figure(c: Consumption, name: str, record: DriveRecord | None) -> Figure:
    """Energy per metre over speed: the range expected on another day, and the stretches of this drive."""
    usual = usual_speed_m_s(c, name)
    speeds = np.linspace(0.4 * usual, 2.0 * usual, _SPEEDS)
    expected = np.array([expected_J_per_m(c, name, float(v)) for v in speeds])
    series = [_line(speeds, expected)]
    there = [d for d in record.driven if d.stretch.terrain == name] if record else []
    if there := [d for d in there if d.stretch.distance_m > _SHORTEST_DRAWN_M]:
        v = np.array([d.stretch.speed_distance_m2_s / d.stretch.distance_m for d in there])
        points = np.array([d.energy_J / d.stretch.distance_m for d in there])
        series.append(Series(v, points, "stretches of this drive", "points", "comparison"))
    return Figure(f"On {name}", "Speed [m/s]", "Energy per metre [J/m]", series, [_band(speeds, expected)])


def _line(x: np.ndarray, quantiles: np.ndarray) -> Series:
    return Series(x, quantiles[:, 1], "P50", role="estimate")


def _band(x: np.ndarray, quantiles: np.ndarray) -> Band:
    return Band(x, quantiles[:, 0], quantiles[:, 2], "P10-P90")


def _smooth(time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
    """A running mean over two seconds: single samples are mostly noise."""
    step_s = max(float(np.median(np.diff(time_s))), 1e-9)
    width = max(round(_SMOOTH_S / step_s), 1)
    known = np.nan_to_num(np.asarray(values, dtype=float))
    half = width // 2
    padded = np.pad(known, half, mode="edge")
    smooth = np.convolve(padded, np.full(width, 1 / width), mode="same")
    return smooth[half : half + len(known)]
