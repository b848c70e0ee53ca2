"""Set-points of slip: the one for the largest force, and the one for the least energy, which is smaller.

The share of the wheel's power that moves the robot against a load is (1 - lambda) (1 - R/F), with the wheel's rolling
resistance R. More slip gives more force and wastes more of it, so the best slip lies below the peak.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ohmward.checks import require_between, require_each_not_negative, require_each_positive, require_positive
from ohmward.errors import InputError
from ohmward.trace import clip, isfinite, maximum, sin, where

OBJECTIVES = ("traction", "energy")
_LEAST_ADHESION = 0.01


class SeekerState(NamedTuple):
    """Moments of slip and adhesion over the window, the set-point, and the time [s] that they cover."""

    slip: Any
    adhesion: Any
    variance: Any
    covariance: Any
    set_point: Any
    time_s: Any


class SetPoint(NamedTuple):
    """The slip ratio to hold now, the sine included; the one around which it swings; slope there; 1 if identified."""

    slip_ratio: Any
    centre: Any
    slope: Any
    identified: Any


@dataclass(frozen=True)
class SetPointSeeker:
    """Extremum seeking of the slip to hold while driving: of maximum traction, or of least energy.

    Around the present slip the adhesion mu = F/N is a line, its slope the regression of mu on lambda over the last
    seconds:

    slope = cov(lambda, mu) / var(lambda)
    traction: climb slope - least slope   to the peak, or the knee of a plateau
    energy:   climb (1 - lambda) rho slope / mu^2 - (1 - rho/mu)   d/dlambda of (1 - lambda)(1 - rho/mu)

    with rho = R/N, the resistance over the load. A small sine on the set-point makes lambda vary. If lambda does not
    vary, because the wheel does not follow or the command is held elsewhere, nothing is learned: the set-point stays,
    and `identified` is 0. The approach to the set-point, from rest or after a skid, is not learned from either: one
    such swing weighs as much as a hundred periods of the sine. With one driven axle at constant speed the force, and so
    the slip, is given; a set-point matters only with an acceleration or a second axle.

    Settings; `init` and `step` are pure functions of them.
    """

    objective: str = "traction"  #: "traction" or "energy"
    resistance_coefficient: float = 0.0  #: rho, for "energy" > 0: force of the wheel at constant speed over its load
    #: range of the set-point, within (0, 1)
    lowest: float = 0.01
    highest: float = 0.5
    dither: float = 0.01  #: amplitude of the sine, >= 0
    dither_Hz: float = 2.0  #: its frequency, > 0
    window_s: float = 1.0  #: of the regression, > 0; a few periods of the sine
    least_std: float = 0.003  #: standard deviation of slip below which nothing is learned, > 0
    #: slip farther from the set-point than this is not on the line around it and not learned from, > the dither
    reach: float = 0.03
    least_slope: float = 0.1  #: slope [1] that counts as the peak for "traction", >= 0
    pace_per_s: float = 0.05  #: fastest change of the set-point, > 0
    full_pace: float = 1.0  #: gradient at which it moves at that pace, > 0

    def __post_init__(self) -> None:
        if self.objective not in OBJECTIVES:
            raise InputError(f"set_point_seeker.objective must be one of {OBJECTIVES}, got {self.objective!r}")
        if self.objective == "energy":
            require_positive("set_point_seeker.resistance_coefficient", self.resistance_coefficient)
        require_each_positive(
            "set_point_seeker.", self, "dither_Hz", "window_s", "least_std", "pace_per_s", "full_pace"
        )
        require_each_not_negative("set_point_seeker.", self, "dither", "least_slope")
        require_between("set_point_seeker.reach", self.reach, self.dither, 1.0)
        require_between("set_point_seeker.lowest", self.lowest, 1e-3, 0.99)
        require_between("set_point_seeker.highest", self.highest, self.lowest, 0.99)

    def init(self, slip_ratio: Any) -> SeekerState:
        """State before the first step, with the slip ratio to start from."""
        zero = 0.0 * slip_ratio
        return SeekerState(zero + slip_ratio, zero, zero, zero, zero + slip_ratio, zero)

    def step(self, state: SeekerState, slip_ratio: Any, adhesion: Any, dt_s: Any) -> tuple[SeekerState, SetPoint]:
        """The state after the slip ratio and adhesion F/N of this instant, and the slip to hold."""
        learned = self.learn(state, slip_ratio, adhesion, dt_s)
        known = isfinite(adhesion) & (abs(slip_ratio - state.set_point) <= self.reach)
        learned = SeekerState(*(where(known, new, old) for new, old in zip(learned, state, strict=True)))
        varied = learned.variance > self.least_std**2
        identified = known & varied & (learned.time_s > self.window_s)
        slope = where(varied, learned.covariance / maximum(learned.variance, self.least_std**2), np.nan)
        uphill = clip(self.gradient(learned, slope) / self.full_pace, -1.0, 1.0)
        move = where(identified, self.pace_per_s * uphill * dt_s, 0.0)
        centre = clip(state.set_point + move, self.lowest, self.highest)
        held = centre + self.dither * sin(2 * math.pi * self.dither_Hz * learned.time_s)
        after = learned._replace(set_point=centre)
        return after, SetPoint(held, centre, slope, where(identified, 1.0, 0.0))

    def learn(self, state: SeekerState, slip_ratio: Any, adhesion: Any, dt_s: Any) -> SeekerState:
        """Moments with one more sample; past samples are forgotten over the window, the first ones count fully."""
        share = dt_s / maximum(self.window_s, dt_s)
        share = maximum(share, dt_s / maximum(state.time_s + dt_s, 1e-9))
        x, y = slip_ratio - state.slip, adhesion - state.adhesion
        return SeekerState(
            state.slip + share * x,
            state.adhesion + share * y,
            (1 - share) * (state.variance + share * x * x),
            (1 - share) * (state.covariance + share * x * y),
            state.set_point,
            state.time_s + dt_s,
        )

    def gradient(self, learned: SeekerState, slope: Any) -> Any:
        """Derivative of the objective with respect to slip."""
        if self.objective == "traction":
            return slope - self.least_slope
        mu, rho = maximum(learned.adhesion, _LEAST_ADHESION), self.resistance_coefficient
        return (1 - learned.slip) * rho * slope / (mu * mu) - (1 - rho / mu)
