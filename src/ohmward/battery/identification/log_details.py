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


class LogDetails(NamedTuple):
    """Stages of the identification on one log that the circuit was fitted to.

    axis: its state of charge and the anchors of that; pulses; edges; relaxations; rests: ends of long rests.
    parts: samples used by the fit, (N,) each, divided at gaps; simulated_V: voltage of the circuit along each.
    """

    record: Record
    axis: SocAxis
    pulses: tuple[Phase, ...]
    edges: tuple[Edge, ...]
    relaxations: tuple[Relaxation, ...]
    rests: tuple[RestPoint, ...]
    parts: tuple[FitSamples, ...]
    simulated_V: tuple[np.ndarray, ...]

    @property
    def residual_V(self) -> tuple[np.ndarray, ...]:
        """Measured minus simulated voltage of each part, (N,) each."""
        return tuple(s.voltage_V - v for s, v in zip(self.parts, self.simulated_V, strict=True))

    @property
    def quality(self) -> LogFit:
        """Range of SoC and residual of the fit; samples weigh as the time they stand for."""
        residual_V = np.concatenate(self.residual_V)
        measured = np.isfinite(residual_V)
        weight = np.minimum(np.concatenate([s.dt_s for s in self.parts])[measured], COARSEST_S)
        mean_square = weight @ residual_V[measured] ** 2 / max(weight.sum(), 1e-9)
        largest_V = float(np.abs(residual_V[measured]).max())
        return log_fit(self.record.log.name, self.record.test, self.axis.soc, float(np.sqrt(mean_square)), largest_V)


def details_of(
    record: Record,
    axis: SocAxis,
    parts: tuple[FitSamples, ...],
    simulated_V: tuple[np.ndarray, ...],
    capacity_Ah: float,
) -> LogDetails:
    """Pulses, edges, relaxations and rests of a record beside its samples and the simulated voltage."""
    return LogDetails(
        record,
        axis,
        find_pulses(record.phases, capacity_Ah),
        find_edges(record, axis.soc, capacity_Ah),
        find_relaxations(record, axis.soc),
        rest_points(record, axis.soc),
        parts,
        simulated_V,
    )


def log_fit(name: str, test: str, soc: np.ndarray, rms_V: float = 0.0, largest_V: float = 0.0) -> LogFit:
    """Entry of a log in the provenance of a battery; soc: (T,) along it."""
    return LogFit(name, test, float(soc.min()), float(soc.max()), rms_V, largest_V)


def branch_fits(branches: Sequence[OcvBranch]) -> tuple[LogFit, ...]:
    """Entries of the low-rate tests that gave the OCV curve."""
    return tuple(log_fit(b.log_name, f"low-rate {b.direction}", b.soc) for b in branches)
