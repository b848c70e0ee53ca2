"""The RC model from a log: the rule of [P] 2.2 first, then least squares on the whole log."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ohmward.battery import rc
from ohmward.battery.ocv import OcvCurve
from ohmward.battery.rc import RcModel
from ohmward.battery.rc_fit import VoltageFit, circuit_of, fit_voltage
from ohmward.battery.rc_rule import FIRST_S, Response, TimeConstant, circuit_by_rule, find_response, find_time_constant
from ohmward.battery.rc_samples import samples_of
from ohmward.logs.log import Log

_LEAST_SOC_RANGE = 0.05


class RcIdentification(NamedTuple):
    """The model, how it was found, and what the log could not tell.

    model: the result; `fit` turned into elements, or `rule` where the fit was not possible.
    rule: by [P]'s rule alone.
    response: at the edges.
    fit: least squares on the whole log; None where it was not possible.
    notes: how it was done.
    not_identified: what could not be identified, and why.
    """

    model: RcModel
    rule: RcModel
    response: Response
    fit: VoltageFit | None
    notes: tuple[str, ...]
    not_identified: tuple[str, ...]


def identify_rc(log: Log, ocv: OcvCurve, capacity_Ah: float) -> RcIdentification:
    """The RC model of the battery in the log.

    log: pulses or a drive, > 0 charges; the longer and the more of the SoC range, the better.
    ocv: open-circuit voltage of the same battery.
    capacity_Ah: charge between full and empty.

    Raises:
        InputError: the log has no edge of current, or no current at all, or the curve does not rise.
    """
    total_F = rc.capacitance_for(capacity_Ah, ocv)
    samples = samples_of(log)
    response = find_response(samples, capacity_Ah)
    tau = find_time_constant(response)
    rule = RcModel(*circuit_by_rule(response.r_total_ohm, tau.tau_s, total_F), ocv, capacity_Ah)
    soc_range = float(np.ptp(samples.charge_As)) / rule.capacity_As
    fit = fit_voltage(samples, None if soc_range > _LEAST_SOC_RANGE else total_F)
    model = rule if fit is None else RcModel(*circuit_of(fit), ocv, capacity_Ah)
    notes = (*_response_notes(response), *_fit_notes(fit, soc_range, total_F))
    return RcIdentification(model, rule, response, fit, notes, _missing(response, tau, fit, soc_range))


def _response_notes(response: Response) -> tuple[str, ...]:
    first = f"R_total = {1e3 * response.r_total_ohm:.3g} mohm from {response.edges} edges, seen after "
    notes = [f"{first}{response.delay_s:g} s (what relaxes within is in it)"]
    if response.window_s > FIRST_S:
        notes.append(
            f"the sampling is too slow for the first {1e3 * FIRST_S:g} ms after an edge; the time constant was sought "
            f"in the first {response.window_s:g} s"
        )
    return tuple(notes)


def _fit_notes(fit: VoltageFit | None, soc_range: float, total_F: float) -> tuple[str, ...]:
    if fit is None:
        return ()
    text = f"least squares leave {1e3 * fit.rms_V:.3g} mV (rms)"
    if soc_range > _LEAST_SOC_RANGE:
        text += f"; C_b + C_s = {fit.capacitance_F:.4g} F there, {total_F:.4g} F by the ends of the OCV curve"
    return (text,)


def _missing(response: Response, tau: TimeConstant, fit: VoltageFit | None, soc_range: float) -> tuple[str, ...]:
    sentences = ["R_t apart from R_b and R_s: the voltage shows four numbers of the five; R_b = R_s was assumed first"]
    if not tau.found:
        sentences.append(f"tau by the rule: no exponential in the first {response.window_s:g} s after the edges")
    if fit is None:
        sentences.append("the whole log: its voltage does not rise with charge and current; the rule alone was used")
    elif fit.r1_ohm == 0.0:
        sentences.append("the relaxation: the log shows no exponential beside R_0 and the open-circuit voltage")
    if soc_range <= _LEAST_SOC_RANGE:
        sentences.append(f"C_b + C_s: the log moves SoC by {100 * soc_range:.2g} % only; the OCV curve's was used")
    return tuple(sentences)
