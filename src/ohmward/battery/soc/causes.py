"""Causes of a wide band of the state of charge: in points, in words, and with what would narrow it.

Uncertainty budget of one state, the part of its variance that each group of other states explains:

    v(A) = P_sA P_AA^-1 P_As        variance of x_s that would vanish if the states A were known
    part of g = mean over all orders of (v(those before g, and g) - v(those before g))

These are the Shapley values of v: they add up to v(all), whatever the correlations, and two causes that explain the
same share it evenly (Owen and Prieur 2017, "On Shapley value for measuring importance of dependent inputs").

A state that stands for several errors at once, those of voltage and SoC axis and the charge gain, is shared out by the
variances that the battery file gives to each of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import combinations
from math import comb
from typing import NamedTuple

import numpy as np

from ohmward.battery.models.noise import USUAL_C
from ohmward.battery.models.temperature import coldness_per_K
from ohmward.battery.models.thevenin import CircuitInput, log_ratio_by_weather
from ohmward.battery.soc.augmented_thevenin import SOC, UNEVEN_ACTIVATION, AugmentedState
from ohmward.battery.soc.charge_history import ChargeHistory
from ohmward.battery.soc.thevenin_filter import FilterState, TheveninFilter
from ohmward.filters.belief import Belief, unpack
from ohmward.filters.consistency import BAND_95
from ohmward.quantities import DAY_S, SECONDS_PER_HOUR

#: States whose correlation matrix is closer to singular than this count as one state in the budget.
_LEAST_EIGENVALUE = 1e-9


class VariancePart(NamedTuple):
    """One line of the budget."""

    variance: float  #: part of the whole; all parts and `VarianceBudget.rest` add up to the whole
    removable: float  #: variance that would vanish if this cause alone were known


class VarianceBudget(NamedTuple):
    """Variance of a state, its parts by cause, and the rest that would stay if every cause were known."""

    variance: float
    parts: dict[str, VariancePart]
    rest: float


def variance_budget(cov: np.ndarray, of: int, causes: Mapping[str, Sequence[int]]) -> VarianceBudget:
    """The budget of the state `of`, for causes that are groups of other states.

    cov: (n, n), symmetric positive semidefinite.  causes: indices of the states of each cause, by name; about ten at
    most, because every subset of them is evaluated.
    """
    names = tuple(causes)
    explained = {
        subset: explained_variance(cov, of, [i for name in subset for i in causes[name]])
        for size in range(len(names) + 1)
        for subset in combinations(names, size)
    }
    parts = {name: VariancePart(_shapley_value(name, names, explained), explained[(name,)]) for name in names}
    return VarianceBudget(float(cov[of, of]), parts, float(cov[of, of]) - explained[names])


def explained_variance(cov: np.ndarray, of: int, known: Sequence[int]) -> float:
    """Variance of the state `of` that would vanish if the states `known` were known, v(A)."""
    states = [i for i in known if cov[i, i] > 0.0]
    if not states:
        return 0.0
    std = np.sqrt(np.diag(cov)[states])
    correlation = cov[np.ix_(states, states)] / np.outer(std, std)
    values, vectors = np.linalg.eigh(correlation)
    along = vectors.T @ (cov[states, of] / std)
    usable = values > _LEAST_EIGENVALUE
    return min(float(np.sum(along[usable] ** 2 / values[usable])), float(cov[of, of]))


def _shapley_value(name: str, names: tuple[str, ...], explained: Mapping[tuple[str, ...], float]) -> float:
    """Mean over all orders of what the cause adds to those before it."""
    others = [other for other in names if other != name]
    total = 0.0
    for size in range(len(names)):
        weight = 1.0 / (len(names) * comb(len(names) - 1, size))
        for before in combinations(others, size):
            joined = tuple(n for n in names if n == name or n in before)
            total += weight * (explained[joined] - explained[before])
    return total


#: Half width of the 95 % band up to which SoC counts as known: one bar of a gauge with ten.
KNOWN_HALF_WIDTH = 0.10
#: Smaller parts of the band are not mentioned: half a point.
LEAST_PART = 0.005
#: Time for which a current must have been missing before it is named as the cause [s].
_MISSING_S = 60.0

#: Smallest share of the variance of a cause that is named as a reason, and largest number of reasons in a sentence.
_MAIN_SHARE, _MOST_REASONS = 0.2, 3


class Cause(NamedTuple):
    """A cause of the band's width."""

    name: str  #: for programs
    text: str  #: in words, as a part of a sentence
    #: its part of the half width of the 95 % band, in points; the squares of all parts add up to the square of the half
    #: width, as in every uncertainty budget
    points: float
    points_without: float  #: half width in points if this alone were known
    remedy: str  #: in words, as the subject of "would narrow it"


