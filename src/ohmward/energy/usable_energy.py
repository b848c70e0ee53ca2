"""Usable energy: what a battery can still give above a reserve, at constant power, with its uncertainty.

At power P the battery delivers the current I that solves (U(z) - R(z) I) I = P, so that its terminals show
V(z) = [U + sqrt(U^2 - 4 R P)] / 2, and from state of charge z0 down to z1 it gives

E = Q * integral of V dz = Q * integral of (U - R I) dz,

down to the reserve, or to where V falls below the cut-off voltage or the power cannot be had (4 R P > U^2). U is the
open-circuit voltage of the discharge branch, R the resistance after all RC pairs have settled.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.models import thevenin
from ohmward.battery.models.noise import USUAL_C
from ohmward.battery.models.temperature import ROOM_DEGC
from ohmward.checks import require_between, require_each_not_negative, require_each_positive
from ohmward.energy.balance import running_integral
from ohmward.energy.points import Quantiles, normal_points, quantiles
from ohmward.errors import InputError
from ohmward.quantities import COLDEST_DEGC, HOTTEST_DEGC

#: Points of the state of charge from 0 to 1.
_DISCHARGE_POINTS = 251
#: Batteries that are discharged side by side.
_BATTERIES_AT_ONCE = 512
_SECONDS_PER_HOUR = 3600.0
#: Margin of a voltage that does not exist: far below any cut-off.
_NO_POWER_V = -1e9


@dataclass(frozen=True)
class BatteryState:
    """State of a battery at an instant, with its uncertainty, and the limits that the robot keeps."""

    soc: float  #: state of charge in [0, 1] and its standard deviation
    soc_std: float = 0.0  #: its standard deviation
    #: capacity over that of the battery file, and its standard deviation
    soh_capacity: float = 1.0
    capacity_std: float = 0.0
    #: resistance over that of the battery file, likewise
    resistance_ratio: float = 1.0
    resistance_std: float = 0.0
    temperature_degC: float = ROOM_DEGC  #: of the battery
    reserve_soc: float = 0.0  #: state of charge that is to be left
    cutoff_V: float = 0.0  #: terminal voltage at which the robot stops; 0 where nothing watches it

    def __post_init__(self) -> None:
        for name in ("soc", "reserve_soc"):
            require_between(name, getattr(self, name), 0.0, 1.0)
        require_each_not_negative("", self, "soc_std", "capacity_std", "resistance_std", "cutoff_V")
        require_each_positive("", self, "soh_capacity", "resistance_ratio")
        require_between("temperature_degC", self.temperature_degC, COLDEST_DEGC, HOTTEST_DEGC)
        if self.reserve_soc >= self.soc:
            raise InputError(
                f"reserve_soc must be below soc = {self.soc:g}, got {self.reserve_soc:g}: nothing above the reserve is "
                "left; charge, or lower the reserve"
            )


class Discharge(NamedTuple):
    """Discharge at constant power of N batteries, drawn from the distribution of this one."""

    soc: np.ndarray  #: (K,) grid from 0 to 1
    energy_J: np.ndarray  #: (K, N) given between each state of charge and the end of the discharge; 0 below the end
    start_soc: np.ndarray  #: (N,) state of charge now


def usable_energy(battery: Battery, state: BatteryState, power_W: float) -> Quantiles:
    """Energy [J] above the reserve at this mean power [W], P10/P50/P90."""
    return quantiles(usable_at(battery, state, power_W, normal_points(3)))


def usable_at(battery: Battery, state: BatteryState, power_W: float, z: np.ndarray) -> np.ndarray:
    """(N,) energy [J] that batteries drawn from the distribution of this one give at constant power [W].

    The same as `usable_J` of their `discharge`, in parts that stay in the cache: less time, an eighth of the memory.

    z: (3, N) standard normal points of state of charge, capacity and resistance.
    """
    parts = [z[:, k : k + _BATTERIES_AT_ONCE] for k in range(0, z.shape[1], _BATTERIES_AT_ONCE)]
    return np.concatenate([usable_J(discharge(battery, state, power_W, part)) for part in parts])


def discharge(battery: Battery, state: BatteryState, power_W: float, z: np.ndarray) -> Discharge:
    """Discharge at constant power [W] of batteries drawn from the distribution of this one.

    z: (3, N) standard normal points of state of charge, capacity and resistance.
    """
    z_soc, z_capacity, z_resistance = z
    soc = np.linspace(0.0, 1.0, _DISCHARGE_POINTS)
    ocv_V, r_ohm = discharge_curves(battery, soc, state.temperature_degC)
    start = np.clip(state.soc + state.soc_std * z_soc, 0.0, 1.0)
    capacity = np.maximum(state.soh_capacity + state.capacity_std * z_capacity, 0.0)
    resistance = np.maximum(state.resistance_ratio + state.resistance_std * z_resistance, 0.0)
    voltage_V, holds = loaded_voltage(ocv_V[:, None], r_ohm[:, None] * resistance, power_W)
    margin_V = np.where(holds, voltage_V - state.cutoff_V, _NO_POWER_V)
    whole_J = _SECONDS_PER_HOUR * battery.capacity_Ah * capacity * running_integral(soc, voltage_V)
    at_reserve_J = _at(soc, whole_J, np.full(start.shape, state.reserve_soc))
    end_J = np.maximum(at_reserve_J, _at_end(whole_J, margin_V, soc, start))
    return Discharge(soc, np.maximum(whole_J - end_J, 0.0), start)


def loaded_voltage(ocv_V: Any, r_ohm: Any, power_W: float) -> tuple[Any, Any]:
    """Terminal voltage [V] at this power, and True where the power can be had; a power below zero counts as zero."""
    square = ocv_V**2 - 4 * r_ohm * max(power_W, 0.0)
    return 0.5 * (ocv_V + np.sqrt(np.maximum(square, 0.0))), square >= 0.0


def usable_J(found: Discharge) -> np.ndarray:
    """(N,) energy [J] that each of the batteries gives from its state of charge now."""
    return _at(found.soc, found.energy_J, found.start_soc)


def soc_after(found: Discharge, energy_J: np.ndarray) -> np.ndarray:
    """(N,) state of charge of each battery once it has given this energy (N,); its end where it cannot."""
    left_J = usable_J(found) - energy_J
    above = np.clip(np.sum(found.energy_J <= left_J, axis=0), 1, len(found.soc) - 1)
    low, high = _rows(found.energy_J, above - 1), _rows(found.energy_J, above)
    share = np.clip((left_J - low) / np.where(high > low, high - low, np.inf), 0.0, 1.0)
    return found.soc[above - 1] + share * (found.soc[1] - found.soc[0])


def discharge_curves(battery: Battery, soc: np.ndarray, temperature_degC: float) -> tuple[np.ndarray, np.ndarray]:
    """Open-circuit voltage [V] of the discharge branch and settled resistance [ohm] at each state of charge (K,)."""
    model = battery.thevenin
    ocv_V = model.ocv.mean_V(soc, temperature_degC) - model.ocv.hysteresis_at(soc)
    usual_A = USUAL_C * model.capacity_Ah
    u = thevenin.CircuitInput(-usual_A, temperature_degC)
    parts = [-thevenin.ohmic_drop(soc, u, model) / usual_A, *thevenin.pair_resistances(soc, u, model)]
    return ocv_V, sum(parts) + np.zeros(soc.shape)


def _at_end(whole_J: np.ndarray, margin_V: np.ndarray, soc: np.ndarray, start: np.ndarray) -> np.ndarray:
    """(N,) running integral at the end of each discharge, where its margin becomes negative; 0 where it never does.

    whole_J, margin_V: (K, N) running integral and margin of voltage along the grid `soc` (K,).
    start: (N,) state of charge from which each battery comes down.
    """
    top = len(soc) - 1
    fails = (margin_V < 0) & (soc[:, None] <= start)
    below = top - np.argmax(fails[::-1], axis=0)
    above = np.minimum(below + 1, top)
    margin_below, margin_above = _rows(margin_V, below), _rows(margin_V, above)
    crosses = (margin_below < 0) & (margin_above > 0)
    share = np.where(crosses, margin_above / np.where(crosses, margin_above - margin_below, 1.0), 0.0)
    low_J, high_J = _rows(whole_J, below), _rows(whole_J, above)
    return np.where(fails.any(axis=0), high_J - share * (high_J - low_J), 0.0)


def _at(grid: np.ndarray, columns: np.ndarray, x: np.ndarray) -> np.ndarray:
    """(N,) linear interpolation in each column (K, N) at its own x (N,)."""
    position = x * (len(grid) - 1)
    below = np.minimum(position.astype(int), len(grid) - 2)
    low, high = _rows(columns, below), _rows(columns, below + 1)
    return low + (position - below) * (high - low)


def _rows(columns: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """(N,) element of each column (K, N) in its own row (N,)."""
    return np.take_along_axis(columns, rows[None], axis=0)[0]
