"""`ohmward soc`: state of charge along a log, with its uncertainty, and its errors where there is a truth."""

from __future__ import annotations

import argparse
import textwrap
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.cells.drift import ranges
from ohmward.battery.cells.pack_estimator import PackRun, estimate_at
from ohmward.battery.cells.weakest import unseen_weakest
from ohmward.battery.soc.anchors import find_anchors
from ohmward.battery.soc.estimator import SocRun
from ohmward.battery.soc.fit_check import misfits
from ohmward.battery.soc.registry import chosen_name, title_of
from ohmward.battery.soc.sample import STD_OF, SocEstimate
from ohmward.battery.soc.score import rejected_voltages, soc_scores, voltage_score
from ohmward.cli import wording
from ohmward.cli.battery_inputs import SocTask, estimate, estimate_cells, make_soc_task
from ohmward.cli.outcome import Outcome, check_output
from ohmward.cli.progress import counting, progress
from ohmward.cli.wording import FOOTER, duration, normal, percent, quantity, sentence, with_assumptions
from ohmward.figures import battery as pictures
from ohmward.figures.cells import cells_difference_figure, cells_soc_figure
from ohmward.figures.parts import wall_clock
from ohmward.filters.consistency import BAND_95
from ohmward.logs import write_table
from ohmward.logs.note import counted
from ohmward.logs.write import TABLES
from ohmward.report import Figure, Page, WallClock


def run(args: argparse.Namespace) -> Outcome:
    """Estimate, compare with the truth, write the estimates; the exit status is 1 if the battery file does not fit."""
    check_output("--output", args.output, TABLES, [args.log, args.battery])
    with progress() as report:
        task = make_soc_task(args, report)
        name = chosen_name(args.filter.lower(), task.battery)
        cells = estimate_cells(task, name, args, report)
        answer = cells.soc_run if cells else estimate(task, name, args, report)
        if args.output:
            writing = counting(report, f"writing {Path(args.output).name}")
            write_table(estimate_table(task, answer, cells), args.output, writing)
    if cells:
        task = task._replace(log=cells.log)
    wrong = misfits(task.battery, task.log, answer.settings, answer.estimates)
    task = task._replace(log=task.log.with_notes(*wrong))
    figures = summary(task, name, answer, cells) | {"fits": not wrong}
    page = partial(make_page, task, name, (answer, cells), figures)
    written = {"output": args.output, "report": args.report}
    return Outcome(figures | written, describe(task, figures), task.notes, page, status=int(bool(wrong)))


#: Columns of the causes of the band's width, and how to read them.
CAUSE_HEADER = ("Cause", "Part of the band [points]", "Band if it were known [± points]", "Narrowed by")
SQUARES = "the squares of the parts add up to that of the band"

#: Quantities that a filter learns beside SoC, and their standard deviations, as an estimate names them.
LEARNT = tuple(name for pair in STD_OF.items() for name in pair if not name.startswith("soc"))


def summary(task: SocTask, name: str, answer: SocRun, cells: PackRun | None = None) -> dict[str, Any]:
    """The object of --json, but for `fits`."""
    log, estimates = task.log, answer.estimates
    voltage = voltage_score(log, estimates)
    explanation = answer.explain()
    return {
        "command": "soc",
        "log": log.name,
        "battery": task.battery.name,
        "filter": name,
        "steps": len(log),
        "seconds": answer.seconds,
        "duration_s": log.duration_s,
        "soc_initial": float(estimates.soc[0]),
        "soc_final": float(estimates.soc[-1]),
        "soc_std_final": float(estimates.soc_std[-1]),
        "explanation": explanation.as_dict(),
        "soc_min": float(estimates.soc.min()),
        "soc_max": float(estimates.soc.max()),
        "voltage_rmse_V": voltage.rmse if voltage else None,
        "rejected_voltages": int(np.count_nonzero(rejected_voltages(log, estimates))),
        **{name: float(getattr(estimates, name)[-1]) for name in LEARNT},
        "anchors": anchor_list(task, answer),
        "cells": cells_summary(cells) if cells else None,
        "weakest_unseen": None if cells else unseen_summary(task.battery, estimates),
        "flags": answer.counts(),
        **soc_scores(log, estimates, task.truth.soc if task.truth else None),
        "truth": task.truth.note if task.truth else None,
        "notes": task.notes,
    }


