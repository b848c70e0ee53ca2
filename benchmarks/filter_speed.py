"""The same filters by everybody: one log, and many logs at once; part of `make bench`.

Every contestant runs the same model on the same samples and has to come to the same mean and covariance, in sigmas of
the state, before its time counts. All return the means of all samples.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from critical_path import least_step_s
from machine_speed import Machine, flops_of, measured_again
from ohmward.battery.soc.sample import SocSample
from ohmward.battery.soc.textbook import TextbookFilter
from ohmward.filters.belief import PackedBelief, unpack
from ohmward.trace import Kernel, trace
from ohmward.trace.lower.llvm_run import MachineStep
from ohmward.trace.scan import state_row
from ohmward.trace.structure import scalar_names, shaped, size
from peers import Absent, Contestant, contestants, numpy_by_hand
from timing import Goal, Section, Times, duration, measure, ratio, share, spread
from workloads import (
    BareCell,
    CellProblem,
    Drive,
    JointProblem,
    Posterior,
    cell_model,
    cell_problem,
    cell_start,
    disagreement,
    joint_ours,
    joint_problem,
    joint_start,
)

STEPS, LOGS, LANE_STEPS = 100_000, 1024, 200
CHECK_STEPS, AGREED = 1000, 1e-5
#: Our functions on the model that the peers have: no faults, no gate, and the mean alone for an output.
BARE = ", the peers' bare model"
#: Least time of JAX over ours in lanes, of an extended filter of three states on that model.
OVER_JAX = 3.0
#: Operations of a step of the AUKF written out, with triangular covariances and nothing of the model's structure used.
TEMPLATE_FLOPS = {"AUKF, 7 states": 2111, "UKF, 3 states": 443}


class Case(NamedTuple):
    """A problem and our filter of it.

    start: our state before a drive.
    """

    name: str
    what: str
    problem: CellProblem | JointProblem
    estimator: Any
    start: Callable[[Drive], Any]
    least_speed_up: float | None = None
    most_s: float | None = None


def cases(steps: int = STEPS) -> Iterator[Case]:
    """AUKF-7, and the textbooks' filters of the cell."""
    joint = joint_ours()
    yield Case(
        "AUKF, 7 states",
        "States and parameters of the RC model with learnt noise, [T] 3.3; sigma points reused for the output",
        joint_problem(steps),
        joint,
        partial(joint_start, joint),
        least_speed_up=600.0,
        most_s=130e-9,
    )
    for method, title in (("ukf", "UKF"), ("ekf", "EKF")):
        ours = TextbookFilter(cell_model(), method=method)
        what = "State of charge and two RC voltages of the Thevenin model"
        yield Case(f"{title}, 3 states", what, cell_problem(method, steps), ours, partial(cell_start, ours))
    bare = BareCell(cell_problem("ekf", steps, hysteresis=True))
    what = "The same with hysteresis as a fourth state: the functions of `ohmward.filters` on the peers' bare model"
    yield Case("EKF with hysteresis, 4 states", what, bare.problem, bare, bare.start, most_s=30e-9)


# ---- one log


def one_log(machine: Machine, repeats: int, steps: int = STEPS) -> Iterator[Section]:
    """A table for each filter."""
    for case in cases(steps):
        machine = measured_again(machine)
        yield one_log_of(case, machine, repeats)


def one_log_of(case: Case, machine: Machine, repeats: int) -> Section:
    length = len(case.problem.drive.current_A)
    found = [limited(c, length) for c in (*ours_on_a_log(case), *contestants(case.problem))]
    running = [c for c in found if isinstance(c, Contestant)]
    times = measure({c: partial(c.run, c.steps) for c in running}, repeats)
    times = {c: t.per(c.steps) for c, t in times.items()}
    best = times[running[0]].median
    bound = latency_bound(case, machine)
    rows = [
        absent_row(c, len(HEADER)) if isinstance(c, Absent) else one_log_row(case, c, times[c], best) for c in found
    ]
    text = (
        f"{case.what}. Steps follow each other no faster than {duration(bound)}, the latency bound; ours in machine "
        f"code reaches {share(bound / best)} of it."
    )
    return Section(f"One log: {case.name}", text, HEADER, rows, tuple(one_log_goals(case, times, best)))


HEADER = ("who", "how", "a step", "least to most", "over ours", "agrees to", "made ready in")


def limited(c: Contestant | Absent, length: int) -> Contestant | Absent:
    """With no more samples than the log has."""
    return c._replace(steps=min(c.steps, length)) if isinstance(c, Contestant) else c


