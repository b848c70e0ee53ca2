"""Figures for judging a battery: measured, estimated and reference values, and the differences between them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ohmward.battery.cells.pack_estimator import PackRun
from ohmward.battery.models.ocv import OcvCurve
from ohmward.battery.models.thevenin import Thevenin
from ohmward.battery.soc.estimator import SocRun
from ohmward.battery.soc.sample import SocEstimate, SocFlag
from ohmward.figures.parts import MOST_SPANS, Timed, band_95, estimated, flag_spans, lognormal_band_95
from ohmward.filters.flags import SampleFlag
from ohmward.logs.log import Log
from ohmward.quantities import QUANTITIES, Quantity
from ohmward.report import TIME, Band, Figure, Series, Span
from ohmward.report.figure import CYCLE, Meaning

if TYPE_CHECKING:
    from ohmward.battery.identification import LogDetails
    from ohmward.battery.identification.circuit_fit import CircuitFit
    from ohmward.battery.identification.log_details import Edge, ExponentialFit, Relaxation
    from ohmward.battery.identification.ocv_from_logs import OcvBranch, RestPoint

SOC_AXIS = "State of charge [%]"
#: Samples drawn of a quantity that changes over hours, such as offset and capacity: lines and bands need no more.
_MOST_SLOW = 100_000
#: Bars of a histogram.
_HISTOGRAM_BINS = 80
#: More lines than this cannot be distinguished: then only the emptiest and the fullest cells are drawn.
_MOST_CELL_LINES = 6
#: Flags that are drawn, and the meaning of their colours.
FLAG_MEANINGS: Mapping[SampleFlag, Meaning] = {
    SocFlag.REST: "background",
    SocFlag.NO_CURRENT: "alert",
    SocFlag.NO_VOLTAGE: "alert",
    SocFlag.BAD_TIME: "alert",
    SocFlag.GAP: "alert",
    SocFlag.VOLTAGE_REJECTED: "alert",
}


def current_figure(log: Log, spans: Sequence[Span] = ()) -> Figure:
    """Measured current over time."""
    series = [Series(log.time_s, log.current_A, "measured", role="estimate")]
    return measured_figure(QUANTITIES["battery_current_A"], series, 200, spans)


def voltage_figure(log: Log, estimates: SocEstimate | None = None) -> Figure:
    """Measured voltage, and the estimator's prediction before each measurement."""
    series = [Series(log.time_s, log.voltage_V, "measured", role="background")]
    if estimates is not None and np.isfinite(estimates.voltage_V).any():
        series.append(Series(log.time_s, estimates.voltage_V, "expected", role="estimate"))
    return measured_figure(QUANTITIES["battery_voltage_V"], series)


def temperature_figure(log: Log) -> Figure:
    """Measured temperature over time."""
    values = np.full(len(log), np.nan) if log.temperature_degC is None else log.temperature_degC
    series = [Series(log.time_s, values, "measured", role="comparison")]
    return measured_figure(QUANTITIES["battery_temperature_degC"], series, 160)


def log_figures(log: Log) -> list[Figure]:
    """Every battery quantity of the log over time."""
    temperature = [] if log.temperature_degC is None else [temperature_figure(log)]
    return [current_figure(log), voltage_figure(log), *temperature, *further_figures(log)]


def further_figures(log: Log) -> list[Figure]:
    """Further battery quantities of the log over time."""
    measured = [(QUANTITIES[name], values) for name, values in log.quantities("battery").items()]
    return [
        measured_figure(quantity, [Series(log.time_s, values, "measured", role="comparison")], 160)
        for quantity, values in measured
        if not quantity.estimated_from
    ]


def measured_figure(
    quantity: Quantity, series: Sequence[Series], height_px: int = Figure.height_px, spans: Sequence[Span] = ()
) -> Figure:
    """A quantity over time, with its label from the table."""
    return Figure(quantity.label, TIME, quantity.axis, series, spans=spans, height_px=height_px)


