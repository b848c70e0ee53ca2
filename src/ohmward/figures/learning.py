"""Figures of learning from logs: curves of the battery file before and after, and its values log by log."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.learning.fold import PULSE_S, ocv_std_V, pulse_ohm_along
from ohmward.figures.battery import SOC_AXIS
from ohmward.figures.parts import band_95, lognormal_band_95
from ohmward.report import Band, Figure, Series
from ohmward.report.figure import Meaning, Style

_SOC = np.linspace(0.0, 1.0, 201)
#: Range of SoC that sets the scale of the change: where the curve is steep its band is far wider.
_MIDDLE = 0.1, 0.95


def ocv_change_figure(before: Battery, after: Battery) -> Figure:
    """Open-circuit voltage before and after, each with its 95 % band."""
    curves = [_curve_V(battery) for battery in (before, after)]
    stds = [ocv_std_V(battery, _SOC) for battery in (before, after)]
    series, bands = _before_and_after(curves, stds)
    return Figure("Open-circuit voltage", SOC_AXIS, "Voltage [V]", series, bands, height_px=320)


def ocv_correction_figure(before: Battery, after: Battery) -> Figure:
    """Change of the open-circuit voltage from the logs, with the 95 % bands before and after."""
    change_mV = 1e3 * (_curve_V(after) - _curve_V(before))
    stds = [1e3 * ocv_std_V(battery, _SOC) for battery in (before, after)]
    series, bands = _before_and_after([np.zeros_like(_SOC), change_mV], stds)
    middle = (_MIDDLE[0] <= _SOC) & (_MIDDLE[1] >= _SOC)
    edges_mV = np.array([(band.low[middle], band.high[middle]) for band in bands])
    limit = 1.2 * float(np.abs(edges_mV).max())
    title = "Change of the open-circuit voltage"
    return Figure(title, SOC_AXIS, "Change [mV]", series, bands, y_limits=(-limit, limit), height_px=220)


def resistance_change_figure(before: Battery, after: Battery) -> Figure:
    """Resistance to ten seconds of current before and after, each with its 95 % band."""
    curves = [1e3 * pulse_ohm_along(battery.thevenin, _SOC) for battery in (before, after)]
    noises = before.noise, after.noise
    log_stds = [np.hypot(n.resistance_std, np.asarray(n.overpotential_share_at(_SOC))) for n in noises]
    series, bands = _before_and_after(curves, log_stds, lognormal_band_95)
    of_lines, of_band = max(line.y.max() for line in series), bands[1].high.max()
    highest = float(max(1.3 * of_lines, 1.1 * of_band))
    title = f"Resistance to {PULSE_S:g} s of current"
    return Figure(title, SOC_AXIS, "Resistance [mΩ]", series, bands, y_limits=(0.0, highest))


def progress_figure(title: str, label: str, knowledge: Sequence[Mapping[str, Any]], scale: float = 1.0) -> Figure:
    """A quantity > 0 with its 95 % band before the first log and after each log.

    knowledge: mean and std of each, as the updates have them.
    """
    number = np.arange(len(knowledge), dtype=float)
    mean = scale * np.array([known["mean"] for known in knowledge])
    std = scale * np.array([known["std"] for known in knowledge])
    line = Series(number, mean, "known", role="estimate")
    band = band_95(number, mean, std, (0.0, np.inf))
    return Figure(title, "Logs learnt", label, [line], [band], height_px=200)


#: States of a file, each with its line and its colour.
_STATES: tuple[tuple[str, Style, Meaning], ...] = (("before", "dashed", "background"), ("after", "line", "estimate"))


def _before_and_after(
    means: Sequence[np.ndarray], stds: Sequence[np.ndarray], band_of: Callable[..., Band] = band_95
) -> tuple[list[Series], list[Band]]:
    """Lines and 95 % bands of a quantity along SoC in both states."""
    x = 100 * _SOC
    series, bands = [], []
    for mean, std, (name, style, role) in zip(means, stds, _STATES, strict=True):
        series.append(Series(x, mean, name, style, role))
        bands.append(band_of(x, mean, std, label=f"95 % {name}", role=role))
    return series, bands


def _curve_V(battery: Battery) -> np.ndarray:
    model = battery.thevenin
    return np.asarray(model.ocv.mean_V(_SOC, model.reference_degC))
