"""Results of the identification along one log: its stages, its residual, and the quality of the fit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ohmward.battery.battery import LogFit
from ohmward.battery.identification.edges import Edge, find_edges
from ohmward.battery.identification.fit_samples import COARSEST_S, FitSamples
from ohmward.battery.identification.ocv_from_low_rate import OcvBranch
from ohmward.battery.identification.ocv_from_rests import RestPoint, rest_points
from ohmward.battery.identification.record import Record
from ohmward.battery.identification.relaxation import Relaxation, find_relaxations
from ohmward.battery.identification.segments import Phase, find_pulses
from ohmward.battery.identification.soc_axis import SocAxis
from ohmward.battery.models.thevenin import Thevenin


class LogDetails(NamedTuple):
    """Stages of the identification on one log that the circuit was fitted to."""

    record: Record
    axis: SocAxis  #: its state of charge and the anchors of that; pulses; edges; relaxations
    pulses: tuple[Phase, ...]
    edges: tuple[Edge, ...]
    relaxations: tuple[Relaxation, ...]
    rests: tuple[RestPoint, ...]  #: ends of long rests
    #: samples used by the fit, (N,) each, divided at gaps; simulated_V: voltage of the circuit along each
    parts: tuple[FitSamples, ...]

    simulated_V: tuple[np.ndarray, ...]
    #: from this voltage on the battery gases, which no circuit models; None where it never does
    gassing_V: float | None

    @property
    def residual_V(self) -> tuple[np.ndarray, ...]:
        """Measured minus simulated voltage of each part, (N,) each."""
        return tuple(s.voltage_V - v for s, v in zip(self.parts, self.simulated_V, strict=True))

    @property
    def quality(self) -> LogFit:
        """Range of SoC and residual of the fit below gassing; samples weigh as the time they stand for."""
        residual_V, modelled = np.concatenate(self.residual_V), self._modelled
        weight = np.minimum(np.concatenate([s.dt_s for s in self.parts])[modelled], COARSEST_S)
        mean_square = weight @ residual_V[modelled] ** 2 / max(weight.sum(), 1e-9)
        largest_V = float(np.abs(residual_V[modelled]).max(initial=0.0))
        return log_fit(self.record.log.name, self.record.test, self.axis.soc, float(np.sqrt(mean_square)), largest_V)

    @property
    def gassing_share(self) -> float:
        """Share of the measured samples at which the battery gases."""
        return 1.0 - int(np.count_nonzero(self._modelled)) / max(int(np.count_nonzero(self._measured)), 1)

    @property
    def _measured(self) -> np.ndarray:
        return np.isfinite(np.concatenate(self.residual_V))

    @property
    def _modelled(self) -> np.ndarray:
        voltage_V = np.concatenate([s.voltage_V for s in self.parts])
        return self._measured & (voltage_V < (np.inf if self.gassing_V is None else self.gassing_V))


def details_of(
    record: Record,
    axis: SocAxis,
    parts: tuple[FitSamples, ...],
    simulated_V: tuple[np.ndarray, ...],
    model: Thevenin,
) -> LogDetails:
    """Pulses, edges, relaxations and rests of a record beside its samples and their voltage as simulated by a model."""
    capacity_Ah = model.capacity_Ah
    return LogDetails(
        record,
        axis,
        find_pulses(record.phases, capacity_Ah),
        find_edges(record, axis.soc, capacity_Ah),
        find_relaxations(record, axis.soc),
        rest_points(record, axis.soc),
        parts,
        simulated_V,
        model.gassing_V,
    )


def log_fit(name: str, test: str, soc: np.ndarray, rms_V: float = 0.0, largest_V: float = 0.0) -> LogFit:
    """Entry of a log in the provenance of a battery; soc: (T,) along it."""
    return LogFit(name, test, float(soc.min()), float(soc.max()), rms_V, largest_V)


def branch_fits(branches: Sequence[OcvBranch]) -> tuple[LogFit, ...]:
    """Entries of the low-rate tests that gave the OCV curve."""
    return tuple(log_fit(b.log_name, f"low-rate {b.direction}", b.soc) for b in branches)
