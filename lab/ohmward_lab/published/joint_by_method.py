"""States and parameters of the RC model together ([T] 3.3) by one of four filters: EKF, AEKF, UKF, AUKF.

    x = [z_Cb, z_Cs, z_Re, z_R0, V_cb, V_cs, V]    y = V    as in `textbook_joint`

The adaptive two match Q = K C K' and R = mean residual moment + P_yy ((3.49), (3.50) with 1/L restored), on floors; the
other two keep Q and R as they are. With `jumps` False V moves as [T] has it, as if the current never changed.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.soc.clean_sample import first_input, sanitize_bare
from ohmward.battery.soc.sample import SocSample
from ohmward.checks import require_between, require_each_positive, require_one_of
from ohmward.filters import adaptive
from ohmward.filters.belief import Belief
from ohmward.trace import where
from ohmward_lab.published.rc_joint import PARAMETERS, TERMINAL, Nominal
from ohmward_lab.published.textbook_joint import STATES, TextbookJoint, TextbookJointEstimate

METHODS = ("ekf", "aekf", "ukf", "aukf")

#: What a matched covariance may not fall below, as a share of the variance that the others keep: next to nothing, as
#: [T] has no floor, and enough for a Cholesky factor to exist.
MATCHED_FLOOR = 1e-6


class JointByMethodState(NamedTuple):
    """Belief, noise and moments of the filter, and the current [A] of the sample before."""

    adaptive: adaptive.PackedAdaptiveState
    current_A: Any


class JointByMethodEstimate(NamedTuple):
    """Estimate after a sample.

    found: parameters and voltages of the capacitors; its innovation is measured minus expected voltage [V].
    residual_V: measured voltage minus the filter's after the sample.
    voltage_variance_V2: of the filter's voltage after the sample.
    """

    found: TextbookJointEstimate
    residual_V: Any
    voltage_variance_V2: Any


@dataclass(frozen=True)
class JointByMethod:
    """Settings; `init` and `step` are pure functions of them.

    Attributes:
        nominal: start of the parameters.
        method: one of METHODS.
        jumps: True lets V follow a change of the current at once; False is di/dt = 0, as [T] has it.
        start_std: relative standard deviation of the start of the parameters.
        bulk_std_V: standard deviation of the voltages at the start.
        walk: change of each state in one step, of the parameters as a share: root of the diagonal of Q.
        voltage_std_V: root of R.
        window: L of the means; [T] takes 100.
    """

    nominal: Nominal
    method: str = "aukf"
    jumps: bool = True
    start_std: float = 0.3
    bulk_std_V: float = 0.05
    walk: tuple[float, ...] = (1e-5, 1e-5, 1e-5, 1e-5, 1e-5, 1e-5, 1e-4)
    voltage_std_V: float = 0.002
    window: float = 100.0

    def __post_init__(self) -> None:
        require_one_of("method", self.method, METHODS)
        require_each_positive("", self, "start_std", "bulk_std_V", "walk", "voltage_std_V")
        require_between("window", self.window, 1.0, np.inf)

    @property
    def adapts(self) -> bool:
        """True for the two filters that match Q and R."""
        return self.method in ("aekf", "aukf")

    @cached_property
    def textbook(self) -> TextbookJoint:
        """The model of the states."""
        return TextbookJoint(self.nominal)

    @cached_property
    def matching(self) -> adaptive.Matching:
        """Noise that stays, or floors of the noise that is matched."""
        share = MATCHED_FLOOR if self.adapts else 1.0
        Q, R = np.diag(np.square(self.walk)), np.array([[self.voltage_std_V**2]])
        gate = np.inf if self.jumps else None  # as printed nothing is left out, a missing sample neither
        return adaptive.Matching(share * Q, share * R, self.window, gate, match_Q=self.adapts, match_R=self.adapts)

    def init(self, first: SocSample) -> JointByMethodState:
        """State before the first sample: at rest at its voltage."""
        mean = np.array([*np.ones(PARAMETERS), *[float(first.voltage_V)] * (STATES - PARAMETERS)])
        std = np.array([*[self.start_std] * PARAMETERS, *[self.bulk_std_V] * (STATES - PARAMETERS)])
        Q, R = np.diag(np.square(self.walk)), np.array([[self.voltage_std_V**2]])
        state = adaptive.init(Belief(mean, np.diag(std**2)), Q, R)
        return JointByMethodState(adaptive.pack(state), first_input(first).current_A)

    def step(self, state: JointByMethodState, sample: SocSample) -> tuple[JointByMethodState, JointByMethodEstimate]:
        """State and estimate after a sample; with `jumps` one without a voltage is predicted over."""
        clean = sanitize_bare(sample, state.current_A, np.inf)
        now_A = clean.current_A if self.jumps else clean.mean_A

        def f(x: np.ndarray) -> np.ndarray:
            return self.next_state(x, clean.mean_A, now_A, clean.dt_s)

        unscented = self.method in ("ukf", "aukf")
        step = adaptive.unscented_step_reusing_points if unscented else adaptive.extended_step
        voltage_V = where(clean.measured, clean.voltage_V, np.nan)
        y = np.array([voltage_V])
        before = adaptive.unpack(state.adaptive)
        after, innovation = step(before, f, lambda x: x[TERMINAL:], y, self.matching)
        mean = self.textbook.possible(after.belief.mean)
        after = after._replace(belief=after.belief._replace(mean=mean))
        return JointByMethodState(adaptive.pack(after), clean.current_A), JointByMethodEstimate(
            self.textbook.estimate(mean, innovation.value[0]),
            voltage_V - mean[TERMINAL],
            after.belief.cov[TERMINAL, TERMINAL],
        )

    def next_state(self, x: np.ndarray, mean_A: Any, now_A: Any, dt_s: Any) -> np.ndarray:
        """State (7,) after an Euler step, V with its jump or, where `now_A` is the mean, without."""
        return self.textbook.next_state(x, mean_A, now_A, dt_s)
