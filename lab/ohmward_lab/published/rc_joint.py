"""States and parameters of the RC model together, by an adaptive unscented Kalman filter ([T] 3.3).

    x = [ln C_b, ln C_s, ln R_e, ln R_t, V_cb, V_cs, V]    y = V    R_b = R_s = R_e

The logarithms are relative to nominal values, so that parameters are of order one. [T] has 1/C_b, 1/C_s, 1/R_e and R_t
themselves, at the end of the state. At the front they cost less: the Cholesky factor is triangular, so that the sigma
points along the voltages all share the parameters of the mean.
With logarithms in place of a projection onto positive values no parameter of a sigma point can be negative, however
wide the belief; a start wrong by a factor is an ordinary Gaussian error; a random walk is a relative change per time;
and nothing is clipped. Their price is an exponential for each parameter that differs between sigma points.

Noise: Q = K C K' + floor and R = residual moment + P_yy + floor over a window of 100 ([T] 3.49-3.50, the missing 1/L
restored). The attributes of `RcJoint` explain the purpose of the floors and the gate. Sigma points are reused for the
output, with alpha = 0.85, beta = 2, kappa = 0, all as in [T].
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.models.noise import BatteryNoise, CurrentSensor, walk_variance
from ohmward.battery.models.temperature import ROOM_DEGC
from ohmward.battery.models.thevenin import CircuitInput
from ohmward.battery.soc.clean_sample import CleanSocSample, SampleLimits, sanitize
from ohmward.battery.soc.sample import INITIAL_SOC_STD, SocEstimate, SocFlag, SocSample
from ohmward.checks import require_each_not_negative, require_positive
from ohmward.errors import InputError
from ohmward.filters import adaptive, unscented
from ohmward.filters.belief import Belief, Innovation, PackedBelief, nis, pack, unpack
from ohmward.filters.flags import flags_of
from ohmward.filters.gate import apply_gain, choose, require_gate, time_rejected
from ohmward.filters.linear_algebra import cholesky, mirror_lower
from ohmward.quantities import SECONDS_PER_HOUR
from ohmward.trace import isfinite, linearize, logical_not, maximum, where
from ohmward.trace.expression import Scalar
from ohmward_lab.published import rc, rc_circuit
from ohmward_lab.published.rc_filter import RcFilter, RcFilterState, RcParameters

LARGEST_LOGARITHM = 7.0
"""A filter with a parameter further than a factor of e^7 from its nominal value has diverged: it starts again."""

BULK_STD_V = 0.5
"""Standard deviation of the open-circuit voltage about the first voltage [V], unless said otherwise."""

PARAMETERS = 4
"""Number of parameters, ln C_b, ln C_s, ln R_e, ln R_t: the first elements of the state."""

BULK, SURFACE, TERMINAL = range(PARAMETERS, PARAMETERS + 3)
"""Indices of the voltages in the state."""

STATES = TERMINAL + 1
"""Number of states."""


class Nominal(NamedTuple):
    """Nominal values: reference of the logarithms, and start of the parameters.

    c_bulk_F, c_surface_F: capacitances [F].  r_ohm: R_e = R_b = R_s [ohm].  r_terminal_ohm: R_t [ohm].
    """

    c_bulk_F: float
    c_surface_F: float
    r_ohm: float
    r_terminal_ohm: float


def require_nominal(nominal: Nominal) -> None:
    """Raise `InputError` unless every value of the circuit is > 0."""
    for name, value in zip(Nominal._fields, nominal, strict=True):
        require_positive(f"nominal.{name}", value)


def nominal_of(model: rc.RcModel) -> Nominal:
    """Elements of the model with R_b = R_s: its own if they are equal, else [P]'s shares of the same DC resistance."""
    if model.r_bulk_ohm == model.r_surface_ohm:
        return Nominal(model.c_bulk_F, model.c_surface_F, model.r_bulk_ohm, model.r_terminal_ohm)
    r_total_ohm = rc_circuit.dc_resistance(model) / (1 + rc.BRANCH_SHARE / 2)
    return Nominal(model.c_bulk_F, model.c_surface_F, rc.BRANCH_SHARE * r_total_ohm, rc.TERMINAL_SHARE * r_total_ohm)


