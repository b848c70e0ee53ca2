"""`ohmward doctor`: contents, assumptions and faults of a log; doubts of a battery file and the band that follows."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from ohmward.battery.battery import Battery, LogFit
from ohmward.battery.file import load_battery
from ohmward.battery.soc.band_forecast import (
    TEMPERATURES_DEGC,
    BandForecast,
    BandsAfterTest,
    forecast,
    taken_as_exact,
    worthwhile_tests,
)
from ohmward.cli import wording
from ohmward.cli.battery_inputs import read_battery_log, read_options
from ohmward.cli.outcome import Outcome
from ohmward.cli.wording import FOOTER, duration, grouped, sentence, with_assumptions
from ohmward.errors import InputError
from ohmward.figures import battery as pictures
from ohmward.figures.parts import wall_clock
from ohmward.filters.consistency import BAND_95
from ohmward.logs import Log, examine
from ohmward.logs.cell_columns import cell_names
from ohmward.logs.channels import CURRENT, VOLTAGE
from ohmward.logs.columns import find_column, listed
from ohmward.logs.doctor import Findings
from ohmward.logs.log import ReadOptions
from ohmward.logs.note import Note, counted
from ohmward.logs.read import open_table
from ohmward.logs.selection import split_selection
from ohmward.logs.sign import CurrentSign, UnknownSignError
from ohmward.logs.survey import Signal
from ohmward.logs.table import TableFile
from ohmward.logs.wheel_columns import wheel_names
from ohmward.report import Page

#: How to read the bands.
READING = "half width of the 95 % band in points, start known / start unknown"
BANDS = ["95 % band on a working day", *(f"{T:g} degC" for T in TEMPERATURES_DEGC)]


class BatteryFindings(NamedTuple):
    """Findings on a battery file."""

    path: str  #: of the file
    battery: Battery
    bands: Sequence[BandForecast]  #: of the file
    tests: Sequence[BandsAfterTest]  #: those worth their time, the best first


def run(args: argparse.Namespace) -> Outcome:
    """Examine each file; the exit status is 1 if a log has an error."""
    batteries = [path for path in args.files if Path(path).suffix == ".toml"]
    paths = [path for path in args.files if path not in batteries]
    logs = [_read(path, read_options(args)) for path in paths]
    found = [examine(log) for log in logs]
    known = [examine_battery(path, load_battery(path)) for path in batteries]
    return Outcome(
        summary={
            "command": "doctor",
            "logs": [{"path": p} | asdict(one) | {"worst": one.worst} for p, one in zip(paths, found, strict=True)],
            "batteries": [battery_summary(one) for one in known],
        },
        text="\n\n".join([*map(describe, logs, found), *map(describe_battery, known)]),
        notes=[note for one in found for note in one.notes],
        page=partial(make_page, logs, found, known),
        status=int(any(one.worst == "error" for one in found)),
    )


def examine_battery(path: str, battery: Battery) -> BatteryFindings:
    """Forecast the bands of a battery file as it is, and after each test."""
    bands = forecast(battery)
    return BatteryFindings(path, battery, bands, worthwhile_tests(battery, bands))


def _read(path: str, reading: ReadOptions) -> Log:
    """The log of a battery.

    Raises:
        InputError: it cannot be read as one; says so where it is that of a drive.
    """
    file = open_table(split_selection(path)[0], reading.hints)
    try:
        return read_battery_log(path, reading, file=file)
    except UnknownSignError as error:
        sign: CurrentSign = "discharge" if error.likely == "discharge" else "charge"
        log = read_battery_log(path, replace(reading, current_sign=sign), file=file)
        others = [note for note in log.notes if not note.text.startswith("positive current")]
        taken = Note(f"{error}; here a positive current is taken to {sign} the battery", "warning")
        return replace(log, notes=(*others, taken))
    except InputError as error:
        if not (wheels := wheel_names(file.names)) or _is_of_battery(file, dict(reading.columns)):
            raise
        raise InputError(
            f"{file.source} looks like a drive, with {listed(wheels, 4)}; see it with `ohmward slip {path} --robot "
            f"robot.toml`. As the log of a battery: {error}"
        ) from error


def _is_of_battery(file: TableFile, columns: dict[str, str]) -> bool:
    """True for a file that has a current and a voltage of a battery."""
    cells = cell_names(file.names)
    for channel in (CURRENT, VOLTAGE):
        optional = channel._replace(required=False)
        try:
            if find_column(file.source, file.names, optional, columns, {}, cells) is None:
                return False
        except InputError:  # several fit
            continue
    return True


def describe(log: Log, found: Findings) -> str:
    """Figures and findings of a log, for people."""
    findings = [f"{finding.severity}: {finding.text} -> {finding.advice}" for finding in found.findings]
    return wording.paragraphs(
        f"{log.name}: {grouped(len(log))} samples in {duration(log.duration_s)}",
        wording.fields(contents(log, found)),
        wording.assumptions(found.notes),
        wording.bullets("Found", findings) or "Found: nothing suspicious.",
    )


def contents(log: Log, found: Findings) -> dict[str, str]:
    """The figures of a log with their units, by name."""
    s = found.survey
    rows = {
        "sampling": f"every {s.sampling.median_s:.3g} s, {s.sampling.shortest_s:.3g} to {s.sampling.longest_s:.4g} s; "
        f"gaps: {s.sampling.gaps}",
        "current": f"{_range(s.current)} A; > 0 charges",
        "voltage": f"{_range(s.voltage)} V",
        "temperature": f"{_range(s.temperature)} degC" if s.temperature else "not recorded",
        "noise": f"{1e3 * s.current.noise_std:.3g} mA, {1e3 * s.voltage.noise_std:.3g} mV",
        "resolution": f"{1e3 * s.current.resolution:.3g} mA, {1e3 * s.voltage.resolution:.3g} mV",
        "charge": f"{s.activity.charge_in_Ah:.4g} Ah in, {s.activity.charge_out_Ah:.4g} Ah out",
        "activity": f"{s.activity.rests} rests, {s.activity.pulses} pulses between rests",
        "at rest": wording.quantity(s.activity.rest_current_A, "mA", 1e3),
        "edges": f"{s.sign.edges} of the current; dV/dI = {wording.quantity(s.sign.resistance_ohm, 'mohm', 1e3)}",
    }
    return rows | ({"also": ", ".join(log.extra)} if log.extra else {})


def _range(signal: Signal) -> str:
    return f"{signal.minimum:.5g} to {signal.maximum:.5g}"


def battery_summary(found: BatteryFindings) -> dict[str, Any]:
    """The entry of --json."""
    battery = found.battery
    return {
        "path": found.path,
        "name": battery.name,
        "chemistry": battery.chemistry,
        "capacity_Ah": battery.capacity_Ah,
        "not_identified": battery.not_identified,
        "bands": found.bands,
        "tests": found.tests,
    }


def describe_battery(found: BatteryFindings) -> str:
    """Findings on a battery file, for people."""
    battery = found.battery
    return wording.paragraphs(
        f"{found.path}: battery {battery.name!r}, {wording.quantity(battery.capacity_Ah, 'Ah')}, "
        f"{battery.chemistry or 'chemistry not said'}, {battery.n_series} in series",
        wording.fields(sources(battery)),
        wording.bullets("Not known", battery.not_identified),
        f"{wording.table(BANDS, band_rows(found))}\n({READING})" if found.bands else "",
        "" if found.bands else "No band: this file has no Thevenin model.",
    )


def sources(battery: Battery) -> dict[str, str]:
    """Provenance of the numbers of a battery."""
    known = battery.identification
    logs = [f"{fit.log} ({fit.test}, SoC {_soc_range(fit)})" for fit in known.logs] if known else []
    models = [name for name in ("thevenin", "rc") if getattr(battery, name) is not None]
    idle = battery.idle_current_A
    exact = taken_as_exact(battery)
    learnt = battery.knowledge.logs if battery.knowledge else ()
    rows = {
        "tests": "; ".join(logs) or "none",
        "learnt from": f"{counted(len(learnt), 'log')}, {sum(log.hours for log in learnt):.1f} h" if learnt else "none",
        "models": ", ".join(models),
        "rest current": "not declared" if idle is None else f"{idle:g} A",
        "current sensor": f"offset ± {BAND_95 * battery.sensor.offset_std_A:.2g} A, "
        f"gain ± {100 * BAND_95 * battery.sensor.gain_std:.2g} % (95 %)",
    }
    return rows | ({"taken as exact": f"{', '.join(exact)}: 0 in [noise]"} if exact else {})


def _soc_range(fit: LogFit) -> str:
    low, high = (round(100 * min(max(soc, 0.0), 1.0)) for soc in (fit.soc_min, fit.soc_max))
    return f"{low} to {high} %"


def band_rows(found: BatteryFindings) -> list[list[str]]:
    """The bands as the file is, then after each test that is worth its time."""
    rows = [["as the file is", *map(_cell, found.bands)]]
    return rows + [[f"at best, {test.test}", *map(_cell, test.bands)] for test in found.tests]


def _cell(band: BandForecast) -> str:
    return f"± {band.known_start:.1f} / {band.unknown_start:.1f}"


def make_page(logs: Sequence[Log], found: Sequence[Findings], batteries: Sequence[BatteryFindings]) -> Page:
    """One section for each log and battery file: figures, findings, plots, assumptions."""
    names = [log.name for log in logs] + [one.battery.name for one in batteries]
    title = names[0] if len(names) == 1 else f"{len(names)} {'files' if batteries else 'logs'}"
    page = Page(title, "What is in it, what is wrong, what was assumed", FOOTER)
    for log, findings in zip(logs, found, strict=True):
        page = _section(page if len(names) == 1 else page.heading(log.name), log, findings)
    for one in batteries:
        page = page if len(names) == 1 else page.heading(one.battery.name)
        page = page.table(["Quantity", "Found"], list(sources(one.battery).items()))
        page = page.table(["Not known"], [[text] for text in one.battery.not_identified])
        if one.bands:
            page = page.table(BANDS, band_rows(one), sentence(READING))
        else:
            page = page.text("No band: this file has no Thevenin model.")
    return page


def _section(page: Page, log: Log, found: Findings) -> Page:
    s = found.survey
    figures = {
        "Samples": grouped(len(log)),
        "Duration": duration(log.duration_s),
        "Interval": f"{s.sampling.median_s:.3g} s",
        "Charge in": f"{s.activity.charge_in_Ah:.4g} Ah",
        "Charge out": f"{s.activity.charge_out_Ah:.4g} Ah",
        "Rests": str(s.activity.rests),
        "Pulses": str(s.activity.pulses),
    }
    page = page.numbers(figures)
    for finding in found.findings:
        page = page.callout(finding.severity, f"{sentence(finding.text)}\n\n{sentence(finding.advice)}")
    plots = [pictures.current_figure(log), pictures.voltage_figure(log)]
    plots += [pictures.temperature_figure(log)] if log.temperature_degC is not None else []
    plots += pictures.further_figures(log)
    plots += [pictures.interval_figure(log)] if len(log) > 1 else []
    page = page.plot(*plots, clock=wall_clock(log))
    page = page.table(["Quantity", "Found"], list(contents(log, found).items()))
    return with_assumptions(page, found.notes)
