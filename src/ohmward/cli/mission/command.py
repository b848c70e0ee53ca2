"""`ohmward mission`: where a drive's energy went, what the ground takes, and how far the rest reaches."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any, NamedTuple

from ohmward.cli.driving import BUILT_IN, make_robot
from ohmward.cli.mission.text import describe
from ohmward.cli.outcome import Outcome, check_output
from ohmward.cli.parser import add_command, add_log_options, add_output_options, number, positive, share
from ohmward.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np

    from ohmward.battery.battery import Battery
    from ohmward.cli.mission_log import Recording
    from ohmward.energy import BatteryState, Consumption, MissionForecast, Range, SpeedAdvice, Stretch
    from ohmward.energy.plan_file import Plan
    from ohmward.traction import Robot

_EXAMPLES = """\
  ohmward mission drive.csv --robot robot.toml --battery battery.toml -o table.toml --report drive.html
  ohmward mission day.csv --mass-kg 42 --terrain grass --battery battery.toml --column speed=gnss_speed
  ohmward mission --plan-example > plan.toml
  ohmward mission --plan plan.toml --battery battery.toml --soc 0.6 --soc-std 0.03 --consumption table.toml
"""
DEFAULT_GROUND = "ground"
DEFAULT_RESERVE = 0.1
#: A speed may be advised between these shares of the present one.
_SLOWER, _FASTER = 0.5, 1.5
_SECONDS_PER_DAY = 86400.0


class MissionTask(NamedTuple):
    """Everything that was read.

    consumption: with what the log taught.  charge: at the end of the log, or as given.
    """

    battery: Battery
    robot: Robot | None
    recording: Recording | None
    plan: Plan | None
    consumption: Consumption
    charge: BatteryState
    notes: list[str]


class MissionAnswer(NamedTuple):
    """What was found.

    left: range over ground like that of the log, or of the plan.  advice: by terrain.
    """

    left: Range
    outlook: MissionForecast | None
    advice: dict[str, SpeedAdvice]


def add_parser(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    what = "where a drive's energy went, what the ground takes, how far the rest reaches"
    parser = add_command(commands, "mission", what, _EXAMPLES)
    parser.add_argument("log", metavar="LOG", nargs="?", help="a CSV or Parquet file with battery and speed or wheels")
    parser.add_argument("--battery", metavar="FILE.toml", help="battery file, made by `ohmward identify`")
    parser.add_argument("--plan", metavar="FILE.toml", help="the mission ahead")
    parser.add_argument("--plan-example", action="store_true", help="print a plan with comments, and nothing else")
    robot = parser.add_argument_group("robot and ground")
    robot.add_argument("--robot", metavar="FILE.toml", help=f"robot file, or {' or '.join(BUILT_IN)}")
    robot.add_argument("--mass-kg", type=positive, metavar="M", help="where there is no robot file")
    robot.add_argument(
        "--terrain",
        default=DEFAULT_GROUND,
        metavar="NAME",
        help="ground of the log, where it has no column 'terrain' (default: %(default)s)",
    )
    robot.add_argument("--payload-kg", type=number, default=0.0, metavar="M", help="load during the log (default 0)")
    robot.add_argument("--consumption", metavar="FILE.toml", help="what was learned before; default: from the robot")
    parser.add_argument("-o", "--output", metavar="FILE.toml", help="write what is known after the log")
    _add_battery_options(parser)
    add_log_options(parser)
    drive = parser.add_argument_group("reading wheels")
    drive.add_argument("--motor-shaft", action="store_true", help="wheel speeds are those of the motors")
    drive.add_argument("--counts-per-turn", type=positive, metavar="N", help="of encoders that count")
    add_output_options(parser)
    parser.set_defaults(run=run)


def _add_battery_options(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("battery")
    group.add_argument("--soc", type=share, metavar="S", help="state of charge now; default: estimated from the log")
    group.add_argument("--soc-std", type=positive, default=0.03, metavar="S", help="how sure --soc is (%(default)s)")
    group.add_argument("--initial-soc", type=share, metavar="S", help="at the log's start; default: from the voltage")
    group.add_argument("--initial-soc-std", type=positive, default=0.03, metavar="S", help="(default %(default)s)")
    group.add_argument("--filter", default="ekf", metavar="NAME", help="SoC estimator, see `soc` (default %(default)s)")
    group.add_argument("--reserve-soc", type=share, metavar="S", help="to be left; default: the plan's, else 0.1")
    group.add_argument("--cutoff-v", type=positive, metavar="V", help="voltage at which the robot stops")
    group.add_argument(
        "--confidence", type=share, default=0.95, metavar="P", help="of the latest point of return (%(default)s)"
    )


def run(args: argparse.Namespace) -> Outcome:
    """Learn from the log, look ahead, write the table."""
    if args.plan_example:
        from ohmward.energy.plan_file import EXAMPLE

        return Outcome({"command": "mission", "plan_example": EXAMPLE}, EXAMPLE.rstrip("\n"))
    check_output("--output", args.output, (".toml",), [p for p in (args.log, args.plan, args.battery) if p])
    task = make_task(args)
    answer = look_ahead(task, args.confidence)
    if args.output:
        from ohmward.energy import save_consumption

        save_consumption(task.consumption, args.output)

    def page():
        from ohmward.cli.mission.report import make_page

        return make_page(task, answer)

    figures = summary(task, answer)
    text = describe(figures)
    return Outcome(figures | {"output": args.output, "report": args.report}, text, task.notes, page)


def make_task(args: argparse.Namespace) -> MissionTask:
    """Read what the options name, and learn from the log.

    Raises:
        InputError: neither a log nor a plan, no battery, nothing known of the robot, no state of charge.
    """
    from ohmward.battery.file import load_battery
    from ohmward.energy.plan_file import load_plan

    _check(args)
    battery = load_battery(args.battery)
    robot = make_robot(args.robot) if args.robot else None
    plan = load_plan(args.plan) if args.plan else None
    before, notes = _before(args, robot)
    if args.log is None:
        recording, consumption = None, _new_drive(before, None, notes)
    else:
        from ohmward.cli.mission_log import record

        recording = record(args, battery, robot)
        consumption = _learned(_new_drive(before, recording, notes), recording)
        notes += recording.notes
    consumption = _with_plan(consumption, plan, args, notes)
    charge = _charge(args, battery, plan, recording, notes)
    return MissionTask(battery, robot, recording, plan, consumption, charge, notes)


def _check(args: argparse.Namespace) -> None:
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


def _before(args: argparse.Namespace, robot: Robot | None) -> tuple[Consumption, list[str]]:
    """What was known before, and where from."""
    from ohmward.energy import load_consumption, prior_from_mass, prior_from_robot, start

    if args.consumption:
        c = load_consumption(args.consumption)
        return c, [f"info: consumption from {args.consumption}: {', '.join(c.terrains) or 'no terrain yet'}"]
    if robot:
        return start(prior_from_robot(robot)), [f"info: consumption expected from the data of {robot.name!r}: broad"]
    return start(prior_from_mass(args.mass_kg)), [
        f"info: consumption expected from a mass of {args.mass_kg:g} kg: broad"
    ]


def _new_drive(c: Consumption, recording: Recording | None, notes: list[str]) -> Consumption:
    """A new drive after the days that lie between it and the last, where both had a wall clock."""
    from ohmward.energy import begin_drive

    start_s = recording.log.start_unix_s if recording else None
    if start_s is None or c.last_drive_unix_s is None:
        return begin_drive(c)
    days = max(start_s - c.last_drive_unix_s, 0.0) / _SECONDS_PER_DAY
    notes.append(f"info: {days:.1f} days since the last drive that was learned from")
    return begin_drive(c, days)


def _learned(c: Consumption, recording: Recording) -> Consumption:
    from dataclasses import replace

    from ohmward.cli.mission_log import last_unix_s
    from ohmward.energy import learn

    for d in recording.driven:
        c = learn(c, d.stretch, d.energy_J)
    return replace(c, last_drive_unix_s=last_unix_s(recording.log) or c.last_drive_unix_s)


def _with_plan(c: Consumption, plan: Plan | None, args: argparse.Namespace, notes: list[str]) -> Consumption:
    """With the plan's terrains; one that is new is guessed only where there is no table that it should be in."""
    from ohmward.energy import with_terrain

    for leg in plan.legs if plan else ():
        if leg.terrain not in c.terrains:
            if args.consumption:
                raise InputError(
                    f"{args.plan}: terrain {leg.terrain!r} is not in {args.consumption}, which knows: "
                    f"{', '.join(c.terrains) or 'none yet'}; name one of these, or drive there once and learn it"
                )
            notes.append(f"warning: nobody has driven on {leg.terrain!r}: its resistance is a broad guess")
            c = with_terrain(c, leg.terrain)
    return c


