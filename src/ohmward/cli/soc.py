"""`ohmward soc`: state of charge along a log, with its uncertainty, and its errors where there is a truth."""

from __future__ import annotations

import argparse
import textwrap
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ohmward.battery.cells.drift import expected_weakest
from ohmward.battery.cells.pack_estimator import PackRun
from ohmward.battery.soc.anchors import find_anchors, judged_anchors
from ohmward.battery.soc.estimator import SocRun
from ohmward.battery.soc.fit_check import DO_NOT_TRUST, misfits
from ohmward.battery.soc.registry import chosen_name, title_of
from ohmward.battery.soc.sample import LEARNT, LEARNT_FIELDS, STD_OF
from ohmward.battery.soc.score import rejected_voltages, soc_figures, soc_scores
from ohmward.cli.battery_inputs import SocTask, make_soc_task
from ohmward.cli.outcome import Outcome, check_results, counting, progress
from ohmward.cli.wording import bullets, fields, known_rows, paragraphs, sentence, styled, table, width
from ohmward.figures import battery as pictures
from ohmward.figures.numbers import band, flagged, lognormal, normal, percent, percent_band, quantity
from ohmward.figures.parts import wall_clock
from ohmward.filters.consistency import BAND_95
from ohmward.logs import write_table
from ohmward.logs.table import counted
from ohmward.logs.write import TABLES
from ohmward.memory import reuse_freed
from ohmward.report import Figure, Page
from ohmward.runs import duration

_CAUSES = ("Cause", "Part of the band [points]", "Band if it were known [± points]", "Narrowed by")
#: How to read the causes of the band's width.
_SQUARES = "the squares of the parts add up to that of the band"
_ANCHORS = "Events that fix the state of charge"
_CELLS = ("Cell", "SoC [%]", "minus typical [points]", "Capacity over typical [%]", "Resistance over typical [%]")


def run(args: argparse.Namespace) -> Outcome:
    """Estimate, compare with the truth, write the estimates; the exit status is 1 if the battery file does not fit."""
    check_results(args.output, TABLES, [args.log, args.battery], "soc_std")
    reuse_freed()
    with progress() as report:
        task = make_soc_task(args, report)
        name = chosen_name(args.filter.lower())
        cells = task.estimate_cells(name, report)
        learnt_along = bool(args.output or args.report)
        answer = cells.soc_run if cells else task.estimate(name, report, learnt_along)
        if args.output:
            writing = counting(report, f"writing {Path(args.output).name}")
            write_table(estimate_table(task, answer, cells), args.output, writing)
    if cells:
        task = task._replace(log=cells.log, anchors=None)
    wrong = misfits(task.battery, task.log, answer.settings, answer.estimates)
    task = task._replace(log=task.log.with_notes(*wrong, *answer.exchanges))
    figures = summary(task, name, answer, cells) | {"fits": not wrong, "output": args.output, "report": args.report}
    page = partial(make_page, task, answer, cells, figures)
    return Outcome(figures, describe(figures), task.notes, page, status=int(bool(wrong)))


def summary(task: SocTask, name: str, answer: SocRun, cells: PackRun | None) -> dict[str, Any]:
    """The object of --json, but for `fits` and the files."""
    log, estimates = task.log, answer.estimates
    anchors = find_anchors(log, task.battery) if task.anchors is None else task.anchors
    figures = soc_figures(log, estimates)
    weakest = None
    if cells is None and task.battery.n_series > 1:
        expected = expected_weakest(figures["soc_final"], figures["soc_std_final"], int(task.battery.n_series))
        weakest = {"soc": float(expected.mean), "soc_std": float(expected.std)}
    return {
        "command": "soc",
        "log": log.name,
        "battery": task.battery.name,
        "filter": name,
        "steps": len(log),
        "seconds": answer.seconds,
        "duration_s": log.duration_s,
        **figures,
        **{STD_OF[mean]: float(getattr(estimates, STD_OF[mean])[-1]) for mean in LEARNT},
        "rejected_voltages": len(rejected_voltages(log, estimates)),
        "explanation": answer.explain().as_dict(),
        "anchors": [anchor.as_dict() for anchor in judged_anchors(anchors, answer)],
        "cells": cells.figures() if cells else None,
        "weakest_expected": weakest,
        "flags": answer.counts(),
        **soc_scores(log, estimates, task.truth.soc if task.truth else None),
        "truth": task.truth.note if task.truth else None,
        "notes": task.notes,
    }


