"""Battery of a type: from several tested ones of a product to one that was not tested.

What the tested ones have in common is the new file, and what they differ by is its doubt. With n of them, a value x of
the type is their mean, and that of another battery is off by

s^2 (1 + 1/n),   s^2 = (k s_0^2 + sum (x_i - mean)^2) / (k + n - 1),

with the usual spread s_0 between batteries of one product, which counts as k of them; a pack of m such cells has the
mean of m, s^2 (1/m + 1/n).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ohmward.battery.battery import Battery, Provenance, require_battery
from ohmward.battery.cells.cell_filter import CellSpread
from ohmward.battery.health.health import NEW_CAPACITY_STD
from ohmward.battery.identification.log_details import MOST_OF_RANGE
from ohmward.battery.models.noise import BatteryNoise, usual_sensor
from ohmward.battery.models.ocv import OCV_GRID, OcvCurve, monotone
from ohmward.battery.models.thevenin import Thevenin
from ohmward.battery.soc.thevenin_filter import LEAST_CAPACITY, MOST_CAPACITY
from ohmward.errors import InputError

#: Number of batteries that the usual spread counts as.
_USUAL_COUNT = 2.0
#: Usual spread of the logarithm of the resistances between new batteries of one product, see `CellSpread`.
_NEW_RESISTANCE_STD = 0.06


def battery_of_type(batteries: Sequence[Battery], n_series: int | None = None, label: str = "") -> Battery:
    """Battery of the type of these, identified one by one; another one of this type begins with it.

    >>> battery_of_type([ow.load_battery("a.toml"), ow.load_battery("b.toml")], n_series=4)       # doctest: +SKIP

    n_series: its cells in series, where these are single cells or packs of fewer; None for as many as they have.
    label: its name; by default "type of" and the first one's.

    Raises:
        InputError: fewer than two, one of them twice, of several chemistries, with different numbers of cells or of RC
            pairs, with capacities or curves that no product has, or `n_series` is not a multiple of theirs.
    """
    for battery in batteries:
        require_battery(battery)
    if len(batteries) < 2:
        raise InputError("a type needs the files of two batteries or more; identify each from its own tests")
    _require_alike(batteries)
    first = batteries[0]
    packed = first.n_series if n_series is None else n_series
    if packed < 1 or packed % first.n_series:
        raise InputError(f"n_series must be a multiple of that of the files, {first.n_series}, got {packed}")
    several = packed // first.n_series
    model = _model([battery.thevenin for battery in batteries])
    names = ", ".join(battery.name for battery in batteries)
    return Battery(
        name=label or f"type of {first.name}",
        capacity_Ah=model.capacity_Ah,
        chemistry=first.chemistry,
        n_series=packed,
        voltage_min_V=several * min(battery.voltage_min_V for battery in batteries),
        voltage_max_V=several * max(battery.voltage_max_V for battery in batteries),
        thevenin=model.in_series(several),
        noise=_noise(batteries, model, several),
        sensor=usual_sensor(model.capacity_Ah),
        identification=Provenance(model.capacity_Ah, notes=(f"of the type of {len(batteries)} batteries: {names}",)),
        not_identified=tuple(dict.fromkeys(text for battery in batteries for text in battery.not_identified)),
    )


def _require_alike(batteries: Sequence[Battery]) -> None:
    if copies := [b.name for b in batteries if batteries.count(b) > 1]:
        raise InputError(f"{copies[0]} is given twice; a type needs several batteries, each with a file of its own")
    chemistries, cells = [b.chemistry or "unknown" for b in batteries], [b.n_series for b in batteries]
    pairs, capacities_Ah = [b.thevenin.pairs for b in batteries], [b.capacity_Ah for b in batteries]
    ocv = batteries[0].thevenin.ocv
    curves_V = np.array([b.thevenin.ocv.mean_V(OCV_GRID, ocv.reference_degC) for b in batteries])
    off_V = np.sqrt(np.mean((curves_V - np.median(curves_V, axis=0)) ** 2, axis=1))
    for what, found, differ, fix in (
        ("chemistry", chemistries, len(set(chemistries)) > 1, "a type has one; leave the others out"),
        ("number of cells in series", cells, len(set(cells)) > 1, "identify all with the same --n-series"),
        ("number of RC pairs", pairs, len(set(pairs)) > 1, "identify all with --model thevenin-2rc"),
        (
            "capacity",
            [f"{capacity_Ah:.4g} Ah" for capacity_Ah in capacities_Ah],
            LEAST_CAPACITY * max(capacities_Ah) > MOST_CAPACITY * min(capacities_Ah),
            "no two of a product do; is one in mAh, or of another product?",
        ),
        (
            "open-circuit voltage",
            [f"{1e3 * each_V:.0f} mV" for each_V in off_V],
            off_V.max() > MOST_OF_RANGE * (ocv.voltage_V[-1] - ocv.voltage_V[0]),
            "RMS from the middle one; is one of another chemistry?",
        ),
    ):
        if differ:
            each = ", ".join(f"{b.name} {value}" for b, value in zip(batteries, found, strict=True))
            raise InputError(f"the batteries of a type differ in their {what}: {each}; {fix}")


def _model(models: Sequence[Thevenin]) -> Thevenin:
    """The mean circuit at the reference temperature of the first; of what cannot be negative the geometric mean."""
    first, grid = models[0], np.linspace(0.0, 1.0, max(len(model.r0_discharge_ohm) for model in models))
    degC = first.reference_degC

    def on_grid(row: Sequence[float]) -> np.ndarray:
        return np.interp(grid, np.linspace(0.0, 1.0, len(row)), row)

    def mean(name: str) -> float:
        return float(np.mean([getattr(model, name) for model in models]))

    def mean_if_all(name: str) -> float | None:
        return None if any(getattr(model, name) is None for model in models) else mean(name)

    ohmic = [(model, model.arrhenius_factor(degC)) for model in models]
    pairs = [(model, model.pair_arrhenius_factor(degC) * model.emptying_factor(grid, degC)) for model in models]
    branches = {model.tested_branch for model in models}
    return replace(
        first,
        capacity_Ah=_geometric([model.capacity_Ah for model in models]).item(),
        ocv=_curve([model.ocv for model in models]),
        r0_discharge_ohm=tuple(_geometric([f * on_grid(model.r0_discharge_ohm) for model, f in ohmic]).tolist()),
        r0_charge_ohm=tuple(_geometric([f * on_grid(model.r0_charge_ohm) for model, f in ohmic]).tolist()),
        r_ohm=tuple(
            tuple(_geometric([f * on_grid(model.r_ohm[j]) for model, f in pairs]).tolist()) for j in range(first.pairs)
        ),
        tau_s=tuple(
            _geometric([model.tau_s[j] / model.rate_arrhenius_factor(degC) for model in models]).item()
            for j in range(first.pairs)
        ),
        hysteresis_rate=_geometric([model.hysteresis_rate for model in models]).item(),
        coulombic_efficiency=mean("coulombic_efficiency"),
        activation_K=mean("activation_K"),
        pair_activation_K=mean("activation_of_pairs_K"),
        tau_activation_K=mean("tau_activation_K"),
        empty_activation_K=mean("empty_activation_K"),
        hysteresis_activation_K=mean("hysteresis_activation_K"),
        gassing_V=mean_if_all("gassing_V"),
        transfer_V=mean_if_all("transfer_V"),
        ocv_slip=mean("ocv_slip"),
        tested_branch=branches.pop() if len(branches) == 1 else 0.0,
    )


def _curve(curves: Sequence[OcvCurve]) -> OcvCurve:
    """The mean curve at the reference temperature of the first."""
    first = curves[0]
    voltage_V = np.mean([curve.mean_V(OCV_GRID, first.reference_degC) for curve in curves], axis=0)
    slope = np.mean([curve.mean_V(OCV_GRID, 1.0) - curve.mean_V(OCV_GRID, 0.0) for curve in curves], axis=0)
    hysteresis_V = np.mean([curve.hysteresis_at(OCV_GRID) for curve in curves], axis=0)
    return replace(
        first,
        voltage_V=tuple(monotone(voltage_V).tolist()),
        hysteresis_V=tuple(np.maximum(hysteresis_V, 0.0).tolist()),
        temperature_V_per_K=tuple(slope.tolist()),
    )


def _noise(batteries: Sequence[Battery], model: Thevenin, several: int) -> BatteryNoise:
    """Noise of one more of the type, made of `several` of these in series."""
    noises, usual = [battery.noise for battery in batteries], CellSpread()
    of_one = math.sqrt(1.0 + 1.0 / len(batteries))
    of_mean = math.sqrt(1.0 / several + 1.0 / len(batteries))
    cells, degC = batteries[0].n_series, model.reference_degC

    def rms(name: str) -> float:
        return float(np.sqrt(np.mean([getattr(noise, name) ** 2 for noise in noises])))

    measured = [b.identification.capacity_measured_Ah if b.identification else 0.0 for b in batteries]
    capacities_Ah = [own or battery.capacity_Ah for own, battery in zip(measured, batteries, strict=True)]
    capacity_std = of_one * _spread(np.log(capacities_Ah), NEW_CAPACITY_STD).item()
    ohm = [b.thevenin.arrhenius_factor(degC) * b.thevenin.largest_ohm for b in batteries]
    resistance_std = of_mean * _spread(np.log(ohm), _NEW_RESISTANCE_STD).item()
    curves_V = np.array([battery.thevenin.ocv.mean_V(OCV_GRID, degC) for battery in batteries])
    apart_V = of_mean * _spread(curves_V, cells * usual.curve_std_V)
    own_V = np.sqrt(np.mean([noise.model_std_at(OCV_GRID) ** 2 for noise in noises], axis=0))
    shares = [noise.overpotential_share_at(OCV_GRID) + np.zeros(OCV_GRID.size) for noise in noises]
    dates = [noise.capacity_known_unix_s for noise in noises]
    return replace(
        noises[0],
        voltage_std_V=several * rms("voltage_std_V"),
        model_std_V=tuple((several * np.hypot(own_V, apart_V)).tolist()),
        overpotential_share=tuple(np.sqrt(np.mean(np.square(shares), axis=0)).tolist()),
        soc_axis_std=math.hypot(rms("soc_axis_std"), of_mean * usual.soc_axis_std),
        level_std_V=several * rms("level_std_V"),
        capacity_std=math.hypot(rms("capacity_std"), capacity_std),
        capacity_known_unix_s=max(dates) if all(dates) else 0.0,
        capacity_known_std=math.hypot(rms("capacity_known_std"), capacity_std),
        resistance_std=math.hypot(rms("resistance_std"), resistance_std),
        activation_std_K=math.hypot(
            rms("activation_std_K"), float(np.std([battery.thevenin.activation_K for battery in batteries], ddof=1))
        ),
        hysteresis_std=rms("hysteresis_std"),
        ocv_std_V_per_K=several * rms("ocv_std_V_per_K"),
    )


def _geometric(values: Sequence[float] | Sequence[np.ndarray]) -> np.ndarray:
    """Geometric mean; 0 where one is 0."""
    with np.errstate(divide="ignore"):
        return np.asarray(np.exp(np.mean(np.log(values), axis=0)))


def _spread(values: np.ndarray, usual: float) -> np.ndarray:
    """Spread (...) between batteries (n, ...), with the usual one as a prior."""
    squares = np.sum((values - values.mean(axis=0)) ** 2, axis=0)
    return np.asarray(np.sqrt((_USUAL_COUNT * usual**2 + squares) / (_USUAL_COUNT + len(values) - 1)))