def _charge(
    args: argparse.Namespace, battery: Battery, plan: Plan | None, recording: Recording | None, notes: list[str]
) -> BatteryState:
    """The battery now: as given, else as estimated at the end of the log."""
    import math

    from ohmward.energy import BatteryState

    noise = battery.noise if battery.thevenin else battery.rc_noise
    reserve = plan.reserve_soc if plan and args.reserve_soc is None else args.reserve_soc
    values: dict[str, Any] = {
        "soc": args.soc,
        "soc_std": args.soc_std,
        "capacity_std": noise.capacity_std,
        "resistance_std": noise.resistance_std,
        "temperature_degC": plan.temperature_degC if plan else 25.0,
        "reserve_soc": DEFAULT_RESERVE if reserve is None else reserve,
        "cutoff_V": args.cutoff_v or (plan.cutoff_V if plan else 0.0),
    }
    if recording and recording.soc:
        e = recording.soc
        values |= {"soc": min(max(float(e.soc[-1]), 0.0), 1.0), "soc_std": float(e.soc_std[-1])}
        shares = {"soh_capacity": e.soh_capacity[-1], "resistance_ratio": e.resistance_ratio[-1]}
        values |= {name: float(value) for name, value in shares.items() if math.isfinite(value)}
    if recording and plan is None and recording.log.temperature_degC is not None:
        values["temperature_degC"] = _last_known(recording.log.temperature_degC, 25.0)
    if recording and reserve is None and 0.0 < values["soc"] <= DEFAULT_RESERVE:
        values["reserve_soc"] = 0.0
        notes.append(f"warning: the log ends below the usual reserve of {DEFAULT_RESERVE:.0%}: range is that to empty")
    return BatteryState(**values)


