"""`ohmward health`: capacity and resistance relative to new over months of logs, and the time left."""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from functools import partial
from typing import Any

from ohmward.battery.battery import Battery
from ohmward.battery.chemistries import Normal
from ohmward.battery.health.ageing import DAYS_PER_YEAR
from ohmward.battery.health.changes import Cause, Outlier
from ohmward.battery.health.health import BatteryHealth, health
from ohmward.battery.health.history import used_capacities
from ohmward.battery.learning.log_update import LogUpdate
from ohmward.cli.battery_inputs import load_with_sensor, log_files, read_battery_log, read_options
from ohmward.cli.outcome import Outcome, Report, progress
from ohmward.cli.wording import bullets, fields, known_rows, paragraphs, sentence
from ohmward.errors import InputError
from ohmward.figures.health import life_figure, trend_figures
from ohmward.figures.numbers import lognormal, normal, ratio
from ohmward.logs import Log
from ohmward.logs.log import ReadOptions
from ohmward.logs.table import counted
from ohmward.quantities import DAY_S, SECONDS_PER_HOUR
from ohmward.report import Page

#: Probabilities of the time left, and times within which the battery may be worn out [days].
QUANTILES = {"p05": 0.05, "p25": 0.25, "p50": 0.5, "p75": 0.75, "p95": 0.95}
WITHIN = {
    "month": DAYS_PER_YEAR / 12,
    "half_year": DAYS_PER_YEAR / 2,
    "year": DAYS_PER_YEAR,
    "five_years": 5 * DAYS_PER_YEAR,
}

#: Likely cause of a sudden change, in words, and its meaning for the trend.
CAUSES: Mapping[Cause, str] = {
    "counter": "the current reads differently from here on: the resistance changed by as much the other way; "
    "this is a counter, no ageing; or another battery, where the capacity grew",
    "cold": "these logs are much colder; they show cold, not ageing",
    "not full": "no full charge shows the capacity here: charges that were broken off look the same; not counted as "
    "ageing",
    "battery": "the resistance rose with it, faster than any ageing: damage, a bad contact, or another battery",
    "exchange": "the resistance fell with it, as no ageing does: another battery; its health is relative to the first",
    "unknown": "the logs do not show whether it is the battery, its counter or how it was used",
}
LOGS = ["log", "begins", "cycles", "mean °C", "capacity", "resistance", "remark"]


def run(args: argparse.Namespace) -> Outcome:
    """Learn from every log in order of time, then judge the trend."""
    if not args.worn > 0.0:
        raise InputError(f"--worn must be above 0, got {args.worn:g}; 0.8 is 80 % of the capacity when new")
    battery, warnings = load_with_sensor(args.battery, args)
    with progress() as report:
        logs, unread = read_logs(args.logs, read_options(args), battery, report)
        found = health(battery, logs, new_capacity_Ah=args.new_capacity_ah, worn=args.worn, progress=report)
    notes = [*warnings, *(f"info: {text}" for text in found.notes), *unread]
    notes += [f"warning: left out: {text}" for text in found.dated.left_out]
    for log in found.dated.logs:
        notes += [f"warning: {log.name}: {note.text}" for note in log.notes if note.level == "warning"]
    figures = summary(found) | {"notes": notes, "report": args.report}
    return Outcome(figures, describe(figures), notes, partial(make_page, found, figures))


def read_logs(
    words: Sequence[str], reading: ReadOptions, battery: Battery, report: Report | None
) -> tuple[list[Log], list[str]]:
    """The logs that can be read, and a warning for each that cannot; raises InputError where none can."""
    logs, refusals = [], []
    texts = log_files(words)
    for text in texts:
        try:
            logs.append(read_battery_log(text, reading, report=report, battery=battery))
        except InputError as refusal:
            refusals.append(refusal)
    if not logs:
        raise refusals[0]
    return logs, [f"warning: left out: {refusal}" for refusal in refusals]