def interval_figure(log: Log) -> Figure:
    """Time from each sample to the next, on a logarithmic axis: gaps and jitter at a glance."""
    dots = [Series(log.time_s[1:], log.dt_s, "to the sample before", "points", "background")]
    return Figure("Time between samples", TIME, "Interval [s]", dots, log_y=True, height_px=160)


def soc_figure(
    log: Timed, estimates: SocEstimate, truth: np.ndarray | None = None, spans: Sequence[Span] = ()
) -> Figure:
    """Estimated state of charge with its 95 % band, and the reference.

    truth: (T,) in [0, 1], nan where there is none.
    """
    reference = None if truth is None else 100 * truth
    curves = estimated(log.time_s, 100 * estimates.soc, 100 * estimates.soc_std, reference, (0.0, 100.0))
    return Figure("State of charge", TIME, SOC_AXIS, *curves, spans=spans, height_px=300)


def soc_error_figure(log: Timed, estimates: SocEstimate, truth: np.ndarray) -> Figure:
    """Estimate minus reference, inside (or outside) the 95 % band that the estimator claimed around zero."""
    error, std = 100 * (estimates.soc - truth), 100 * estimates.soc_std
    series = [Series(log.time_s, error, "estimate - reference", role="comparison")]
    band = band_95(log.time_s, np.zeros_like(std), std)
    return _errors_of_charge(series, [band])


def offset_figure(log: Timed, estimates: SocEstimate) -> Figure:
    """Estimated offset of the current sensor with its 95 % band."""
    time_s, offset_mA, std_mA = _slow(log.time_s, 1e3, estimates.current_offset_A, estimates.current_offset_std_A)
    curves = estimated(time_s, offset_mA, std_mA)
    return Figure("Offset of the current sensor", TIME, "Offset [mA]", *curves, height_px=180)


def health_figure(log: Timed, estimates: SocEstimate) -> Figure:
    """Estimated capacity and resistance as shares of the battery file's, with their 95 % bands."""
    e = estimates
    time_s, capacity, capacity_std = _slow(log.time_s, 100.0, e.soh_capacity, e.soh_capacity_std)
    _, resistance, resistance_std = _slow(log.time_s, 100.0, e.resistance_ratio, e.resistance_ratio_std)
    log_std = resistance_std / np.where(resistance > 0.0, resistance, np.nan)
    series = [
        Series(time_s, capacity, "capacity", role="estimate"),
        Series(time_s, resistance, "resistance", role="comparison"),
    ]
    bands = [
        band_95(time_s, capacity, capacity_std, (0.0, np.inf), "95 % of capacity"),
        lognormal_band_95(time_s, resistance, log_std, "95 % of resistance", "comparison"),
    ]
    return Figure("Capacity and resistance over the battery file's", TIME, "Share [%]", series, bands, height_px=180)


def voltage_error_figure(log: Log, estimates: SocEstimate) -> Figure:
    """Measured minus expected voltage over time."""
    series = [Series(log.time_s, 1e3 * (log.voltage_V - estimates.voltage_V), "measured - expected", role="estimate")]
    return Figure("Error of the voltage", TIME, "Error [mV]", series, height_px=180)


def soc_comparison_figure(log: Timed, estimates: Mapping[str, SocEstimate], truth: np.ndarray | None = None) -> Figure:
    """State of charge by every estimator, and the reference."""
    series = _side_by_side(log.time_s, {name: 100 * e.soc for name, e in estimates.items()})
    if truth is not None:
        series.append(Series(log.time_s, 100 * truth, "reference", "dashed", "reference"))
    return Figure("State of charge", TIME, SOC_AXIS, series, height_px=320)


def soc_errors_figure(log: Timed, estimates: Mapping[str, SocEstimate], truth: np.ndarray) -> Figure:
    """Estimate minus reference of every estimator."""
    series = _side_by_side(log.time_s, {name: 100 * (e.soc - truth) for name, e in estimates.items()})
    return _errors_of_charge(series)