def describe(task: SocTask, figures: dict[str, Any]) -> str:
    """Text for people."""
    title = f"{figures['log']} with battery {figures['battery']!r}\n{figures['filter']}: "
    return wording.paragraphs(
        title + title_of(figures["filter"]),
        textwrap.fill(headline(figures), wording.WIDTH),
        wording.fields(result(figures)),
        anchor_text(figures),
        cells_text(figures),
        causes(figures),
        errors(figures) if task.truth else "",
        wording.assumptions(task.notes),
    )


def headline(figures: dict[str, Any]) -> str:
    """State of charge in a sentence, that of the pack first where the log has its cells."""
    doubt = "" if figures["fits"] else "The battery file does not fit this log, do not trust the estimate. "
    return doubt + cells_sentence(figures) + wording.sentence(figures["explanation"]["sentence"])


def result(figures: dict[str, Any]) -> dict[str, str]:
    """The key figures of a run with their units, by name."""
    band = wording.percent(BAND_95 * figures["soc_std_final"], 1)
    offset = wording.normal(learnt(figures, "current_offset_A"), "mA", 1e3)
    capacity = wording.normal(learnt(figures, "soh_capacity"), "%", 100)
    resistance = wording.lognormal(learnt(figures, "resistance_ratio"), "%", 100)
    rows = {
        "SoC at the end": f"{wording.percent(figures['soc_final'], 1)} ± {band} (95 %)",
        "SoC before": f"started at {wording.percent(figures['soc_initial'], 1)}, "
        f"ran from {wording.percent(figures['soc_min'], 1)} to {wording.percent(figures['soc_max'], 1)}",
        **unseen_result(figures),
        "voltage error": wording.quantity(figures["voltage_rmse_V"], "mV RMS", 1e3) + without_rejected(figures),
        "current offset": f"{offset} (95 %)",
        "capacity": f"{capacity} of the battery file's (95 %)",
        "resistance": f"{resistance} of the battery file's (95 %)",
        "flagged samples": wording.flagged(figures["flags"]),
        "steps": f"{figures['steps']:,} in {figures['seconds']:.2g} s",
    }
    return {name: value for name, value in rows.items() if value.split()[0] != "-"}


def without_rejected(figures: dict[str, Any]) -> str:
    """Number of the voltages that the filter did not believe and the voltage error leaves out; "" for none."""
    return (
        f", without {counted(figures['rejected_voltages'], 'rejected voltage')}" if figures["rejected_voltages"] else ""
    )


def learnt(figures: dict[str, Any], name: str) -> dict[str, float]:
    """Mean and standard deviation of a quantity of `LEARNT` at the end."""
    return {"mean": figures[name], "std": figures[STD_OF[name]]}


def causes(figures: dict[str, Any]) -> str:
    """The causes of the band's width, the largest first; nothing where the filter does not say."""
    lines = [f"{points} points: {text} -> {remedy}" for text, points, _, remedy in cause_rows(figures)]
    return wording.bullets(f"What makes the band wide, and what would narrow it ({SQUARES})", lines)


def cause_rows(figures: dict[str, Any]) -> list[list[str]]:
    """Cause, its points, the band without it, and what would narrow it."""
    return [
        [cause["text"], f"{cause['points']:.1f}", f"{cause['points_without']:.1f}", cause["remedy"]]
        for cause in figures["explanation"]["causes"]
    ]