def _last_known(values: np.ndarray, otherwise: float) -> float:
    """The last finite value."""
    known = [v for v in values if v == v]
    return float(known[-1]) if known else otherwise


def look_ahead(task: MissionTask, confidence: float) -> MissionAnswer:
    """Range, the outlook of the plan, and advice for each ground that was or will be driven."""
    from ohmward.energy import get_home, range_left

    ahead = stretches_ahead(task)
    left = range_left(task.consumption, ahead, task.battery, task.charge)
    plan = task.plan
    outlook = get_home(task.consumption, plan.legs, task.battery, task.charge, confidence) if plan else None
    return MissionAnswer(left, outlook, _advice(task.consumption, ahead))


def stretches_ahead(task: MissionTask) -> list[Stretch]:
    """The plan's legs, else ground like that of the log."""
    from ohmward.energy import stretch_of

    if task.plan:
        return [stretch_of(leg) for leg in task.plan.legs]
    assert task.recording is not None
    return [d.stretch for d in task.recording.driven]


def _advice(c: Consumption, ahead: Sequence[Stretch]) -> dict[str, SpeedAdvice]:
    from ohmward.energy import speed_advice

    advice = {}
    for name in sorted({s.terrain for s in ahead if s.distance_m > 0}):
        there = [s for s in ahead if s.terrain == name]
        speed = sum(s.speed_distance_m2_s for s in there) / sum(s.distance_m for s in there)
        advice[name] = speed_advice(c, name, speed, (_SLOWER * speed, _FASTER * speed))
    return advice


