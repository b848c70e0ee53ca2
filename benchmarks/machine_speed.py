"""Speed of this processor, and of our public filters on it; part of `make bench`."""

from __future__ import annotations

import itertools
import math
import os
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from critical_path import least_step_s
from latency import latencies
from ohmward.battery.chemistries import start_noise
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.battery.soc.gaussian_sum import GaussianSumFilter
from ohmward.battery.soc.sample import SocSample
from ohmward.battery.soc.textbook import TextbookFilter
from ohmward.battery.soc.thevenin_filter import TheveninFilter
from ohmward.trace import Kernel, trace
from ohmward.trace.lower import llvm_machine_code as machine_code
from ohmward.trace.lower.llvm_run import MachineStep
from ohmward.trace.program import Program
from ohmward.trace.scan import state_row
from ohmward.trace.structure import size
from ohmward.traction import Odometry
from ohmward.traction.speed_observer.estimator import SlipEstimator
from peak import peak_flops
from peers import Contestant, contestants
from timing import Goal, Section, Times, duration, measure, share, spread
from workloads import Drive, cell_model, cell_problem, joint_ours, make_drive

#: Operations that a floating-point unit does; comparisons, choices and table look-ups come on top.
FLOPS = ("add", "subtract", "multiply", "divide", "sqrt", "negative", "absolute", "minimum", "maximum")
EXAMPLE = SocSample(0.0, 0.0, 0.0, 0.0)
LOGS, LANE_STEPS, UPDATES = 1024, 200, 2000
#: Our own filters, and the least that FilterPy's UKF of three states takes over a step of theirs on one log.
DEFAULT, EXTENDED = "the default, a sum of three extended filters", "extended filter of the battery"
OVER_FILTERPY = {DEFAULT: 427.0, EXTENDED: 853.0}
#: Robots whose motion is estimated live by wheels, so many of them, and gyro.
MOTIONS = {"slip of a Husky": (SlipEstimator, "husky", 4), "pose of a TurtleBot": (Odometry, "turtlebot4", 2)}


class Machine(NamedTuple):
    """Speed of the processor.

    peak: fused multiply-adds of one core, counted as two [1/s], by precision.
    latencies: of every operation [s], f64.
    """

    peak: dict[str, float]
    latencies: dict[str, float]


def measured_machine() -> Machine:
    return Machine({p: peak_flops(p, repeats=30) for p in ("f64", "f32")}, latencies("f64", repeats=15))


def measured_again(machine: Machine) -> Machine:
    """The best of what was measured before and now: what else runs on the machine must not make it look weaker."""
    now = measured_machine()
    peak = {p: max(f, now.peak[p]) for p, f in machine.peak.items()}
    return Machine(peak, {name: min(s, now.latencies[name]) for name, s in machine.latencies.items()})


def flops_of(program: Program) -> int:
    """Floating-point operations of a step."""
    return sum(program.operations[name] for name in FLOPS)


def machine_section(machine: Machine) -> Section:
    """Peak and latencies."""
    rows = [("fused multiply-adds, " + p, f"{peak / 1e9:.0f} GFLOP/s") for p, peak in machine.peak.items()]
    names = ("add", "multiply", "fma", "divide", "sqrt", "floor", "minimum", "where", "less", "gather")
    words = {"where": "choice", "less": "comparison", "gather": "look-up in a table, conversion of the index included"}
    rows += [(f"latency, {words.get(name, name)}", duration(machine.latencies[name])) for name in names]
    text = (
        "Measured in this run. The peak is what one core does in registers, a multiply-add counting as two. Latencies "
        "are those of chains of machine code in f64. The latency bound of a step is the longest cycle of operations "
        "from the state to the state, products and sums fused where that is shorter: a lower bound, which counts "
        "nothing else that a processor has to do."
    )
    return Section("The machine", text, ("what", "measured"), rows)


# ---- the public filters


def public_filters() -> dict[str, Any]:
    """Public filters: they survive bad samples, gate, and carry the current's offset, capacity and model error."""
    noise = start_noise()
    return {
        DEFAULT: GaussianSumFilter(TheveninFilter(cell_model(), noise)),
        EXTENDED: TheveninFilter(cell_model(), noise),
        "unscented filter of the battery": TheveninFilter(cell_model(), noise, method="ukf"),
    }


