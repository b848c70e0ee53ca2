"""Thevenin model: equivalent circuit with n RC pairs ([P] (11)-(14)) and one state of hysteresis.

d soc/dt = eta i / Q            eta = 1 in discharge
d v_j/dt = -v_j / tau_j + R_j i / tau_j
h+       = e^(-a) h + (1 - e^(-a)) sign(i),  a = |gamma i dt / Q|  (Plett), or h + gamma i dt / Q within -1 and 1
V        = OCV(soc, T) + M(soc, T) h + sum v_j + v_0
v_0      = R_0 i, or V_t asinh(R_0 i / V_t) where charge transfer bends it (Butler-Volmer)

R_0, R_j and tau_j grow in the cold by Arrhenius factors of their own: conduction, and transfer and diffusion. Those of
the R_j grow towards empty, where the last free sites of a layered oxide take lithium slowly, most of all in the cold.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.models.ocv import OcvCurve, between_knots, hat
from ohmward.battery.models.temperature import ROOM_DEGC, arrhenius_factor, coldness_per_K
from ohmward.checks import require_between, require_finite, require_length, require_positive
from ohmward.errors import InputError
from ohmward.quantities import SECONDS_PER_HOUR
from ohmward.trace import Scalar, clip, exp, log, sign, sqrt, table, where

#: Keeps asinh(x) / x from 0 / 0: it is 1 within 2e-5 there.
_ROUND = 1e-4

#: Below this SoC the activation of the RC pairs grows, linearly towards empty: pulses of NCA between -10 and 25 degC
#: show 2300 to 3200 K at 0.5, 4000 at 0.3, 7500 at 0.2 and 9500 at 0.15.
EMPTYING_SOC = 0.35

#: Grid of SoC on which resistances are fitted, and on which errors are kept.
RESISTANCE_GRID = np.linspace(0.0, 1.0, 21)
#: Corrected time constants stay apart by this factor at least.
_TAU_RATIO = 1.5


class CircuitInput(NamedTuple):
    """Inputs of the circuit: current [A] (> 0 charges) and temperature [degC]; scalars, or arrays along a log."""

    current_A: Any
    temperature_degC: Any
    unknown_K: Any = 0.0  #: standard deviation of a temperature that is not measured; models ignore it

    @property
    def error_degC(self) -> Any:
        """Temperature for which errors are evaluated: that of a colder battery where it is not measured."""
        return self.temperature_degC - self.unknown_K


class StateOfHealth(NamedTuple):
    """Capacity, and all resistances together, over those of the file; 1 for a battery as it was identified.

    `Corrections` has the same ratios for each parameter by itself.
    """

    soh_capacity: Scalar = 1.0
    resistance_ratio: Scalar = 1.0

    @property
    def efficiency_ratio(self) -> Scalar:
        """Coulombic efficiency over the file's."""
        return 1.0

    def ohmic_ratio(self, soc: Any, u: CircuitInput, p: Thevenin) -> Any:
        """R_0 over the file's, at this SoC and temperature."""
        return self.resistance_ratio

    def pair_ratios(self, soc: Any, u: CircuitInput, p: Thevenin) -> Sequence[Any]:
        """R_1 ... R_n over the file's, (n,), at this SoC and temperature."""
        return (self.resistance_ratio,) * p.pairs

    def rate_ratios(self, p: Thevenin) -> Sequence[Any]:
        """Rates 1 / tau_1 ... 1 / tau_n over the file's, (n,)."""
        return (1.0,) * p.pairs


AS_IDENTIFIED = StateOfHealth()