def _errors_of_charge(series: Sequence[Series], bands: Sequence[Band] = ()) -> Figure:
    """Lines and bands around zero, as far as all but the largest reach."""
    limit = _usual(np.concatenate([*(line.y for line in series), *(band.high for band in bands)]))
    title = "Error of the state of charge"
    return Figure(title, TIME, "Error [% of capacity]", series, bands, y_limits=(-limit, limit))


def comparison_figures(log: Timed, runs: Mapping[str, SocRun], truth: np.ndarray | None = None) -> list[Figure]:
    """State of charge by every estimator, and their errors where a truth (T,) in [0, 1] is known."""
    estimates = {name: run.estimates for name, run in runs.items()}
    figures = [soc_comparison_figure(log, estimates, truth)]
    return figures if truth is None else [*figures, soc_errors_figure(log, estimates, truth)]


def soc_flag_spans(log: Timed, flags: np.ndarray) -> list[Span]:
    """Stretches of samples that carry a flag, rests in grey and faults in red; flags: (T,) sums of `SocFlag` values."""
    return flag_spans(log.time_s, flags, FLAG_MEANINGS)


def run_figures(run: SocRun, truth: np.ndarray | None = None) -> list[Figure]:
    """State of charge of a run, its error where a truth (T,) in [0, 1] is known, and the estimator's other values."""
    e = run.estimates
    figures = [soc_figure(run, e, truth, soc_flag_spans(run, run.flags))]
    if truth is not None:
        figures.append(soc_error_figure(run, e, truth))
    if np.isfinite(e.innovation_V).any():
        line = [Series(run.time_s, 1e3 * e.innovation_V, "measured - expected", role="estimate")]
        figures.append(Figure("Innovation of the voltage", TIME, "Innovation [mV]", line, height_px=180))
    if np.isfinite(e.current_offset_A).any():
        figures += [offset_figure(run, e), health_figure(run, e)]
    return figures


def ocv_figure(
    ocv: OcvCurve,
    branches: Sequence[OcvBranch] = (),
    rests: Sequence[RestPoint] = (),
    fit: CircuitFit | None = None,
) -> Figure:
    """Open-circuit voltage: mean curve and branches, the tests and rests behind it, the fit's 95 % interval."""
    soc = np.linspace(0.0, 1.0, 401)
    mean, half = np.asarray(ocv.mean_V(soc, ocv.reference_degC)), np.asarray(ocv.hysteresis_at(soc))
    series = [Series(100 * b.soc, b.voltage_V, f"measured {b.direction}", "points", "background") for b in branches]
    series.append(Series(100 * soc, mean, "mean", role="estimate"))
    if half.any():
        series.append(Series(100 * soc, mean + half, "charge branch", "dashed", "comparison"))
        series.append(Series(100 * soc, mean - half, "discharge branch", "dashed"))
    if rests:
        x, y = np.array([(r.soc, r.voltage_V) for r in rests]).T
        series.append(Series(100 * x, y, "at the end of a rest", "points", "reference"))
    bands = [] if fit is None else [band_95(100 * soc, mean, fit.ocv_std_V(soc))]
    return Figure("Open-circuit voltage", SOC_AXIS, "Voltage [V]", series, bands, height_px=320)


def resistance_figure(model: Thevenin, fit: CircuitFit | None = None) -> Figure:
    """Every resistance of the circuit against state of charge, with the fit's 95 % intervals."""
    names = ["R0 discharge", "R0 charge", *(f"R{j}, {seconds_text(tau)}" for j, tau in enumerate(model.tau_s, 1))]
    rows = [model.r0_discharge_ohm, model.r0_charge_ohm, *model.r_ohm]
    roles: tuple[Meaning, ...] = ("estimate", "background", "comparison", "reference", "alert")
    soc = 100 * np.linspace(0.0, 1.0, len(model.r0_discharge_ohm))
    series, bands = [], []
    for j, (name, row_ohm, role) in enumerate(zip(names, rows, roles, strict=False)):
        row_mohm = 1e3 * np.asarray(row_ohm)
        series.append(Series(soc, row_mohm, name, role=role))
        if fit is not None:
            std_mohm = 1e3 * fit.resistance_std_ohm(j)
            bands.append(band_95(soc, row_mohm, std_mohm, (0.0, np.inf), f"95 % of {name}", role))
    return Figure("Resistances", SOC_AXIS, "Resistance [mΩ]", series, bands)


