"""Usable energy: what a battery can still give above a reserve, at constant power, with its uncertainty.

At power P the battery delivers the current I that solves (U(z) - R(z) I) I = P, so that its terminals show
V(z) = [U + sqrt(U^2 - 4 R P)] / 2, and from state of charge z0 down to z1 it gives

E = Q * integral of V dz = Q * integral of (U - R I) dz,

down to the reserve, to where P cannot be delivered or would take the terminals below the cut-off voltage V_c, or to the
first peak of power that would. A peak is short: the highest that the battery gives at z is

P_p(z) = V_c I_p,   I_p = (U - (R - R_p) I - V_c) / R_p,

with half of U - (R - R_p) I for V_c where that is more. U is the open-circuit voltage of the discharge branch, R the
resistance after all RC pairs have settled, R_p that to a peak. Peaks above P_p occur at a rate (`peaks`), so that a
battery lasts from z0 to z with the probability exp(-integral of that rate over the time between).

Where a voltage ends the discharge, it ends earlier than the circuit predicts: the voltage follows the surface of the
particles, which is emptier than their mean. In a sphere of radius r and diffusivity D a steady current causes the
difference

dz = I T / Q,   T = r^2 / (15 D),

and at a time t after a step of the current, 2 sqrt(15 T t / pi) / 3 - t takes the place of T. T is known to within a
factor; an earlier discharge that ended at the cut-off narrows it, together with Q and R.
"""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.models import thevenin
from ohmward.battery.models.noise import USUAL_C
from ohmward.battery.models.temperature import ROOM_DEGC
from ohmward.checks import require_between, require_each_not_negative, require_each_positive
from ohmward.energy.balance import running_integral
from ohmward.energy.discharge_end import DischargeEnd
from ohmward.energy.peaks import Peaks
from ohmward.energy.points import Quantiles, normal_points, normal_tail, quantiles, two_piece
from ohmward.errors import InputError
from ohmward.quantities import COLDEST_DEGC, HOTTEST_DEGC, SECONDS_PER_HOUR

#: Grid of states of charge for a discharge; grids that resistances and lags are interpolated from: deviations of the
#: resistance in standard deviations, and lags over the expected one.
_GRID = np.linspace(0.0, 1.0, 251)
_RESISTANCES = np.array([-3.8, -2.6, -1.9, -1.4, -1.0, -0.6, -0.3, 0.0, 0.3, 0.6, 1.0, 1.4, 1.9, 2.6, 3.8])
_LAGS, _USUAL_LAG = np.array([0.0, 1.0, 3.0, 9.0]), 1
#: Duration [s] of a peak of power: rough ground, the start of a climb.
PEAK_LASTS_S = 10.0
#: Lag T [s] of diffusion and the standard deviation of its logarithm. The slower electrode of published parameter sets
#: of lithium cells has 27 (Ramadass 2004), 59 (Kim 2011), 102 (Mohtat 2020), 111 (Ai 2020), 171 (Marquis 2019), 454
#: (Chen 2020, O'Kane 2022), 556 (Prada 2013) and 1026 s (Ecker 2015); which one empties first differs.
USUAL_LAG_S, _LAG_LOG_STD = 150.0, 1.1
#: Standard deviation of the charge given down to an end, from the model of the voltage near empty, over the capacity.
_NEAR_EMPTY_STD = 0.02
#: Standard deviation of the capacity on the lower side, over the mean of both sides: ageing only reduces capacity.
_LOWER_SIDE_SHARE = 1.5
#: Rows of the points of a battery: state of charge, capacity, resistance, diffusion lag, luck with the peaks.
BATTERY_DIMENSIONS = 5
#: Smallest relative capacity used as a divisor.
_LEAST_SOH_CAPACITY = 0.01
#: Where the log-likelihoods of all batteries differ by less than this, what they have done carries no information.
_UNINFORMATIVE = 0.001
#: Voltage margin where the power cannot be delivered: far below any cut-off.
_NO_POWER_V = -1e9
#: Smallest resistance [ohm] and time [s] used as a divisor.
_LEAST_OHM = _LEAST_S = 1e-9


