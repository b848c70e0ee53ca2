"""Identification of the RC model from a log: the rule of [P] 2.2 first, then least squares on the whole log.

By the rule, R_total is the sudden change of voltage over the change of current; R_b = R_s = 0.75 R_total, R_t =
R_total - R_b / 2; the time constant tau of an exponential through the first 500 ms after the edges gives C_s = tau /
(2 R_s).

A linear model does not follow a battery through a full charge: voltage limit, gassing, incomplete storage of the
charge, an open-circuit voltage above that of discharge. So long charges are left out; short ones, as in braking, stay.
The log between two long charges is a part, with an open-circuit voltage of its own at the start.

Least squares are linear except in one parameter. With s = C_s / (C_b + C_s) and D = R_b + R_s the terminal voltage of
the model is, exactly,

    V = V_start + q / C + R_1 F[i] + R_0 i

where q is the charge since the start, F a first-order filter of gain 1 and rate w, and

    C = C_b + C_s,   R_0 = R_t + R_b R_s / D,   R_1 = (R_b - s D)^2 / D,   w = 1 / (s (1 - s) C D) = 1 / tau.

Each part between two long charges has a V_start of its own. For a given w this is linear: one search in w finds the
best. A known OCV curve takes the place of V_start + q / C, so that its curvature is not mistaken for a slow
relaxation, and C is that of the straight line through the part of the curve that the log covers.
`rc.circuit_of` makes a circuit of the four numbers.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ohmward.battery.charge_count import count_charge, find_gaps, known_current_A
from ohmward.battery.identification.fit_samples import scan
from ohmward.battery.models.noise import BatteryNoise
from ohmward.battery.models.ocv import OcvCurve
from ohmward.battery.models.temperature import ROOM_DEGC
from ohmward.errors import InputError
from ohmward.logs.log import SECONDS_PER_HOUR, Log
from ohmward.optional import require
from ohmward_lab.published import rc_circuit
from ohmward_lab.published.rc import RcModel, circuit_by_rule, circuit_of

#: Currents below this rate neither charge nor discharge.
_ZERO_RATE = 1 / 200
#: A charge of more than this share of the capacity is long; braking never lasts that long.
_LONG_CHARGE = 0.05


#: Time after an edge in which [P] looks for the time constant [s].
FIRST_S = 0.5

#: Fewest samples of a window from which a time constant is identified.
_FEWEST_OF_A_WINDOW = 5
#: Smallest change of current that counts as an edge: C/20.
_EDGE_RATE = 1 / 20


class EdgeResponse(NamedTuple):
    """Response of the voltage to a change of current by one ampere, from all edges."""

    edges: int  #: their number
    r_total_ohm: float  #: resistance seen at once, or at the first sample after the edge (median)
    delay_s: float  #: time from the edge to that sample (median)
    window_s: float  #: length of the window after the edge: 0.5, or ten samples where the log is slower
    #: (K,) time since the first sample after an edge, and rise of the voltage since, of all edges
    time_s: np.ndarray
    rise_ohm: np.ndarray


class TimeConstant(NamedTuple):
    """Time constant of the exponential r (1 - e^(-t / tau)) through the rises after the edges."""

    tau_s: float  #: tau; the length of the window where none was identified
    found: bool  #: True where tau was identified


def find_response(samples: RcSamples, capacity_Ah: float) -> EdgeResponse:
    """Mean response of the voltage to the edges: changes of current by more than C/20 from one sample to the next.

    Raises:
        InputError: there is no such edge.
    """
    change_A = np.diff(samples.current_A)
    edges = np.flatnonzero((np.abs(change_A) > _EDGE_RATE * capacity_Ah) & ~samples.gap[1:])
    if not edges.size:
        raise InputError(
            f"the log has no edge of current above C/20 = {_EDGE_RATE * capacity_Ah:.3g} A, so no resistance can be "
            "found; record a few pulses"
        )
    fewest_s = _FEWEST_OF_A_WINDOW * samples.typical_step_s
    window_s = FIRST_S if fewest_s <= FIRST_S else 2 * fewest_s  # ten samples where the log is slower
    before, after = _around(samples, edges)
    r_total = float(np.median((samples.voltage_V[after] - samples.voltage_V[before]) / change_A[edges]))
    if not r_total > 0:
        raise InputError(
            f"the voltage falls when the current rises (R = {r_total:.3g} ohm at {edges.size} edges); currents must be "
            "> 0 when they charge: turn the sign of the current"
        )
    times, rises = zip(*(_after_edge(samples, int(k) + 1, change_A[k], window_s) for k in edges), strict=True)
    return EdgeResponse(
        edges.size,
        r_total,
        float(np.median(samples.time_s[after] - samples.time_s[before])),
        window_s,
        np.concatenate(times),
        np.concatenate(rises),
    )


def _around(samples: RcSamples, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Last sample a typical step before the new current and first a typical step after the old one, for each edge.

    In a regular log these are the samples of the edge itself. A logger that writes both currents and one voltage at the
    same moment is handled too.
    """
    step_s = 0.99 * samples.typical_step_s
    before = np.searchsorted(samples.time_s, samples.time_s[edges + 1] - step_s, "right") - 1
    after = np.searchsorted(samples.time_s, samples.time_s[edges] + step_s, "left")
    return np.maximum(before, 0), np.minimum(after, len(samples.time_s) - 1)


