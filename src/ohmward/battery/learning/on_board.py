"""Knowledge that a live estimator has gained on board, folded into the battery file on request.

The filter carries the corrections z that it can see while it runs: the levels of capacity and resistances, activations,
hysteresis and the sensor's offset. Its belief N(m, C) began as N(0, C_0), so the samples have added the information

    J = C^-1 - C_0^-1 >= 0,        b = C^-1 m,

and the parameters theta of the file, of which it sees z = H theta, with their prior N(0, P), become

    P' = P - P H' J (1 + H P H' J)^-1 H P,        theta' = P' H' b.

It learns levels, not curves: what depends on SoC is learnt from logs.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from ohmward.battery.battery import Battery, SeenLog
from ohmward.battery.learning.fold import fold, known_since
from ohmward.battery.learning.learn import aged
from ohmward.battery.learning.parameters import parameters_of, prior_covariance
from ohmward.battery.models.thevenin import CircuitInput
from ohmward.battery.posterior import Unknowns
from ohmward.battery.soc.augmented_thevenin import AugmentedThevenin
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.battery.soc.gaussian_sum import carries_errors
from ohmward.errors import InputError
from ohmward.filters.belief import Belief, unpack
from ohmward.logs.log import SECONDS_PER_HOUR

#: Largest correction, in prior standard deviations of the file: a sensor fault is not ageing.
MOST_CORRECTION_STD = 3.0
#: SoC at which the errors of the file are evaluated; they do not depend on it.
_ANY_SOC = 0.5


def learnt_on_board(battery: Battery, estimator: SocEstimator) -> Battery:
    """The battery file with what its live estimator has learnt since it began; the estimator stays as it is.

    battery: the one that the estimator was made with. The result is complete each time, not added to a previous one.

    Raises:
        InputError: there was no sample yet, the filter carries no such corrections, or it is of another battery.
    """
    system, belief = _belief(estimator)
    pinned = battery.pinned
    if (system.model, system.noise, system.sensor) != (pinned.thevenin, pinned.noise, battery.sensor):
        raise InputError(
            f"battery {battery.name!r} is not the one that this estimator was made with; give that one, its knowledge "
            "is where the estimator began"
        )
    hours = max(estimator.time_s - estimator.memory.start_s, 0.0) / SECONDS_PER_HOUR
    hours = hours if math.isfinite(hours) else 0.0
    p = parameters_of(battery)
    names, H = seen_by_filter(p, system)
    before = aged(battery, hours, 0.0)
    theta, covariance = _posterior(prior_covariance(before), H, *_information(system, belief, names))
    on_board = SeenLog("on board", hours=hours, summary="capacity, resistances and offset, as the filter found them")
    end_unix_s = None if estimator.unix_s is None else estimator.unix_s + SECONDS_PER_HOUR * hours
    found = known_since(fold(before, theta, covariance, 1.0, math.inf), end_unix_s)
    assert found.knowledge is not None
    return replace(found, knowledge=replace(found.knowledge, logs=(*battery.learnt_logs, on_board)))


def seen_by_filter(p: Unknowns, system: AugmentedThevenin) -> tuple[list[str], np.ndarray]:
    """Names of the filter's states that correct the file, and H (n, K): each as a mean of parameters."""
    activation = p.group("activation")
    places = {
        "charge_gain": p.group("capacity"),
        "ohmic_log_ratio": p.group("ohmic"),
        "pair_log_ratio": p.group("pair"),
        "offset_A": p.group("offset"),
        "ohmic_activation_error_K": slice(activation.start, activation.start + 1),
        "pair_activation_error_K": slice(activation.stop - 1, activation.stop),
        "hysteresis_log_ratio": p.group("hysteresis"),
    }
    names = [name for name in system.error_names if name in places and places[name].stop > places[name].start]
    H = np.zeros((len(names), p.size))
    for row, name in zip(H, names, strict=True):
        row[places[name]] = 1.0 / (places[name].stop - places[name].start)
    return names, H


def _belief(estimator: SocEstimator) -> tuple[AugmentedThevenin, Belief]:
    """Model and belief of the estimator; those of a Gaussian sum as one Gaussian."""
    settings: Any = estimator.settings
    if not carries_errors(settings):
        raise InputError(f"{estimator!r} carries no corrections of a battery file; the filters gsf, ekf and ukf do")
    if estimator.state is None:
        raise InputError("nothing was learnt before the first sample; give update() samples first")
    return settings.system, unpack(settings.merged(estimator.state).belief)


def _information(system: AugmentedThevenin, belief: Belief, names: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """Information J (n, n) and vector b (n,) of the samples on these states, from the belief before them and now.

    A direction in which the belief has not narrowed, because it walks, has no information.
    """
    room = CircuitInput(0.0, system.model.reference_degC)
    began = system.start(_ANY_SOC, 1.0, room)
    at = [system.state_names.index(name) for name in names]
    m, C, C0 = _corrections(belief, began, at, names.index("charge_gain"))
    L = np.linalg.cholesky(C0)
    narrowed, axes = np.linalg.eigh(np.linalg.solve(L, np.linalg.solve(L, C).T))
    narrower = np.where(narrowed < 1.0, narrowed, np.inf)
    whitened = axes.T @ np.linalg.solve(L, m)
    back = np.linalg.solve(L.T, axes)  # L^-T V
    information = np.where(np.isfinite(narrower), 1.0 / narrower - 1.0, 0.0)
    return (back * information) @ back.T, back @ (whitened / narrower)


def _corrections(belief: Belief, began: Belief, at: list[int], gain: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean and covariance of z now, and its covariance at the beginning; the gain g as ln Q = -ln g."""
    g = float(belief.mean[at[gain]])
    m = belief.mean[at] - began.mean[at]
    m[gain] = -math.log(g)
    by_gain, by_gain_at_first = np.ones(len(at)), np.ones(len(at))
    by_gain[gain], by_gain_at_first[gain] = -1.0 / g, -1.0
    C = by_gain[:, None] * belief.cov[np.ix_(at, at)] * by_gain
    C0 = by_gain_at_first[:, None] * began.cov[np.ix_(at, at)] * by_gain_at_first
    return m, C, C0


def _posterior(P: np.ndarray, H: np.ndarray, J: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corrections (K,) and covariance (K, K) with this information; no correction beyond `MOST_CORRECTION_STD`."""
    seen = H @ P
    gain = seen.T @ J @ np.linalg.inv(np.eye(len(J)) + seen @ H.T @ J)
    covariance = P - gain @ seen
    theta = covariance @ H.T @ b
    beyond = np.abs(H @ theta) / np.sqrt(np.diag(seen @ H.T))
    return theta / max(float(beyond.max()) / MOST_CORRECTION_STD, 1.0), 0.5 * (covariance + covariance.T)
