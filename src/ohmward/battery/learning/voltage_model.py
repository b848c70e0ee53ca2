"""Voltage of a battery along a part of a log, and its derivatives by all unknowns.

    c(t)    = c_0 + jumps + (counted(t) - integral of the offset) / Q_file       charge, by the capacity of the file
    s(t)    = 1 - (1 - c(t)) Q_file / Q                                          state of charge
    V_ocv(c) = OCV(z, T) + c_ocv(c) + (T - T_0) e(c)                             open-circuit voltage
    V       = V_ocv(c, T) + M(c, T) h + v_0 + sum v_j

The corrections are functions of the charge c, since that is what a log shows. Charge, overpotentials and hysteresis
with their derivatives are the model's own, see `sensitivities`. An offset that changes in the middle of a log acts from
there on like one that was present from the start.

Where logs have shown the curve, down to the SoC l, it is pinned to the charge below full, whatever the capacity is.
Below, it is known along SoC, so that it stretches to empty, at the charge e = 1 - Q / Q_file in units of Q_file. The
place z on the curve of the file is

    z(c) = c                            c >= l
    z(c) = l (c - e) / (l - e)          c <  l

With l = 1 no log has shown the curve: then z is the state of charge, and for a battery that may have aged since its
test, the slip of its electrodes moves it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.learning.parameters import SLOPE_WIDTH, parameters_of, prior_covariance
from ohmward.battery.learning.samples import Samples
from ohmward.battery.models.noise import HYSTERESIS_UNKNOWN_STD, SOC_UNKNOWN_STD, walk_variance
from ohmward.battery.models.ocv import correlation, hat, slip_shape
from ohmward.battery.models.sensitivities import CircuitAlong, CircuitSample, SensitiveCircuit
from ohmward.battery.models.thevenin import Corrections, Thevenin, without_curve
from ohmward.battery.posterior import ENTROPY_KNOTS, OCV_KNOTS, Unknowns
from ohmward.filters.belief import Belief
from ohmward.logs.log import SECONDS_PER_HOUR
from ohmward.trace import Kernel, exp, linearize, where

#: A range of SoC above empty that is shorter than this is not stretched: it counts as shown.
_SHORTEST = 0.02


class CurvePlace(NamedTuple):
    """Places z on the curve of the file."""

    seen_from_soc: Any  #: l
    log_ratio: Any  #: of the capacity over the file's
    slip: Any = 0.0  #: share of a loss of capacity by which the electrodes slip
    full_stays: bool = True  #: False where slip leaves empty where it is, see `models.ocv`

    @property
    def empty(self) -> Any:
        """Charge e at empty."""
        return 1.0 - exp(self.log_ratio)

    def at(self, charge: Any) -> Any:
        """Places (N,) of these charges c, array or traced."""
        low, empty = self.seen_from_soc, self.empty
        stretches = (low > _SHORTEST) & (low - empty > _SHORTEST) & (charge < low)
        z = where(stretches, low * (charge - empty) / where(stretches, low - empty, 1.0), charge)
        loss = exp(-self.log_ratio) - 1.0  # over the capacity that is left
        return z + self.slip * loss * slip_shape(z, 1.0 if self.full_stays else -1.0)

    def columns(self, charge: np.ndarray) -> np.ndarray:
        """(N, 2) derivatives of the places by the logarithm of the capacity and by the slip."""
        place = np.array(self[:3], dtype=float)
        return np.asarray(_columns(self.full_stays).scan(place, np.asarray(charge, dtype=float))[1])


@cache
def _columns(full_stays: bool) -> Kernel:
    """The derivatives of a place, compiled once for all batteries."""

    def step(place: np.ndarray, charge: Any) -> tuple[np.ndarray, np.ndarray]:
        def at(z: np.ndarray) -> np.ndarray:
            return np.array([CurvePlace(place[0], z[0], z[1], full_stays).at(charge)])

        return place, linearize(at, place[1:])[1][0]

    return Kernel(step, np.zeros(3), 0.0)


def true_soc(charge: np.ndarray, log_ratio: float) -> np.ndarray:
    """State of charge at the charges c by the capacity of the file."""
    return 1.0 - (1.0 - charge) * np.exp(-log_ratio)


def file_charge(soc: np.ndarray, log_ratio: float) -> np.ndarray:
    """Charges c by the capacity of the file at these states of charge."""
    return 1.0 - (1.0 - soc) * np.exp(log_ratio)


@dataclass(frozen=True, eq=False)
class OpenCircuit:
    """The curve of a battery with the corrections theta (K,)."""

    battery: Battery
    theta: np.ndarray
    parameters: Unknowns  #: of the battery

    @cached_property
    def model(self) -> Thevenin:
        """The circuit of the file."""
        return self.battery.thevenin

    @cached_property
    def place(self) -> CurvePlace:
        """Places on the curve; the electrodes of a battery whose curve was learnt do not slip."""
        knowledge, slip = self.battery.knowledge, self.model.ocv_slip
        log_ratio = float(self.theta[self.parameters.group("capacity")].sum())
        if knowledge is not None:
            return CurvePlace(knowledge.seen_from_soc, log_ratio)
        more_slip = float(self.theta[self.parameters.group("slip")].sum())
        return CurvePlace(1.0, log_ratio, slip + more_slip, full_stays=slip >= 0.0)

    def at(self, charge: np.ndarray, temperature_degC: np.ndarray | float) -> np.ndarray:
        """Voltage [V] without hysteresis at these charges (N,)."""
        group, curve = self.parameters.group, self.model.ocv
        voltage_V = np.asarray(curve.mean_V(self.place.at(charge), temperature_degC))
        voltage_V = voltage_V + np.interp(charge, OCV_KNOTS, self.theta[group("ocv")])
        entropy = self.theta[group("entropy")]
        if not entropy.size:
            return voltage_V
        return voltage_V + (temperature_degC - curve.reference_degC) * np.interp(charge, ENTROPY_KNOTS, entropy)

    def slope_V(self, charge: np.ndarray, temperature_degC: np.ndarray | float) -> np.ndarray:
        """Slope of the voltage along the charge [V] (N,)."""
        above_V, below_V = (self.at(charge + step, temperature_degC) for step in (SLOPE_WIDTH, -SLOPE_WIDTH))
        return (above_V - below_V) / (2 * SLOPE_WIDTH)

    def columns(self, charge: np.ndarray, temperature_degC: np.ndarray | float) -> np.ndarray:
        """(N, K) derivatives of the voltage by the corrections."""
        columns = np.zeros((charge.size, self.parameters.size))
        self.fill(columns, charge, temperature_degC)
        return columns

    def fill(self, columns: np.ndarray, charge: np.ndarray, temperature_degC: np.ndarray | float) -> None:
        """Write the derivatives by the corrections of the curve to their places in columns (N, K or more)."""
        group, curve = self.parameters.group, self.model.ocv
        z, degC = self.place.at(charge), temperature_degC
        steep_V = (curve.mean_V(z + SLOPE_WIDTH, degC) - curve.mean_V(z - SLOPE_WIDTH, degC)) / (2 * SLOPE_WIDTH)
        by_capacity, by_slip = self.place.columns(charge).T
        columns[:, group("capacity")] = (steep_V * by_capacity)[:, None]
        if self.battery.knowledge is None:
            columns[:, group("slip")] = (steep_V * by_slip)[:, None]
        columns[:, group("ocv")] = hat(charge, OCV_KNOTS)
        if self.theta[group("entropy")].size:
            warmer_K = np.broadcast_to(degC - curve.reference_degC, charge.shape)
            columns[:, group("entropy")] = warmer_K[:, None] * hat(charge, ENTROPY_KNOTS)


#: Interval between changes of the offset of a current sensor [h], and most such changes.
_OFFSET_HOURS, _MOST_OFFSETS = 6.0, 30
#: Knots of SoC of the error peculiar to one log, however well the model fits all others.
MISFIT_KNOTS = np.linspace(0.0, 1.0, 11)
_MISFIT_LENGTH = 0.1
#: Error of the RC voltages at the start of a part: those of this current, in multiples of the capacity per hour.
_START_C = 0.15
#: Keeps the walk of a sensor that has none from being singular [A].
_LEAST_WALK_A = 1e-9
#: Smallest standard deviation of an RC voltage at the start, for each volt of the battery.
_LEAST_PAIR_SHARE = 5e-4


#: Half step of the hysteresis at the start for its derivative, since a state that saturates is not linear in it.
_HYSTERESIS_STEP = 0.5


class VoltageInRows(NamedTuple):
    """Voltage in the rows of a part, and its charge."""

    soc: np.ndarray  #: (N,) charge c, SoC by the capacity of the file
    voltage_V: np.ndarray  #: (N,)
    over_V2: np.ndarray  #: (N,) sum of the squares of the overpotentials [V^2]
    voltage_columns: np.ndarray  #: (N, K + M) derivatives by the unknowns
    charge: ChargeAlong  #: charge and SoC at every sample


@dataclass(frozen=True, eq=False)
class VoltageModel:
    """The voltage along a part of a log as a function of the unknowns."""

    battery: Battery  #: as its file has it
    samples: Samples  #: of the part
    rows: np.ndarray  #: (N,) indices of the samples whose voltage is compared
    #: circuit, linear about a point; None runs the circuit through the log for all unknowns
    about: LinearCircuit | None = None

    @cached_property
    def model(self) -> Thevenin:
        """The circuit."""
        return self.battery.thevenin

    @cached_property
    def parameters(self) -> Unknowns:
        """Unknowns of the battery."""
        return parameters_of(self.battery)

    @cached_property
    def unknowns(self) -> Unknowns:
        """All unknowns (K + M,): those of the battery, then those of the part."""
        segments, hysteresis = self.starts.size, any(self.model.ocv.hysteresis_V)
        of_part = {
            "start soc": 1,
            "jumps": len(self.samples.jumps),
            "offset changes": self.offset_starts.size,
            **{f"start v{j}": segments for j in range(self.model.pairs)},
            "start hysteresis": segments * hysteresis,
            "misfit": MISFIT_KNOTS.size,
        }
        return Unknowns({**self.parameters.sizes, **of_part})

    @cached_property
    def starts(self) -> np.ndarray:
        """Indices of the first sample of each segment, the start of the part and after every gap."""
        return np.concatenate([[0], self.samples.gaps]).astype(int)

    def predict(self, x: np.ndarray) -> VoltageInRows:
        """Voltage in the rows with the unknowns x (K + M,), and its derivatives."""
        return self._predictions(x.tobytes())

    @cached_property
    def _predictions(self) -> Callable[[bytes], VoltageInRows]:
        """The last prediction: a search with other weights or another prior begins where the one before ended."""
        return lru_cache(maxsize=1)(lambda x: self._predict(np.frombuffer(x)))

    def _predict(self, x: np.ndarray) -> VoltageInRows:
        there = self.circuit(x) if self.about is None else self.about.at(x, self.rows)
        soc, degC = there.soc, self.samples.temperature_degC[self.rows]
        curve = OpenCircuit(self.battery, x[: self.parameters.size], self.parameters)
        columns = there.voltage_columns.copy()
        columns[:, there.charge.moving] += curve.slope_V(soc, degC)[:, None] * there.charge.moving_columns(self.rows)
        curve.fill(columns, soc, degC)
        misfit = self.unknowns.group("misfit")
        columns[:, misfit] = hat(soc, MISFIT_KNOTS)
        voltage_V = curve.at(soc, degC) + there.voltage_V + columns[:, misfit] @ x[misfit]
        return there._replace(voltage_V=voltage_V, voltage_columns=columns)

    def linear_about(self, x: np.ndarray, every: int) -> VoltageModel:
        """The model with every `every`-th row, its circuit linear about x: much quicker."""
        part = VoltageModel(self.battery, self.samples, self.rows[::every])
        there = part.circuit(x)
        columns = there.charge.moving_columns(np.arange(self.samples.time_s.size))
        return replace(part, about=LinearCircuit(x, there, columns))

    def offset_rows(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Offsets [A] that declared rests show beyond those in x, (B,), and their derivatives (B, K + M)."""
        at = np.array([rest.sample for rest in self.samples.rests], dtype=int)
        found_A = np.array([rest.excess_A for rest in self.samples.rests])
        columns = np.zeros((at.size, x.size))
        columns[:, self.parameters.group("offset")] = 1.0
        columns[:, self.unknowns.group("offset changes")] = at[:, None] >= self.offset_starts
        return found_A - self.battery.sensor.offset_A - columns @ x, columns

    @cached_property
    def offset_starts(self) -> np.ndarray:
        """Indices of the first sample after each change of the sensor's offset."""
        time_s = self.samples.time_s
        steps = int(min(self.samples.hours / _OFFSET_HOURS, _MOST_OFFSETS))
        from_s = time_s[0] + (time_s[-1] - time_s[0]) * np.arange(1, steps + 1) / (steps + 1)
        return np.searchsorted(time_s, from_s, side="right")

    @cached_property
    def sensitive(self) -> SensitiveCircuit:
        """The circuit without its curve, with an offset even where the file takes it as exact: a log may change it."""
        sizes = Corrections(*(self.parameters.sizes[name] for name in Corrections._fields))._replace(offset=1)
        return SensitiveCircuit(without_curve(self.model), sizes)

    @cached_property
    def places(self) -> np.ndarray:
        """Places of the corrections of the circuit among the unknowns; an offset is the last of them."""
        return self.parameters.places(*Corrections._fields)

    @cached_property
    def moving_corrections(self) -> np.ndarray:
        """Places of the corrections that move the charge; an offset that the file has is the last of them."""
        moving = self.sensitive.moving
        return self.places[moving[moving < self.places.size]]

    @cached_property
    def moving(self) -> np.ndarray:
        """Places of the unknowns on which the charge depends: corrections, its start, jumps, changes of the offset."""
        return np.concatenate([self.moving_corrections, self.unknowns.places("start soc", "jumps", "offset changes")])

    def circuit(self, x: np.ndarray) -> VoltageInRows:
        """Voltage of the circuit without its curve: overpotentials and hysteresis."""
        # the slope of the hysteresis at the starts is that between one below and one above the most likely one
        group = self.unknowns.group("start hysteresis")
        middle = x[group] if x[group].size else np.zeros(self.starts.size)
        low, high = np.maximum(middle - _HYSTERESIS_STEP, -1.0), np.minimum(middle + _HYSTERESIS_STEP, 1.0)
        start_h = np.column_stack([low, middle, high])
        theta = np.zeros(sum(self.sensitive.sizes))
        theta[: self.places.size] = x[self.places]
        (soc,) = x[self.unknowns.group("start soc")]
        along = self.sensitive.along(theta, soc, self._circuit_samples(x, start_h))
        return VoltageInRows(
            soc=along.soc[self.rows],
            voltage_V=along.voltage_V[self.rows],
            over_V2=along.over_V2[self.rows],
            voltage_columns=self._columns(x, along, high - low),
            charge=ChargeAlong(self, x, along.soc, along.soc_columns),
        )

    def _circuit_samples(self, x: np.ndarray, hysteresis: np.ndarray) -> CircuitSample:
        """The samples with the unknowns x (K + M,) of the part; hysteresis: (segments, 3) at the starts."""
        samples, group, starts = self.samples, self.unknowns.group, self.starts
        T = samples.time_s.size
        counted, moved = np.ones(T), np.zeros(T)
        start_V, start_h = np.zeros((T, self.model.pairs)), np.zeros((T, 3))
        counted[starts] = 0.0
        moved[starts] = samples.moved_Ah[starts] / self.model.capacity_Ah
        np.add.at(moved, self.jump_starts, x[group("jumps")])
        for j in range(self.model.pairs):
            start_V[starts, j] = x[group(f"start v{j}")]
        start_h[starts] = hysteresis
        offset_A = np.zeros(T)
        np.add.at(offset_A, self.offset_starts, x[group("offset changes")])
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
        rows, group, P = self.rows, self.unknowns.group, sum(self.sensitive.sizes)
        columns = np.zeros((rows.size, x.size))
        found = along.voltage_columns[rows]
        columns[:, self.places] = found[:, : self.places.size]
        columns[:, group("offset changes")] = found[:, P - 1, None] * (rows[:, None] >= self.offset_starts)
        segment = np.searchsorted(self.starts, rows, side="right") - 1
        for j in range(self.model.pairs):
            # share of the voltage at the start of each segment that is left at the start of each later one
            left = np.tril(np.ones((self.starts.size, self.starts.size)))
            for k, share in enumerate(along.left[self.starts[1:], j], start=1):
                left[k:, :k] *= share
            columns[:, group(f"start v{j}")] = found[:, P + j, None] * left[segment]
        if self.unknowns.sizes["start hysteresis"]:
            slope_V = along.hysteresis_V[rows] / np.maximum(width, 1e-9)[segment]
            columns[np.arange(rows.size), group("start hysteresis").start + segment] = slope_V
        return columns


