"""`ohmward doctor`: contents and faults of logs, battery files, robot files and setups, and the next command."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.battery import Battery, LogFit
from ohmward.battery.charge_count import count_charge, require_followed
from ohmward.battery.file import BATTERY_FILE, load_battery
from ohmward.battery.identification.record import make_records
from ohmward.battery.models.noise import AGED_AFTER_DAYS, BatteryNoise
from ohmward.battery.soc import band_forecast
from ohmward.cli.battery_inputs import of_kinds, read_battery_log, reading_words
from ohmward.cli.drive_inputs import TWO_WHEELS, DriveOptions, drive_options
from ohmward.cli.outcome import Outcome
from ohmward.cli.wording import assumptions, bullets, fields, paragraphs, sentence, table, with_assumptions
from ohmward.errors import InputError
from ohmward.figures import battery as pictures
from ohmward.figures.numbers import quantity
from ohmward.figures.parts import wall_clock
from ohmward.figures.slip import wheels_figure
from ohmward.filters.consistency import BAND_95
from ohmward.logs import DriveLog, Log, examine
from ohmward.logs.battery_columns import cell_names, find_cells, numbered_rows
from ohmward.logs.channels import CURRENT, VOLTAGE
from ohmward.logs.columns import find_column
from ohmward.logs.doctor import DriveSurvey, Findings, Sampling, Signal, Survey, examine_drive
from ohmward.logs.log import ReadOptions, UnknownSignError
from ohmward.logs.read import open_table
from ohmward.logs.selection import SeveralRecordingsError, split_selection
from ohmward.logs.table import Note, TableFile, counted
from ohmward.logs.units import unit_in_name
from ohmward.onboard.robot_setup import SETUP_FILE
from ohmward.quantities import QUANTITIES
from ohmward.report import Page
from ohmward.runs import duration
from ohmward.traction import load_robot
from ohmward.traction.drive_checks import check_drive
from ohmward.traction.robot.packaged import PACKAGED
from ohmward.traction.robot.robot import ROBOT_FILE

_LOG = "log"
#: More logs than these are those of a fleet: the next command is one for all of them.
_MOST_LOGS = 10
#: Radius of wheels [m] that no robot file gives: their speeds at the rim in m/s are shown as so many rad/s.
_NO_RADIUS_M = 1.0
#: How to read the bands.
READING = "half width of the 95 % band in points, start known / start unknown"
BANDS = ["95 % band on a working day", *(f"{T:g} degC" for T in band_forecast.TEMPERATURES_DEGC)]


class GivenFiles(NamedTuple):
    """How to read drives, and the files that the next commands name."""

    drives: DriveOptions
    robot: str
    battery: str

    def make_battery(self, cells: Collection[str] = ()) -> list[str]:
        """The command that makes the battery file, if there is none; cells: columns of their voltages."""
        return (
            []
            if Path(self.battery).exists()
            else [shlex.join(["ohmward", "generic", *_label(cells), "-o", self.battery])]
        )

    def make_robot(self, path: str, drive: DriveLog) -> list[str]:
        """The command that makes the robot file, if there is none; a speed from outside shows its sizes."""
        if kind_of(self.robot) == ROBOT_FILE.noun or Path(self.robot).exists():
            return []
        if drive.speed_m_s is None:
            return [f"ohmward robot --radius M --track M --mass KG -o {self.robot}"]
        return [self.next_command("robot", path, "--mass", "KG", "-o", self.robot)]

    def fleet(self, paths: Sequence[str]) -> str:
        """The command that estimates many logs."""
        words = reading_words(of_kinds(self.drives.reading, of_battery=True))
        return shlex.join(["ohmward", "fleet", *paths, "--battery", self.battery, *words, "-o", "results"])

    def next_command(self, command: str, path: str, *options: str) -> str:
        """A command on a log, with the options by which it was read, and further ones."""
        is_drive, is_battery = command in ("robot", "slip", "mission"), command not in ("robot", "slip")
        reading = self.drives.reading if is_drive and is_battery else of_kinds(self.drives.reading, is_battery)
        shaft = self.drives.shaft_words if is_drive else []
        return shlex.join(["ohmward", command, path, *options, *reading_words(reading), *shaft])


def _label(cells: Collection[str]) -> tuple[str, ...]:
    """Options for what the label of a battery says; the number of cells where a log has their voltages."""
    return "--capacity-ah", "AH", "--chemistry", "CHEMISTRY", "--n-series", str(len(cells) or "N")


class Part(NamedTuple):
    """Findings on a file as the log of a battery, as the log of a drive, or as a TOML file."""

    kind: str  #: its list in --json, one of `_KINDS`
    name: str
    text: str  #: for people
    summary: Mapping[str, Any]  #: its entry in --json
    next_commands: Sequence[str]  #: suggested for it
    notes: Sequence[str] = ()
    is_wrong: bool = False  #: True if it has an error
    section: Callable[[Page], Page] | None = None  #: adds it to a page; None for a kind that pages leave out


#: Kinds of parts in the order of the text; on a page battery files stand before drives.
_KINDS = ("logs", "drives", "batteries", "robots", "setups")


def run(args: argparse.Namespace) -> Outcome:
    """Examine each file; the exit status is 1 if a log has an error, or cannot be used beside others.

    Raises:
        InputError: none of the files can be used; the reason of the first.
    """
    kinds = {path: kind_of(path) for path in args.files}
    first = {kind: path for path, kind in reversed(kinds.items())}
    drives = drive_options(args, load_robot(args.robot) if args.robot else None)
    given = GivenFiles(
        drives if args.robot else drives._replace(radius_m=_NO_RADIUS_M),
        args.robot or first.get(ROBOT_FILE.noun, "robot.toml"),
        first.get(BATTERY_FILE.noun, "battery.toml"),
    )
    found: list[Part] = []
    refused: dict[str, InputError] = {}
    for path, kind in kinds.items():
        try:
            found += _EXAMINED[kind](path, given)
        except SeveralRecordingsError as error:
            of_fleet = f"; or estimate all of them: {given.fleet([path])}" if Path(path).is_dir() else ""
            refused[path] = InputError(f"{error}{of_fleet}")
        except InputError as error:
            refused[path] = error
    if not found and refused:
        raise next(iter(refused.values()))
    parts = sorted(found, key=lambda part: _KINDS.index(part.kind))
    following = list(dict.fromkeys(command for part in found for command in part.next_commands))
    logs = [path for path, kind in kinds.items() if kind == _LOG and path not in refused]
    if len(logs) > _MOST_LOGS:
        following = [*given.make_battery(), given.fleet(list(dict.fromkeys(str(Path(path).parent) for path in logs)))]
    return Outcome(
        summary={
            "command": "doctor",
            **{kind: [part.summary for part in parts if part.kind == kind] for kind in _KINDS},
            "refused": [{"path": path, "error": str(error)} for path, error in refused.items()],
            "next": following,
        },
        text=paragraphs(
            *(part.text for part in parts),
            bullets("Could not be used", list(map(str, refused.values()))),
            bullets("Next", following),
        ),
        notes=[note for part in parts for note in part.notes],
        has_notes=True,
        page=partial(make_page, parts),
        status=int(any(part.is_wrong for part in parts) or bool(refused)),
    )


def kind_of(path: str) -> str:
    """Kind of file that an argument names: a log, or a kind of TOML file; a packaged robot is a robot file.

    A recording with the name of a robot, such as the folder `husky` of a bag, is a log.
    """
    if path.lower() in PACKAGED and not Path(path).exists():
        return ROBOT_FILE.noun
    if Path(path).suffix.lower() != ".toml":
        return _LOG
    try:
        head = Path(path).read_text(encoding="utf-8", errors="replace")
    except OSError:
        return BATTERY_FILE.noun  # its reader reports what is wrong
    kinds = (ROBOT_FILE, SETUP_FILE)
    return next((kind.noun for kind in kinds if f'"{kind.format.partition("/")[0]}/' in head), BATTERY_FILE.noun)


def examine_log(path: str, given: GivenFiles) -> Iterator[Part]:
    """Battery and drive in a log, whichever it has.

    Raises:
        InputError: it has neither; the message names what is missing for a battery, or for a drive with wheels alone.
    """
    options = given.drives
    reading = options.reading
    file = open_table(split_selection(path)[0], reading.hints)
    places = _places(file, options)
    log, drive, refused = None, None, None
    try:
        log = _read(path, of_kinds(reading, of_battery=True), file)
    except InputError as error:
        # a robot was given for a drive, also for one whose wheels are not recognised
        places = places or (tuple(place.name for place in options.robot.places) if options.robot else ())
        places = places or (TWO_WHEELS if _is_of_drive(file) else ())
        if not places or _is_of_battery(file, dict(reading.columns)):
            raise
        refused = error
    cells: set[str] = set()
    if log is not None:
        cells = _cells(log)
        file = file._replace(names=tuple(name for name in file.names if name not in cells))
        places = _places(file, options)
    if places:
        try:
            drive = options._replace(reading=of_kinds(reading, of_battery=False)).read(path, file=file)
            if options.robot is None:
                drive = drive.with_notes(*_without_radius(drive))
            else:  # which shows the values of the file, not the mended ones
                drive = replace(drive, notes=check_drive(options.robot, drive).notes)
        except InputError as error:
            if log is None:
                raise InputError(f"{error}. As the log of a battery: {refused}", error.options) from error
            log = log.with_notes(Note(f"also a drive, which could not be read: {error}", "warning"))
    if log is not None:
        log, teaches = _with_verdict(log)
        found = examine(log)
        of_battery = ("--battery", given.battery)
        if teaches and _has_pulses(log, found):
            commands = [given.next_command("identify", path, *_label(cells), "-o", given.battery)]
        elif (commands := given.make_battery(cells)) and teaches:
            commands.append(given.next_command("learn", path, *of_battery, "-o", given.battery))
        commands.append(given.next_command("soc", path, *of_battery))
        yield _examined(
            "logs", path, log.name, log, contents(log, found), found, commands, partial(_section, log, found)
        )
    if drive is not None:
        of_drive = examine_drive(drive, places)
        commands = [*given.make_robot(path, drive), given.next_command("slip", path, "--robot", given.robot)]
        if log is not None:
            commands.append(given.next_command("mission", path, "--robot", given.robot, *of_battery))
        name, rows = f"{drive.name}, drive", drive_contents(drive, of_drive)
        yield _examined("drives", path, name, drive, rows, of_drive, commands, partial(_drive_section, drive, of_drive))


def _examined(
    kind: str,
    path: str,
    title: str,
    log: Log | DriveLog,
    rows: Mapping[str, str],
    found: Findings[Any],
    commands: Sequence[str],
    section: Callable[[Page], Page],
) -> Part:
    """A log with its length, its figures, what was assumed and what was found."""
    sentences = [f"{finding.severity}: {finding.text} -> {finding.advice}" for finding in found.findings]
    also_found = {f"{finding.severity}: {finding.text}" for finding in found.findings}
    text = paragraphs(
        f"{title}: {len(log):,} samples in {duration(log.duration_s)}",
        fields(rows),
        assumptions([note for note in found.notes if note not in also_found], "all"),
        bullets("Found", sentences) or "Found: nothing suspicious.",
    )
    summary = {"path": path} | asdict(found) | {"worst": found.worst}
    is_wrong = found.worst == "error"  # what the finding advises comes first
    return Part(kind, title, text, summary, [] if is_wrong else commands, found.notes, is_wrong, section)


def _with_verdict(log: Log) -> tuple[Log, bool]:
    """The log, and whether its rows follow the current closely enough to show a battery; if not, it has a warning."""
    try:
        require_followed(log)
    except InputError as refusal:
        return log.with_notes(Note(f"shows no resistances: {refusal}", "warning")), False
    return log, True


def _has_pulses(log: Log, found: Findings[Survey]) -> bool:
    """True for a pulse test; the charge between its fullest and its emptiest moment stands for the capacity."""
    activity = found.survey.activity
    moved_Ah = np.ptp(count_charge(log).total_Ah) if activity.pulses else 0.0
    return moved_Ah > 0.0 and make_records(log, moved_Ah, activity.rest_current_A or 0.0)[0].test == "pulses"


def _cells(log: Log) -> set[str]:
    """Columns that their sum shows to be cells of the battery: by name alone, V1, V2, ... may be speeds."""
    rows = numbered_rows(log.extra)
    return {
        name for row in rows for name in row if find_cells({n: log.extra[n] for n in row}, log.voltage_V, len(row))[0]
    }


def _places(file: TableFile, options: DriveOptions) -> tuple[str, ...]:
    """Names of the robot's wheels, or without a robot of those in the columns; () for a log without a drive."""
    try:
        names = file.part("drive").names
    except InputError:  # a recording without a topic of a drive
        return ()
    if not (found := options.places_in(names)):
        return ()
    return tuple(place.name for place in options.robot.places) if options.robot else found