def errors(figures: dict[str, Any]) -> str:
    """Errors against the truth as a table."""
    rows = [
        [title, *(wording.percent(figures[key + suffix]) for suffix in ("", "_after_1h"))]
        for title, key in (
            ("root mean square error", "soc_rmse"),
            ("mean absolute error", "soc_mae"),
            ("largest error", "soc_max_error"),
            ("truth inside the 95 % band", "coverage_95"),
        )
    ]
    return wording.table(["against the truth", "whole log", "after 1 h"], rows)


def estimate_table(task: SocTask, answer: SocRun, cells: PackRun | None = None) -> dict[str, np.ndarray]:
    """Columns (T,) of the estimates file, by name."""
    log, e = task.log, answer.estimates
    clock = {} if log.start_unix_s is None else {"unix_time_s": log.start_unix_s + log.time_s}
    columns = {
        "time_s": log.time_s,
        **clock,
        "current_A": log.current_A,
        "voltage_V": log.voltage_V,
        "soc": e.soc,
        "soc_std": e.soc_std,
        "voltage_expected_V": e.voltage_V,
        "voltage_expected_std_V": e.voltage_std_V,
        "innovation_V": e.innovation_V,
        **{name: getattr(e, name) for name in LEARNT},
        "flags": e.flags.astype(int),
    }
    columns |= cell_columns(cells) if cells else {}
    return columns | ({"soc_truth": task.truth.soc} if task.truth else {})


TITLE = "Events that tell the state of charge"
ANCHOR_HEADER = ("Event", "After", "Told by", "It tells", "Estimate before it")
#: Kinds that a filter may use.
_USABLE = ("full charge", "empty")


def anchor_list(task: SocTask, answer: SocRun) -> list[dict[str, Any]]:
    """The list `anchors` of --json; nothing for a battery file without a Thevenin model.

    The estimate is that before the event, or before the filter used it: it sees a full charge while it tapers.
    """
    if task.battery.thevenin is None:
        return []
    used = np.flatnonzero(answer.flags.astype(np.int32) & np.int32(answer.flag_type["ANCHORED"]))
    before = -1
    found = []
    for anchor in find_anchors(task.log, task.battery):
        seen = used[(used > before) & (used <= anchor.sample)] if anchor.kind in _USABLE else used[:0]
        k = max(int(seen[-1] if seen.size else anchor.sample) - 1, 0)
        found.append(
            anchor._asdict()
            | {"soc": float(anchor.soc), "soc_std": float(anchor.soc_std), "used": bool(seen.size)}
            | {"soc_estimated": float(answer.soc[k]), "soc_std_estimated": float(answer.soc_std[k])}
        )
        before = anchor.sample
    return found


def anchor_rows(figures: dict[str, Any]) -> list[list[str]]:
    """Event, its time, what tells it, its state of charge and the one that was estimated."""
    return [
        [
            anchor["kind"],
            wording.duration(anchor["time_s"]),
            anchor["told_by"] + (", used" if anchor["used"] else ""),
            _band_percent(anchor["soc"], anchor["soc_std"]),
            _band_percent(anchor["soc_estimated"], anchor["soc_std_estimated"]),
        ]
        for anchor in figures["anchors"]
    ]


def anchor_text(figures: dict[str, Any]) -> str:
    """The same as lines of text; nothing without an anchor."""
    lines = [
        f"{kind} after {after} ({by}): {tells}, estimated {estimated}"
        for kind, after, by, tells, estimated in anchor_rows(figures)
    ]
    return wording.bullets(TITLE, lines)


def _band_percent(soc: float, std: float) -> str:
    return f"{wording.percent(soc, 1)} ± {wording.percent(BAND_95 * std, 1)}"


CELL_HEADER = ("Cell", "SoC [%]", "minus typical [points]", "Capacity over typical [%]", "Resistance over typical [%]")


