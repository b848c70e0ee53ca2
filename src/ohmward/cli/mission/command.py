"""`ohmward mission`: energy of a drive, consumption on each ground, range, and the forecast of a plan."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from ohmward.cli import wording
from ohmward.cli.battery_inputs import load_battery_with_sensor, read_battery_log
from ohmward.cli.drive_inputs import make_terrain, read_drive_log
from ohmward.cli.options import DEFAULT_TERRAIN, file_hints
from ohmward.cli.outcome import Outcome, check_output
from ohmward.cli.parser import split_selection
from ohmward.cli.progress import counting, progress
from ohmward.cli.wording import FOOTER, duration, percent, quantity, with_assumptions
from ohmward.energy import (
    BatteryState,
    Consumption,
    MissionForecast,
    Range,
    load_consumption,
    prior_from_mass,
    prior_from_robot,
    save_consumption,
    start,
)
from ohmward.energy.consumption_figures import (
    TerrainFigures,
    expected_J_per_m,
    record_figures,
    terrain_figures,
    usual_speed_m_s,
)
from ohmward.energy.drive_record import DriveRecord, RecordedBalance
from ohmward.energy.mission import MissionResult, MissionSettings, analyse
from ohmward.energy.plan_file import EXAMPLE, load_plan
from ohmward.errors import InputError
from ohmward.figures.parts import wall_clock
from ohmward.logs import DriveLog, Log, Note
from ohmward.logs.clock import date_column, nanosecond_column, read_clock
from ohmward.logs.columns import find_columns
from ohmward.logs.read import open_table
from ohmward.logs.selection import select_rows
from ohmward.logs.table import TableFile
from ohmward.report import TIME, Band, Figure, Marker, Page, Series
from ohmward.report.palette import Meaning
from ohmward.traction import Robot, load_robot
from ohmward.traction.friction.terrain import ADHESION, ROADS, SOILS


def run(args: argparse.Namespace) -> Outcome:
    """Learn from the log, look ahead, write the table."""
    if args.plan_example:
        return Outcome({"command": "mission", "plan_example": EXAMPLE}, EXAMPLE.rstrip("\n"))
    check_output("--output", args.output, (".toml",), [p for p in (args.log, args.plan, args.battery) if p])
    check(args)
    battery, contradictions = load_battery_with_sensor(args.battery, args)
    robot = load_robot(args.robot) if args.robot else None
    plan = load_plan(args.plan) if args.plan else None
    before, origin = earlier_consumption(args, robot)
    log, drive, ground = read_logs(args, robot)
    settings = settings_of(args, robot)
    with progress() as report:
        told = counting(report, "ukf") if drive else None
        result = analyse(
            battery, before, log, drive=drive, robot=robot, ground=ground, plan=plan, settings=settings, progress=told
        )
    if args.output:
        save_consumption(result.consumption, args.output)
    warnings = [f"warning: {text}" for text in contradictions]
    figures = summary(result, robot, [origin, *warnings, *map(str, result.notes)])
    written = {"output": args.output, "report": args.report}
    return Outcome(figures | written, describe(figures), figures["notes"], partial(make_page, result, figures))


TERRAINS = ["terrain", "drives", "driven", "measured", "cost of transport", "level, another day, P10-P90", "resistance"]


def summary(result: MissionResult, robot: Robot | None, notes: Sequence[str]) -> dict[str, Any]:
    """The object of --json.

    notes: everything that was assumed.
    """
    c = result.consumption
    record = result.record
    forecast = result.forecast
    return {
        "command": "mission",
        "log": record.log.name if record else None,
        "battery": result.battery.name,
        "robot": robot.name if robot else None,
        "drive": record_figures(record, c)._asdict() if record else None,
        "terrains": {name: _terrain(terrain_figures(c, name)) for name in c.terrains},
        "idle_W": float(c.mean[0]),
        "idle_std_W": float(c.cov[0, 0] ** 0.5),
        "soc": result.state.soc,
        "soc_std": result.state.soc_std,
        "reserve_soc": result.state.reserve_soc,
        **_range(result.range),
        "probability": forecast.probability if forecast else None,
        "plan": _plan(forecast) if forecast else None,
        "advice": {name: advice._asdict() for name, advice in result.advice.items()},
        "notes": list(notes),
    }


def _terrain(figures: TerrainFigures) -> dict[str, Any]:
    expected = {name: getattr(figures, name)._asdict() for name in ("expected_J_per_m", "expected_cost_of_transport")}
    return figures._asdict() | expected


def _range(left: Range) -> dict[str, Any]:
    return {
        "usable_J": left.usable_J._asdict(),
        "range_m": left.distance_m._asdict(),
        "time_left_s": left.time_s._asdict(),
        "energy_J_per_m": left.energy_J_per_m._asdict(),
        "power_W": left.power_W,
    }


def _plan(forecast: MissionForecast) -> dict[str, Any]:
    milestones = [m._asdict() | {"energy_J": m.energy_J._asdict(), "soc": m.soc._asdict()} for m in forecast.milestones]
    last = milestones[-1]
    return {
        "distance_m": last["distance_m"],
        "time_s": last["time_s"],
        "energy_J": last["energy_J"],
        "probability": forecast.probability,
        "point_of_return_m": forecast.point_of_return_m,
        "milestones": milestones,
    }


def describe(figures: Mapping[str, Any]) -> str:
    """Text for people."""
    return wording.paragraphs(
        _title(figures),
        wording.fields(result(figures)),
        _split_text(figures["drive"]),
        wording.table(TERRAINS, terrain_rows(figures)) if figures["terrains"] else "",
        _plan_text(figures["plan"]),
        wording.bullets("Advice", advice_lines(figures)),
        wording.assumptions(figures["notes"]),
    )


def _title(figures: Mapping[str, Any]) -> str:
    what = figures["log"] or "plan"
    return f"{what} with battery {figures['battery']!r}" + (f", robot {figures['robot']!r}" if figures["robot"] else "")


def result(figures: Mapping[str, Any]) -> dict[str, str]:
    """The key figures with their units, by name."""
    rows = {
        "SoC": f"{wording.percent(figures['soc'], 1)}, std {wording.percent(figures['soc_std'], 1)}; "
        f"{wording.percent(figures['reserve_soc'], 0)} is the reserve",
        "usable energy": band(figures["usable_J"], "Wh", 1 / 3600.0),
        "range left": band(figures["range_m"], "m"),
        "time left": " / ".join(wording.duration(t) for t in figures["time_left_s"].values()) + "  (P10 / P50 / P90)",
        "energy ahead": band(figures["energy_J_per_m"], "J/m"),
        "idle power": f"{figures['idle_W']:.3g} W, std {figures['idle_std_W']:.2g} W",
    }
    if drive := figures["drive"]:
        per_metre = wording.quantity(drive["energy_J_per_m"], "J/m")
        rows = {
            "drive": f"{wording.quantity(drive['distance_m'], 'm', digits=4)} in {wording.duration(drive['used_s'])}, "
            f"{drive['energy_J'] / 3600.0:.3g} Wh, {per_metre}, cost of transport "
            f"{wording.quantity(drive['cost_of_transport'], '')}",
            **rows,
        }
    return rows


def band(values: Mapping[str, float], unit: str, scale: float = 1.0) -> str:
    """P10 / P50 / P90 with their unit."""
    return " / ".join(f"{float(f'{scale * v:.3g}'):g}" for v in values.values()) + f" {unit}  (P10 / P50 / P90)"


def terrain_rows(figures: Mapping[str, Any]) -> list[list[str]]:
    """One row for each ground."""
    return [
        [
            name,
            str(t["drives"]),
            f"{t['distance_m']:.4g} m",
            wording.quantity(t["energy_J_per_m"], "J/m"),
            wording.quantity(t["cost_of_transport"], "").strip(),
            f"{t['expected_J_per_m']['p10']:.3g} to {t['expected_J_per_m']['p90']:.3g} J/m",
            f"{t['force_N']:.3g} N, std {t['force_std_N']:.2g} N",
        ]
        for name, t in figures["terrains"].items()
    ]


def split_rows(drive: Mapping[str, Any]) -> list[list[str]]:
    """Terms of the energy balance of the drive, one row each."""
    parts = drive["split_J"] or {}
    whole = parts.get("battery")
    return [
        [
            name,
            f"{value / 3600.0:.3f} Wh",
            wording.percent(value / whole, 1) if whole else "-",
            f"± {drive['split_std_J'][name] / 3600.0:.2g} Wh" if name in drive["split_std_J"] else "",
        ]
        for name, value in parts.items()
    ]


def _split_text(drive: Mapping[str, Any] | None) -> str:
    if not drive or not drive["split_J"]:
        return ""
    return wording.table(["energy", "", "share", "std, at most"], split_rows(drive))


def _plan_text(plan: Mapping[str, Any] | None) -> str:
    if plan is None:
        return ""
    lines = {
        "plan": f"{plan['distance_m']:.4g} m in {wording.duration(plan['time_s'])}",
        "energy": band(plan["energy_J"], "Wh", 1 / 3600.0),
        "SoC at the end": " / ".join(wording.percent(v, 1) for v in plan["milestones"][-1]["soc"].values()),
        "probability": f"{wording.percent(plan['probability'], 1)} to finish with the reserve left",
        "point of return": f"{plan['point_of_return_m']:.4g} m along the plan, for the way back over the same ground",
    }
    return wording.fields(lines)


def advice_lines(figures: Mapping[str, Any]) -> list[str]:
    """A sentence or two for each ground."""
    lines = []
    for name, a in figures["advice"].items():
        saved = f"{a['saving_J_per_m']:.2g} ± {a['saving_std_J_per_m']:.1g} J/m"
        sure = a["saving_J_per_m"] > 2 * a["saving_std_J_per_m"]
        text = f"{name}: least energy per metre at {a['speed_m_s']:.2g} m/s, saves {saved} against the present speed"
        text += "" if sure else "; that is not certain"
        text += "; faster or slower may save more" if a["at_limit"] else ""
        lines.append(text)
        if a["idle_dominates"]:
            lines.append(f"{name}: idle power dominates, {wording.percent(a['idle_share'], 0)} of the energy per metre")
    return lines


#: Kinds of --column and --unit that are the battery's; all others, and the time, are the drive's.
BATTERY_KINDS = ("time", "current", "voltage", "temperature")
#: Column with the name of the ground under each sample.
TERRAIN_COLUMN = "terrain"

Ground = str | np.ndarray


def check(args: argparse.Namespace) -> None:
    """Refuse what cannot work before anything is read.

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
        raise InputError("nothing is known of the robot: give --robot, --consumption or --mass-kg")
    if args.payload_kg < 0:
        raise InputError(f"--payload-kg must be >= 0, got {args.payload_kg:g}")


