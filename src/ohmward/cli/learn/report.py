"""Report of `ohmward learn`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ohmward.battery.learning.pulse_resistance import PULSE_S
from ohmward.cli.learn.files import BatteryFiles
from ohmward.cli.learn.journal import Row
from ohmward.cli.learn.result import (
    CHANGES,
    LOGS,
    change_rows,
    ending,
    headline,
    learnt,
    log_rows,
    title,
)
from ohmward.cli.report_parts import FOOTER, with_assumptions
from ohmward.cli.wording import lognormal, normal, sentence
from ohmward.figures import learning as pictures
from ohmward.filters.consistency import BAND_95
from ohmward.report import Page

ANCHORS = ["log", "time", "anchor", "state of charge"]


def make_page(files: BatteryFiles, figures: Mapping[str, Any]) -> Page:
    """Each battery before and after, what each log taught, what was not learnt from and why."""
    names = [file["name"] for file in figures["files"]]
    page = Page(f"Battery {names[0]!r}" if len(names) == 1 else f"{len(names)} batteries", title(figures), FOOTER)
    page = page.callout("info", ending(figures))
    for row in figures["logs"]:
        if row["verdict"] == "set aside":
            page = page.callout("warning", f"{row['log']} was set aside.\n\n{sentence(row['reason'])}")
    for file in figures["files"]:
        page = _battery(page, files, file, [row for row in figures["logs"] if row["battery_file"] == file["output"]])
    page = page.heading("Logs").table(LOGS, log_rows(figures["logs"]), "In the order in which they were learnt")
    page = _anchors(page, figures["logs"])
    return with_assumptions(page, figures["notes"]) if figures["notes"] else page


def _battery(page: Page, files: BatteryFiles, file: Mapping[str, Any], rows: Sequence[Row]) -> Page:
    """One battery: its figures and curves before and after, and its knowledge log by log."""
    key = file["output"] or ""
    before, after = files.before[key], files.after[key]
    page = page.heading(sentence(headline(file)).rstrip(".")).numbers(_numbers(file["after"]))
    page = page.table(CHANGES, change_rows(file), "With 95 % bands")
    page = page.plot(pictures.ocv_change_figure(before, after), pictures.ocv_correction_figure(before, after))
    page = page.plot(pictures.resistance_change_figure(before, after))
    taught = learnt(rows)
    if not taught:
        return page
    steps = [
        ("Capacity", "Capacity [Ah]", "capacity_Ah", 1.0),
        (f"Resistance to {PULSE_S:g} s of current", "Resistance [mΩ]", "resistance_ohm", 1e3),
    ]
    return page.plot(
        *(
            pictures.progress_figure(name, label, [file["before"][key], *(row[key] for row in taught)], scale)
            for name, label, key, scale in steps
        )
    )


def _numbers(state: Mapping[str, Any]) -> dict[str, str]:
    return {
        "Capacity": normal(state["capacity_Ah"], "Ah"),
        "Resistance, 10 s": lognormal(state["resistance_ohm"], "mΩ", 1e3),
        "Current offset": normal(state["current_offset_A"], "mA", 1e3),
    }


def _anchors(page: Page, rows: Sequence[Row]) -> Page:
    """The anchors of all logs, where there are any."""
    found = [[row["log"], anchor] for row in rows for anchor in row.get("anchors", [])]
    if not found:
        return page
    cells = [[log, _hours(anchor), str(anchor.get("kind", "given")), _soc(anchor)] for log, anchor in found]
    return page.heading("Anchors").table(ANCHORS, cells, "What told the state of charge beside the voltage, once each")


def _hours(anchor: Mapping[str, Any]) -> str:
    return f"{anchor['time_s'] / 3600:.2f} h" if anchor.get("time_s") is not None else "start"


def _soc(anchor: Mapping[str, Any]) -> str:
    return f"{100 * anchor['soc']:.0f} ± {100 * BAND_95 * anchor['soc_std']:.0f} %"
