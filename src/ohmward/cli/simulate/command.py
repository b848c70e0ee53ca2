"""`ohmward simulate`: a robot, its battery, its observer and its controller in closed loop on a ground."""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ohmward.cli import wording
from ohmward.cli.outcome import Outcome, check_output
from ohmward.cli.parser import add_command, add_output_options, count
from ohmward.cli.progress import progress
from ohmward.errors import InputError

if TYPE_CHECKING:
    from ohmward.simulate.closed_loop import ClosedLoopRun, Scenario
    from ohmward.simulate.closed_loop.figures import Figures

_EXAMPLES = """\
  ohmward simulate --list
  ohmward simulate onto-ice --report onto-ice.html
  ohmward simulate --example > my.toml
  ohmward simulate my.toml -o drive.parquet --report drive.html
  ohmward slip drive.parquet --robot rlma --truth speed_true_m_s
"""
#: What the parts of the energy are called.
ENERGY = {
    "copper": "heat of the motors' windings",
    "drive": "gears and bearings",
    "slip": "slip between wheels and ground",
    "rolling": "rolling resistance",
    "climb": "climbing",
    "kinetic": "motion",
    "idle": "electronics",
    "resistor": "braking resistor",
    "numerical": "numerical",
}


def add_parser(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    parser = add_command(commands, "simulate", "a robot and its battery driven in closed loop on a ground", _EXAMPLES)
    parser.add_argument(
        "scenario", nargs="?", metavar="SCENARIO", help="a scenario file (.toml), or the name of one of --list"
    )
    parser.add_argument("--list", action="store_true", help="what scenarios come with ohmward")
    parser.add_argument("--example", action="store_true", help="print a commented scenario file with every key")
    parser.add_argument("--seed", type=count, metavar="N", help="another seed than the file's: other noise")
    add_output_options(parser)
    parser.add_argument("-o", "--output", metavar="FILE", help="write the log of the drive: .csv or .parquet")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> Outcome:
    """Print an example or the list, or simulate, write the log and report."""
    if args.example:
        return _example()
    if args.list:
        return _listed()
    scenario = _scenario(args)
    check_output("--output", args.output, (".csv", ".parquet"), [args.scenario])
    answer = _simulate(scenario)
    if args.output:
        _write(answer, args.output)

    def page():
        from ohmward.cli.simulate.report import make_page

        return make_page(answer)

    found = summary(answer)
    return Outcome(
        found | {"output": args.output, "report": args.report}, describe(answer, found), answer.warnings, page
    )


def summary(answer: ClosedLoopRun) -> dict[str, Any]:
    """The object of --json."""
    from ohmward.simulate.closed_loop.figures import figures

    f, history, scenario = figures(answer), answer.history, answer.scenario
    return {
        "command": "simulate",
        "scenario": scenario.name,
        "robot": scenario.model.name,
        "plant": scenario.plant,
        "observer": scenario.observer.method,
        "controller": scenario.controller.mode,
        "duration_s": f.duration_s,
        "distance_m": f.distance_m,
        "seconds": answer.seconds,
        "slip_settle_s": f.slip_settle_s,
        "slip_rms_error": f.slip_rms_error,
        "slip_commands": [held._asdict() for held in f.slip],
        "energy_J": f.energy_J.battery,
        "energy_J_per_m": f.energy_J_per_m,
        "energy_split_J": {name: getattr(f.energy_J, name) for name in ENERGY},
        **_scores(f),
        "soc_initial": scenario.battery.start_soc,
        "soc_final": float(history.soc[-1]),
        "voltage_min_V": float(history.voltage_V.min()),
        "voltage_max_V": float(history.voltage_V.max()),
        "steps": len(answer.rows.time_s),
        "warnings": list(answer.warnings),
    }


def _scores(f: Figures) -> dict[str, float | None]:
    """Of the observer, None without one."""
    names = (
        "speed_rmse_m_s",
        "speed_max_error_m_s",
        "speed_coverage_95",
        "slip_rmse",
        "coverage_95",
        "false_alarm_rate",
        "detection_rate",
    )
    return {name: getattr(f.score, name) if f.score else None for name in names}


def describe(answer: ClosedLoopRun, found: dict[str, Any]) -> str:
    """The same for people."""
    title = f"{found['scenario']}\n{found['robot']} on plant {found['plant']!r}, controller {found['controller']!r}"
    observer = "the true speed" if found["observer"] == "true" else f"observer {found['observer']!r}"
    return wording.paragraphs(
        f"{title}, {observer}",
        wording.fields(result(found)),
        energy_table(found),
        wording.bullets("Warnings", answer.warnings),
    )


def result(found: dict[str, Any]) -> dict[str, str]:
    """The key figures with their units, by name."""
    rows = {
        "drive": f"{found['distance_m']:.2f} m in {wording.duration(found['duration_s'])}",
        "state of charge": f"{wording.percent(found['soc_initial'])} to {wording.percent(found['soc_final'])}",
        "battery voltage": f"{found['voltage_min_V']:.2f} to {found['voltage_max_V']:.2f} V",
        "energy": wording.quantity(found["energy_J"], "J"),
        "energy per metre": wording.quantity(found["energy_J_per_m"], "J/m"),
        "slip reached after": wording.quantity(found["slip_settle_s"], "s"),
        "slip error, RMS": wording.quantity(found["slip_rms_error"], "(slip ratio)", digits=2),
        "speed error, RMS": wording.quantity(found["speed_rmse_m_s"], "mm/s", 1e3),
        "speed in 95 % band": wording.percent(found["speed_coverage_95"], 1),
        "slip in 95 % band": wording.percent(found["coverage_95"], 1),
        "false slip alarms": wording.percent(found["false_alarm_rate"]),
        "computed in": wording.duration(found["seconds"]),
    }
    return {name: value for name, value in rows.items() if value != "-"}


def energy_table(found: dict[str, Any]) -> str:
    """Where the energy went, what is below a millionth left out."""
    whole = found["energy_J"]
    parts = {name: value for name, value in found["energy_split_J"].items() if abs(value) > 1e-6 * abs(whole)}
    rows = [[ENERGY[name], f"{value:.4g} J", wording.percent(value / whole, 1)] for name, value in parts.items()]
    return wording.table(["where the energy went", "", "share"], rows)


def _scenario(args: argparse.Namespace) -> Scenario:
    from ohmward.simulate.closed_loop import find_scenario

    if args.scenario is None:
        raise InputError(
            "name a scenario file, or one of `ohmward simulate --list`; --example prints one to start from"
        )
    scenario = find_scenario(args.scenario)
    return scenario if args.seed is None else replace(scenario, seed=args.seed)


def _simulate(scenario: Scenario) -> ClosedLoopRun:
    from ohmward.simulate import closed_loop

    with progress() as report:
        told = (lambda done, total: report(scenario.name, done / total)) if report else None
        return closed_loop.run(scenario, told)


def _write(answer: ClosedLoopRun, path: str) -> None:
    from ohmward.logs import write_table
    from ohmward.simulate.closed_loop import columns

    write_table(columns(answer), path)


def _example() -> Outcome:
    from ohmward.simulate.closed_loop.scenario_file import EXAMPLE, packaged_text

    text = packaged_text(EXAMPLE).rstrip()
    return Outcome({"command": "simulate", "example": text}, text)


def _listed() -> Outcome:
    from ohmward.simulate.closed_loop import packaged

    scenarios = dict(packaged())
    text = f"ohmward simulate NAME\n\n{wording.fields(scenarios)}"
    return Outcome({"command": "simulate", "scenarios": scenarios}, text)
