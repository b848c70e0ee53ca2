"""Filters of [T] chapter 3 along a measured log, beside the results on the simulated pack."""

from __future__ import annotations

from functools import partial

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.models.rc import rc_of_thevenin
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.figures.battery import current_figure, voltage_figure
from ohmward.logs.log import Log
from ohmward.report import TIME, Figure, Series
from ohmward_lab.published.scheme_by_method import METHODS, SchemeByMethodEstimate
from ohmward_lab.reproduce.row import Errors, Item, Result, ResultRow, error_rows, errors
from ohmward_lab.reproduce.thesis_battery import SOC_PERCENT, START_STD, VOLTAGE_V, run_along

_WHY = (
    "another battery and another drive than those printed; the state of charge is compared with the count of the log's "
    "own current from the given start, as in [T]"
)


def measured_item(log: Log, battery: Battery, start_soc: float) -> Item:
    """Voltage and state of charge by the four filters along this log, from this start."""
    return Item(("measured",), f"{battery.name} along {log.name}", partial(measured, log, battery, start_soc))


def measured(log: Log, battery: Battery, start_soc: float, why: str = _WHY) -> Result:
    """Rows as in tables 3.2 and 3.3; voltage errors are those before the sample.

    why: reason of the difference from the printed numbers.
    """
    model = rc_of_thevenin(battery.thevenin)
    counted = start_soc + log.charge_Ah() / battery.capacity_Ah
    there = np.isfinite(log.voltage_V) & (log.voltage_V > 0.0)
    if missing := int(np.sum(~there)):
        why += (
            f"; {missing} of {len(log)} samples have no voltage: the filters predict over them, and the errors leave "
            "them out"
        )
    default = SocEstimator(battery, initial_soc=start_soc, initial_soc_std=START_STD).run(log)
    default_V = errors((log.voltage_V - default.voltage_V)[there & np.isfinite(default.voltage_V)])
    default_soc = errors(100.0 * (default.soc - counted)[there])

    def soc_error(found: SchemeByMethodEstimate) -> Errors:
        return errors(100.0 * (found.soc.soc - counted)[there])

    rows: list[ResultRow] = []
    lines = []
    for method in METHODS:
        printed, corrected = (run_along(log, model, method, form, start_soc) for form in (False, True))
        name = method.upper()
        voltage = (errors(printed.joint.innovation_V[there]), errors(corrected.joint.innovation_V[there]), default_V)
        rows += error_rows(f"Voltage before the sample, {name}", "V", VOLTAGE_V[method], *voltage)
        soc = (soc_error(printed), soc_error(corrected), default_soc)
        rows += error_rows(f"SoC, {name}", "%", SOC_PERCENT[method], *soc)
        lines.append(Series(log.time_s, 1e3 * corrected.joint.innovation_V, name))
    rows[0] = rows[0]._replace(why=why)
    drawn = Figure("Voltage error before the sample", TIME, "Error [mV]", lines)
    return Result(tuple(rows), (current_figure(log), voltage_figure(log), drawn))