def settings_of(args: argparse.Namespace, robot: Robot | None) -> MissionSettings:
    """Settings of the analysis."""
    named = args.terrain if args.terrain in {*ADHESION, *ROADS, *SOILS} else DEFAULT_TERRAIN
    return MissionSettings(
        soc=args.soc,
        soc_std=args.soc_std,
        initial_soc=args.initial_soc,
        initial_soc_std=args.initial_soc_std,
        filter=args.filter,
        reserve_soc=args.reserve_soc,
        cutoff_V=args.cutoff_v,
        payload_kg=args.payload_kg,
        speed_column=_speed_column(args),
        believed=make_terrain(named, robot) if robot else None,
        confidence=args.confidence,
    )


def earlier_consumption(args: argparse.Namespace, robot: Robot | None) -> tuple[Consumption, str]:
    """Consumption as known before, and its origin."""
    if args.consumption:
        c = load_consumption(args.consumption)
        return c, f"info: consumption from {args.consumption}: {', '.join(c.terrains) or 'no terrain yet'}"
    if robot:
        return start(prior_from_robot(robot)), f"info: consumption expected from the data of {robot.name!r}: broad"
    expected = start(prior_from_mass(args.mass_kg))
    return expected, f"info: consumption expected from a mass of {args.mass_kg:g} kg: broad"