class Conditions(NamedTuple):
    """Present state of the battery, in the quantities that the sentences need."""

    settings: TheveninFilter
    history: ChargeHistory
    #: largest standard deviation of the states of each cause; for capacity and resistance that of the estimate
    std: Mapping[str, float]
    temperature_degC: float  #: of the battery; if not measured, the colder one assumed for errors
    slope_V: float  #: change of the open-circuit voltage per unit of SoC
    error_V: Mapping[str, float]  #: standard deviation of each part of the model's voltage error, by cause
    usual_error_V: Mapping[str, float]  #: the same under a usual load, and that by the SoC axis
    slip_std: float  #: standard deviation of the SoC axis by a loss of capacity, in addition to the file's
    #: relative error of the overpotential at the present SoC, at the temperature of the test
    overpotential_share: float
    axis_std: float  #: error of the SoC axis of the curve at the present SoC
    unsettled_V: float  #: standard deviation that even a long rest leaves in the voltage
    unknown_s: float  #: time for which the current has been missing


class Wording(NamedTuple):
    """Sentence parts of one cause: the cause itself, and what would narrow it."""

    text: Callable[[Conditions], str]
    remedy: Callable[[Conditions], str]


def causes_of(now: Conditions, belief: Belief) -> tuple[Cause, ...]:
    """The causes that are worth mentioning, the largest part first."""
    budget = variance_budget(belief.cov, SOC, cause_states(now.settings.state_names))
    earlier = budget.rest * voltage_limited_share(now, belief)
    counted = budget.rest - earlier
    parts = {
        **budget.parts,
        "history": VariancePart(counted, counted),
        "earlier_voltage_error": VariancePart(earlier, earlier),
    }

    def cause(name: str, part: VariancePart) -> Cause:
        wording = WORDINGS[name]
        return Cause(
            name,
            wording.text(now),
            points(part.variance),
            points(budget.variance - part.removable),
            wording.remedy(now),
        )

    found = [
        cause(name, part) for name, part in shared_out(parts, now).items() if points(part.variance) >= 100 * LEAST_PART
    ]
    return tuple(sorted(found, key=lambda c: -c.points))


def reasons(now: Conditions, causes: tuple[Cause, ...]) -> tuple[str, ...]:
    """The reasons for a wide band in words: the place on the curve, the main causes, the time without a charge.

    On a flat part of the curve any error of the voltage is a large error of SoC, so the place comes first, and the last
    full charge counts as much as any cause.
    """
    flat = is_flat(now)
    total = sum(cause.points**2 for cause in causes)
    main = [c for c in causes if c.points**2 >= _MAIN_SHARE * total and not (flat and c.name in ("curve", "history"))]
    texts = ["flat part of the curve"] if flat else []
    texts += [cause.text for cause in main[: _MOST_REASONS - 2 * flat]]
    return (*texts, _history(now)) if flat else tuple(texts)


def points(variance: float) -> float:
    """Half width of the 95 % band of this variance of SoC, in points of percent."""
    return 100 * BAND_95 * float(np.sqrt(max(variance, 0.0)))


