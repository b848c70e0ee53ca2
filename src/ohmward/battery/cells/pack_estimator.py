"""State of charge of every cell of a pack, live or from logs: a filter for the typical cell, and one for each cell."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, NamedTuple, Self

import numpy as np

from ohmward.battery.battery import Battery, require_battery
from ohmward.battery.cells.cell_filter import CellEstimate, CellFilter, CellSample, CellSpread, CellState, TypicalCell
from ohmward.battery.cells.drift import CellWarning, PackState, cell_warnings, drifted, pack_state, ranges
from ohmward.battery.soc.estimator import SocEstimator, SocRun, samples_of
from ohmward.battery.soc.registry import DEFAULT, chosen_name
from ohmward.battery.soc.sample import INITIAL_SOC_STD, SocEstimate, SocFlag
from ohmward.errors import InputError
from ohmward.filters.estimator import Progress, number, numbers, row_of
from ohmward.filters.run import Run
from ohmward.logs.battery_columns import find_cells
from ohmward.logs.log import Log, LogSource, as_log
from ohmward.trace import Kernel
from ohmward.trace.live import Live
from ohmward.trace.snapshot import VERSION, resume, sealed, take
from ohmward.trace.structure import is_finite, pick_lanes, structure_of

#: Filters that estimate the offset and the health of the typical cell, which the differences need.
FILTERS = ("ekf", "ukf", "gsf")


class PackEstimate(NamedTuple):
    """Estimate after a sample."""

    pack: PackState  #: SoC, charge and weakest cell of the pack
    typical: SocEstimate  #: estimate of the typical cell, as for a pack of equal cells
    cells: CellEstimate  #: estimates of all cells, every field (n,)
    flags: Any  #: of the typical cell


@dataclass(frozen=True, eq=False, repr=False)
class PackRun(Run[PackEstimate]):
    """Estimates for a whole log; the fields of the cells are (T, n), all others (T,)."""

    names: tuple[str, ...]  #: (n,) of the cells
    soc_run: SocRun  #: run of the typical cell
    log: Log  #: with the voltage of a pack of typical cells, as used in that run

    flag_type = SocFlag

    @property
    def pack(self) -> PackState:
        """SoC, charge and weakest cell of the pack, each (T,)."""
        return self.estimates.pack

    @property
    def typical(self) -> SocEstimate:
        """Estimates of the typical cell, each (T,)."""
        return self.estimates.typical

    @property
    def cells(self) -> CellEstimate:
        """Estimates of all cells, each (T, n)."""
        return self.estimates.cells

    def warnings(self) -> tuple[CellWarning, ...]:
        """Warnings about cells that have drifted apart, at the end of the log."""
        return cell_warnings(row_of(self.cells, -1), self.names)

    def first_warning_s(self) -> float | None:
        """Time of the first warning about a cell, None without one."""
        warned = np.any([condition.any(axis=1) for condition in drifted(self.cells).values()], axis=0)
        return float(self.time_s[np.argmax(warned)]) if warned.any() else None

    def figures(self) -> dict[str, Any]:
        """The pack, its weakest cell, the ranges and each cell at the end of the log, by name."""
        now = row_of(self.estimates, -1)
        each = [column for column in now.cells._fields if column != "flags"]
        return {
            **{name: float(value) for name, value in now.pack._asdict().items()},
            "weakest": self.names[int(now.pack.weakest)],
            "ranges": {name: {"value": value, "std": std} for name, (value, std) in ranges(now.cells).items()},
            "warnings": [warning._asdict() | {"cell": self.names[warning.cell]} for warning in self.warnings()],
            "first_warning_s": self.first_warning_s(),
            "cells": [
                {"name": name} | {column: float(getattr(now.cells, column)[k]) for column in each}
                for k, name in enumerate(self.names)
            ],
        }

    def columns(self) -> dict[str, np.ndarray]:
        """Columns (T,) of pack and cells, by name; the number of the weakest cell counts from 1."""
        pack = {
            f"pack_{name}": values for name, values in self.pack._asdict().items() if not name.startswith("weakest")
        }
        weakest = {
            "weakest_cell": self.pack.weakest + 1,
            "weakest_soc": self.pack.weakest_soc,
            "weakest_soc_std": self.pack.weakest_soc_std,
        }
        each = {
            f"cell_{k + 1}_{name}": getattr(self.cells, name)[:, k]
            for k in range(len(self.names))
            for name in ("soc", "soc_std", "capacity_ratio", "resistance_ratio")
        }
        return pack | weakest | each


class PackEstimator:
    """State of charge of every cell, of the weakest and of the pack.

    >>> estimator = ow.PackEstimator(ow.load_battery("battery.toml"))
    >>> now = estimator.update(0.0, current_A=-3.2, cell_voltages_V=[3.31, 3.30, 3.31, 3.22])
    >>> int(now.pack.weakest), now.cells.soc.shape
    (3, (4,))

    Args:
        battery: a pack of at least two cells in series.
        initial_soc: of the typical cell, in [0, 1]; None takes it from the first voltages.
        initial_soc_std: standard deviation of that value.
        lowering: "python", "machine" or None, see `ohmward.trace.Kernel`.
        filter: of the typical cell, "ekf", "ukf" or "gsf".
        spread: expected differences of the cells.

    Raises:
        InputError: a single cell, another filter.
    """

    def __init__(
        self,
        battery: Battery,
        initial_soc: float | None = None,
        initial_soc_std: float = INITIAL_SOC_STD,
        lowering: str | None = None,
        filter: str = DEFAULT,
        spread: CellSpread | None = None,
    ):
        require_battery(battery)
        if battery.n_series < 2:
            raise InputError(f"battery {battery.name!r} has n_series = 1; an estimate of cells needs a pack of them")
        if chosen_name(filter.lower()) not in FILTERS:
            raise InputError(f"filter must be one of {', '.join(FILTERS)} for an estimate of cells, got {filter!r}")
        self.battery = battery
        self.lowering = lowering
        self.typical = SocEstimator(battery, initial_soc, initial_soc_std, lowering, filter)
        self.settings = CellFilter(battery.thevenin, battery.noise, int(battery.n_series), spread or CellSpread())
        self.last: PackEstimate | None = None
        self._states: list[CellState] = []
        self._live: list[Live] = []
        self._compiled: Kernel | None = None

    @property
    def time_s(self) -> float:
        """Time of the last sample; nan before the first."""
        return self.typical.time_s

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the cells: "cell 1" is the first."""
        return tuple(f"cell {k + 1}" for k in range(self.settings.n_series))

    def update(
        self,
        time_s: float,
        current_A: float | None,
        cell_voltages_V: Sequence[float | None] | np.ndarray,
        temperature_degC: float | None = math.nan,
    ) -> PackEstimate:
        """Estimate after one live sample; bad samples are tolerated and flagged. None and nan are missing.

        cell_voltages_V: (n,) of all cells, in their order.  Other arguments as those of `SocEstimator.update`.

        Raises:
            InputError: something other than numbers, or not one for each cell of the battery.
        """
        cells_V = numbers("cell_voltages_V", cell_voltages_V, self.settings.n_series)
        time_s = number("time_s", time_s)
        dt_s = 0.0 if self.typical.state is None else time_s - self.typical.time_s
        pack_V = float(self.typical_voltage(cells_V[None])[0])
        now = self.typical.update(time_s, current_A, pack_V, temperature_degC)
        typical = _typical_cell(now, pack_V)
        current_A, temperature_degC = number("current_A", current_A), number("temperature_degC", temperature_degC)
        samples = [
            CellSample(dt_s, current_A, self.settings.n_series * float(cell_V), temperature_degC, typical)
            for cell_V in cells_V
        ]
        found = [self._advance(k, sample) for k, sample in enumerate(samples)]
        cells = CellEstimate(*(np.array(column, dtype=float) for column in zip(*found, strict=True)))
        self.last = self._estimate(now, cells)
        return self.last

    def run(
        self,
        log: LogSource,
        cell_voltages_V: np.ndarray | None = None,
        progress: Progress | None = None,
        names: tuple[str, ...] = (),
    ) -> PackRun:
        """Estimates for every sample of a log, continuing from the present state.

        cell_voltages_V: (T, n); by default the columns of the log that are numbered and add up to its voltage.
        progress: called now and then with (steps done, T), for the typical cell.
        names: (n,) of the cells; by default those of the columns, or "cell 1" and so on.

        Raises:
            InputError: the log has no cell voltages, or they are of another shape.
        """
        began = time.perf_counter()
        log = as_log(log)
        cells_V, found = self._cells_of(log, cell_voltages_V)
        pack_V = self.typical_voltage(cells_V)
        of_typical = replace(log, voltage_V=pack_V)
        samples = samples_of(of_typical, self.typical.time_s)
        soc_run = self.typical.run(of_typical, progress)
        of_cells = CellSample(
            samples.dt_s,
            samples.current_A,
            self.settings.n_series * cells_V,
            samples.temperature_degC,
            _typical_cell(soc_run.estimates, pack_V),
        )
        cells = self._scan(of_cells, np.flatnonzero(soc_run.flags & SocFlag.EXCHANGED).tolist())
        estimates = self._estimate(soc_run.estimates, cells)
        self.last = row_of(estimates, -1)
        return PackRun(log.time_s, estimates, time.perf_counter() - began, names or found, soc_run, of_typical)

    def warnings(self) -> tuple[CellWarning, ...]:
        """Warnings about cells that have drifted apart, after the last sample."""
        return cell_warnings(self.last.cells, self.names) if self.last else ()

    def snapshot(self) -> dict[str, Any]:
        """The state as a dict for JSON; an estimator of the same battery that restores it continues bit for bit."""
        cells = [take(self.settings, state, self.time_s) for state in self._cell_states()]
        return sealed({"typical": self.typical.snapshot(), "cells": cells})

    @classmethod
    def restore(cls, battery: Battery, snapshot: Mapping[str, Any], **options: Any) -> Self:
        """Estimator that continues from a snapshot; battery, options: those of the estimator that took it.

        Raises:
            InputError: the snapshot is of another version, battery or number of cells, or damaged.
        """
        estimator = cls(battery, **options)
        cells = snapshot.get("cells") if isinstance(snapshot, Mapping) else None
        if not isinstance(cells, Sequence) or len(cells) != estimator.settings.n_series:
            raise InputError(
                f"the snapshot is not of a pack of {estimator.settings.n_series} cells (version {VERSION}); start "
                "a new estimator from the first sample instead"
            )
        filter_name = options.get("filter", DEFAULT)
        estimator.typical = SocEstimator.restore(
            battery, snapshot.get("typical", {}), lowering=estimator.lowering, filter=filter_name
        )
        example = estimator.settings.init(_nothing())
        estimator._states = [resume(estimator.settings, example, cell)[0] for cell in cells]
        return estimator

    def typical_voltage(self, cells_V: np.ndarray) -> np.ndarray:
        """(T,) voltage [V] of a pack of typical cells: n times the median of those that were measured.

        cells_V: (T, n). One cell that falls behind, or a broken wire, does not move the median.
        """
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # a sample without any cell is nan
            return self.settings.n_series * np.nanmedian(np.where(cells_V > 0.0, cells_V, np.nan), axis=-1)

    @property
    def kernel(self) -> Kernel:
        """The step of a cell, compiled."""
        if self._compiled is None:
            nothing = _nothing()
            self._compiled = Kernel(self.settings.step, self.settings.init(nothing), nothing, lowering=self.lowering)
        return self._compiled

    def _advance(self, k: int, sample: CellSample) -> CellEstimate:
        """Estimate of cell k after a sample; a cell whose state is no longer a number is restarted."""
        if not self._live:
            self._live = [self.kernel.live(state) for state in self._states or self._first(sample)]
        estimate = self._live[k].step(sample)
        if not estimate.soc + estimate.soc_std < math.inf and not self._live[k].is_finite():
            self._live[k] = self.kernel.live(self.settings.init(sample))
            estimate = self._live[k].step(sample)
        return estimate

    def _first(self, sample: CellSample) -> list[CellState]:
        """States of all cells before the first sample."""
        return [self.settings.init(sample)] * self.settings.n_series

    def _cell_states(self) -> list[CellState]:
        return [live.state for live in self._live] if self._live else self._states

    def _scan(self, samples: CellSample, exchanged: Sequence[int]) -> CellEstimate:
        """Estimates (T, n) of all cells along samples; exchanged: rows from which on another battery is in."""
        columns = [samples._replace(voltage_V=voltage_V) for voltage_V in samples.voltage_V.T]
        pieces = []
        for begin, end in pairwise(sorted({0, *exchanged, len(samples.dt_s)})):
            if begin in exchanged:
                self._states, self._live = [], []
            pieces.append(self._scan_piece([pick_lanes(column, slice(begin, end)) for column in columns]))
        return CellEstimate(*map(np.concatenate, zip(*pieces, strict=True)))

    def _scan_piece(self, columns: Sequence[CellSample]) -> CellEstimate:
        """Estimates (T, n) of cells along the samples (T,) of each, one after the other: faster than lanes for few."""
        first, last = (row_of(columns[0], k)._replace(dt_s=0.0, voltage_V=math.nan) for k in (0, -1))
        states = self._cell_states() or self._first(first)
        ended, cells = zip(*map(self.kernel.scan, states, columns), strict=True)
        structure = structure_of(states[0], "state")
        self._states = [state if is_finite(structure, state) else self.settings.init(last) for state in ended]
        self._live = []
        return CellEstimate(*(np.stack(values, axis=-1) for values in zip(*cells, strict=True)))

    def _cells_of(self, log: Log, cell_voltages_V: np.ndarray | None) -> tuple[np.ndarray, tuple[str, ...]]:
        """(T, n) cell voltages [V] and the names of the cells."""
        n = self.settings.n_series
        if cell_voltages_V is None:
            found, notes = find_cells(log.extra, log.voltage_V, n)
            if found is None:
                why = "; ".join(note.text for note in notes) or "no columns are numbered and add up to its voltage"
                raise InputError(f"{log.name}: there are no voltages of {n} cells: {why}")
            return found.voltage_V, found.names
        cells_V = np.asarray(cell_voltages_V, dtype=float)
        if cells_V.shape != (len(log), n):
            raise InputError(f"cell_voltages_V must have the shape {(len(log), n)}, got {cells_V.shape}")
        return cells_V, self.names

    def _estimate(self, typical: SocEstimate, cells: CellEstimate) -> PackEstimate:
        typical_Ah = self.battery.capacity_Ah * np.asarray(typical.soh_capacity)
        return PackEstimate(pack_state(cells, typical_Ah), typical, cells, typical.flags)


def _typical_cell(estimate: SocEstimate, voltage_V: Any) -> TypicalCell:
    e = estimate
    return TypicalCell(e.soc, e.soc_std, e.current_offset_A, e.soh_capacity, e.resistance_ratio, voltage_V)


def _nothing() -> CellSample:
    """A sample in which nothing was measured, of an unknown cell."""
    return CellSample(0.0, math.nan, math.nan, math.nan, TypicalCell(0.5, 0.3, 0.0, 1.0, 1.0, math.nan))