def _without_radius(drive: DriveLog) -> Iterator[Note]:
    """A warning on speeds that were measured at the rim, so that those in rad/s are not the wheels'."""
    if any("of a rim of radius" in note.text for note in drive.notes):
        text = f"the radius of the wheels is not known: with {_NO_RADIUS_M:g} m their rad/s are m/s; give --robot"
        yield Note(text, "warning")


def _read(path: str, reading: ReadOptions, file: TableFile) -> Log:
    """The log of a battery; if the sign of the current is unknown, the likely one is assumed, with a warning."""
    try:
        return read_battery_log(path, reading, file=file)
    except UnknownSignError as error:
        log = read_battery_log(path, replace(reading, current_sign=error.likely), file=file)
        others = [note for note in log.notes if not note.text.startswith("positive current")]
        taken = Note(f"{error}; here a positive current is taken to {error.likely} the battery", "warning")
        return replace(log, notes=(*others, taken))


def _is_of_drive(file: TableFile) -> bool:
    """True for a file with the unit of a speed, and none of a battery's."""
    return not any(unit_in_name(name, ("current", "voltage", "power")) for name in file.names) and any(
        unit_in_name(name, ("rotation", "turn rate", "speed")) for name in file.names
    )


def _is_of_battery(file: TableFile, columns: dict[str, str]) -> bool:
    """True for a file that has a current and a voltage of a battery."""
    cells = cell_names(file.names)
    for channel in (CURRENT, VOLTAGE):
        try:
            if find_column(file.source, file.names, channel, columns, {}, cells, optional=True) is None:
                return False
        except InputError:  # several fit
            continue
    return True


