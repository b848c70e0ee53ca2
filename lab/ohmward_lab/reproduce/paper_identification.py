"""Figures 3 and 5 to 8 of [P] and its 75 % rule: the pulse test, its relaxations, the fit, the open-circuit voltage."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ohmward.battery.identification.rc_rule import find_response, find_time_constant, outside_long_charges
from ohmward.battery.identification.relaxation import Relaxation
from ohmward.battery.models.rc_elements import circuit_by_rule
from ohmward.battery.models.thevenin import Thevenin
from ohmward.figures.battery import current_figure, edge_response_figure, ocv_figure, relaxation_figure, voltage_figure
from ohmward.logs.log import Log
from ohmward.report import TIME, Figure, Series
from ohmward_lab.reproduce.paper_runs import NAMES, PaperCase, case, thevenin_of
from ohmward_lab.reproduce.row import Result, ResultRow
from ohmward_lab.simulate.plant import resting_state, simulate
from ohmward_lab.simulate.profile import steps
from ohmward_lab.simulate.robot_day import record
from ohmward_lab.simulate.sensors import low_cost_sensors, on_the_bench
from ohmward_lab.simulate.voltage import simulate_voltage

CHEMISTRIES = ("lead-acid", "lfp")
#: [P] reads its time constant from the first 500 ms after an edge: a log of 100 Hz has fifty samples there.
_FAST_S = 0.01
#: State of charge of the fast pulse.
_FAST_SOC = 0.8
#: The rule of [P] 2.2: shares of R_total that R_b = R_s and R_t have.
_SHARES = (0.75, 0.625)
_TWO = "[P] shows pictures, in which one time constant misses the rest's beginning and two do not"
#: A shorter rest follows a pulse, which does not fill the slow pair.
_LONG_REST_S = 600.0
_FAST_WHY = (
    "the rule is a choice of shares, so that they come out exactly. The mean circuit of this battery has no relaxation "
    "as fast as 500 ms, so the time constant there is that of the start of a slower one"
)


def pulse_test() -> Result:
    """Figure 3: the pulse test; the 75 % rule and C_s from the first 500 ms of a pulse at 100 Hz."""
    rows, figures = [], []
    for chemistry in CHEMISTRIES:
        here = case(chemistry)
        samples = outside_long_charges(fast_pulse(here), here.battery.capacity_Ah)
        response = find_response(samples, here.battery.capacity_Ah)
        tau = find_time_constant(response)
        by_rule = circuit_by_rule(response.r_total_ohm, tau.tau_s, here.rule.c_bulk_F + here.rule.c_surface_F)
        shares = by_rule.r_bulk_ohm / response.r_total_ohm, by_rule.r_terminal_ohm / response.r_total_ohm
        name = NAMES[chemistry]
        true_ohm = _true_step_ohm(here)
        rows += [
            ResultRow(f"{name}: R_b / R_total", "", _SHARES[0], shares[0], shares[0], None, _FAST_WHY),
            ResultRow(f"{name}: R_t / R_total", "", _SHARES[1], shares[1], shares[1]),
            ResultRow(
                f"{name}: R_total, at 100 Hz (default: true step)", "mohm", None, *_mohm(response.r_total_ohm, true_ohm)
            ),
            ResultRow(f"{name}: tau of the first 500 ms", "s", None, tau.tau_s, tau.tau_s),
            ResultRow(f"{name}: C_s = tau / (2 R_s)", "F", None, by_rule.c_surface_F, by_rule.c_surface_F),
        ]
        log = here.recording.bench
        figures += [current_figure(log), voltage_figure(log), edge_response_figure(response, {"rule": here.rule})]
    return Result(tuple(rows), tuple(figures))


def _mohm(found_ohm: float, true_ohm: float) -> tuple[float, float, float]:
    return 1e3 * found_ohm, 1e3 * found_ohm, 1e3 * true_ohm


def fast_pulse(here: PaperCase) -> Log:
    """A discharge of 1 C for ten seconds, recorded at 100 Hz by the sensors on the bench."""
    battery = here.recording.battery
    profile = steps([(60.0, 0.0), (10.0, -battery.circuit.capacity_Ah), (60.0, 0.0)])
    times = np.arange(0.0, profile.time_s[-1], _FAST_S)
    rng = np.random.default_rng(0)
    simulation = simulate(battery, profile, times, resting_state(battery, _FAST_SOC), max_step_s=_FAST_S)
    return record(battery, "pulse at 100 Hz", simulation, on_the_bench(low_cost_sensors(rng)), rng)


def _true_step_ohm(here: PaperCase) -> float:
    """Resistance [ohm] that a step of 1 C sees at once: the ohmic one and charge transfer."""
    battery = here.recording.battery
    circuit, current_A = battery.circuit, battery.circuit.capacity_Ah
    grid = np.linspace(0.0, 1.0, len(circuit.r0_discharge_ohm))
    transfer_V = battery.transfer_V * np.arcsinh(current_A / battery.exchange_A)
    return float(np.interp(_FAST_SOC, grid, circuit.r0_discharge_ohm) + transfer_V / current_A)


def relaxations() -> Result:
    """Figures 5 and 6: each rest with one and with two time constants."""
    rows, figures = [], []
    for chemistry in CHEMISTRIES:
        rests = rests_of(case(chemistry))
        single, double = (1e3 * float(np.mean([getattr(r, n).rms_V for r in rests])) for n in ("single", "double"))
        chosen = float(np.mean([r.pairs == 2 for r in rests]))
        name = NAMES[chemistry]
        rows += [
            ResultRow(f"{name}: one time constant, RMS of {len(rests)} rests", "mV", None, single, single),
            ResultRow(f"{name}: two time constants, RMS", "mV", None, double, double, None, _TWO),
            ResultRow(
                f"{name}: rests for which Akaike's criterion takes two", "%", None, None, 100 * chosen, 100 * chosen
            ),
        ]
        figures.append(relaxation_figure(rests[len(rests) // 2]))
    return Result(tuple(rows), tuple(figures))


def rests_of(here: PaperCase) -> list[Relaxation]:
    """Rests of the pulse test, with their fits."""
    return [rest for log in here.found.logs for rest in log.relaxations]


def fit() -> Result:
    """Figure 7: the voltage of the circuit before and after the nonlinear fit."""
    rows, figures = [], []
    for chemistry in CHEMISTRIES:
        here = case(chemistry)
        log, after = here.recording.bench, thevenin_of(here.found)
        voltages = {
            "before": simulate_voltage(first_circuit(here), log, 1.0).voltage_V,
            "after": simulate_voltage(after, log, 1.0, hysteresis=1.0).voltage_V,
        }
        rms = {name: 1e3 * float(np.sqrt(np.nanmean((v - log.voltage_V) ** 2))) for name, v in voltages.items()}
        name = NAMES[chemistry]
        why = (
            "[P] shows pictures; before: medians of edges and relaxations, after: variable projection on the whole test"
        )
        rows.append(
            ResultRow(f"{name}: before the nonlinear fit, RMS", "mV", None, rms["before"], rms["before"], None, why)
        )
        rows.append(ResultRow(f"{name}: after it, RMS", "mV", None, rms["after"], rms["after"], rms["after"]))
        figures.append(_before_and_after(name, log, voltages))
    return Result(tuple(rows), tuple(figures))


def first_circuit(here: PaperCase) -> Thevenin:
    """The circuit as edges and relaxations show it, one value each for all states of charge ([P] 2.3, first stage)."""
    after = thevenin_of(here.found)
    rests = [rest for rest in rests_of(here) if rest.time_s[-1] > _LONG_REST_S and rest.before_A != 0.0]
    tau_s = tuple(float(t) for t in np.median([r.double.tau_s for r in rests], axis=0))
    pair_ohm = np.median([np.abs(r.double.amplitude_V) / abs(r.before_A) for r in rests], axis=0)
    r0 = float(np.median([e.resistance_ohm for log in here.found.logs for e in log.edges]))
    grid = len(after.r0_discharge_ohm)
    flat = tuple((float(r),) * grid for r in pair_ohm)
    return replace(after, r0_discharge_ohm=(r0,) * grid, r0_charge_ohm=(r0,) * grid, r_ohm=flat, tau_s=tau_s)


def _before_and_after(name: str, log: Log, voltages: dict[str, np.ndarray]) -> Figure:
    series = [
        Series(log.time_s, log.voltage_V, "measured", role="background"),
        Series(log.time_s, voltages["before"], "before", role="comparison"),
        Series(log.time_s, voltages["after"], "after", role="estimate"),
    ]
    return Figure(f"{name}: before and after the fit", TIME, "Voltage [V]", series)


_OCV_WHY = (
    "[P] has no truth to compare with. Over the range of the pulse test, mean of both branches: rests of an hour after "
    "discharges still have the hysteresis of LFP and the slow polarisation of lead-acid in them"
)
#: [P] 4.2: ends of the two flat parts of the LFP curve, and the rise of the voltage over each [V].
_PLATEAUS = ((0.75, 0.98, 0.024), (0.25, 0.65, 0.2))
_PLATEAU_WHY = (
    "`default` is the simulated battery itself. The pulse test has points 9 % of the charge apart and begins at full, "
    "where the curve is steep, so that its curve is off at the upper end of the upper flat part; for the lower one [P] "
    "prints that the rise is below 0.2 V"
)


def open_circuit() -> Result:
    """Figure 8: the open-circuit voltage from the rests of the pulse test, against the curve that was simulated."""
    rows, figures = [], []
    for chemistry in CHEMISTRIES:
        here = case(chemistry)
        curves = thevenin_of(here.found).ocv, here.recording.battery.circuit.ocv
        soc = np.linspace(here.recording.bench.extra["soc_true"][-1], 1.0, 91)
        found_V, true_V = (ocv.mean_V(soc, ocv.reference_degC) for ocv in curves)
        rms = 1e3 * float(np.sqrt(np.mean((found_V - true_V) ** 2)))
        rows.append(ResultRow(f"{NAMES[chemistry]}: error of the curve, RMS", "mV", None, rms, rms, rms, _OCV_WHY))
        if chemistry == "lfp":
            for low, high, printed_V in _PLATEAUS:
                found, true = (
                    float(np.diff(ocv.mean_V(np.array([low, high]), ocv.reference_degC))[0]) for ocv in curves
                )
                what = f"{NAMES[chemistry]}: rise of the curve, {low:.0%} to {high:.0%}"
                rows.append(ResultRow(what, "V", printed_V, found, found, true, _PLATEAU_WHY))
        rests = [point for log in here.found.logs for point in log.rests]
        figures.append(ocv_figure(curves[0], rests=rests))
    return Result(tuple(rows), tuple(figures))