@dataclass(frozen=True)
class Thevenin:
    """Parameters of the Thevenin model. Resistances are on a uniform grid of SoC from 0 to 1, ends included."""

    capacity_Ah: float  #: charge between full and empty, > 0
    ocv: OcvCurve  #: open-circuit voltage
    #: (M,) ohmic resistance for each direction of the current
    r0_discharge_ohm: tuple[float, ...]
    r0_charge_ohm: tuple[float, ...]
    r_ohm: tuple[tuple[float, ...], ...]  #: (n, M) resistance of each RC pair
    tau_s: tuple[float, ...]  #: (n,) time constant of each RC pair, increasing
    #: gamma: the hysteresis state follows the current direction over 1/gamma of the capacity
    hysteresis_rate: float = 20.0
    coulombic_efficiency: float = 1.0  #: share of the charging current that is stored
    #: activation temperature of the ohmic resistance, which grows with exp(activation_K (1/T - 1/T_reference))
    activation_K: float = 0.0
    reference_degC: float = ROOM_DEGC  #: temperature for which resistances and time constants are given
    pair_activation_K: float | None = None  #: activation temperature of the RC resistances; if absent, activation_K
    tau_activation_K: float = 0.0  #: activation temperature of the time constants
    #: activation temperature of the RC pairs at empty beyond pair_activation_K; it falls linearly to 0 at a SoC of 0.35
    empty_activation_K: float = 0.0
    #: terminal voltage above which part of the charging current makes gas: from there until the surface charge is gone,
    #: the voltage is not used for SoC. Absent for a battery that does not gas
    gassing_V: float | None = None
    #: ohmic drop beyond which it grows only logarithmically (charge transfer); if absent, it is proportional to the
    #: current
    transfer_V: float | None = None
    #: share of a capacity loss by which the electrodes shift against each other: if positive, the full end of the OCV
    #: curve stays, if negative, the empty end; 0 leaves the curve as it is
    ocv_slip: float = 0.0
    net_charge_hysteresis: bool = False  #: true: the hysteresis follows the net charge; false: the charge throughput
    hysteresis_activation_K: float = 0.0  #: activation temperature of the hysteresis voltage; 0 if constant
    #: hysteresis state at which the curve was tested, -1 for a discharge alone: an error of the hysteresis voltage does
    #: not change the open-circuit voltage there
    tested_branch: float = 0.0

    def __post_init__(self) -> None:
        require_positive("thevenin.capacity_Ah", self.capacity_Ah)
        grid = len(self.r0_discharge_ohm)
        if grid < 2:
            raise InputError(f"thevenin.r0_discharge_ohm needs at least 2 points from SoC 0 to 1, got {grid}")
        require_length("thevenin.r0_charge_ohm", self.r0_charge_ohm, grid, "as many as r0_discharge_ohm")
        require_length("thevenin.tau_s", self.tau_s, len(self.r_ohm), "one for each row of r_ohm")
        for name, values in (("r0_discharge_ohm", self.r0_discharge_ohm), ("r0_charge_ohm", self.r0_charge_ohm)):
            require_between(f"thevenin.{name}", values, 0.0, np.inf)
        for j, row in enumerate(self.r_ohm, start=1):
            require_length(f"thevenin.r{j}_ohm", row, grid, "as many as r0_discharge_ohm")
            require_between(f"thevenin.r{j}_ohm", row, 0.0, np.inf)
        require_positive("thevenin.tau_s", self.tau_s)
        if any(b <= a for a, b in zip(self.tau_s, self.tau_s[1:], strict=False)):
            raise InputError(f"thevenin.tau_s must increase from pair to pair, got {list(self.tau_s)}")
        require_between("thevenin.hysteresis_rate", self.hysteresis_rate, 0.0, np.inf)
        require_between("thevenin.coulombic_efficiency", self.coulombic_efficiency, 0.5, 1.0)
        activations = ("activation_K", "pair_activation_K", "tau_activation_K", "empty_activation_K")
        for name in (*activations, "hysteresis_activation_K", "ocv_slip"):
            if (value := getattr(self, name)) is not None:
                require_finite(f"thevenin.{name}", value)
        require_between("thevenin.tested_branch", self.tested_branch, -1.0, 1.0)
        if self.gassing_V is not None:
            require_positive("thevenin.gassing_V", self.gassing_V)
        if self.transfer_V is not None:
            require_positive("thevenin.transfer_V", self.transfer_V)

    @property
    def pairs(self) -> int:
        """Number of RC pairs n."""
        return len(self.tau_s)

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the state, in order: soc, one voltage for each RC pair [V], hysteresis in [-1, 1]."""
        return ("soc", *(f"v{j}_V" for j in range(1, self.pairs + 1)), "hysteresis")

    @property
    def capacity_As(self) -> float:
        """Capacity in ampere seconds."""
        return SECONDS_PER_HOUR * self.capacity_Ah

    @property
    def activation_of_pairs_K(self) -> float:
        """Activation temperature of the RC resistances."""
        return self.activation_K if self.pair_activation_K is None else self.pair_activation_K

    @cached_property
    def largest_ohm(self) -> float:
        """Resistance to a lasting current [ohm] at the reference temperature, each part where it is largest."""
        rows = [self.r0_discharge_ohm, self.r0_charge_ohm]
        return max(max(row) for row in rows) + sum(max(row) for row in self.r_ohm)

    def arrhenius_factor(self, temperature_degC: Any) -> Any:
        """Factor of the ohmic resistance at a temperature, 1 at the reference."""
        return arrhenius_factor(temperature_degC, self.activation_K, self.reference_degC)

    def pair_arrhenius_factor(self, temperature_degC: Any) -> Any:
        """Factor of the resistances of the RC pairs at a temperature, 1 at the reference."""
        return arrhenius_factor(temperature_degC, self.activation_of_pairs_K, self.reference_degC)

    def emptying_factor(self, soc: Any, temperature_degC: Any) -> Any:
        """Further factor of the resistances of the RC pairs, 1 at the reference and above `EMPTYING_SOC`."""
        if self.empty_activation_K == 0.0:
            return 1.0
        cold = coldness_per_K(temperature_degC, self.reference_degC)
        return exp(self.empty_activation_K * cold * emptiness(soc))

    def rate_arrhenius_factor(self, temperature_degC: Any) -> Any:
        """Factor of the rates 1 / tau_j at a temperature, 1 at the reference."""
        return arrhenius_factor(temperature_degC, -self.tau_activation_K, self.reference_degC)

    def hysteresis_V_at(self, soc: Any, temperature_degC: Any) -> Any:
        """Half the distance of the two branches [V] at this SoC and temperature."""
        if not self.hysteresis_activation_K:
            return self.ocv.hysteresis_at(soc)
        factor = arrhenius_factor(temperature_degC, self.hysteresis_activation_K, self.reference_degC)
        return factor * self.ocv.hysteresis_at(soc)

    def in_series(self, cells: int) -> Thevenin:
        """The pack of `cells` equal cells in series: the same capacity, `cells` times each voltage and resistance."""
        require_finite("cells in series", cells)
        if cells < 1:
            raise InputError(f"cells in series must be at least 1, got {cells}")
        return replace(
            self._with_each_ohm(lambda ohm: cells * ohm),
            ocv=self.ocv.scaled(cells),
            gassing_V=None if self.gassing_V is None else cells * self.gassing_V,
            transfer_V=None if self.transfer_V is None else cells * self.transfer_V,
        )

    def in_parallel(self, strings: float) -> Thevenin:
        """The pack of `strings` equal strings in parallel: `strings` times the capacity, resistances over it."""
        return replace(self._with_each_ohm(lambda ohm: ohm / strings), capacity_Ah=strings * self.capacity_Ah)

    def worn(self, soh_capacity: float, resistance_ratio: float) -> Thevenin:
        """The circuit with these multiples of its capacity and of all its resistances."""
        ageing = self._with_each_ohm(lambda ohm: resistance_ratio * ohm)
        return replace(ageing, capacity_Ah=soh_capacity * self.capacity_Ah)

    def _with_each_ohm(self, change: Callable[[float], float]) -> Thevenin:
        """The circuit with each of its resistances changed alike."""
        r0_discharge, r0_charge, *pairs = (
            tuple(map(change, row)) for row in (self.r0_discharge_ohm, self.r0_charge_ohm, *self.r_ohm)
        )
        return replace(self, r0_discharge_ohm=r0_discharge, r0_charge_ohm=r0_charge, r_ohm=tuple(pairs))


#: SoC at which corrections of a resistance are given. Resistances rise towards empty, so their knots are closer there.
RESISTANCE_KNOTS = np.array([0.0, 0.1, 0.3, 0.6, 1.0])


class Corrections(NamedTuple):
    """Corrections of a battery file, as unknowns of a fit: the ratios as in `StateOfHealth`, and the corrected circuit.

    All are 0 for the file as it is. Logarithms cannot turn a resistance negative, and make twice as large as likely as
    half as large. () is not corrected. Their priors are in `learning.parameters`, under these names.
    """

    efficiency: Any = ()  #: (1,) ln of the coulombic efficiency over the file's
    ohmic: Any = ()  #: (5,) ln of R_0 over the file's on RESISTANCE_KNOTS
    pair: Any = ()  #: (n * 5,) the same of R_1, then of R_2, ...
    tau: Any = ()  #: (n,) ln of the time constants over the file's
    activation: Any = ()  #: (2,) change of the activation temperatures of R_0 and of the R_j [K]
    empty_activation: Any = ()  #: (1,) change of that of the R_j towards empty [K]
    hysteresis: Any = ()  #: (1,) ln of the hysteresis voltage over the file's
    offset: Any = ()  #: (1,) change of the reading of the current sensor at zero current [A]

    @property
    def soh_capacity(self) -> Scalar:
        """Always 1: a log shows the charge in units of the file's capacity."""
        return 1.0

    @property
    def efficiency_ratio(self) -> Scalar:
        """Coulombic efficiency over the file's."""
        return exp(self.efficiency[0]) if len(self.efficiency) else 1.0

    def ohmic_ratio(self, soc: Any, u: CircuitInput, p: Thevenin) -> Any:
        """R_0 over the file's."""
        log_ratio = between_knots(self.ohmic, RESISTANCE_KNOTS, soc) if len(self.ohmic) else 0.0
        if len(self.activation):
            log_ratio = log_ratio + self.activation[0] * coldness_per_K(u.temperature_degC, p.reference_degC)
        return exp(log_ratio)

    def pair_ratios(self, soc: Any, u: CircuitInput, p: Thevenin) -> Sequence[Any]:
        """R_1 ... R_n over the file's."""
        cold, common = coldness_per_K(u.temperature_degC, p.reference_degC), 0.0
        if len(self.activation):
            common = common + self.activation[1] * cold
        if len(self.empty_activation):
            common = common + self.empty_activation[0] * cold * emptiness(soc)
        knots = RESISTANCE_KNOTS.size
        return [
            exp(between_knots(self.pair[knots * j : knots * (j + 1)], RESISTANCE_KNOTS, soc) + common)
            for j in range(p.pairs)
        ]

    def rate_ratios(self, p: Thevenin) -> Sequence[Any]:
        """Rates 1 / tau_1 ... 1 / tau_n over the file's."""
        return [exp(-log_ratio) for log_ratio in self.tau] if len(self.tau) else (1.0,) * p.pairs

    @property
    def hysteresis_ratio(self) -> Scalar:
        """Hysteresis voltage over the file's."""
        return exp(self.hysteresis[0]) if len(self.hysteresis) else 1.0

    @property
    def offset_A(self) -> Scalar:
        """Offset of the current sensor beyond the file's [A]."""
        return self.offset[0] if len(self.offset) else 0.0

    def made(self, p: Thevenin) -> Thevenin:
        """The circuit with the corrections applied; its open-circuit curve is unchanged."""
        ohmic, pairs, knots = np.asarray(self.ohmic), np.asarray(self.pair), RESISTANCE_KNOTS.size
        ohmic_K, more_pair_K = self.activation if len(self.activation) else (0.0, 0.0)
        return replace(
            p,
            r0_discharge_ohm=_times(p.r0_discharge_ohm, ohmic),
            r0_charge_ohm=_times(p.r0_charge_ohm, ohmic),
            r_ohm=tuple(_times(row, pairs[knots * j : knots * (j + 1)]) for j, row in enumerate(p.r_ohm)),
            tau_s=_apart([tau / ratio for tau, ratio in zip(p.tau_s, self.rate_ratios(p), strict=True)]),
            coulombic_efficiency=min(float(p.coulombic_efficiency * self.efficiency_ratio), 1.0),
            activation_K=float(p.activation_K + ohmic_K),
            pair_activation_K=float(p.activation_of_pairs_K + more_pair_K),
            empty_activation_K=float(p.empty_activation_K + np.sum(self.empty_activation)),
        )