def examine_robot(path: str, _: GivenFiles) -> Iterator[Part]:
    """Contents of a robot file."""
    robot = load_robot(path)
    rows = {
        "chassis": type(robot.chassis).__name__,
        "wheels": ", ".join(place.name for place in robot.places) + f"; the first {robot.driven} are driven",
        "mass": f"{robot.mass_kg:g} kg",
        "wheel radius": f"{robot.wheel.radius_m:g} m",
        "gear": f"{robot.motor.gear_ratio:g}",
    }
    text = paragraphs(f"{path}: robot {robot.name!r}", fields(rows))
    summary = {"path": path, "name": robot.name} | rows
    yield Part("robots", robot.name, text, summary, [f"ohmward slip LOG --robot {path}"])


def examine_setup(path: str, _: GivenFiles) -> Iterator[Part]:
    """Contents of a setup."""
    setup = SETUP_FILE.load(path)
    rows = {
        "estimates": ", ".join(kind for kind, part in (("charge", setup.battery), ("motion", setup.robot)) if part),
        "sources": ", ".join(source.name for source in setup.source) or "none",
        "sinks": ", ".join(sink.name for sink in setup.sink) or "none",
    }
    text = paragraphs(f"{path}: setup of a robot", fields(rows))
    yield Part("setups", path, text, {"path": path} | rows, [f"ohmward run {path} --check"])