@dataclass(frozen=True)
class BatteryState:
    """State of a battery at an instant, with its uncertainty, and the limits of the robot."""

    soc: float  #: state of charge in [0, 1]
    soc_std: float = 0.0  #: its standard deviation
    _: KW_ONLY
    #: charge counted since SoC was last known, over the capacity: a capacity error makes it a SoC error too
    counted: float = 0.0
    #: capacity over the battery file's, and its standard deviation
    soh_capacity: float = 1.0
    capacity_std: float = 0.0
    #: resistance over the battery file's, likewise; that to peaks of power separately where loads have measured it
    resistance_ratio: float = 1.0
    resistance_std: float = 0.0
    peak_resistance_ratio: float | None = None
    peak_resistance_std: float = 0.0
    temperature_degC: float = ROOM_DEGC  #: of the battery
    reserve_soc: float = 0.0  #: state of charge that must be left
    cutoff_V: float = 0.0  #: terminal voltage at which the robot stops; 0 if nothing monitors it
    peaks: Peaks | None = None  #: of power on the way; None where only the mean is known
    #: state of charge from which the battery has come here without a failure, on a route like this one; 0 for none
    began_soc: float = 0.0
    diffusion_lag_s: float = USUAL_LAG_S  #: T, known to within a factor
    end: DischargeEnd | None = None  #: of an earlier discharge of this battery
    #: time under load at the end of the route: RC pairs settle in their own times
    loaded_s: float = math.inf

    def __post_init__(self) -> None:
        for name in ("soc", "reserve_soc", "counted"):
            require_between(name, getattr(self, name), 0.0, 1.0)
        require_each_not_negative("", self, "soc_std", "capacity_std", "resistance_std", "cutoff_V", "diffusion_lag_s")
        require_each_positive("", self, "soh_capacity", "resistance_ratio")
        require_between("temperature_degC", self.temperature_degC, COLDEST_DEGC, HOTTEST_DEGC)
        if self.reserve_soc >= self.soc:
            raise InputError(
                f"reserve_soc must be below soc = {self.soc:g}, got {self.reserve_soc:g}: nothing above the reserve is "
                "left; charge, or lower the reserve"
            )


def require_cutoff(battery: Battery, cutoff_V: float) -> None:
    """Raise InputError for a voltage at which the robot stops that the full battery does not reach at rest."""
    full_V = float(battery.thevenin.ocv.voltage_V[-1])
    if cutoff_V >= full_V:
        raise InputError(
            f"cutoff_V must be below {full_V:.4g} V, the voltage of the full battery at rest, got {cutoff_V:g} (volts, "
            "not millivolts?)"
        )


class Discharge(NamedTuple):
    """Discharge at constant power of N batteries, sampled from the distribution of this one."""

    soc: np.ndarray  #: (K,) grid from 0 to 1
    energy_J: np.ndarray  #: (K, N) given between each state of charge and the end of the discharge; 0 below the end
    start_soc: np.ndarray  #: (N,) state of charge now


def usable_energy(battery: Battery, state: BatteryState, power_W: float) -> Quantiles:
    """Energy [J] above the reserve at this mean power [W], P10/P50/P90."""
    return quantiles(usable_at(battery, state, power_W, normal_points(BATTERY_DIMENSIONS)))


def usable_at(battery: Battery, state: BatteryState, power_W: float, z: np.ndarray) -> np.ndarray:
    """(N,) energy [J] that batteries sampled from the distribution of this one give at constant power [W].

    z: (5, N) standard normal points of state of charge, capacity, resistance, diffusion lag and luck with the peaks.
    """
    drawn, curves = _drawn(battery, state, power_W, z)
    start_J = _at_both(curves.whole_J, drawn.soc, drawn.resistance)
    end_J = _end_J(curves, state, drawn)
    return drawn.capacity * np.maximum(start_J - end_J, 0.0)


def discharge(battery: Battery, state: BatteryState, power_W: float, z: np.ndarray) -> Discharge:
    """Discharge at constant power [W] of batteries sampled from the distribution of this one.

    z: (5, N) standard normal points of state of charge, capacity, resistance, diffusion lag and luck with the peaks.
    """
    drawn, curves = _drawn(battery, state, power_W, z)
    whole_J = _at_resistance(curves.whole_J, drawn.resistance)
    end_J = _end_J(curves, state, drawn)
    return Discharge(_GRID, drawn.capacity * np.maximum(whole_J - end_J, 0.0), drawn.soc)


