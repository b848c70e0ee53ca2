"""First open-circuit voltage, which the fit of the circuit corrects, from the best source available.

In order: the curve that the user gives; low-rate tests; rests at several states of charge; the chemistry's usual curve;
for the RC model alone, a straight line through drives.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

import numpy as np

from ohmward.battery.chemistries import (
    CHEMISTRIES,
    ChemistryPrior,
    CurvePrior,
    chemistry,
    chemistry_prior,
)
from ohmward.battery.identification.circuit_solve import last_direction
from ohmward.battery.identification.fit_samples import COARSEST_S, FitSamples, scan, thin
from ohmward.battery.identification.ocv_from_logs import (
    OcvBranch,
    RestPoint,
    branch_axis_std,
    branch_note,
    find_branches,
    ocv_from_branches,
    ocv_from_rests,
    reconcile_branches,
    rest_points,
)
from ohmward.battery.identification.record import Record, reference_degC
from ohmward.battery.identification.soc_axis import SocAxis, anchor_soc, axis_anchors
from ohmward.battery.models.ocv import OCV_GRID, OcvCurve
from ohmward.battery.ocv_file import given_ocv
from ohmward.battery.posterior import OCV_KNOTS
from ohmward.errors import InputError
from ohmward.logs.log import Note
from ohmward.optional import require

#: "thevenin" chooses the number of RC pairs by evidence. "rc", the model of [P], has one pair, and a straight line for
#: the curve where the logs show none.
MODELS = ("thevenin", "thevenin-0rc", "thevenin-1rc", "thevenin-2rc", "thevenin-3rc", "rc")
DEFAULT_MODEL = "thevenin"


class IdentificationSettings(NamedTuple):
    """Knowledge of the user about the battery and its logs; see `identify`."""

    capacity_Ah: float
    model: str = DEFAULT_MODEL
    chemistry: str = ""
    n_series: int = 1
    name: str = ""
    initial_soc: Mapping[str, float] = MappingProxyType({})
    idle_current_A: float | None = None
    ocv: Any = None


#: Error of a straight line through a drive for a cell of 3.7 V, of its SoC axis, and their correlation length in SoC.
_LINE_CURVE = CurvePrior((0.03,) * 2, 0.03, 0.3)
#: Largest distance in SoC between rests that show a curve which bends between them: constant currents cannot tell the
#: bends from an overpotential.
_LARGEST_GAP = 0.3
#: Largest distance from a chord of a curve that is straight, over its voltage: between full and empty that is 1.2 % for
#: lead and acid, and 5 % or more for lithium cells.
_CHORD_SHARE = 0.014
#: Relative error of the slope of a straight line beyond the logs that it was fitted to: the slope of the curves of
#: NCA, NMC and LCO between 20 and 60 % is 0.8, 0.6 and 0.4 of that between 60 and 100 %.
_SLOPE_STD = 0.3
#: Smallest change of SoC in which logs show the slope of their open-circuit voltage.
_LEAST_SOC_RANGE = 0.05
#: Time constants [s] of the overpotential beside a straight line, which the fit of the circuit then finds.
_LINE_TAUS_S = (10.0, 60.0, 300.0)


class FirstOcv(NamedTuple):
    """The first curve, its source and its errors."""

    curve: OcvCurve
    #: where it comes from; "line": a straight line through a drive
    source: Literal["given", "low-rate", "rests", "chemistry", "line"]
    fitted: tuple[Record, ...]  #: the records that the circuit is fitted to
    branches: tuple[OcvBranch, ...] = ()  #: low-rate discharges and charges, () for another source
    axis_std: float = 0.0  #: additional error of its SoC axis in the middle
    line_std_V: Any = 0.0  #: error on OCV_KNOTS of a line beyond the logs, or between the rests, that it was fitted to
    notes: tuple[Note, ...] = ()  #: how it was found

    @property
    def both_directions(self) -> bool:
        """True where a low-rate discharge and a low-rate charge were measured."""
        return len({b.direction for b in self.branches}) == 2

    @property
    def not_identified(self) -> tuple[str, ...]:
        """Sentence on a curve that was not measured."""
        if self.source == "line":
            return ("open-circuit voltage: no curve in the logs; a straight line was taken",)
        if self.source != "chemistry":
            return ()
        return ("open-circuit voltage: the usual curve of the chemistry, corrected where the logs moved",)

    def prior(self, chemistry: str) -> ChemistryPrior:
        """The prior of the circuit and of the correction of this curve."""
        prior = chemistry_prior(chemistry)
        if self.source == "chemistry":
            return prior
        if self.source == "line":
            return prior._replace(curve=_LINE_CURVE._replace(line_std_V=self.line_std_V))
        measured = self.source == "given" or self.both_directions
        curve = prior.measured_curve if measured else prior.rested_curve
        curve = curve._replace(middle_soc_std=self.axis_std, line_std_V=self.line_std_V)
        return prior._replace(
            curve=curve,
            hysteresis=(prior.hysteresis_on_branches if self.both_directions else None) or prior.hysteresis,
            model_V=(None if self.branches else prior.unmeasured_model_V) or prior.model_V,
            walk_share=(prior.walk_share_from_rests if self.source == "rests" else None) or prior.walk_share,
        )


def find_first_ocv(records: Sequence[Record], settings: IdentificationSettings) -> FirstOcv:
    """The first curve from all records.

    Raises:
        InputError: no source gives one.
    """
    if settings.ocv is not None:
        given = given_ocv(settings.ocv, np.concatenate([r.log.voltage_V for r in records]), settings.n_series)
        return FirstOcv(given.curve, "given", tuple(records), notes=given.notes)
    fast = tuple(r for r in records if r.test != "low-rate")
    # a charge shows gas instead of the open-circuit voltage; rests of another test show that
    if settings.chemistry and CHEMISTRIES[settings.chemistry].gases and fast:
        return _without_low_rate(records, settings)
    Q = settings.capacity_Ah
    slow = [r for r in records if r.test == "low-rate"]
    found = [find_branches(record, Q, settings.initial_soc.get(record.log.name)) for record in slow]
    branches = reconcile_branches(list(chain.from_iterable(found)))
    if not branches:
        return _without_low_rate(fast or records, settings)
    curve = ocv_from_branches(branches, reference_degC(fast or slow))
    notes = tuple(branch_note(branch, Q) for branch in branches)
    return FirstOcv(curve, "low-rate", fast, branches, branch_axis_std(branches), notes=notes)


def _without_low_rate(records: Sequence[Record], settings: IdentificationSettings) -> FirstOcv:
    """The curve through rests; with too few of them at a known state of charge, the chemistry's usual curve.

    So too where that bends between rests that are far apart. Without a chemistry the error of the curve between these
    is as large as its rise.
    """
    has_usual = bool(settings.chemistry) and all(known_without_curve(record, settings) for record in records)
    try:
        points = _rests(records, settings)
        lowest_V = min(float(np.nanmin(record.log.voltage_V)) for record in records)
        curve = ocv_from_rests(points, lowest_V, reference_degC(records))
    except InputError:
        if not has_usual:
            raise
        return _usual_ocv(records, settings)
    by_rests = FirstOcv(curve, "rests", tuple(records))
    soc = np.array(sorted(point.soc for point in points))
    if float(np.diff(soc).max()) <= _LARGEST_GAP:
        return by_rests
    if not has_usual:
        beyond = np.abs(OCV_KNOTS[:, None] - soc).min(axis=1)
        return by_rests._replace(line_std_V=float(np.ptp(curve.voltage_V)) * beyond)
    usual = _usual_ocv(records, settings)
    grid = np.linspace(soc[0], soc[-1], OCV_GRID.size)
    usual_V, at_rests_V = (np.asarray(usual.curve.mean_V(x, usual.curve.reference_degC)) for x in (grid, soc))
    off_chord = np.abs(usual_V - np.interp(grid, soc, at_rests_V)) / usual_V
    return by_rests if float(np.max(off_chord, initial=0.0)) <= _CHORD_SHARE else usual


def soc_axis(
    record: Record, settings: IdentificationSettings, curve: OcvCurve | None = None, curve_axis_std: float = 0.0
) -> SocAxis:
    """`anchor_soc` with the values of the user and of the chemistry."""
    cell = CHEMISTRIES[settings.chemistry] if settings.chemistry else None
    return anchor_soc(
        record,
        settings.capacity_Ah,
        curve,
        settings.initial_soc.get(record.log.name),
        efficiency=cell.coulombic_efficiency if cell else 1.0,
        ocv_axis_std=curve_axis_std,
        empty_V=settings.n_series * cell.ocv_V[0] if cell else 0.0,
        left_per_C=chemistry_prior(settings.chemistry).left_per_C,
    )


def _rests(records: Sequence[Record], settings: IdentificationSettings) -> list[RestPoint]:
    """The rests of every record whose state of charge is known without a curve."""
    points: list[RestPoint] = []
    first_refusal: InputError | None = None
    for record in records:
        try:
            axis = soc_axis(record, settings)
        except InputError as refusal:
            if known_without_curve(record, settings):
                raise
            first_refusal = first_refusal or refusal
            continue
        points += rest_points(record, axis.soc)
    if not points and first_refusal:
        raise first_refusal
    return points


def known_without_curve(record: Record, settings: IdentificationSettings) -> bool:
    """True where the record's state of charge is known without a curve."""
    try:
        axis_anchors(record, settings.capacity_Ah, None, settings.initial_soc.get(record.log.name))
    except InputError:
        return False
    return True


