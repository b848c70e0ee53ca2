"""Tables 3.1 to 3.3 and figures 3.6 to 3.15 of [T]: voltage, parameters and state of charge by four filters.

The pack of [T] is driven by joystick, and the filters of its chapter 3 run along the drive.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.identification.identify import identify
from ohmward.battery.soc.estimator import SocEstimator, SocRun, samples_of
from ohmward.battery.soc.sample import SocSample
from ohmward.figures.battery import current_figure, voltage_figure
from ohmward.logs.log import Log
from ohmward.report import TIME, Figure, Series
from ohmward.trace import Kernel
from ohmward_lab.published import rc, rc_circuit
from ohmward_lab.published.rc_identification import RcIdentification, identify_rc
from ohmward_lab.published.scheme_by_method import METHODS, SchemeByMethod, SchemeByMethodEstimate
from ohmward_lab.reproduce.batteries import joystick_drive
from ohmward_lab.reproduce.row import Errors, Result, ResultRow, error_rows, errors, mean_errors
from ohmward_lab.simulate.cells import lithium_polymer_pack

#: Seeds, each with another drive and other noise; figures show the first.
SEEDS = (1, 2, 3)
#: [T] 3.4: from 98 to 90 %; and the whole range, which [T] does not show.
NARROW, WHOLE = (0.98, 0.90), (0.98, 0.10)
FIRST = NARROW, SEEDS[0]
#: Standard deviation of the initial state of charge that the filters are given.
START_STD = 0.005
#: Step [V] of an oscilloscope of 8 bit over the pack's largest voltage ([T] 3.3.5).
_SCOPE_V = 42.0 / 256


class ThesisCase(NamedTuple):
    """The pack on its drive, the battery that the default estimator has, and the RC model found offline."""

    log: Log  #: the drive
    truth: np.ndarray  #: state of charge (T,)
    battery: Battery
    offline: RcIdentification


@cache
def case(soc: tuple[float, float], seed: int) -> ThesisCase:
    """The pack, tested, identified and driven."""
    recording = joystick_drive(lithium_polymer_pack(), soc, seed)
    pack = recording.battery
    capacity_Ah = pack.circuit.capacity_Ah
    battery = identify(recording.bench, capacity_Ah=capacity_Ah, chemistry=pack.chemistry, n_series=pack.n_series)
    offline = identify_rc(recording.bench, battery.thevenin.ocv, capacity_Ah, 1.0)
    return ThesisCase(recording.drive, recording.truth, battery, offline)


@cache
def run(method: str, corrected: bool, soc: tuple[float, float], seed: int) -> SchemeByMethodEstimate:
    """The scheme of figure 3.10 along the drive, both stages by this method, (T,) each."""
    here = case(soc, seed)
    return run_along(here.log, here.offline.rule, method, corrected, soc[0])


def run_along(log: Log, model: rc.RcModel, method: str, corrected: bool, start_soc: float) -> SchemeByMethodEstimate:
    """The scheme along any log, from a model found offline and the first voltage; gaps in the voltage are predicted."""
    scheme = SchemeByMethod(model, method, corrected)
    samples = samples_of(log)
    first = SocSample(0.0, *(float(column[0]) for column in samples[1:]))
    first = first._replace(voltage_V=float(log.voltage_V[np.isfinite(log.voltage_V)][0]))
    start = scheme.init(first, start_soc, START_STD)
    return Kernel(scheme.step, start, first).scan(start, samples)[1]


@cache
def default_run(soc: tuple[float, float], seed: int) -> SocRun:
    """The default estimator along the drive, from the same start."""
    here = case(soc, seed)
    return SocEstimator(here.battery, initial_soc=soc[0], initial_soc_std=START_STD).run(here.log)


def offline_voltage(here: ThesisCase, model: rc.RcModel) -> np.ndarray:
    """Voltage (T,) of a circuit that is never corrected, from rest at the right state of charge."""

    class Moved(NamedTuple):
        x: np.ndarray
        current_A: float

    def step(state: Moved, sample: SocSample) -> tuple[Moved, np.ndarray]:
        x = rc_circuit.next_state(state.x, 0.5 * (state.current_A + sample.current_A), model, sample.dt_s)
        return Moved(x, sample.current_A), rc_circuit.voltage(x, sample.current_A, model)

    samples = samples_of(here.log)
    first = SocSample(0.0, *(float(column[0]) for column in samples[1:]))
    start = Moved(rc_circuit.at_rest(model, float(here.truth[0])), first.current_A)
    return Kernel(step, start, first).scan(start, samples)[1][:, 0]


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
#: Time [s] after which the filters have recovered from their initial parameters.
_START_FOUND_S = 100.0

_BEFORE = (
    "P0, Q0, R0, alpha, beta and L are those of (3.51). `as printed` has the circuit (3.6) as it is printed, with "
    "di/dt = 0 and nothing that bounds the parameters, but the misprints of the filter itself corrected, with which no "
    "number can come out: the sigma points of UKF and AUKF have negative capacitances, and they end in nan; EKF and "
    "AEKF explain each jump of the voltage by wrong parameters. `corrected` has the corrected circuit in exact steps, "
    "its parameters within a factor of ten of the offline ones"
)
_AFTER = (
    "the printed 0.002 V must be an error after the sample: with R0 = 0.1 V^2 beside 0.9 V^2 of Q0 its voltage is "
    "nearly the sample itself. Before it no filter can be better than the sensor's noise (2 mV here, 1.6 mV in the "
    "mean), nor than the steps of [T]'s oscilloscope, 0.16 V on 42 V at the usual 8 bit. So it shows how closely the "
    "filter follows its sensor, not how well it knows the battery: an EKF with the same Q0 and R0 is as close"
)
_SCOPE = "the same drives with a voltage in the 256 steps of 0.164 V that an 8 bit oscilloscope has over 42 V"
_OFFLINE = "another battery; `as printed` by the 75 % rule, `corrected` by least squares on the whole pulse test"
_SOC = (
    "both stages of figure 3.10 by each method. [T] prints no constants of the second stage: here its R0 is that of "
    "(3.51), and the SoC starts right, give or take 0.5 %. With a start ten times as sure the errors of EKF and UKF "
    "fall to a third, those of the adaptive two hardly, and the UKF is before the AUKF: the order depends on a "
    "constant that is not printed. With (3.51) the parameters wander from step to step and take the SoC along; a "
    "count would be better. `as printed`: parameters that may be negative, and a second stage whose frozen partner "
    "loses charge"
)
_SOC_ORDER = (
    "the second stage is linear, so that EKF and UKF differ by their parameters alone: the EKF's, which start right, "
    "hardly move, and no other method is as good here"
)


_VARIANCE = (
    "[T] shows its covariance in a picture, without a number, as a proof of the AUKF. It is what a filter says of its "
    "own error: matched by its residuals it is small after any sample that the filter has followed"
)
#: Pairs of methods of which the first is nearer to the truth in [T].
_ORDERS = (("aukf", "ukf"), ("aekf", "ekf"), ("aukf", "aekf"), ("aekf", "ukf"), ("ukf", "ekf"))
_Series = Callable[[SchemeByMethodEstimate, ThesisCase], np.ndarray]
#: Errors of the voltage, by when they are taken.
_VOLTAGE_ERROR: dict[str, _Series] = {"before": lambda f, _: f.innovation_V, "after": lambda f, _: f.residual_V}


def offline_and_updated() -> Result:
    """Table 3.1 and figures 3.6 to 3.9: the model found offline against the one that is updated along the drive."""
    by_rule, by_fit, updated, printed, default = [], [], [], [], []
    for seed in SEEDS:
        here = case(NARROW, seed)
        measured_V = here.log.voltage_V
        by_rule.append(errors(measured_V - offline_voltage(here, here.offline.rule)))
        by_fit.append(errors(measured_V - offline_voltage(here, here.offline.model)))
        printed.append(errors(run("aukf", False, NARROW, seed).innovation_V))
        updated.append(errors(run("aukf", True, NARROW, seed).innovation_V))
        default.append(errors(_expected_error(here, seed)))
    rows = [
        *error_rows("Voltage, offline model", "V", OFFLINE_V, by_rule, by_fit, default, _OFFLINE),
        *error_rows("Voltage, model updated by AUKF", "V", VOLTAGE_V["aukf"], printed, updated, default, _BEFORE),
    ]
    here, found = case(*FIRST), run("aukf", True, *FIRST)
    drawn = (current_figure(here.log), voltage_figure(here.log), *_parameter_figures(here, found))
    return Result(tuple(rows), drawn)


def _expected_error(here: ThesisCase, seed: int) -> np.ndarray:
    """Measured voltage less the one that the default estimator expects (T - 1,)."""
    return (here.log.voltage_V - default_run(NARROW, seed).voltage_V)[1:]


def _parameter_figures(here: ThesisCase, found: SchemeByMethodEstimate) -> list[Figure]:
    """Figure 3.7: the four parameters over time."""
    p, t = found.circuit, here.log.time_s
    named = {
        "C_b [kF]": 1e-3 * p.c_bulk_F,
        "C_s [F]": p.c_surface_F,
        "R_e [mΩ]": 1e3 * p.r_bulk_ohm,
        "R_t [mΩ]": 1e3 * p.r_terminal_ohm,
    }
    return [
        Figure(f"{name.split()[0]} by AUKF", TIME, name, [Series(t, y, "AUKF", role="estimate")], height_px=140)
        for name, y in named.items()
    ]


def voltage_by_method() -> Result:
    """Table 3.2 and figures 3.11, 3.12: voltage error and covariance of EKF, AEKF, UKF and AUKF."""
    rows = []
    default = [errors(_expected_error(case(NARROW, seed), seed)) for seed in SEEDS]
    for method in METHODS:
        for when, of in _VOLTAGE_ERROR.items():
            rows += error_rows(
                f"Voltage {when} the sample, {method.upper()}",
                "V",
                VOLTAGE_V[method],
                [errors(of(run(method, False, NARROW, seed), case(NARROW, seed))) for seed in SEEDS],
                [errors(of(run(method, True, NARROW, seed), case(NARROW, seed))) for seed in SEEDS],
                default if when == "before" else [],
                _BEFORE if when == "before" else _AFTER,
            )
    scoped = []
    for here in (case(NARROW, seed) for seed in SEEDS):
        log = replace(here.log, voltage_V=_SCOPE_V * np.round(here.log.voltage_V / _SCOPE_V))
        scoped.append(run_along(log, here.offline.rule, "aukf", True, NARROW[0]))
    for when, found in (("before", [f.innovation_V for f in scoped]), ("after", [f.residual_V for f in scoped])):
        mean = mean_errors([errors(error) for error in found]).mean
        rows.append(
            ResultRow(f"Voltage {when} the sample, AUKF, 8 bit oscilloscope: mean", "V", 0.002, None, mean, why=_SCOPE)
        )
    for when, of in _VOLTAGE_ERROR.items():
        rows += _order(of, f"voltage {when} the sample")
    rows += _variance_rows("Standard deviation of the voltage", "mV", _voltage_std_mV, _VARIANCE)
    return Result(tuple(rows), _method_figures())


def _variance_rows(what: str, unit: str, of: _Series, why: str) -> list[ResultRow]:
    """Standard deviation that each method reports, the mean along the drives."""
    rows = []
    for method in METHODS:
        printed, corrected = (
            float(np.mean([of(run(method, right, NARROW, seed), case(NARROW, seed)).mean() for seed in SEEDS]))
            for right in (False, True)
        )
        rows.append(ResultRow(f"{what} by {method.upper()} itself", unit, None, printed, corrected, None, why))
    return rows


def _voltage_std_mV(found: SchemeByMethodEstimate, here: ThesisCase) -> np.ndarray:
    return 1e3 * _root(found.voltage_variance_V2)


def _soc_std(found: SchemeByMethodEstimate, here: ThesisCase) -> np.ndarray:
    return 100.0 * _root(found.soc_variance)


def _root(variance: np.ndarray) -> np.ndarray:
    """Standard deviation; nan where a filter that diverges has a negative variance."""
    return np.sqrt(np.where(variance >= 0.0, variance, np.nan))


def _soc_error(found: SchemeByMethodEstimate, here: ThesisCase) -> np.ndarray:
    return 100.0 * (found.soc - here.truth)


def _order(of: _Series, what: str, why: str = "") -> list[ResultRow]:
    """Shares of the drives in which one method has the smaller mean error, once both have recovered from the start."""
    rows = []
    for better, worse in _ORDERS:
        wins = []
        for seed in SEEDS:
            here = case(NARROW, seed)
            late = here.log.time_s >= _START_FOUND_S
            one, other = (np.abs(of(run(m, True, NARROW, seed), here))[late].mean() for m in (better, worse))
            wins.append(one < other)
        name = f"{better.upper()} < {worse.upper()} in {what}, mean after {_START_FOUND_S:g} s, share of drives"
        rows.append(ResultRow(name, "%", 100.0, None, 100.0 * float(np.mean(wins)), None, why))
    return rows


def _method_figures() -> tuple[Figure, ...]:
    t = case(*FIRST).log.time_s
    found = {m: run(m, True, *FIRST) for m in METHODS}
    innovation = [Series(t, 1e3 * f.innovation_V, m.upper()) for m, f in found.items()]
    stds = [Series(t, _voltage_std_mV(f, case(*FIRST)), m.upper()) for m, f in found.items()]
    return (
        Figure("Voltage error before the sample", TIME, "Error [mV]", innovation),
        Figure("Standard deviation of the voltage", TIME, "sigma [mV]", stds),
    )


def soc_by_method() -> Result:
    """Table 3.3 and figures 3.10, 3.13 to 3.15: SoC error of the scheme of figure 3.10, from 98 to 90 %."""
    rows = []
    for method in METHODS:
        rows += _soc_rows(method, NARROW, SOC_PERCENT[method], _SOC if method == METHODS[0] else "")

    rows += _order(_soc_error, "SoC", _SOC_ORDER)
    rows += _variance_rows("Standard deviation of SoC", "%", _soc_std, _VARIANCE)
    here = case(*FIRST)
    t, found = here.log.time_s, {m: run(m, True, *FIRST) for m in METHODS}
    soc = [Series(t, 100 * f.soc, m.upper()) for m, f in found.items()]
    soc.append(Series(t, 100 * here.truth, "truth", "dashed", "reference"))
    wrong = [Series(t, _soc_error(f, here), m.upper()) for m, f in found.items()]
    stds = [Series(t, _soc_std(f, here), m.upper()) for m, f in found.items()]
    drawn = (
        Figure("State of charge", TIME, "State of charge [%]", soc),
        Figure("Its error", TIME, "Error [%]", wrong),
        Figure("Its standard deviation", TIME, "sigma [%]", stds),
    )
    return Result(tuple(rows), drawn)


def _soc_rows(method: str, soc: tuple[float, float], printed: Errors | None, why: str) -> list[ResultRow]:
    by = {}
    for corrected in (False, True):
        by[corrected] = [errors(_soc_error(run(method, corrected, soc, seed), case(soc, seed))) for seed in SEEDS]
    default = [errors(100.0 * (default_run(soc, seed).soc - case(soc, seed).truth)) for seed in SEEDS]
    what = f"SoC, {100 * soc[0]:g} to {100 * soc[1]:g} %, {method.upper()}"
    return error_rows(what, "%", printed, by[False], by[True], default, why)


_WHOLE = "[T] shows 98 to 90 % only, where a straight line is a good open-circuit voltage"


def whole_range() -> Result:
    """SoC error of the scheme over the whole range, which [T] does not show."""
    rows = []
    for method in METHODS:
        rows += _soc_rows(method, WHOLE, None, _WHOLE if method == METHODS[0] else "")
    here = case(WHOLE, SEEDS[0])
    t = here.log.time_s
    lines = [Series(t, _soc_error(run(m, True, WHOLE, SEEDS[0]), here), m.upper()) for m in METHODS]
    lines.append(Series(t, 100 * (default_run(WHOLE, SEEDS[0]).soc - here.truth), "default", role="estimate"))
    return Result(tuple(rows), (Figure("Error of the state of charge", TIME, "Error [%]", lines),))
