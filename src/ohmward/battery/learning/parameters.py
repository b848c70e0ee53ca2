"""Parameters that a battery learns, each the correction of a value in its file, and their prior covariance.

All corrections are 0 for the file as it stands, so that the prior has mean 0. Logarithms keep resistances and
capacity positive, and make twice a value as likely as half of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.models.noise import RESISTANCE_CORRELATION, BatteryNoise
from ohmward.battery.models.ocv import OcvCurve, correlation
from ohmward.battery.models.thevenin import RESISTANCE_KNOTS, Thevenin
from ohmward.battery.posterior import ENTROPY_KNOTS, ENTROPY_LENGTH, OCV_KNOTS, Unknowns

#: The charger's voltage limit defines a full lithium cell, so that an error of the SoC axis falls to this share of it
#: there, and to no more than chargers differ. A test has shown the limit itself, a label that of the chemistry.
_FULL_SHARE, _MOST_FULL_STD = 1.0 / 3.0, 0.01
#: SoC from which an error of the axis falls towards full, local share of its variance, and correlation length of that:
#: cells differ near full; from 1 to 0.95 the curves of four NMC cells fall by 14 to 52 mV more than the chemistry's.
_FULL_FROM, _LOCAL_SHARE, _LOCAL_LENGTH = 0.95, 0.5, 0.1
#: Correlation length [SoC] of a resistance about its level, and of the axis.
_RESISTANCE_LENGTH, _AXIS_LENGTH = 0.3, 1.0
#: The relative error of the overpotential is a mean over resistances with errors of their own: one resistance at one
#: SoC errs by this multiple of it, and a time constant by the other.
_SHAPE_SHARES, _TAU_SHARES = 2.0, 3.0
#: On RESISTANCE_KNOTS: towards empty resistances differ more, relative to half charge by exp(0.1 to 0.5) in R_0 and by
#: exp(0.4 to 4.6) in the pairs, in full tests of three simulated cells.
_SHAPE_FACTORS = np.array([2.7, 1.6, 1.0, 1.0, 1.0])
#: The acid of a battery that gases goes into its plates: in a full test of a porous one R_0 grows from full on:
#: relative to half charge it is exp(-0.7) there, and exp(0.6), exp(1.0) and exp(1.0) at 0.3, 0.1 and empty.
_GASSING_SHAPE_FACTORS = np.array([4.0, 3.0, 2.0, 1.3, 1.0])
#: Levels of two RC pairs differ from their common level by this share of its error: they share what relaxes.
_PAIR_SHARE = 0.5
#: Error of a coulombic efficiency as a share of what it loses: 1 - 0.97 comes from cells with 1 to 5 %.
_LOSS_SHARE = 0.6

#: Half step of SoC for the slope of the curve, by which an error of the SoC axis moves it: nearly the distance of its
#: knots, so that the slope has no steps there. With steps the capacity would depend on where the knots lie.
SLOPE_WIDTH = 0.02

#: Names of the groups for people.
TITLES = {
    "capacity": "capacity",
    "efficiency": "coulombic efficiency",
    "slip": "slip of the electrodes",
    "ohmic": "ohmic resistance",
    "pair": "resistance of the RC pairs",
    "tau": "time constants",
    "activation": "activation temperatures",
    "empty_activation": "activation towards empty",
    "ocv": "open-circuit voltage",
    "entropy": "change of the curve with temperature",
    "hysteresis": "hysteresis",
    "offset": "offset of the current sensor",
}


class Group(NamedTuple):
    """Parameters of one kind: their names, and their covariance before any log."""

    names: tuple[str, ...]
    covariance: np.ndarray


def parameters_of(battery: Battery) -> Unknowns:
    """The parameters of a battery, without those that its file takes as exact."""
    return _Prior(battery, battery.thevenin).parameters


def prior_covariance(battery: Battery) -> np.ndarray:
    """(K, K) covariance of the corrections: the one learnt, or that of the file's noise before any log."""
    prior = _Prior(battery, battery.thevenin)
    learnt, P = battery.knowledge, prior.covariance
    if learnt is None:
        return P
    names = prior.parameters.names
    # a parameter that the file takes as exact by now is left out of what it has learnt
    still = [k for k, name in enumerate(learnt.names) if name in names]
    # a parameter that the file did not have when it learnt follows the others as before any log
    known = [names.index(learnt.names[k]) for k in still]
    among = np.ix_(known, known)
    follows = np.linalg.solve(P[among], P[known, :])
    follows[:, known] = np.eye(len(known))
    return P + follows.T @ (learnt.matrix[np.ix_(still, still)] - P[among]) @ follows


