"""The hybrid that [P] proposes: the Thevenin filter estimates all the time, the RC filter initialises and corrects it.

Both have seen the same samples, so their errors are correlated to an unknown degree and must not be averaged. For one
number the covariance intersection of two such estimates is simply the surer one: at the start and once in every long
rest, where the RC filter with its own states is surer of SoC, the Thevenin filter takes SoC and sigma over from it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.soc.clean_sample import Rest, rested
from ohmward.battery.soc.rc_kalman import RcKalman
from ohmward.battery.soc.rc_linear import LinearState
from ohmward.battery.soc.sample import SocEstimate, SocFlag, SocSample
from ohmward.battery.soc.thevenin_filter import FilterState, TheveninFilter
from ohmward.filters.belief import Belief, pack, unpack
from ohmward.filters.gate import choose
from ohmward.filters.linear_algebra import mirror_lower
from ohmward.trace import maximum, where


class HybridState(NamedTuple):
    """Both filters, and the rest that the battery may be in."""

    thevenin: FilterState
    rc: LinearState
    rest: Rest


@dataclass(frozen=True)
class Hybrid:
    """Settings.

    Attributes:
        thevenin: what estimates.
        rc: what initialises and corrects.
        rest_share: current below this share of 1 C, and three sigma of its noise, counts as rest.
        settle_s: length of a rest before its voltage is taken for the open-circuit voltage.
    """

    thevenin: TheveninFilter
    rc: RcKalman
    rest_share: float = 0.03
    settle_s: float = 900.0

    def init(self, first: SocSample, soc: float | None = None, soc_std: float = 0.03) -> HybridState:
        """State before the first sample: the SoC of whichever filter is surer of it."""
        thevenin, rc = self.thevenin.init(first, soc, soc_std), self.rc.init(first, soc, soc_std)
        _, estimate = self.rc.step(rc, first)
        belief, _ = _surer(unpack(thevenin.belief), estimate.soc, estimate.soc_std)
        return HybridState(thevenin._replace(belief=pack(belief)), rc, Rest())

    def step(self, state: HybridState, sample: SocSample) -> tuple[HybridState, SocEstimate]:
        """The state after a sample, and what is known then; `SocFlag.REST` marks a correction."""
        thevenin, estimate = self.thevenin.step(state.thevenin, sample)
        rc, second = self.rc.step(state.rc, sample)
        model, noise = self.thevenin.model, self.thevenin.noise
        quiet = abs(thevenin.current_A) < noise.rest_threshold_A(model.capacity_Ah, self.rest_share)
        dt_s = self.thevenin.sanitize(state.thevenin, sample).dt_s
        rest, due = rested(state.rest, quiet, dt_s, self.settle_s)

        before = unpack(thevenin.belief)
        surer, taken = _surer(before, second.soc, second.soc_std)
        belief = choose(due, surer, before)
        after = HybridState(thevenin._replace(belief=pack(belief)), rc, rest)
        corrected = where(due & taken & (estimate.flags % (2 * SocFlag.REST) < SocFlag.REST), float(SocFlag.REST), 0.0)
        return after, estimate._replace(
            soc=belief.mean[0],
            soc_std=np.sqrt(maximum(belief.cov[0, 0], 0.0)),
            flags=estimate.flags + corrected,
        )


def _surer(belief: Belief, soc: Any, soc_std: Any) -> tuple[Belief, Any]:
    """The belief with this SoC and sigma where they are surer than its own, everything correlated moved along."""
    P, other = belief.cov, soc_std * soc_std
    taken = other < P[0, 0]
    share = P[:, 0] / maximum(P[0, 0], 1e-18)
    moved = Belief(
        belief.mean + share * (soc - belief.mean[0]),
        mirror_lower(P - np.outer(share, share) * (P[0, 0] - other)),
    )
    return choose(taken, moved, belief), taken