def summary(found: BatteryHealth) -> dict[str, Any]:
    """The object of --json, but for the notes and the files."""
    health, updates = found.health, found.updates
    used = used_capacities(updates)
    days, cycles = health.now
    by_logs = found.capacity_by == "logs"
    return {
        "command": "health",
        "battery": found.battery.name,
        "logs": [_log(found, k, used[k].capacity_Ah) for k in range(len(updates))],
        "days": days,
        "cycles": cycles,
        "capacity_new_Ah": found.new.capacity_Ah,
        "resistance_new_ohm": found.new.resistance_ohm,
        "capacity_Ah": updates[-1].capacity_Ah._asdict(),
        "discharge_Ah": used[-1].capacity_Ah._asdict(),
        "emptied": used[-1].latest is not None,
        "soh_capacity": ratio(found.capacity) if found.capacity else None,
        "capacity_by": found.capacity_by,
        "resistance_ratio": ratio(health.resistance_now),
        "worn_share": health.ahead.share,
        "worn_in_days": {name: health.ahead.quantile(q) for name, q in QUANTILES.items()} if by_logs else None,
        "worn_within": {name: health.ahead.within(of_days) for name, of_days in WITHIN.items()} if by_logs else None,
        "sudden_changes": [
            {
                "before": step.before,
                "after": step.after,
                "days": step.days,
                "capacity_ratio": ratio(step.capacity),
                "resistance_ratio": ratio(step.resistance) if math.isfinite(step.resistance.std) else None,
                "cause": step.cause,
                "text": CAUSES[step.cause],
            }
            for step in health.changes
        ],
        "off_trend": [
            {"log": one.log, "sigma": one.deviation, "cause": one.cause, "text": CAUSES[one.cause]}
            for one in health.outliers
        ],
    }


def _log(found: BatteryHealth, k: int, discharge_Ah: Normal) -> dict[str, Any]:
    update, point = found.updates[k], found.health.points[k]
    start_s = float(found.dated.start_s[k])
    shows_capacity = point.shows_capacity and found.capacity_by == "logs"
    return {
        "log": update.log,
        "begins": f"{datetime.fromtimestamp(start_s, UTC):%Y-%m-%d %H:%M}" if found.dated.has_clock else None,
        "days": (start_s - float(found.dated.start_s[0])) / DAY_S,
        "hours": found.dated.logs[k].duration_s / SECONDS_PER_HOUR,
        "cycles": point.cycles,
        "temperature_degC": point.temperature_degC,
        "verdict": update.verdict,
        "reason": update.reason,
        "soc_min": update.soc_min,
        "soc_max": update.soc_max,
        "capacity_Ah": update.capacity_Ah._asdict(),
        "discharge_Ah": discharge_Ah._asdict(),
        "resistance_ohm": update.resistance_ohm._asdict(),
        "own_soh_capacity": ratio(point.log_capacity) if shows_capacity else None,
        "own_resistance_ratio": ratio(point.log_resistance) if point.shows_resistance else None,
        "remark": remark(update, shows_capacity, found.health.outliers),
    }


def remark(update: LogUpdate, shows_capacity: bool, outliers: Sequence[Outlier]) -> str:
    """Remark on a log beside its numbers."""
    if update.verdict != "learnt":
        return f"{update.verdict}: {update.reason}" if update.reason else update.verdict
    own = next((outlier for outlier in outliers if outlier.log == update.log), None)
    if own is not None:
        return f"{own.deviation:+.1f} sigma off the trend: {CAUSES[own.cause]}"
    return "" if shows_capacity else "says nothing of the capacity by itself"


def describe(f: Mapping[str, Any]) -> str:
    """Text for people.

    f: the summary of the run, here and in all functions below.
    """
    aside = [f"{log['log']}: {log['reason']}" for log in f["logs"] if log["verdict"] == "set aside"]
    return paragraphs(
        f"health of battery {f['battery']!r} over {span(f)}",
        fields(result(f)),
        bullets("Sudden changes, which no ageing makes", list(map(change_text, f["sudden_changes"]))),
        bullets("Logs off the trend", list(map(off_text, f["off_trend"]))),
        bullets("Set aside", aside),
    )


def span(f: Mapping[str, Any]) -> str:
    """Number of logs, and the days and cycles between the first and the last."""
    of_logs, days = counted(len(f["logs"]), "log"), counted(round(f["days"]), "day")
    return f"{of_logs}, {days}, {f['cycles']:.3g} full cycles"


