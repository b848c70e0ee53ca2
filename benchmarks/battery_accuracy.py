"""Accuracy of the state of charge on measured data, see `accuracy.py`.

Nothing here is tuned: every battery is identified from the tests that its user would have, with the defaults, and
estimated on another recording.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

import measured_cells as cells
from figure import data_file, verdict
from figure import table as markdown_table
from ohmward.battery.battery import Battery
from ohmward.battery.chemistries import start_model, start_noise
from ohmward.battery.identification import identify
from ohmward.battery.models.ocv import OcvCurve
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.battery.soc.registry import DEFAULT, ESTIMATORS, EstimatorSettings, available, make_estimator, published
from ohmward.battery.soc.score import Score, score
from ohmward.logs import Log, read_log
from ohmward_lab.simulate.voltage import simulate_voltage

USUAL_METHODS = ("coulomb", DEFAULT, "ekf", "ukf")
INTRODUCTION = """\
Every battery is identified with the defaults, from the tests that its user would have, and estimated on another
recording; nothing is tuned per file. Errors of SoC in points of percent, of voltage in mV; coverage is the share of
samples whose truth lies in the estimate's own 95 % band.
"""


class Row(NamedTuple):
    """One line of the table; errors in percent of SoC or in mV."""

    data: str
    method: str
    start: str
    score: Score
    bar: str
    met: bool | None


class Case(NamedTuple):
    """One way to start an estimator on a log.

    start: in words; soc: initial value or None; offset_A: added to the measured current; after_s: scored from then on.
    """

    start: str
    soc: float | None
    offset_A: float = 0.0
    after_s: float = 0.0
    rmse_bar: float | None = None
    mae_bar: float | None = None
    coverage_bar: float | None = None


def a123() -> Iterator[Row]:
    """LFP: OCV test and the first half of the dynamic run identify; the whole run is estimated."""
    for temperature in (25, 5, 45):
        run = _read("plett_a123_lfp/a123_dyn.parquet", where={"temp_C": temperature, "script": 1})
        rest = _read("plett_a123_lfp/a123_dyn.parquet", where={"temp_C": temperature, "script": 2})
        tests = [
            _read("plett_a123_lfp/a123_ocv.parquet", where={"temp_C": temperature, "script": script})
            for script in (1, 3)
        ]
        half = run.between(run.time_s[0], run.time_s[len(run.time_s) // 2])
        battery = identify([*tests, half], capacity_Ah=cells.A123_AH, chemistry="lfp")
        capacity_Ah = float(cells.discharged_Ah(run)[-1] + cells.discharged_Ah(rest)[-1])
        truth = 1 - cells.discharged_Ah(run) / capacity_Ah
        name = f"A123 LFP dynamic, {temperature} degC"
        rmse, low = (0.006, 0.01) if temperature == 25 else (None, None)
        cases = [
            Case("right", 1.0, rmse_bar=rmse),
            Case("30 points low", 0.7, after_s=cells.HOUR, rmse_bar=low),
            Case("unknown", None),
        ]
        bars = {"rmse_bar": 0.012, "coverage_bar": 0.85} if temperature == 25 else {}
        cases += [Case(f"right, {1000 * a:+.0f} mA offset", 1.0, a, **bars) for a in (0.05, -0.05)]
        yield from _estimates(name, battery, run, truth, cases, all_methods=temperature == 25)
        bars = {"rmse_bar": 0.008, "coverage_bar": 0.85}
        cases = [Case(f"right, {1000 * a:+.0f} mA offset", 1.0, a, **bars) for a in (0.05, -0.05)]
        cases += [Case(f"30 points low, {1000 * a:+.0f} mA offset", 0.7, a, cells.HOUR, **bars) for a in (0.05, -0.05)]
        currentless = replace(battery, idle_current_A=0.0)
        yield from _estimates(f"{name}, rests declared currentless", currentless, run, truth, cases)


def panasonic() -> Iterator[Row]:
    """NCA: HPPC and C/20 identify; two drive cycles are estimated."""
    battery = cells.panasonic_battery(25)
    for cycle in ("Cycle_1", "HWFTa"):
        run, truth = cells.panasonic(f"25degC_{cycle}")
        cases = [
            Case("right", 1.0, rmse_bar=0.015),
            Case("20 points low", 0.8, after_s=cells.HOUR, rmse_bar=0.02),
            Case("unknown", None),
            Case("right, +50 mA offset", 1.0, 0.05),
        ]
        yield from _estimates(f"Panasonic NCA {cycle}, 25 degC", battery, run, truth, cases)


def inr20r() -> Iterator[Row]:
    """NMC without any test: generic start values with the OCV polynomial that comes with the data."""
    run, truth = cells.calce()
    soc = np.linspace(0, 1, 201)
    polynomial = [6.22208, -19.90939, 23.98139, -12.65667, 3.29470, 3.24331]
    ocv = OcvCurve(tuple(np.maximum.accumulate(np.polyval(polynomial, soc)).tolist()))
    model, noise = start_model("nmc", 2.0, ocv=ocv), start_noise("nmc", ocv_known=True)
    battery = Battery(name="generic NMC", chemistry="nmc", capacity_Ah=2.0, thevenin=model, noise=noise)
    cases = [Case("right", 0.8), Case("50 points low", 0.3, after_s=1800.0, rmse_bar=0.03), Case("unknown", None)]
    yield from _estimates("Samsung 20R NMC DST, start values only", battery, run, truth, cases)


def vrla() -> Iterator[Row]:
    """Sealed lead-acid: the first two discharges identify, the third is estimated."""
    battery, (run, truth) = cells.vrla_battery(), cells.vrla()
    cases = [Case("right", 1.0, mae_bar=0.022), Case("unknown", None)]
    yield from _estimates("BBOXX VRLA telemetry, third discharge", battery, run, truth, cases, all_methods=True)


def ornl() -> Iterator[Row]:
    """Li-ion pouch: HPPC identifies, the voltage of a 1C discharge is simulated."""
    battery = identify([_read("ornl_nissan_leaf_cell/cell-low-current-hppc-25c-2.parquet")], capacity_Ah=cells.ORNL_AH)
    log = _read("ornl_nissan_leaf_cell/cell-discharge-bitrode-1c.parquet")
    run = log.between(9500.0, 13655.0)
    simulated = simulate_voltage(battery.thevenin, run, initial_soc=1.0)
    above = simulated.soc > 0.1
    result = score(simulated.voltage_V[above], run.voltage_V[above])
    met = result.rmse <= 0.025
    yield Row("ORNL Leaf cell 1C, voltage above 10 % SoC", "simulation", "full", result, "RMSE <= 25 mV", met)


SECTIONS: tuple[Callable[[], Iterator[Row]], ...] = (a123, panasonic, inr20r, vrla, ornl)


def _estimates(
    data: str, battery: Battery, run: Log, truth: np.ndarray, cases: list[Case], all_methods: bool = False
) -> Iterator[Row]:
    methods = (DEFAULT, *available(battery, with_published=True)) if all_methods else USUAL_METHODS
    for method in methods:
        for case in cases:
            estimator = make_estimator(method, battery, EstimatorSettings(battery.idle_current_A))
            shifted = replace(run, current_A=run.current_A + case.offset_A)
            estimates = SocEstimator(estimator, case.soc).run(shifted).estimates
            counted = run.time_s - run.time_s[0] >= case.after_s
            found = score(estimates.soc[counted], truth[counted], estimates.soc_std[counted])
            bar, met = _judge(found, case) if method == DEFAULT else ("", None)
            start = case.start + (f", after {case.after_s / 60:.0f} min" if case.after_s else "")
            yield Row(data, method, start, found, bar, met)


def _judge(found: Score, case: Case) -> tuple[str, bool | None]:
    """The bars of a case in words, and whether they are met."""
    bars = [
        (f"RMSE <= {100 * (case.rmse_bar or 0):.1f} %", case.rmse_bar, found.rmse <= (case.rmse_bar or 0)),
        (f"MAE <= {100 * (case.mae_bar or 0):.1f} %", case.mae_bar, found.mae <= (case.mae_bar or 0)),
        (
            f"coverage >= {100 * (case.coverage_bar or 0):.0f} %",
            case.coverage_bar,
            found.coverage_95 >= (case.coverage_bar or 0),
        ),
    ]
    wanted = [(text, met) for text, bar, met in bars if bar is not None]
    return ", ".join(text for text, _ in wanted), all(met for _, met in wanted) if wanted else None


def _read(path: str, **options) -> Log:
    return read_log(data_file(path), **options)


def line(row: Row) -> str:
    """A row for the terminal."""
    s = row.score
    figures = f"{100 * s.rmse:6.2f} {100 * s.coverage_95:5.0f}"
    return f"{row.data:55s} {row.method:8s} {row.start:40s} {figures} {row.bar} {verdict(row.met)}"


def table(rows: Sequence[Row]) -> list[str]:
    """The rows in Markdown, and what the methods are."""
    header = ("data", "method", "start", "RMSE", "MAE", "max", "coverage of 95 %", "to reach", "")
    lines = []
    for row in rows:
        s, factor = row.score, 1000 if "voltage" in row.data else 100
        errors = [f"{factor * error:.2f}" for error in (s.rmse, s.mae, s.max_error)]
        coverage = f"{100 * s.coverage_95:.0f} %" if np.isfinite(s.coverage_95) else ""
        lines.append((*row[:3], *errors, coverage, row.bar, verdict(row.met)))
    methods = [f"- `{DEFAULT}`: `gsf`"]
    methods += [f"- `{name}`: {choice.title}" for name, choice in (ESTIMATORS | published()).items()]
    return [*markdown_table(header, lines), "", "Methods:", "", *methods]