def one_log_row(case: Case, c: Contestant, times: Times, best: float) -> tuple[str, ...]:
    points = ", points redrawn" if c.redrawn and isinstance(case.problem, JointProblem) else ""
    return (
        c.who,
        c.how + points,
        duration(times.median),
        spread(times),
        ratio(times.median, best),
        agreement(case.problem, c),
        duration(c.prepared_s),
    )


def absent_row(peer: Absent, columns: int) -> tuple[str, ...]:
    return (peer.title, f"not installed: pip install {peer.package}", *("" for _ in range(columns - 2)))


def one_log_goals(case: Case, times: dict[Contestant, Times], best: float) -> Iterator[Goal]:
    if case.most_s is not None:
        yield Goal(f"{case.name}, one log, f64: a step", best, case.most_s)
    filterpy = [t.median for c, t in times.items() if c.who == "FilterPy"]
    if case.least_speed_up is not None and filterpy:
        yield Goal(
            f"{case.name}, one log: FilterPy's time over ours", filterpy[0] / best, case.least_speed_up, "x", most=False
        )


def ours_on_a_log(case: Case) -> Iterator[Contestant]:
    """Our step in machine code, bare where it is not, and as Python source."""
    ways = [("machine", "machine code", STEPS, case.estimator, case.start)]
    if isinstance(case.estimator, TextbookFilter):
        bare = BareCell(case.problem)
        ways.append(("machine", f"machine code{BARE}", STEPS, bare, bare.start))
    ways.append(("python", "Python source, NumPy alone", 1000, case.estimator, case.start))
    for lowering, how, steps, estimator, begin in ways:
        began = time.perf_counter()
        start = begin(case.problem.drive)
        kernel = Kernel(estimator.step, start, SocSample(0.0, 0.0, 0.0, 0.0), lowering=lowering)
        run = partial(run_kernel, kernel, start, case.problem.drive)
        run(2)
        prepared_s = time.perf_counter() - began
        redrawn = isinstance(case.problem, CellProblem) and case.problem.method == "ukf"
        yield Contestant("ohmward", how, steps, run, redrawn, prepared_s)


def run_kernel(kernel: Kernel, start: Any, drive: Drive, steps: int) -> Posterior:
    after, _ = kernel.scan(start, drive.first(steps).samples)
    return Posterior(*unpack(after.belief))


def agreement(problem: CellProblem | JointProblem, contestant: Contestant) -> str:
    """Largest disagreement with the matrices in NumPy, of the same variant."""
    if contestant.who == "NumPy by hand":
        return "reference"
    difference = disagreement(contestant.run(CHECK_STEPS), reference(problem, contestant.redrawn))
    return f"{difference:.0e}" if difference <= AGREED else f"**{difference:.0e}, another result**"


def reference(problem: CellProblem | JointProblem, redrawn: bool, steps: int = CHECK_STEPS) -> Posterior:
    if isinstance(problem, CellProblem):
        return numpy_by_hand.run_cell(problem, steps)
    return numpy_by_hand.run_joint(problem, steps, redrawn)


def latency_bound(case: Case, machine: Machine) -> float:
    """Least time [s] between two steps."""
    step = machine_step(case, "f64")
    return least_step_s(step.expanded, step.state_size, machine.latencies)


def machine_step(case: Case, precision: str) -> MachineStep:
    program = trace(case.estimator.step, case.start(case.problem.drive.first(1)), SocSample(0.0, 0.0, 0.0, 0.0))
    return MachineStep(program, size(program.argument_structure.children[0]), precision)


# ---- many logs


def many_logs(machine: Machine, repeats: int, steps: int = STEPS, logs: int = LOGS) -> Iterator[Section]:
    """A table for each filter."""
    for case in cases(steps):
        machine = measured_again(machine)
        yield many_logs_of(case, machine, repeats, logs)