def estimate_table(task: SocTask, answer: SocRun, cells: PackRun | None) -> dict[str, np.ndarray]:
    """Columns (T,) of the estimates file, by name."""
    log, e = task.log, answer.estimates
    clock = {} if log.start_unix_s is None else {"unix_time_s": log.start_unix_s + log.time_s}
    return {
        "time_s": log.time_s,
        **clock,
        "current_A": log.current_A,
        "voltage_V": log.voltage_V,
        "soc": e.soc,
        "soc_std": e.soc_std,
        "voltage_expected_V": e.voltage_V,
        "voltage_expected_std_V": e.voltage_std_V,
        "innovation_V": e.innovation_V,
        **{name: getattr(e, name) for name in LEARNT_FIELDS},
        "flags": e.flags.astype(int),
        **(cells.columns() if cells else {}),
        **({"soc_truth": task.truth.soc} if task.truth else {}),
    }


def describe(f: Mapping[str, Any]) -> str:
    """Text for people.

    f: the summary of the run, here and in all functions below.
    """
    causes = [f"{points} points: {text} -> {remedy}" for text, points, _, remedy in cause_rows(f)]
    anchors = [
        f"{kind} after {after} ({by}): {given}, estimated {estimated}"
        for kind, after, by, given, estimated in anchor_rows(f)
    ]
    cells = f["cells"]
    drifting = [warning["text"] for warning in cells["warnings"]] if cells else []
    return paragraphs(
        f"{f['log']} with battery {f['battery']!r}\n{f['filter']}: {title_of(f['filter'])}",
        styled(textwrap.fill(headline(f), width())),
        fields(result(f)),
        bullets(_ANCHORS, anchors),
        f"Cells\n{fields(pack_rows(cells))}" if cells else "",
        table(_CELLS, cell_rows(cells)) if cells else "",
        bullets("Cells that drift apart from the others", drifting),
        bullets(f"What makes the band wide, and what would narrow it ({_SQUARES})", causes),
        table(["against the truth", "whole log", "after 1 h"], error_rows(f)) if f["truth"] else "",
    )


def headline(f: Mapping[str, Any]) -> str:
    """State of charge in a sentence, the pack's first if the log has its cells."""
    caveat = "" if f["fits"] else f"{DO_NOT_TRUST} "
    if cells := f["cells"]:
        pack = band(cells["soc"], cells["soc_std"])
        caveat += f"Pack {pack} %: {cells['weakest']} will be empty first. Typical cell: "
    return caveat + sentence(f["explanation"]["sentence"])


def result(f: Mapping[str, Any]) -> dict[str, str]:
    """The key figures of a run with their units, by name."""
    start, low, high = (percent(f[name], 1) for name in ("soc_initial", "soc_min", "soc_max"))
    weakest, rejected = f["weakest_expected"], f["rejected_voltages"]
    rows = {
        "SoC at the end": f"{percent_band(f['soc_final'], f['soc_std_final'])} (95 %)",
        "SoC before": f"started at {start}, ran from {low} to {high}",
        "weakest cell": f"not measured; probably {band(weakest['soc'], weakest['soc_std'])} %" if weakest else "",
        "voltage error": quantity(f["voltage_rmse_V"], "mV RMS", 1e3)
        + (f", without {counted(rejected, 'rejected voltage')}" if rejected else ""),
        "current offset": f"{normal(learnt(f, 'current_offset_A'), 'mA', 1e3)} (95 %)",
        "capacity": f"{normal(learnt(f, 'soh_capacity'), '%', 100)} of the battery file's (95 %)",
        "resistance": f"{lognormal(learnt(f, 'resistance_ratio'), '%', 100)} of the battery file's (95 %)",
        "flagged samples": flagged(f["flags"]),
        "steps": f"{f['steps']:,} in {f['seconds']:.2g} s",
    }
    return known_rows(rows)


def learnt(f: Mapping[str, Any], name: str) -> dict[str, float]:
    """Mean and standard deviation of a quantity of `LEARNT` at the end."""
    return {"mean": f[name], "std": f[STD_OF[name]]}


def cause_rows(f: Mapping[str, Any]) -> list[list[str]]:
    """The causes of the band's width, the largest first, under `_CAUSES`; empty where the filter gives none."""
    return [
        [cause["text"], f"{cause['points']:.1f}", f"{cause['points_without']:.1f}", cause["remedy"]]
        for cause in f["explanation"]["causes"]
    ]


def error_rows(f: Mapping[str, Any]) -> list[list[str]]:
    """Errors against the truth, over the whole log and after its first hour."""
    names = {
        "root mean square error": "soc_rmse",
        "mean absolute error": "soc_mae",
        "largest error": "soc_max_error",
        "truth inside the 95 % band": "coverage_95",
    }
    return [[title, percent(f[key]), percent(f[f"{key}_after_1h"])] for title, key in names.items()]