def drive_contents(log: DriveLog, found: Findings[DriveSurvey]) -> dict[str, str]:
    """The figures of a drive with their units, by name."""
    s = found.survey
    rows = {"sampling": _sampling(s.sampling)}
    rows |= {f"wheel {place}": f"{_range(wheel)} rad/s" for place, wheel in s.wheels.items()}
    rows |= {f"motor {place}": f"{_range(motor)} A" for place, motor in s.motors.items()}
    body = {QUANTITIES[name]: signal for name, signal in s.body.items()}
    rows |= {quantity.label.lower(): f"{_range(signal)} {quantity.unit}" for quantity, signal in body.items()}
    return rows | ({"also": ", ".join(log.extra)} if log.extra else {})


def _sampling(s: Sampling) -> str:
    interval, shortest, longest = (f"{value_s:.3g} s" for value_s in (s.median_s, s.shortest_s, s.longest_s))
    spread = "" if shortest == longest else f", {shortest} to {longest}"
    return f"every {interval}{spread}; {counted(s.gaps, 'gap') if s.gaps else 'no gaps'}"


def contents(log: Log, found: Findings[Survey]) -> dict[str, str]:
    """The figures of a log with their units, by name."""
    s = found.survey
    rows = {
        "sampling": _sampling(s.sampling),
        "current": f"{_range(s.current)} A; > 0 charges",
        "voltage": f"{_range(s.voltage)} V",
        "temperature": f"{_range(s.temperature)} degC" if s.temperature else "not recorded",
        "noise": f"{1e3 * s.current.noise_std:.3g} mA, {1e3 * s.voltage.noise_std:.3g} mV",
        "resolution": f"{1e3 * s.current.resolution:.3g} mA, {1e3 * s.voltage.resolution:.3g} mV",
        "charge": f"{s.activity.charge_in_Ah:.4g} Ah in, {s.activity.charge_out_Ah:.4g} Ah out",
        "activity": f"{s.activity.rests} rests, {s.activity.pulses} pulses between rests",
        "at rest": quantity(s.activity.rest_current_A, "mA", 1e3),
        "edges": f"{s.sign.edges} of the current; dV/dI = {quantity(s.sign.resistance_ohm, 'mohm', 1e3)}",
    }
    return rows | ({"also": ", ".join(log.extra)} if log.extra else {})


