"""The scheme of [T] fig. 3.10 by one of four filters (EKF, AEKF, UKF, AUKF), with the constants of [T] (3.51).

First stage, states and parameters of the RC model together ([T] 3.3):

    x = [V_cb, V_cs, V, 1/C_b, 1/C_s, 1/R_e, R_t]        y = V        R_b = R_s = R_e

Second stage, with the parameters of the first ([T] 3.4.2):

    x = [V_cb, V_cs, soc]        y = (V_cb + V_cs) / 2 + (R_t + R_e / 2) i        d soc/dt = i / Q

The two adaptive filters match Q = K C K' and R = mean residual moment + P_yy ((3.49), (3.50) with 1/L restored),
starting from Q0 and R0; the other two keep these. Sigma points are redrawn for the output: with (3.42) on the
propagated ones the 0.9 V^2 of Q0 would be missing in its covariance.

With `corrected` False the circuit is as printed: (3.6) in Euler steps, with V_cs and 1/(2 R_e C_s) and no jump of V
with the current, R_e in (3.1), each capacitor of 3.4.2 stepped with its partner frozen, and unbounded parameters. With
P0 = I a sigma point has 1/C_b = -2 per farad, and the two unscented filters end in nan. If corrected, the steps are
exact, and the circuit sees parameters within a factor of `LIMIT` of the offline ones, where Euler steps are unstable.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.models.noise import BatteryNoise
from ohmward.battery.soc.clean_sample import CleanBareSample, first_input, sanitize_bare
from ohmward.battery.soc.sample import INITIAL_SOC_STD, SocEstimate, SocSample
from ohmward.checks import require_between, require_one_of
from ohmward.errors import InputError
from ohmward.filters import adaptive
from ohmward.filters.belief import Belief
from ohmward.filters.linear_algebra import lower_triangle, symmetric_from
from ohmward.trace import clip, maximum, where
from ohmward_lab.published import rc, rc_circuit
from ohmward_lab.published.rc_filter import SocByCurve

METHODS = ("ekf", "aekf", "ukf", "aukf")
#: [T] (3.51): diagonals of P0 and Q0, in the squared units of the state, and R0 [V^2]; L of (3.50).
P0 = (1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0)
Q0 = (0.005, 0.07, 0.9, 0.0001, 0.005, 0.6, 0.009)
R0_V2 = 0.1
WINDOW = 100.0

#: Largest ratio of a parameter to its offline value, either way.
LIMIT = 10.0
#: Floor of a matched covariance as a share of Q0 and R0: next to nothing, as [T] has no floor.
MATCHED_FLOOR = 1e-12
#: Random walk of the SoC in one step of the second stage, whose R0 is that of (3.51); [T] prints no constants of it.
SOC_WALK = 1e-5
#: Initial standard deviation [V] of both voltages of the second stage about the OCV of its SoC.
REST_STD_V = 1e-3

_TERMINAL = 2


class PackedAdaptiveState(NamedTuple):
    """State of an adaptive filter as it is stored: lower triangles instead of symmetric matrices."""

    mean: np.ndarray  #: (n,)
    #: (n (n + 1) / 2,), row by row
    cov: np.ndarray
    Q: np.ndarray
    #: (m (m + 1) / 2,), row by row
    R: np.ndarray
    innovation: np.ndarray
    residual: np.ndarray
    samples: float  #: of the means


def pack(state: adaptive.AdaptiveState) -> PackedAdaptiveState:
    """The state with lower triangles only; `unpack` undoes it."""
    (mean, cov), Q, R, noise = state
    cov, Q, R, innovation, residual = map(lower_triangle, (cov, Q, R, noise.innovation, noise.residual))
    return PackedAdaptiveState(mean, cov, Q, R, innovation, residual, noise.samples)


def unpack(packed: PackedAdaptiveState) -> adaptive.AdaptiveState:
    """The state with full matrices, symmetric by construction."""
    mean, *triangles, samples = packed
    cov, Q, R, innovation, residual = map(symmetric_from, triangles)
    noise = adaptive.NoiseEstimate(innovation, residual, samples)
    return adaptive.AdaptiveState(Belief(mean, cov), Q, R, noise)


class SchemeByMethodState(NamedTuple):
    """Belief, noise and moments of both stages, and the current [A] of the sample before."""

    joint: PackedAdaptiveState
    soc: PackedAdaptiveState
    current_A: Any


class SchemeByMethodEstimate(NamedTuple):
    """Estimates after a sample: of the first stage, then the state of charge of the second and its variance."""

    circuit: rc.Circuit  #: the parameters, as the circuit sees them
    innovation_V: Any  #: measured minus expected voltage; nan when there was none
    residual_V: Any  #: measured voltage minus the filter's after the sample
    voltage_variance_V2: Any  #: of the filter's voltage after the sample
    soc: Any
    soc_variance: Any


@dataclass(frozen=True)
class SchemeByMethod:
    """Settings; `init` and `step` are pure functions of them."""

    model: rc.RcModel  #: found offline: start of the parameters, OCV curve and capacity
    method: str = "aukf"  #: one of METHODS, in both stages
    corrected: bool = True  #: False is the circuit as printed
    window: float = WINDOW  #: L of the means

    def __post_init__(self) -> None:
        require_one_of("method", self.method, METHODS)
        require_between("window", self.window, 1.0, np.inf)

    @cached_property
    def nominal(self) -> rc.Nominal:
        """The offline circuit with R_b = R_s."""
        return rc.nominal_of(self.model)

    @property
    def parameters(self) -> np.ndarray:
        """1/C_b, 1/C_s, 1/R_e, R_t (4,) of the offline circuit."""
        c_bulk_F, c_surface_F, r_ohm, r_terminal_ohm = self.nominal
        return np.array([1.0 / c_bulk_F, 1.0 / c_surface_F, 1.0 / r_ohm, r_terminal_ohm])

    def init(self, first: SocSample, soc: float, soc_std: float) -> SchemeByMethodState:
        """State before the first sample: at rest, V at its voltage, the SoC as given."""
        voltage_V, ocv_V = float(first.voltage_V), float(rc_circuit.at_rest(self.model, soc)[0])
        joint = Belief(np.array([*[voltage_V] * 3, *self.parameters]), np.diag(np.array(P0)))
        along = np.outer(self.charge_direction, self.charge_direction)
        second = Belief(
            np.array([ocv_V, ocv_V, soc]), soc_std**2 * along + np.diag([REST_STD_V**2, REST_STD_V**2, 0.0])
        )
        R = np.array([[R0_V2]])
        return SchemeByMethodState(
            pack(adaptive.init(joint, np.diag(np.array(Q0)), R)),
            pack(adaptive.init(second, SOC_WALK**2 * along, R)),
            first_input(first).current_A,
        )

    @cached_property
    def charge_direction(self) -> np.ndarray:
        """Change of V_cb, V_cs [V] and SoC by a charge error of one full capacity, on the offline OCV line."""
        slope_V = self.model.capacity_As / (self.nominal.c_bulk_F + self.nominal.c_surface_F)
        return np.array([slope_V, slope_V, 1.0])

    def step(self, state: SchemeByMethodState, sample: SocSample) -> tuple[SchemeByMethodState, SchemeByMethodEstimate]:
        """State and estimates after a sample; without a voltage they are only predicted."""
        clean = sanitize_bare(sample, state.current_A, np.inf)
        voltage_V = where(clean.measured, clean.voltage_V, np.nan)
        joint, innovation_V = self.joint_step(state.joint, voltage_V, clean)
        mean, cov = joint.belief
        per_bulk, per_surface, per_ohm, r_terminal_ohm = mean[_TERMINAL + 1 :]
        r_ohm = 1.0 / per_ohm
        circuit = rc.Circuit(1.0 / per_bulk, 1.0 / per_surface, r_ohm, r_ohm, r_terminal_ohm)
        soc = self.soc_step(state.soc, voltage_V, clean, circuit)
        after = SchemeByMethodState(pack(joint), pack(soc), clean.current_A)
        return after, SchemeByMethodEstimate(
            circuit,
            innovation_V,
            voltage_V - mean[_TERMINAL],
            cov[_TERMINAL, _TERMINAL],
            soc.belief.mean[2],
            soc.belief.cov[2, 2],
        )

    def joint_step(
        self, state: PackedAdaptiveState, voltage_V: Any, clean: CleanBareSample
    ) -> tuple[adaptive.AdaptiveState, Any]:
        """State of the first stage after a sample, its parameters within the limit, and the innovation [V]."""
        before, parameters = unpack(state), slice(_TERMINAL + 1, None)
        after, innovation = self.filter_step(
            before, lambda x: self.next_state(x, clean), lambda x: x[_TERMINAL : _TERMINAL + 1], voltage_V, np.diag(Q0)
        )
        mean = np.array([*after.belief.mean[: _TERMINAL + 1], *self.limited(after.belief.mean[parameters])])
        return after._replace(belief=after.belief._replace(mean=mean)), innovation.value[0]

    def soc_step(
        self, state: PackedAdaptiveState, voltage_V: Any, clean: CleanBareSample, p: rc.Circuit
    ) -> adaptive.AdaptiveState:
        """State of the second stage after a sample, with these parameters."""
        current_A = clean.mean_A if self.corrected else before_A(clean)
        instant_ohm = rc.instant_resistance(p) if self.corrected else p.r_terminal_ohm + p.r_bulk_ohm

        def f(x: np.ndarray) -> np.ndarray:
            soc = x[2] + clean.dt_s * (1.0 / self.model.capacity_As) * current_A
            return np.array([*self.next_voltages(x, clean, p), soc])

        def h(x: np.ndarray) -> np.ndarray:
            return np.array([0.5 * x[0] + 0.5 * x[1] + instant_ohm * clean.current_A])

        Q = SOC_WALK**2 * np.outer(self.charge_direction, self.charge_direction)
        after, _ = self.filter_step(unpack(state), f, h, voltage_V, Q)
        return after

    def filter_step(
        self, before: adaptive.AdaptiveState, f: Any, h: Any, voltage_V: Any, Q: np.ndarray
    ) -> tuple[adaptive.AdaptiveState, Any]:
        """One filter step, for either stage."""
        adapts, unscented = self.method in ("aekf", "aukf"), self.method in ("ukf", "aukf")
        share = MATCHED_FLOOR if adapts else 1.0
        matching = adaptive.Matching(share * Q, share * np.array([[R0_V2]]), self.window, np.inf, adapts, adapts)
        step = adaptive.unscented_step if unscented else adaptive.extended_step
        return step(before, f, h, np.array([voltage_V]), matching)

    def limited(self, parameters: np.ndarray) -> np.ndarray:
        """The parameters (4,) clipped to the limit if corrected, else unchanged."""
        if not self.corrected:
            return parameters
        return np.array([clip(p, o / LIMIT, o * LIMIT) for p, o in zip(parameters, self.parameters, strict=True)])

    def next_state(self, x: np.ndarray, clean: CleanBareSample) -> np.ndarray:
        """State (7,) of the first stage after a step: exact, or [T] (3.6) and (3.35) by Euler; the parameters stay."""
        x1, x2, x3 = x[: _TERMINAL + 1]
        x4, x5, x6, x7 = self.within(x[_TERMINAL + 1 :])
        if self.corrected:
            r_ohm = 1.0 / x6
            p = rc.Circuit(1.0 / x4, 1.0 / x5, r_ohm, r_ohm, x7)
            currents_A = before_A(clean), clean.mean_A, clean.current_A
            moved = rc_circuit.next_state_with_voltage(x[: _TERMINAL + 1], *currents_A, p, clean.dt_s)
            return np.array([*moved, *x[_TERMINAL + 1 :]])
        u, dt = clean.current_A, clean.dt_s
        f1 = 0.5 * x4 * (x6 * (x2 - x1) + u)
        f2 = 0.5 * x5 * (x6 * (x1 - x2) + u)
        f3 = 0.5 * x6 * ((x4 - x5) * (x2 - x1) + (x5 + x7 * (x5 - x4)) * u)
        return np.array([x1 + dt * f1, x2 + dt * f2, x3 + dt * f3, *x[_TERMINAL + 1 :]])

    def within(self, parameters: np.ndarray) -> np.ndarray:
        """Parameters that the circuit sees; an EKF linearises at the mean, which is within the limit already."""
        return self.limited(parameters) if self.method in ("ukf", "aukf") else parameters

    def next_voltages(self, x: np.ndarray, clean: CleanBareSample, p: rc.Circuit) -> np.ndarray:
        """V_cb, V_cs [V] (2,) of the second stage after a step: exact, or as printed with the partner frozen."""
        if self.corrected:
            return rc_circuit.next_state(x[:2], clean.mean_A, p, clean.dt_s)
        bulk, surface, drop_V = x[0], x[1], p.r_bulk_ohm * before_A(clean)
        of_bulk, of_surface = (np.exp(clean.dt_s * -0.5 / (p.r_bulk_ohm * c)) for c in (p.c_bulk_F, p.c_surface_F))
        return np.array(
            [
                of_bulk * bulk + (1.0 - of_bulk) * (drop_V + surface),
                of_surface * surface + (1.0 - of_surface) * (drop_V + bulk),
            ]
        )


def before_A(clean: CleanBareSample) -> Any:
    """Current [A] at the start of the step."""
    return 2.0 * clean.mean_A - clean.current_A


@dataclass(frozen=True)
class SchemeSoc:
    """The scheme; its estimates are nan except for SoC and its standard deviation."""

    scheme: SchemeByMethod

    def init(self, first: SocSample, soc: float | None = None, soc_std: float = INITIAL_SOC_STD) -> SchemeByMethodState:
        """State before the first sample; `soc` None is found from its voltage on the OCV curve.

        A first sample without a voltage is assumed to be at rest at the given SoC.

        Raises:
            InputError: neither a SoC nor a voltage.
        """
        model, known = self.scheme.model, math.isfinite(first.voltage_V)
        if soc is None and not known:
            raise InputError("the first sample has no voltage: give soc, the state of charge at the start")
        if soc is None:
            beyond: Any = SocByCurve(model, BatteryNoise()).soc_beyond(first.voltage_V)
            soc = min(max(float(beyond), 0.0), 1.0)
        voltage_V = first.voltage_V if known else float(rc_circuit.at_rest(model, soc)[0])
        return self.scheme.init(first._replace(voltage_V=voltage_V), soc, soc_std)

    def step(self, state: SchemeByMethodState, sample: SocSample) -> tuple[SchemeByMethodState, SocEstimate]:
        """State and estimate after a sample."""
        after, found = self.scheme.step(state, sample)
        return after, SocEstimate(found.soc, np.sqrt(maximum(found.soc_variance, 0.0)))
