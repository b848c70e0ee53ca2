"""Adaptive fuzzy sliding mode, [T] 6.2: inference on sigma and dsigma/dt adapts gain and layer of `sliding_mode`.

k = k_0 share_k(x, y),   Phi = Phi_0 share_Phi(x, y)
x = min(|sigma| / Phi_0, 1)                 zero, small, large
y = sign(sigma) dsigma/dt / k_0             approaching, still, leaving

The sets are triangles that add up to one, the rules have singletons as consequents (Takagi and Sugeno, order zero), so
inference is interpolation between the rules. Outside the layer no rule has a gain below k_0: the sliding condition
holds as it does for the plain law; inside, the gain comes down where nothing needs it, and the reaction to noise too.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ohmward.checks import require_between
from ohmward.errors import InputError
from ohmward.trace import clip, maximum, minimum, where
from ohmward.traction.control.signals import DrivenWheel
from ohmward.traction.control.sliding_mode import SlidingMemory, SlidingMode
from ohmward.traction.control.slip_law import Motion

Rules = tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]

_SIZES = (0.0, 0.5, 1.0)
_MOTIONS = (-1.0, 0.0, 1.0)

#: Rows: |sigma| zero, small, large; columns: approaching, still, leaving.
GAIN_RULES: Rules = ((0.5, 0.5, 0.8), (0.5, 0.8, 1.0), (1.0, 1.1, 1.3))
LAYER_RULES: Rules = ((1.2, 1.0, 1.0), (1.1, 1.0, 0.9), (1.0, 1.0, 1.0))


class FuzzyMemory(NamedTuple):
    """Memory of the plain law, sigma [m/s] of the last step, and its rate [m/s^2] through a lag."""

    sliding: SlidingMemory
    sigma_m_s: Any
    rate_m_s2: Any


@dataclass(frozen=True)
class FuzzySlidingMode:
    """Settings of the law."""

    sliding: SlidingMode  #: the law that is adapted
    #: (3, 3) shares of k and Phi, > 0; those of k for large sigma are at least 1
    gain_rules: Rules = GAIN_RULES
    layer_rules: Rules = LAYER_RULES

    def __post_init__(self) -> None:
        for name in ("gain_rules", "layer_rules"):
            rules = np.asarray(getattr(self, name), dtype=float)
            if rules.shape != (3, 3):
                raise InputError(f"fuzzy_sliding_mode.{name} must be 3 rows of 3 shares, got shape {rules.shape}")
            require_between(f"fuzzy_sliding_mode.{name}", rules.ravel().tolist(), 0.01, 100.0)
        if min(self.gain_rules[2]) < 1:
            raise InputError(
                "fuzzy_sliding_mode.gain_rules must be at least 1 in the row of large sigma, or the sliding condition "
                f"fails; got {self.gain_rules[2]}"
            )

    def init(self, zero: Any) -> FuzzyMemory:
        """On the surface and at rest."""
        return FuzzyMemory(self.sliding.init(zero), zero, zero)

    def torque_Nm(self, memory: FuzzyMemory, motion: Motion, wheel: DrivenWheel) -> Any:
        """Torque [N m] at the wheel without limits."""
        here = self.sliding.surface(motion)
        k = self.sliding.gain_m_s2(here, motion, wheel)
        layer = self.sliding.layer_m_s(k, motion.dt_s)
        x = minimum(abs(here.sigma) / layer, 1.0)
        y = clip(where(here.sigma >= 0, 1.0, -1.0) * memory.rate_m_s2 / k, -1.0, 1.0)
        adapted_k = infer(self.gain_rules, x, y) * k
        adapted_layer = infer(self.layer_rules, x, y) * layer
        return self.sliding.torque_with(adapted_k, adapted_layer, memory.sliding, motion, wheel)

    def remember(self, memory: FuzzyMemory, motion: Motion, demanded_Nm: Any, torque_Nm: Any) -> FuzzyMemory:
        """The plain law's memory, and the rate of sigma through its own time constant."""
        sigma = self.sliding.surface(motion).sigma
        lag = self.sliding.time_constant_s + motion.dt_s
        rate = memory.rate_m_s2 + (sigma - memory.sigma_m_s - memory.rate_m_s2 * motion.dt_s) / lag
        return FuzzyMemory(self.sliding.remember(memory.sliding, motion, demanded_Nm, torque_Nm), sigma, rate)


def infer(rules: Rules, size: Any, motion: Any) -> Any:
    """Consequent of the rules for |sigma| in [0, 1] and motion in [-1, 1], both relative."""
    rows = [_member(size, _SIZES, i) for i in range(3)]
    columns = [_member(motion, _MOTIONS, j) for j in range(3)]
    return sum(rules[i][j] * rows[i] * columns[j] for i in range(3) for j in range(3))


def _member(value: Any, centres: tuple[float, float, float], index: int) -> Any:
    """Membership [0, 1] of a value in the triangle around a centre."""
    return maximum(1.0 - abs(value - centres[index]) / (centres[1] - centres[0]), 0.0)