def anchor_rows(f: Mapping[str, Any]) -> list[list[str]]:
    """Each event with its time, its source, its state of charge and the one that was estimated."""
    return [
        [
            anchor["kind"],
            duration(anchor["time_s"]),
            anchor["source"] + (", used" if anchor["used"] else ""),
            percent_band(anchor["soc"], anchor["soc_std"]),
            percent_band(anchor["soc_estimated"], anchor["soc_std_estimated"]),
        ]
        for anchor in f["anchors"]
    ]


def pack_rows(cells: Mapping[str, Any]) -> dict[str, str]:
    """The key figures of the pack with their units, by name."""
    ranges = [
        f"{name} by {band(found['value'], found['std'])} {'points' if name == 'SoC' else '%'}"
        for name, found in cells["ranges"].items()
    ]
    return {
        "weakest cell": f"{cells['weakest']}, {band(cells['weakest_soc'], cells['weakest_soc_std'])} % (95 %)",
        "usable charge": f"{cells['usable_Ah']:.3g} ± {BAND_95 * cells['usable_std_Ah']:.2g} Ah, until that cell is "
        "empty",
        "pack": f"{band(cells['soc'], cells['soc_std'])} % of {cells['capacity_Ah']:.3g} Ah between the ends that its "
        "cells set",
        "cells differ": ", ".join(ranges),
    }


def cell_rows(cells: Mapping[str, Any]) -> list[list[str]]:
    """One row for each cell under `_CELLS`, with the half widths of its 95 % bands."""
    names = ("soc", "soc_difference", "capacity_ratio", "resistance_ratio")
    return [[cell["name"], *(band(cell[name], cell[f"{name}_std"]) for name in names)] for cell in cells["cells"]]


def make_page(task: SocTask, answer: SocRun, cells: PackRun | None, f: Mapping[str, Any]) -> Page:
    """Key figures, plots on a common time axis, anchors, cells, causes, assumptions."""
    clock, explanation = wall_clock(task.log), f["explanation"]
    what = f"State of charge by {f['filter']}, battery {task.battery.name!r}, {duration(task.log.duration_s)}"
    page = Page(task.log.name, what)
    page = page.callout("info" if explanation["known"] and f["fits"] else "warning", headline(f))
    numbers = {
        "SoC at the end": f"{100 * f['soc_final']:.1f} ± {percent(BAND_95 * f['soc_std_final'], 1)}",
        "RMSE": percent(f["soc_rmse"]),
        "RMSE after 1 h": percent(f["soc_rmse_after_1h"]),
        "Largest error": percent(f["soc_max_error"]),
        "Truth in 95 % band": percent(f["coverage_95"], 1),
        "Voltage error, RMS": quantity(f["voltage_rmse_V"], "mV", 1e3),
        "Current offset": normal(learnt(f, "current_offset_A"), "mA", 1e3),
    }
    page = page.numbers(known_rows(numbers)).plot(*_plots(task, answer), clock=clock)
    if f["anchors"]:
        header = ("Event", "After", "Source", "State of charge given", "Estimate before it")
        page = page.heading(_ANCHORS).table(header, anchor_rows(f))
    if cells:
        page = page.heading("Cells")
        for warning in f["cells"]["warnings"]:
            page = page.callout("warning", f"{warning['text']}.")
        page = page.table(["Quantity", "Value"], list(pack_rows(f["cells"]).items()))
        page = page.plot(pictures.cells_soc_figure(cells), pictures.cells_difference_figure(cells), clock=clock)
        page = page.table(_CELLS, cell_rows(f["cells"]), "Half widths are those of the 95 % bands.")
    if explanation["causes"]:
        page = page.heading("What makes the band wide").table(_CAUSES, cause_rows(f), sentence(_SQUARES))
    return page.heading("Result").table(["Quantity", "Value"], list(result(f).items()))


def _plots(task: SocTask, answer: SocRun) -> list[Figure]:
    log, estimates = task.log, answer.estimates
    truth = task.truth.soc if task.truth else None
    plots = [pictures.soc_figure(log, estimates, truth)]
    if truth is not None:
        plots.append(pictures.soc_error_figure(log, estimates, truth))
    plots.append(pictures.current_figure(log, pictures.soc_flag_spans(log, estimates.flags)))
    plots.append(pictures.voltage_figure(log, estimates))
    plots += pictures.further_figures(log)
    if not np.isnan(estimates.voltage_V).all():
        plots.append(pictures.voltage_error_figure(log, estimates))
    if not np.isnan(estimates.current_offset_A).all():
        plots += [pictures.offset_figure(log, estimates), pictures.health_figure(log, estimates)]
    return plots
