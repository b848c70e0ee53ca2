"""The simulated battery over time: circuit, charge transfer, side reactions, limits, self-heating.

V    = OCV(soc, T) + M h + sum v_j + R_0 i + B arcsinh(i / i_x)
heat = M h i + sum v_j^2 / R_j + R_0 i^2 + B arcsinh(i / i_x) i + OCV (i - i_s) + i_s T dOCV/dT
C dT/dt = heat - G (T - T_ambient)

i_s is the part of the current that is stored. The last two terms are side reactions and reversible heat (Bernardi,
Pawlikowski, Newman 1985).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.models.temperature import KELVIN, ROOM_DEGC
from ohmward.battery.models.thevenin import (
    CircuitInput,
    next_state,
    ohmic_drop,
    ohmic_resistance,
    pair_resistances,
    voltage,
)
from ohmward.errors import InputError
from ohmward.trace import Kernel, exp, maximum, minimum, where
from ohmward_lab.simulate.cells import SimulatedBattery
from ohmward_lab.simulate.profile import Profile

#: Index of the state of charge in the state of the circuit.
SOC = 0
#: Newton converges quadratically from one side: four steps reach rounding.
_LIMIT_STEPS = 4


class PlantState(NamedTuple):
    """State of the simulated battery."""

    x: Any  #: (n + 2,) state of the circuit, as `Thevenin.state_names`
    temperature_degC: Any  #: of the battery
    current_A: Any  #: present current
    heat_W: Any  #: released now; negative where reversible heat is absorbed
    heat_J: Any  #: released so far


class Demand(NamedTuple):
    """One small step: its length [s], the demanded current at its end [A], the ambient temperature [degC]."""

    dt_s: Any
    current_A: Any
    ambient_degC: Any


class BatteryTruth(NamedTuple):
    """True state of the battery at an instant, numbers or (T,) arrays; heat_J is counted from the start."""

    current_A: Any
    voltage_V: Any
    soc: Any
    temperature_degC: Any
    heat_J: Any


class Simulation(NamedTuple):
    """The truth at the times (T,) [s], and the state at the last of them."""

    time_s: np.ndarray
    truth: BatteryTruth
    state: PlantState


def resting_state(
    battery: SimulatedBattery, soc: float, temperature_degC: float = ROOM_DEGC, hysteresis: float = 0.0
) -> PlantState:
    """The battery after a long rest at this SoC; hysteresis is 1 after a charge, -1 after a discharge."""
    if not 0.0 <= soc <= 1.0:
        raise InputError(f"soc must be between 0 and 1, got {soc}")
    x = np.array([soc, *np.zeros(battery.circuit.pairs), hysteresis])
    return PlantState(x, float(temperature_degC), 0.0, 0.0, 0.0)


def simulate(
    battery: SimulatedBattery, profile: Profile, time_s: np.ndarray, state: PlantState, max_step_s: float = 1.0
) -> Simulation:
    """The truth at `time_s` under the load of `profile`, in steps of at most `max_step_s`.

    time_s: (T,) [s], increasing, within the profile; the profile starts at its first time with `state`.

    Raises:
        InputError: times outside the profile or not increasing.
    """
    time_s = np.asarray(time_s, dtype=float)
    _check_times(time_s, profile)
    grid = fine_times(np.union1d(profile.time_s, time_s), max_step_s)
    wanted = Demand(
        np.diff(grid, prepend=grid[0]),
        np.interp(grid, profile.time_s, profile.current_A),
        np.interp(grid, profile.time_s, profile.ambient_degC),
    )
    last, truth = Kernel(step, state, Demand(0.0, 0.0, 0.0), constants=(battery,)).scan(state, wanted)
    rows = np.searchsorted(grid, time_s)
    return Simulation(time_s, BatteryTruth(*(values[rows] for values in truth)), last)


def step(state: PlantState, demand: Demand, battery: SimulatedBattery) -> tuple[PlantState, BatteryTruth]:
    """One small step: the current is linear; the circuit sees its mean, and the temperature at the beginning.

    The limits hold for the state to which the present current would lead.
    """
    p, T = battery.circuit, state.temperature_degC
    ahead = next_state(state.x, CircuitInput(state.current_A, T), p, demand.dt_s)
    current_A = within_limits(ahead, demand.current_A, T, battery)
    mean = CircuitInput(0.5 * (state.current_A + current_A), T)
    x = next_circuit(state.x, mean, battery, demand.dt_s)
    heat_W = heat(x, CircuitInput(current_A, T), battery)
    mean_heat_W = 0.5 * (state.heat_W + heat_W)
    T = next_temperature(T, mean_heat_W, demand, battery)
    after = PlantState(x, T, current_A, heat_W, state.heat_J + mean_heat_W * demand.dt_s)
    return after, BatteryTruth(
        current_A, terminal_voltage(x, CircuitInput(current_A, T), battery), x[SOC], T, after.heat_J
    )


def next_circuit(x: np.ndarray, u: CircuitInput, battery: SimulatedBattery, dt_s: Any) -> np.ndarray:
    """State of the circuit after a step of constant current; near full only a share of the charge is stored."""
    after = next_state(x, u, battery.circuit, dt_s)
    after[SOC] = x[SOC] + accepted_share(x[SOC], u.current_A, battery) * (after[SOC] - x[SOC])
    return after


def terminal_voltage(x: np.ndarray, u: CircuitInput, battery: SimulatedBattery) -> Any:
    """Terminal voltage [V] at the current of this instant."""
    return voltage(x, u, battery.circuit)[0] + transfer_overpotential(u, battery)


def transfer_overpotential(u: CircuitInput, battery: SimulatedBattery) -> Any:
    """Butler-Volmer with symmetry 1/2 [V]: linear at small currents, logarithmic at large ones."""
    return battery.transfer_V * np.arcsinh(
        u.current_A * battery.circuit.arrhenius_factor(u.temperature_degC) / battery.exchange_A
    )


def rest_voltage(x: np.ndarray, temperature_degC: Any, battery: SimulatedBattery) -> Any:
    """Voltage [V] without current."""
    return voltage(x, CircuitInput(0.0, temperature_degC), battery.circuit)[0]


def within_limits(x: np.ndarray, current_A: Any, temperature_degC: Any, battery: SimulatedBattery) -> Any:
    """The demanded current, limited so that the voltage stays in its range, as by a charger at constant voltage."""
    charge = minimum(current_A, current_at_limit(x, temperature_degC, 1.0, battery))
    return where(current_A > 0, charge, maximum(current_A, current_at_limit(x, temperature_degC, -1.0, battery)))


def current_at_limit(x: np.ndarray, temperature_degC: Any, direction: float, battery: SimulatedBattery) -> Any:
    """Current [A] at the voltage limit of charging (direction 1, >= 0) or discharging (-1, <= 0)."""
    limit_V = battery.voltage_max_V if direction > 0 else battery.voltage_min_V
    overpotential_V = limit_V - rest_voltage(x, temperature_degC, battery)
    current_A = current_at(overpotential_V, CircuitInput(direction, temperature_degC), x[SOC], battery)
    return maximum(current_A, 0.0) if direction > 0 else minimum(current_A, 0.0)


def current_at(overpotential_V: Any, u: CircuitInput, soc: Any, battery: SimulatedBattery) -> Any:
    """The current [A] with v_0(i) + B arcsinh(i / i_x) = overpotential_V, R_0 as in the direction of u.

    Newton from the tangent at 0, which lies beyond the curve: the steps approach the root from one side.
    """
    i = overpotential_V / instant_drop(0.0, u, soc, battery)[1]
    for _ in range(_LIMIT_STEPS):
        drop_V, slope_ohm = instant_drop(i, u, soc, battery)
        i = i - (drop_V - overpotential_V) / slope_ohm
    return i


def instant_drop(i: Any, u: CircuitInput, soc: Any, battery: SimulatedBattery) -> tuple[Any, Any]:
    """Overpotential v_0(i) + B arcsinh(i / i_x) [V] that follows a current i at once, and its slope [ohm].

    v_0 is R_0 i, or nonlinear as with `Thevenin.transfer_V`; R_0 as in the direction and at the temperature of u.
    """
    p = battery.circuit
    r0_ohm = ohmic_resistance(soc, u, p)
    exchange_A = battery.exchange_A / p.arrhenius_factor(u.temperature_degC)
    transfer_V = battery.transfer_V * np.arcsinh(i / exchange_A)
    transfer_ohm = battery.transfer_V / np.sqrt(i * i + exchange_A * exchange_A)
    if p.transfer_V is None:
        return r0_ohm * i + transfer_V, r0_ohm + transfer_ohm
    ratio = r0_ohm * i / p.transfer_V
    return p.transfer_V * np.arcsinh(ratio) + transfer_V, r0_ohm / np.sqrt(1.0 + ratio * ratio) + transfer_ohm


def accepted_share(soc: Any, current_A: Any, battery: SimulatedBattery) -> Any:
    """Share of a charge that is still stored, 0 at full; the rest makes gas."""
    if battery.full_width == 0.0:
        return 1.0
    return where(current_A > 0, 1 - exp((soc - 1) / battery.full_width), 1.0)


def heat(x: np.ndarray, u: CircuitInput, battery: SimulatedBattery) -> Any:
    """Heat [W] released in state x; the formula is at the top of the file."""
    p = battery.circuit
    soc, *v, h = x
    i = u.current_A
    stored_A = accepted_share(soc, i, battery) * where(i > 0, p.coulombic_efficiency, 1.0) * i
    diffusion = sum(vj * vj / rj for vj, rj in zip(v, pair_resistances(soc, u, p), strict=True))
    ohmic = (ohmic_drop(soc, u, p) + transfer_overpotential(u, battery)) * i
    side_reactions = p.ocv.mean_V(soc, u.temperature_degC) * (i - stored_A)
    reversible = stored_A * (u.temperature_degC + KELVIN) * _entropy_V_per_K(soc, battery)
    return p.hysteresis_V_at(soc, u.temperature_degC) * h * i + diffusion + ohmic + side_reactions + reversible


def next_temperature(temperature_degC: Any, heat_W: Any, demand: Demand, battery: SimulatedBattery) -> Any:
    """Temperature [degC] after the step: one heat capacity, cooled by the ambient air, exact for constant heat."""
    settled = demand.ambient_degC + heat_W / battery.cooling_W_per_K
    decay = np.exp(-demand.dt_s * battery.cooling_W_per_K / battery.heat_capacity_J_per_K)
    return settled + decay * (temperature_degC - settled)


def fine_times(time_s: np.ndarray, max_step_s: float) -> np.ndarray:
    """The times (T,), with evenly spaced ones between them so that no step exceeds `max_step_s`."""
    parts = np.maximum(np.ceil(np.diff(time_s) / max_step_s - 1e-9), 1).astype(int)
    share = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
    inner = np.repeat(time_s[:-1], parts) + share * np.repeat(np.diff(time_s) / parts, parts)
    return np.append(inner, time_s[-1])


def _entropy_V_per_K(soc: Any, battery: SimulatedBattery) -> Any:
    """dOCV/dT [V/K]; the curve is linear in temperature."""
    ocv = battery.circuit.ocv
    return ocv.mean_V(soc, ocv.reference_degC + 1.0) - ocv.mean_V(soc, ocv.reference_degC)


def _check_times(time_s: np.ndarray, profile: Profile) -> None:
    if not time_s.size or np.any(np.diff(time_s) <= 0):
        raise InputError("time_s must hold at least one time and increase strictly; sort the times")
    if time_s[0] < profile.time_s[0] or time_s[-1] > profile.time_s[-1]:
        raise InputError(
            f"time_s must lie within the profile, {profile.time_s[0]:g} to {profile.time_s[-1]:g} s, "
            f"got {time_s[0]:g} to {time_s[-1]:g} s"
        )