def edge_figure(edges: Sequence[Edge]) -> Figure:
    """Resistance from each step of the current, by direction."""
    series = []
    for sign, label in ((-1.0, "discharge"), (1.0, "charge")):
        points = [(e.soc, e.resistance_ohm) for e in edges if e.current_A * sign > 0]
        x, y = np.array(points or np.empty((0, 2))).T
        series.append(Series(100 * x, 1e3 * y, label, "points"))
    return Figure("Ohmic resistance at the edges of the current", SOC_AXIS, "dV/dI [mΩ]", series, height_px=220)


def relaxation_figure(rest: Relaxation) -> Figure:
    """One rest, and the fits with one and with two time constants."""
    single, double = rest.single, rest.double
    series = [
        Series(rest.time_s, rest.voltage_V, "measured", "points", "reference"),
        Series(rest.time_s, single.voltage_V, f"{_taus(single)}, {1e3 * single.rms_V:.2g} mV RMS", role="comparison"),
        Series(rest.time_s, double.voltage_V, f"{_taus(double)}, {1e3 * double.rms_V:.2g} mV RMS", role="estimate"),
    ]
    title = f"Rest at {max(100 * rest.soc, 0.0):.0f} % after {rest.before_A:.3g} A"
    return Figure(title, TIME, "Voltage [V]", series, height_px=220)


def fit_figures(log: LogDetails) -> list[Figure]:
    """Measured and simulated voltage, residual, current and state of charge of one log, on one clock."""
    whole, time_s = log.record.log, _joined([part.time_s for part in log.parts], hold=True)
    measured, simulated = _joined([part.voltage_V for part in log.parts]), _joined(log.simulated_V)
    rests = [(phase.first, phase.last) for phase in log.record.phases if phase.kind == "rest"][:MOST_SPANS]
    spans = [Span(float(whole.time_s[first]), float(whole.time_s[last]), "rest") for first, last in rests]
    voltage = [
        Series(time_s, measured, "measured", role="background"),
        Series(time_s, simulated, "simulated", role="estimate"),
    ]
    residual = [Series(time_s, 1e3 * (measured - simulated), "measured - simulated", role="comparison")]
    soc = [Series(whole.time_s, 100 * log.axis.soc, "counted", role="estimate")]
    return [
        measured_figure(QUANTITIES["battery_voltage_V"], voltage, spans=spans),
        Figure("Residual", TIME, "Residual [mV]", residual, height_px=180),
        current_figure(whole),
        Figure("State of charge", TIME, SOC_AXIS, soc, height_px=180),
    ]


def residuals_figure(residual_mV: np.ndarray) -> Figure:
    """Frequency of the residuals of a fit, beside the normal distribution of the same mean and deviation.

    residual_mV: (N,); nan is left out, and the outermost 0.1 % on either side are not drawn.
    """
    title, x_label = "Residuals", "Measured - simulated voltage [mV]"
    known = residual_mV[np.isfinite(residual_mV)]
    if not known.size:
        return Figure(title, x_label, "Density", [], height_px=220)
    low, high = np.quantile(known, [0.001, 0.999])
    high = high if high > low else low + 1e-9
    density, edges = np.histogram(known, _HISTOGRAM_BINS, (low, high), density=True)
    middle = 0.5 * (edges[1:] + edges[:-1])
    std = max(known.std(), 1e-12)
    z = (middle - known.mean()) / std
    normal = np.exp(-0.5 * z**2) / (std * np.sqrt(2 * np.pi))
    series = [
        Series(edges, np.append(density, density[-1]), "residuals", "step", "estimate"),
        Series(middle, normal, "normal", "dashed", "reference"),
    ]
    return Figure(title, x_label, "Density", series, height_px=220)


