"""RC model and Kalman filter with three states as in [P] 2.2 and 3.1; SoC from V_cb by the inverse OCV curve.

    x = [V_cb, V_cs, V_o]        y = V_o        dV_o/dt = A33 (V_o - V_cb) + B31 i

The capacitors are those of `rc_circuit`; V_o as a state moves under the assumption di/dt = 0.

With `jumps` V_o also changes by (R_t + R_b R_s / D) (i_k - i_(k-1)), which di/dt = 0 leaves out. The step is exact in
both cases. Q and R are those of (25), constant and diagonal; P0 is not printed. The filter uses its start as given, to
show the effect of a wrong one: all three voltages at the OCV of that SoC, as [P] starts at the OCV of a full battery.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.models.noise import BatteryNoise
from ohmward.battery.soc.clean_sample import first_input, sanitize_bare
from ohmward.battery.soc.sample import INITIAL_SOC_STD, SocEstimate, SocSample
from ohmward.checks import require_each_positive
from ohmward.filters import extended, kalman
from ohmward.filters.belief import Belief, PackedBelief, pack, unpack
from ohmward.filters.gate import choose
from ohmward.trace import clip, where
from ohmward_lab.published import rc, rc_circuit
from ohmward_lab.published.rc_filter import SocByCurve

#: Row that selects V_o from the state.
_H = np.array([[0.0, 0.0, 1.0]])


class RcThreeState(NamedTuple):
    """State of the filter: mean (3,) and lower triangle of the covariance, and the current [A] of the sample before."""

    belief: PackedBelief
    current_A: Any


@dataclass(frozen=True)
class RcThreeStates:
    """Settings; `init` and `step` are pure functions of them."""

    model: rc.RcModel  #: the circuit and its OCV curve
    process_variance_V2: tuple[float, float, float] = (0.00001, 0.001, 0.9)  #: diagonal of Q in one step
    voltage_variance_V2: float = 0.8  #: R
    start_variance_V2: float = 1.0  #: each element on the diagonal of P0
    jumps: bool = False  #: True lets V_o follow a change of the current at once; False is [P]'s di/dt = 0

    def __post_init__(self) -> None:
        require_each_positive("", self, "process_variance_V2", "voltage_variance_V2", "start_variance_V2")

    @cached_property
    def link(self) -> SocByCurve:
        """The inverse OCV curve."""
        return SocByCurve(self.model, BatteryNoise())

    def init(self, first: SocSample, soc: float | None = None, soc_std: float = INITIAL_SOC_STD) -> RcThreeState:
        """State before the first sample: at rest at this SoC, used as given; with None V_cb is the first voltage."""
        ocv_V = float(first.voltage_V) if soc is None else self.link.ocv_V(soc)
        belief = Belief(np.full(3, ocv_V), self.start_variance_V2 * np.eye(3))
        return RcThreeState(pack(belief), first_input(first).current_A)

    def step(self, state: RcThreeState, sample: SocSample) -> tuple[RcThreeState, SocEstimate]:
        """State and estimate after a sample."""
        clean = sanitize_bare(sample, state.current_A, self.model.ocv.voltage_V[-1])
        ends = (state.current_A, clean.current_A) if self.jumps else (clean.mean_A, clean.mean_A)
        prior = extended.predict(
            unpack(state.belief),
            lambda x: rc_circuit.next_state_with_voltage(x, ends[0], clean.mean_A, ends[1], self.model, clean.dt_s),
            np.diag(np.array(self.process_variance_V2)),
        )
        R = np.array([[self.voltage_variance_V2]])
        posterior, innovation, _ = kalman.correct(prior, np.array([clean.voltage_V]), _H, R)
        posterior = choose(clean.measured, posterior, prior)
        return RcThreeState(pack(posterior), clean.current_A), self.estimate(
            posterior, prior.mean[2], where(clean.measured, innovation.value[0], math.nan), innovation.cov[0, 0]
        )

    def estimate(self, posterior: Belief, expected_V: Any, innovation_V: Any, variance_V2: Any) -> SocEstimate:
        """SoC at V_cb on the OCV curve; its std is half the SoC range between plus and minus one sigma of V_cb."""
        bulk_V, std_V = posterior.mean[0], np.sqrt(posterior.cov[0, 0])
        width = self.link.soc_beyond(bulk_V + std_V) - self.link.soc_beyond(bulk_V - std_V)
        soc = clip(self.link.soc_beyond(bulk_V), 0.0, 1.0)
        return SocEstimate(
            soc=soc,
            soc_std=0.5 * width,
            voltage_V=expected_V,
            voltage_std_V=np.sqrt(variance_V2),
            innovation_V=innovation_V,
            flags=0.0,
        )
