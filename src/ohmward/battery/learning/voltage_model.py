"""Voltage of a battery along a part of a log, and its derivatives by all that is not known.

    c(t)  = c_0 + jumps + (counted(t) - integral of the offset) / Q_file         charge, by the capacity of the file
    s(t)  = 1 - (1 - c(t)) Q_file / Q                                            state of charge
    V     = V_ocv(c, T) + M(c, T) h + v_0 + sum v_j

The corrections stand along the charge c, since that is what a log shows; `open_circuit` has the voltage V_ocv. Charge,
overpotentials and hysteresis with their derivatives are the model's own, see `sensitivities`. An offset that changes in
the middle of a log acts from there on as one that was there from the start.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ohmward.battery.battery import Battery, require_thevenin
from ohmward.battery.learning.nuisances import MISFIT_KNOTS, Nuisances, nuisances_of
from ohmward.battery.learning.open_circuit import OpenCircuit, true_soc
from ohmward.battery.learning.parameters import Parameters, parameters_of
from ohmward.battery.learning.samples import Samples
from ohmward.battery.models.knots import hat
from ohmward.battery.models.sensitivities import CircuitAlong, CircuitSample, SensitiveCircuit
from ohmward.battery.models.thevenin import Corrections, Thevenin, without_curve

#: Half step of the hysteresis at the start for its derivative, since a state that saturates is not linear in it.
_HYSTERESIS_STEP = 0.5


class VoltagePrediction(NamedTuple):
    """Voltage and SoC in the rows of a part."""

    soc: np.ndarray  #: (N,) charge c, SoC by the capacity of the file
    voltage_V: np.ndarray  #: (N,)
    over_V2: np.ndarray  #: (N,) sum of the squares of the overpotentials [V^2]
    voltage_columns: np.ndarray  #: (N, K + M) derivatives by the parameters, then by the nuisances
    charge: ChargeAlong  #: charge and SoC at every sample


@dataclass(frozen=True, eq=False)
class VoltageModel:
    """The voltage along a part of a log as a function of the unknowns."""

    battery: Battery  #: as its file has it
    samples: Samples  #: of the part
    rows: np.ndarray  #: (N,) indices of the samples that are looked at
    #: circuit, linear about a point; None runs the circuit through the log for all unknowns
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

    @cached_property
    def starts(self) -> np.ndarray:
        """Indices of the first sample of each segment, the start of the part and after every gap."""
        return np.concatenate([[0], self.samples.gaps]).astype(int)

    def share_at(self, soc: np.ndarray) -> np.ndarray:
        """Relative error of the overpotential at these states of charge."""
        share = self.battery.noise.overpotential_share
        along = share if isinstance(share, tuple) else (share, share)
        return np.interp(soc, np.linspace(0.0, 1.0, len(along)), along)

    def predict(self, x: np.ndarray) -> VoltagePrediction:
        """Voltage in the rows with the unknowns x (K + M,), and its derivatives."""
        K, rows = self.parameters.size, self.rows
        there = self.circuit(x) if self.about is None else self.about.at(x)
        soc, degC = there.charge.charge[rows], self.samples.temperature_degC[rows]
        curve = OpenCircuit(self.battery, x[:K])
        columns = there.columns + curve.slope_V(soc, degC)[:, None] * there.charge.columns(rows)
        columns[:, :K] += curve.columns(soc, degC)
        misfit, places = hat(soc, MISFIT_KNOTS), K + np.arange(self.nuisances.size)[self.nuisances.misfit]
        columns[:, places] = misfit
        voltage_V = curve.at(soc, degC) + there.voltage_V + misfit @ x[places]
        return VoltagePrediction(soc, voltage_V, there.over_V2, columns, there.charge)

    def linear_about(self, x: np.ndarray, every: int) -> VoltageModel:
        """The model with every so many rows, its circuit linear about x: much quicker."""
        part = VoltageModel(self.battery, self.samples, self.rows[::every])
        there = part.circuit(x)
        columns = there.charge.columns(np.arange(self.samples.time_s.size))
        moving = np.flatnonzero(columns.any(axis=0))
        return replace(part, about=LinearCircuit(x, there, moving, columns[:, moving]))

    def offset_rows(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Offsets [A] that declared rests show beyond those in x, (B,), and their derivatives (B, K + M)."""
        at = np.array([rest.sample for rest in self.samples.rests], dtype=int)
        found_A = np.array([rest.excess_A for rest in self.samples.rests])
        columns = np.zeros((at.size, x.size))
        columns[:, self.parameters.group("offset")] = 1.0
        columns[:, self.parameters.size :][:, self.nuisances.offsets] = at[:, None] >= self.offset_starts
        return found_A - self.battery.sensor.offset_A - columns @ x, columns

    @cached_property
    def offset_starts(self) -> np.ndarray:
        """Indices of the first sample after each change of the offset."""
        return np.searchsorted(self.samples.time_s, self.nuisances.offset_from_s, side="right")

    @cached_property
    def sensitive(self) -> SensitiveCircuit:
        """The circuit without its curve, with an offset also where the file does not doubt it: a log may change it."""
        sizes = Corrections(*(self.parameters.sizes[name] for name in Corrections._fields))._replace(offset=1)
        return SensitiveCircuit(without_curve(self.model), sizes)

    @cached_property
    def places(self) -> np.ndarray:
        """Places of the corrections of the circuit among the unknowns; an offset is the last of them."""
        groups = [self.parameters.group(name) for name in Corrections._fields]
        return np.concatenate([np.arange(group.start, group.stop) for group in groups])

    def circuit(self, x: np.ndarray) -> CircuitInRows:
        """The circuit along the part, with the derivatives of its voltage in the rows."""
        nu = x[self.parameters.size :]
        low, high = self._hysteresis_starts(nu)
        theta = np.zeros(sum(self.sensitive.sizes))
        theta[: self.places.size] = x[self.places]
        along = self.sensitive.along(theta, nu[self.nuisances.soc], self._circuit_samples(nu, low, high))
        charge = ChargeAlong(self, x, along.soc, along.soc_columns)
        return CircuitInRows(
            charge, along.voltage_V[self.rows], along.over_V2[self.rows], self._columns(x, along, high - low)
        )

    def _hysteresis_starts(self, nu: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Hysteresis (segments,) at the starts below and above the most likely one; its slope is that between them."""
        at = nu[self.nuisances.hysteresis] if self.nuisances.has_hysteresis else np.zeros(self.starts.size)
        return np.maximum(at - _HYSTERESIS_STEP, -1.0), np.minimum(at + _HYSTERESIS_STEP, 1.0)

    def _circuit_samples(self, nu: np.ndarray, low: np.ndarray, high: np.ndarray) -> CircuitSample:
        """The samples with what the nuisances nu (M,) say of them."""
        samples, nuisances, starts = self.samples, self.nuisances, self.starts
        T = samples.time_s.size
        counted, moved = np.ones(T), np.zeros(T)
        start_V, start_h = np.zeros((T, self.model.pairs)), np.zeros((T, 3))
        counted[starts] = 0.0
        moved[starts] = samples.moved_Ah[starts] / self.model.capacity_Ah
        np.add.at(moved, self.jump_starts, nu[nuisances.jumps])
        for j in range(self.model.pairs):
            start_V[starts, j] = nu[nuisances.pair(j)]
        middle = nu[nuisances.hysteresis] if nuisances.has_hysteresis else np.zeros(starts.size)
        start_h[starts] = np.column_stack([low, middle, high])
        offset_A = np.zeros(T)
        np.add.at(offset_A, self.offset_starts, nu[nuisances.offsets])
        return CircuitSample(
            dt_s=samples.dt_s,
            mean_current_A=samples.mean_current_A,
            current_A=samples.current_A,
            temperature_degC=samples.temperature_degC,
            counted=counted,
            moved=moved,
            offset_A=self.battery.sensor.offset_A + np.cumsum(offset_A),
            start_V=start_V,
            start_h=start_h,
        )

    @cached_property
    def jump_starts(self) -> np.ndarray:
        """Indices of the first sample after each jump of SoC."""
        return np.array([jump.sample for jump in self.samples.jumps], dtype=int)

    def _columns(self, x: np.ndarray, along: CircuitAlong, width: np.ndarray) -> np.ndarray:
        """(N, K + M) derivatives of the voltage of the circuit in the rows."""
        rows, nuisances, P = self.rows, self.nuisances, sum(self.sensitive.sizes)
        columns = np.zeros((rows.size, x.size))
        of_log = columns[:, self.parameters.size :]
        found = along.voltage_columns[rows]
        columns[:, self.places] = found[:, : self.places.size]
        if nuisances.offset_from_s.size:
            of_log[:, nuisances.offsets] = found[:, P - 1, None] * (rows[:, None] >= self.offset_starts)
        segment = np.searchsorted(self.starts, rows, side="right") - 1
        for j in range(self.model.pairs):
            # what is left of the voltage at the start of each segment at the start of each later one
            left = np.tril(np.ones((self.starts.size, self.starts.size)))
            for k, share in enumerate(along.left[self.starts[1:], j], start=1):
                left[k:, :k] *= share
            of_log[:, nuisances.pair(j)] = found[:, P + j, None] * left[segment]
        if nuisances.has_hysteresis:
            slope_V = along.hysteresis_V[rows] / np.maximum(width, 1e-9)[segment]
            of_log[np.arange(rows.size), nuisances.hysteresis.start + segment] = slope_V
        return columns


class ChargeAlong(NamedTuple):
    """Charge c at every sample of a part, state of charge, and their derivatives."""

    of: VoltageModel
    x: np.ndarray  #: (K + M,) unknowns
    charge: np.ndarray  #: (T,)
    by_circuit: np.ndarray  #: (T, P) derivatives by the corrections of the circuit, the last of them the offset

    @property
    def log_ratio(self) -> float:
        """Logarithm of the capacity over the file's."""
        return float(self.x[self.of.parameters.group("capacity")].sum())

    @property
    def soc(self) -> np.ndarray:
        """(T,) state of charge."""
        return true_soc(self.charge, self.log_ratio)

    def columns(self, at: np.ndarray) -> np.ndarray:
        """(N, K + M) derivatives of the charge in these samples."""
        places, nuisances = self.of.places, self.of.nuisances
        columns = np.zeros((at.size, self.x.size))
        of_log = columns[:, self.of.parameters.size :]
        columns[:, places] = self.by_circuit[at, : places.size]
        of_log[:, nuisances.soc] = 1.0
        of_log[:, nuisances.jumps] = at[:, None] >= self.of.jump_starts
        if nuisances.offset_from_s.size:
            before = self.by_circuit[self.of.offset_starts - 1, -1]
            of_log[:, nuisances.offsets] = np.minimum(self.by_circuit[at, -1, None] - before, 0.0)
        return columns

    def soc_columns(self, at: np.ndarray) -> np.ndarray:
        """(N, K + M) derivatives of the state of charge in these samples."""
        columns = np.exp(-self.log_ratio) * self.columns(at)
        columns[:, self.of.parameters.group("capacity")] = (1.0 - self.soc[at])[:, None]
        return columns


class CircuitInRows(NamedTuple):
    """Charge along a part, and the voltage of the circuit without its curve in the rows."""

    charge: ChargeAlong
    voltage_V: np.ndarray  #: (N,) overpotentials and hysteresis
    over_V2: np.ndarray  #: (N,) sum of the squares of the overpotentials [V^2]
    columns: np.ndarray  #: (N, K + M) derivatives of the voltage


class LinearCircuit(NamedTuple):
    """Charge and voltage of the circuit as linear functions of the unknowns about x."""

    x: np.ndarray
    circuit: CircuitInRows
    moving: np.ndarray  #: places of the unknowns on which the charge depends
    charge_columns: np.ndarray  #: its derivatives by these at every sample

    def at(self, x: np.ndarray) -> CircuitInRows:
        """Both at other unknowns."""
        there, step = self.circuit, x - self.x
        charge = there.charge.charge + self.charge_columns @ step[self.moving]
        return there._replace(
            charge=there.charge._replace(x=x, charge=charge), voltage_V=there.voltage_V + there.columns @ step
        )
