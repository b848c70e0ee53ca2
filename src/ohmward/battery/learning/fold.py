"""Fold learnt parameters into a battery file: means into the model, standard deviations into the noise, with floors.

Resistance to a pulse, as battery testers measure and quote it.

After a rest a current I of one capacity per hour flows for t = 10 s:

    R = (overpotentials of `models.thevenin` after it + (I t / Q) dOCV/ds) / I

The last term is the fall of the open-circuit voltage by the charge drawn, which a tester measures as well.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.battery import Battery, Knowledge
from ohmward.battery.chemistries import CELL_V, Normal, chemistry, chemistry_prior
from ohmward.battery.learning.parameters import mean_slope_V, parameters_of, prior_covariance
from ohmward.battery.learning.voltage_model import CurvePlace, OpenCircuit, file_charge, true_soc
from ohmward.battery.models.noise import BatteryNoise
from ohmward.battery.models.ocv import OCV_POINTS, OcvCurve, hat, slip_shape
from ohmward.battery.models.thevenin import (
    RESISTANCE_GRID,
    RESISTANCE_KNOTS,
    CircuitInput,
    Corrections,
    Thevenin,
    at_rest,
    next_state,
    overpotentials,
    scaled_hysteresis,
)
from ohmward.battery.posterior import (
    ACTIVATION_STD_K,
    ENTROPY_KNOTS,
    ENTROPY_SHARE,
    HYSTERESIS_STD,
    OCV_KNOTS,
    OVERPOTENTIAL_STD,
    SOC_AXIS_STD,
    Unknowns,
    beyond_axis_V,
    remaining_std,
    variances,
)
from ohmward.filters.consistency import BAND_95

#: Duration of the pulse [s], and state of charge before the pulse that is quoted.
PULSE_S, _HALF = 10.0, 0.5

#: Smallest error of the model that stays with SoC [V], for each CELL_V of the battery, and its correlation length.
MODEL_STD_V, _MODEL_LENGTH = 0.005, 0.1
#: The same for a battery that gases: slowly diffusing acid leaves 18 to 50 mV of 12 V after a day of loads.
_GASSING_MODEL_STD_V = 0.01
#: Smallest relative errors: of the capacity, of all resistances.
_CAPACITY_STD, _RESISTANCE_STD = 0.01, 0.05
#: Distance in SoC at which the correlation of the curve's error is taken, for its length.
_NEIGHBOUR = 0.1


def model_floor_V(battery: Battery) -> float:
    """Smallest error of the model's voltage [V] that stays with SoC."""
    model = battery.thevenin
    cell_V = chemistry_prior(battery.chemistry).unmeasured_model_V or MODEL_STD_V
    cell_V = cell_V if model.gassing_V is None else _GASSING_MODEL_STD_V
    return cell_V * float(np.mean(model.ocv.voltage_V)) / CELL_V


def fold(
    battery: Battery, theta: np.ndarray, covariance: np.ndarray, lowest_soc: float, count_error2: float
) -> Battery:
    """The battery with the corrections theta (K,) applied, and with the covariance (K, K) of their remaining errors.

    lowest_soc: lowest SoC of the log, by the new capacity; count_error2: see `without_capacity`.
    """
    p = parameters_of(battery)
    curve, sensor = OpenCircuit(battery, theta, p), battery.sensor
    model = folded_model(curve, covariance)
    seen_before = float(true_soc(np.array(curve.place.seen_from_soc), curve.place.log_ratio))
    seen_from_soc = min(lowest_soc, seen_before)
    offset = p.group("offset")
    if theta[offset].size:
        std_A = float(np.sqrt(covariance[offset, offset][0, 0]))
        sensor = replace(sensor, offset_A=sensor.offset_A + float(theta[offset][0]), offset_std_A=std_A)
    folded = replace(
        battery,
        capacity_Ah=model.capacity_Ah,
        thevenin=model,
        sensor=sensor,
        knowledge=Knowledge.of(p.names, covariance, battery.learnt_logs, float(np.clip(seen_from_soc, 0.0, 1.0))),
    )
    covariance = without_capacity(covariance_of_folded(curve, folded, covariance), folded, count_error2)
    noise = folded_noise(folded, p, covariance)
    knowledge = Knowledge.of(p.names, covariance, battery.learnt_logs, folded.curve_seen_from_soc)
    return replace(folded, noise=noise, knowledge=knowledge)