@dataclass(frozen=True, eq=False)
class _Prior:
    """Covariance of the parameters before any log, from the noise in the file."""

    battery: Battery
    model: Thevenin

    @property
    def noise(self) -> BatteryNoise:
        return self.battery.noise

    @cached_property
    def parameters(self) -> Unknowns:
        groups = self.groups
        return Unknowns(
            {name: len(group.names) for name, group in groups.items()},
            tuple(name for group in groups.values() for name in group.names),
        )

    @property
    def covariance(self) -> np.ndarray:
        groups, parameters = self.groups, self.parameters
        P = np.zeros((parameters.size, parameters.size))
        for name, group in groups.items():
            P[parameters.group(name), parameters.group(name)] = group.covariance
        # the level of R_0 and that of the pairs err together
        shared = RESISTANCE_CORRELATION * self.noise.resistance_std**2
        ohmic, pairs = parameters.group("ohmic"), parameters.group("pair")
        P[ohmic, pairs] = shared
        P[pairs, ohmic] = shared
        # ageing takes capacity where it adds resistance
        capacity = parameters.group("capacity")
        for level in (ohmic, pairs):
            P[capacity, level] = -self.noise.ageing_covariance
            P[level, capacity] = -self.noise.ageing_covariance
        return P

    @cached_property
    def groups(self) -> dict[str, Group]:
        """All groups in their order, without members where the file takes them as exact."""
        noise, model = self.noise, self.model
        lost = 1.0 - model.coulombic_efficiency
        hysteresis_std = noise.hysteresis_std * any(model.ocv.hysteresis_V)
        resistances, pairs = _along(RESISTANCE_KNOTS), range(1, model.pairs + 1)
        return {
            "capacity": _each(["ln capacity"], [np.hypot(noise.capacity_std, self.battery.sensor.gain_std)]),
            "efficiency": _each(["ln efficiency"], [_LOSS_SHARE * lost]),
            "slip": _each(["ocv_slip"], [noise.ocv_slip_std]),
            "ohmic": Group(tuple(f"ln r0 at {at}" for at in resistances), self.ohmic),
            "pair": Group(tuple(f"ln r{j} at {at}" for j in pairs for at in resistances), self.pairs),
            "tau": _each([f"ln tau{j}" for j in pairs], [_TAU_SHARES * self.share] * model.pairs),
            "activation": _each(["activation_K", "pair_activation_K"], [noise.activation_std_K] * 2),
            "empty_activation": _each(["empty_activation_K"], [noise.empty_activation_std_K]),
            "ocv": Group(tuple(f"ocv_V at {at}" for at in _along(OCV_KNOTS)), self.ocv),
            "entropy": self.entropy,
            "hysteresis": _each(["ln hysteresis"], [hysteresis_std]),
            "offset": _each(["offset_A"], [self.battery.sensor.offset_std_A]),
        }

    @property
    def share(self) -> float:
        """Relative error of the overpotential, mean over SoC."""
        return float(np.mean(self.noise.overpotential_share))

    @property
    def shape(self) -> np.ndarray:
        """Covariance of the logarithm of a resistance along SoC about its level."""
        factors = _GASSING_SHAPE_FACTORS if self.model.gassing_V else _SHAPE_FACTORS
        std = _SHAPE_SHARES * self.share * factors
        return np.outer(std, std) * correlation(RESISTANCE_KNOTS, _RESISTANCE_LENGTH)

    @property
    def ohmic(self) -> np.ndarray:
        return self.noise.resistance_std**2 + self.shape

    @property
    def pairs(self) -> np.ndarray:
        level, of_each = self.noise.resistance_std**2, np.eye(self.model.pairs)
        apart = np.kron(_PAIR_SHARE**2 * level * of_each, np.ones_like(self.shape))
        return level + apart + np.kron(of_each, self.shape)

    @property
    def ocv(self) -> np.ndarray:
        std_V = np.asarray(self.noise.model_std_at(OCV_KNOTS))
        curve = np.outer(std_V, std_V) * correlation(OCV_KNOTS, self.noise.model_soc_length)
        whole_std = self.noise.soc_axis_std
        full_std = whole_std if self.model.gassing_V else min(_FULL_SHARE * whole_std, _MOST_FULL_STD)
        axis_std = np.interp(OCV_KNOTS, [_FULL_FROM, 1.0], [whole_std, full_std])
        axis_V = axis_std * mean_slope_V(self.model.ocv, OCV_KNOTS)
        whole, local = (correlation(OCV_KNOTS, length) for length in (_AXIS_LENGTH, _LOCAL_LENGTH))
        return curve + np.outer(axis_V, axis_V) * ((1.0 - _LOCAL_SHARE) * whole + _LOCAL_SHARE * local)

    @property
    def entropy(self) -> Group:
        std = self.noise.ocv_std_V_per_K
        knots = ENTROPY_KNOTS if std else ENTROPY_KNOTS[:0]
        names = tuple(f"ocv_V_per_K at {at}" for at in _along(knots))
        return Group(names, std**2 * correlation(knots, ENTROPY_LENGTH))


def mean_slope_V(ocv: OcvCurve, soc: np.ndarray) -> np.ndarray:
    """Slope of the curve [V per unit of SoC] over `SLOPE_WIDTH` to either side, less at the ends."""
    degC = ocv.reference_degC
    low, high = np.clip(soc - SLOPE_WIDTH, 0.0, 1.0), np.clip(soc + SLOPE_WIDTH, 0.0, 1.0)
    return np.asarray((ocv.mean_V(high, degC) - ocv.mean_V(low, degC)) / (high - low))


def _each(names: list[str], stds: list[float]) -> Group:
    """Independent parameters; those without an error are left out."""
    uncertain = [(name, std) for name, std in zip(names, stds, strict=True) if std > 0.0]
    return Group(tuple(name for name, _ in uncertain), np.diag([std**2 for _, std in uncertain]))


def _along(knots: np.ndarray) -> list[str]:
    return [f"soc {knot:g}" for knot in knots]