def read_logs(args: argparse.Namespace, robot: Robot | None) -> tuple[Log | None, DriveLog | None, Ground]:
    """Logs of battery and wheels and the ground, all from one file that is read once."""
    if args.log is None:
        return None, None, args.terrain
    file = open_table(split_selection(args.log)[0], file_hints(args)).read_once()
    log, ground = read_battery(args, file)
    return log, read_wheels(args, file, robot, log), ground


def read_battery(args: argparse.Namespace, file: TableFile) -> tuple[Log, Ground]:
    """The battery's log with all further columns, and the ground under its samples."""
    log = read_battery_log(args.log, _with_kinds(args, BATTERY_KINDS.__contains__), file=file)
    ground = read_ground(args, file, log)
    if isinstance(ground, str):
        return log.with_notes(Note(f"the whole drive on {ground!r}")), ground
    names = ", ".join(sorted(set(ground)))
    return log.with_notes(Note(f"ground from column {TERRAIN_COLUMN!r}: {names}")), ground


def read_wheels(args: argparse.Namespace, file: TableFile, robot: Robot | None, log: Log) -> DriveLog | None:
    """Wheels and motors in the same file; None where there are none and a speed tells enough."""
    if robot is None:
        return None
    try:
        return read_drive_log(args.log, robot, _with_kinds(args, _is_of_drive), extra=(), file=file)
    except InputError:
        if _speed_column(args) in log.extra:
            return None
        raise