class _Between(NamedTuple):
    """Places (N,) on a grid: the lower neighbour, and the share of the step above it."""

    below: np.ndarray
    share: np.ndarray

    def rows(self, rows: np.ndarray) -> _Between:
        """Some of the places."""
        return _Between(self.below[rows], self.share[rows])


class _Drawn(NamedTuple):
    """Batteries sampled from a distribution, (N,) each."""

    soc: np.ndarray
    capacity: np.ndarray  #: over the battery file's
    lag_J: np.ndarray  #: energy left when the voltage ends a discharge, because the surface empties before the mean
    luck: np.ndarray  #: expected number of peaks up to the first that occurs
    resistance: _Between  #: on the grid of `_Curves`
    lag: _Between  #: likewise

    def rows(self, rows: np.ndarray) -> _Drawn:
        """Some of the batteries, with the luck of all: it is that of the peaks to come."""
        return _Drawn(
            self.soc[rows],
            self.capacity[rows],
            self.lag_J[rows],
            self.luck,
            self.resistance.rows(rows),
            self.lag.rows(rows),
        )


class _Curves(NamedTuple):
    """Energy along SoC (K,) for resistances (R,), of a battery with the capacity of its file."""

    whole_J: np.ndarray  #: (K, R) given between empty and each SoC
    end_J: np.ndarray  #: (K, R) part of it that is left where the voltage ends a discharge from each SoC
    #: for each lag, (K, R) expected number of peaks that the battery cannot deliver, from full down to each SoC; None
    #: for no peaks
    peaks: tuple[np.ndarray, ...] | None


def _drawn(battery: Battery, state: BatteryState, power_W: float, z: np.ndarray) -> tuple[_Drawn, _Curves]:
    """Batteries at the points (5, N), and the curves to interpolate.

    By Bayes' rule, the points count by how likely such batteries are to have done what this one has: survived the way
    up to here, as far as their resistance decides, and given its charge down to an earlier end.
    """
    z_soc, z_capacity, z_resistance, z_lag, z_luck = z
    deviation = state.capacity_std * two_piece(z_capacity, _LOWER_SIDE_SHARE)
    capacity = np.maximum(state.soh_capacity + deviation, _LEAST_SOH_CAPACITY)
    counted_std = min(state.counted * state.capacity_std / state.soh_capacity, state.soc_std)
    counted = counted_std / state.capacity_std * state.soh_capacity if state.capacity_std > 0.0 else 0.0
    with_capacity = counted * (1.0 - state.soh_capacity / capacity)
    by_itself = np.sqrt(state.soc_std**2 - counted_std**2) * z_soc
    soc = np.clip(state.soc + with_capacity + by_itself, 0.0, 1.0)
    lag_s = state.diffusion_lag_s * np.exp(_LAG_LOG_STD * z_lag)
    curves = _curves(battery, state, power_W)
    drawn = _Drawn(
        soc,
        capacity,
        max(power_W, 0.0) * lag_s if state.cutoff_V > 0.0 else np.zeros(soc.shape),
        -np.log(normal_tail(z_luck)),
        _between(z_resistance, _RESISTANCES),
        _between(lag_s / capacity, _lags_s(state)),
    )
    unlikely = np.zeros(soc.shape)
    if state.began_soc > state.soc and curves.peaks is not None:
        unlikely += _failures(curves.peaks[min(_USUAL_LAG, len(curves.peaks) - 1)], state, drawn.resistance)
    if state.end is not None:
        unlikely += _misfit(battery, state, state.end, capacity, lag_s, drawn.resistance)
    if np.ptp(unlikely) <= _UNINFORMATIVE:
        return drawn, curves
    upto = np.cumsum(np.exp(unlikely.min() - unlikely))  # each row as often as it is likely
    return drawn.rows(np.searchsorted(upto, (np.arange(len(upto)) + 0.5) / len(upto) * upto[-1])), curves