def cause_states(state_names: tuple[str, ...]) -> dict[str, list[int]]:
    """Indices of the states of each cause; several states, such as the voltages of the RC pairs, may be one."""
    groups: dict[str, list[int]] = {}
    for index, name in enumerate(state_names):
        if index != SOC:
            cause = next((cause for part, cause in _CAUSE_BY_NAME.items() if part in name), "relaxation")
            groups.setdefault(cause, []).append(index)
    return groups


def shared_out(parts: Mapping[str, VariancePart], now: Conditions) -> dict[str, VariancePart]:
    """The parts, with the voltage errors and the charge gain divided among the errors behind them."""
    noise, sensor = now.settings.noise, now.settings.sensor
    shares = {
        "voltage_error": _shares(now.error_V),
        "earlier_voltage_error": _shares(now.usual_error_V),
        "axis": _shares({"axis": now.axis_std, "capacity": now.slip_std}),
        "charge_gain": _shares({"capacity": noise.capacity_std, "gain": sensor.gain_std}),
    }
    divided: dict[str, VariancePart] = {}
    for name, part in parts.items():
        for own, share in shares.get(name, {name: 1.0}).items():
            before = divided.get(own, VariancePart(0.0, 0.0))
            more = VariancePart(share * part.variance, share * part.removable)
            divided[own] = VariancePart(before.variance + more.variance, before.removable + more.removable)
    return divided


def _shares(stds: Mapping[str, float]) -> dict[str, float]:
    """Share of each in the sum of the variances."""
    total = sum(std**2 for std in stds.values())
    return {name: std**2 / total if total else 0.0 for name, std in stds.items()}


def conditions(settings: TheveninFilter, state: FilterState, history: ChargeHistory) -> Conditions:
    """The conditions in a state of the filter."""
    belief = unpack(state.belief)
    state_std = np.sqrt(np.maximum(np.diag(belief.cov), 0.0))
    std = {cause: float(state_std[of].max()) for cause, of in cause_states(settings.state_names).items()}
    known = settings.system.known(belief)
    std |= {
        "capacity": float(known["soh_capacity_std"]),
        "resistance": float(known["resistance_ratio_std"] / known["resistance_ratio"]),
    }
    x = settings.system.split(belief.mean)
    u = CircuitInput(float(state.current_A) - x.offset_A, float(state.temperature_degC), float(state.unknown_K))
    slope_V = float(settings.system.ocv_slope(np.array([x.circuit[SOC]]), x.circuit, u)[0])
    now_V = float(np.linalg.norm([float(v) for v in settings.system.overpotentials(x, u)]))
    usual_V = float(settings.system.total_ohm(x, u)) * USUAL_C * settings.model.capacity_Ah
    # SoC axis: the error in the file, and the shift by a loss of capacity
    axis_std = float(settings.noise.axis_std_at(x.circuit[SOC]))
    slip_std = math.sqrt(max(float(settings.system.axis_variance(x)) - axis_std**2, 0.0))
    slopes_V = {"axis": axis_std * slope_V, "capacity": slip_std * slope_V}
    error_V = voltage_errors(settings, x, u, now_V) | ({} if settings.system.axis_is_shift else slopes_V)
    gain_V = std.get("voltage_gain", 0.0) * float(settings.noise.gain_error_V(x.circuit[SOC], u, settings.model))
    hysteresis_V = std["hysteresis"] * float(settings.model.hysteresis_V_at(x.circuit[SOC], u.temperature_degC))
    return Conditions(
        settings,
        history,
        std,
        u.error_degC,
        slope_V,
        error_V,
        slopes_V | voltage_errors(settings, x, u, usual_V),
        slip_std,
        float(settings.noise.overpotential_share_at(x.circuit[SOC])),
        axis_std,
        float(np.linalg.norm([error_V["curve"], error_V["ocv_temperature"], hysteresis_V, gain_V])),
        float(state.unknown_s),
    )