def _times(ohm: tuple[float, ...], log_ratio: np.ndarray) -> tuple[float, ...]:
    """Resistances along SoC times a factor on RESISTANCE_KNOTS, on a grid fine enough for it; unchanged for ()."""
    if not log_ratio.size:
        return ohm
    grid = np.linspace(0.0, 1.0, len(ohm))
    fine = grid if grid.size > RESISTANCE_GRID.size else RESISTANCE_GRID
    return tuple((np.interp(fine, grid, ohm) * np.exp(hat(fine, RESISTANCE_KNOTS) @ log_ratio)).tolist())


def _apart(tau_s: Sequence[float]) -> tuple[float, ...]:
    """Time constants that increase from pair to pair by `_TAU_RATIO` at least."""
    found = [float(tau) for tau in tau_s]
    for j in range(1, len(found)):
        found[j] = max(found[j], _TAU_RATIO * found[j - 1])
    return tuple(found)


def without_curve(model: Thevenin) -> Thevenin:
    """The circuit whose open-circuit voltage is that of its hysteresis alone."""
    flat = (0.0,) * len(model.ocv.voltage_V)
    return replace(model, ocv=replace(model.ocv, voltage_V=flat, temperature_V_per_K=flat))


def at_rest(soc: np.ndarray, p: Thevenin) -> np.ndarray:
    """(n + 2, N) states at these SoC (N,) without overpotentials and hysteresis."""
    x = np.zeros((p.pairs + 2, soc.size))
    x[0] = soc
    return x