def _between(values: np.ndarray, grid: np.ndarray) -> _Between:
    """Places of values (N,) on an increasing grid, of which the ends stand for all beyond."""
    below = np.clip(np.searchsorted(grid, values) - 1, 0, max(len(grid) - 2, 0))
    if len(grid) == 1:
        return _Between(below, np.zeros(values.shape))
    return _Between(below, np.clip((values - grid[below]) / (grid[below + 1] - grid[below]), 0.0, 1.0))


def _failures(peaks: np.ndarray, state: BatteryState, resistance: _Between) -> np.ndarray:
    """(N,) expected number n of peaks that a battery could not have delivered since `began_soc`; exp(-n) survive.

    peaks: (K, R) at the usual lag. With the lag of each point, survival would prove that it is short: but the peaks
    behind were only similar to those ahead.
    """
    now, began = (
        np.array([np.interp(soc, _GRID, column) for column in peaks.T]) for soc in (state.soc, state.began_soc)
    )
    return _at_resistance((now - began)[None], resistance)[0]


def _misfit(
    battery: Battery,
    state: BatteryState,
    end: DischargeEnd,
    capacity: np.ndarray,
    lag_s: np.ndarray,
    resistance: _Between,
) -> np.ndarray:
    """(N,) negative log-likelihoods of the charge given down to an earlier end."""
    ocv_V, r_ohm, peak_ohm = (row[:, None] for row in discharge_curves(battery, _GRID, end.temperature_degC))
    slow_ohm, fast_ohm = _resistances(state, r_ohm, peak_ohm)
    margin_V = ocv_V - slow_ohm * end.mean_A - fast_ohm * end.last_A - end.voltage_V
    surface_soc = _at_resistance(_ends(_GRID[:, None] + np.zeros(margin_V.shape), margin_V)[-1:], resistance)[0]
    lag_As = end.mean_A * lag_s + max(end.last_A - end.mean_A, 0.0) * _peak_lag_s(lag_s)
    file_Ah = battery.capacity_Ah
    given_Ah = file_Ah * capacity * (end.start_soc - surface_soc) - lag_As / SECONDS_PER_HOUR
    offset_Ah = battery.sensor.offset_std_A * end.hours
    std_Ah = math.hypot(file_Ah * end.start_soc_std, offset_Ah, _NEAR_EMPTY_STD * file_Ah)
    return 0.5 * ((given_Ah - end.given_Ah) / std_Ah) ** 2


def _lags_s(state: BatteryState) -> np.ndarray:
    """Lags of diffusion [s] of the curves; 0 alone where no voltage ends a discharge."""
    has_lag = state.cutoff_V > 0.0 and state.diffusion_lag_s > 0.0
    return state.diffusion_lag_s * _LAGS if has_lag else np.zeros(1)


