"""Thevenin model of a solution: from the unknowns of the fit to resistances, OCV curve and start of each record."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ohmward.battery.identification.circuit_design import ENTROPY_KNOTS, OCV_KNOTS, RESISTANCE_GRID
from ohmward.battery.identification.circuit_solve import CircuitProblem, CircuitSolution
from ohmward.battery.identification.confidence import covered
from ohmward.battery.identification.fit_samples import FitSamples
from ohmward.battery.identification.ocv_from_logs import OCV_GRID, smooth
from ohmward.battery.models.ocv import OcvCurve
from ohmward.battery.models.thevenin import Thevenin
from ohmward.logs.log import Note

#: Points of the OCV grid over which the gap is averaged: 5 % of SoC.
_SHAPE_SMOOTHING = 11
#: Largest share of a curve that may run backwards by more than noise, and that noise over the voltage of full.
_MOST_BACKWARDS, _SMALL_FALL = 0.03, 3e-4
#: No resistance is a smaller share of its mean along SoC, however narrow the gap.
_SMALLEST_SHAPE = 0.3


def circuit_of(solution: CircuitSolution, problem: CircuitProblem, efficiency: float) -> Thevenin:
    """The Thevenin model of a solution: its OCV curve corrected, its hysteresis scaled."""
    layout, x = solution.layout, solution.x
    discharge, charge, *pairs = (tuple(x[layout.block(j)].tolist()) for j in range(layout.blocks))
    return Thevenin(
        capacity_Ah=problem.capacity_Ah,
        ocv=corrected_ocv(solution, problem),
        r0_discharge_ohm=discharge,
        r0_charge_ohm=charge,
        r_ohm=tuple(pairs),
        coulombic_efficiency=efficiency,
        reference_degC=problem.reference_degC,
        **solution.rates._asdict(),
        ocv_slip=problem.prior.ocv_slip.mean,
    )


def corrected_ocv(solution: CircuitSolution, problem: CircuitProblem) -> OcvCurve:
    """The first OCV curve as the fit corrected it, non-decreasing, and its hysteresis at the scale of the fit."""
    layout, x = solution.layout, solution.x
    scale = float(x[layout.scale][0]) if layout.hysteresis else 0.0
    more_V_per_K = np.interp(OCV_GRID, ENTROPY_KNOTS, x[layout.entropic]) if layout.entropy else 0.0
    return problem.ocv.corrected(_fitted_curve_V(solution, problem), scale, more_V_per_K)


def curve_notes(solution: CircuitSolution, problem: CircuitProblem) -> tuple[Note, ...]:
    """A warning where much of the fitted OCV curve runs backwards, so that `corrected_ocv` levels it."""
    fitted_V = _fitted_curve_V(solution, problem)
    falls_V = np.maximum.accumulate(fitted_V) - np.minimum.accumulate(fitted_V[::-1])[::-1]
    share = float(np.mean(falls_V > _SMALL_FALL * fitted_V[-1]))
    if share <= _MOST_BACKWARDS:
        return ()
    text = (
        f"{share:.0%} of the open-circuit voltage curve that fits the logs falls with SoC and was levelled, so "
        f"estimators will err there: the logs contradict the capacity or each other. "
        f"Is {problem.capacity_Ah:g} Ah what the tests at low rate move, and are all logs of the same battery?"
    )
    return (Note(text, "warning"),)


def _fitted_curve_V(solution: CircuitSolution, problem: CircuitProblem) -> np.ndarray:
    """The first OCV curve with the correction of the fit [V], on OCV_GRID."""
    first = problem.ocv
    correction_V = np.interp(OCV_GRID, OCV_KNOTS, solution.x[solution.layout.correction])
    return np.asarray(first.mean_V(OCV_GRID, first.reference_degC)) + correction_V


def start_of(solution: CircuitSolution, part: int) -> tuple[tuple[float, ...], float]:
    """RC voltages (n,) [V] and hysteresis state at the start of one part of the records."""
    layout = solution.layout
    start = solution.x[layout.initial(part)].tolist()
    scale = float(solution.x[layout.scale][0]) if layout.hysteresis else 0.0
    return tuple(start[: layout.pairs]), start[-1] / scale if scale > 0 else 0.0


def slow_shape(ocv: OcvCurve, samples: Sequence[FitSamples], capacity_Ah: float) -> np.ndarray:
    """(21,) expected course of the slowest resistance along SoC, about 1 with data: that of the low-rate gap.

    The gap of the low-rate branches is slow overpotential as well as hysteresis, so it shows where the battery is slow.
    Its ends hold more than that and are replaced. Flat without a gap.
    """
    gap_V = smooth(np.asarray(ocv.hysteresis_at(OCV_GRID)) * np.ones(OCV_GRID.size), _SHAPE_SMOOTHING)
    shape = np.interp(RESISTANCE_GRID, OCV_GRID, gap_V)
    shape[0], shape[-1] = shape[1], shape[-2]
    there = covered(samples, capacity_Ah)
    level = float(shape[there].mean()) if there.any() else float(shape.mean())
    return np.maximum(shape / level, _SMALLEST_SHAPE) if level > 0 else np.ones(RESISTANCE_GRID.size)