class JointState(NamedTuple):
    """State of the filter between two samples: plain numbers."""

    belief: PackedBelief  #: mean (n,) and lower triangle of the covariance
    noise: adaptive.NoiseEstimate  #: second moments of innovation and residual [V^2]
    gain: np.ndarray  #: (n,) of the last voltage; zero where it was not used
    current_A: Scalar  #: of the sample before
    rejected_s: Scalar  #: time for which the voltage has been outside its gate [s]


class JointEstimate(NamedTuple):
    """Estimate after a sample."""

    circuit: rc.Circuit  #: the parameters
    #: relative standard deviations of three of them
    c_bulk_std: Scalar
    r_std: Scalar
    r_terminal_std: Scalar
    voltage_V: Scalar  #: terminal voltage expected before the measurement
    voltage_std_V: Scalar  #: standard deviation of that voltage
    innovation_V: Scalar  #: measured minus expected voltage; nan when there was none
    flags: Scalar  #: sum of `SocFlag`


@dataclass(frozen=True)
class RcJoint:
    """Settings; `init` and `step` are pure functions of them."""

    nominal: Nominal  #: start of the parameters
    #: (4,) standard deviations of the logarithms of C_b, C_s, R_e, R_t at the start; 0.5 is a factor 1.6
    start_std: tuple[float, float, float, float] = (0.5, 0.5, 0.5, 0.5)
    voltage_std_V: float = 0.002  #: white noise of the voltage sensor; floor of R
    current_std_A: float = 0.02  #: white noise of the current sensor; moves both capacitors
    #: change in one second of the voltage beyond the circuit's; floor of Q
    disturbance_V: float = 0.0005
    #: relative change of each parameter in one hour; floor of Q. Without it the filter stops learning and is
    #: confidently wrong as soon as the battery warms up.
    parameter_walk: float = 0.01
    #: noise that is learnt; both in [T]. Otherwise the floors are the whole noise.
    match_Q: bool = True
    match_R: bool = True
    window: float = 100.0  #: effective number of samples from which the noise is learnt
    gate: float = 25.0  #: largest NIS of a voltage that is used
    #: time outside the gate after which the filter has diverged: voltages are used until one passes
    reset_after_s: float = 60.0
    gap_s: float = 600.0  #: in a longer step the current between the two samples is unknown
    unknown_A: float = 1.0  #: standard deviation of a current that was not measured
    current_limit_A: float = math.inf  #: a larger current is a sensor fault
    highest_ocv_V: float = math.inf  #: of the battery [V]; voltages that are impossible with it are ignored
    scaling: unscented.Scaling = field(default=unscented.DEFAULT)  #: of the sigma points

    def __post_init__(self) -> None:
        require_nominal(self.nominal)
        require_positive("voltage_std_V", self.voltage_std_V)
        require_each_not_negative("", self, "start_std", "current_std_A", "disturbance_V", "parameter_walk")
        if not self.window >= 1:
            raise InputError(f"window must be at least 1 sample, got {self.window}; [T] takes 100")
        require_gate(self.gate, self.reset_after_s)

    def init(self, first: SocSample, bulk_V: float | None = None, bulk_std_V: float = BULK_STD_V) -> JointState:
        """State before the first sample: at rest, at `bulk_V`, or at the first voltage where that is None.

        bulk_std_V: standard deviation of the open-circuit voltage about it.

        Raises:
            InputError: bulk_V is None and the first sample has no voltage.
        """
        level = first.voltage_V if bulk_V is None else bulk_V
        if not math.isfinite(level):
            raise InputError("the first sample has no voltage: give bulk_V, the battery's open-circuit voltage")
        belief = pack(self.ignorance(float(level), bulk_std_V))
        moments = adaptive.NoiseEstimate(np.zeros((1, 1)), np.zeros((1, 1)), 0.0)
        return JointState(belief, moments, np.zeros(STATES), 0.0, 0.0)

    def ignorance(self, level_V: Scalar, std_V: float) -> Belief:
        """Belief about a battery at rest near `level_V` of which only the nominal values are known."""
        n = STATES - PARAMETERS
        mean = np.array([*np.zeros(PARAMETERS), *(level_V for _ in range(n))])
        voltages = np.full((n, n), std_V**2) + np.diag([1e-4 * std_V**2] * n)
        parameters = np.diag(np.square(self.start_std))
        return Belief(mean, np.block([[parameters, np.zeros((PARAMETERS, n))], [np.zeros((n, PARAMETERS)), voltages]]))

    def step(self, state: JointState, sample: SocSample) -> tuple[JointState, JointEstimate]:
        """State and estimate after a sample."""
        clean = sanitize(sample, CircuitInput(state.current_A, ROOM_DEGC), self.limits)
        *_, last_V = state.belief.mean
        y = np.array([where(clean.voltage_measured, sample.voltage_V, last_V)])
        before, healthy = self.restart_if_diverged(unpack(state.belief), y[0])
        prior, correction = unscented.correct_reusing_points(
            before,
            lambda x: self.next_state(x, clean),
            _voltage,
            y,
            self.process_noise(state, clean),
            self.measurement_noise(state, before, clean),
            self.scaling,
        )
        used, outside, rejected_s = self.decide(state, clean, correction.innovation)
        K = where(used, correction.gain, 0.0)
        posterior = apply_gain(prior, correction.innovation, K)
        residual = y - _voltage(posterior.mean)
        moments = adaptive.remember(state.noise, correction.innovation.value, residual, self.window)
        noise = choose(used, moments, state.noise)
        flags = clean.flags + flags_of(
            {
                SocFlag.VOLTAGE_REJECTED: outside & logical_not(used),
                SocFlag.NOT_POSITIVE_DEFINITE: logical_not(healthy),
            }
        )
        after = JointState(pack(posterior), noise, K[:, 0], clean.now.current_A, rejected_s)
        return after, self.estimate(posterior, y[0], correction.innovation, clean, flags)

    @property
    def limits(self) -> SampleLimits:
        """Limits of plausible samples."""
        return SampleLimits(self.gap_s, self.current_limit_A, highest_ocv_V=self.highest_ocv_V)

    def decide(self, state: JointState, clean: CleanSocSample, innovation: Innovation) -> tuple[Any, Any, Scalar]:
        """Decision of the gate on a voltage; a repeated sample (dt = 0) does not count as a measurement.

        Returns: the conditions that it is used and that its NIS exceeds the gate, and the time [s] for which voltages
        have been outside.
        """
        distance = nis(innovation)
        first = state.noise.samples < 0.5
        measured = clean.voltage_measured & isfinite(distance) & ((clean.dt_s > 0) | first)
        outside = measured & (distance > self.gate)
        diverged = state.rejected_s > self.reset_after_s
        used = measured & ((distance <= self.gate) | diverged)
        return used, outside, time_rejected(state.rejected_s, clean.dt_s, outside, measured)

    def restart_if_diverged(self, belief: Belief, voltage_V: Scalar) -> tuple[Belief, Any]:
        """The belief, replaced by ignorance where it is not healthy; and the condition that it is healthy."""
        healthy = self.is_healthy(belief)
        level_V = where(isfinite(voltage_V), voltage_V, 0.0)
        return choose(healthy, belief, self.ignorance(level_V, BULK_STD_V)), healthy

    def is_healthy(self, belief: Belief) -> Any:
        """True where the belief is finite, its covariance positive and its parameters are near the nominal ones."""
        logarithms, voltages = belief.mean[:PARAMETERS], belief.mean[PARAMETERS:]
        _, positive = cholesky(belief.cov)
        return (positive > 0.5) & (logarithms @ logarithms < LARGEST_LOGARITHM**2) & isfinite(sum(voltages))

    def circuit(self, x: np.ndarray) -> rc.Circuit:
        """The parameters in state x."""
        c_bulk, c_surface, r, r_terminal = np.array(self.nominal) * np.exp(x[:PARAMETERS])
        return rc.Circuit(c_bulk, c_surface, r, r, r_terminal)

    def next_state(self, x: np.ndarray, clean: CleanSocSample) -> np.ndarray:
        """State after the step, (n,); the parameters stay."""
        p, voltages, now_A = self.circuit(x), x[PARAMETERS:], clean.now.current_A
        before_A = now_A - clean.change_A
        moved = rc_circuit.next_state_with_voltage(voltages, before_A, clean.mean.current_A, now_A, p, clean.dt_s)
        return np.array([*x[:PARAMETERS], *moved])

    def process_noise(self, state: JointState, clean: CleanSocSample) -> np.ndarray:
        """Q (n, n) of this step: the floor, and K C K' of the last steps ([T] 3.49)."""
        dt_s = clean.dt_s
        charge_As2 = self.current_std_A**2 * dt_s + where(clean.current_known, 0.0, (self.unknown_A * dt_s) ** 2)
        per_V = 1 / (self.nominal.c_bulk_F + self.nominal.c_surface_F), 0.5 / self.nominal.c_surface_F
        walk = [walk_variance(self.parameter_walk, SECONDS_PER_HOUR, dt_s)] * PARAMETERS
        Q = np.diag(np.array([*walk, *(charge_As2 * g**2 for g in per_V), self.disturbance_V**2 * dt_s]))
        if not self.match_Q:
            return Q
        K = state.gain[:, None]
        C = where(dt_s > 0, state.noise.innovation, 0.0)
        return mirror_lower(Q + K @ C @ K.T)

    def measurement_noise(self, state: JointState, before: Belief, clean: CleanSocSample) -> np.ndarray:
        """R (1, 1) of this step: the floor, or the matched one where it is more ([T] 3.50)."""
        instant_ohm = self.nominal.r_terminal_ohm + 0.5 * self.nominal.r_ohm
        unknown_V2 = where(clean.current_known, 0.0, (self.unknown_A * instant_ohm) ** 2)
        floor = np.array([[self.voltage_std_V**2 + unknown_V2]])
        if not self.match_R:
            return floor
        P_yy = unscented.output_covariance(before, _voltage, self.scaling)
        matched = state.noise.residual + P_yy
        return where(state.noise.samples < 0.5, floor, maximum(floor, matched))

    def estimate(
        self, belief: Belief, voltage_V: Scalar, innovation: Innovation, clean: CleanSocSample, flags: Scalar
    ) -> JointEstimate:
        """Estimate after the sample."""
        c_bulk, _, r, r_terminal = (np.sqrt(maximum(belief.cov[k, k], 0.0)) for k in range(PARAMETERS))
        nu = innovation.value[0]
        return JointEstimate(
            circuit=self.circuit(belief.mean),
            c_bulk_std=c_bulk,
            r_std=r,
            r_terminal_std=r_terminal,
            voltage_V=voltage_V - nu,
            voltage_std_V=np.sqrt(innovation.cov[0, 0]),
            innovation_V=where(clean.voltage_measured, nu, math.nan),
            flags=flags,
        )