def bare_filters() -> dict[str, Any]:
    """The published ones, of the tables above."""
    return {
        "EKF, 3 states": TextbookFilter(cell_model(), method="ekf"),
        "UKF, 3 states": TextbookFilter(cell_model(), method="ukf"),
        "AUKF, 7 states": joint_ours(),
    }


def public_section(machine: Machine, repeats: int, steps: int) -> Section:
    """One log and many, with NumPy alone and in machine code."""
    drive = make_drive(steps)
    runs: dict[tuple[str, str], Callable[[], object]] = {}
    for name, estimator in public_filters().items():
        runs |= {(name, how): run for how, run in ways(estimator, drive).items()}
    counts = {"python": len(drive.first(1000).current_A), "machine": steps}
    counts |= dict.fromkeys(("lanes", "f64", "f32"), LOGS * LANE_STEPS) | {"lanes": LOGS * LANE_STEPS // 4}
    times = {key: t.per(counts[key[1]]) for key, t in measure(runs, repeats).items()}
    rows, goals, filterpy_s = [], [], filterpy_seconds(repeats)
    for name, estimator in public_filters().items():
        step = step_of(estimator, drive)
        bound = least_step_s(step.expanded, step.state_size, machine.latencies)
        one, f64 = times[name, "machine"].median, times[name, "f64"].median
        cells = [duration(times[name, how].median) for how in ("python", "machine", "lanes", "f64", "f32")]
        peak = share(flops_of(step.expanded) / f64 / machine.peak["f64"])
        rows.append((name, *cells[:2], share(bound / one), *cells[2:], peak))
        if name in OVER_FILTERPY and not math.isnan(filterpy_s):
            what = f"{name}, one log: FilterPy's time for a UKF of 3 states over it"
            goals.append(Goal(what, filterpy_s / one, OVER_FILTERPY[name], "x", most=False))
    header = (
        "filter",
        "one log, Python source",
        "one log, machine code",
        "of the latency bound",
        f"{LOGS} logs, NumPy",
        "machine code, f64",
        "f32",
        "of the peak, f64",
    )
    text = (
        "Time of a step of one log. These survive bad samples, gate, and carry the current's offset, the capacity and "
        "the model's error. Python source and NumPy over lanes need NumPy alone."
    )
    return Section("The public filters", text, header, rows, tuple(goals))


def filterpy_seconds(repeats: int) -> float:
    """Time [s] of a step of FilterPy's UKF of three states; nan where it is not installed."""
    for peer in contestants(cell_problem("ukf", 2000)):
        if isinstance(peer, Contestant) and peer.who == "FilterPy":
            return measure({peer.who: partial(peer.run, peer.steps)}, repeats)[peer.who].per(peer.steps).median
    return math.nan


def ways(estimator: Any, drive: Drive) -> dict[str, Callable[[], object]]:
    """A way to run a log, or many."""
    state = estimator.init(first_of(drive))
    python = Kernel(estimator.step, state, EXAMPLE, lowering="python")
    machine = Kernel(estimator.step, state, EXAMPLE, lowering="machine")
    starts = np.random.default_rng(2).integers(0, len(drive.current_A) - LANE_STEPS, LOGS)
    lanes = SocSample(*(np.stack([c[s : s + LANE_STEPS] for s in starts], axis=1) for c in drive.samples))
    quarter = SocSample(*(c[: LANE_STEPS // 4] for c in lanes))
    step, row = step_of(estimator, drive), state_row(python.program.argument_structure.children[0], state)
    single = MachineStep(step.program, step.state_size, "f32")
    rows = np.repeat(np.array(row, dtype=float)[:, None], LOGS, axis=1)
    outputs = [np.empty((LANE_STEPS, LOGS)) for _ in range(len(step.program.outputs) - step.state_size)]
    return {
        "python": partial(python.scan, state, drive.first(1000).samples),
        "machine": partial(machine.scan, state, drive.samples),
        "lanes": partial(python.scan_lanes, state, quarter),
        "f64": lambda: step.many(rows.copy(), list(lanes), outputs, threads=1),
        "f32": lambda: single.many(rows.copy(), list(lanes), outputs, threads=1),
    }


def step_of(estimator: Any, drive: Drive) -> MachineStep:
    program = trace(estimator.step, estimator.init(first_of(drive)), EXAMPLE)
    return MachineStep(program, size(program.argument_structure.children[0]))


def first_of(drive: Drive) -> SocSample:
    return SocSample(*(float(column[0]) for column in drive.samples))


# ---- live samples and starting


def live_section(repeats: int) -> Section:
    """One sample through the public `update()`."""
    filters = {name: e for name, e in (public_filters() | bare_filters()).items() if "AUKF" not in name}
    runs = {(name, how): updates(e, how) for name, e in filters.items() for how in ("machine", "python")}
    times = {key: t.per(UPDATES) for key, t in measure(runs, repeats).items()}
    rows, goals = [], []
    for name in filters:
        machine, python = times[name, "machine"], times[name, "python"]
        rows.append((name, duration(machine.median), spread(machine), duration(python.median), spread(python)))
        goals.append(Goal(f"`update()`, {name}, machine code", machine.median, 3e-6))
        goals.append(Goal(f"`update()`, {name}, Python source", python.median, 40e-6))
    motions = measure(
        {name: moves(kind(robot, "machine"), wheels) for name, (kind, robot, wheels) in MOTIONS.items()}, repeats
    )
    for name, taken in motions.items():
        one = taken.per(UPDATES)
        rows.append((name, duration(one.median), spread(one), "", ""))
        goals.append(Goal(f"`update()`, {name}, machine code", one.median, 15e-6))
    header = ("filter", "machine code", "least to most", "Python source", "least to most")
    text = (
        "A sample through `update()`, from Python to Python: of `SocEstimator`, and of `SlipEstimator` "
        "and `Odometry` by wheels and gyro."
    )
    return Section("Live samples", text, header, rows, tuple(goals))


def updates(estimator: Any, lowering: str) -> Callable[[], None]:
    """A drive that goes on for ever: its samples again and again, from where the one before has ended."""
    public = SocEstimator(estimator, 0.95, lowering=lowering)
    drive = make_drive(UPDATES)
    samples = list(zip(drive.current_A.tolist(), drive.voltage_V.tolist(), strict=True))
    times = itertools.count()

    def run() -> None:
        for current_A, voltage_V in samples:
            public.update(float(next(times)), current_A, voltage_V)

    return run


def moves(public: SlipEstimator | Odometry, wheels: int) -> Callable[[], None]:
    """A robot that accelerates, turns and stands, 50 times a second."""
    times = itertools.count()

    def run() -> None:
        for k in range(UPDATES):
            speed = np.full(wheels, 4.0 * math.sin(0.01 * k))
            public.update(0.02 * next(times), speed, yaw_rate_rad_s=0.002 * math.sin(k))

    return run


def compilation_section(repeats: int) -> Section:
    """From the function to the first result, with an empty cache and from the cache."""
    rows, goals = [], []
    drive = make_drive(400)
    for name, estimator in (bare_filters() | public_filters()).items():
        cold, warm = compilation(estimator, drive, repeats)
        rows.append((name, duration(cold.median), spread(cold), duration(warm.median), spread(warm)))
        if name == "AUKF, 7 states":
            goals = [
                Goal(f"{name}: traced and compiled", cold.median, 0.15),
                Goal(f"{name}: traced, code from the cache", warm.median, 0.02),
            ]
    header = ("filter", "compiled", "least to most", "from the cache", "least to most")
    text = (
        "From the function to the step that is ready for its first sample: traced, and compiled or found in the cache."
    )
    return Section("Tracing and compiling", text, header, rows, tuple(goals))


def compilation(estimator: Any, drive: Drive, repeats: int) -> tuple[Times, Times]:
    """Cold and warm."""
    state = estimator.init(first_of(drive))
    found: tuple[list[float], list[float]] = ([], [])
    machine_code.llvm()
    for _ in range(repeats):
        with empty_cache():
            for times in found:
                began = time.process_time()
                Kernel(estimator.step, state, EXAMPLE, lowering="machine").live(state)
                times.append(time.process_time() - began)
    cold, warm = (Times(statistics.median(t), min(t), max(t)) for t in found)
    return cold, warm


@contextmanager
def empty_cache() -> Iterator[None]:
    """With an empty cache of compiled programs, here and in every process that is started."""
    before = os.environ.get("OHMWARD_CACHE")
    with tempfile.TemporaryDirectory() as folder:
        os.environ["OHMWARD_CACHE"] = folder
        try:
            yield
        finally:
            os.environ.pop("OHMWARD_CACHE")
            if before is not None:
                os.environ["OHMWARD_CACHE"] = before
