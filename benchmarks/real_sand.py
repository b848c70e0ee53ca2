"""One smooth wheel in sand (CMU single-wheel testbed): which law of traction serves, and what books would have said.

27 steady trials without slip angle: nine slips, three repetitions each, 10 mm/s of travel. Drawbar pull is -Fy of the
sensor, load -Fz; slips are those of the measured rim speed (the command of 12 mm/s ran at 13). Errors are those of a
slip that the fit has not seen; in the rows "chosen" the choice of the law has not seen it either.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from figure import Figure, at_most, rms
from ohmward.traction.friction.law import SoftGround, contact, direction_and_size, mean_shear
from ohmward.traction.friction.terrain import SOILS
from ohmward_lab.traction.friction_fit import (
    Family,
    ForceSlip,
    LawFit,
    brush,
    burckhardt,
    coulomb_creep,
    fit_law,
    lack_of_fit,
    left_out_errors_N,
    select_law,
    soft_ground,
    ward_iagnemma,
    ward_iagnemma_with_slope,
)
from real_data import columns

DATA = "CMU wheel in sand"
RADIUS_M, WIDTH_M = 0.058, 0.05
#: The wheel travels at 10 mm/s; slip ratios are meant down to a tenth of that.
SPEED_FLOOR_M_S = 1e-3
#: Intervals of a law that the scatter of repetitions contradicts so clearly would mean nothing.
DOUBTED = 0.01
FAMILIES: tuple[Family, ...] = (
    ward_iagnemma(),
    ward_iagnemma_with_slope(),
    burckhardt(SPEED_FLOOR_M_S),
    brush(speed_floor_m_s=SPEED_FLOOR_M_S),
    coulomb_creep(),
    soft_ground(SOILS["firm soil"], RADIUS_M, WIDTH_M, SPEED_FLOOR_M_S),
)


class Trials(NamedTuple):
    """data: forces and contacts; group: (n,) commanded rim speed [m/s]; sinkage_m: (n,)."""

    data: ForceSlip
    group: np.ndarray
    sinkage_m: np.ndarray

    def pick(self, chosen: np.ndarray) -> Trials:
        return Trials(self.data.pick(chosen), self.group[chosen], self.sinkage_m[chosen])


def rows() -> Iterator[Figure]:
    trials = recording()
    branches = {"driving": trials.pick(trials.group >= 0.01), "braking": trials.pick(trials.group <= 0.01)}
    for branch, chosen in branches.items():
        yield from branch_figures(f"{DATA}, {branch}", chosen)
    yield from prior_figures(branches)
    yield from sinkage_figures(trials)


def recording() -> Trials:
    """The trials without slip angle, in SI units."""
    raw = columns("cmu_single_wheel_sand/smooth_wheel.csv")
    raw = {name: values[raw["beta"] == 0] for name, values in raw.items()}
    at = contact(1e-3 * raw["avg_Vry"], 1e-3 * raw["avg_Vx"], -raw["avg_Fz"])
    return Trials(ForceSlip(at, -raw["avg_Fy"]), 1e-3 * raw["Vry"], -1e-3 * raw["avg_Z"])


def branch_figures(data: str, trials: Trials) -> Iterator[Figure]:
    forces, group = trials.data, trials.group
    scatter_N = rms(np.array([np.std(forces.force_N[group == g], ddof=1) for g in np.unique(group)]))
    yield at_most(data, "three repetitions", "scatter of the force [N]", scatter_N)
    for family in FAMILIES:
        fit = fit_law(forces, family)
        unseen = left_out_errors_N(forces, group, lambda seen, _, family=family: fit_law(seen, family))
        chance = lack_of_fit(fit, forces, group)
        errors = f"{rms(unseen):.2f}, {fit.rmse_N:.2f}, {chance:.1g}"
        yield Figure(data, family.name, "error on unseen slips, on seen ones [N], p of lack of fit", errors)
        if chance > DOUBTED:
            yield Figure(data, family.name, "parameters, 95 %", parameters(fit))
    unseen = left_out_errors_N(forces, group, lambda seen, labels: select_law(seen, FAMILIES, labels))
    yield at_most(
        data, f"chosen: {select_law(forces, FAMILIES, group).family}", "error on unseen slips [N]", rms(unseen)
    )


def parameters(fit: LawFit) -> str:
    return ", ".join(
        f"{i.name} {i.value:.3g} ({i.low:.2g} to {i.high:.2g}{'' if i.identified else ', not identified'})"
        for i in fit.intervals
    )


def prior_figures(branches: dict[str, Trials]) -> Iterator[Figure]:
    """Soils of public demonstrations under this wheel, compaction taken off, without any fit."""
    for name, soil in SOILS.items():
        ground = SoftGround(soil, RADIUS_M, WIDTH_M, SPEED_FLOOR_M_S)
        for branch, trials in branches.items():
            at = trials.data.contact
            error_N = ground.force_N(at) - ground.compaction_N(at.load_N) - trials.data.force_N
            yield at_most(f"{DATA}, {branch}", f"{name}, not fitted", "error of the force [N]", rms(error_N))


def sinkage_figures(trials: Trials) -> Iterator[Figure]:
    """Both branches at once, given how deep the wheel stood: F = N tan phi shear(i l(z)/K) - R (z/20 mm)^2.

    The pressure of soil that is pushed away grows with its depth (Rankine), so the force on it with the square.
    """
    unseen = np.empty(len(trials.group))
    for group in np.unique(trials.group):
        out = trials.group == group
        unseen[out] = pull_N(fit_sinkage(trials.pick(~out)), trials.pick(out)) - trials.data.force_N[out]
    tan_phi, shear_m, resistance_N = fit_sinkage(trials)
    found = f"phi {np.degrees(np.arctan(tan_phi)):.1f} deg, K {1e3 * shear_m:.1f} mm, R {resistance_N:.1f} N"
    method = "Janosi, resistance with the square of the measured sinkage"
    yield at_most(f"{DATA}, both", method, "error on unseen slips [N]", rms(unseen))
    yield Figure(f"{DATA}, both", method, "parameters", found)


def fit_sinkage(trials: Trials) -> np.ndarray:
    """tan phi, K [m], R [N]."""
    from scipy.optimize import least_squares

    limits = [0.0, 1e-4, 0.0], [2.0, 1.0, 50.0]
    start = [0.5, 0.01, 4.0]
    return least_squares(lambda p: pull_N(p, trials) - trials.data.force_N, start, bounds=limits, x_scale=start).x


def pull_N(p: np.ndarray, trials: Trials) -> np.ndarray:
    """Drawbar pull with these parameters at the measured sinkage; l = sqrt(z (2 r - z))."""
    tan_phi, shear_m, resistance_N = p
    at, z = trials.data.contact, trials.sinkage_m
    direction, creep = direction_and_size(at.slip_speed_m_s / np.maximum(at.rim_speed_m_s, SPEED_FLOOR_M_S))
    shear = mean_shear(creep * np.sqrt(z * (2 * RADIUS_M - z)) / shear_m)
    return direction * at.load_N * tan_phi * shear - resistance_N * (z / 0.02) ** 2
