"""Prior of the circuit. It regularises where data are thin, and so gives honest covariances.

Volts are relative to a lithium-ion cell of 3.7 V, so that a pack or a lead-acid battery needs no other numbers.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.chemistries import ChemistryPrior, chemistry_prior
from ohmward.battery.identification.circuit_design import (
    ENTROPY_KNOTS,
    OCV_KNOTS,
    RESISTANCE_GRID,
    ParameterLayout,
)
from ohmward.battery.models.ocv import OcvCurve, correlation
from ohmward.battery.posterior import Gaussian


class CircuitPrior(NamedTuple):
    """Standard deviations of the prior."""

    walk_share: float = 0.25  #: of a resistance over 0.1 of SoC, as a share of its level; a random walk along SoC
    level_share: float = 1.0  #: of the level itself
    direction_share: float = 0.1  #: between r0 in charge and in discharge
    #: of the OCV curve: voltage, and error of its SoC axis; correlated over `ocv_length` of SoC
    ocv_V: float = 0.004
    ocv_soc: float = 0.01
    ocv_line_std_V: Any = 0.0  #: error on OCV_KNOTS of a straight line beyond its logs, of the battery [V]
    ocv_axis_std: float = 0.0  #: error of its SoC axis in the middle that two branches leave open, see `axis_bridge`
    ocv_gap: float = 0.5  #: again, as a share of the half gap: the truth lies between the branches, not in the middle
    ocv_length: float = 0.05
    #: mean and std of the scale ms of the hysteresis; the low-rate gap holds slow overpotential as well
    hysteresis: tuple[float, float] = (0.5, 0.2)
    #: slowest of several time constants, log-normal
    slow_tau_s: float = 700.0
    slow_tau_log_std: float = 0.6
    #: gamma, log-normal
    hysteresis_rate: float = 40.0
    hysteresis_rate_log_std: float = 0.7
    #: error of the model over that of a lithium-ion cell, in a discharge, and in a charge and the rest after it
    discharging_factor: float = 1.0
    charging_factor: float = 1.0
    #: in a charge and the rest after it above this SoC, where part of the charge makes gas
    gassing_factor: float = 1.0
    gassing_soc: float = 0.85
    #: of each RC voltage at the start of a record that starts at rest, or not
    rest_V: float = 0.002
    start_V: float = 0.03
    model_V: float = 0.003  #: error of the model at any SoC, however well it fits
    seeks_transfer: bool = True  #: True where tests at two temperatures show how charge transfer bends the ohmic drop
    #: True where the low-rate branches are records of the fit, and tell hysteresis from slow processes
    fits_branches: bool = False
    #: activations and temperature of the curve, where the data do not show them
    untested: ChemistryPrior = chemistry_prior("")
    model_soc_length: float = 0.1  #: correlation length of the error `model_V`
    #: the same error, at least, where short pulses are all there is: they show only the start of a slow process
    pulses_V: float = 0.008


# On the plateau of iron phosphate hysteresis and a slow overpotential look alike in a drive that discharges: with
# either the residual is the same, and only a charge tells them apart. So the prior holds their split, and the noise has
# its width. Half the gap of an A123 cell at C/30 is 17 mV at 25, 25 at 5 and 50 at -15 degC: 12 mV and a resistance.
# Models of two LFP cells err by 6 to 17 mV (mean over 10 min) on other records, where they fit their own within 4.
_IRON_PHOSPHATE = CircuitPrior(hysteresis=(0.4, 0.05), hysteresis_rate=15.0, hysteresis_rate_log_std=0.5, model_V=0.004)

#: The same where a drive and a given curve are all there is: the residual of one record is the best case.
LFP_WITHOUT_LOW_RATE_V = 0.008


#: Width of the curve's temperature slope where low-rate tests measured it, over that where they did not: their branches
#: hold overpotential, which changes with temperature as well.
_MEASURED_SLOPE = 0.5
#: Correlation length of that slope along SoC: a stage of graphite.
ENTROPY_LENGTH = 0.2

#: Walk of its resistances where rests gave the curve: between two rests, a resistance that may wander takes what the
#: curve does there. From pulses at 25 degC, four simulated cells: RMSE 1.3 % with 0.25, 0.8 % with half of it.
LFP_WALK_FROM_RESTS = 0.12


class SlowestPair(NamedTuple):
    """Prior of the slowest time constant: median [s] and standard deviation of its logarithm."""

    tau_s: float
    log_std: float


# Iron phosphate is slow on its plateau: a pair of a few hundred seconds fits a drive as well, and then fails elsewhere.
# The acid of a lead-acid battery diffuses for hours; in a day of work that is worth a tenth of its charge.
SLOW = {"lfp": SlowestPair(2200.0, 0.3), "lead-acid": SlowestPair(7200.0, 0.3)}


def prior_for(chemistry: str, ocv_from_low_rate: bool) -> CircuitPrior:
    """Prior for a chemistry and for the way in which the OCV curve was measured."""
    prior = CircuitPrior() if ocv_from_low_rate else CircuitPrior(ocv_V=0.010, ocv_soc=0.02)
    if chemistry == "lfp":
        prior = _IRON_PHOSPHATE._replace(ocv_V=prior.ocv_V, ocv_soc=prior.ocv_soc)
    if chemistry == "lead-acid":
        # Charging is another reaction than discharging and makes gas near full; no two discharges are quite alike. The
        # curve has no phases, so what is wrong with it here is wrong over half of the charge: with a length of 0.1 such
        # an error would average out in one discharge, and 80 % of the truth were covered instead of 98.
        prior = CircuitPrior(
            ocv_V=0.020,
            ocv_soc=0.03,
            ocv_length=0.3,
            direction_share=1.0,
            discharging_factor=2.0,
            charging_factor=6.0,
            gassing_factor=100.0,
            model_V=0.005,
            seeks_transfer=False,
            model_soc_length=0.5,
            pulses_V=0.005,
        )
    slow = SLOW.get(chemistry, SlowestPair(prior.slow_tau_s, prior.slow_tau_log_std))
    return prior._replace(slow_tau_s=slow.tau_s, slow_tau_log_std=slow.log_std, untested=chemistry_prior(chemistry))


def with_branches(prior: CircuitPrior) -> CircuitPrior:
    """The prior of iron phosphate where the circuit is fitted to a low-rate discharge and charge as well.

    Their current is another one, which tells hysteresis from a slow overpotential: then 0.71 to 0.87 of the gap of an
    A123 cell at -15 to 45 degC is hysteresis, which turns over with 2/17 of the charge.
    """
    return prior._replace(hysteresis=(0.8, 0.15), hysteresis_rate=18.0, hysteresis_rate_log_std=0.3, fits_branches=True)


def nuisance_prior(
    prior: CircuitPrior, layout: ParameterLayout, ocv: OcvCurve, at_rest: list[bool], volts: float
) -> Gaussian:
    """The prior of all but the resistances: hysteresis, OCV correction, states at the start of each record.

    at_rest: for each record, True where it starts with a rest.
    volts: voltage of the battery over that of a lithium-ion cell.
    """
    precision = np.zeros((layout.size, layout.size))
    information = np.zeros(layout.size)
    if layout.hysteresis:
        mean, std = prior.hysteresis
        precision[layout.scale, layout.scale] += 1 / std**2
        information[layout.scale] += mean / std**2
    precision[layout.correction, layout.correction] += ocv_precision(prior, ocv, volts)
    if layout.entropy:
        precision[layout.entropic, layout.entropic] += entropy_precision(prior, ocv, volts)
    for record, rests in enumerate(at_rest):
        where = layout.initial(record)
        start_V = np.full(layout.pairs, volts * (prior.rest_V if rests else prior.start_V))
        std_of_start = np.concatenate([start_V, np.full(int(layout.hysteresis), prior.hysteresis[0])])
        precision[where, where] += np.diag(1 / std_of_start**2)
    return Gaussian(precision, information)


def resistance_prior(prior: CircuitPrior, layout: ParameterLayout, levels: np.ndarray, shapes: np.ndarray) -> Gaussian:
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


def ocv_precision(prior: CircuitPrior, ocv: OcvCurve, volts: float) -> np.ndarray:
    """(K, K) precision of the OCV correction on OCV_KNOTS: exponential correlation, wider where steep."""
    slope = np.abs(np.gradient(np.asarray(ocv.mean_V(OCV_KNOTS, ocv.reference_degC)), OCV_KNOTS))
    gap = np.asarray(ocv.hysteresis_at(OCV_KNOTS))
    axis = np.hypot(prior.ocv_soc, prior.ocv_axis_std * axis_bridge(OCV_KNOTS))
    own_V = np.hypot(volts * prior.ocv_V, prior.ocv_line_std_V)
    std = np.sqrt(own_V**2 + (axis * slope) ** 2 + (prior.ocv_gap * gap) ** 2)
    return np.linalg.inv(std[:, None] * correlation(OCV_KNOTS, prior.ocv_length) * std)


def entropy_precision(prior: CircuitPrior, ocv: OcvCurve, volts: float) -> np.ndarray:
    """(K, K) precision of the change of the OCV curve with temperature on ENTROPY_KNOTS."""
    return np.linalg.inv(entropy_std(prior, ocv, volts) ** 2 * correlation(ENTROPY_KNOTS, ENTROPY_LENGTH))


def entropy_std(prior: CircuitPrior, ocv: OcvCurve, volts: float) -> float:
    """Prior standard deviation of that change [V/K]: less where low-rate tests at two temperatures have measured it."""
    usual = volts * prior.untested.ocv_std_V_per_K
    return _MEASURED_SLOPE * usual if any(ocv.temperature_V_per_K) else usual


def axis_bridge(soc: Any) -> Any:
    """Course along SoC of an error of the axis that is 0 where the battery is full or empty, and 1 in the middle."""
    inside = np.clip(soc, 0.0, 1.0)
    return 2 * np.sqrt(inside * (1 - inside))


def add_rows(precision: np.ndarray, where: slice, rows: np.ndarray) -> None:
    """Add the precision of `rows` @ x[where] ~ N(., 1) to precision (K, K), in place."""
    precision[where, where] += rows.T @ rows


def _walk(prior: CircuitPrior, level: float) -> np.ndarray:
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
