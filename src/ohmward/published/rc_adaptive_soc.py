"""The scheme of [T] fig. 3.10: the joint filter finds the parameters, the SoC filter uses them, sample by sample."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

from ohmward.battery.identification.rc_rule import BRANCH_SHARE, TERMINAL_SHARE
from ohmward.battery.models import rc
from ohmward.battery.models.noise import BatteryNoise
from ohmward.battery.soc.rc_linear import LinearState
from ohmward.battery.soc.rc_soc import Parameters, RcSoc
from ohmward.battery.soc.sample import SocEstimate, SocFlag, SocSample
from ohmward.filters.gate import choose
from ohmward.published.rc_joint import JointState, Nominal, RcJoint
from ohmward.trace import maximum, where

_LEAST_START_STD = 0.1


class SchemeState(NamedTuple):
    """State of both filters."""

    joint: JointState
    soc: LinearState


@dataclass(frozen=True)
class RcAdaptiveSoc:
    """Settings of both filters; `init` and `step` are pure functions of them.

    Attributes:
        joint: finds C_b, C_s, R_e and R_t.
        soc: estimates the state of charge with them; its model says what full parameters are.
    """

    joint: RcJoint
    soc: RcSoc

    def init(self, first: SocSample, soc: float | None = None, soc_std: float = 0.03) -> SchemeState:
        """State before the first sample, which it looks at; `soc` None takes it from the first voltage."""
        start = self.soc.init(first, soc, soc_std)
        return SchemeState(self.joint.init(first, bulk_V=float(start.belief.mean[0])), start)

    def step(self, state: SchemeState, sample: SocSample) -> tuple[SchemeState, SocEstimate]:
        """The state after a sample, and what is known then."""
        joint, found = self.joint.step(state.joint, sample)
        lost = found.flags >= float(SocFlag.NOT_POSITIVE_DEFINITE)
        circuit = choose(lost, self.soc.model.circuit, found.circuit)
        doubts = where(lost, 1.0, found.c_bulk_std), where(lost, 1.0, maximum(found.r_std, found.r_terminal_std))
        soc, estimate = self.soc.step(state.soc, sample, Parameters(circuit, *doubts))
        restarted = where(lost, float(SocFlag.NOT_POSITIVE_DEFINITE), 0.0)
        shares = self.shares(circuit)
        estimate = estimate._replace(
            soh_capacity=shares[0], resistance_ratio=shares[1], flags=estimate.flags + restarted
        )
        return SchemeState(joint, soc), estimate

    def shares(self, p: rc.Circuit) -> tuple[Any, Any]:
        """Capacitance and lasting resistance over the model's: how much there is of what the battery file says."""
        file = self.soc.model.circuit
        capacitance = (p.c_bulk_F + p.c_surface_F) / (file.c_bulk_F + file.c_surface_F)
        return capacitance, lasting_resistance(p) / lasting_resistance(file)


def lasting_resistance(p: rc.Circuit | rc.RcModel) -> Any:
    """R_0 + R_1 [ohm]: what a lasting current sees."""
    return rc.instant_resistance(p) + rc.slow_resistance(p)


def adaptive_soc_of(model: rc.RcModel, noise: BatteryNoise | None = None) -> RcAdaptiveSoc:
    """The scheme for a model; the joint filter starts at its circuit."""
    noise = noise or BatteryNoise()
    std = max(noise.resistance_std, _LEAST_START_STD)
    soc = RcSoc(model, noise)
    joint = RcJoint(
        even(model),
        start_std=(std, std, std, std),
        voltage_std_V=noise.voltage_std_V,
        current_std_A=noise.current_std_A,
        current_limit_A=soc.current_limit_A,
        highest_ocv_V=model.ocv.voltage_V[-1],
    )
    return RcAdaptiveSoc(joint, soc)


def even(model: rc.RcModel) -> Nominal:
    """The model's elements with R_b = R_s: as they are, or with the same lasting resistance shared by [P]'s rule."""
    if model.r_bulk_ohm == model.r_surface_ohm:
        return Nominal(model.c_bulk_F, model.c_surface_F, model.r_bulk_ohm, model.r_terminal_ohm)
    r_total_ohm = lasting_resistance(model) / (1 + BRANCH_SHARE / 2)
    return Nominal(model.c_bulk_F, model.c_surface_F, BRANCH_SHARE * r_total_ohm, TERMINAL_SHARE * r_total_ohm)
