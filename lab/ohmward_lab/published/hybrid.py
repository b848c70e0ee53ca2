"""The hybrid that [P] proposes: the Thevenin filter estimates all the time, the RC filter initialises and corrects it.

Both have seen the same samples, so their errors are correlated to an unknown degree and must not be averaged. For one
number the covariance intersection of two such estimates is simply the more certain one. So at the start and once in
every long rest, where the RC filter is more certain of SoC, the Thevenin filter takes over its SoC and sigma.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.soc.clean_sample import Rest, continue_rest
from ohmward.battery.soc.sample import INITIAL_SOC_STD, SocEstimate, SocFlag, SocSample
from ohmward.battery.soc.thevenin_filter import FilterState, TheveninFilter
from ohmward.filters.belief import Belief, pack, unpack
from ohmward.filters.flags import flags_of
from ohmward.filters.gate import choose
from ohmward.filters.linear_algebra import mirror_lower
from ohmward.trace import Scalar, logical_not, maximum
from ohmward_lab.published.rc_filter import RcFilter, RcFilterState


class HybridState(NamedTuple):
    """Both filters, and the rest that the battery may be in."""

    thevenin: FilterState
    rc: RcFilterState
    rest: Rest


@dataclass(frozen=True)
class Hybrid:
    """Settings."""

    thevenin: TheveninFilter  #: estimates
    rc: RcFilter  #: initialises and corrects
    rest_share: float = 0.03  #: current below this share of 1 C, and three sigma of its noise, counts as rest
    settle_s: float = 900.0  #: length of a rest after which its voltage counts as the open-circuit voltage

    def init(self, first: SocSample, soc: float | None = None, soc_std: float = INITIAL_SOC_STD) -> HybridState:
        """State before the first sample, with the SoC of whichever filter is more certain of it."""
        thevenin = self.thevenin.init(first, soc, soc_std)
        rc = self.rc.init(first, soc, soc_std)
        _, estimate = self.rc.step(rc, first)
        belief, _ = _surer(unpack(thevenin.belief), estimate.soc, estimate.soc_std)
        return HybridState(thevenin._replace(belief=pack(belief)), rc, Rest())

    def step(self, state: HybridState, sample: SocSample) -> tuple[HybridState, SocEstimate]:
        """State and estimate after a sample; `SocFlag.REST` marks a correction."""
        thevenin, estimate = self.thevenin.step(state.thevenin, sample)
        rc, by_rc = self.rc.step(state.rc, sample)
        threshold_A = self.thevenin.sensor.rest_threshold_A(self.thevenin.model.capacity_Ah, self.rest_share)
        resting = abs(thevenin.current_A) < threshold_A
        dt_s = self.thevenin.sanitize(state.thevenin, sample).dt_s
        rest, due = continue_rest(state.rest, resting, dt_s, self.settle_s)
        before = unpack(thevenin.belief)
        corrected, surer = _surer(before, by_rc.soc, by_rc.soc_std)
        belief = choose(due, corrected, before)
        flagged_already = self.thevenin.is_resting(thevenin.rest_s)
        after = HybridState(thevenin._replace(belief=pack(belief)), rc, rest)
        return after, estimate._replace(
            soc=belief.mean[0],
            soc_std=np.sqrt(maximum(belief.cov[0, 0], 0.0)),
            flags=estimate.flags + flags_of({SocFlag.REST: due & surer & logical_not(flagged_already)}),
        )


def _surer(belief: Belief, soc: Scalar, soc_std: Scalar) -> tuple[Belief, Any]:
    """The belief with this SoC and sigma where sigma is smaller than its own; correlated states move along.

    Returns: the belief, and the condition that sigma is smaller.
    """
    P, variance = belief.cov, soc_std * soc_std
    surer = variance < P[0, 0]
    share = P[:, 0] / maximum(P[0, 0], 1e-18)
    moved = Belief(
        belief.mean + share * (soc - belief.mean[0]),
        mirror_lower(P - np.outer(share, share) * (P[0, 0] - variance)),
    )
    return choose(surer, moved, belief), surer
