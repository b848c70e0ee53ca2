"""Tables 3.1 to 3.3 and figures 3.6 to 3.15 of [T]: voltage, parameters and state of charge by four filters."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ohmward.figures.battery import current_figure, voltage_figure
from ohmward.published.joint_by_method import METHODS
from ohmward.report import TIME, Figure, Series
from ohmward.reproduce.row import Errors, Result, ResultRow, error_rows, errors, mean_errors
from ohmward.reproduce.thesis_runs import (
    NARROW,
    SEEDS,
    WHOLE,
    SchemeRun,
    ThesisCase,
    case,
    default_run,
    offline_voltage,
    run,
)

#: Printed largest and mean absolute error: of the voltage [V] in tables 3.1 and 3.2, of the SoC [%] in table 3.3.
OFFLINE_V = Errors(0.16, 0.018)
VOLTAGE_V = {
    "aukf": Errors(0.060, 0.002),
    "ukf": Errors(0.11, 0.012),
    "aekf": Errors(0.09, 0.008),
    "ekf": Errors(0.16, 0.020),
}
SOC_PERCENT = {
    "aukf": Errors(0.10, 0.028),
    "aekf": Errors(0.22, 0.035),
    "ukf": Errors(0.47, 0.11),
    "ekf": Errors(0.71, 0.18),
}
#: Time [s] after which the start of the parameters has been found.
_SETTLED_S = 100.0

_BEFORE = (
    "the text leaves open whether its error is taken before or after the sample, and does not give its sensor's noise "
    "(2 mV here, 1.6 mV in the mean); as printed, with di/dt = 0, the filters explain each jump of the voltage by a "
    "small C_s, with which the Euler step is unstable: nan"
)
_AFTER = "a filter that matches Q and R lets the voltage follow every sample: its error after the sample proves little"
_OFFLINE = "another battery; `as printed` by the 75 % rule, `corrected` by least squares on the whole pulse test"
_SOC = (
    "the sensors here have no offset, as [T]'s reference, so that the count carries every filter; the mean says how "
    "much the voltage pulls it. Q0, R0 and P0 are not those of (3.51)"
)


def offline_and_updated() -> Result:
    """Table 3.1 and figures 3.6 to 3.9: the model found offline against the one that is updated on the way."""
    by_rule, by_fit, updated, printed, default = [], [], [], [], []
    for seed in SEEDS:
        here = case(NARROW, seed)
        measured_V = here.log.voltage_V
        by_rule.append(errors(measured_V - offline_voltage(here, here.offline.rule)))
        by_fit.append(errors(measured_V - offline_voltage(here, here.offline.model)))
        printed.append(errors(run("aukf", False, NARROW, seed).joint.found.innovation_V))
        updated.append(errors(run("aukf", True, NARROW, seed).joint.found.innovation_V))
        default.append(errors(_expected_error(here, seed)))
    rows = [
        *_mean_rows("Voltage, offline model", "V", OFFLINE_V, by_rule, by_fit, default, _OFFLINE),
        *_mean_rows("Voltage, model updated by AUKF", "V", VOLTAGE_V["aukf"], printed, updated, default, _BEFORE),
    ]
    here, found = case(), run("aukf", True)
    drawn = (current_figure(here.log), voltage_figure(here.log), *_parameter_figures(here, found))
    return Result(tuple(rows), drawn)


def _expected_error(here: ThesisCase, seed: int) -> np.ndarray:
    """Measured voltage less that which the default estimator expects (T - 1,)."""
    return (here.log.voltage_V - default_run(NARROW, seed).voltage_V)[1:]


def _mean_rows(
    what: str,
    unit: str,
    printed: Errors | None,
    as_printed: list[Errors],
    corrected: list[Errors],
    default: list[Errors] | None,
    why: str,
) -> list[ResultRow]:
    """Rows of the errors' means over the seeds."""
    found = (mean_errors(as_printed), mean_errors(corrected), mean_errors(default) if default else None)
    return error_rows(what, unit, printed, *found, why)


def _parameter_figures(here: ThesisCase, found: SchemeRun) -> list[Figure]:
    """Figure 3.7: the four parameters over time."""
    p, t = found.joint.found, here.log.time_s
    named = {
        "C_b [kF]": 1e-3 * p.c_bulk_F,
        "C_s [F]": p.c_surface_F,
        "R_e [mΩ]": 1e3 * p.r_ohm,
        "R_t [mΩ]": 1e3 * p.r_terminal_ohm,
    }
    return [
        Figure(f"{name.split()[0]} by AUKF", TIME, name, [Series(t, y, "AUKF", role="estimate")], height_px=140)
        for name, y in named.items()
    ]