def _usual_ocv(records: Sequence[Record], settings: IdentificationSettings) -> FirstOcv:
    """The chemistry's usual curve, to be corrected by the fit."""
    curve = chemistry(settings.chemistry).ocv().scaled(settings.n_series)
    curve = replace(curve, reference_degC=reference_degC(records))
    text = (
        f"no open-circuit voltage curve in the logs: the usual curve of {settings.chemistry} cells was taken and "
        "corrected by the fit; a table of it (--ocv, ocv=), a low-rate test, or rests of 10 min at several states of "
        "charge tell more"
    )
    return FirstOcv(curve, "chemistry", tuple(records), notes=(Note(text, "warning"),))


def line_through(records: Sequence[Record], axes: Sequence[SocAxis], capacity_Ah: float, why: InputError) -> FirstOcv:
    """Fit a straight line and resistances to drives at a known state of charge, by least squares.

    V = V_0 + V_1 soc + R_0 i + sum R_k F_k[i], all coefficients >= 0, F_k a first-order filter of gain 1. A charge and
    the rest after it are left out: a line cannot follow gassing or the limit of a charger.

    why: error raised by the other sources.

    Raises:
        InputError: the records move SoC too little to show a slope, or their voltage does not rise.
    """
    nnls = require("scipy.optimize", "identification").nnls

    parts = chain.from_iterable(thin(r, axis.soc) for r, axis in zip(records, axes, strict=True))
    rows = np.concatenate([_line_rows(part) for part in parts])
    columns, voltage_V, time_s = rows[:, :-2], rows[:, -2], rows[:, -1]
    soc = columns[:, 1]
    soc_range = float(np.ptp(soc)) if soc.size else 0.0
    empty_V = slope_V = 0.0
    if soc_range >= _LEAST_SOC_RANGE:
        weight = np.sqrt(time_s)
        x, _ = nnls(weight[:, None] * columns, weight * voltage_V)
        empty_V, slope_V = x[:2]
    if slope_V == 0.0:
        raise InputError(
            f"{why}. The RC model does with a straight line, but the logs, which move SoC by {100 * soc_range:.2g} % "
            "outside charges, do not show an open-circuit voltage that rises; give the battery's OCV curve"
        )
    beyond = np.abs(OCV_KNOTS - OCV_KNOTS.clip(soc.min(), soc.max()))
    curve = OcvCurve((empty_V, empty_V + slope_V), reference_degC=reference_degC(records))
    names = ", ".join(repr(r.log.name) for r in records)
    text = f"open-circuit voltage: the straight line through {names}, because {why}"
    note = Note(text, "warning")
    return FirstOcv(curve, "line", tuple(records), line_std_V=_SLOPE_STD * slope_V * beyond, notes=(note,))


def _line_rows(samples: FitSamples) -> np.ndarray:
    """(N, 8) columns of V_0, V_1, R_0 and the R_k, the voltage, and the time that each sample stands for."""
    mean_A, dt_s = samples.mean_current_A, samples.dt_s
    decays = [np.exp(-dt_s / tau_s) for tau_s in _LINE_TAUS_S]
    filtered = [scan(decay, (1 - decay) * mean_A) for decay in decays]
    used = np.isfinite(samples.voltage_V) & (last_direction(mean_A) <= 0)
    weight = np.minimum(dt_s, COARSEST_S)
    columns = [np.ones_like(dt_s), samples.soc, samples.current_A, *filtered, samples.voltage_V, weight]
    return np.column_stack(columns)[used]