def _voltage(x: np.ndarray) -> np.ndarray:
    """Terminal voltage [V] in state x, (1,)."""
    return x[TERMINAL:]


#: Smallest relative standard deviation of the parameters at the start: an overconfident joint filter learns nothing.
_LEAST_START_STD = 0.1


class SchemeState(NamedTuple):
    """State of both filters."""

    joint: JointState
    soc: RcFilterState


@dataclass(frozen=True)
class RcAdaptiveSoc:
    """Scheme of [T] fig. 3.10: the joint filter finds the parameters, the SoC filter uses them, sample by sample.

    Settings of both filters; `init` and `step` are pure functions of them.
    """

    joint: RcJoint  #: finds C_b, C_s, R_e and R_t
    soc: RcFilter  #: estimates the state of charge with them; its own model has the values of the battery file

    def init(self, first: SocSample, soc: float | None = None, soc_std: float = INITIAL_SOC_STD) -> SchemeState:
        """State before the first sample, whose voltage gives the SoC where `soc` is None."""
        start = self.soc.init(first, soc, soc_std)
        return SchemeState(self.joint.init(first, bulk_V=float(start.belief.mean[0])), start)

    def step(self, state: SchemeState, sample: SocSample) -> tuple[SchemeState, SocEstimate]:
        """State and estimate after a sample; the model's own circuit is used where the joint filter has diverged."""
        diverged = logical_not(self.joint.is_healthy(unpack(state.joint.belief)))
        joint, found = self.joint.step(state.joint, sample)
        parameters = RcParameters(
            choose(diverged, self.soc.model.circuit, found.circuit),
            capacitance_std=where(diverged, 1.0, found.c_bulk_std),
            resistance_std=where(diverged, 1.0, maximum(found.r_std, found.r_terminal_std)),
        )
        soc, estimate = self.soc.step(state.soc, sample, parameters)
        soh_capacity, resistance_ratio = self.ratios(parameters.circuit)
        soh_capacity_std, resistance_ratio_std = self.ratio_stds(unpack(joint.belief))
        return SchemeState(joint, soc), estimate._replace(
            soh_capacity=soh_capacity,
            soh_capacity_std=where(diverged, 1.0, soh_capacity_std),
            resistance_ratio=resistance_ratio,
            resistance_ratio_std=where(diverged, 1.0, resistance_ratio_std),
            flags=estimate.flags + flags_of({SocFlag.NOT_POSITIVE_DEFINITE: diverged}),
        )

    def ratios(self, p: rc.Circuit) -> tuple[Scalar, Scalar]:
        """Ratios of capacitance and DC resistance to those of the battery file."""
        file = self.soc.model.circuit
        capacitance = (p.c_bulk_F + p.c_surface_F) / (file.c_bulk_F + file.c_surface_F)
        return capacitance, rc_circuit.dc_resistance(p) / rc_circuit.dc_resistance(file)

    def ratio_stds(self, belief: Belief) -> list[Scalar]:
        """Standard deviations of both ratios in the joint filter's belief: sqrt(diag(G P G')), G their Jacobian."""
        _, G = linearize(lambda x: np.array(self.ratios(self.joint.circuit(x))), belief.mean)
        return [np.sqrt(maximum(variance, 0.0)) for variance in np.diag(G @ belief.cov @ G.T)]


def adaptive_soc_of(
    model: rc.RcModel, noise: BatteryNoise | None = None, sensor: CurrentSensor | None = None
) -> RcAdaptiveSoc:
    """The scheme for a model; the joint filter starts at its circuit."""
    noise, sensor = noise or BatteryNoise(), sensor or CurrentSensor()
    std = max(noise.resistance_std, _LEAST_START_STD)
    soc = RcFilter(model, noise, sensor)
    joint = RcJoint(
        nominal_of(model),
        start_std=(std, std, std, std),
        voltage_std_V=noise.voltage_std_V,
        current_std_A=sensor.noise_std_A,
        current_limit_A=soc.limits.current_A,
        highest_ocv_V=model.ocv.voltage_V[-1],
    )
    return RcAdaptiveSoc(joint, soc)