def covariance_of_folded(curve: OpenCircuit, folded: Battery, covariance: np.ndarray) -> np.ndarray:
    """(K, K) covariance of the corrections of the new file, whose knots lie elsewhere along the charge below full.

    The error of the voltage at a charge is the same before and after: the part that moved with the capacity, and now
    does not, becomes an error of the knots.
    """
    p, battery = curve.parameters, curve.battery
    ocv, slip, capacity = p.group("ocv"), p.group("slip"), p.group("capacity")
    old, degC = file_charge(OCV_KNOTS, curve.place.log_ratio), curve.model.ocv.reference_degC
    before = curve.columns(old, degC)
    after = OpenCircuit(folded, np.zeros(p.size), p).columns(OCV_KNOTS, degC)
    T = np.eye(p.size)
    T[ocv, ocv] = before[:, ocv]
    T[ocv, slip] = before[:, slip]
    T[ocv, capacity] = before[:, capacity] - after[:, capacity]
    moved = T @ covariance @ T.T
    std_V = battery.noise.model_std_V[0]
    beyond = np.maximum(-old, 0.0)  # beyond the old empty nothing is known but how fast such curves change
    moved[ocv, ocv] += np.minimum.outer(beyond, beyond) * 2 * std_V**2 / battery.noise.model_soc_length
    return moved


def without_capacity(covariance: np.ndarray, battery: Battery, count_error2: float) -> np.ndarray:
    """The covariance (K, K) without correlations of the capacity, but for those by the offset of the current sensor.

    Where logs have shown the curve, the voltage at a charge below full is the same whatever the capacity is; the rest
    of the curve stretches with the capacity by itself (`CurvePlace`). A correlation that is left comes from between the
    knots, and each log would infer the capacity from it again. But charge counted between two places gives capacity and
    offset together: a log that finds the offset gives the capacity within count_error2, the variance of those places.
    """
    found, p = covariance.copy(), parameters_of(battery)
    q, offset = p.group("capacity"), p.group("offset")
    gain = np.linalg.solve(covariance[offset, offset], covariance[offset, q])
    by_offset = float((gain * covariance[offset, q]).sum())
    beyond_count = max(float(covariance[q, q].sum()) - count_error2, 0.0)
    share = min(beyond_count, by_offset) / by_offset if by_offset else 0.0
    found[q, :] = np.sqrt(share) * gain.T @ covariance[offset, :]
    found[:, q] = found[q, :].T
    found[q, q] = covariance[q, q]
    return found


