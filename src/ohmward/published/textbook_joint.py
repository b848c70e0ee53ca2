"""States and parameters of the RC model together, by the filter as [T] 3.3 has it: Euler steps and nothing else.

    x = [z_Cb, z_Cs, z_Re, z_Rt, V_cb, V_cs, V]    y = V    R_b = R_s = R_e
    1/C_b = z_Cb / C_b0    1/C_s = z_Cs / C_s0    1/R_e = z_Re / R_e0    R_t = z_Rt R_t0

the parameters being of order one by their nominal values. [T] has them at the end; at the front they cost less, because
the Cholesky factor is triangular: the sigma points along the voltages all share the parameters of the mean.

It trusts the current, assumes di/dt = 0 while V moves, and a sigma point may have a negative capacitance: `RcJoint`
does all that better. This one is the published filter to compare with, and what fits into a small microcontroller.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.soc.clean_sample import first_input, is_current, is_voltage
from ohmward.battery.soc.sample import SocSample
from ohmward.checks import require_between, require_positive
from ohmward.errors import InputError
from ohmward.filters import adaptive, unscented
from ohmward.filters.belief import Belief, PackedBelief, pack, unpack
from ohmward.filters.gate import apply_gain, choose
from ohmward.filters.linear_algebra import mirror_lower
from ohmward.published.rc_joint import PARAMETERS, Nominal, require_nominal
from ohmward.trace import maximum, where

STATES = 7

#: Parameters are kept above this share of their nominal values.
LEAST = 0.02


class TextbookJointState(NamedTuple):
    """What the filter carries.

    belief: mean (7,) and lower triangle of the covariance.
    noise: second moments of innovation and residual [V^2].
    gain: (7,) of the last voltage.
    current_A: of the sample before.
    """

    belief: PackedBelief
    noise: adaptive.NoiseEstimate
    gain: np.ndarray
    current_A: Any


class TextbookJointEstimate(NamedTuple):
    """What is known after a sample.

    c_bulk_F, c_surface_F: capacitances C_b, C_s [F].
    r_ohm: R_e, in front of each capacitor [ohm].
    r_terminal_ohm: R_t [ohm].
    bulk_V, surface_V: voltages of the capacitors.
    innovation_V: measured minus expected voltage; nan when there was none.
    """

    c_bulk_F: Any
    c_surface_F: Any
    r_ohm: Any
    r_terminal_ohm: Any
    bulk_V: Any
    surface_V: Any
    innovation_V: Any


class CleanJointSample(NamedTuple):
    """What a sample says.

    dt_s: step [s], >= 0.
    current_A: of this instant; that of the sample before where it is not measured.
    mean_A: mean current over the step.
    voltage_V: measured; 0 where it is not.
    measured: whether there is a voltage.
    """

    dt_s: Any
    current_A: Any
    mean_A: Any
    voltage_V: Any
    measured: Any


@dataclass(frozen=True)
class TextbookJoint:
    """Settings; `init`, `start` and `step` are pure functions of them.

    Attributes:
        nominal: start of the parameters.
        start_std: how wrong that start may be, as a share of it.
        walk: change of each state in one step, of the parameters as a share: floor of Q, the diagonal's root. [P] finds
            that it must be small, or the filter wanders.
        voltage_std_V: of the voltage sensor: floor of R.
        window: effective number of samples whose innovations the noise is matched to.
        highest_ocv_V: of the battery; voltages that no such battery can show are none.
        scaling: of the sigma points.
    """

    nominal: Nominal
    start_std: float = 0.3
    walk: tuple[float, ...] = (1e-5, 1e-5, 1e-5, 1e-5, 1e-5, 1e-5, 1e-4)
    voltage_std_V: float = 0.002
    window: float = 100.0
    highest_ocv_V: float = math.inf
    scaling: unscented.Scaling = field(default=unscented.DEFAULT)

    def __post_init__(self) -> None:
        require_nominal(self.nominal)
        require_positive("start_std", self.start_std)
        if len(self.walk) != STATES:
            raise InputError(f"walk must have {STATES} numbers, one for each state, got {len(self.walk)}")
        require_positive("walk", self.walk)
        require_positive("voltage_std_V", self.voltage_std_V)
        require_between("window", self.window, 1.0, math.inf)

    def init(self, first: SocSample, bulk_std_V: float = 0.05) -> TextbookJointState:
        """State before the first sample: at rest at its voltage, give or take `bulk_std_V`.

        Raises:
            InputError: the first sample has no voltage.
        """
        if not math.isfinite(first.voltage_V):
            raise InputError("the first sample has no voltage, which this filter starts from; begin with one that has")
        return self.start(first, bulk_std_V)

    def start(self, first: SocSample, bulk_std_V: Any) -> TextbookJointState:
        """The same, traceable."""
        mean = np.array([*np.ones(PARAMETERS), *[first.voltage_V] * 3])
        variances = np.square(np.array([*[self.start_std] * PARAMETERS, *[bulk_std_V] * 3]))
        moments = adaptive.NoiseEstimate(np.zeros((1, 1)), np.zeros((1, 1)), 0.0)
        belief = pack(Belief(mean, np.diag(variances)))
        return TextbookJointState(belief, moments, np.zeros(len(mean)), first_input(first).current_A)

    def step(self, state: TextbookJointState, sample: SocSample) -> tuple[TextbookJointState, TextbookJointEstimate]:
        """The state after a sample, and what is known then."""
        reading = self.sanitize(state, sample)
        before, noise = unpack(state.belief), state.noise
        P_yy = before.cov[-1:, -1:]
        prior, correction = unscented.correct_reusing_points(
            before,
            lambda x: self.next_state(x, reading.mean_A, reading.dt_s),
            lambda x: x[-1:],
            np.array([reading.voltage_V]),
            mirror_lower(np.diag(np.square(np.array(self.walk))) + noise.innovation * np.outer(state.gain, state.gain)),
            noise.residual + P_yy + self.voltage_std_V**2,
            self.scaling,
        )
        K = where(reading.measured, correction.gain, 0.0)
        corrected = apply_gain(prior, correction.innovation, K)
        after = state._replace(belief=pack(corrected), gain=K[:, 0])
        return self.concluded(after, correction.innovation.value[0], reading)

    def sanitize(self, state: TextbookJointState, sample: SocSample) -> CleanJointSample:
        """What a sample says."""
        current_A = where(is_current(sample.current_A, math.inf), sample.current_A, state.current_A)
        measured = is_voltage(sample.voltage_V, self.highest_ocv_V)
        return CleanJointSample(
            where(sample.dt_s > 0, sample.dt_s, 0.0),
            current_A,
            0.5 * (current_A + state.current_A),
            where(measured, sample.voltage_V, 0.0),
            measured,
        )

    def concluded(
        self, state: TextbookJointState, innovation_V: Any, reading: CleanJointSample
    ) -> tuple[TextbookJointState, TextbookJointEstimate]:
        """The state with possible parameters and its moments of the noise renewed, and what is known then."""
        mean = self.possible(state.belief.mean)
        nu, residual = np.array([innovation_V]), np.array([reading.voltage_V - mean[-1]])
        noise = choose(reading.measured, adaptive.remember(state.noise, nu, residual, self.window), state.noise)
        belief = state.belief._replace(mean=mean)
        after = state._replace(belief=belief, noise=noise, current_A=reading.current_A)
        return after, self.estimate(mean, where(reading.measured, innovation_V, math.nan))

    def next_state(self, x: np.ndarray, current_A: Any, dt_s: Any) -> np.ndarray:
        """State (7,) after an Euler step; [T] (3.6) with R_b = R_s and its indices set right."""
        z_bulk, z_surface, z_r, z_terminal, bulk_V, surface_V, V = x
        per_bulk, per_surface = dt_s * (0.5 / self.nominal.c_bulk_F), dt_s * (0.5 / self.nominal.c_surface_F)
        bulk, surface = per_bulk * z_bulk, per_surface * z_surface  # dt / (2 C), what a current moves in the step
        g = z_r * (1 / self.nominal.r_ohm)
        across_A = g * (surface_V - bulk_V)
        terminal_V = bulk_V - V + z_terminal * (self.nominal.r_terminal_ohm * current_A)
        moved = [
            bulk_V + bulk * (across_A + current_A),
            surface_V + surface * (current_A - across_A),
            V + (surface - bulk) * (g * terminal_V) + surface * current_A,
        ]
        return np.array([*x[:PARAMETERS], *moved])

    def possible(self, mean: np.ndarray) -> np.ndarray:
        """The mean (7,) with its parameters positive."""
        return np.array([*(maximum(z, LEAST) for z in mean[:PARAMETERS]), *mean[PARAMETERS:]])

    def estimate(self, x: np.ndarray, innovation_V: Any) -> TextbookJointEstimate:
        """What state x says in units."""
        c_bulk, c_surface, r, r_terminal = self.nominal
        return TextbookJointEstimate(
            c_bulk / x[0], c_surface / x[1], r / x[2], r_terminal * x[3], x[PARAMETERS], x[PARAMETERS + 1], innovation_V
        )
