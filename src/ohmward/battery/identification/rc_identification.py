"""Identification of the RC model from a log: the rule of [P] 2.2 first, then least squares on the whole log."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ohmward.battery.chemistries import CELL_V, chemistry_prior
from ohmward.battery.identification.rc_fit import (
    LONGEST_TAU_S,
    VoltageFit,
    charge_in_part,
    fit_voltage,
    voltage_fit,
)
from ohmward.battery.identification.rc_rule import (
    FIRST_S,
    EdgeResponse,
    RcSamples,
    TimeConstant,
    find_response,
    find_time_constant,
    outside_long_charges,
)
from ohmward.battery.identification.record import Record
from ohmward.battery.identification.soc_axis import SocAxis
from ohmward.battery.models import rc
from ohmward.battery.models.noise import BatteryNoise
from ohmward.battery.models.ocv import OcvCurve
from ohmward.battery.models.rc import RcModel
from ohmward.battery.models.rc_elements import circuit_by_rule, circuit_of
from ohmward.battery.models.temperature import ROOM_DEGC, arrhenius_factor
from ohmward.errors import InputError
from ohmward.logs.log import SECONDS_PER_HOUR, Log

#: A log that moves SoC by less does not show the slope of its open-circuit voltage.
_LEAST_SOC_RANGE = 0.05
#: Without a curve a relaxation is looked for that lasts until SoC has moved by so much at the current of the log: a
#: slower one cannot be told from a bend of the open-circuit voltage (a DST on NMC: 893 s and ten times the R_1).
_STRAIGHT_SOC = 0.02
#: A time constant so close to the longest one is that which the search allows, not that of the battery.
_AT_LIMIT = 0.95
#: A voltage seen later after an edge is not that of the edge [s]; [P] fits the time constant to the first 500 ms.
_SLOW_DELAY_S = 10.0
#: No sensor is better, whatever a short log shows.
_LEAST_VOLTAGE_STD_V = 0.001
#: Two estimates of the resistances may agree by chance.
_CHANCE_STD = 0.05
#: A straight line errs in long bows.
_MODEL_SOC_LENGTH = 0.3
#: Points of SoC on which the model error stands.
_SOC_POINTS = 11
#: Relative error of the slope of a straight line beyond the part that it was laid through: the slope of the curves of
#: NCA, NMC and LCO between 20 and 60 % is 0.8, 0.6 and 0.4 of that between 60 and 100 %.
_SLOPE_STD = 0.3
#: Median of the absolute value of a standard normal number.
_MEDIAN_OF_NORMAL = 0.6745


class RcIdentification(NamedTuple):
    """The RC model, the way to it, and the parameters that the log does not show."""

    model: RcModel  #: the result; `fit` turned into elements, or `rule` where the fit was not possible
    noise: BatteryNoise  #: what a filter on this model should assume: voltage noise, and model error along SoC
    rule: RcModel  #: by [P]'s rule alone
    rule_rms_V: float  #: root mean square of the error that the rule's circuit leaves on the whole log
    response: EdgeResponse  #: of the voltage to the edges of the current
    tau: TimeConstant  #: time constant by the rule
    fit: VoltageFit | None  #: least squares on the whole log; None where it was not possible
    notes: tuple[str, ...]  #: what was done
    not_identified: tuple[str, ...]  #: what could not be identified, and why


def rc_of_records(
    records: Sequence[Record], axes: Sequence[SocAxis], capacity_Ah: float, ocv: OcvCurve | None
) -> tuple[RcIdentification, Record, SocAxis]:
    """The RC model from the record that moves most charge, a low-rate test aside, and that record with its axis.

    ocv: None takes the straight line through the record.
    """
    moved_Ah = [float(np.abs(r.charge.moved_Ah).sum()) * (r.test != "low-rate") for r in records]
    most = int(np.argmax(moved_Ah))
    record, axis = records[most], axes[most]
    first_s = outside_long_charges(record.log, capacity_Ah).time_s[0]
    start_soc = float(np.interp(first_s, record.log.time_s, axis.soc))
    return identify_rc(record.log, ocv, capacity_Ah, start_soc), record, axis


def identify_rc(log: Log, ocv: OcvCurve | None, capacity_Ah: float, start_soc: float | None = None) -> RcIdentification:
    """The RC model of the battery in the log.

    log: pulses or a drive, > 0 charges; the longer and the more of the SoC range, the better.
    ocv: open-circuit voltage of the same battery; None takes the straight line that the log itself shows, which suits
        a linear model best where the battery is nearly linear, as lead-acid is.
    capacity_Ah: charge between full and empty.
    start_soc: state of charge at the first sample of the log outside long charges; None takes it from the curve.

    Raises:
        InputError: no edge of current in the log, no current at all, a curve that does not rise, or neither curve nor
            start_soc.
    """
    samples = outside_long_charges(log, capacity_Ah)
    response = find_response(samples, capacity_Ah)
    tau = find_time_constant(response)
    longest_tau_s = LONGEST_TAU_S if ocv else min(LONGEST_TAU_S, _straight_s(samples, capacity_Ah))
    fit: VoltageFit | None
    if ocv is None:
        fit, curve, start = _fit_with_line(samples, capacity_Ah, start_soc, longest_tau_s, _usual_degC(log))
        soc, ocv_V = _soc_along(samples, start, capacity_Ah), None
    else:
        curve = ocv
        soc = _soc_along(samples, _start_soc(samples, response, ocv, start_soc), capacity_Ah)
        ocv_V = ocv.mean_V(soc, ocv.reference_degC)
        fit = fit_voltage(samples, ocv_V)
    total_F = rc.capacitance_for(capacity_Ah, curve)
    rule = RcModel(*circuit_by_rule(response.r_total_ohm, tau.tau_s, total_F), curve, capacity_Ah)
    model = rule if fit is None else RcModel(*circuit_of(*fit.numbers), curve, capacity_Ah)
    line_slope_V = 0.0 if ocv else curve.voltage_V[-1] - curve.voltage_V[0]
    noise = BatteryNoise() if fit is None else _noise(fit, response, soc, line_slope_V)
    notes = (*_part_notes(samples, len(log)), *_response_notes(response), *_fit_notes(fit, total_F))
    rule_rms_V = voltage_fit(samples, ocv_V, rc.four_numbers(rule)).rms_V
    missing = _missing(response, tau, fit, (float(np.median(samples.dt_s[1:])), longest_tau_s))
    return RcIdentification(model, noise, rule, rule_rms_V, response, tau, fit, notes, missing)


def _usual_degC(log: Log) -> float:
    """Median temperature of the log [degC], room temperature where it has none."""
    known = np.empty(0) if log.temperature_degC is None else log.temperature_degC[np.isfinite(log.temperature_degC)]
    return float(np.median(known)) if known.size else ROOM_DEGC


def _straight_s(samples: RcSamples, capacity_Ah: float) -> float:
    """Time in which the root mean square of the current moves SoC by `_STRAIGHT_SOC` [s]."""
    rms_A = float(np.sqrt(np.mean(samples.current_A**2)))
    return _STRAIGHT_SOC * SECONDS_PER_HOUR * capacity_Ah / rms_A


def _fit_with_line(
    samples: RcSamples, capacity_Ah: float, start_soc: float | None, longest_tau_s: float, reference_degC: float
) -> tuple[VoltageFit, OcvCurve, np.ndarray]:
    """Least squares without a curve, the straight OCV line that it means, and the SoC at the start of each part."""
    if start_soc is None:
        raise InputError("identify_rc needs ocv, or start_soc to lay a straight line through the log; both are None")
    soc_range = float(np.ptp(charge_in_part(samples))) / (SECONDS_PER_HOUR * capacity_Ah)
    fit = fit_voltage(samples, None, longest_tau_s) if soc_range > _LEAST_SOC_RANGE else None
    if fit is None:
        raise InputError(
            f"ocv is None, and the log, which moves SoC by {100 * soc_range:.2g} %, does not show an open-circuit "
            "voltage that rises; give the battery's OCV curve"
        )
    slope_V = SECONDS_PER_HOUR * capacity_Ah / fit.capacitance_F
    empty_V = float(fit.start_V[0]) - start_soc * slope_V
    return fit, OcvCurve((empty_V, empty_V + slope_V), reference_degC=reference_degC), (fit.start_V - empty_V) / slope_V


def _start_soc(samples: RcSamples, response: EdgeResponse, ocv: OcvCurve, start_soc: float | None) -> np.ndarray:
    """SoC at the first sample of each part, from its voltage without the drop at R_total; `start_soc` for the first."""
    first = np.flatnonzero(np.diff(samples.part, prepend=-1) > 0)
    open_V = samples.voltage_V[first] - response.r_total_ohm * samples.current_A[first]
    soc = np.array([ocv.soc_at(v, ocv.reference_degC) for v in open_V.tolist()])
    return soc if start_soc is None else np.array([start_soc, *soc[1:]])


def _soc_along(samples: RcSamples, start: np.ndarray, capacity_Ah: float) -> np.ndarray:
    """SoC along the log (T,) from that at the start of each part."""
    return start[samples.part] + charge_in_part(samples) / (SECONDS_PER_HOUR * capacity_Ah)


def _noise(fit: VoltageFit, response: EdgeResponse, soc: np.ndarray, line_slope_V: float) -> BatteryNoise:
    """Noise to assume: residual from sample to sample and along SoC, and the difference of the two resistances.

    line_slope_V: slope of the straight line per unit of SoC, 0 where a curve is known.
    """
    white_V = float(np.median(np.abs(np.diff(fit.residual_V)))) / (_MEDIAN_OF_NORMAL * math.sqrt(2))
    resistance_std = max(_resistance_std(response, fit), _CHANCE_STD)
    return BatteryNoise(
        voltage_std_V=max(white_V, _LEAST_VOLTAGE_STD_V),
        model_std_V=_model_std_V(fit.residual_V, soc, line_slope_V),
        model_soc_length=_MODEL_SOC_LENGTH,
        overpotential_share=resistance_std,
        resistance_std=resistance_std,
    )


def _model_std_V(error_V: np.ndarray, soc: np.ndarray, line_slope_V: float) -> tuple[float, ...]:
    """Error of the model on a grid of SoC: root mean square, at least its median over the grid.

    The residual of a fit has zeros, and another log has them elsewhere; hence the median. The largest where there are
    no data, and more with the distance to them where a straight line stands for the curve.
    """
    nearest = np.clip(np.rint(soc * (_SOC_POINTS - 1)), 0, _SOC_POINTS - 1).astype(int)
    counts = np.bincount(nearest, minlength=_SOC_POINTS)
    rms_V = np.sqrt(np.bincount(nearest, error_V**2, _SOC_POINTS) / np.maximum(counts, 1))
    visited = counts > 0
    along_V = np.where(visited, np.maximum(rms_V, np.median(rms_V[visited])), rms_V.max())
    grid = np.linspace(0.0, 1.0, _SOC_POINTS)
    distance = np.maximum(np.maximum(grid - soc.max(), soc.min() - grid), 0.0)
    return tuple(np.hypot(along_V, _SLOPE_STD * line_slope_V * distance).tolist())


def _resistance_std(response: EdgeResponse, fit: VoltageFit) -> float:
    """Relative standard deviation of the resistances, from the difference between edges and least squares."""
    at_edges = response.r_total_ohm
    fitted = fit.r0_ohm + fit.r1_ohm * (1 - math.exp(-response.delay_s / fit.tau_s))
    return abs(at_edges - fitted) / (at_edges + fitted)


def _part_notes(samples: RcSamples, count: int) -> tuple[str, ...]:
    left_out = 1 - len(samples.time_s) / count
    if left_out == 0.0:
        return ()
    return (f"{100 * left_out:.2g} % of the samples left out: long charges or no voltage",)


def _response_notes(response: EdgeResponse) -> tuple[str, ...]:
    first = f"R_total = {1e3 * response.r_total_ohm:.3g} mohm from {response.edges} edges, seen after "
    notes = [f"{first}{response.delay_s:g} s (what relaxes within is in it)"]
    if response.window_s > FIRST_S:
        notes.append(
            f"the sampling is too slow for the first {1e3 * FIRST_S:g} ms after an edge; the time constant was sought "
            f"in the first {response.window_s:g} s"
        )
    return tuple(notes)


def _fit_notes(fit: VoltageFit | None, total_F: float) -> tuple[str, ...]:
    if fit is None:
        return ()
    return (
        f"least squares leave {1e3 * fit.rms_V:.3g} mV (rms); C_b + C_s = {fit.capacitance_F:.4g} F along the log, "
        f"{total_F:.4g} F by the ends of the OCV curve",
    )


def _missing(
    response: EdgeResponse, tau: TimeConstant, fit: VoltageFit | None, limits_s: tuple[float, float]
) -> tuple[str, ...]:
    """Sentences on what the log does not show; limits_s: usual time between samples, longest time constant sought."""
    step_s, longest_s = limits_s
    sentences = ["R_t apart from R_b and R_s: the voltage shows four numbers of the five; R_b = R_s was assumed first"]
    if response.delay_s > _SLOW_DELAY_S:
        sentences.append(
            f"R_total by the rule: the log shows the voltage only {response.delay_s:.0f} s after an edge, when it has "
            "relaxed and charge has flowed"
        )
    if not tau.found:
        sentences.append(f"tau by the rule: no exponential in the first {response.window_s:g} s after the edges")
    if fit is None:
        sentences.append("the whole log: its voltage does not rise with charge and current; the rule alone was used")
    elif fit.r1_ohm == 0.0:
        sentences.append("the relaxation: the log shows no exponential beside R_0 and the open-circuit voltage")
    elif fit.tau_s < step_s:
        sentences.append(f"the time constant: shorter than the {step_s:g} s between two samples, or none")
    elif fit.tau_s > _AT_LIMIT * longest_s:
        sentences.append(
            f"the time constant: {fit.tau_s:.0f} s is the longest that was looked for; slower ones are not told from "
            "the open-circuit voltage"
        )
    return tuple(sentences)


def with_activation(
    found: RcIdentification, activation_K: float, noise: BatteryNoise, record_degC: float | None
) -> RcIdentification:
    """The RC model with an activation and the noise that belongs to it; its resistances at the curve's temperature.

    noise: with the doubts of activation and open-circuit voltage.
    record_degC: temperature of the record that it was identified from; None where that is unknown.
    """
    reference_degC = found.model.ocv.reference_degC
    factor = 1.0 if record_degC is None else arrhenius_factor(record_degC, activation_K, reference_degC)
    names = ("r_bulk_ohm", "r_surface_ohm", "r_terminal_ohm")
    resistances = {name: getattr(found.model, name) / factor for name in names}
    model = replace(found.model, activation_K=activation_K, **resistances)
    own = replace(found.noise, activation_std_K=noise.activation_std_K, ocv_std_V_per_K=noise.ocv_std_V_per_K)
    return found._replace(model=model, noise=own)


def with_usual_activation(found: RcIdentification, chemistry: str, record_degC: float | None) -> RcIdentification:
    """As `with_activation`, with what is usual for the chemistry, "" where that is unknown; half ohmic, half pairs."""
    prior, volts = chemistry_prior(chemistry), float(np.mean(found.model.ocv.voltage_V)) / CELL_V
    activation_K = 0.5 * (prior.activation_K.mean + prior.pair_activation_K.mean)
    noise = BatteryNoise(activation_std_K=prior.activation_std_K, ocv_std_V_per_K=volts * prior.ocv_std_V_per_K)
    sentence = (
        f"activation of the resistances: {activation_K:.0f} ± {prior.activation_std_K:.0f} K was taken, as usual for "
        f"{chemistry or 'batteries'}"
    )
    usual = with_activation(found, activation_K, noise, record_degC)
    return usual._replace(not_identified=(*usual.not_identified, sentence))