def voltage_errors(settings: TheveninFilter, x: AugmentedState, u: CircuitInput, over_V: float) -> dict[str, float]:
    """Standard deviations [V] of the other errors that stay with SoC, at an overpotential over_V [V]."""
    noise, model = settings.noise, settings.model
    soc = x.circuit[SOC]
    at_test, here = float(noise.overpotential_share_at(soc)), float(settings.system.overpotential_share(soc, u))
    weather = UNEVEN_ACTIVATION * float(log_ratio_by_weather(u, model))
    elsewhere_V = math.sqrt(max(here**2 - at_test**2 - weather**2, 0.0)) * over_V
    tested = noise.activation_std_K == 0.0  # then the cold itself is to blame, not an untested activation
    return {
        "curve": math.hypot(float(noise.model_std_at(soc)), noise.level_std_V),
        "overpotential": math.hypot(at_test * over_V, elsewhere_V if tested else 0.0),
        "activation": 0.0 if tested else elsewhere_V,
        "weather": weather * over_V,
        "ocv_temperature": noise.ocv_std_V_per_K * abs(u.error_degC - model.ocv.reference_degC),
    }


def voltage_limited_share(now: Conditions, belief: Belief) -> float:
    """Share of the remaining variance that comes from errors of earlier voltages, not from counting; 0 if unknown.

    1 - P / P_0: a voltage that brought the variance P_0 of counting alone down to P has left its own errors in P.
    """
    anchor, settings = now.history.anchor, now.settings
    if anchor is None:
        return 0.0
    idle = settings.idle_current_A is not None  # then rests show the offset, and the voltage is not needed for it
    offset_A = now.std["offset"] if idle else settings.sensor.offset_std_A
    gain = math.hypot(settings.noise.capacity_std, settings.sensor.gain_std)
    drift = offset_A * anchor.since_s / settings.model.capacity_As
    counted = anchor.std**2 + drift**2 + (gain * (float(belief.mean[SOC]) - anchor.soc)) ** 2
    return max(1.0 - float(belief.cov[SOC, SOC]) / counted, 0.0) if counted > 0.0 else 0.0


def is_flat(now: Conditions) -> bool:
    """True where the voltage cannot determine SoC to within `KNOWN_HALF_WIDTH`, even after a long rest."""
    return now.slope_V * KNOWN_HALF_WIDTH < BAND_95 * now.unsettled_V


def time_in_words(seconds: float) -> str:
    """A duration in words: "25 minutes", "7 hours", "6 days"."""
    for unit, length_s in (("day", DAY_S), ("hour", SECONDS_PER_HOUR)):
        if round(seconds / length_s) >= 2:
            return f"{seconds / length_s:.0f} {unit}s"
    minutes = round(seconds / 60.0)
    return f"{minutes} minute{'' if minutes == 1 else 's'}"


def within(relative_std: float) -> str:
    """Range of a relative error in words: "± 30 %", or "a factor of 3" where that says more."""
    factor = float(np.exp(min(BAND_95 * relative_std, 5.0)))
    return f"± {100 * BAND_95 * relative_std:.0f} %" if factor < 2 else f"a factor of {float(f'{factor:.1g}'):g}"


def _curve(now: Conditions) -> str:
    return "flat part of the curve" if is_flat(now) else "error of the open-circuit curve"


def _activation(now: Conditions) -> str:
    T = now.temperature_degC
    spread = now.std["activation"] * abs(coldness_per_K(T, now.settings.model.reference_degC))
    return f"resistance at {T:z.0f} degC known only within {within(spread)}"


def _ocv_temperature(now: Conditions) -> str:
    std_mV = 1e3 * now.error_V["ocv_temperature"]
    return f"open-circuit curve at {now.temperature_degC:z.0f} degC known within ± {BAND_95 * std_mV:.2g} mV"