def with_curve_of_file(
    p: Unknowns, theta: np.ndarray, covariance: np.ndarray, before: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The corrections (K,) and their covariance (K, K) where those of the curve stay as before (K, K) a log."""
    curve, others = p.places("slip", "ocv", "entropy"), np.ones(p.size, dtype=bool)
    others[curve] = False
    stays = np.where(np.outer(others, others), covariance, 0.0)
    stays[np.ix_(curve, curve)] = before[np.ix_(curve, curve)]
    return np.where(others, theta, 0.0), stays


def ageing_direction(battery: Battery, p: Unknowns) -> np.ndarray:
    """(K,) change of the parameters with the logarithm of the capacity in ageing, slip of the electrodes included."""
    model, direction = battery.thevenin, np.zeros(p.size)
    direction[p.group("capacity")] = 1.0
    direction[p.group("ocv")] = _slope_by_capacity_V(battery, OCV_KNOTS)
    return direction + model.ocv_slip * slip_direction(battery, p)


def _slope_by_capacity_V(battery: Battery, soc: np.ndarray) -> np.ndarray:
    """(N,) change of the curve at these SoC with the logarithm of the capacity [V].

    Where logs have shown the curve it is known over the charge below full, so that along SoC it errs with the capacity.
    """
    stretched = CurvePlace(battery.curve_seen_from_soc, 0.0).columns(soc)[:, 0]
    return mean_slope_V(battery.thevenin.ocv, soc) * (1.0 - soc - stretched)


def slip_direction(battery: Battery, p: Unknowns) -> np.ndarray:
    """(K,) change of the curve where the electrodes slip by the whole of a loss of capacity."""
    model, direction = battery.thevenin, np.zeros(p.size)
    direction[p.group("ocv")] = -mean_slope_V(model.ocv, OCV_KNOTS) * slip_shape(OCV_KNOTS, model.ocv_slip)
    return direction


def folded_model(curve: OpenCircuit, covariance: np.ndarray) -> Thevenin:
    """The circuit with the corrections applied; covariance: (K, K) of their errors."""
    model, p, theta = curve.model, curve.parameters, curve.theta
    corrections = Corrections(*(theta[p.group(name)] for name in Corrections._fields))
    return replace(
        corrections.made(model),
        capacity_Ah=model.capacity_Ah * float(np.exp(curve.place.log_ratio)),
        ocv=folded_curve(curve, covariance),
        ocv_slip=model.ocv_slip + float(theta[p.group("slip")].sum()),
    )


def folded_curve(curve: OpenCircuit, covariance: np.ndarray) -> OcvCurve:
    """The open-circuit curve with the corrections applied, as far as they leave it rising."""
    ocv, p, theta = curve.model.ocv, curve.parameters, curve.theta
    soc = np.linspace(0.0, 1.0, max(len(ocv.voltage_V), OCV_POINTS))
    charge, group = file_charge(soc, curve.place.log_ratio), p.group("ocv")
    voltage_V, knots = curve.at(charge, ocv.reference_degC), hat(charge, OCV_KNOTS)
    std_V = np.sqrt(variances(knots, covariance[group, group]))
    entropy = theta[p.group("entropy")]
    more_V_per_K = hat(soc, ENTROPY_KNOTS) @ entropy if entropy.size else 0.0
    ratio = float(np.exp(theta[p.group("hysteresis")].sum()))
    voltage_V = voltage_V + scaled_hysteresis(0.0, ratio, curve.model) * np.asarray(ocv.hysteresis_at(soc))
    return ocv.corrected(voltage_V, ratio, more_V_per_K, std_V=std_V)


def folded_noise(battery: Battery, p: Unknowns, covariance: np.ndarray) -> BatteryNoise:
    """Noise of the battery with these errors left in its parameters, none narrowed below its floor.

    Those of capacity and resistances grow with age between two logs; no other is above the old value.
    """
    noise = battery.noise
    std = np.sqrt(np.diag(covariance))
    curve_V, length = _curve_error(battery, p, covariance)
    axis_std = min(noise.soc_axis_std, max(SOC_AXIS_STD, _axis_std(battery, curve_V)))
    floor_V = model_floor_V(battery)
    model_V = np.hypot(beyond_axis_V(curve_V, battery.thevenin.ocv, axis_std), floor_V)
    activation_K = _rms(std[p.group("activation")])
    empty_K = float(std[p.group("empty_activation")].sum())
    entropy = _rms(std[p.group("entropy")])
    return replace(
        noise,
        model_std_V=tuple(model_V.tolist()),
        model_soc_length=length,
        soc_axis_std=axis_std,
        overpotential_share=_share(noise, p, std),
        capacity_std=capacity_std(battery, covariance),
        resistance_std=resistance_std(battery, covariance),
        ageing_correlation=0.0,  # the errors that a log leaves in either are independent
        activation_std_K=remaining_std(activation_K, ACTIVATION_STD_K, noise.activation_std_K),
        empty_activation_std_K=remaining_std(empty_K, 0.0, noise.empty_activation_std_K),
        ocv_std_V_per_K=remaining_std(entropy, ENTROPY_SHARE * noise.ocv_std_V_per_K, noise.ocv_std_V_per_K),
        hysteresis_std=remaining_std(float(std[p.group("hysteresis")].sum()), HYSTERESIS_STD, noise.hysteresis_std),
    )


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else 0.0


def known_since(battery: Battery, unix_s: float | None) -> Battery:
    """The battery with that day as the date of its capacity error; unchanged where the day is unknown."""
    if unix_s is None:
        return battery
    noise = battery.noise
    dated = replace(noise, capacity_known_unix_s=unix_s, capacity_known_std=noise.capacity_std)
    return replace(battery, noise=dated)


def capacity_std(battery: Battery, covariance: np.ndarray) -> float:
    """Relative error of the capacity, without the gain of the sensor by which the corrections count it."""
    q = parameters_of(battery).group("capacity")
    variance = float(covariance[q, q].sum()) - battery.sensor.gain_std**2
    return max(float(np.sqrt(max(variance, 0.0))), min(_CAPACITY_STD, battery.noise.capacity_std))


def resistance_std(battery: Battery, covariance: np.ndarray) -> float:
    """Relative error of the resistance to a steady current, mean over SoC."""
    p, model = parameters_of(battery), battery.thevenin
    grid = np.linspace(0.0, 1.0, len(model.r0_discharge_ohm))
    along = hat(RESISTANCE_GRID, RESISTANCE_KNOTS).mean(axis=0)
    rows = [along * np.interp(RESISTANCE_KNOTS, grid, ohm) for ohm in (model.r0_discharge_ohm, *model.r_ohm)]
    weights = np.zeros(p.size)
    weights[p.places("ohmic", "pair")] = np.concatenate(rows)
    total = weights.sum()
    found = float(np.sqrt(weights @ covariance @ weights) / total) if total > 0 else 0.0
    return max(found, min(_RESISTANCE_STD, battery.noise.resistance_std))


def _curve_error(battery: Battery, p: Unknowns, covariance: np.ndarray) -> tuple[np.ndarray, float]:
    """(21,) standard deviation [V] of the curve along SoC, and the correlation length of that error."""
    rows = np.zeros((RESISTANCE_GRID.size, p.size))
    rows[:, p.group("ocv")] = hat(RESISTANCE_GRID, OCV_KNOTS)
    rows[:, p.group("capacity")] = -_slope_by_capacity_V(battery, RESISTANCE_GRID)[:, None]
    error = rows @ covariance @ rows.T
    variance = np.diag(error)
    floor_V2 = model_floor_V(battery) ** 2
    apart = round(_NEIGHBOUR / float(RESISTANCE_GRID[1] - RESISTANCE_GRID[0]))
    shared = np.diag(error, apart) + floor_V2 * np.exp(-_NEIGHBOUR / _MODEL_LENGTH)
    correlation = shared / np.sqrt((variance[apart:] + floor_V2) * (variance[:-apart] + floor_V2))
    length = -_NEIGHBOUR / np.log(np.clip(np.median(correlation), 0.2, 0.95))
    return np.sqrt(variance), float(max(length, _MODEL_LENGTH))


def _axis_std(battery: Battery, curve_V: np.ndarray) -> float:
    """Error of the SoC axis, from that of the curve where it is steep."""
    slope_V = mean_slope_V(battery.thevenin.ocv, RESISTANCE_GRID)
    steep = slope_V >= np.quantile(slope_V, 0.75)
    return float(np.median(curve_V[steep] / slope_V[steep]))


def _share(noise: BatteryNoise, p: Unknowns, std: np.ndarray) -> float | tuple[float, ...]:
    """Relative error of the overpotential, from the remaining errors of the resistances and the floor."""
    shape = np.square(std[p.places("ohmic", "pair")]).mean()
    before = np.asarray(noise.overpotential_share)
    found = np.minimum(np.maximum(before, 0.0), np.hypot(OVERPOTENTIAL_STD, 0.25 * np.sqrt(shape)))
    return tuple(found.tolist()) if found.ndim else float(found)


def pulse_ohm(model: Thevenin) -> float:
    """Resistance [ohm] to ten seconds of 1 C at half charge and the temperature of the file."""
    return float(pulse_ohm_along(model, np.array([_HALF]))[0])


def pulse_ohm_along(model: Thevenin, soc: np.ndarray) -> np.ndarray:
    """Resistance [ohm] to ten seconds of 1 C at these states of charge and the temperature of the file."""
    u = CircuitInput(-model.capacity_Ah, model.reference_degC)
    x = next_state(at_rest(soc, model), u, model, PULSE_S)
    x[0] = soc
    ohm = sum(overpotentials(x, u, model)) / u.current_A
    return ohm + mean_slope_V(model.ocv, soc) * PULSE_S / model.capacity_As


#: Beginnings of the sentences of a label; those of a test stay as they are.
_OF_A_LABEL = ("everything", "capacity: ", "resistances: ", "open-circuit voltage: ")
#: A curve that is known down to this SoC is known to its end.
_SEEN_TO_THE_END = 0.02


class KnownBattery(NamedTuple):
    """Quantities of a battery file with their standard deviations."""

    capacity_Ah: Normal  #: with the gain error of the current sensor, which cannot be separated from it
    resistance_ohm: Normal  #: to ten seconds of 1 C at half charge and the temperature of the file
    offset_A: Normal  #: reading of the current sensor at zero current
    #: (21,) standard deviation of the open-circuit curve that the estimators assume, from SoC 0 to 1
    ocv_std_V: np.ndarray
    #: number and length of the logs that it has learnt from
    logs: int
    hours: float


def known(battery: Battery) -> KnownBattery:
    """Quantities of a battery file with their standard deviations."""
    p, covariance = parameters_of(battery), prior_covariance(battery)
    # counted by this sensor, and once more by one without its gain: as the filters have it
    counted_std = math.hypot(capacity_std(battery, covariance), battery.sensor.gain_std, battery.sensor.gain_std)
    ohm, offset = pulse_ohm(battery.thevenin), p.group("offset")
    return KnownBattery(
        Normal(battery.capacity_Ah, battery.capacity_Ah * counted_std),
        Normal(ohm, ohm * resistance_std(battery, covariance)),
        Normal(battery.sensor.offset_A, float(np.sqrt(covariance[offset, offset].sum()))),
        ocv_std_V(battery, RESISTANCE_GRID),
        len(battery.learnt_logs),
        sum(log.hours for log in battery.learnt_logs),
    )


def ocv_std_V(battery: Battery, soc: Any) -> np.ndarray:
    """Standard deviation of the open-circuit curve [V] that the estimators assume, its SoC axis included."""
    model = battery.thevenin
    slope_V = np.gradient(np.asarray(model.ocv.mean_V(soc, model.reference_degC)), soc)
    return np.hypot(np.asarray(battery.noise.model_std_at(soc)), slope_V * battery.noise.axis_std_at(soc))


def not_identified_sentences(battery: Battery) -> tuple[str, ...]:
    """The sentences on what is not identified, those of a label updated to what the battery has learnt."""
    others = tuple(text for text in battery.not_identified if not text.startswith(_OF_A_LABEL))
    if battery.knowledge is None or not any(text.startswith(_OF_A_LABEL[0]) for text in battery.not_identified):
        return battery.not_identified
    found, seen_soc = known(battery), battery.knowledge.seen_from_soc
    capacity = BAND_95 * found.capacity_Ah.relative_std
    resistance = np.exp(BAND_95 * found.resistance_ohm.relative_std)
    kind = f"cells of {chemistry(battery.chemistry).title}" if battery.chemistry else "batteries"
    sentences = [
        f"everything that no log has shown: start values that {kind} have in common",
        f"capacity: learnt within ± {capacity:.0%} (95 %) from {found.logs} log{'s' * (found.logs != 1)}",
        f"resistances: learnt within a factor of {resistance:.2f} (95 %)",
    ]
    if seen_soc == 1.0:
        sentences.append("open-circuit voltage: that of the file, as no log shows its state of charge well enough")
    elif seen_soc > _SEEN_TO_THE_END:
        sentences.append(f"open-circuit voltage: no log went below {seen_soc:.0%} of charge")
    return (*sentences, *others)
