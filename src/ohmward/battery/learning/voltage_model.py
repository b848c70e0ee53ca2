"""Voltage of a battery along a part of a log, and its derivatives by all that is not known.

    c(t)  = c_0 + jumps + (counted(t) - integral of the offset) / Q_file         charge, by the capacity of the file
    s(t)  = 1 - (1 - c(t)) Q_file / Q                                            state of charge
    V     = V_ocv(c, T) + M(c, T) h + v_0 + sum v_j

The corrections stand along the charge c, since that is what a log shows; `open_circuit` has the voltage V_ocv.

The corrections theta of the battery act as `parameters` says; those of the log are its `nuisances`. SoC acts on the
voltage through the slope of the curve; what it does to resistances is of second order and left to the iteration.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate
from typing import NamedTuple

import numpy as np

from ohmward.battery.battery import Battery, require_thevenin
from ohmward.battery.identification.circuit_design import hat
from ohmward.battery.identification.open_loop import scan
from ohmward.battery.learning.nuisances import MISFIT_KNOTS, Nuisances, hours_since, nuisances_of
from ohmward.battery.learning.open_circuit import OpenCircuit, true_soc
from ohmward.battery.learning.parameters import (
    RESISTANCE_KNOTS,
    Parameters,
    parameters_of,
)
from ohmward.battery.learning.samples import Samples
from ohmward.battery.models.temperature import coldness_per_K
from ohmward.battery.models.thevenin import (
    CircuitInput,
    Thevenin,
    emptiness,
    ohmic_resistance,
    pair_resistances,
    transfer_share,
)

#: Relative step of a time constant for the derivative.
_TAU_STEP = 0.02
#: Half step of the hysteresis at the start for its derivative, since a state that saturates is not linear in it.
_HYSTERESIS_STEP = 0.5


class VoltagePrediction(NamedTuple):
    """Voltage and SoC in the rows of a part."""

    soc: np.ndarray  #: (N,) charge c, SoC by the capacity of the file
    voltage_V: np.ndarray  #: (N,)
    over_V2: np.ndarray  #: (N,) sum of the squares of the overpotentials [V^2]
    voltage_columns: np.ndarray  #: (N, K + M) derivatives by the parameters, then by the nuisances
    soc_anywhere: np.ndarray  #: (T,) SoC at every sample


class CircuitVoltage(NamedTuple):
    """Overpotentials and hysteresis in the rows."""

    voltage_V: np.ndarray  #: (N,) their sum
    over_V2: np.ndarray  #: (N,) sum of the squares of the overpotentials [V^2]
    columns: np.ndarray  #: (N, K + M) derivatives


class LinearCircuit(NamedTuple):
    """Overpotentials and hysteresis as linear functions of the unknowns about x."""

    x: np.ndarray
    circuit: CircuitVoltage

    def at(self, x: np.ndarray) -> CircuitVoltage:
        """Their values at other unknowns."""
        return self.circuit._replace(voltage_V=self.circuit.voltage_V + self.circuit.columns @ (x - self.x))


@dataclass(frozen=True, eq=False)
class VoltageModel:
    """The voltage along a part of a log as a function of the unknowns."""

    battery: Battery  #: as its file has it
    samples: Samples  #: of the part
    rows: np.ndarray  #: (N,) indices of the samples that are looked at
    #: overpotentials and hysteresis, linear about a point; None computes them anew for all unknowns
    about: LinearCircuit | None = None

    @cached_property
    def model(self) -> Thevenin:
        """The circuit."""
        return require_thevenin(self.battery)

    @cached_property
    def parameters(self) -> Parameters:
        """Unknowns of the battery."""
        return parameters_of(self.battery)

    @cached_property
    def nuisances(self) -> Nuisances:
        """Unknowns of the part."""
        return nuisances_of(self.samples, self.model)

    def share_at(self, soc: np.ndarray) -> np.ndarray:
        """Relative error of the overpotential at these states of charge."""
        share = self.battery.noise.overpotential_share
        along = share if isinstance(share, tuple) else (share, share)
        return np.interp(soc, np.linspace(0.0, 1.0, len(along)), along)

    @cached_property
    def coldness(self) -> np.ndarray:
        """(T,) distance from the temperature of the file in an Arrhenius law."""
        return np.asarray(coldness_per_K(self.samples.temperature_degC, self.model.reference_degC))

    @cached_property
    def offset_hours(self) -> np.ndarray:
        """(T, 1 + offsets) hours since the start and since each change of the offset."""
        return hours_since(self.samples, np.concatenate([self.samples.time_s[:1], self.nuisances.offset_from_s]))

    @cached_property
    def jump_steps(self) -> np.ndarray:
        """(T, jumps) 1 from each jump of SoC on."""
        at = np.array([jump.sample for jump in self.samples.jumps], dtype=int)
        return (np.arange(self.samples.time_s.size)[:, None] >= at).astype(float)

    @cached_property
    def starts(self) -> np.ndarray:
        """Indices of the first sample of each segment, the start of the part and after every gap."""
        return np.concatenate([[0], self.samples.gaps]).astype(int)

    def predict(self, x: np.ndarray) -> VoltagePrediction:
        """Voltage in the rows with the unknowns x (K + M,), and its derivatives."""
        K, rows = self.parameters.size, self.rows
        theta, nu = x[:K], x[K:]
        charge = _ChargeAlong(self, theta, nu)
        soc = charge.soc[rows]
        curve, degC = OpenCircuit(self.battery, theta), self.samples.temperature_degC[rows]
        circuit = self.circuit(x, charge) if self.about is None else self.about.at(x)
        columns = circuit.columns + curve.slope_V(soc, degC)[:, None] * charge.columns(rows)
        columns[:, :K] += curve.columns(soc, degC)
        misfit = hat(soc, MISFIT_KNOTS)
        columns[:, K:][:, self.nuisances.misfit] = misfit
        voltage_V = curve.at(soc, degC) + circuit.voltage_V + misfit @ nu[self.nuisances.misfit]
        return VoltagePrediction(soc, voltage_V, circuit.over_V2, columns, charge.true_soc)

    def linear_about(self, x: np.ndarray, every: int) -> VoltageModel:
        """The model with every so many rows, its overpotentials and its hysteresis linear about x: much quicker."""
        part = VoltageModel(self.battery, self.samples, self.rows[::every])
        charge = _ChargeAlong(part, x[: self.parameters.size], x[self.parameters.size :])
        return replace(part, about=LinearCircuit(x, part.circuit(x, charge)))

    def circuit(self, x: np.ndarray, charge: _ChargeAlong) -> CircuitVoltage:
        """Overpotentials and hysteresis in the rows."""
        K, rows, soc = self.parameters.size, self.rows, charge.soc
        theta, nu = x[:K], x[K:]
        columns = np.zeros((rows.size, x.size))
        voltage_V = self._add_hysteresis(columns, theta, nu, soc[rows])
        current_A = self.samples.current_A - charge.offset_A
        v0 = self._add_ohmic(columns, theta, soc[rows], current_A[rows])
        over_V2 = v0**2
        mean_A = self.samples.mean_current_A - np.where(self.samples.mean_current_A == 0.0, 0.0, charge.offset_A)
        before = np.concatenate([soc[:1], soc[:-1]])
        for j in range(self.model.pairs):
            vj = self._add_pair(columns, j, theta, nu, before, mean_A)
            over_V2 += vj**2
            voltage_V += vj
        return CircuitVoltage(voltage_V + v0, over_V2, columns)

    def soc_columns(self, x: np.ndarray, samples: np.ndarray) -> np.ndarray:
        """(A, K + M) derivatives of the SoC in these samples by the unknowns x."""
        return _ChargeAlong(self, x[: self.parameters.size], x[self.parameters.size :]).true_columns(samples)

    def offset_rows(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Offsets [A] that declared rests show beyond those in x, (B,), and their derivatives (B, K + M)."""
        at = np.array([rest.sample for rest in self.samples.rests], dtype=int)
        found_A = np.array([rest.excess_A for rest in self.samples.rests])
        columns = np.zeros((at.size, x.size))
        columns[:, self.parameters.group("offset")] = 1.0
        columns[:, self.parameters.size :][:, self.nuisances.offsets] = self.offset_hours[at, 1:] > 0.0
        return found_A - self.battery.sensor.offset_A - columns @ x, columns

    def _add_ohmic(self, columns: np.ndarray, theta: np.ndarray, soc: np.ndarray, current_A: np.ndarray) -> np.ndarray:
        """Ohmic drop [V] in the rows, its derivatives added to the columns."""
        group, cold = self.parameters.group, self.coldness[self.rows]
        u = CircuitInput(current_A, self.samples.temperature_degC[self.rows])
        shape = hat(soc, RESISTANCE_KNOTS)
        activation = theta[group("activation")]
        log_ratio = shape @ theta[group("ohmic")] + (cold * activation[0] if activation.size else 0.0)
        ohm = ohmic_resistance(soc, u, self.model) * np.exp(log_ratio)
        linear_V, transfer_V = ohm * current_A, self.model.transfer_V
        drop_V = linear_V if transfer_V is None else linear_V * transfer_share(linear_V / transfer_V)
        share = 1.0 if transfer_V is None else 1.0 / np.sqrt(1.0 + (linear_V / transfer_V) ** 2)
        columns[:, group("ohmic")] += (share * linear_V)[:, None] * shape
        if activation.size:
            columns[:, group("activation").start] += share * linear_V * cold
        self._add_offset(columns, -ohm * share)
        return drop_V

    def _add_offset(self, columns: np.ndarray, volts_per_A: np.ndarray) -> None:
        """Add what an offset of the current does to an overpotential."""
        columns[:, self.parameters.group("offset")] += volts_per_A[:, None]
        on = self.offset_hours[self.rows, 1:] > 0.0
        columns[:, self.parameters.size :][:, self.nuisances.offsets] += volts_per_A[:, None] * on

    def _add_pair(
        self, columns: np.ndarray, j: int, theta: np.ndarray, nu: np.ndarray, before: np.ndarray, mean_A: np.ndarray
    ) -> np.ndarray:
        """Voltage [V] of the RC pair j in the rows, its derivatives added to the columns.

        before: (T,) SoC at the sample before; mean_A: (T,) mean current of the interval.
        """
        p, rows, group = self.parameters, self.rows, self.parameters.group
        ohm, shape, emptying = self._pair_ohm(j, theta, before, mean_A)
        tau_s = self.model.tau_s[j] * np.exp(theta[group("tau")][j])
        passed = self.samples.dt_s * self.model.rate_arrhenius_factor(self.samples.temperature_degC) / tau_s
        decay = np.exp(-passed)
        drive_V = (1 - decay) * ohm * mean_A
        empty = group("empty_activation")
        drives = [shape, emptying[:, None]] if theta[empty].size else [shape]
        found = scan(decay, drive_V[:, None] * np.hstack(drives))[rows]
        driven_V = found[:, : RESISTANCE_KNOTS.size].sum(axis=1)
        of_starts = self._left_of_starts(passed)
        start_V = of_starts @ nu[self.nuisances.pair(j)]
        columns[:, p.pair(j)] += found[:, : RESISTANCE_KNOTS.size]
        columns[:, empty] += found[:, RESISTANCE_KNOTS.size :]
        columns[:, p.size :][:, self.nuisances.pair(j)] += of_starts
        if theta[group("activation")].size:
            columns[:, group("activation").stop - 1] += self.coldness[rows] * driven_V
        slower = np.exp(-passed / (1 + _TAU_STEP))
        columns[:, group("tau").start + j] += (scan(slower, (1 - slower) * ohm * mean_A)[rows] - driven_V) / _TAU_STEP
        self._add_offset(columns, -ohm[rows])
        return driven_V + start_V

    def _pair_ohm(
        self, j: int, theta: np.ndarray, soc: np.ndarray, current_A: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(T,) resistance of the pair j, and its logarithm's derivatives by the knots (T, R) and towards empty (T,)."""
        group, u = self.parameters.group, CircuitInput(current_A, self.samples.temperature_degC)
        shape, emptying = hat(soc, RESISTANCE_KNOTS), self.coldness * np.asarray(emptiness(soc))
        activation, empty = theta[group("activation")], theta[group("empty_activation")]
        log_ratio = shape @ theta[self.parameters.pair(j)] + emptying * empty.sum()
        if activation.size:
            log_ratio += self.coldness * activation[-1]
        return pair_resistances(soc, u, self.model)[j] * np.exp(log_ratio), shape, emptying

    def _left_of_starts(self, passed: np.ndarray) -> np.ndarray:
        """(N, segments) share left in the rows of a voltage at the start of each segment; passed: (T,) dt / tau."""
        age = np.cumsum(passed)
        since = age[self.rows, None] - age[self.starts]
        return np.where(self.rows[:, None] >= self.starts, np.exp(-np.maximum(since, 0.0)), 0.0)

    def _add_hysteresis(self, columns: np.ndarray, theta: np.ndarray, nu: np.ndarray, soc: np.ndarray) -> np.ndarray:
        """Hysteresis voltage [V] in the rows, its derivatives added to the columns."""
        if not self.nuisances.has_hysteresis:
            return np.zeros(soc.size)
        larger = theta[self.parameters.group("hysteresis")]
        half_distance_V = self.model.hysteresis_V_at(soc, self.samples.temperature_degC[self.rows])
        half_distance_V = half_distance_V * np.exp(larger.sum())
        states, slopes = self._hysteresis(nu[self.nuisances.hysteresis])
        h = states[self.rows]
        columns[:, self.parameters.group("hysteresis")] += (half_distance_V * h)[:, None]
        segment = np.searchsorted(self.starts, self.rows, side="right") - 1
        places = self.parameters.size + self.nuisances.hysteresis.start + segment
        columns[np.arange(self.rows.size), places] += half_distance_V * slopes[self.rows]
        return half_distance_V * h

    def _hysteresis(self, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(T,) hysteresis state from these states at the start of each segment, and its derivative by them."""
        rate = self.model.hysteresis_rate / self.model.capacity_Ah
        moved = rate * np.where(self.samples.mean_current_A == 0.0, 0.0, self.samples.moved_Ah)
        if self.model.net_charge_hysteresis:
            low, high = np.maximum(start - _HYSTERESIS_STEP, -1.0), np.minimum(start + _HYSTERESIS_STEP, 1.0)
            below, at, above = (_saturating(moved, self.starts, each) for each in (low, start, high))
            width = np.repeat(np.maximum(high - low, 1e-9), np.diff(self.starts, append=moved.size))
            return at, (above - below) / width
        decay = np.exp(-np.abs(moved))
        drive = (1 - decay) * np.sign(moved)
        decay[self.starts], drive[self.starts] = 0.0, start
        of_start = np.zeros(moved.size)
        of_start[self.starts] = 1.0
        found = scan(decay, np.column_stack([drive, of_start]))
        return found[:, 0], found[:, 1]


class _ChargeAlong:
    """Charge c along a part in every sample, state of charge, and their derivatives."""

    def __init__(self, of: VoltageModel, theta: np.ndarray, nu: np.ndarray):
        self.of, group = of, of.parameters.group
        samples, places, capacity_Ah = of.samples, of.nuisances, of.model.capacity_Ah
        stored = of.model.coulombic_efficiency * float(np.exp(theta[group("efficiency")].sum()))
        self.stored = np.cumsum(np.where(samples.moved_Ah > 0.0, stored * samples.moved_Ah, 0.0)) / capacity_Ah
        drawn = np.cumsum(np.where(samples.moved_Ah > 0.0, 0.0, samples.moved_Ah)) / capacity_Ah
        changes_A = np.concatenate([[of.battery.sensor.offset_A + theta[group("offset")].sum()], nu[places.offsets]])
        self.per_A = -of.offset_hours / capacity_Ah
        counted = self.stored + drawn + self.per_A @ changes_A
        self.soc = nu[places.soc] + counted + of.jump_steps @ nu[places.jumps]
        self.offset_A = changes_A[0] + (of.offset_hours[:, 1:] > 0.0) @ changes_A[1:]
        log_ratio = float(theta[group("capacity")].sum())
        self.gain = float(np.exp(-log_ratio))
        self.true_soc = true_soc(self.soc, log_ratio)

    def columns(self, at: np.ndarray) -> np.ndarray:
        """(N, K + M) derivatives of the charge c in these samples."""
        p, places = self.of.parameters, self.of.nuisances
        columns = np.zeros((at.size, p.size + places.size))
        columns[:, p.group("efficiency")] = self.stored[at, None]
        columns[:, p.group("offset")] = self.per_A[at, :1]
        of_log = columns[:, p.size :]
        of_log[:, places.soc] = 1.0
        of_log[:, places.jumps] = self.of.jump_steps[at]
        of_log[:, places.offsets] = self.per_A[at, 1:]
        return columns

    def true_columns(self, at: np.ndarray) -> np.ndarray:
        """(N, K + M) derivatives of the state of charge in these samples."""
        columns = self.gain * self.columns(at)
        columns[:, self.of.parameters.group("capacity")] = (1.0 - self.true_soc[at])[:, None]
        return columns


def _saturating(moved: np.ndarray, starts: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(T,) state that follows the net charge within -1 and 1, from these values at the start of each segment."""
    parts = []
    for first, last, value in zip(starts, [*starts[1:], moved.size], values, strict=True):
        steps = moved[first + 1 : last].tolist()
        parts.append(list(accumulate(steps, lambda h, step: min(max(h + step, -1.0), 1.0), initial=float(value))))
    return np.concatenate(parts)