def cells_summary(run: PackRun) -> dict[str, Any]:
    """The object `cells` of --json: at the end of the log."""
    now = estimate_at(run.estimates, -1)
    pack, cells = now.pack, now.cells
    names = run.names
    fields = [name for name in cells._fields if name != "flags"]
    return {
        "weakest": names[int(pack.weakest)],
        **{name: float(value) for name, value in pack._asdict().items() if name != "weakest"},
        "ranges": {name: {"value": value, "std": std} for name, (value, std) in ranges(cells).items()},
        "warnings": [warning._asdict() | {"cell": names[warning.cell]} for warning in run.warnings()],
        "first_warning_s": run.first_warning_s(),
        "cells": [
            {"name": name, **{field: float(getattr(cells, field)[k]) for field in fields}}
            for k, name in enumerate(names)
        ],
    }


def cells_result(figures: dict[str, Any]) -> dict[str, str]:
    """The key figures of the pack with their units, by name."""
    cells = figures["cells"]
    ranges_ = cells["ranges"]
    return {
        "weakest cell": f"{cells['weakest']}, {_band(cells['weakest_soc'], cells['weakest_soc_std'])} % (95 %)",
        "usable charge": f"{cells['usable_Ah']:.3g} ± {BAND_95 * cells['usable_std_Ah']:.2g} Ah, until that cell is "
        "empty",
        "pack": f"{_band(cells['soc'], cells['soc_std'])} % of {cells['capacity_Ah']:.3g} Ah between the ends that its "
        "cells set",
        "cells differ": ", ".join(
            f"{name} by {_band(found['value'], found['std'])} {'points' if name == 'SoC' else '%'}"
            for name, found in ranges_.items()
        ),
    }


def unseen_summary(battery: Battery, estimates: SocEstimate) -> dict[str, float] | None:
    """The object `weakest_unseen` of --json, of a pack whose cells the log does not have: at the end of the log."""
    if battery.n_series < 2:
        return None
    expected = unseen_weakest(float(estimates.soc[-1]), float(estimates.soc_std[-1]), int(battery.n_series))
    return {"soc": float(expected.mean), "soc_std": float(expected.std)}


def unseen_result(figures: dict[str, Any]) -> dict[str, str]:
    """The weakest cell where it was not measured; nothing for a single cell."""
    found = figures["weakest_unseen"]
    return {"weakest cell": f"not measured; probably {_band(found['soc'], found['soc_std'])} %"} if found else {}


def cells_sentence(figures: dict[str, Any]) -> str:
    """SoC of the pack and its weakest cell in one sentence; nothing for a log without cells."""
    if not figures["cells"]:
        return ""
    cells = figures["cells"]
    pack = _band(cells["soc"], cells["soc_std"])
    return f"Pack {pack} %: {cells['weakest']} will be empty first. Typical cell: "


def cells_text(figures: dict[str, Any]) -> str:
    """The cells for people; nothing for a log without them."""
    if not figures["cells"]:
        return ""
    warnings = [warning["text"] for warning in figures["cells"]["warnings"]]
    return wording.paragraphs(
        "Cells\n" + wording.fields(cells_result(figures)),
        wording.table(CELL_HEADER, cell_rows(figures)),
        wording.bullets("Cells that drift apart from the others", warnings),
    )


def cell_rows(figures: dict[str, Any]) -> list[list[str]]:
    """One row for each cell, with the half widths of its 95 % bands."""
    return [
        [
            cell["name"],
            _band(cell["soc"], cell["soc_std"]),
            _band(cell["soc_difference"], cell["soc_difference_std"]),
            _band(cell["capacity_ratio"], cell["capacity_ratio_std"]),
            _band(cell["resistance_ratio"], cell["resistance_ratio_std"]),
        ]
        for cell in figures["cells"]["cells"]
    ]