def _history(now: Conditions) -> str:
    if now.unknown_s > _MISSING_S:
        return f"current not measured for {time_in_words(now.unknown_s)}"
    diverged_s = now.history.since_diverged_s
    if diverged_s is not None and diverged_s < (now.history.since_full_s or math.inf):
        return f"the voltage contradicted the estimate {time_in_words(diverged_s)} ago"
    if now.history.since_full_s is not None:
        return f"not charged fully for {time_in_words(now.history.since_full_s)}"
    if now.history.since_start_s is not None:
        return f"not charged fully since the start {time_in_words(now.history.since_start_s)} ago"
    return "start not known better"


def _settling(now: Conditions) -> str:
    minutes = 2.0 * max(now.settings.model.tau_s, default=0.0) / 60.0
    return f"{time_in_words(300.0 * max(math.ceil(minutes / 5.0), 1))} of rest"


_BOTH_BRANCHES = "a slow discharge and a slow charge as a test"
_DECLARED_REST = "a declared rest current (idle_current_A in the battery file)"

#: Sentence parts by cause.
WORDINGS: dict[str, Wording] = {
    "history": Wording(_history, lambda now: "a full charge"),
    "curve": Wording(_curve, lambda now: "a full charge" if is_flat(now) else _BOTH_BRANCHES),
    "axis": Wording(
        lambda now: f"SoC axis of the curve known within ± {100 * BAND_95 * now.axis_std:.2g} points",
        lambda now: _BOTH_BRANCHES,
    ),
    "overpotential": Wording(
        lambda now: f"voltage drop under load known within {within(now.overpotential_share)}",
        _settling,
    ),
    "ocv_temperature": Wording(
        _ocv_temperature,
        lambda now: f"a test with rests at {5 * round(now.temperature_degC / 5):.0f} degC",
    ),
    "hysteresis": Wording(lambda now: "place between the charge and the discharge curve", lambda now: "a full charge"),
    "hysteresis_size": Wording(
        lambda now: f"hysteresis known within {within(now.std['hysteresis_size'])}", lambda now: _BOTH_BRANCHES
    ),
    "offset": Wording(
        lambda now: f"offset of the current sensor known within ± {BAND_95 * now.std['offset']:.2g} A",
        lambda now: "a minute of rest" if now.settings.idle_current_A is not None else _DECLARED_REST,
    ),
    "capacity": Wording(
        lambda now: f"capacity known within {within(now.std['capacity'])}",
        lambda now: "a discharge from full to empty",
    ),
    "gain": Wording(
        lambda now: f"gain of the current sensor known within {within(now.settings.sensor.gain_std)}",
        lambda now: "the data sheet of the current sensor ([sensor] in the battery file)",
    ),
    "voltage_gain": Wording(
        lambda now: (
            "gain of the voltage sensor known within "
            f"± {100 * BAND_95 * now.std['voltage_gain'] * now.settings.noise.voltage_gain_std:.2g} %"
        ),
        lambda now: "a voltage sensor that was compared with that of the test (voltage_gain_std in the battery file)",
    ),
    "resistance": Wording(
        lambda now: f"resistance known within {within(now.std['resistance'])}",
        lambda now: "an hour of driving with changing current",
    ),
    "activation": Wording(_activation, lambda now: f"a pulse test at {5 * round(now.temperature_degC / 5):.0f} degC"),
    "weather": Wording(
        lambda now: "temperature of the battery not measured", lambda now: "a temperature sensor at the battery"
    ),
    "relaxation": Wording(lambda now: "voltage not settled after the last load", _settling),
}

#: Causes that are large for lack of a test, which would remove them.
TESTED = ("activation", "capacity", "hysteresis_size", "ocv_temperature")

#: Cause of a state of the filter by a part of its name, matched in this order; all others are voltages of RC pairs.
_CAUSE_BY_NAME = {
    "activation": "activation",
    "hysteresis_": "hysteresis_size",
    "hysteresis": "hysteresis",
    "offset": "offset",
    "charge_gain": "charge_gain",
    "resistance": "resistance",
    "_log": "resistance",
    "model_error": "voltage_error",
    "axis_error": "axis",
    "level_error": "voltage_error",
    "voltage_gain": "voltage_gain",
}
