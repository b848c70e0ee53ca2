"""`ohmward mission`: energy of a drive, consumption on each ground, range, and the forecast of a plan."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from ohmward import energy
from ohmward.battery.battery import Battery
from ohmward.cli.battery_inputs import load_with_sensor, of_kinds, read_battery_log, read_options
from ohmward.cli.drive_inputs import DriveOptions, drive_options
from ohmward.cli.options import DEFAULT_TERRAIN
from ohmward.cli.outcome import Outcome, check_output, counting, progress
from ohmward.cli.wording import bullets, fields, known_rows, paragraphs, table
from ohmward.energy.drive_record import RecordFigures, record_figures, terrain_figures
from ohmward.energy.mission import EXAMPLE, PLAN_FILE, MissionResult, MissionSettings, analyse
from ohmward.energy.points import Quantiles
from ohmward.energy.range import summary_of
from ohmward.errors import InputError
from ohmward.figures import mission as pictures
from ohmward.figures.numbers import normal, percent, percent_band, quantity
from ohmward.figures.parts import wall_clock
from ohmward.filters.consistency import BAND_95
from ohmward.logs import DriveLog, Log, Note
from ohmward.logs.clock import date_column, read_clock
from ohmward.logs.columns import find_columns, fraction_column
from ohmward.logs.log import ReadOptions
from ohmward.logs.read import open_table
from ohmward.logs.selection import select_rows, split_selection
from ohmward.logs.table import TableFile
from ohmward.quantities import SECONDS_PER_HOUR
from ohmward.report import Page
from ohmward.runs import duration
from ohmward.traction import Robot, load_robot
from ohmward.traction.friction.terrain import ADHESION, ROADS, SOILS, terrain_named

#: Columns of the table of grounds.
TERRAINS = [
    "terrain", "drives", "driven", "measured", "cost of transport", "level, another day, P10-P90", "resistance, 95 %",
]  # fmt: skip
#: Largest number of grounds that are drawn.
_MOST_TERRAINS = 6
#: Column with the name of the ground under each sample, in any case.
TERRAIN_COLUMN = "terrain"

Ground = str | np.ndarray


def run(args: argparse.Namespace) -> Outcome:
    """Learn from the log, forecast the plan, write the table of consumption."""
    if args.plan_example:
        return Outcome({"command": "mission", "plan_example": EXAMPLE}, EXAMPLE.rstrip("\n"))
    check_output("--output", args.output, (".toml",), [p for p in (args.log, args.plan, args.battery) if p])
    check(args)
    battery, warnings = load_with_sensor(args.battery, args)
    robot = load_robot(args.robot) if args.robot else None
    plan = PLAN_FILE.load(args.plan) if args.plan else None
    before, origin = earlier_consumption(args.consumption, args.mass_kg, robot)
    log, drive, ground, reading = None, None, args.terrain, read_options(args)
    if args.log is not None:
        drives = drive_options(args, robot) if robot else None
        log, drive, ground = MissionReader(args.log, reading, drives, args.terrain, battery).read()
    named = args.terrain if args.terrain in {*ADHESION, *ROADS, *SOILS} else DEFAULT_TERRAIN
    settings = MissionSettings(
        soc=args.soc,
        soc_std=args.soc_std,
        initial_soc=args.initial_soc,
        initial_soc_std=args.initial_soc_std,
        filter=args.filter,
        reserve_soc=args.reserve_soc,
        cutoff_V=args.cutoff_v,
        payload_kg=args.payload_kg,
        speed_column=speed_column(reading),
        speed_unit=dict(reading.units).get("speed"),
        terrain=terrain_named(named, robot.wheel) if robot else None,
        confidence=args.confidence,
    )
    with progress() as report:
        tick = counting(report, "ukf") if drive else None
        result = analyse(
            battery, before, log, drive=drive, robot=robot, ground=ground, plan=plan, settings=settings, progress=tick
        )
    if args.output:
        energy.save_consumption(result.consumption, args.output)
    notes = [origin, *warnings, *map(str, result.notes)]
    figures = summary(result, robot, notes) | {"output": args.output, "report": args.report}
    return Outcome(figures, describe(figures), notes, partial(make_page, result, figures))


def check(args: argparse.Namespace) -> None:
    """Refuse options that cannot work, before anything is read.

    Raises:
        InputError: neither a log nor a plan, no battery, nothing known of the robot, no state of charge.
    """
    if args.log is None and args.plan is None:
        raise InputError("nothing to do: give a LOG, or --plan FILE.toml (--plan-example prints one)")
    if args.battery is None:
        raise InputError("--battery FILE.toml is needed; `ohmward identify` or `ohmward generic` makes one")
    if args.log is None and args.soc is None:
        raise InputError("--soc S is needed with a plan alone: the state of charge now, 0 to 1")
    if not (args.robot or args.consumption or args.mass_kg):
        raise InputError("the robot is unknown: give --robot, --consumption or --mass-kg")
    if args.payload_kg < 0:
        raise InputError(f"--payload-kg must be >= 0, got {args.payload_kg:g}")


def earlier_consumption(path: str | None, mass_kg: float, robot: Robot | None) -> tuple[energy.Consumption, str]:
    """Prior consumption and its origin: a file, else the robot, else a mass."""
    if path:
        c = energy.load_consumption(path)
        return c, f"info: consumption from {path}: {', '.join(c.terrains) or 'no terrain yet'}"
    prior = energy.prior_from_robot(robot) if robot else energy.prior_from_mass(mass_kg)
    source = f"the data of {robot.name!r}" if robot else f"a mass of {mass_kg:g} kg"
    return energy.start(prior), f"info: consumption expected from {source}: broad"


class MissionReader(NamedTuple):
    """Reader of a log of battery, wheels and ground, all in one file."""

    text: str  #: the log as named on the command line
    reading: ReadOptions
    drive: DriveOptions | None  #: None without a robot
    ground: str  #: assumed where the file does not name it
    battery: Battery  #: of the log

    def read(self) -> tuple[Log, DriveLog | None, Ground]:
        """Logs of battery and wheels, and the ground; the file is read once."""
        file = open_table(split_selection(self.text)[0], self.reading.hints).read_once()
        log = read_battery_log(self.text, of_kinds(self.reading, of_battery=True), file=file, battery=self.battery)
        drive_of_log = self.read_wheels(file, log)
        if not (column := next((name for name in file.names if name.strip().lower() == TERRAIN_COLUMN), "")):
            return log.with_notes(Note(f"the whole drive on {self.ground!r}")), drive_of_log, self.ground
        ground = self.read_ground(file, log, column)
        names = ", ".join(sorted(set(ground)))
        return log.with_notes(Note(f"ground from column {column!r}: {names}")), drive_of_log, ground

    def read_wheels(self, file: TableFile, log: Log) -> DriveLog | None:
        """Wheels and motors in the same file; None without a robot, or if the file has a speed instead."""
        if self.drive is None:
            return None
        try:
            of_wheels = of_kinds(self.reading, of_battery=False)
            return self.drive._replace(reading=of_wheels).read(self.text, extra=(), file=file)
        except InputError:
            if speed_column(self.reading) in log.extra:
                return None
            raise

    def read_ground(self, file: TableFile, log: Log, column: str) -> np.ndarray:
        """(T,) name of the ground under each sample, from a column of the file."""
        battery = of_kinds(self.reading, of_battery=True)
        time = find_columns(file.source, file.names, dict(battery.columns), dict(battery.units))["time"]
        rows = dict(battery.where) | split_selection(self.text)[1]
        date = date_column(file, time.name)
        fraction = fraction_column(file.names, time.name)
        wanted = {time.name, column, *rows, date or "", fraction[0] if fraction else ""}
        chosen = select_rows(file.load(wanted & set(file.names)), rows)
        clock = read_clock(chosen, time, file.hints, date)
        time_s = clock.time_s if clock.start_unix_s is None else clock.time_s - np.nanmin(clock.time_s)
        order = np.argsort(time_s, kind="stable")
        cells = [str(cell).strip() for cell in chosen.columns[column]]
        named = [self.ground if cell.lower() in ("", "nan", "none") else cell for cell in cells]
        names = np.array(named, dtype=object)[order]
        return names[np.maximum(np.searchsorted(time_s[order], log.time_s, side="right") - 1, 0)]


def speed_column(reading: ReadOptions) -> str:
    """Column of the speed."""
    return dict(reading.columns).get("speed", "speed_m_s")


def summary(result: MissionResult, robot: Robot | None, notes: Sequence[str]) -> dict[str, Any]:
    """The object of --json, but for the files.

    notes: everything that was assumed.
    """
    c, record, forecast, left = result.consumption, result.record, result.forecast, result.range
    return {
        "command": "mission",
        "log": record.log.name if record else None,
        "battery": result.battery.name,
        "robot": robot.name if robot else None,
        "drive": record_figures(record, c) if record else None,
        "terrains": {name: terrain_figures(c, name) for name in c.terrains},
        "idle_W": float(c.mean[0]),
        "idle_std_W": float(c.cov[0, 0] ** 0.5),
        "soc": result.state.soc,
        "soc_std": result.state.soc_std,
        "reserve_soc": result.state.reserve_soc,
        "usable_J": left.usable_J,
        "range_m": left.distance_m,
        "time_left_s": left.time_s,
        "energy_J_per_m": left.energy_J_per_m,
        "power_W": left.power_W,
        "probability": forecast.probability if forecast else None,
        "plan": forecast and summary_of(forecast),
        "advice": result.advice,
        "notes": list(notes),
    }


def describe(f: Mapping[str, Any]) -> str:
    """Text for people.

    f: the summary of the mission, here and in all functions below.
    """
    robot = f", robot {f['robot']!r}" if f["robot"] else ""
    parts = split_rows(f["drive"])
    return paragraphs(
        f"{f['log'] or 'plan'} with battery {f['battery']!r}{robot}",
        fields(result(f)),
        table(["energy", "", "share", "95 %, at most"], parts) if parts else "",
        table(TERRAINS, terrain_rows(f)) if f["terrains"] else "",
        fields(plan_rows(f["plan"])) if f["plan"] else "",
        bullets("Advice", advice_lines(f)),
    )


def result(f: Mapping[str, Any]) -> dict[str, str]:
    """The key figures with their units, by name."""
    rows = {
        "drive": drive_text(f["drive"]) if f["drive"] else "",
        "SoC": f"{percent_band(f['soc'], f['soc_std'])} (95 %); {percent(f['reserve_soc'], 0)} is the reserve",
        "usable energy": quantiles(f["usable_J"], "Wh", 1 / SECONDS_PER_HOUR),
        "range left": quantiles(f["range_m"], "m"),
        "time left": " / ".join(map(duration, f["time_left_s"])) + "  (P10 / P50 / P90)",
        "energy ahead": quantiles(f["energy_J_per_m"], "J/m"),
        "idle power": f"{normal({'mean': f['idle_W'], 'std': f['idle_std_W']}, 'W')} (95 %)",
    }
    return {name: text for name, text in rows.items() if text}


def drive_text(drive: RecordFigures) -> str:
    """Length, duration and energy of a drive."""
    used_Wh = drive.energy_J / SECONDS_PER_HOUR
    driven = f"{quantity(drive.distance_m, 'm', digits=4)} in {duration(drive.used_s)}, {used_Wh:.3g} Wh"
    cost = f"cost of transport {quantity(drive.cost_of_transport, '')}"
    return f"{driven}, {quantity(drive.energy_J_per_m, 'J/m')}, {cost}"


def quantiles(values: Quantiles, unit: str, scale: float = 1.0) -> str:
    """P10 / P50 / P90 with their unit."""
    return " / ".join(f"{float(f'{scale * v:.3g}'):g}" for v in values) + f" {unit}  (P10 / P50 / P90)"


def terrain_rows(f: Mapping[str, Any]) -> list[list[str]]:
    """One row for each ground under `TERRAINS`."""
    return [
        [
            name,
            str(t.drives),
            f"{t.distance_m:.4g} m",
            quantity(t.energy_J_per_m, "J/m"),
            quantity(t.cost_of_transport, ""),
            f"{t.expected_J_per_m.p10:.3g} to {t.expected_J_per_m.p90:.3g} J/m",
            normal({"mean": t.force_N, "std": t.force_std_N}, "N"),
        ]
        for name, t in f["terrains"].items()
    ]


def split_rows(drive: RecordFigures | None) -> list[list[str]]:
    """Terms of the energy balance of the drive, one row each; empty where it is not known."""
    parts, stds = (drive and drive.split_J) or {}, (drive and drive.split_std_J) or {}
    whole = parts.get("battery")
    return [
        [
            name,
            f"{value / SECONDS_PER_HOUR:.3f} Wh",
            percent(value / whole, 1) if whole else "-",
            f"± {BAND_95 * stds[name] / SECONDS_PER_HOUR:.2g} Wh" if name in stds else "",
        ]
        for name, value in parts.items()
    ]


def plan_rows(plan: Mapping[str, Any]) -> dict[str, str]:
    """The figures of the plan with their units, by name."""
    return {
        "plan": f"{plan['distance_m']:.4g} m in {duration(plan['time_s'])}",
        "energy": quantiles(plan["energy_J"], "Wh", 1 / SECONDS_PER_HOUR),
        "SoC at the end": " / ".join(percent(v, 1) for v in plan["milestones"][-1].soc),
        "probability": f"{percent(plan['probability'], 1)} to finish with the reserve left",
        "point of return": f"{plan['point_of_return_m']:.4g} m along the plan, for the way back over the same ground",
    }


def advice_lines(f: Mapping[str, Any]) -> list[str]:
    """A sentence or two for each ground."""
    lines = []
    for name, a in f["advice"].items():
        saved = normal({"mean": a.saving_J_per_m, "std": a.saving_std_J_per_m}, "J/m")
        sure = a.saving_J_per_m > 2 * a.saving_std_J_per_m
        text = f"{name}: least energy per metre at {a.speed_m_s:.2g} m/s, saves {saved} against the present speed"
        text += "" if sure else "; that is not certain"
        text += "; faster or slower may save more" if a.at_limit else ""
        lines.append(text)
        if a.idle_dominates:
            lines.append(f"{name}: idle power dominates, {percent(a.idle_share, 0)} of the energy per metre")
    return lines


def make_page(found: MissionResult, f: Mapping[str, Any]) -> Page:
    """Key figures, the plan, the energy balance, consumption on each ground, assumptions."""
    robot = f", robot {f['robot']!r}" if f["robot"] else ""
    numbers = {
        "Range left, P50": quantity(f["range_m"].p50, "m"),
        "With 90 % probability": quantity(f["range_m"].p10, "m"),
        "Time left, P50": duration(f["time_left_s"].p50),
        "SoC now": percent_band(f["soc"], f["soc_std"]),
        "Energy per metre": quantity(f["drive"].energy_J_per_m, "J/m") if f["drive"] else "",
        "Plan with the reserve left": percent(f["probability"], 1),
    }
    page = Page(f["log"] or "Mission", f"Energy, range and the way home; battery {f['battery']!r}{robot}")
    page = page.numbers(known_rows(numbers))
    if found.forecast:
        rows = [
            [
                str(k),
                f"{m.distance_m:.4g} m",
                duration(m.time_s),
                f"{percent(m.soc.p10, 1)} to {percent(m.soc.p90, 1)}",
                percent(m.probability, 1),
            ]
            for k, m in enumerate(found.forecast.milestones, start=1)
        ]
        page = page.heading("Plan").plot(*pictures.plan_figures(found.forecast, found.state))
        page = page.table(["leg", "distance", "time", "SoC, P10-P90", "probability"], rows)
    if record := found.record:
        plots = [pictures.power_figure(record.balance)] if record.balance else []
        page = page.heading("Where the energy went")
        page = page.plot(*plots, pictures.speed_figure(record), clock=wall_clock(record.log))
        if record.balance:
            page = page.table(["Part", "Energy", "Share", "95 %, at most"], split_rows(f["drive"]))
    if found.consumption.terrains:
        page = page.heading("What the ground takes").table(TERRAINS, terrain_rows(f))
    for name in found.consumption.terrains[:_MOST_TERRAINS]:
        page = page.plot(pictures.terrain_figure(found.consumption, name, found.record))
    for line in advice_lines(f):
        page = page.callout("info", line)
    return page.heading("Result").table(["Quantity", "Value"], list(result(f).items()))