def cell_columns(run: PackRun) -> dict[str, np.ndarray]:
    """Columns (T,) of the estimates file, by name; the number of the weakest cell counts from 1."""
    pack = {f"pack_{name}": values for name, values in run.pack._asdict().items() if not name.startswith("weakest")}
    weakest = {
        "weakest_cell": run.pack.weakest + 1,
        "weakest_soc": run.pack.weakest_soc,
        "weakest_soc_std": run.pack.weakest_soc_std,
    }
    each = {
        f"cell_{k + 1}_{name}": getattr(run.cells, name)[:, k]
        for k in range(len(run.names))
        for name in ("soc", "soc_std", "capacity_ratio", "resistance_ratio")
    }
    return pack | weakest | each


def _band(share: float, std: float) -> str:
    return f"{100 * share:.1f} ± {100 * BAND_95 * std:.1f}"


def make_page(task: SocTask, name: str, answers: tuple[SocRun, PackRun | None], figures: dict[str, Any]) -> Page:
    """Key figures, plots above each other on one clock, assumptions.

    answers: of the battery, and of its cells where the log has them.
    figures: the summary of the run.
    """
    answer, cells = answers
    what = f"State of charge by {name}, battery {task.battery.name!r}, {duration(task.log.duration_s)}"
    explanation = figures["explanation"]
    page = Page(task.log.name, what, FOOTER)
    page = page.callout("info" if explanation["known"] and figures["fits"] else "warning", headline(figures))
    page = page.numbers(_numbers(figures)).plot(*_plots(task, answer), clock=wall_clock(task.log))
    if figures["anchors"]:
        page = page.heading(TITLE).table(ANCHOR_HEADER, anchor_rows(figures))
    if cells:
        page = _cells(page, cells, figures, wall_clock(task.log))
    if explanation["causes"]:
        page = page.heading("What makes the band wide").table(CAUSE_HEADER, cause_rows(figures), sentence(SQUARES))
    page = page.heading("Result").table(["Quantity", "Value"], list(result(figures).items()))
    return with_assumptions(page, task.notes)


def _cells(page: Page, cells: PackRun, figures: dict[str, Any], clock: WallClock | None) -> Page:
    """The page with the section on the cells of the pack."""
    page = page.heading("Cells")
    for warning in figures["cells"]["warnings"]:
        page = page.callout("warning", f"{warning['text']}.")
    page = page.table(["Quantity", "Value"], list(cells_result(figures).items()))
    page = page.plot(cells_soc_figure(cells), cells_difference_figure(cells), clock=clock)
    return page.table(CELL_HEADER, cell_rows(figures), "Half widths are those of the 95 % bands.")


def _numbers(figures: dict) -> dict[str, str]:
    half_band = BAND_95 * figures["soc_std_final"]
    numbers = {
        "SoC at the end": f"{100 * figures['soc_final']:.1f} ± {percent(half_band, 1)}",
        "RMSE": percent(figures["soc_rmse"]),
        "RMSE after 1 h": percent(figures["soc_rmse_after_1h"]),
        "Largest error": percent(figures["soc_max_error"]),
        "Truth in 95 % band": percent(figures["coverage_95"], 1),
        "Voltage error, RMS": quantity(figures["voltage_rmse_V"], "mV", 1e3),
        "Current offset": normal(learnt(figures, "current_offset_A"), "mA", 1e3),
    }
    return {label: value for label, value in numbers.items() if value != "-"}


def _plots(task: SocTask, answer: SocRun) -> list[Figure]:
    log, estimates = task.log, answer.estimates
    truth = task.truth.soc if task.truth else None
    plots = [pictures.soc_figure(log, estimates, truth)]
    if truth is not None:
        plots.append(pictures.soc_error_figure(log, estimates, truth))
    plots.append(pictures.current_figure(log, pictures.soc_flag_spans(log, estimates.flags)))
    plots.append(pictures.voltage_figure(log, estimates))
    plots += pictures.further_figures(log)
    if _any(estimates.voltage_V):
        plots.append(pictures.voltage_error_figure(log, estimates))
    if _any(estimates.current_offset_A):
        plots += [pictures.offset_figure(log, estimates), pictures.health_figure(log, estimates)]
    return plots


def _any(values) -> bool:
    return bool((values == values).any())