def next_state(
    x: np.ndarray, u: CircuitInput, p: Thevenin, dt_s: Any, health: StateOfHealth | Corrections = AS_IDENTIFIED
) -> np.ndarray:
    """State after `dt_s` of constant current, exact for charge, RC pairs and hysteresis.

    x: (n + 2,) [soc, v_1 ... v_n, hysteresis], as `p.state_names`; or (n + 2, N), N states at once.
    Returns: the same at the end of the step.
    """
    soc, *v, h = x
    i = u.current_A
    ratios = health.pair_ratios(soc, u, p)
    v_next = [
        decay * vj + (1 - decay) * rj * (ratio * i)
        for decay, vj, rj, ratio in zip(
            pair_decays(u, p, dt_s, health), v, pair_resistances(soc, u, p), ratios, strict=True
        )
    ]
    d_soc = charge(i, dt_s, p, health) / (p.capacity_As * health.soh_capacity)
    return np.array([soc + d_soc, *v_next, next_hysteresis(h, i, dt_s, p)])


def voltage(
    x: np.ndarray, u: CircuitInput, p: Thevenin, health: StateOfHealth | Corrections = AS_IDENTIFIED
) -> np.ndarray:
    """Terminal voltage [V] in state x at the current of this instant, as (1,)."""
    return np.array([open_circuit(x, u, p) + sum(overpotentials(x, u, p, health))])