def voltage_by_method() -> Result:
    """Table 3.2 and figures 3.11, 3.12, 3.15: voltage error and covariance of EKF, AEKF, UKF and AUKF."""
    rows = []
    default = [errors(_expected_error(case(NARROW, seed), seed)) for seed in SEEDS]
    for method in METHODS:
        for when, of in (("before", _innovation), ("after", _residual)):
            rows += _mean_rows(
                f"Voltage {when} the sample, {method.upper()}",
                "V",
                VOLTAGE_V[method],
                [errors(of(run(method, False, NARROW, seed))) for seed in SEEDS],
                [errors(of(run(method, True, NARROW, seed))) for seed in SEEDS],
                default if when == "before" else None,
                _BEFORE if when == "before" else _AFTER,
            )
    return Result((*rows, *_order(_innovation, "mean voltage error before the sample")), _method_figures())


def _innovation(found: SchemeRun) -> np.ndarray:
    return found.joint.found.innovation_V


def _residual(found: SchemeRun) -> np.ndarray:
    return found.joint.residual_V


def _soc_error(found: SchemeRun, truth: np.ndarray) -> np.ndarray:
    return 100.0 * (found.soc.soc - truth)


def _order(of: Callable[[SchemeRun], np.ndarray], what: str) -> list[ResultRow]:
    """Shares of the drives in which the adaptive filter is better, once the start has been found."""
    rows = []
    for better, worse in (("aukf", "ukf"), ("aekf", "ekf"), ("aukf", "aekf"), ("ukf", "ekf")):
        wins = []
        for seed in SEEDS:
            late = case(NARROW, seed).log.time_s >= _SETTLED_S
            one, other = (np.abs(of(run(m, True, NARROW, seed)))[late].mean() for m in (better, worse))
            wins.append(one < other)
        name = f"{better.upper()} < {worse.upper()} in {what} after {_SETTLED_S:g} s, share of drives"
        rows.append(ResultRow(name, "%", 100.0, None, 100.0 * float(np.mean(wins)), None, ""))
    return rows


def _method_figures() -> tuple[Figure, ...]:
    t = case().log.time_s
    found = {m: run(m, True) for m in METHODS}
    innovation = [Series(t, 1e3 * _innovation(f), m.upper()) for m, f in found.items()]
    variance = [Series(t, np.sqrt(f.joint.voltage_variance_V2) * 1e3, m.upper()) for m, f in found.items()]
    return (
        Figure("Voltage error before the sample", TIME, "Error [mV]", innovation),
        Figure("Standard deviation of the voltage", TIME, "sigma [mV]", variance),
    )


def soc_by_method() -> Result:
    """Table 3.3 and figures 3.10, 3.13, 3.14: SoC error of the scheme of figure 3.10, from 98 to 90 %."""
    rows = []
    for method in METHODS:
        rows += _soc_rows(method, NARROW, SOC_PERCENT[method], _SOC if method == METHODS[0] else "")
    here = case()
    t, found = here.log.time_s, {m: run(m, True) for m in METHODS}
    soc = [Series(t, 100 * f.soc.soc, m.upper()) for m, f in found.items()]
    soc.append(Series(t, 100 * here.truth, "truth", "dashed", "reference"))
    wrong = [Series(t, _soc_error(f, here.truth), m.upper()) for m, f in found.items()]
    drawn = (
        Figure("State of charge", TIME, "State of charge [%]", soc),
        Figure("Its error", TIME, "Error [%]", wrong),
    )
    return Result(tuple(rows), drawn)


def _soc_rows(method: str, soc: tuple[float, float], printed: Errors | None, why: str) -> list[ResultRow]:
    by = {}
    for jumps in (False, True):
        by[jumps] = [errors(_soc_error(run(method, jumps, soc, seed), case(soc, seed).truth)) for seed in SEEDS]
    default = [errors(100.0 * (default_run(soc, seed).soc - case(soc, seed).truth)) for seed in SEEDS]
    what = f"SoC, {100 * soc[0]:g} to {100 * soc[1]:g} %, {method.upper()}"
    return _mean_rows(what, "%", printed, by[False], by[True], default, why)


_WHOLE = "[T] shows 98 to 90 % only, where a straight line is a good open-circuit voltage"


def whole_range() -> Result:
    """The same over the whole range, which [T] does not show."""
    rows = []
    for method in METHODS:
        rows += _soc_rows(method, WHOLE, None, _WHOLE if method == METHODS[0] else "")
    here = case(WHOLE)
    t = here.log.time_s
    lines = [Series(t, _soc_error(run(m, True, WHOLE), here.truth), m.upper()) for m in METHODS]
    lines.append(Series(t, 100 * (default_run(WHOLE).soc - here.truth), "default", role="estimate"))
    return Result(tuple(rows), (Figure("Error of the state of charge", TIME, "Error [%]", lines),))
