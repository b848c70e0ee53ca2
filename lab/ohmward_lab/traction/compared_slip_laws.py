"""Slip laws to compare with `sliding_mode`, the one to use: a PID, and the sliding modes of [T] 5.3 and 6.2."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

from ohmward.checks import require_each_not_negative, require_each_positive, require_positive
from ohmward.trace import clip, maximum, minimum, where
from ohmward.traction.control.signals import DrivenWheel, limited
from ohmward.traction.control.sliding_mode import STEPS_PER_TIME_CONSTANT, SlidingMemory, SlidingMode, Uncertainty
from ohmward.traction.control.slip_law import Motion, NoMemory, surface


class PidMemory(NamedTuple):
    """Torque of the integral [N m], the last error, its rate [1/s] through the lag."""

    integral_Nm: Any
    error: Any
    rate_per_s: Any


@dataclass(frozen=True)
class SlipPid:
    """PID on the slip ratio: the baseline.

    tau = K_p e + K_i int e dt + K_d de/dt,   e = -sigma / V_f

    The error is that of the slip ratio, relative to v_0 below that speed; its derivative goes through a lag. The
    integral stops while the torque is limited and the error would wind it up.
    """

    proportional_Nm: float = 30.0  #: K_p, torque per unit of slip ratio, >= 0
    integral_Nm_per_s: float = 1000.0  #: K_i, >= 0
    derivative_Nm_s: float = 0.0  #: K_d, >= 0
    derivative_lag_s: float = 0.005  #: > 0

    def __post_init__(self) -> None:
        require_each_not_negative("slip_pid.", self, "proportional_Nm", "integral_Nm_per_s", "derivative_Nm_s")
        require_positive("slip_pid.derivative_lag_s", self.derivative_lag_s)

    def init(self, zero: Any) -> PidMemory:
        """Memory with zero integral and error."""
        return PidMemory(zero, zero, zero)

    def torque_Nm(self, memory: PidMemory, motion: Motion, wheel: DrivenWheel) -> Any:
        """Torque [N m] at the wheel without limits."""
        error = self.error(motion)
        rate = self.rate_per_s(memory, error, motion.dt_s)
        return self.proportional_Nm * error + memory.integral_Nm + self.derivative_Nm_s * rate

    def remember(self, memory: PidMemory, motion: Motion, demanded_Nm: Any, torque_Nm: Any) -> PidMemory:
        """The integral and the error after the step."""
        error = self.error(motion)
        windup = limited(demanded_Nm, torque_Nm) & ((demanded_Nm - torque_Nm) * error > 0.0)
        more = where(windup, 0.0, self.integral_Nm_per_s * error * motion.dt_s)
        return PidMemory(memory.integral_Nm + more, error, self.rate_per_s(memory, error, motion.dt_s))

    def error(self, motion: Motion) -> Any:
        """e: slip ratio that is missing to the target."""
        here = surface(motion.rim_m_s, motion.travel_m_s, motion.slip_target, motion.floor_m_s, motion.launch)
        return -here.sigma / here.reference_speed

    def rate_per_s(self, memory: PidMemory, error: Any, dt_s: Any) -> Any:
        """de/dt through its lag."""
        change = error - memory.error - memory.rate_per_s * dt_s
        return memory.rate_per_s + change / (self.derivative_lag_s + dt_s)


#: Smallest 1 - lambda used as a divisor in `SlipRatioSlidingMode`.
_LEAST_REMAINDER = 0.05


@dataclass(frozen=True)
class SlipRatioSlidingMode:
    """Sliding mode on the slip ratio: the law of [T] 5.3, corrected.

    dlambda/dt = f + B tau,   V = max(r omega, v)
    B = r (1 - max(lambda, 0)) / (J V)
    f = -(1 + min(lambda, 0)) dv/dt / V - r^2 (1 - max(lambda, 0)) F / (J V)
    tau = [ -f_hat + dlambda_d/dt - k sat((lambda - lambda_d) / phi) ] / B_hat
    k = beta (df + eta) + (beta - 1) |-f_hat + dlambda_d/dt|,   phi = max(phi_0, k max(T, 5 dt))

    In the text that we worked from, B lacks 1 - lambda (5.26), f_hat has the wrong sign and B_hat^-1 appears twice
    (5.33-5.35), sat is 1 inside the layer (5.47). B vanishes for a wheel that spins at standstill, and every term grows
    without bound towards V = 0; floors keep both away from zero here. The gain k grows as 1/V; a layer of constant
    width, as in [T], is then too thin for a slow wheel, and the torque oscillates from step to step. A layer that
    follows its gain (Slotine and Li) also works from rest.
    """

    uncertainty: Uncertainty  #: that the gain has to outweigh
    reaching_per_s: float = 1.0  #: eta, > 0
    layer: float = 0.02  #: phi_0, least layer as a slip ratio, > 0
    floor_m_s: float = 0.05  #: least V, > 0
    #: T, of the slip inside the layer, >= 0; with 0 and steps of zero length the layer is phi_0
    time_constant_s: float = 0.005

    def __post_init__(self) -> None:
        require_each_positive("slip_ratio_sliding_mode.", self, "reaching_per_s", "layer", "floor_m_s")
        require_each_not_negative("slip_ratio_sliding_mode.", self, "time_constant_s")

    def init(self, zero: Any) -> NoMemory:
        """The law has no memory."""
        return NoMemory()

    def torque_Nm(self, memory: NoMemory, motion: Motion, wheel: DrivenWheel) -> Any:
        """Torque [N m] at the wheel without limits."""
        r, J, unsure = wheel.radius_m, wheel.inertia_kg_m2, self.uncertainty
        beta = unsure.inertia_factor
        V = maximum(maximum(motion.rim_m_s, motion.travel_m_s), self.floor_m_s)
        slip = (motion.rim_m_s - motion.travel_m_s) / V
        grip, skid = maximum(1 - maximum(slip, 0.0), _LEAST_REMAINDER), 1 + minimum(slip, 0.0)
        f = -(skid * motion.acceleration_m_s2 + r * r * grip * motion.force_N / J) / V
        by_force = r * r * grip * (beta * unsure.force_N + (beta - 1) * abs(motion.force_N)) / J
        f_error = (abs(skid) * unsure.acceleration_m_s2 + by_force) / V
        u = -f + motion.target_rate_per_s
        k = beta * (f_error + self.reaching_per_s) + (beta - 1) * abs(u)
        layer = maximum(self.layer, k * maximum(self.time_constant_s, STEPS_PER_TIME_CONSTANT * motion.dt_s))
        return (u - k * clip((slip - motion.slip_target) / layer, -1.0, 1.0)) / (r * grip / (J * V))

    def remember(self, memory: NoMemory, motion: Motion, demanded_Nm: Any, torque_Nm: Any) -> NoMemory:
        """The same memory: the law has none."""
        return memory


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
    """Adaptive fuzzy sliding mode, [T] 6.2: inference on sigma and dsigma/dt adapts gain and layer of `sliding_mode`.

    k = k_0 share_k(x, y),   Phi = Phi_0 share_Phi(x, y)
    x = min(|sigma| / Phi_0, 1)                 zero, small, large
    y = sign(sigma) dsigma/dt / k_0             approaching, still, leaving

    The sets are triangles that add up to one, the rules have singletons as consequents (Takagi and Sugeno, order zero),
    so inference is interpolation between the rules. Outside the layer no rule has a gain below k_0, so the sliding
    condition holds as it does for the plain law; inside, the gain is reduced where it is not needed, and with it the
    reaction to noise.
    """

    sliding: SlidingMode  #: the law that is adapted
    #: shares of k and Phi, > 0; those of k for large sigma are at least 1, or the sliding condition fails
    gain_rules: Rules = GAIN_RULES
    layer_rules: Rules = LAYER_RULES

    def init(self, zero: Any) -> FuzzyMemory:
        """Memory on the surface and at rest."""
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
