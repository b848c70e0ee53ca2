"""Bayesian trend of the capacity: which laws of ageing fit what the logs have shown, and how well each is known.

With y = ln(Q / Q_reference), the logs see

    y_k = u(t_k) - loss_h(t_k) + e_k,        u(t) = q + w(t)

for each law h: q is the capacity of this battery when new over the reference, with the error that all logs share
(sensor gain, end of the curve), w a random walk for what no law says, e_k the error of one log. Given h all of them are
normal, so its likelihood and the capacity are in closed form, and the mixture over all laws is the result. No log can
show the common error; it widens the band.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ohmward.battery.health.ageing_laws import AgeingLaws
from ohmward.battery.health.point import DAY_S, Track
from ohmward.battery.models.noise import HOUR_S

#: Capacity that comes and goes from log to log: after a rest of days it is 1 % larger (Epding et al., J. Electrochem.
#: Soc. 166, 2019; the cells of NASA), and at another temperature.
REVERSIBLE_STD = 0.01
#: Beyond this many standard deviations a log counts less the further it is off (Huber), as an error of its own.
_HUBER = 2.0
_ROBUST_ROUNDS = 6
#: Laws that are less likely than this share of the best are left out of the mixture.
_NEGLIGIBLE = 1e-5
_THOUSAND_HOURS_S = 1000 * HOUR_S


class CapacityUncertainty(NamedTuple):
    """Standard deviations of ln(capacity) that hold for a battery and its sensor."""

    new: float  #: of the capacity when new against the reference
    common: float  #: of an error that all logs share
    walk: float  #: of a random walk in 1000 hours

    def covariance(self, days: np.ndarray, other_days: np.ndarray) -> np.ndarray:
        """(n, m) covariance of u at these times since the first log."""
        shared = np.minimum(days[:, None], other_days[None, :])
        return self.new**2 + self.common**2 + self.walk_variance(shared)

    def walk_variance(self, days: np.ndarray) -> np.ndarray:
        """(n,) variance of the random walk over these times."""
        return self.walk**2 * DAY_S * days / _THOUSAND_HOURS_S


class CapacityBand(NamedTuple):
    """Mean and standard deviation of ln(Q / Q_reference), (n,) each."""

    mean: np.ndarray
    std: np.ndarray


class AgeingFit(NamedTuple):
    """Laws that fit a track, and what each makes of the capacity."""

    #: (H,) those that are not negligible; the weights add up to 1
    laws: AgeingLaws
    weight: np.ndarray
    uncertainty: CapacityUncertainty  #: as assumed
    track: Track  #: with the standard deviations as used, those of logs that are off by more than usual enlarged
    residual: np.ndarray  #: (n,) y_k less the mean of the mixture, in standard deviations of that log alone

    def level(self, days: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean (H, m) and covariance (m, m) of u at these times, given all logs."""
        return _level(self.laws, self.uncertainty, self.track, days)

    def band(self, days: np.ndarray, cycles: np.ndarray) -> CapacityBand:
        """Capacity at these times (m,): moments of the mixture over the laws."""
        mean, cov = self.level(days)
        each = mean - self.laws.loss(days, cycles)
        middle = self.weight @ each
        variance = np.diag(cov) + self.uncertainty.common**2 + self.weight @ (each - middle) ** 2
        return CapacityBand(middle, np.sqrt(variance))


def fit_ageing(
    laws: AgeingLaws, track: Track, uncertainty: CapacityUncertainty, reversible_std: float = REVERSIBLE_STD
) -> AgeingFit:
    """The laws weighed by a track of capacities; without logs by their prior alone.

    reversible_std: of what comes and goes from log to log.
    """
    own_std = np.hypot(track.std, reversible_std)
    used = track._replace(std=own_std)
    for _ in range(_ROBUST_ROUNDS):
        weight = _weights(laws, uncertainty, used)
        likely = weight > _NEGLIGIBLE * weight.max()
        fit = AgeingFit(laws.chosen(likely), weight[likely] / weight[likely].sum(), uncertainty, used, np.zeros(0))
        residual = (track.value - fit.band(track.days, track.cycles).mean) / own_std
        fit = fit._replace(residual=residual)
        used = track._replace(std=own_std * np.sqrt(np.maximum(1.0, np.abs(residual) / _HUBER)))
    return fit


def _weights(laws: AgeingLaws, uncertainty: CapacityUncertainty, track: Track) -> np.ndarray:
    """(H,) posterior probabilities: prior times N(y + loss; 0, K)."""
    inverse = np.linalg.inv(observed_covariance(uncertainty, track))
    u = track.value + laws.loss(track.days, track.cycles)
    log_weight = laws.log_prior - 0.5 * np.einsum("hn,hn->h", u @ inverse, u)
    weight = np.exp(log_weight - log_weight.max())
    return weight / weight.sum()


def observed_covariance(uncertainty: CapacityUncertainty, track: Track) -> np.ndarray:
    """(n, n) covariance of u + e at the times of the logs."""
    return uncertainty.covariance(track.days, track.days) + np.diag(track.std**2)


def _level(
    laws: AgeingLaws, uncertainty: CapacityUncertainty, track: Track, days: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    cross = uncertainty.covariance(days, track.days)
    gain = np.linalg.solve(observed_covariance(uncertainty, track), cross.T).T
    u = track.value + laws.loss(track.days, track.cycles)
    return u @ gain.T, uncertainty.covariance(days, days) - gain @ cross.T