class ChargeAlong(NamedTuple):
    """Charge c at every sample of a part, state of charge, and their derivatives."""

    of: VoltageModel
    x: np.ndarray  #: (K + M,) unknowns
    charge: np.ndarray  #: (T,)
    by_circuit: np.ndarray  #: (T, C) derivatives by the corrections that move it, the last of them the offset

    @property
    def log_ratio(self) -> float:
        """Logarithm of the capacity over the file's."""
        return float(self.x[self.of.parameters.group("capacity")].sum())

    @property
    def soc(self) -> np.ndarray:
        """(T,) state of charge."""
        return true_soc(self.charge, self.log_ratio)

    @property
    def moving(self) -> np.ndarray:
        """Places of the unknowns on which the charge depends."""
        return self.of.moving

    def moving_columns(self, at: np.ndarray) -> np.ndarray:
        """Derivatives of the charge in these samples (N,) by the unknowns on which it depends."""
        by_circuit = self.by_circuit[at]
        before = self.by_circuit[self.of.offset_starts - 1, -1]
        return np.hstack(
            [
                by_circuit[:, : self.of.moving_corrections.size],
                np.ones((at.size, 1)),
                at[:, None] >= self.of.jump_starts,
                np.minimum(by_circuit[:, -1, None] - before, 0.0),
            ]
        )

    def columns(self, at: np.ndarray) -> np.ndarray:
        """(N, K + M) derivatives of the charge in these samples."""
        columns = np.zeros((at.size, self.x.size))
        columns[:, self.moving] = self.moving_columns(at)
        return columns

    def soc_columns(self, at: np.ndarray) -> np.ndarray:
        """(N, K + M) derivatives of the state of charge in these samples."""
        columns = np.exp(-self.log_ratio) * self.columns(at)
        columns[:, self.of.parameters.group("capacity")] = (1.0 - self.soc[at])[:, None]
        return columns