def result(f: Mapping[str, Any]) -> dict[str, str]:
    """The key figures with their units, by name."""
    resistance = {"resistance": f"{lognormal(f['resistance_ratio'], '%', 100)} of that when new, at 25 degC"}
    left = {f"down to {f['worn_share']:.0%} in": life_text(f)}
    if f["capacity_by"] != "logs":
        return {"capacity": capacity_text(f)} | resistance | left
    rows = {"capacity": capacity_text(f)} | resistance | {"from full to empty": normal(f["capacity_Ah"], "Ah")}
    if f["emptied"]:
        rows["a discharge gives"] = f"{normal(f['discharge_Ah'], 'Ah')}, from full to where they have ended"
    return rows | left


def capacity_text(f: Mapping[str, Any]) -> str:
    """The capacity with its band, and whether it is that of the filter alone; or what would show it."""
    if f["soh_capacity"] is None:
        return "not known: no log shows it; a discharge from full to empty would"
    found = f"{normal(f['soh_capacity'], '%', 100)} of that when new"
    return found if f["capacity_by"] == "logs" else f"{found}, by the filter over all logs; no log alone shows it"


def life_text(f: Mapping[str, Any]) -> str:
    """The time left in words: its median and 90 % interval."""
    left = f["worn_in_days"]
    if left is None:
        return "not known: the logs show no trend of the capacity"
    if left["p95"] == 0.0:
        return "it is there already"
    return f"{time_text(left['p50'])}; nine in ten: {time_text(left['p05'])} to {time_text(left['p95'])}"


def time_text(days: float) -> str:
    """A time in days, months or years, whichever fits."""
    if not math.isfinite(days):
        return "more than 30 years"
    if days < 1.0:
        return "now"
    if days < 60.0:
        return f"{days:.0f} days"
    months = days / (DAYS_PER_YEAR / 12)
    return f"{months:.0f} months" if months < 24.0 else f"{days / DAYS_PER_YEAR:.1f} years"


def change_text(step: Mapping[str, Any]) -> str:
    """A sudden change in a sentence."""
    changes = [f"capacity {100 * (step['capacity_ratio']['mean'] - 1):+.0f} %"]
    if step["resistance_ratio"]:
        changes.append(f"resistance {100 * (step['resistance_ratio']['mean'] - 1):+.0f} %")
    return f"between {step['before']} and {step['after']}: {', '.join(changes)}; {step['text']}"


def off_text(outlier: Mapping[str, Any]) -> str:
    """A log off the trend in a sentence."""
    return f"{outlier['log']}, by {outlier['sigma']:+.1f} sigma: {outlier['text']}"


def make_page(found: BatteryHealth, f: Mapping[str, Any]) -> Page:
    """Key figures, trends, the time left, and the logs."""
    numbers = {
        "Capacity": normal(f["soh_capacity"], "%", 100) if f["soh_capacity"] else "not known",
        "Resistance": lognormal(f["resistance_ratio"], "%", 100),
        f"Down to {f['worn_share']:.0%} within a year": f"{f['worn_within']['year']:.0%}" if f["worn_within"] else "",
    }
    page = Page(f"Health of battery {f['battery']!r}", span(f)).numbers(known_rows(numbers))
    for step in f["sudden_changes"]:
        page = page.callout("warning", sentence(f"sudden change {change_text(step)}"))
    for outlier in f["off_trend"]:
        page = page.callout("info", sentence(off_text(outlier)))
    page = page.heading("Trend").plot(*trend_figures(found))
    page = page.heading("Time left").text(sentence(f"Down to {f['worn_share']:.0%}: {life_text(f)}"))
    if f["worn_within"]:
        page = page.plot(life_figure(found.health.ahead))
    page = page.heading("Result").table(["Quantity", "Value, 95 %"], list(result(f).items()))
    rows = [
        [
            log["log"],
            log["begins"] or f"day {log['days']:.1f}",
            f"{log['cycles']:.2f}",
            f"{log['temperature_degC']:.0f}" if math.isfinite(log["temperature_degC"]) else "-",
            normal(log["own_soh_capacity"], "%", 100) if log["own_soh_capacity"] else "-",
            lognormal(log["own_resistance_ratio"], "%", 100) if log["own_resistance_ratio"] else "-",
            log["remark"],
        ]
        for log in f["logs"]
    ]
    return page.heading("Logs").table(LOGS, rows, "What each log shows by itself")