def _resistances(state: BatteryState, r_ohm: np.ndarray, peak_ohm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(K, R) resistances of the slow pairs and to a peak, from those of the file (K, 1)."""
    ratio = np.maximum(state.resistance_ratio + state.resistance_std * _RESISTANCES, 0.0)
    if state.peak_resistance_ratio is None:
        return (r_ohm - peak_ohm) * ratio, peak_ohm * ratio
    of_peaks = np.maximum(state.peak_resistance_ratio + state.peak_resistance_std * _RESISTANCES, 0.0)
    return (r_ohm - peak_ohm) * ratio, peak_ohm * of_peaks


def _curves(battery: Battery, state: BatteryState, power_W: float) -> _Curves:
    """Energy at constant power [W] of batteries with each of the resistances and lags."""
    ocv_V, r_ohm, peak_ohm = (
        row[:, None] for row in discharge_curves(battery, _GRID, state.temperature_degC, state.loaded_s)
    )
    slow_ohm, fast_ohm = _resistances(state, r_ohm, peak_ohm)
    square = ocv_V**2 - 4 * (slow_ohm + fast_ohm) * max(power_W, 0.0)
    voltage_V = 0.5 * (ocv_V + np.sqrt(np.maximum(square, 0.0)))
    margin_V = np.where(square >= 0.0, voltage_V - state.cutoff_V, _NO_POWER_V)
    whole_J = SECONDS_PER_HOUR * battery.capacity_Ah * running_integral(_GRID, voltage_V)
    peaks = None
    if state.peaks is not None and power_W > 0.0:
        settled_V = ocv_V - slow_ohm * power_W / voltage_V
        time_s = (whole_J[-1] - whole_J[::-1]) / power_W
        highest_W = (_highest_W(battery, state, power_W, settled_V, fast_ohm, lag_s) for lag_s in _lags_s(state))
        peaks = tuple(running_integral(time_s, state.peaks.above(of_lag[::-1]))[::-1] for of_lag in highest_W)
    return _Curves(whole_J, _ends(whole_J, margin_V), peaks)


def _highest_W(
    battery: Battery, state: BatteryState, power_W: float, settled_V: np.ndarray, peak_ohm: np.ndarray, lag_s: float
) -> np.ndarray:
    """(K, R) highest power that a peak may have, with this lag over the capacity.

    settled_V: (K, R) voltage of the battery before its resistance to peaks. With diffusion, the limit at the SoC of the
    surface applies at a mean SoC that is higher by the charge that mean power and peak have taken from the surface.
    """
    least_V = np.maximum(state.cutoff_V, 0.5 * settled_V)
    peak_A = np.maximum(settled_V - least_V, 0.0) / np.maximum(peak_ohm, _LEAST_OHM)
    highest_W = least_V * peak_A
    if not lag_s > 0.0:
        return highest_W
    of_peak_s = float(_peak_lag_s(lag_s))
    mean_A, charge_As = power_W / settled_V, SECONDS_PER_HOUR * battery.capacity_Ah
    lead = (mean_A * lag_s + np.maximum(peak_A - mean_A, 0.0) * of_peak_s) / charge_As
    # below the SoC at which the highest peak empties the surface, the limit is the peak that just empties it
    emptying_A = mean_A + np.maximum(_GRID[:, None] * charge_As - mean_A * lag_s, 0.0) / max(of_peak_s, _LEAST_S)
    columns = zip((_GRID[:, None] + lead).T, highest_W.T, (least_V * emptying_A).T, strict=True)
    return np.stack(
        [np.where(at[0] > _GRID, emptying, np.interp(_GRID, at, watts)) for at, watts, emptying in columns], axis=1
    )


def _peak_lag_s(lag_s: Any) -> Any:
    """The time that takes the place of the lag [s] for a peak, of any shape."""
    return np.clip(2.0 / 3.0 * np.sqrt(15.0 / math.pi * lag_s * PEAK_LASTS_S) - PEAK_LASTS_S, 0.0, lag_s)


def _ends(whole_J: np.ndarray, margin_V: np.ndarray) -> np.ndarray:
    """(K, R) energy at the end of a discharge from each SoC, where its margin is first below 0; 0 where it never is."""
    rows = np.arange(len(whole_J))[:, None]
    below = np.maximum.accumulate(np.where(margin_V < 0, rows, -1), axis=0)  # the next SoC down that fails, -1 for none
    low, high = np.maximum(below, 0), np.clip(below + 1, 0, len(whole_J) - 1)
    margin_low, margin_high = np.take_along_axis(margin_V, low, 0), np.take_along_axis(margin_V, high, 0)
    crosses = (margin_low < 0) & (margin_high > 0)
    share = np.where(crosses, margin_high / np.where(crosses, margin_high - margin_low, 1.0), 0.0)
    low_J, high_J = np.take_along_axis(whole_J, low, 0), np.take_along_axis(whole_J, high, 0)
    return np.where(below >= 0, high_J - share * (high_J - low_J), 0.0)


def _end_J(curves: _Curves, state: BatteryState, drawn: _Drawn) -> np.ndarray:
    """(N,) energy over the capacity at the end of each battery's discharge, by its voltage, the reserve or a peak."""
    soc, resistance = drawn.soc, drawn.resistance
    from_here = curves.end_J[(soc * (len(_GRID) - 1)).astype(int)[:, None], resistance.below[:, None] + np.arange(2)]
    by_voltage = from_here[:, 0] + resistance.share * (from_here[:, 1] - from_here[:, 0])
    by_voltage += drawn.lag_J / drawn.capacity
    by_reserve = _at_both(curves.whole_J, np.full(soc.shape, state.reserve_soc), resistance)
    end_J = np.maximum(by_reserve, by_voltage)
    if curves.peaks is None:
        return end_J
    by_peaks = np.stack([_end_by_peaks_J(curves.whole_J, of_lag, drawn) for of_lag in curves.peaks])
    low, high = (_rows(by_peaks, np.minimum(drawn.lag.below + k, len(by_peaks) - 1)) for k in (0, 1))
    return np.maximum(end_J, low + drawn.lag.share * (high - low))


def _end_by_peaks_J(whole_J: np.ndarray, peaks: np.ndarray, drawn: _Drawn) -> np.ndarray:
    """(N,) energy over the capacity at the first peak (of a table (K, R)) that a battery cannot deliver."""
    end_J, resistance = np.zeros(drawn.soc.shape), drawn.resistance
    upto = _at_both(peaks, drawn.soc, resistance) + drawn.luck / drawn.capacity
    for column in range(peaks.shape[1] - 1):
        here = resistance.below == column
        low, high = (np.interp(upto[here], peaks[::-1, k], whole_J[::-1, k], right=0.0) for k in (column, column + 1))
        end_J[here] = low + resistance.share[here] * (high - low)
    return end_J


def _at_resistance(table: np.ndarray, between: _Between) -> np.ndarray:
    """(K, N) columns of a table (K, R), interpolated at the resistances of the batteries."""
    low, high = table[:, between.below], table[:, between.below + 1]
    return low + between.share * (high - low)


def _at_both(table: np.ndarray, soc: np.ndarray, between: _Between) -> np.ndarray:
    """(N,) values of a table (K, R), interpolated at the SoC and the resistance of each battery."""
    position = soc * (len(_GRID) - 1)
    row = np.minimum(position.astype(int), len(_GRID) - 2)
    rows = table[row[:, None] + np.arange(2), between.below[:, None]]
    next_rows = table[row[:, None] + np.arange(2), between.below[:, None] + 1]
    at_low, at_high = (pair[:, 0] + (position - row) * (pair[:, 1] - pair[:, 0]) for pair in (rows, next_rows))
    return at_low + between.share * (at_high - at_low)


def usable_J(found: Discharge) -> np.ndarray:
    """(N,) energy [J] that each of the batteries gives from its state of charge now."""
    position = found.start_soc * (len(found.soc) - 1)
    below = np.minimum(position.astype(int), len(found.soc) - 2)
    low, high = _rows(found.energy_J, below), _rows(found.energy_J, below + 1)
    return low + (position - below) * (high - low)


def soc_after(found: Discharge, energy_J: np.ndarray) -> np.ndarray:
    """(N,) state of charge of each battery after giving this energy (N,), at most down to the end of its discharge."""
    left_J = usable_J(found) - energy_J
    above = np.clip(np.sum(found.energy_J <= left_J, axis=0), 1, len(found.soc) - 1)
    low, high = _rows(found.energy_J, above - 1), _rows(found.energy_J, above)
    share = np.clip((left_J - low) / np.where(high > low, high - low, np.inf), 0.0, 1.0)
    return found.soc[above - 1] + share * (found.soc[1] - found.soc[0])


def discharge_curves(
    battery: Battery, soc: np.ndarray, temperature_degC: float, loaded_s: float = math.inf
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Along SoC (K,): voltage [V] of the discharge branch, resistance [ohm] after `loaded_s` of load, and to a peak."""
    model = battery.thevenin
    ocv_V = model.ocv.mean_V(soc, temperature_degC) - model.hysteresis_V_at(soc, temperature_degC)
    usual_A = USUAL_C * model.capacity_Ah
    u = thevenin.CircuitInput(-usual_A, temperature_degC)
    ohmic, pairs = -thevenin.ohmic_drop(soc, u, model) / usual_A, thevenin.pair_resistances(soc, u, model)

    def after(seconds: float) -> np.ndarray:
        decays = thevenin.pair_decays(u, model, seconds) if math.isfinite(seconds) else [0.0] * len(pairs)
        return (
            ohmic + np.zeros(soc.shape) + sum((1.0 - decay) * pair for decay, pair in zip(decays, pairs, strict=True))
        )

    return ocv_V, after(max(loaded_s, PEAK_LASTS_S)), after(PEAK_LASTS_S)


def _rows(columns: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """(N,) element of each column (K, N) in its own row (N,)."""
    return np.take_along_axis(columns, rows[None], axis=0)[0]