def read_ground(args: argparse.Namespace, file: TableFile, log: Log) -> Ground:
    """Name of the ground under each sample (T,), from a column of the file; else that of --terrain for all."""
    if TERRAIN_COLUMN not in file.names:
        return args.terrain
    battery = _with_kinds(args, BATTERY_KINDS.__contains__)
    time = find_columns(file.source, file.names, dict(battery.column), dict(battery.unit))["time"]
    rows = dict(args.where) | split_selection(args.log)[1]
    beside = nanosecond_column(file.names, time.name), date_column(file, time.name)
    wanted = {time.name, TERRAIN_COLUMN, *rows, *(name or "" for name in beside)}
    table = select_rows(file.load(wanted & set(file.names)), rows)
    clock = read_clock(table, time, file.hints, beside[1])
    time_s = clock.time_s if clock.start_unix_s is None else clock.time_s - np.nanmin(clock.time_s)
    order = np.argsort(time_s, kind="stable")
    names = np.array([_name(cell, args.terrain) for cell in table.columns[TERRAIN_COLUMN]], dtype=object)[order]
    return names[np.maximum(np.searchsorted(time_s[order], log.time_s, side="right") - 1, 0)]


def _name(cell: object, otherwise: str) -> str:
    """The name in a cell, or another where it is empty."""
    text = str(cell).strip()
    return otherwise if text.lower() in ("", "nan", "none") else text


def _is_of_drive(kind: str) -> bool:
    return kind == "time" or kind not in BATTERY_KINDS


def _with_kinds(args: argparse.Namespace, wanted: Callable[[str], bool]) -> argparse.Namespace:
    """The arguments with those columns and units only whose kind is wanted."""
    chosen = vars(args).copy()
    for option in ("column", "unit"):
        chosen[option] = [(kind, value) for kind, value in chosen[option] if wanted(kind)]
    return argparse.Namespace(**chosen)


def _speed_column(args: argparse.Namespace) -> str:
    return dict(args.column).get("speed", "speed_m_s")


