"""Full end of the curve of a label, where the charger of a battery stops below the limit of its chemistry.

Chargers of lithium are set to 4.1 V a cell as well as to 4.2, and a robot calls its battery full where its charger has
tapered. With the SoC z_c of the curve at that voltage,

    OCV'(z) = OCV(z z_c)        Q' = Q (1 + z_c) / 2    of a label, which counts from either limit
                                Q' = Q z_c              where logs have shown the charge along the curve

A file from a test knows the full end itself, and so does one that has learnt from a full charge: to them a charger that
stops below it leaves the battery less than full.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.knowledge import Knowledge
from ohmward.battery.learning.parameters import thevenin_of
from ohmward.battery.models.ocv import OcvCurve
from ohmward.battery.models.rc_elements import rc_of_thevenin
from ohmward.battery.soc.anchor_rule import AnchorRule
from ohmward.battery.soc.anchors import charger_limit_V
from ohmward.logs.log import Log

#: Points of the curve at least.
_POINTS = 201


def full_at_charger_limit(battery: Battery, log: Log) -> Battery:
    """The battery that is full where its charger stops in this log; as it is where its full end is known."""
    if battery.identification is not None or thevenin_of(battery).gassing_V is not None or _was_full(battery.knowledge):
        return battery
    limit_V = charger_limit_V(log, battery)
    if limit_V is None:
        return battery
    rule = AnchorRule(thevenin_of(battery), battery.noise, battery.sensor)
    return with_full_at(battery, float(rule.soc_at(limit_V)))


def with_full_at(battery: Battery, soc: float) -> Battery:
    """The battery whose full end is at this SoC of its curve.

    Its curve may be stretched as a whole or at its upper end alone, so that half of what is missing joins the error of
    the axis, and that of a label.
    """
    model, noise, half = thevenin_of(battery), battery.noise, 0.5 * (1.0 - soc)
    knowledge, capacity_Ah = battery.knowledge, battery.capacity_Ah * (1.0 - half)
    if knowledge is not None:
        capacity_Ah = battery.capacity_Ah * soc
        knowledge = replace(knowledge, seen_from_soc=min(knowledge.seen_from_soc / soc, 1.0))
    stretched = replace(model, ocv=_stretched(model.ocv, soc), capacity_Ah=capacity_Ah)
    wider = replace(
        noise,
        soc_axis_std=math.hypot(noise.soc_axis_std, half),
        capacity_std=math.hypot(noise.capacity_std, half),
    )
    return replace(
        battery,
        capacity_Ah=capacity_Ah,
        thevenin=stretched,
        rc=None if battery.rc is None else rc_of_thevenin(stretched),
        noise=wider,
        rc_noise=replace(battery.rc_noise, capacity_std=wider.capacity_std),
        knowledge=knowledge,
    )


def limit_sentence(before: Battery, after: Battery) -> str:
    """Sentence on a full end that was moved, for people; "" for one that stays."""
    if after is before:
        return ""
    full_V = thevenin_of(after).ocv.voltage_V[-1]
    return f"full is where its charger stops, at {full_V:.3g} V at rest; "


def _was_full(knowledge: Knowledge | None) -> bool:
    """True where something else than the voltage has told the charge in a log."""
    return knowledge is not None and any(log.anchors for log in knowledge.logs)


def _stretched(ocv: OcvCurve, full_soc: float) -> OcvCurve:
    """The curve from 0 to this SoC as one from 0 to 1."""
    soc = full_soc * np.linspace(0.0, 1.0, max(len(ocv.voltage_V), _POINTS))
    degC = ocv.reference_degC
    voltage_V = np.asarray(ocv.mean_V(soc, degC))
    return OcvCurve(
        tuple(np.maximum.accumulate(voltage_V).tolist()),
        tuple(np.asarray(ocv.hysteresis_at(soc)).tolist()),
        tuple((np.asarray(ocv.mean_V(soc, degC + 1.0)) - voltage_V).tolist()),
        degC,
        ocv.interpolation,
    )
