"""Full end of the curve of a label, where the charger of a battery stops below the limit of its chemistry.

Lithium chargers are set to 4.1 V a cell as well as to 4.2, and a robot calls its battery full where its charger has
tapered. With the SoC z_c of the curve at that voltage,

    OCV'(z) = OCV(z z_c)        Q' = Q (1 + z_c) / 2    of a label, which counts from either limit
                                Q' = Q z_c              where logs have shown the charge along the curve

A file from a test has the full end itself, and so has one that has learnt from a full charge: for them a charger that
stops below it leaves the battery less than full. Where a battery with a label had the lower charger and a later one
holds a higher voltage, the curve of the chemistry goes on from there, z_c > 1, with the standard deviations of a label.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ohmward.battery.battery import Battery, Knowledge
from ohmward.battery.chemistries import chemistry, generic_battery
from ohmward.battery.learning.parameters import parameters_of, prior_covariance
from ohmward.battery.learning.same_battery import forgotten
from ohmward.battery.models.ocv import OCV_POINTS, OcvCurve
from ohmward.battery.models.temperature import ROOM_DEGC
from ohmward.battery.models.thevenin import CircuitInput, Thevenin
from ohmward.battery.soc.anchor_rule import BEYOND_SIGMAS
from ohmward.battery.soc.anchors import VOLTAGE, Anchor, LogAnchors, rule_of, scan_anchors, with_known_full
from ohmward.battery.soc.coulomb import REST_CURRENT_C
from ohmward.logs.log import Log

#: A full end was lowered by more than 7 % of SoC, twice the error of a label's curve there. It is raised by no less
#: than this factor: a full battery at rest lies some 30 mV below its charger.
_LEAST_RAISE = 1.05
#: A voltage counts once so many samples reach it: fewer may be glitches.
_REACHED_BY = 5


def full_at_charger_limit(battery: Battery, log: Log, found: LogAnchors | None = None) -> Battery:
    """The battery that is full where its charger stops in this log; unchanged where its full end is known.

    A charge up to the full end of a label's curve shows that this is full.

    found: in the log by the battery with a known full end, from `scan_anchors`; None scans it.
    """
    if battery.identification is not None or battery.thevenin.gassing_V is not None:
        return battery
    anchored = any(log.anchors for log in battery.learnt_logs)
    was_lowered = anchored and _was_lowered(battery)
    if anchored and not was_lowered and not battery.noise.full_soc_std:
        return battery
    anchors, limit_V = found or scan_anchors(log, battery)[1]
    battery, known = with_charge_seen(battery, log), with_known_full(battery)
    rule, full = rule_of(known), [a for a in anchors if a.kind == "full charge"]
    if full:
        battery = known
    if was_lowered:
        full_V = [float(rule.relaxed_V(a.voltage_V, _input(a))) for a in full if a.source == VOLTAGE]
        return raised_to(battery, max(full_V, default=0.0))
    return battery if anchored or limit_V is None else with_full_at(known, float(rule.soc_at(limit_V)))


def with_charge_seen(battery: Battery, log: Log) -> Battery:
    """The battery whose full end is no farther below that of its curve than this log shows it charged.

    No voltage without a charging current is above that at which the charger stops.
    """
    noise = battery.noise
    not_charging = log.current_A <= REST_CURRENT_C * battery.capacity_Ah
    still_V = log.voltage_V[not_charging & np.isfinite(log.voltage_V)]
    if not noise.full_soc_std or still_V.size < _REACHED_BY:
        return battery
    farthest = 1.0 - float(rule_of(battery).soc_at(np.partition(still_V, -_REACHED_BY)[-_REACHED_BY]))
    return replace(battery, noise=replace(noise, full_soc_std=min(noise.full_soc_std, farthest)))


def raised_to(battery: Battery, full_V: float) -> Battery:
    """The battery that is full at this higher voltage, with the errors of a label; unchanged where it is no higher."""
    before_soc = _soc_of_chemistry(battery, battery.thevenin.ocv.voltage_V[-1])
    longer = _soc_of_chemistry(battery, full_V) / before_soc
    if longer < _LEAST_RAISE:
        return battery
    wide = forgotten(battery)
    model = wide.thevenin
    raised = replace(model, ocv=_prolonged(battery, before_soc, longer), capacity_Ah=model.capacity_Ah * longer)
    changed = _with_model(wide, raised)
    knowledge = Knowledge.of(parameters_of(changed).names, prior_covariance(changed), battery.learnt_logs)
    return replace(changed, knowledge=knowledge)


def with_full_at(battery: Battery, soc: float) -> Battery:
    """The battery whose full end is at this SoC of its curve.

    Its curve may be stretched as a whole or at its upper end alone, so that half of the missing range is added to the
    errors of the axis and of the capacity of a label.
    """
    model, noise, half = battery.thevenin, battery.noise, 0.5 * (1.0 - soc)
    knowledge, capacity_Ah = battery.knowledge, battery.capacity_Ah * (1.0 - half)
    if knowledge is not None:
        capacity_Ah = battery.capacity_Ah * soc
        knowledge = replace(knowledge, seen_from_soc=min(knowledge.seen_from_soc / soc, 1.0))
    inside = soc * np.linspace(0.0, 1.0, max(len(model.ocv.voltage_V), OCV_POINTS))
    voltage_V = np.asarray(model.ocv.mean_V(inside, model.ocv.reference_degC))
    stretched = replace(model, ocv=model.ocv.corrected(voltage_V, soc=inside), capacity_Ah=capacity_Ah)
    wider = replace(
        noise,
        soc_axis_std=math.hypot(noise.soc_axis_std, half),
        capacity_std=math.hypot(noise.capacity_std, half),
    )
    return replace(_with_model(battery, stretched), noise=wider, knowledge=knowledge)


def _with_model(battery: Battery, model: Thevenin) -> Battery:
    """The battery with this circuit and its capacity."""
    return replace(battery, capacity_Ah=model.capacity_Ah, thevenin=model)


def _was_lowered(battery: Battery) -> bool:
    """True where the full end lies below the chemistry's by more than the error of a label; never on a flat curve."""
    if not battery.chemistry:
        return False
    label = generic_battery(battery.chemistry, battery.capacity_Ah, battery.n_series)
    degC = label.thevenin.reference_degC
    still = rule_of(label).at_rest(battery.thevenin.ocv.voltage_V[-1], CircuitInput(0.0, degC))
    return bool(1.0 - still.soc > max(BEYOND_SIGMAS * still.std, 1.0 - 1.0 / _LEAST_RAISE))


