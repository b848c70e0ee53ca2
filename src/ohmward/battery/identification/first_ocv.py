"""First open-circuit voltage, which the fit of the circuit corrects, from the best source that there is.

In order: the curve that the user gives; low-rate tests; rests at several states of charge; the chemistry's usual curve.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

import numpy as np

from ohmward.battery.chemistries import CHEMISTRIES, chemistry
from ohmward.battery.identification.circuit_prior import (
    LFP_WALK_FROM_RESTS,
    LFP_WITHOUT_LOW_RATE_V,
    CircuitPrior,
    prior_for,
    with_branches,
)
from ohmward.battery.identification.ocv_from_logs import (
    OcvBranch,
    RestPoint,
    branch_axis_std,
    branch_notes,
    find_branches,
    ocv_from_branches,
    ocv_from_rests,
    reconcile_branches,
    rest_points,
)
from ohmward.battery.identification.record import Record, reference_degC
from ohmward.battery.identification.soc_axis import anchor_soc, find_anchors
from ohmward.battery.models.ocv import OcvCurve
from ohmward.battery.ocv_file import given_ocv
from ohmward.errors import InputError
from ohmward.logs.log import Note

#: "thevenin" chooses the number of RC pairs by evidence.
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


#: Error of the chemistry's usual curve for a cell of 3.7 V, of its SoC axis, and the SoC over which they hold on: cells
#: of one chemistry differ by a shift, a stretch and a bend.
_USUAL_V, _USUAL_SOC, _USUAL_LENGTH = 0.03, 0.03, 0.3


class FirstOcv(NamedTuple):
    """The first curve and what is known of it."""

    curve: OcvCurve
    #: where it comes from, "line" a straight line through a drive
    source: Literal["given", "low-rate", "rests", "chemistry", "line"]
    fitted: tuple[Record, ...]  #: the records that the circuit is fitted to
    branches: tuple[OcvBranch, ...] = ()  #: low-rate discharges and charges, none for another source
    axis_std: float = 0.0  #: error of its SoC axis in the middle beyond the usual
    notes: tuple[Note, ...] = ()  #: how it was found

    @property
    def both_directions(self) -> bool:
        """True where a low-rate discharge and a low-rate charge were measured."""
        return len({b.direction for b in self.branches}) == 2

    @property
    def not_identified(self) -> tuple[str, ...]:
        """Sentence on a curve that nobody measured."""
        if self.source != "chemistry":
            return ()
        return ("open-circuit voltage: the usual curve of the chemistry, corrected where the logs moved",)

    def prior(self, chemistry: str) -> CircuitPrior:
        """The prior of the circuit and of the correction of this curve."""
        prior = prior_for(chemistry, self.source == "given" or self.both_directions)
        if self.source == "chemistry":
            return prior._replace(ocv_V=_USUAL_V, ocv_soc=_USUAL_SOC, ocv_length=_USUAL_LENGTH)
        if chemistry == "lfp" and self.both_directions:
            prior = with_branches(prior)
        if chemistry == "lfp" and not self.branches:
            prior = prior._replace(model_V=LFP_WITHOUT_LOW_RATE_V)
        if chemistry == "lfp" and self.source == "rests":
            prior = prior._replace(walk_share=LFP_WALK_FROM_RESTS)
        return prior._replace(ocv_axis_std=self.axis_std)


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
    branches = reconcile_branches([b for r in slow for b in find_branches(r, Q, settings.initial_soc.get(r.log.name))])
    if not branches:
        return _without_low_rate(fast or records, settings)
    curve = ocv_from_branches(branches, reference_degC(fast or slow))
    return FirstOcv(curve, "low-rate", fast, branches, branch_axis_std(branches), branch_notes(branches, Q))


def _without_low_rate(records: Sequence[Record], settings: IdentificationSettings) -> FirstOcv:
    """The curve through rests; with too few of them at a known state of charge, the chemistry's usual curve."""
    try:
        return FirstOcv(_ocv_from_rests(records, settings), "rests", tuple(records))
    except InputError:
        if not settings.chemistry or not all(known_without_curve(record, settings) for record in records):
            raise
    return _usual_ocv(records, settings)


def usual_efficiency(settings: IdentificationSettings) -> float:
    """Coulombic efficiency of the chemistry, 1 for an unknown one."""
    return CHEMISTRIES[settings.chemistry].coulombic_efficiency if settings.chemistry else 1.0


def _ocv_from_rests(records: Sequence[Record], settings: IdentificationSettings) -> OcvCurve:
    """The curve through the rests of every record whose state of charge is known without a curve."""
    points: list[RestPoint] = []
    first_refusal: InputError | None = None
    for record in records:
        given = settings.initial_soc.get(record.log.name)
        try:
            axis = anchor_soc(record, settings.capacity_Ah, None, given, usual_efficiency(settings))
        except InputError as refusal:
            if known_without_curve(record, settings):
                raise
            first_refusal = first_refusal or refusal
            continue
        points += rest_points(record, axis.soc)
    if not points and first_refusal:
        raise first_refusal
    lowest_V = min(float(np.nanmin(r.log.voltage_V)) for r in records)
    return ocv_from_rests(points, lowest_V, reference_degC(records))


def known_without_curve(record: Record, settings: IdentificationSettings) -> bool:
    """True where the record's state of charge is known without a curve."""
    try:
        find_anchors(record, settings.capacity_Ah, None, settings.initial_soc.get(record.log.name))
    except InputError:
        return False
    return True


def _usual_ocv(records: Sequence[Record], settings: IdentificationSettings) -> FirstOcv:
    """The chemistry's usual curve, to be corrected by the fit."""
    curve = chemistry(settings.chemistry).ocv().scaled(settings.n_series)
    curve = replace(curve, reference_degC=reference_degC(records))
    text = (
        f"no open-circuit voltage in the logs: the usual curve of {settings.chemistry} cells was taken and corrected "
        "by the fit; a table of it (--ocv, ocv=), a low-rate test, or rests of 10 min at several states of charge tell "
        "more"
    )
    return FirstOcv(curve, "chemistry", tuple(records), notes=(Note(text, "warning"),))
