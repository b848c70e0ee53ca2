"""The scheme of [T] fig. 3.10: the joint filter finds the parameters, the SoC filter uses them, sample by sample."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ohmward.battery.models import rc
from ohmward.battery.models.noise import BatteryNoise
from ohmward.battery.models.sensor import CurrentSensor
from ohmward.battery.soc.rc_filter import RcFilter, RcFilterState, RcParameters
from ohmward.battery.soc.sample import SocEstimate, SocFlag, SocSample
from ohmward.filters.belief import Belief, unpack
from ohmward.filters.flags import flags_of
from ohmward.filters.gate import choose
from ohmward.trace import linearize, logical_not, maximum, where
from ohmward.trace.expression import Scalar
from ohmward_lab.published.rc_joint import JointState, RcJoint, nominal_of

#: Relative standard deviation of the parameters at the start at least: a joint filter that is too sure learns nothing.
_LEAST_START_STD = 0.1


class SchemeState(NamedTuple):
    """State of both filters."""

    joint: JointState
    soc: RcFilterState


@dataclass(frozen=True)
class RcAdaptiveSoc:
    """Settings of both filters; `init` and `step` are pure functions of them."""

    joint: RcJoint  #: finds C_b, C_s, R_e and R_t
    soc: RcFilter  #: estimates the state of charge with them; its model has those of the battery file

    def init(self, first: SocSample, soc: float | None = None, soc_std: float = 0.03) -> SchemeState:
        """State before the first sample, which it looks at; `soc` None takes it from the first voltage."""
        start = self.soc.init(first, soc, soc_std)
        return SchemeState(self.joint.init(first, bulk_V=float(start.belief.mean[0])), start)

    def step(self, state: SchemeState, sample: SocSample) -> tuple[SchemeState, SocEstimate]:
        """State and estimate after a sample; the model's own circuit serves where the joint filter has diverged."""
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
        """Capacitance and resistance to a steady current over those of the battery file."""
        file = self.soc.model.circuit
        capacitance = (p.c_bulk_F + p.c_surface_F) / (file.c_bulk_F + file.c_surface_F)
        return capacitance, rc.dc_resistance(p) / rc.dc_resistance(file)

    def ratio_stds(self, belief: Belief) -> list[Scalar]:
        """Standard deviations of both in the belief of the joint filter: sqrt(diag(G P G')), G their Jacobian."""
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