def _range(signal: Signal) -> str:
    low, high = f"{signal.minimum:.5g}", f"{signal.maximum:.5g}"
    return low if low == high else f"{low} to {high}"


def examine_battery(path: str, _: GivenFiles) -> Iterator[Part]:
    """Contents of a battery file, with the SoC bands of the present file and of one after each worthwhile test."""
    battery = load_battery(path)
    bands = band_forecast.forecast(battery)
    tests = band_forecast.worthwhile_tests(battery, bands)
    rows = [["as the file is", *map(_cell, bands)]]
    rows += [[f"at best, {test.test}", *map(_cell, test.bands)] for test in tests]
    text = paragraphs(
        f"{path}: battery {battery.name!r}, {quantity(battery.capacity_Ah, 'Ah')}, "
        f"{battery.chemistry or 'chemistry not said'}, {battery.n_series} in series",
        fields(sources(battery)),
        bullets("Not known", battery.not_identified),
        f"{table(BANDS, rows)}\n({READING})",
    )
    summary = {
        "path": path,
        "name": battery.name,
        "chemistry": battery.chemistry,
        "capacity_Ah": battery.capacity_Ah,
        "not_identified": battery.not_identified,
        "bands": bands,
        "tests": tests,
    }

    def section(page: Page) -> Page:
        page = page.table(["Quantity", "Found"], list(sources(battery).items()))
        page = page.table(["Not known"], [[text] for text in battery.not_identified])
        return page.table(BANDS, rows, sentence(READING))

    yield Part("batteries", battery.name, text, summary, [f"ohmward soc LOG --battery {path}"], section=section)


def sources(battery: Battery) -> dict[str, str]:
    """Provenance of the numbers of a battery."""
    known = battery.identification
    logs = [f"{fit.log} ({fit.test}, SoC {_soc_range(fit)})" for fit in known.logs] if known else []
    idle = battery.idle_current_A
    exact = band_forecast.taken_as_exact(battery)
    learnt = battery.knowledge.logs if battery.knowledge else ()
    voltage_gain = battery.noise.voltage_gain_std
    rows = {
        "tests": "; ".join(logs) or "none",
        "learnt from": f"{counted(len(learnt), 'log')}, {sum(log.hours for log in learnt):.1f} h" if learnt else "none",
        "model": f"thevenin-{battery.thevenin.pairs}rc",
        "capacity": capacity_uncertainty(battery.noise),
        "rest current": "not declared" if idle is None else f"{idle:g} A",
        "current sensor": f"offset ± {BAND_95 * battery.sensor.offset_std_A:.2g} A, "
        f"gain ± {100 * BAND_95 * battery.sensor.gain_std:.2g} % (95 %)",
        "voltage sensor": f"gain ± {100 * BAND_95 * voltage_gain:.2g} % (95 %)" if voltage_gain else "that of the test",
    }
    return rows | ({"assumed exact": f"{', '.join(exact)}: 0 in [noise]"} if exact else {})