def summary(task: MissionTask, answer: MissionAnswer) -> dict[str, Any]:
    """The object of --json."""
    left, outlook, charge = answer.left, answer.outlook, task.charge
    return {
        "command": "mission",
        "log": task.recording.log.name if task.recording else None,
        "battery": task.battery.name,
        "robot": task.robot.name if task.robot else None,
        "drive": _drive(task) if task.recording else None,
        "terrains": {name: _terrain(task.consumption, name) for name in task.consumption.terrains},
        "idle_W": float(task.consumption.mean[0]),
        "idle_std_W": float(task.consumption.cov[0, 0] ** 0.5),
        "soc": charge.soc,
        "soc_std": charge.soc_std,
        "reserve_soc": charge.reserve_soc,
        "usable_J": left.usable_J._asdict(),
        "range_m": left.distance_m._asdict(),
        "time_left_s": left.time_s._asdict(),
        "energy_J_per_m": left.energy_J_per_m._asdict(),
        "power_W": left.power_W,
        "probability": outlook.probability if outlook else None,
        "plan": _plan(outlook) if outlook else None,
        "advice": {name: advice._asdict() for name, advice in answer.advice.items()},
        "notes": task.notes,
    }


def _drive(task: MissionTask) -> dict[str, Any]:
    """What the log says by itself."""
    from ohmward.energy.balance import DRIVE_TERMS

    recording = task.recording
    assert recording is not None
    energy_J, distance_m = (
        sum(values) for values in zip(*((d.energy_J, d.stretch.distance_m) for d in recording.driven), strict=True)
    )
    split = recording.split
    return {
        "duration_s": recording.log.duration_s,
        "used_s": sum(d.stretch.time_s for d in recording.driven),
        "distance_m": distance_m,
        "energy_J": energy_J,
        "energy_J_per_m": energy_J / distance_m if distance_m else None,
        "cost_of_transport": cost_of_transport(task.consumption, energy_J, distance_m),
        "regenerated_J": split.energy.regenerated_J if split else None,
        "split_J": {name: getattr(split.energy.balance, name) for name in ("battery", *DRIVE_TERMS)} if split else None,
        "split_std_J": split.energy.std_J if split else None,
    }


def cost_of_transport(c: Consumption, energy_J: float, distance_m: float) -> float | None:
    """Energy over weight and distance: a number without a unit."""
    from ohmward.traction.robot.robot import GRAVITY

    return energy_J / (c.prior.mass_kg * GRAVITY * distance_m) if distance_m else None


def _terrain(c: Consumption, name: str) -> dict[str, Any]:
    """What was measured on a ground, and what is expected of it on another day."""
    visits, k = c.visits[c.terrains.index(name)], c.force_index(name)
    band = expected_J_per_m(c, name, usual_speed_m_s(c, name))
    return {
        **visits._asdict(),
        "energy_J_per_m": visits.energy_J / visits.distance_m if visits.distance_m else None,
        "cost_of_transport": cost_of_transport(c, visits.energy_J, visits.distance_m),
        "force_N": float(c.mean[k]),
        "force_std_N": float(c.cov[k, k] ** 0.5),
        "speed_m_s": usual_speed_m_s(c, name),
        "expected_J_per_m": band._asdict(),
        "expected_cost_of_transport": {key: cost_of_transport(c, v, 1.0) for key, v in band._asdict().items()},
    }


def usual_speed_m_s(c: Consumption, name: str) -> float:
    """Mean speed of all that was driven there; half a metre a second where nothing was."""
    visits = c.visits[c.terrains.index(name)]
    return visits.distance_m / visits.time_s if visits.time_s else 0.5


def expected_J_per_m(c: Consumption, name: str, speed_m_s: float):
    """P10, P50 and P90 of the energy per metre [J/m] over 100 m of level ground on another day."""
    from ohmward.energy import Leg, begin_drive, energy_demand, stretch_of
    from ohmward.energy.points import Quantiles, normal_points, quantiles
    from ohmward.energy.range import DIMENSIONS, needed_J

    found = energy_demand(begin_drive(c), [stretch_of(Leg(100.0, name, speed_m_s))])
    return Quantiles(*(value / 100.0 for value in quantiles(needed_J(found, normal_points(DIMENSIONS)))))


def _plan(outlook: MissionForecast) -> dict[str, Any]:
    milestones = [{**m._asdict(), "energy_J": m.energy_J._asdict(), "soc": m.soc._asdict()} for m in outlook.milestones]
    last = milestones[-1]
    return {
        "distance_m": last["distance_m"],
        "time_s": last["time_s"],
        "energy_J": last["energy_J"],
        "probability": outlook.probability,
        "point_of_return_m": outlook.point_of_return_m,
        "milestones": milestones,
    }