def _after_edge(samples: RcSamples, first: int, change_A: float, window_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Time since sample `first` [s] and rise of the voltage since [ohm], while the current is constant, in a window."""
    last = first + int(np.searchsorted(samples.time_s[first:], samples.time_s[first] + window_s, "right"))
    moved = np.abs(samples.current_A[first:last] - samples.current_A[first]) > 0.1 * abs(change_A)
    stays = slice(first, first + (int(np.argmax(moved)) if moved.any() else last - first))
    rise_ohm = (samples.voltage_V[stays] - samples.voltage_V[first]) / change_A
    return samples.time_s[stays] - samples.time_s[first], rise_ohm


def find_time_constant(response: EdgeResponse) -> TimeConstant:
    """Least squares over a grid of tau between a twentieth of the window and ten windows, equally weighted.

    Tau is not found where the best one lies at an end of the grid or the exponential explains less than half of the
    rises' scatter about their mean.
    """
    t, y = response.time_s, response.rise_ohm
    taus = response.window_s * np.geomspace(0.05, 10.0, 200)
    costs = [_cost_of(1 - np.exp(-t / tau), y) for tau in taus]
    best = int(np.argmin(costs))
    found = 0 < best < len(taus) - 1 and costs[best] < 0.5 * float(np.sum((y - y.mean()) ** 2))
    return TimeConstant(float(taus[best]) if found else response.window_s, found)


def _cost_of(column: np.ndarray, y: np.ndarray) -> float:
    """Residual sum of squares of the best multiple >= 0 of the column."""
    scale = max(float(column @ y) / max(float(column @ column), 1e-300), 0.0)
    return float(np.sum((y - scale * column) ** 2))


class RcSamples(NamedTuple):
    """The samples with a voltage, (T,) each."""

    time_s: np.ndarray
    dt_s: np.ndarray  #: step
    current_A: np.ndarray  #: at the sample
    charge_As: np.ndarray  #: since the start
    mean_A: np.ndarray  #: mean current over the step
    voltage_V: np.ndarray
    gap: np.ndarray  #: True where the step is a gap in the recording, or the first of a part
    part: np.ndarray  #: number of the part, 0 for the first

    @property
    def typical_step_s(self) -> float:
        """Median of the steps [s]."""
        return float(np.median(self.dt_s[1:]))


def outside_long_charges(log: Log, capacity_Ah: float) -> RcSamples:
    """The samples with a voltage outside long charges; the charge moved in all other samples is counted too."""
    moved_Ah, current_A = count_charge(log).moved_Ah, known_current_A(log)
    charging, part = _long_charges(current_A, moved_Ah, capacity_Ah)
    used = np.isfinite(log.voltage_V) & ~charging
    if not used.any():
        raise InputError(f"log {log.name!r} holds nothing but a long charge; an RC model needs a discharge or pulses")
    part = part[used] - part[used][0]
    time_s = log.time_s[used]
    charge_As = SECONDS_PER_HOUR * np.cumsum(moved_Ah)[used]
    dt_s = np.diff(time_s, prepend=time_s[:1])
    mean_A = np.diff(charge_As, prepend=charge_As[:1]) / np.where(dt_s > 0, dt_s, 1.0)
    gap = find_gaps(time_s) | (np.diff(part, prepend=-1) > 0)
    return RcSamples(time_s, dt_s, current_A[used], charge_As, mean_A, log.voltage_V[used], gap, part)


def _long_charges(current_A: np.ndarray, moved_Ah: np.ndarray, capacity_Ah: float) -> tuple[np.ndarray, np.ndarray]:
    """True inside a charge of more than 5 % of the capacity, and the number of such charges before a sample.

    A charge lasts until the next discharge: after it the voltage falls for hours, which no linear model describes.
    """
    sign = np.sign(current_A) * (np.abs(current_A) > _ZERO_RATE * capacity_Ah)
    last_moving = np.maximum.accumulate(np.where(sign != 0, np.arange(len(sign)), 0))
    charging = sign[last_moving] > 0
    run = np.cumsum(np.diff(charging, prepend=charging[:1]))
    long = charging & (np.bincount(run, moved_Ah)[run] > _LONG_CHARGE * capacity_Ah)
    return long, np.cumsum(np.diff(long.astype(int), prepend=int(long[0])) < 0)


#: Largest weight of a sample, as time [s]: a model error lasts as long as the current, however long the step.
_LONGEST_WEIGHT_S = 60.0
#: Slower processes belong to the open-circuit voltage of a model with one time constant.
LONGEST_TAU_S = 900.0
#: A relaxation that explains less of the squared residual is dropped: slow samples cannot separate it from R_0.
_LEAST_EXPLAINED = 0.05
#: Points of the grid of time constants before the search.
_RATES = 40


class VoltageFit(NamedTuple):
    """The four numbers that the voltage of an RC model depends on, see the top of the file."""

    start_V: np.ndarray  #: (parts,) open-circuit voltage at the first sample of each part of the log
    capacitance_F: float  #: C_b + C_s
    #: R_0, R_1
    r0_ohm: float
    r1_ohm: float
    tau_s: float  #: 1 / w
    residual_V: np.ndarray  #: (T,) measured minus fitted voltage; the fit uses the OCV curve where it is known

    @property
    def numbers(self) -> tuple[float, float, float, float]:
        """C, R_0, R_1 and tau, as `rc.four_numbers`."""
        return self.capacitance_F, self.r0_ohm, self.r1_ohm, self.tau_s

    @property
    def rms_V(self) -> float:
        """Root of the mean square of the residual."""
        return float(np.sqrt(np.mean(self.residual_V**2)))


def fit_voltage(
    samples: RcSamples, ocv_V: np.ndarray | None = None, longest_tau_s: float = LONGEST_TAU_S
) -> VoltageFit | None:
    """Best V_start, C, R_0, R_1 and tau for the whole log; None where the log does not identify R_0 or C.

    Samples are weighted by the time that they represent, up to 60 s. No number may be negative.

    ocv_V: (T,) open-circuit voltage along the log where it is known [V].
    longest_tau_s: longest time constant in the search.
    """
    minimize_scalar = require("scipy.optimize", "identification").minimize_scalar

    longest_s = min(0.5 * (samples.time_s[-1] - samples.time_s[0]), longest_tau_s)
    shortest_s = 0.5 * samples.typical_step_s  # anything faster looks like R_0
    grid = np.geomspace(shortest_s, max(longest_s, 4 * shortest_s), _RATES)
    best = int(np.argmin([_solve(samples, ocv_V, tau)[1] for tau in grid]))
    low, high = np.log(grid[max(best - 1, 0)]), np.log(grid[min(best + 1, _RATES - 1)])
    found = minimize_scalar(
        lambda log_tau: _solve(samples, ocv_V, math.exp(log_tau))[1], bounds=(low, high), method="bounded"
    )
    tau_s = math.exp(found.x)
    (r0, r1, per_C), cost = _solve(samples, ocv_V, tau_s)
    alone, cost_alone = _solve(samples, ocv_V, math.inf)
    if r0 == 0.0 or cost > (1 - _LEAST_EXPLAINED) * cost_alone:
        r0, r1, per_C = alone
    if not (per_C > 0 and r0 > 0):
        return None
    return voltage_fit(samples, ocv_V, (1 / per_C, r0, r1, tau_s if r1 > 0 else shortest_s))


def voltage_fit(samples: RcSamples, ocv_V: np.ndarray | None, numbers: tuple[float, float, float, float]) -> VoltageFit:
    """The fit with these four numbers C, R_0, R_1 and tau, and with the best V_start for them."""
    capacitance_F, r0, r1, tau_s = numbers
    over_V = r0 * samples.current_A + r1 * filtered(samples, tau_s)
    charge_V = charge_in_part(samples) / capacitance_F
    open_V = samples.voltage_V - over_V if ocv_V is None else ocv_V
    start_V = _means(samples, open_V - charge_V)
    if ocv_V is None:
        open_V = start_V[samples.part] + charge_V
    return VoltageFit(start_V, capacitance_F, r0, r1, tau_s, samples.voltage_V - (open_V + over_V))


def _solve(samples: RcSamples, ocv_V: np.ndarray | None, tau_s: float) -> tuple[tuple[float, float, float], float]:
    """Best R_0, R_1 and 1 / C >= 0 for a time constant, and the weighted sum of squared residuals."""
    nnls = require("scipy.optimize", "identification").nnls

    currents = _centred(samples, np.column_stack([samples.current_A, filtered(samples, tau_s)]))
    charge = _centred(samples, charge_in_part(samples))
    if ocv_V is None:
        (r0, r1, per_C), norm = nnls(np.column_stack([currents, charge]), _centred(samples, samples.voltage_V))
    else:
        (r0, r1), norm = nnls(currents, _centred(samples, samples.voltage_V - ocv_V))
        per_C = charge @ _centred(samples, ocv_V) / max(charge @ charge, 1e-300)
    return (float(r0), float(r1), float(per_C)), float(norm) ** 2


def charge_in_part(samples: RcSamples) -> np.ndarray:
    """Charge since the first sample of each part [A s], (T,)."""
    _, first = np.unique(samples.part, return_index=True)
    return samples.charge_As - samples.charge_As[first][samples.part]


def filtered(samples: RcSamples, tau_s: float) -> np.ndarray:
    """The current through a first-order filter of gain 1, (T,); exact for the mean current of each step.

    Each part starts from rest.
    """
    first = np.diff(samples.part, prepend=-1) > 0
    decay = np.where(first, 0.0, np.exp(-samples.dt_s / tau_s))
    return scan(decay, np.where(first, 0.0, (1 - decay) * samples.mean_A))


def _weights(samples: RcSamples) -> np.ndarray:
    """Root of the time that each sample represents, (T,)."""
    return np.sqrt(np.clip(samples.dt_s, 1e-3, _LONGEST_WEIGHT_S))


def _centred(samples: RcSamples, values: np.ndarray) -> np.ndarray:
    """Weighted values (T,) or (T, n) less the mean of their part, which the best V_start absorbs."""
    columns = values.reshape(len(values), -1)
    left = [_weights(samples) * (c - _means(samples, c)[samples.part]) for c in columns.T]
    return np.column_stack(left).reshape(values.shape)


def _means(samples: RcSamples, values: np.ndarray) -> np.ndarray:
    """Weighted mean (parts,) of values (T,) over each part."""
    weights = _weights(samples) ** 2
    return np.bincount(samples.part, weights * values) / np.bincount(samples.part, weights)


#: Smallest range of SoC in a log that identifies the slope of the open-circuit voltage.
_LEAST_SOC_RANGE = 0.05
#: Without a curve, change of SoC, at the current of the log, within the longest time constant of the search: a slower
#: relaxation looks like curvature of the open-circuit voltage (a DST on NMC: 893 s and ten times the R_1).
_STRAIGHT_SOC = 0.02
#: Smallest standard deviation of a voltage sensor, whatever a short log shows.
_LEAST_VOLTAGE_STD_V = 0.001
#: Smallest relative standard deviation of the resistances: two estimates of them may agree by chance.
_CHANCE_STD = 0.05
#: Correlation length in SoC of the error of a straight line, which varies slowly.
_MODEL_SOC_LENGTH = 0.3
#: Points on the grid of SoC for the model error.
_SOC_POINTS = 11
#: Relative error of the slope of a straight line beyond the range that it was fitted to: the slope of the curves of
#: NCA, NMC and LCO between 20 and 60 % is 0.8, 0.6 and 0.4 of that between 60 and 100 %.
_SLOPE_STD = 0.3
#: Median of the absolute value of a standard normal number.
_MEDIAN_OF_NORMAL = 0.6745


class RcIdentification(NamedTuple):
    """The RC model, and how it was identified."""

    model: RcModel  #: the result; `fit` turned into elements, or `rule` where the fit was not possible
    noise: BatteryNoise  #: what a filter on this model should assume: voltage noise, and model error along SoC
    rule: RcModel  #: by [P]'s rule alone
    response: EdgeResponse  #: of the voltage to the edges of the current
    tau: TimeConstant  #: time constant by the rule
    fit: VoltageFit | None  #: least squares on the whole log; None where it was not possible


def identify_rc(log: Log, ocv: OcvCurve | None, capacity_Ah: float, start_soc: float | None = None) -> RcIdentification:
    """The RC model of the battery in the log.

    log: pulses or a drive, > 0 charges; the longer and the more of the SoC range, the better.
    ocv: open-circuit voltage of the same battery; None fits a straight line to the log itself, which suits a linear
        model best where the battery is nearly linear, as lead-acid is.
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
    total_F = rc_circuit.capacitance_for(capacity_Ah, curve)
    rule = RcModel(*circuit_by_rule(response.r_total_ohm, tau.tau_s, total_F), curve, capacity_Ah)
    model = rule if fit is None else RcModel(*circuit_of(*fit.numbers), curve, capacity_Ah)
    line_slope_V = 0.0 if ocv else curve.voltage_V[-1] - curve.voltage_V[0]
    noise = BatteryNoise() if fit is None else _noise(fit, response, soc, line_slope_V)
    return RcIdentification(model, noise, rule, response, tau, fit)


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
    """Least squares without a curve, the straight OCV line that results, and the SoC at the start of each part."""
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
    """SoC at the first sample of each part, from its voltage less the drop at R_total; `start_soc` for the first."""
    first = np.flatnonzero(np.diff(samples.part, prepend=-1) > 0)
    open_V = samples.voltage_V[first] - response.r_total_ohm * samples.current_A[first]
    soc = np.array([ocv.soc_at(v, ocv.reference_degC) for v in open_V.tolist()])
    return soc if start_soc is None else np.array([start_soc, *soc[1:]])


def _soc_along(samples: RcSamples, start: np.ndarray, capacity_Ah: float) -> np.ndarray:
    """SoC along the log (T,) from that at the start of each part."""
    return start[samples.part] + charge_in_part(samples) / (SECONDS_PER_HOUR * capacity_Ah)


def _noise(fit: VoltageFit, response: EdgeResponse, soc: np.ndarray, line_slope_V: float) -> BatteryNoise:
    """Noise to assume, from the residual between samples and along SoC, and the difference of the two resistances.

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

    The residual of a fit has zeros, and another log has them elsewhere; hence the median. Where there are no data, the
    error is the largest one; with a straight line for the curve it also grows with the distance to the data.
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