def _slow(time_s: np.ndarray, factor: float, *columns: np.ndarray) -> list[np.ndarray]:
    """Times, and columns times the factor: every sample, or `_MOST_SLOW` even ones of a long log."""
    drawn = np.linspace(0, time_s.size - 1, min(_MOST_SLOW, time_s.size)).astype(int)
    return [time_s[drawn], *(factor * column[drawn] for column in columns)]


def _side_by_side(x: np.ndarray, lines: Mapping[str, np.ndarray]) -> list[Series]:
    """A line each; those beyond the number of hues are dashed."""
    series = [Series(x, y, name) for name, y in lines.items()]
    beyond = [replace(line, style="dashed") for line in series[len(CYCLE) :]]
    return series[: len(CYCLE)] + beyond


def seconds_text(seconds: float) -> str:
    """A time constant with three digits, or to the second: "48.1 s", "1240 s"."""
    return f"{seconds:.0f} s" if seconds >= 100 else f"{seconds:.3g} s"


def _taus(fit: ExponentialFit) -> str:
    return " and ".join(map(seconds_text, fit.tau_s))


def _joined(parts: Sequence[np.ndarray], *, hold: bool = False) -> np.ndarray:
    """The parts one after the other with a gap, nan or (for a time) the last value, after each."""
    return np.concatenate([np.append(part, part[-1] if hold else np.nan) for part in parts])


def _usual(values: np.ndarray) -> float:
    """A limit above all but the largest 2 % of the magnitudes, so that the first seconds do not flatten the rest."""
    size = values[np.isfinite(values)]
    if not size.size:
        return 1.0
    np.abs(size, out=size)
    return max(1.3 * float(np.quantile(size, 0.98, overwrite_input=True)), 1e-6)


def cells_soc_figure(run: PackRun) -> Figure:
    """State of charge of the cells, and of the pack; the 95 % band of the cell that is weakest at the end."""
    time_s, cells, k = run.time_s, run.cells, int(run.pack.weakest[-1])
    soc, std = 100 * cells.soc[:, k], 100 * cells.soc_std[:, k]
    weakest = Series(time_s, soc, f"weakest: {run.names[k]}", role="alert")
    others = _cell_lines(run, cells.soc, [other for other in _drawn(run) if other != k])
    pack = Series(time_s, 100 * run.pack.soc, "pack", "dashed", "reference")
    band = band_95(time_s, soc, std, (0.0, 100.0), role="alert")
    series = [weakest, *others, pack]
    return Figure("State of charge of the cells", TIME, SOC_AXIS, series, [band], height_px=300)


def cells_difference_figure(run: PackRun) -> Figure:
    """State of charge of each cell minus that of the typical one, with the range of all cells."""
    difference = run.cells.soc_difference
    series = _cell_lines(run, difference, _drawn(run))
    low, high = 100 * difference.min(axis=1), 100 * difference.max(axis=1)
    band = Band(run.time_s, low, high, "all cells", "background")
    return Figure("Cells beside the typical one", TIME, "Difference of SoC [points]", series, [band], height_px=200)


def _cell_lines(run: PackRun, share: np.ndarray, cells: Sequence[int]) -> list[Series]:
    """A share (T, cells) of the capacity of some cells, in percent."""
    return [Series(run.time_s, 100 * share[:, k], run.names[k]) for k in cells]


def _drawn(run: PackRun) -> list[int]:
    """Indices of the cells that are drawn: all where they are few, else the emptiest and the fullest at the end."""
    order = np.argsort(run.cells.soc[-1]).tolist()
    if len(order) > _MOST_CELL_LINES:
        order = [*order[: _MOST_CELL_LINES // 2], order[-1]]
    return sorted(order)