#: Parts of the power that lie on each other in the picture, and their colours.
_STACK: dict[str, tuple[tuple[str, ...], Meaning]] = {
    "idle": (("idle",), "background"),
    "windings and gears": (("copper", "drive"), "comparison"),
    "slip": (("slip",), "alert"),
    "rolling": (("rolling",), "estimate"),
}
_SMOOTH_S = 2.0
_MOST_TERRAINS = 6
_SPEEDS = 25
#: Shorter stretches are starts and stops: their energy per metre says nothing.
_SHORTEST_SHOWN_M = 5.0


def make_page(found: MissionResult, figures: Mapping[str, Any]) -> Page:
    """Key figures, the plan, the energy balance, consumption on each ground, assumptions.

    figures: summary of the mission.
    """
    page = Page(figures["log"] or "Mission", _subtitle(figures), FOOTER).numbers(_numbers(figures))
    if found.forecast:
        page = page.heading("Plan").plot(*plan_figures(found.forecast, found.state))
        page = page.table(["leg", "distance", "time", "SoC, P10-P90", "probability"], _milestones(figures["plan"]))
    if found.record:
        page = _recorded(page, found.record, figures)
    page = _grounds(page, found, figures)
    page = page.heading("Result").table(["Quantity", "Value"], list(result(figures).items()))
    return with_assumptions(page, figures["notes"])


def plan_figures(forecast: MissionForecast, state: BatteryState) -> list[Figure]:
    """State of charge, energy and probability along the plan."""
    m = forecast.milestones
    x = np.array([0.0, *(one.distance_m for one in m)])
    soc = 100 * np.array([[state.soc - 1.2816 * state.soc_std, state.soc, state.soc + 1.2816 * state.soc_std]])
    soc = np.vstack([soc, *(100 * np.array(one.soc) for one in m)]).clip(0.0, 100.0)
    energy = np.vstack([np.zeros(3), *(np.array(one.energy_J) / 3600.0 for one in m)])
    probability = 100 * np.array([1.0, *(one.probability for one in m)])
    turn = [Marker(forecast.point_of_return_m, "latest point of return", "alert")]
    reserve = Series(x, np.full(len(x), 100 * state.reserve_soc), "reserve", "dashed", "reference")
    label = "Distance [m]"
    return [
        Figure("State of charge", label, "State of charge [%]", [_line(x, soc), reserve], [_band(x, soc)], turn),
        Figure("Energy", label, "Energy [Wh]", [_line(x, energy)], [_band(x, energy)], turn, height_px=200),
        Figure(
            "Probability to get here with the reserve left",
            label,
            "Probability [%]",
            [Series(x, probability, "probability", role="estimate")],
            markers=turn,
            y_limits=(-2.0, 102.0),
            height_px=200,
        ),
    ]


def power_figure(balance: RecordedBalance) -> Figure:
    """Losses on each other, and the battery's power over them."""
    t = balance.time_s
    bands = []
    lower = np.zeros(len(t))
    for label, (names, role) in _STACK.items():
        losses_W = sum(getattr(balance.power, name) for name in names)
        upper = lower + np.maximum(_smooth(t, losses_W), 0.0)
        bands.append(Band(t, lower, upper, label, role))
        lower = upper
    line = Series(t, _smooth(t, balance.power.battery), "battery", role="reference")
    title = "Power: losses on each other; what is left to the battery's line climbs, accelerates or is unexplained"
    return Figure(title, TIME, "Power [W]", [line], bands, height_px=320)


def speed_figure(record: DriveRecord) -> Figure:
    """Speed and power of the battery, where no split is known."""
    t = record.log.time_s
    series = [
        Series(t, record.battery_W, "battery", role="reference"),
        Series(t, record.speed_m_s, "speed", role="estimate", axis="right"),
    ]
    return Figure("Power and speed", TIME, "Power [W]", series, right_label="Speed [m/s]")


