"""Figures of `ohmward soc`, for programs, for people and along the log."""

from __future__ import annotations

import textwrap
from typing import Any

import numpy as np

from ohmward.battery.cells.pack_estimator import PackRun
from ohmward.battery.soc.estimator import SocRun
from ohmward.battery.soc.registry import title_of
from ohmward.battery.soc.sample import STD_OF
from ohmward.battery.soc.score import rejected_voltages, soc_scores, voltage_score
from ohmward.cli import wording
from ohmward.cli.battery_inputs import SocTask
from ohmward.cli.soc.anchors import anchor_list, anchor_text
from ohmward.cli.soc.cells import (
    cell_columns,
    cells_sentence,
    cells_summary,
    cells_text,
    unseen_result,
    unseen_summary,
)
from ohmward.filters.consistency import BAND_95
from ohmward.logs.note import counted

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
