"""`ohmward simulate --cell`: the log of a test or a day of a porous-electrode cell."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from functools import partial
from typing import Any

from ohmward.battery.models.temperature import ROOM_DEGC
from ohmward.cli.outcome import Outcome, check_output
from ohmward.cli.wording import fields, paragraphs
from ohmward.errors import InputError
from ohmward.figures.battery import current_figure, temperature_figure, voltage_figure
from ohmward.figures.numbers import percent
from ohmward.logs import Log, write_log
from ohmward.logs.write import TABLES
from ohmward.report import TIME, Figure, Page, Series
from ohmward.runs import duration
from ohmward_lab.simulate.electrochemical import ElectrochemicalCell, aged, capacity_Ah, record_cell, usual_model


def run(args: argparse.Namespace) -> Outcome:
    """Simulate, write the log and report."""
    check_output("--output", args.output, TABLES)
    if args.scenario is not None:
        raise InputError(f"name a scenario ({args.scenario}) or --cell {args.cell}, not both")
    record = args.record or "day"
    new = ElectrochemicalCell(args.cell, args.model or usual_model(args.cell), args.n_series or 1)
    new_Ah = capacity_Ah(new)
    cell = aged(new, 1.0 if args.aged_to is None else args.aged_to, args.resistance or 1.0)
    degC = ROOM_DEGC if args.ambient_degc is None else args.ambient_degc
    seed = {} if args.seed is None else {"seed": args.seed}
    log = record_cell(cell, record, degC, new_Ah=new_Ah, **seed)
    if args.output:
        write_log(log, args.output)
    figures = {"command": "simulate", **summary(cell, log), "record": record, "capacity_new_Ah": new_Ah}
    figures |= {"output": args.output, "report": args.report}
    return Outcome(figures, describe(figures), (), partial(make_page, log, figures))


def summary(cell: ElectrochemicalCell, log: Log) -> dict[str, Any]:
    """The figures of a cell and of its log, which has the column `soc_true`."""
    soc, temperature_degC = log.extra["soc_true"], log.temperature_degC
    assert temperature_degC is not None
    return {
        "cell": cell.parameter_set,
        "model": cell.model,
        "n_series": cell.n_series,
        "capacity_Ah": capacity_Ah(cell),
        "resistance_ratio": cell.resistance_ratio,
        "duration_s": log.duration_s,
        "samples": len(log),
        "soc_initial": float(soc[0]),
        "soc_final": float(soc[-1]),
        "voltage_min_V": float(log.voltage_V.min()),
        "voltage_max_V": float(log.voltage_V.max()),
        "temperature_min_degC": float(temperature_degC.min()),
        "temperature_max_degC": float(temperature_degC.max()),
        "notes": [str(note) for note in log.notes],
    }


def describe(found: Mapping[str, Any]) -> str:
    """Text for people."""
    output, then = found["output"], ""
    if output and found["record"] == "day":
        then = f"next: ohmward soc {output} --battery FILE.toml --initial-soc 1 --truth soc_true"
    elif output:
        then = f"next: ohmward identify {output} --capacity-ah {found['capacity_new_Ah']:.3g}"
        then += f" --n-series {found['n_series']}" if found["n_series"] > 1 else ""
    title = f"{found['cell']}, {found['model']}: {found['record']}"
    return paragraphs(title, fields(result(found)), then)


def result(found: Mapping[str, Any]) -> dict[str, str]:
    """The key figures with their units, by name."""
    age = found["capacity_Ah"] / found["capacity_new_Ah"]
    low, high = found["temperature_min_degC"], found["temperature_max_degC"]
    return {
        "duration": f"{duration(found['duration_s'])}, {found['samples']:,} samples",
        "capacity": f"{found['capacity_Ah']:.4g} Ah" + (f", {percent(age, 0)} of a new cell's" if age < 1 else ""),
        "state of charge": f"{percent(found['soc_initial'])} to {percent(found['soc_final'])}",
        "voltage": f"{found['voltage_min_V']:.3f} to {found['voltage_max_V']:.3f} V",
        "temperature": f"{low:.1f} to {high:.1f} degC",
    }


def make_page(log: Log, figures: Mapping[str, Any]) -> Page:
    """Key figures; voltage, current, temperature and the true state of charge on a common time axis."""
    truth = Figure(
        "State of charge", TIME, "State of charge [%]", [Series(log.time_s, 100 * log.extra["soc_true"], "true")]
    )
    what = f"{figures['record']} of {figures['cell']}, model {figures['model']}, simulated with PyBaMM"
    page = Page(log.name, what).numbers(result(figures))
    return page.plot(truth, voltage_figure(log), current_figure(log), temperature_figure(log))