def _input(anchor: Anchor) -> CircuitInput:
    degC = anchor.temperature_degC if math.isfinite(anchor.temperature_degC) else ROOM_DEGC
    return CircuitInput(anchor.current_A, degC)


def _soc_of_chemistry(battery: Battery, voltage_V: float) -> float:
    """SoC on the curve of the chemistry at this voltage of the battery."""
    return float(chemistry(battery.chemistry).ocv().soc_at(voltage_V / battery.n_series))


def _prolonged(battery: Battery, before_soc: float, longer: float) -> OcvCurve:
    """The curve of the file up to its full end, and that of the chemistry from there on."""
    ocv = battery.thevenin.ocv
    soc, degC = longer * np.linspace(0.0, 1.0, max(len(ocv.voltage_V), OCV_POINTS)), ocv.reference_degC
    beyond_V = np.asarray(chemistry(battery.chemistry).ocv().mean_V(before_soc * soc, degC)) * battery.n_series
    inside = np.minimum(soc, 1.0)
    voltage_V = np.where(soc > 1.0, np.maximum(beyond_V, ocv.voltage_V[-1]), ocv.mean_V(inside, degC))
    return ocv.corrected(voltage_V, soc=inside)


def limit_sentence(before: Battery, after: Battery) -> str:
    """Sentence on a full end that was moved, for people; "" for one that stays."""
    full_V = after.thevenin.ocv.voltage_V[-1]
    if full_V == before.thevenin.ocv.voltage_V[-1]:
        return ""
    return f"full is where its charger stops, at {full_V:.3g} V at rest; "
