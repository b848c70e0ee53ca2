"""States and parameters of the RC model together, by the filter of [T] 3.3 in Euler steps; V jumps with the current.

    x = [z_Cb, z_Cs, z_Re, z_R0, V_cb, V_cs, V]    y = V    R_b = R_s = R_e    R_0 = R_t + R_e / 2
    1/C_b = z_Cb / C_b0    1/C_s = z_Cs / C_s0    1/R_e = z_Re / R_e0    R_0 = z_R0 R_00

The parameters z are of order one, relative to their nominal values. [T] has them at the end; at the front they cost
less, because the Cholesky factor is triangular: the sigma points along the voltages all share the mean's parameters.

[T] has R_t itself, and V moves as if the current never changed (di/dt = 0). But the voltage of a battery jumps by R_0
times the change of the current, and a filter without this term explains the jumps by a surface capacitor small enough
to follow: with the exact circuit and an exactly right start C_s falls to a seventh and R_e to a fifth. Here the
equation of [T] moves V - R_0 i, which does not jump, and V is that plus R_0 times the current of its instant. With R_0
in place of R_t this needs no division.

The filter assumes an exact current, and a sigma point may have a negative capacitance. Euler steps make C_s too large
by half a step over the time constant, a share dt (1/C_b + 1/C_s) / (4 R_e), and are unstable where that exceeds one.
This is the published filter, for comparison, and fits into a small microcontroller.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.soc.clean_sample import CleanBareSample, first_input, sanitize_bare
from ohmward.battery.soc.sample import SocSample
from ohmward.checks import require_between, require_each_positive, require_positive
from ohmward.errors import InputError
from ohmward.filters import adaptive, unscented
from ohmward.filters.belief import Belief, PackedBelief, pack, unpack
from ohmward.filters.gate import apply_gain, choose
from ohmward.filters.linear_algebra import mirror_lower
from ohmward.trace import Scalar, maximum, where
from ohmward_lab.published.rc import Nominal

#: Number of parameters, the first elements of the state.
PARAMETERS = 4
#: Indices of the voltages in the state.
BULK, SURFACE, TERMINAL = range(PARAMETERS, PARAMETERS + 3)
STATES = TERMINAL + 1

#: Parameters are kept above this share of their nominal values.
LEAST = 0.02


class TextbookJointState(NamedTuple):
    """State of the filter."""

    belief: PackedBelief  #: mean (7,) and lower triangle of the covariance
    noise: adaptive.NoiseEstimate  #: second moments of innovation and residual [V^2]
    gain: np.ndarray  #: (7,) of the last voltage
    current_A: Any  #: of the sample before


class TextbookJointEstimate(NamedTuple):
    """Estimate after a sample."""

    c_bulk_F: Any  #: capacitance C_b [F]
    c_surface_F: Any  #: capacitance C_s [F]
    r_ohm: Any  #: R_e, in front of each capacitor [ohm]
    r_terminal_ohm: Any  #: R_t, R_0 less R_e / 2 [ohm]
    bulk_V: Any  #: voltage of the bulk capacitor
    surface_V: Any  #: voltage of the surface capacitor
    innovation_V: Any  #: measured minus expected voltage; nan when there was none


@dataclass(frozen=True)
class TextbookJoint:
    """Settings; `init`, `start` and `step` are pure functions of them."""

    nominal: Nominal  #: start of the parameters
    start_std: float = 0.3  #: relative standard deviation of that start
    #: change of each state in one step, relative for parameters: root of the diagonal floor of Q. Keep it small, or the
    #: estimates drift.
    walk: tuple[float, ...] = (1e-5, 1e-5, 1e-5, 1e-5, 1e-5, 1e-5, 1e-4)
    voltage_std_V: float = 0.002  #: of the voltage sensor: floor of R
    window: float = 100.0  #: effective number of samples whose innovations the noise is matched to
    highest_ocv_V: float = math.inf  #: of the battery; voltages that are impossible with it are ignored

    def __post_init__(self) -> None:
        require_each_positive("nominal.", self.nominal, *Nominal._fields)
        require_positive("start_std", self.start_std)
        if len(self.walk) != STATES:
            raise InputError(f"walk must have {STATES} numbers, one for each state, got {len(self.walk)}")
        require_each_positive("", self, "walk", "voltage_std_V")
        require_between("window", self.window, 1.0, math.inf)

    def init(self, first: SocSample, bulk_std_V: float = 0.05) -> TextbookJointState:
        """State before the first sample: at rest at its voltage, with standard deviation `bulk_std_V`.

        Raises:
            InputError: the first sample has no voltage.
        """
        if not math.isfinite(first.voltage_V):
            raise InputError("the first sample has no voltage, which this filter starts from; begin with one that has")
        return self.start(first, bulk_std_V)

    def start(self, first: SocSample, bulk_std_V: Any) -> TextbookJointState:
        """State before the first sample, as `init`; traceable."""
        voltages = STATES - PARAMETERS
        mean = np.array([*np.ones(PARAMETERS), *[first.voltage_V] * voltages])
        variances = np.square(np.array([*[self.start_std] * PARAMETERS, *[bulk_std_V] * voltages]))
        moments = adaptive.NoiseEstimate(np.zeros((1, 1)), np.zeros((1, 1)), 0.0)
        belief = pack(Belief(mean, np.diag(variances)))
        return TextbookJointState(belief, moments, np.zeros(len(mean)), first_input(first).current_A)

    def step(self, state: TextbookJointState, sample: SocSample) -> tuple[TextbookJointState, TextbookJointEstimate]:
        """State and estimate after a sample."""
        clean = self.sanitize(state, sample)
        before = unpack(state.belief)
        prior, correction = unscented.correct_reusing_points(
            before,
            lambda x: self.next_state(x, clean.mean_A, clean.current_A, clean.dt_s),
            lambda x: x[TERMINAL:],
            np.array([clean.voltage_V]),
            self.process_noise(state),
            state.noise.residual + before.cov[TERMINAL:, TERMINAL:] + self.voltage_std_V**2,
        )
        K = where(clean.measured, correction.gain, 0.0)
        corrected = apply_gain(prior, correction.innovation, K)
        after = state._replace(belief=pack(corrected), gain=K[:, 0])
        return self.concluded(after, correction.innovation.value[0], clean)

    def sanitize(self, state: TextbookJointState, sample: SocSample) -> CleanBareSample:
        """The sample with impossible values replaced; no step counts as too long."""
        return sanitize_bare(sample, state.current_A, self.highest_ocv_V, math.inf)

    def process_noise(self, state: TextbookJointState) -> np.ndarray:
        """Q (7, 7): K C K' ([T] 3.49) and the floor."""
        floor = np.diag(np.square(np.array(self.walk)))
        return mirror_lower(floor + state.noise.innovation * np.outer(state.gain, state.gain))

    def concluded(
        self, state: TextbookJointState, innovation_V: Scalar, clean: CleanBareSample
    ) -> tuple[TextbookJointState, TextbookJointEstimate]:
        """State with its parameters limited and the noise moments updated, and the estimate."""
        mean = self.possible(state.belief.mean)
        residual = np.array([clean.voltage_V - mean[TERMINAL]])
        moments = adaptive.remember(state.noise, np.array([innovation_V]), residual, self.window)
        noise = choose(clean.measured, moments, state.noise)
        belief = state.belief._replace(mean=mean)
        after = state._replace(belief=belief, noise=noise, current_A=clean.current_A)
        return after, self.estimate(mean, where(clean.measured, innovation_V, math.nan))

    def next_state(self, x: np.ndarray, mean_A: Scalar, now_A: Scalar, dt_s: Scalar) -> np.ndarray:
        """State (7,) after an Euler step; [T] (3.6) with R_b = R_s, its indices corrected, for U = V - R_0 i.

            dU/dt = (1 / (2 R_e)) (1 / C_s - 1 / C_b) (V_cb - U) + (1 / (4 C_b) + 1 / (4 C_s)) i

        mean_A: current over the step, half way between those of its ends.  now_A: current at its end.
        """
        z_bulk, z_surface, z_r, z_instant, bulk_V, surface_V, V = x
        bulk = dt_s * (0.5 / self.nominal.c_bulk_F) * z_bulk  # dt / (2 C): voltage per ampere of the step
        surface = dt_s * (0.5 / self.nominal.c_surface_F) * z_surface
        g = z_r * (1 / self.nominal.r_ohm)
        instant_ohm = z_instant * self.instant_ohm
        across_A = g * (surface_V - bulk_V)
        U = V - instant_ohm * (2 * mean_A - now_A)
        U_next = U + (surface - bulk) * (g * (bulk_V - U)) + (surface + bulk) * (0.5 * mean_A)
        moved = [
            bulk_V + bulk * (across_A + mean_A),
            surface_V + surface * (mean_A - across_A),
            U_next + instant_ohm * now_A,
        ]
        return np.array([*x[:PARAMETERS], *moved])

    @property
    def instant_ohm(self) -> float:
        """Nominal R_0 = R_t + R_e / 2 [ohm]."""
        return self.nominal.r_terminal_ohm + 0.5 * self.nominal.r_ohm

    def possible(self, mean: np.ndarray) -> np.ndarray:
        """The mean (7,) with its parameters positive, and R_e so small that R_t is positive too."""
        z_bulk, z_surface, z_r, z_instant = (maximum(z, LEAST) for z in mean[:PARAMETERS])
        most_ohm = 2 * (z_instant * self.instant_ohm - LEAST * self.nominal.r_terminal_ohm)
        z_r = maximum(z_r, self.nominal.r_ohm / most_ohm)
        return np.array([z_bulk, z_surface, z_r, z_instant, *mean[PARAMETERS:]])

    def estimate(self, x: np.ndarray, innovation_V: Scalar) -> TextbookJointEstimate:
        """Parameters and voltages of state x in their units."""
        z_bulk, z_surface, z_r, z_instant = x[:PARAMETERS]
        r_ohm = self.nominal.r_ohm / z_r
        return TextbookJointEstimate(
            c_bulk_F=self.nominal.c_bulk_F / z_bulk,
            c_surface_F=self.nominal.c_surface_F / z_surface,
            r_ohm=r_ohm,
            r_terminal_ohm=z_instant * self.instant_ohm - 0.5 * r_ohm,
            bulk_V=x[BULK],
            surface_V=x[SURFACE],
            innovation_V=innovation_V,
        )
