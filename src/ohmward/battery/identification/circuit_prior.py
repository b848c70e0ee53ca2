"""Prior of the linear unknowns of the circuit, by what cells of a chemistry have in common."""

from __future__ import annotations

from typing import Any

import numpy as np

from ohmward.battery.chemistries import ChemistryPrior, CurvePrior
from ohmward.battery.identification.circuit_design import (
    ENTROPY_KNOTS,
    OCV_KNOTS,
    RESISTANCE_GRID,
    ParameterLayout,
)
from ohmward.battery.models.noise import on_soc_grid
from ohmward.battery.models.ocv import OcvCurve, correlation
from ohmward.battery.posterior import Gaussian

#: Error of the curve as a share of the half gap of its branches: the truth lies between them, not in the middle.
_GAP_SHARE = 0.5
#: Width of the curve's temperature slope where low-rate tests measured it, over that where they did not: their branches
#: hold overpotential, which changes with temperature as well.
_MEASURED_SLOPE = 0.5
#: Correlation length of that slope along SoC: a stage of graphite.
ENTROPY_LENGTH = 0.2


def nuisance_prior(
    prior: ChemistryPrior, layout: ParameterLayout, ocv: OcvCurve, at_rest: list[bool], volts: float
) -> Gaussian:
    """The prior of all but the resistances: hysteresis, OCV correction, states at the start of each record.

    at_rest: for each record, True where it starts with a rest.
    volts: voltage of the battery over that of a lithium-ion cell.
    """
    precision = np.zeros((layout.size, layout.size))
    information = np.zeros(layout.size)
    if layout.hysteresis:
        mean, std = prior.hysteresis.share
        precision[layout.scale, layout.scale] += 1 / std**2
        information[layout.scale] += mean / std**2
    precision[layout.correction, layout.correction] += ocv_precision(prior.curve, ocv, volts)
    if layout.entropy:
        precision[layout.entropic, layout.entropic] += entropy_precision(prior, ocv, volts)
    for record, rests in enumerate(at_rest):
        where = layout.initial(record)
        start_V = np.full(layout.pairs, volts * (prior.rest_V if rests else prior.start_V))
        std_of_start = np.concatenate([start_V, np.full(int(layout.hysteresis), prior.hysteresis.share.mean)])
        precision[where, where] += np.diag(1 / std_of_start**2)
    return Gaussian(precision, information)


def resistance_prior(
    prior: ChemistryPrior, layout: ParameterLayout, levels: np.ndarray, shapes: np.ndarray
) -> Gaussian:
    """The prior of the resistances: random walks along SoC about a level, r0 alike in both directions.

    levels: (2 + n,) level of each resistance [ohm]; shapes: (2 + n, 21) its expected course along SoC, about 1.
    """
    precision = np.zeros((layout.size, layout.size))
    information = np.zeros(layout.size)
    for j in range(layout.blocks):
        add_rows(precision, layout.block(j), _walk(prior, levels[j]) / shapes[j])
        if j != 1:
            row = 1 / (prior.level_share * levels[j] * RESISTANCE_GRID.size * shapes[j])
            add_rows(precision, layout.block(j), row[None, :])
            information[layout.block(j)] += row / prior.level_share
    _tie_directions(precision, layout, prior.direction_share * levels[0])
    return Gaussian(precision, information)


def ocv_precision(prior: CurvePrior, ocv: OcvCurve, volts: float) -> np.ndarray:
    """(K, K) precision of the OCV correction on OCV_KNOTS: exponential correlation, wider where steep."""
    slope = np.abs(np.gradient(np.asarray(ocv.mean_V(OCV_KNOTS, ocv.reference_degC)), OCV_KNOTS))
    gap = np.asarray(ocv.hysteresis_at(OCV_KNOTS))
    axis = np.hypot(prior.soc_std, prior.middle_soc_std * axis_bridge(OCV_KNOTS))
    own_V = np.hypot(volts * on_soc_grid(prior.std_V, OCV_KNOTS), prior.line_std_V)
    std = np.sqrt(own_V**2 + (axis * slope) ** 2 + (_GAP_SHARE * gap) ** 2)
    return np.linalg.inv(std[:, None] * correlation(OCV_KNOTS, prior.soc_length) * std)


def entropy_precision(prior: ChemistryPrior, ocv: OcvCurve, volts: float) -> np.ndarray:
    """(K, K) precision of the change of the OCV curve with temperature on ENTROPY_KNOTS."""
    return np.linalg.inv(entropy_std(prior, ocv, volts) ** 2 * correlation(ENTROPY_KNOTS, ENTROPY_LENGTH))


def entropy_std(prior: ChemistryPrior, ocv: OcvCurve, volts: float) -> float:
    """Prior standard deviation of that change [V/K]: less where low-rate tests at two temperatures have measured it."""
    usual = volts * prior.ocv_std_V_per_K
    return _MEASURED_SLOPE * usual if any(ocv.temperature_V_per_K) else usual


def axis_bridge(soc: Any) -> Any:
    """Course along SoC of an error of the axis that is 0 where the battery is full or empty, and 1 in the middle."""
    inside = np.clip(soc, 0.0, 1.0)
    return 2 * np.sqrt(inside * (1 - inside))


def add_rows(precision: np.ndarray, where: slice, rows: np.ndarray) -> None:
    """Add the precision of `rows` @ x[where] ~ N(., 1) to precision (K, K), in place."""
    precision[where, where] += rows.T @ rows


def _walk(prior: ChemistryPrior, level: float) -> np.ndarray:
    """(20, 21) differences of neighbouring grid points over their standard deviation."""
    std = prior.walk_share * level * np.sqrt(np.diff(RESISTANCE_GRID) / 0.1)
    return np.diff(np.eye(RESISTANCE_GRID.size), axis=0) / std[:, None]


def _tie_directions(precision: np.ndarray, layout: ParameterLayout, std_ohm: float) -> None:
    discharge, charge = layout.block(0), layout.block(1)
    tie = np.eye(RESISTANCE_GRID.size) / std_ohm**2
    precision[discharge, discharge] += tie
    precision[charge, charge] += tie
    precision[discharge, charge] -= tie
    precision[charge, discharge] -= tie