def open_circuit(x: np.ndarray, u: CircuitInput, p: Thevenin) -> Any:
    """Open-circuit voltage with hysteresis, OCV(soc, T) + M(soc, T) h [V]."""
    soc, *_, h = x
    return p.ocv.mean_V(soc, u.temperature_degC) + p.hysteresis_V_at(soc, u.temperature_degC) * h


def scaled_hysteresis(h: Any, ratio: Any, p: Thevenin) -> Any:
    """Hysteresis state h of a battery whose hysteresis voltage is `ratio` times the file's, in multiples of the file's.

    The open-circuit voltage stays at `p.tested_branch`.
    """
    if not p.tested_branch:
        return h * ratio
    return p.tested_branch + ratio * (h - p.tested_branch)


def log_ratio_by_weather(u: CircuitInput, p: Thevenin) -> Any:
    """Standard deviation of ln R by an unmeasured temperature, that of a colder battery; 0 where it is measured."""
    activation_K = max(p.activation_K, p.pair_activation_K or 0.0)
    return activation_K * coldness_per_K(u.error_degC, u.temperature_degC)


def overpotentials(
    x: np.ndarray, u: CircuitInput, p: Thevenin, health: StateOfHealth | Corrections = AS_IDENTIFIED
) -> list[Any]:
    """Overpotentials [V]: v_1 ... v_n of the RC pairs, then the ohmic drop."""
    soc, *v, _ = x
    return [*v, ohmic_drop(soc, u, p, health)]


