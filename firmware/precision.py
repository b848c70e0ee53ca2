"""Cost of single precision: every exported filter over a long log against the same program in double precision.

The exported C runs on this machine, bit by bit as on the target (see measure.py). The battery is cycled by a drive that
its own model answers, as cheap sensors show it; an observer replays its drive. Writes
benchmarks/single_precision.md. `make single-precision` runs it.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from measure import FILTERS, OBSERVERS, Case, battery_and_hour, drive, title_of

from ohmward.battery.battery import Battery
from ohmward.battery.soc.sample import SocSample
from ohmward.embedded import Twin, battery_export, library, observer_export, write_library
from ohmward.embedded.battery import JOINT
from ohmward.embedded.comparison import in_double_precision
from ohmward.logs import Log
from ohmward.trace import Kernel
from ohmward.trace.structure import flatten
from ohmward.traction import hard_terrain
from ohmward.traction.motion.sample import samples_of as drive_samples_of
from ohmward_lab.published import rc_circuit
from ohmward_lab.published.rc import rc_of_thevenin
from ohmward_lab.simulate.voltage import simulate_voltage

PAGE = Path(__file__).resolve().parents[1] / "benchmarks" / "single_precision.md"
STEPS = 100_000
#: Outputs that say nothing of precision.
FLAGS = "flags"


class Cost(NamedTuple):
    """Of one output: the difference of 99 % of the samples, the largest, the largest value, samples with one NaN."""

    title: str
    member: str
    usual: float
    difference: float
    largest: float
    unequal_nans: int


def main() -> int:
    """Measure all, write the page."""
    rows = []
    for case in cases():
        for row in costs(case):
            print(
                f"{row.title:45s} {row.member:24s} {row.usual:10.3g} {row.difference:10.3g} of {row.largest:10.3g}",
                flush=True,
            )
            rows.append(row)
    PAGE.write_text(page(rows), encoding="utf-8")
    return 0


def cases() -> Iterator[Case]:
    """Every filter of a battery and the observers; a style or a rate changes the operations, so each is one."""
    battery, _ = battery_and_hour()
    samples, of_rc = cycled(battery, STEPS), cycled_rc(battery, STEPS)
    for name, options in FILTERS:
        if options.get("style") != "loops":  # the bits of the straight line
            export = battery_export(battery, name, "filter", **options)
            yield Case(title_of(name, **options), export, of_rc if name == JOINT else samples)
    ground = hard_terrain("dry asphalt")
    for robot, name, scenario in OBSERVERS:
        samples = drive_samples_of(drive(scenario), robot)
        yield Case(f"{robot.name} speed, {name}", observer_export(robot, ground, name, "filter"), samples)


def cycled(battery: Battery, steps: int) -> SocSample:
    """Samples (steps,) of a drive, 1 s apart, that takes the battery from 90 % to 20 % and back every four hours."""
    current = _cycling_A(battery.capacity_Ah, steps)
    log = Log("cycled", np.arange(float(steps)), current, np.full(steps, np.nan), np.full(steps, 25.0))
    return _seen(battery, current, simulate_voltage(battery.thevenin, log, 0.9).voltage_V)


def cycled_rc(battery: Battery, steps: int) -> SocSample:
    """The same drive on a battery that is the RC model, for the filter of its parameters."""
    model, current = rc_of_thevenin(battery.thevenin), _cycling_A(battery.capacity_Ah, steps)

    def step(x: np.ndarray, pair: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        after = rc_circuit.next_state(x, 0.5 * (pair[0] + pair[1]), model, 1.0)
        return after, rc_circuit.voltage(after, pair[1], model)

    pairs = np.column_stack([np.concatenate([[0.0], current[:-1]]), current])
    start = rc_circuit.at_rest(model, 0.9)
    _, voltage = Kernel(step, start, np.zeros(2)).scan(start, pairs)
    return _seen(battery, current, voltage[:, 0])


def _cycling_A(capacity_Ah: float, steps: int) -> np.ndarray:
    """Current (steps,): changing every 20 s, and led so that SoC goes up and down between 90 % and 20 %."""
    drawn = capacity_Ah * np.repeat(np.random.default_rng(3).normal(0.0, 0.5, steps // 20 + 1), 20)
    wanted = 0.55 + 0.35 * np.cos(2.0 * np.pi * np.arange(steps) / 14_400.0)
    current, soc = np.empty(steps), 0.9
    for k in range(steps):
        current[k] = drawn[k] + 3600.0 * capacity_Ah * 0.01 * (wanted[k] - soc)
        soc += current[k] / (3600.0 * capacity_Ah)
    return current


def _seen(battery: Battery, current_A: np.ndarray, voltage_V: np.ndarray) -> SocSample:
    """Samples of cheap sensors: noise, and an offset of the current."""
    rng, steps = np.random.default_rng(4), len(current_A)
    current = current_A + 0.002 * battery.capacity_Ah + battery.sensor.noise_std_A * rng.standard_normal(steps)
    voltage = voltage_V + battery.noise.voltage_std_V * rng.standard_normal(steps)
    return SocSample(np.concatenate([[0.0], np.ones(steps - 1)]), current, voltage, np.full(steps, 25.0))


def costs(case: Case) -> Iterator[Cost]:
    """The cost of every output of a library."""
    export = case.export
    with tempfile.TemporaryDirectory() as folder:
        write_library(library(export), Path(folder))
        twin = Twin(folder)
        arguments = dict(zip(twin.arguments, export.arguments, strict=True))
        twin.start(type(case.samples)(*(np.asarray(c)[0] if np.ndim(c) else c for c in case.samples)), **arguments)
        found = twin.run(case.samples)
    output = export.step.step_structure.output
    exact = flatten(output, in_double_precision(export, case.samples, export.arguments))
    named = zip(twin.Output._fields, found, (x for x in exact if np.size(x)), strict=True)
    for member, single, double in named:
        if member != FLAGS and np.isfinite(double).any():
            yield _cost(case.title, member, np.asarray(single, float), np.asarray(double, float))


def _cost(title: str, member: str, single: np.ndarray, double: np.ndarray) -> Cost:
    both = np.isfinite(single) & np.isfinite(double)
    differences = np.abs(single - double)[both]
    usual, difference = (float(np.quantile(differences, share)) for share in (0.99, 1.0))
    unequal_nans = int(np.count_nonzero(np.isnan(single) != np.isnan(double)))
    return Cost(title, member, usual, difference, float(np.abs(double[both]).max(initial=0.0)), unequal_nans)


def page(rows: list[Cost]) -> str:
    """The table in Markdown."""
    text = f"""\
# What single precision costs

Written by `make single-precision`: the exported C, bit by bit what a microcontroller computes, against the same program
in double precision: the difference that 99 % of the samples keep, the largest, and the largest value of the output.

- The filters of a battery (generic lfp, 12 Ah, 4 cells) see it cycled between 90 % and 20 % over {STEPS:,} samples, 1 s
  apart, by currents up to 2 C, through cheap sensors. They start at 50 %, give or take 30 %, which is wrong.
  `textbook-joint` sees a battery that is its model.
- The observers of a robot see a drive of a simulated scenario, 1,000 or 2,000 samples.

Where a difference is large for a moment the filter itself is sensitive: a linearised curve with a knee takes another
slope for another last bit.

| | output | 99 % within | largest | of |
|---|---|---|---|---|"""
    lines = [text]
    before = ""
    for row in rows:
        title, before = ("" if row.title == before else row.title), row.title
        nans = f", no number in one of both {row.unequal_nans} times" if row.unequal_nans else ""
        lines.append(f"| {title} | `{row.member}` | {row.usual:.2g} | {row.difference:.2g}{nans} | {row.largest:.3g} |")
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    sys.exit(main())