class LinearCircuit(NamedTuple):
    """Charge and voltage of the circuit as linear functions of the unknowns about x."""

    x: np.ndarray
    circuit: VoltageInRows
    charge_columns: np.ndarray  #: derivatives of the charge at every sample by the unknowns on which it depends

    def at(self, x: np.ndarray, rows: np.ndarray) -> VoltageInRows:
        """Both at other unknowns; rows: those of the model."""
        there, step = self.circuit, x - self.x
        charge = there.charge.charge + self.charge_columns @ step[there.charge.moving]
        return there._replace(
            soc=charge[rows],
            voltage_V=there.voltage_V + there.voltage_columns @ step,
            charge=there.charge._replace(x=x, charge=charge),
        )


def prior_of(model: VoltageModel, misfit_V: float) -> Belief:
    """Prior of all unknowns of a part, whose SoC at the start may be any; misfit_V: error peculiar to one log [V]."""
    battery, samples, circuit = model.battery, model.samples, model.model
    K, group = model.parameters.size, model.unknowns.group
    mean, std = np.zeros(model.unknowns.size), np.zeros(model.unknowns.size)
    mean[group("start soc")], std[group("start soc")] = 0.5, SOC_UNKNOWN_STD
    std[group("jumps")] = [jump.std for jump in samples.jumps]
    step_s = float(samples.time_s[-1] - samples.time_s[0]) / (model.offset_starts.size + 1)
    walk_A2: Any = walk_variance(max(battery.sensor.offset_walk_A, _LEAST_WALK_A), SECONDS_PER_HOUR, step_s)
    std[group("offset changes")] = np.sqrt(walk_A2)
    least_V = _LEAST_PAIR_SHARE * float(np.mean(circuit.ocv.voltage_V))
    for j, row in enumerate(circuit.r_ohm):
        std[group(f"start v{j}")] = least_V + _START_C * circuit.capacity_Ah * float(np.mean(row))
    std[group("start hysteresis")] = HYSTERESIS_UNKNOWN_STD
    covariance = np.diag(std**2)
    covariance[:K, :K] = prior_covariance(battery)
    covariance[group("misfit"), group("misfit")] = misfit_V**2 * correlation(MISFIT_KNOTS, _MISFIT_LENGTH)
    return Belief(mean, covariance)