def ohmic_drop(soc: Any, u: CircuitInput, p: Thevenin, health: StateOfHealth | Corrections = AS_IDENTIFIED) -> Any:
    """Ohmic drop [V]: R_0 i, or with `transfer_V` V_t asinh(R_0 i / V_t), the Butler-Volmer law of two equal halves."""
    linear_V = ohmic_resistance(soc, u, p) * (health.ohmic_ratio(soc, u, p) * u.current_A)
    return linear_V if p.transfer_V is None else linear_V * transfer_share(linear_V * (1 / p.transfer_V))


def transfer_share(x: Any) -> Any:
    """Asinh(x) / x, 1 at x = 0: even, so that it is the same for charge and discharge."""
    size = sqrt(x * x + _ROUND)
    return log(size + sqrt(size * size + 1.0)) * (1.0 / size)


def pair_decays(
    u: CircuitInput, p: Thevenin, dt_s: Any, health: StateOfHealth | Corrections = AS_IDENTIFIED
) -> list[Any]:
    """Decay factors e^(-dt / tau_j) of the RC pairs at this temperature."""
    warm_s = dt_s * p.rate_arrhenius_factor(u.temperature_degC)
    return [exp(warm_s * (-1.0 / tau) * ratio) for tau, ratio in zip(p.tau_s, health.rate_ratios(p), strict=True)]


def charge(current_A: Scalar, dt_s: Scalar, p: Thevenin, health: StateOfHealth | Corrections = AS_IDENTIFIED) -> Any:
    """Charge stored [A s] by `dt_s` of current; charging loses 1 - eta to side reactions."""
    if p.coulombic_efficiency == 1.0:
        return current_A * dt_s
    stored = health.efficiency_ratio * p.coulombic_efficiency
    return where(current_A > 0, stored * current_A, current_A) * dt_s


def next_hysteresis(h: Scalar, current_A: Scalar, dt_s: Scalar, p: Thevenin) -> Any:
    """Hysteresis state after `dt_s` of current: it moves with the charge that flows, not with time.

    With the net charge it saturates on the branches, as an elastic-plastic element does: a short charge in a drive
    moves it a little off the discharge branch, and the next discharge brings it back. With the throughput (Plett's
    one-state model) it goes to the middle there.
    """
    if p.net_charge_hysteresis:
        return clip(h + current_A * (dt_s * p.hysteresis_rate / p.capacity_As), -1.0, 1.0)
    decay = exp(-abs(current_A) * (dt_s * p.hysteresis_rate / p.capacity_As))
    return decay * h + (1 - decay) * sign(current_A)


def ohmic_resistance(soc: Any, u: CircuitInput, p: Thevenin) -> Any:
    """R_0 [ohm] at this SoC, direction of current and temperature."""
    charging = _on_grid(p.r0_charge_ohm, soc)
    if p.r0_charge_ohm == p.r0_discharge_ohm:
        return p.arrhenius_factor(u.temperature_degC) * charging
    return p.arrhenius_factor(u.temperature_degC) * where(u.current_A > 0, charging, _on_grid(p.r0_discharge_ohm, soc))


def pair_resistances(soc: Any, u: CircuitInput, p: Thevenin) -> list[Any]:
    """R_1 ... R_n [ohm] at this SoC and temperature."""
    factor = p.pair_arrhenius_factor(u.temperature_degC) * p.emptying_factor(soc, u.temperature_degC)
    return [factor * _on_grid(row, soc) for row in p.r_ohm]


def emptiness(soc: Any) -> Any:
    """Share of the way from `EMPTYING_SOC` to empty, from 0 above it to 1."""
    return clip(1.0 - soc * (1.0 / EMPTYING_SOC), 0.0, 1.0)


def _on_grid(values: tuple[float, ...], soc: Any) -> Any:
    """Value at soc, constant beyond the ends (a resistance has no reason to go on growing there)."""
    held = (values[0], *values, values[-1])
    return table(held, -1.0 / (len(values) - 1), 1.0 / (len(values) - 1), soc)
