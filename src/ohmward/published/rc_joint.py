"""States and parameters of the RC model together, by an adaptive unscented Kalman filter ([T] 3.3).

    x = [ln C_b, ln C_s, ln R_e, ln R_t, V_cb, V_cs, V]    y = V    R_b = R_s = R_e

the logarithms being relative to nominal values, so that parameters are of order one. [T] has 1/C_b, 1/C_s, 1/R_e and
R_t themselves, at the end: at the front they cost less, because the Cholesky factor is triangular, so that the sigma
points along the voltages all share the parameters of the mean.
Logarithms instead of a projection onto positive values, because then no sigma point can be negative however wide the
belief, a start wrong by a factor is an ordinary Gaussian error, a random walk is a share per time for every parameter,
and nothing is clipped. Their price is an exponential for each parameter that differs between sigma points.

With `voltage_as="output"` V is no state: six states, no memory of a voltage disturbance, y = h(x, i).

Noise: Q = K C K' + floor and R = residual moment + P_yy + floor over a window of 100 ([T] 3.49-3.50, the missing 1/L
restored). What the floors and the gate are for is said at the attributes of `RcJoint`. Sigma points are reused for the
output, with alpha = 0.85, beta = 2, kappa = 0, all as in [T].
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import numpy as np

from ohmward.battery.models import rc
from ohmward.battery.models.temperature import ROOM_DEGC
from ohmward.battery.soc.clean_sample import CleanSocSample, is_voltage, sanitize
from ohmward.battery.soc.sample import SocFlag, SocSample
from ohmward.checks import require_between, require_positive
from ohmward.errors import InputError
from ohmward.filters import adaptive, unscented
from ohmward.filters.belief import Belief, Innovation, PackedBelief, nis, pack, unpack
from ohmward.filters.gate import apply_gain, choose
from ohmward.filters.linear_algebra import cholesky, mirror_lower
from ohmward.trace import isfinite, logical_not, maximum, where

DIVERGED = 7.0
"""Parameters further than a factor of e^7 from their nominal values are lost, and the filter starts again."""

BULK_STD_V = 0.5
"""How far the open-circuit voltage may be from the first voltage [V], unless said otherwise."""

PARAMETERS = 4
"""ln C_b, ln C_s, ln R_e, ln R_t: the first elements of the state."""


class Nominal(NamedTuple):
    """Values that the logarithms refer to, and the start of the parameters.

    c_bulk_F, c_surface_F: capacitances [F].  r_ohm: R_e = R_b = R_s [ohm].  r_terminal_ohm: R_t [ohm].
    """

    c_bulk_F: float
    c_surface_F: float
    r_ohm: float
    r_terminal_ohm: float


def require_nominal(nominal: Nominal) -> None:
    """Refuse values of the circuit that are not > 0."""
    for name, value in zip(Nominal._fields, nominal, strict=True):
        require_positive(f"nominal.{name}", value)


class JointState(NamedTuple):
    """All that the filter carries from sample to sample: plain numbers.

    belief: mean (n,) and lower triangle of the covariance.
    noise: second moments of innovation and residual [V^2].
    gain: (n,) of the last voltage; zero where it was not used.
    current_A: of the sample before.
    rejected_s: how long the voltage has been outside its gate [s].
    """

    belief: PackedBelief
    noise: adaptive.NoiseEstimate
    gain: np.ndarray
    current_A: float
    rejected_s: float


class JointEstimate(NamedTuple):
    """What the filter says after a sample.

    circuit: the parameters.
    c_bulk_std, c_surface_std, r_std, r_terminal_std: their standard deviations as shares of themselves.
    bulk_V, surface_V: voltages of the capacitors.
    voltage_V, voltage_std_V: terminal voltage expected before the measurement, and how far off it may be.
    innovation_V: measured minus expected voltage; nan when there was none.
    flags: sum of `SocFlag`.
    """

    circuit: rc.Circuit
    c_bulk_std: Any
    c_surface_std: Any
    r_std: Any
    r_terminal_std: Any
    bulk_V: Any
    surface_V: Any
    voltage_V: Any
    voltage_std_V: Any
    innovation_V: Any
    flags: Any


@dataclass(frozen=True)
class RcJoint:
    """Settings; `init` and `step` are pure functions of them.

    Attributes:
        nominal: start of the parameters.
        start_std: (4,) how wrong that start may be, of the logarithms of C_b, C_s, R_e, R_t; 0.5 is a factor 1.6.
        voltage_as: "state" is [T]'s seven states, "output" the six.
        voltage_std_V: white noise of the voltage sensor; floor of R.
        current_std_A: white noise of the current sensor; moves both capacitors.
        disturbance_V: change in one second of what the circuit leaves unexplained, with V as a state; floor of Q.
        parameter_walk: change of each parameter in one hour as a share of itself; floor of Q. Without it the filter
            stops learning, believes itself, and is wrong with confidence as soon as the battery warms up.
        match_Q, match_R: which noise is learnt; both in [T]. The floors are the whole noise otherwise.
        window: effective number of samples for that.
        gate: largest NIS of a voltage that is used.
        reset_after_s: after so much time outside the gate the voltage is used: it is the filter that is wrong.
        gap_s: a longer step says nothing about the current in between.
        unknown_A: standard deviation of a current that was not measured.
        current_limit_A: a larger current is a fault of its sensor.
        highest_ocv_V: of the battery [V]; voltages that no such battery can show are none.
        scaling: of the sigma points.
    """

    nominal: Nominal
    start_std: tuple[float, float, float, float] = (0.5, 0.5, 0.5, 0.5)
    voltage_as: Literal["state", "output"] = "state"
    voltage_std_V: float = 0.002
    current_std_A: float = 0.02
    disturbance_V: float = 0.0005
    parameter_walk: float = 0.01
    match_Q: bool = True
    match_R: bool = True
    window: float = 100.0
    gate: float = 25.0
    reset_after_s: float = 60.0
    gap_s: float = 600.0
    unknown_A: float = 1.0
    current_limit_A: float = math.inf
    highest_ocv_V: float = math.inf
    scaling: unscented.Scaling = field(default=unscented.DEFAULT)

    def __post_init__(self) -> None:
        require_nominal(self.nominal)
        require_positive("voltage_std_V", self.voltage_std_V)
        for name in ("start_std", "current_std_A", "disturbance_V", "parameter_walk"):
            require_between(name, getattr(self, name), 0.0, math.inf)
        if self.voltage_as not in ("state", "output"):
            raise InputError(f'voltage_as must be "state" (seven states) or "output" (six), got {self.voltage_as!r}')
        if not self.window >= 1:
            raise InputError(f"window must be at least 1 sample, got {self.window}; [T] takes 100")

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the belief's mean, in order."""
        circuit = rc.STATE_NAMES_WITH_VOLTAGE if self.voltage_as == "state" else rc.STATE_NAMES
        return ("ln_c_bulk", "ln_c_surface", "ln_r", "ln_r_terminal", *circuit)

    def init(self, first: SocSample, bulk_V: float | None = None, bulk_std_V: float = BULK_STD_V) -> JointState:
        """State before the first sample: at rest, at `bulk_V`, or at the first voltage where that is None.

        bulk_std_V: how far the open-circuit voltage may be from it.

        Raises:
            InputError: bulk_V is None and the first sample has no voltage.
        """
        level = first.voltage_V if bulk_V is None else bulk_V
        if not math.isfinite(level):
            raise InputError("the first sample has no voltage: give bulk_V, the battery's open-circuit voltage")
        belief = pack(self.ignorance(float(level), bulk_std_V))
        moments = adaptive.NoiseEstimate(np.zeros((1, 1)), np.zeros((1, 1)), 0.0)
        return JointState(belief, moments, np.zeros(len(self.state_names)), 0.0, 0.0)

    def ignorance(self, level_V: Any, std_V: float) -> Belief:
        """Belief about a battery at rest near `level_V` of which only the nominal values are known."""
        n = len(self.state_names) - PARAMETERS
        mean = np.array([*np.zeros(PARAMETERS), *(level_V for _ in range(n))])
        voltages = np.full((n, n), std_V**2) + np.diag([1e-4 * std_V**2] * n)
        parameters = np.diag(np.square(self.start_std))
        return Belief(mean, np.block([[parameters, np.zeros((PARAMETERS, n))], [np.zeros((n, PARAMETERS)), voltages]]))

    def step(self, state: JointState, sample: SocSample) -> tuple[JointState, JointEstimate]:
        """The state after a sample, and what is known then."""
        reading = sanitize(sample, state.current_A, ROOM_DEGC, self.gap_s, self.current_limit_A)
        measured = is_voltage(sample.voltage_V, self.highest_ocv_V)
        y = where(measured, sample.voltage_V, state.belief.mean[-1])
        before, healthy = self.revived(unpack(state.belief), y)
        prior, correction = unscented.correct_reusing_points(
            before,
            lambda x: self.next_state(x, reading),
            lambda x: self.voltage(x, reading),
            np.array([y]),
            self.process_noise(state, reading),
            self.measurement_noise(state, before, reading),
            self.scaling,
        )
        used, outside = self.verdict(state, reading, measured, correction.innovation)
        K = where(used, correction.gain, 0.0)
        posterior = apply_gain(prior, correction.innovation, K)
        residual = np.array([y]) - self.voltage(posterior.mean, reading)
        moments = adaptive.remember(state.noise, correction.innovation.value, residual, self.window)
        after = JointState(
            pack(posterior),
            choose(used, moments, state.noise),
            K[:, 0],
            reading.now.current_A,
            where(outside, state.rejected_s + reading.dt_s, 0.0),
        )
        flags = (
            reading.flags
            + where(measured, 0.0, float(SocFlag.NO_VOLTAGE))
            + where(outside & logical_not(used), float(SocFlag.VOLTAGE_REJECTED), 0.0)
            + where(healthy, 0.0, float(SocFlag.NOT_POSITIVE_DEFINITE))
        )
        innovation_V = where(measured, correction.innovation.value[0], math.nan)
        return after, self.estimate(posterior, y, correction.innovation, innovation_V, flags)

    def verdict(
        self, state: JointState, reading: CleanSocSample, measured: Any, innovation: Innovation
    ) -> tuple[Any, Any]:
        """Whether the voltage is used, and whether it is outside the gate; a repeated sample (dt = 0) is neither.

        Once patience is at its end every voltage is used, until one is inside again.
        """
        first = state.noise.samples < 0.5
        distance = nis(innovation)
        measured = measured & isfinite(distance) & ((reading.dt_s > 0) | first)
        outside = measured & (distance > self.gate)
        return measured & ((distance <= self.gate) | (state.rejected_s > self.reset_after_s)), outside

    def revived(self, belief: Belief, voltage_V: Any) -> tuple[Belief, Any]:
        """The belief, or ignorance in its place where it is no belief any more; and whether it still was one."""
        logarithms, voltages = belief.mean[:PARAMETERS], belief.mean[PARAMETERS:]
        _, positive = cholesky(belief.cov)
        healthy = (positive > 0.5) & (logarithms @ logarithms < DIVERGED**2) & isfinite(sum(voltages))
        level_V = where(isfinite(voltage_V), voltage_V, 0.0)
        return choose(healthy, belief, self.ignorance(level_V, BULK_STD_V)), healthy

    def circuit(self, x: np.ndarray) -> rc.Circuit:
        """The parameters in state x."""
        c_bulk, c_surface, r, r_terminal = np.array(self.nominal) * np.exp(x[:PARAMETERS])
        return rc.Circuit(c_bulk, c_surface, r, r, r_terminal)

    def next_state(self, x: np.ndarray, reading: CleanSocSample) -> np.ndarray:
        """State after the step, (n,); the parameters stay."""
        p, voltages = self.circuit(x), x[PARAMETERS:]
        if self.voltage_as == "output":
            moved = rc.next_state(voltages, reading.mean.current_A, p, reading.dt_s)
        else:
            now_A = reading.now.current_A
            before_A = now_A - reading.change_A
            moved = rc.next_state_with_voltage(voltages, before_A, reading.mean.current_A, now_A, p, reading.dt_s)
        return np.array([*x[:PARAMETERS], *moved])

    def voltage(self, x: np.ndarray, reading: CleanSocSample) -> np.ndarray:
        """Terminal voltage [V] in state x, (1,)."""
        return (
            x[-1:] if self.voltage_as == "state" else rc.voltage(x[PARAMETERS:], reading.now.current_A, self.circuit(x))
        )

    def process_noise(self, state: JointState, reading: CleanSocSample) -> np.ndarray:
        """Q (n, n) of this step: the floor, and what the innovations of the last steps say."""
        dt_s = reading.dt_s
        charge_As2 = self.current_std_A**2 * dt_s + where(reading.known > 0.5, 0.0, (self.unknown_A * dt_s) ** 2)
        per_V = 1 / (self.nominal.c_bulk_F + self.nominal.c_surface_F), 0.5 / self.nominal.c_surface_F
        disturbance = [self.disturbance_V**2 * dt_s] if self.voltage_as == "state" else []
        walk = [self.parameter_walk**2 * dt_s / 3600.0] * PARAMETERS
        Q = np.diag(np.array([*walk, *(charge_As2 * g**2 for g in per_V), *disturbance]))
        if not self.match_Q:
            return Q
        K, C = state.gain[:, None], where(dt_s > 0, state.noise.innovation, 0.0)
        return mirror_lower(Q + K @ C @ K.T)

    def measurement_noise(self, state: JointState, before: Belief, reading: CleanSocSample) -> np.ndarray:
        """R (1, 1) of this step: the floor, and what the residuals of the last steps say."""
        instant_ohm = self.nominal.r_terminal_ohm + 0.5 * self.nominal.r_ohm
        unknown_V2 = where(reading.known > 0.5, 0.0, (self.unknown_A * instant_ohm) ** 2)
        floor = np.array([[self.voltage_std_V**2 + unknown_V2]])
        if not self.match_R:
            return floor
        P_yy = unscented.output_covariance(before, lambda x: self.voltage(x, reading), self.scaling)
        matched = state.noise.residual + P_yy
        return where(state.noise.samples < 0.5, floor, maximum(floor, matched))

    def estimate(
        self, x: Belief, voltage_V: Any, innovation: Innovation, innovation_V: Any, flags: Any
    ) -> JointEstimate:
        """What is known after the sample."""
        std = [np.sqrt(maximum(x.cov[k, k], 0.0)) for k in range(PARAMETERS)]
        return JointEstimate(
            circuit=self.circuit(x.mean),
            c_bulk_std=std[0],
            c_surface_std=std[1],
            r_std=std[2],
            r_terminal_std=std[3],
            bulk_V=x.mean[PARAMETERS],
            surface_V=x.mean[PARAMETERS + 1],
            voltage_V=voltage_V - innovation.value[0],
            voltage_std_V=np.sqrt(innovation.cov[0, 0]),
            innovation_V=innovation_V,
            flags=flags,
        )