def many_logs_of(case: Case, machine: Machine, repeats: int, logs: int) -> Section:
    problem = case.problem._replace(drive=pieces(case.problem.drive, logs))
    one = case.problem._replace(drive=Drive(*(column[:, 0] for column in problem.drive)))
    ours = {precision: ours_on_lanes(case, problem.drive, precision) for precision in ("f64", "f32")}
    bare = []
    if isinstance(case.estimator, TextbookFilter):
        own = BareCell(case.problem)
        bare = [ours_on_lanes(case._replace(estimator=own, start=own.start), problem.drive, "f64", BARE)]
    found = [
        limited(c, LANE_STEPS)
        for c in (*ours.values(), *bare, ours_in_numpy(case, problem.drive), *contestants(problem, lanes=True))
    ]
    running = [c for c in found if isinstance(c, Contestant)]
    times = measure({c: partial(c.run, c.steps) for c in running}, repeats)
    times = {c: t.per(c.steps * logs) for c, t in times.items()}
    best = times[running[0]].median
    rows = [
        absent_row(c, len(LANES_HEADER)) if isinstance(c, Absent) else lanes_row(one, c, times[c], best) for c in found
    ]
    peak, goals = [], []
    for precision, contestant in ours.items():
        seconds, counted = times[contestant].median, flops_of(machine_step(case, precision).expanded)
        template = TEMPLATE_FLOPS.get(case.name)
        of_template = template / seconds / machine.peak[precision] if template else math.nan
        shares = share(counted / seconds / machine.peak[precision])
        peak.append(f"{precision}: {counted} operations, {shares} of the peak")
        if template:
            peak[-1] += f", {share(of_template)} as the {template} of the template"
        if template and case.least_speed_up:
            goals.append(
                Goal(
                    f"{case.name}, {logs} logs, {precision}: of the peak by template",
                    of_template,
                    0.55,
                    "%",
                    most=False,
                )
            )
    jax = [times[peer].median for peer in running if peer.who == "JAX"]
    if bare and jax and case.name.startswith("EKF"):
        what = f"{case.name}, {logs} logs{BARE}: JAX's time over ours"
        goals.append(Goal(what, jax[0] / times[bare[0]].median, OVER_JAX, "x", most=False))
    text = f"{logs} logs side by side on one core. Ours in machine code: {'; '.join(peak)}."
    return Section(f"Many logs: {case.name}", text, LANES_HEADER, rows, tuple(goals))


LANES_HEADER = ("who", "how", "a step of a log", "least to most", "over ours", "agrees to")


def lanes_row(problem: CellProblem | JointProblem, c: Contestant, times: Times, best: float) -> tuple[str, ...]:
    difference = disagreement(c.run(c.steps), lane_reference(problem, c))
    agreed = f"{difference:.0e}" if difference <= AGREED or "f32" in c.how else f"**{difference:.0e}, another result**"
    return c.who, c.how, duration(times.median), spread(times), ratio(times.median, best), agreed


def lane_reference(problem: CellProblem | JointProblem, c: Contestant) -> Posterior:
    """The first log by itself."""
    run = numpy_by_hand.run_cell if isinstance(problem, CellProblem) else numpy_by_hand.run_joint
    return run(problem, c.steps)


def pieces(drive: Drive, logs: int) -> Drive:
    """Pieces of the drive, one for each log, (T, B): each begins with the current that it had before."""
    starts = np.random.default_rng(2).integers(0, len(drive.current_A) - LANE_STEPS, logs)
    columns = [np.stack([c[s : s + LANE_STEPS] for s in starts], axis=1) for c in drive]
    columns[1][0] = columns[0][0]
    return Drive(*columns)


def ours_on_lanes(case: Case, drive: Drive, precision: str, model: str = "") -> Contestant:
    """Machine code, a log in each SIMD lane; model: whose it is, where it is not that of the filter."""
    step, state = machine_step(case, precision), lane_states(case, drive)
    structure = step.program.argument_structure.children[0]
    samples = drive.samples

    results = [np.empty(drive.current_A.shape) for _ in range(len(step.program.outputs) - step.state_size)]

    def run(steps: int) -> Posterior:
        rows = state.copy()
        step.many(rows, [c[:steps] for c in samples], [r[:steps] for r in results], threads=1)
        return posterior(shaped(structure, rows[:, 0].tolist()))

    return Contestant("ohmward", f"machine code, {precision}{model}", LANE_STEPS, run)


def ours_in_numpy(case: Case, drive: Drive) -> Contestant:
    """NumPy over lanes, which needs nothing but NumPy."""
    start = case.start(case.problem.drive.first(1))
    kernel = Kernel(case.estimator.step, start, SocSample(0.0, 0.0, 0.0, 0.0), lowering="python")
    start = start._replace(current_A=drive.current_A[0])

    def run(steps: int) -> Posterior:
        samples = SocSample(*(c[:steps] for c in drive.samples))
        after, _ = kernel.scan_lanes(start, samples)
        return Posterior(*unpack(PackedBelief(after.belief.mean[:, 0], after.belief.lower[:, 0])))

    return Contestant("ohmward", "NumPy over lanes, NumPy alone", LANE_STEPS // 4, run)


def lane_states(case: Case, drive: Drive) -> np.ndarray:
    """Our state before each log (n, B)."""
    start = case.start(case.problem.drive.first(1))
    program = trace(case.estimator.step, start, SocSample(0.0, 0.0, 0.0, 0.0))
    structure = program.argument_structure.children[0]
    rows = np.repeat(np.array(state_row(structure, start), dtype=float)[:, None], drive.current_A.shape[1], axis=1)
    rows[scalar_names(structure).index("current_A")] = drive.current_A[0]
    return rows


def posterior(state: Any) -> Posterior:
    return Posterior(*unpack(state.belief))
