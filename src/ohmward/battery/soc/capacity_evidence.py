"""Evidence about the capacity, counted once: the error of the curve recurs whenever the battery passes over it again.

Voltages give the capacity by the charge between two places on the curve. When they repeat themselves their error is the
same, and the mean of many is no better than one. So the belief takes no more information about the capacity than the
best two passes over the curve have given, there and back. With the variances P before an update and P+ after the whole
of it,

    r <- r + 1/P+ - 1/P                                        information of this pass, r' of the one before
    u <- u + min(max(r + r' - u, 0), 1/P+ - 1/P)               information in the belief

and the capacity follows the update only as far as u grows: a partial Schmidt-Kalman update (Brink 2017, J. Guid.
Control Dyn. 40, 2214). All other states follow it fully.
"""

from __future__ import annotations

from typing import NamedTuple

from ohmward.battery.models.noise import PASS_SOC
from ohmward.filters.belief import Belief
from ohmward.trace import Scalar, clip, maximum, sqrt, where

#: Keeps ratios of variances of a capacity that is exact finite: far below the square of any variance.
_NO_DIVISOR_BELOW = 1e-30


class CapacityEvidence(NamedTuple):
    """Information about the capacity: inverse variances of the gain of the charge."""

    recent: Scalar = 0.0  #: of the updates in this pass over the curve, r
    before: Scalar = 0.0  #: of those in the pass before, r'
    used: Scalar = 0.0  #: in the belief beyond that before the first update, u
    moved: Scalar = 0.0  #: charge that has flowed in this pass, over the capacity

    def after_step(self, moved: Scalar, before: Scalar, after: Scalar) -> CapacityEvidence:
        """The evidence after a step: charge that flows in it, and variances of the capacity before and after it."""
        ends = self.moved + moved > PASS_SOC
        return CapacityEvidence(
            where(ends, 0.0, self.recent),
            where(ends, self.recent, self.before),
            self.used * before / maximum(after, _NO_DIVISOR_BELOW),
            where(ends, 0.0, self.moved + moved),
        )


def count_once(evidence: CapacityEvidence, prior: Belief, posterior: Belief, k: int) -> tuple[Belief, CapacityEvidence]:
    """The posterior with what is new about state k, and the evidence after it; k: index of the gain of the charge."""
    P, fall = prior.cov[k, k], maximum(prior.cov[k, k] - posterior.cov[k, k], 0.0)
    gained = fall / maximum(P * (P - fall), _NO_DIVISOR_BELOW)
    recent = evidence.recent + gained
    new = clip(recent + evidence.before - evidence.used, 0.0, gained)
    left = maximum(fall - P * P * new / (1.0 + P * new), 0.0)
    mean, cov = posterior.mean.copy(), posterior.cov.copy()
    mean[k] = mean[k] - sqrt(left / maximum(fall, _NO_DIVISOR_BELOW)) * (mean[k] - prior.mean[k])
    cov[k, k] = cov[k, k] + left
    return Belief(mean, cov), evidence._replace(recent=recent, used=evidence.used + new)