def terrain_figure(c: Consumption, name: str, record: DriveRecord | None) -> Figure:
    """Energy per metre over speed: what another day may take, and the stretches of this one."""
    usual = usual_speed_m_s(c, name)
    speeds = np.linspace(0.4 * usual, 2.0 * usual, _SPEEDS)
    expected = np.array([expected_J_per_m(c, name, float(v)) for v in speeds])
    series = [_line(speeds, expected)]
    there = [d for d in record.driven if d.stretch.terrain == name] if record else []
    if there := [d for d in there if d.stretch.distance_m > _SHORTEST_SHOWN_M]:
        v = np.array([d.stretch.speed_distance_m2_s / d.stretch.distance_m for d in there])
        points = np.array([d.energy_J / d.stretch.distance_m for d in there])
        series.append(Series(v, points, "stretches of this drive", "points", "comparison"))
    return Figure(f"On {name}", "Speed [m/s]", "Energy per metre [J/m]", series, [_band(speeds, expected)])


def _subtitle(figures: Mapping[str, Any]) -> str:
    robot = f", robot {figures['robot']!r}" if figures["robot"] else ""
    return f"Energy, range and the way home; battery {figures['battery']!r}{robot}"


def _numbers(figures: Mapping[str, Any]) -> dict[str, str]:
    reach = figures["range_m"]
    numbers = {
        "Range left, P50": quantity(reach["p50"], "m"),
        "with 90 % probability": quantity(reach["p10"], "m"),
        "Time left, P50": duration(figures["time_left_s"]["p50"]),
        "SoC now": percent(figures["soc"], 1),
    }
    if drive := figures["drive"]:
        numbers["Energy per metre"] = quantity(drive["energy_J_per_m"], "J/m")
    if figures["plan"]:
        numbers["Plan with the reserve left"] = percent(figures["probability"], 1)
    return {label: value for label, value in numbers.items() if value != "-"}


def _milestones(plan: Mapping[str, Any]) -> list[list[str]]:
    return [
        [
            str(k),
            f"{m['distance_m']:.4g} m",
            duration(m["time_s"]),
            f"{percent(m['soc']['p10'], 1)} to {percent(m['soc']['p90'], 1)}",
            percent(m["probability"], 1),
        ]
        for k, m in enumerate(plan["milestones"], start=1)
    ]


def _recorded(page: Page, record: DriveRecord, figures: Mapping[str, Any]) -> Page:
    page = page.heading("Where the energy went")
    clock = wall_clock(record.log)
    if record.balance is None:
        return page.plot(speed_figure(record), clock=clock)
    page = page.plot(power_figure(record.balance), speed_figure(record), clock=clock)
    return page.table(["Part", "Energy", "Share", "Std, at most"], split_rows(figures["drive"]))


def _grounds(page: Page, found: MissionResult, figures: Mapping[str, Any]) -> Page:
    c = found.consumption
    if not c.terrains:
        return page
    page = page.heading("What the ground takes").table(TERRAINS, terrain_rows(figures))
    for name in c.terrains[:_MOST_TERRAINS]:
        page = page.plot(terrain_figure(c, name, found.record))
    for line in advice_lines(figures):
        page = page.callout("info", line)
    return page


def _line(x: np.ndarray, quantiles: np.ndarray) -> Series:
    return Series(x, quantiles[:, 1], "P50", role="estimate")


def _band(x: np.ndarray, quantiles: np.ndarray) -> Band:
    return Band(x, quantiles[:, 0], quantiles[:, 2], "P10-P90")


def _smooth(time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
    """A running mean over two seconds: the parts of single samples are noise."""
    width = max(round(_SMOOTH_S / max(float(np.median(np.diff(time_s))), 1e-9)), 1)
    known = np.nan_to_num(np.asarray(values, dtype=float))
    return np.convolve(np.pad(known, width // 2, mode="edge"), np.full(width, 1 / width), mode="same")[
        width // 2 : width // 2 + len(known)
    ]