def capacity_uncertainty(noise: BatteryNoise) -> str:
    """Uncertainty of the capacity on the day of the last log, a year later, and in a log without a date."""

    def within(std: float) -> str:
        return f"± {100 * BAND_95 * std:.2g} %"

    if not noise.capacity_known_unix_s:
        return f"known within {within(noise.capacity_std)} (95 %)"
    day = datetime.fromtimestamp(noise.capacity_known_unix_s, UTC).date()
    later = noise.on(noise.capacity_known_unix_s + timedelta(days=AGED_AFTER_DAYS).total_seconds())
    return (
        f"known within {within(noise.capacity_known_std)} on {day}, {within(later.capacity_std)} a year later, "
        f"{within(noise.capacity_std)} in a log without a date (95 %)"
    )


def _soc_range(fit: LogFit) -> str:
    low, high = (round(100 * min(max(soc, 0.0), 1.0)) for soc in (fit.soc_min, fit.soc_max))
    return f"{low} to {high} %"


def _cell(band: band_forecast.BandForecast) -> str:
    return f"± {band.known_start:.1f} / {band.unknown_start:.1f}"


def make_page(parts: Sequence[Part]) -> Page:
    """One section for each log, battery file and drive: figures, findings, plots, assumptions."""
    sections = [(part.section, part) for part in parts if part.section]
    kinds = [part.kind for _, part in sections]
    names = [part.name.removesuffix(", drive") for _, part in sections]
    title = names[0] if len(names) == 1 else f"{len(names)} {'files' if 'batteries' in kinds else 'logs'}"
    page = Page(title, "What is in it, what is wrong, what was assumed")
    for section, part in sorted(sections, key=lambda one: one[1].kind == "drives"):
        page = section(page if len(names) == 1 else page.heading(part.name))
    return page


def _with_findings(page: Page, found: Findings) -> Page:
    for finding in found.findings:
        page = page.callout(finding.severity, f"{sentence(finding.text)}\n\n{sentence(finding.advice)}")
    return page


def _drive_section(log: DriveLog, found: Findings[DriveSurvey], page: Page) -> Page:
    page = _with_findings(page, found)
    page = page.plot(wheels_figure(log, list(found.survey.wheels)), clock=wall_clock(log))
    page = page.table(["Quantity", "Found"], list(drive_contents(log, found).items()))
    return with_assumptions(page, found.notes)


def _section(log: Log, found: Findings[Survey], page: Page) -> Page:
    s = found.survey
    figures = {
        "Samples": f"{len(log):,}",
        "Duration": duration(log.duration_s),
        "Interval": f"{s.sampling.median_s:.3g} s",
        "Charge in": f"{s.activity.charge_in_Ah:.4g} Ah",
        "Charge out": f"{s.activity.charge_out_Ah:.4g} Ah",
        "Rests": str(s.activity.rests),
        "Pulses": str(s.activity.pulses),
    }
    page = _with_findings(page.numbers(figures), found)
    intervals = [pictures.interval_figure(log)] if len(log) > 1 else []
    page = page.plot(*pictures.log_figures(log), *intervals, clock=wall_clock(log))
    page = page.table(["Quantity", "Found"], list(contents(log, found).items()))
    return with_assumptions(page, found.notes)


#: Function that examines each kind of file.
_EXAMINED: dict[str, Callable[[str, GivenFiles], Iterator[Part]]] = {
    _LOG: examine_log,
    BATTERY_FILE.noun: examine_battery,
    ROBOT_FILE.noun: examine_robot,
    SETUP_FILE.noun: examine_setup,
}
