"""Drive to empty: `make drive-to-empty` writes benchmarks/drive_to_empty.md.

Each drive goes out on a line of legs until the battery cannot give the power any more. The robots and grounds are those
of `energy_world`, the batteries PyBaMM's cells, neither made with the formulas of the estimator; sensors have an offset
of 1 % of C and a gain off by 1 %. Once a minute the range is asked of what runs on the robot, `SocEstimator` and
`RangeEstimator`, and compared with the metre at which the robot stopped. Where the probability of coming home falls
below a promise, the same day is driven again, with the way back from there.

Drives are kept in build/drive_to_empty and not made again; `--drives 96` makes as many of them. `--split` makes drives
without the ways home, and writes anew only the section that takes the error of the range apart.
"""

from __future__ import annotations

import argparse
import pickle
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import lru_cache, partial, reduce
from itertools import product
from typing import Any, NamedTuple

import numpy as np

import ohmward as ow
from energy_world import DT_S, TERRAINS, Course, Record, World, draw_course, draw_day, draw_world, drive
from figure import HERE, Figure, at_most, between, table
from ohmward.battery.soc.estimator import SocRun
from ohmward.energy import Consumption, Leg, begin_drive, prior_from_robot, start, with_terrain
from ohmward.energy.discharge_end import DischargeEnd, end_along
from ohmward.energy.range_step import RangeEstimate
from ohmward.logs import Log
from ohmward.traction import RLMA
from ohmward_lab.simulate.electrochemical import (
    ElectrochemicalCell,
    aged,
    capacity_Ah,
    log_of,
    record_cell,
    simulate_cell,
    usual_sensors,
)
from ohmward_lab.simulate.profile import Profile
from range_accuracy import LEARNING_S, taught

PAGE, KEPT = HERE / "drive_to_empty.md", HERE.parent / "build" / "drive_to_empty"
INTRODUCTION = """\
# Drive to empty

Written by `make drive-to-empty`. Robots, grounds and sensors are those of `benchmarks/energy_world.py`,
batteries PyBaMM's cells (LFP: Prada2013, 8 in series; NMC: OKane2022, 4 in series), new and with 85 % of their capacity
and 1.3 times their resistance, at 0, 20 and 35 degC, with a file from a pulse test of the new cell at 25 degC or from
the label alone. A robot that its battery does not drive for five minutes is drawn again. Each robot knows up to eight
drives of other days; *after a day to the cut-off*: also one, on other ground and at any of these temperatures, until
its battery was empty. The robots of seeds 0 to 4 were looked at while the estimator was made; none of those here, of
seeds from 5 on, chose a setting.

Once a minute the range is asked, and compared with the metre at which the robot stopped: over ground that is not known,
and with the course known.
*At best over unknown ground*: the median distance over 64 courses of the same kind, by one who knows the robot, the
day and the energy that the battery will give, but not the course.
*Home*: where the probability of coming home on the known way back, linear between the minutes, first falls below the
promise, the robot turns; a missed return is one that stops on the way. Given up: distance of that turn short of half of
the whole range.
"""
#: Title of the section that takes the error apart, and its introduction.
SPLIT = "## Where the error of P50 comes from"
OF_SPLIT = """\
Written by `python benchmarks/drive_to_empty.py --split`. A distance is the energy left over the energy per metre; here
each is the estimate's median or the truth. With both true the error is zero. From half charge on, of {count} drives.
"""
REFRESH_S, REST_S, HOURS = 60.0, 300.0, 6.0
PROMISES = (0.95, 0.99)
FIRST_SEED = 5
TEMPERATURES_DEGC = (0.0, 20.0, 35.0)
#: Number of courses that stand for the ground of their kind.
COURSES = 64
#: Seconds below the cut-off after which the protection of a battery opens.
PROTECTION_S = 3
ROBOT = replace(RLMA, idle_W=12.0)


class Case(NamedTuple):
    """One drive."""

    chemistry: str
    degC: float
    is_aged: bool
    is_tested: bool
    seed: int


class Known(NamedTuple):
    """What the robot is given beside its sensors."""

    course: bool = False
    charge: bool = False  #: the true state of charge and capacity
    end: bool = False  #: an earlier day to the cut-off


#: What is asked, and what follows the quantity's name on the page.
WAYS = {
    Known(): "",
    Known(course=True): ", course known",
    Known(end=True): ", after a day to the cut-off",
    Known(course=True, end=True): ", course known, after a day to the cut-off",
}
#: Those of every kind of drive; what takes the error of the range apart.
JUDGED = (Known(), Known(course=True))
OF_ERRORS = (*JUDGED, Known(charge=True))
#: Those that decide when to turn for home.
TURNING = (Known(), Known(end=True))


class Question(NamedTuple):
    """The range as it was asked at an instant."""

    soc: float  #: true
    answers: dict[Known, RangeEstimate]
    by_counting: float  #: distance left by counting charge and the mean consumption so far
    at_best: float  #: distance left by the energy that the battery will give, over ground of the same kind
    left_J: float  #: energy that the battery will give
    truth: float  #: distance that was left


class Return(NamedTuple):
    """What became of a promise to come home."""

    is_home: bool
    given_up: float  #: distance of the turn short of half of the range, over that half


class Drive(NamedTuple):
    """Answers along a drive, and what became of each promise."""

    case: Case
    questions: tuple[Question, ...]
    returns: dict[Known, tuple[Return, ...]]  #: for each of PROMISES
    reach_m: float


CELLS = {"lfp": ("Prada2013", 8, 2.5, 2.3), "nmc": ("OKane2022", 4, 2.8, 5.0)}


@lru_cache(maxsize=8)
def cell_of(chemistry: str, is_aged: bool) -> ElectrochemicalCell:
    """The pack, with the cut-off of a usual protection."""
    name, n_series, low_V, _ = CELLS[chemistry]
    new = ElectrochemicalCell(name, n_series=n_series, voltage_min_V=low_V)
    return aged(new, 0.85, 1.3) if is_aged else new


@lru_cache(maxsize=8)
def battery_of(chemistry: str, is_tested: bool) -> ow.Battery:
    """The battery file: from a pulse test of the new pack, or from its label."""
    _, n_series, _, label_Ah = CELLS[chemistry]
    if not is_tested:
        return ow.generic_battery(chemistry, label_Ah, n_series)
    new = cell_of(chemistry, False)
    test = record_cell(new, "pulse-test", 25.0, seed=1)
    return ow.identify(test, capacity_Ah=capacity_Ah(new), chemistry=chemistry, n_series=n_series)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--drives", type=int, default=48)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--split", action="store_true", help="only the section that takes the error apart")
    args = parser.parse_args()
    todo = cases(args.drives)
    (KEPT / "split").mkdir(parents=True, exist_ok=True)
    with ProcessPoolExecutor(args.processes) as pool:
        for k, case in enumerate(pool.map(partial(made, is_split=args.split), todo), 1):
            print(f"{k} of {len(todo)}: {case}", file=sys.stderr)
    drives = [pickle.loads(kept(case, args.split).read_bytes()) for case in todo]
    text = PAGE.read_text(encoding="utf-8").partition(SPLIT)[0].rstrip() + "\n\n" if args.split else page(drives)
    PAGE.write_text(text + split(drives), encoding="utf-8")
    return 0


def cases(count: int) -> list[Case]:
    """So many drives, every kind as often as any other."""
    kinds = list(product(CELLS, TEMPERATURES_DEGC, (False, True), (True, False)))
    # in steps of 7, so that the first dozen has every temperature, and new and aged, as often
    return [Case(*kinds[7 * k % len(kinds)], seed=FIRST_SEED + k // len(kinds)) for k in range(count)]


def kept(case: Case, is_split: bool) -> Any:
    return KEPT / ("split" if is_split else "") / ("-".join(map(str, case)) + ".pickle")


def made(case: Case, is_split: bool) -> Case:
    """Make a drive, unless it was made before."""
    if not kept(case, is_split).exists():
        kept(case, is_split).write_bytes(pickle.dumps(driven(case, is_split)))
    return case


def driven(case: Case, is_split: bool) -> Drive:
    """Out until the battery is empty, and, but for the split of the error, once more for each promise."""
    key = [case.seed, int(case.degC), *map(ord, case.chemistry), case.is_aged, case.is_tested]
    rng = np.random.default_rng(key)
    other_rng = np.random.default_rng([*key, 1])
    stop = 0
    while stop * DT_S <= REST_S:  # such a robot would have been given another battery
        world, known = learnt_world(rng)
        course, day = long_course(rng), draw_day(rng, world)
        out = drive(rng, world, course, HOURS * 3600.0, day=day)
        log, soc, stop = driven_log(case, out.power_W, rng, world)
    assert stop < len(out.power_W), "the battery outlasts the drive"
    run = ow.SocEstimator(battery_of(case.chemistry, case.is_tested)).run(log)
    ended = known if is_split else replace(known, end=earlier_end(case, other_rng, world))
    ways = OF_ERRORS if is_split else dict.fromkeys((*WAYS, *OF_ERRORS))
    answers = {way: asked(case, log, run, soc, out, ended if way.end else known, course, way) for way in ways}
    estimates = answers[Known()]
    place_m = DT_S * np.cumsum(out.speed_m_s)
    reaches = [reach(other_rng, world, day) for _ in range(COURSES)]
    left_J = DT_S * (np.sum(out.power_W[:stop]) - np.cumsum(out.power_W))
    questions = tuple(
        Question(
            float(soc[k]),
            {way: of_way[k] for way, of_way in answers.items()},
            by_counting(k, place_m, log, case),
            float(np.median([np.interp(left_J[k], *course) for course in reaches])),
            float(left_J[k]),
            float(place_m[stop] - place_m[k]),
        )
        for k in estimates
    )
    returns = {
        way: tuple(promised(p, case, rng, world, day, course, out, answers[way], place_m[stop]) for p in PROMISES)
        for way in (() if is_split else TURNING)
    }
    return Drive(case, questions, returns, float(place_m[stop]))


def learnt_world(rng: np.random.Generator) -> tuple[World, Consumption]:
    """A robot in its surroundings, and what it has learnt of them on up to eight days before."""
    world, c = draw_world(rng), start(prior_from_robot(ROBOT))
    for _ in range(int(rng.integers(0, 9))):
        c = taught(begin_drive(c, days=1.0), drive(rng, world, draw_course(rng), LEARNING_S))
    return world, reduce(with_terrain, TERRAINS, begin_drive(c, days=1.0))


def long_course(rng: np.random.Generator) -> Course:
    """A course that no battery can finish."""
    return Course(tuple(leg for _ in range(12) for leg in draw_course(rng).legs))


def reach(rng: np.random.Generator, world: World, day: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Energy [J] and place [m] along another course of the same kind, (T,) each."""
    record = drive(rng, world, long_course(rng), HOURS * 3600.0, day=day)
    return np.maximum.accumulate(DT_S * np.cumsum(record.power_W)), DT_S * np.cumsum(record.speed_m_s)


def earlier_end(case: Case, rng: np.random.Generator, world: World) -> DischargeEnd | None:
    """The end of another day of this robot, on which its battery was emptied."""
    on_day = case._replace(degC=float(rng.choice(TEMPERATURES_DEGC)))
    out = drive(rng, world, long_course(rng), HOURS * 3600.0)
    log, _, _ = driven_log(on_day, out.power_W, rng, world)
    battery = battery_of(case.chemistry, case.is_tested)
    run = ow.SocEstimator(battery).run(log)
    return end_along(log, run.estimates.soc, run.estimates.soc_std, cutoff_of(case))


def cutoff_of(case: Case) -> float:
    """Voltage at which the protection opens."""
    _, n_series, low_V, _ = CELLS[case.chemistry]
    return n_series * low_V


def driven_log(case: Case, power_W: np.ndarray, rng: np.random.Generator, world: World) -> tuple[Log, np.ndarray, int]:
    """The battery's log, the true state of charge (T,), and the second at which the battery gives too little."""
    cell = cell_of(case.chemistry, case.is_aged)
    time_s = DT_S * np.arange(len(power_W))
    current_A = -power_W / (3.6 * cell.n_series)
    for _ in range(3):  # the current that gives this power
        truth = simulate_cell(cell, Profile(time_s, current_A, np.full(len(time_s), case.degC)), time_s)
        wanted_A = 0.5 * (current_A[1:] + current_A[:-1])  # steps have the current of their middles
        short = (truth.current_A[1:] > 0.95 * wanted_A) & (wanted_A < -0.1)
        lasting = short[PROTECTION_S - 1 :].copy()
        for k in range(1, PROTECTION_S):
            lasting &= short[PROTECTION_S - 1 - k : len(short) - k]
        stop = int(np.argmax(lasting)) + PROTECTION_S if lasting.any() else len(time_s)
        current_A = -power_W / np.where(
            time_s <= time_s[min(stop, len(time_s) - 1)], truth.voltage_V, truth.voltage_V[0]
        )
    label_Ah = CELLS[case.chemistry][3]
    offset = 0.01 * float(rng.choice([-1.0, 1.0]))
    sensors = usual_sensors(label_Ah, cell.n_series, offset=offset, gain=world.power_gain - 1.0)
    log = log_of(truth, sensors, rng, "drive").select(slice(0, max(stop, 2)))
    return log, truth.soc, stop


def asked(
    case: Case,
    log: Log,
    run: SocRun,
    true_soc: np.ndarray,
    out: Record,
    known: Consumption,
    course: Course,
    way: Known,
) -> dict[int, RangeEstimate]:
    """What the robot says each minute, by the second."""
    battery = battery_of(case.chemistry, case.is_tested)
    estimator = ow.RangeEstimator(battery, known, reserve_soc=0.0, cutoff_V=cutoff_of(case), refresh_s=REFRESH_S)
    place_m, found = DT_S * np.cumsum(out.speed_m_s), {}
    rows = list(zip(*run.estimates, strict=True))
    true_soh = capacity_Ah(cell_of(case.chemistry, case.is_aged)) / battery.capacity_Ah
    for k in range(len(log)):
        soc = ow.SocEstimate(*rows[k])
        if way.charge:
            soc = soc._replace(soc=float(true_soc[k]), soc_std=0.001, soh_capacity=true_soh, soh_capacity_std=0.001)
        due = k % int(REFRESH_S / DT_S) == 0
        now = estimator.update(
            float(log.time_s[k]),
            soc._replace(soc=min(max(soc.soc, 0.0), 1.0)),
            float(out.seen_speed_m_s[k]),
            float(log.current_A[k]),
            float(log.voltage_V[k]),
            float(out.seen_grade_rad[k]),
            str(out.terrain[k]),
            way_back(course, place_m[k]) if due else None,
            None if log.temperature_degC is None else float(log.temperature_degC[k]),
            way_on(course, place_m[k]) if due and way.course else (),
        )
        if due and log.time_s[k] >= REST_S:
            found[k] = now
    return found


def way_on(course: Course, place_m: float) -> list[Leg]:
    """The legs from a place on; after the last one the course begins anew."""
    legs, left = [], place_m
    for leg in course.legs:
        driven_m = min(left, leg.distance_m)
        left -= driven_m
        if driven_m < leg.distance_m:
            legs.append(replace(leg, distance_m=leg.distance_m - driven_m))
    return [*legs, *course.legs]


def way_back(course: Course, place_m: float) -> list[Leg]:
    """The legs from a place to the start, nearest first."""
    legs, left = [], place_m
    for leg in course.legs:
        if left <= 0.0:
            break
        legs.append(replace(leg, distance_m=min(leg.distance_m, left), grade_rad=-leg.grade_rad))
        left -= leg.distance_m
    return legs[::-1] or [replace(course.legs[0], distance_m=0.1)]


def by_counting(k: int, place_m: np.ndarray, log: Log, case: Case) -> float:
    """Distance left [m] by counting charge and the mean consumption so far; nan before any charge was given."""
    used = -float(log.charge_Ah()[k]) / CELLS[case.chemistry][3]
    return float(place_m[k] * (1.0 - used) / used) if used > 0 else float("nan")


def promised(
    promise: float,
    case: Case,
    rng: np.random.Generator,
    world: World,
    day: np.ndarray,
    course: Course,
    out: Record,
    estimates: dict[int, RangeEstimate],
    reach_m: float,
) -> Return:
    """What becomes of the robot that turns where the probability falls below a promise."""
    place_m = DT_S * np.cumsum(out.speed_m_s)
    turn = turning_second({k: e.home_probability for k, e in estimates.items()}, promise)
    back = way_back(course, place_m[turn])
    seconds = sum(leg.distance_m / leg.speed_m_s + leg.stop_s + 3.0 for leg in back)
    record = drive(rng, world, Course(tuple(back)), seconds, day=day)
    way_m = DT_S * np.cumsum(record.speed_m_s)
    steps = int(np.argmax(way_m >= 0.99 * place_m[turn])) or len(way_m) - 1
    power_W = np.concatenate([out.power_W[:turn], record.power_W[:steps]])
    _, _, stop = driven_log(case, power_W, rng, world)
    return Return(stop >= len(power_W) - 1, 1.0 - float(place_m[turn]) / (0.5 * reach_m))


def turning_second(home_probability: dict[int, float], promise: float) -> int:
    """Second at which the probability of coming home, by second, first falls below a promise; the last if it does not.

    A robot that turned at the next of the questions, up to a minute later, would break more than it promised.
    """
    seconds = list(home_probability)
    below = next((k for k in seconds if home_probability[k] < promise), seconds[-1])
    if below == seconds[0] or home_probability[below] >= promise:
        return below
    before = seconds[seconds.index(below) - 1]
    share = (home_probability[before] - promise) / (home_probability[before] - home_probability[below])
    return before + int(share * (below - before))


def page(drives: Sequence[Drive]) -> str:
    rows = [(f.data, *f.cells[2:]) for f in figures(drives)]
    return "\n".join([INTRODUCTION, *table(("drives", "quantity", "value", "to reach", ""), rows), ""])


def figures(drives: Sequence[Drive]) -> Iterator[Figure]:
    yield from calibration(f"all {len(drives)}", drives, (77.0, 83.0), tuple(WAYS))
    kinds = {
        "LFP": lambda c: c.chemistry == "lfp",
        "NMC": lambda c: c.chemistry == "nmc",
        "0 degC": lambda c: c.degC == 0.0,
        "20 degC": lambda c: c.degC == 20.0,
        "35 degC": lambda c: c.degC == 35.0,
        "new": lambda c: not c.is_aged,
        "85 % of the capacity": lambda c: c.is_aged,
        "file from a test": lambda c: c.is_tested,
        "label alone": lambda c: not c.is_tested,
    }
    for name, chosen in kinds.items():
        yield from calibration(name, [d for d in drives if chosen(d.case)], (70.0, 90.0))
    for quarter in range(4):
        part = [
            d._replace(questions=tuple(q for q in d.questions if quarter / 4 <= q.soc < (quarter + 1) / 4 + 1e-9))
            for d in drives
        ]
        yield from calibration(f"charge {25 * quarter} to {25 * quarter + 25} %", part, (70.0, 90.0))
    for way, (k, promise) in product(TURNING, enumerate(PROMISES)):
        name, returns = f"home promised {promise:.0%}{WAYS[way]}", [d.returns[way][k] for d in drives]
        missed = 1000.0 * np.mean([not r.is_home for r in returns])
        bars = (30.0, 70.0) if promise == 0.95 else (5.0, 15.0)
        yield between(name, "", "missed returns per 1,000", missed, bars)
        given = 100.0 * float(np.median([r.given_up for r in returns]))
        yield at_most(name, "", "given up [% of half of the range]", given, 12.0)


def calibration(
    name: str, drives: Sequence[Drive], bars: tuple[float, float], ways: Sequence[Known] = JUDGED
) -> Iterator[Figure]:
    """Where the truth lay, each drive as much as any other."""
    asked_of = [d.questions for d in drives if d.questions]
    late = late_questions(drives)
    for way in ways:
        inside, below = (
            100.0
            * float(np.mean([np.mean([is_so(q.answers[way].distance_m, q.truth) for q in qs]) for qs in asked_of]))
            for is_so in (lambda said, truth: said.p10 <= truth <= said.p90, lambda said, truth: truth < said.p10)
        )
        yield between(name, "", f"truth within P10-P90{WAYS[way]} [%]", inside, bars)
        yield Figure(name, "", f"truth below P10{WAYS[way]} [%]", f"{below:.0f}")
        if late:
            error = median_error(late, lambda q, way=way: q.answers[way].distance_m.p50)
            yield at_most(name, "", f"median error of P50{WAYS[way]}, from half charge on [%]", error, 6.0, ".1f")
    if late:
        best, counting = median_error(late, lambda q: q.at_best), median_error(late, lambda q: q.by_counting)
        yield Figure(name, "", "the same at best over unknown ground", f"{best:.1f}")
        yield Figure(name, "", "the same by counting and the mean consumption", f"{counting:.1f}")


def late_questions(drives: Sequence[Drive]) -> list[Question]:
    """Those from half charge on, until the robot has almost stopped."""
    return [q for d in drives for q in d.questions if q.soc <= 0.5 and q.truth > 50.0]


def median_error(questions: Sequence[Question], distance_m: Callable[[Question], float]) -> float:
    """Median of the relative error [%] of a distance."""
    return 100.0 * float(np.median([abs(distance_m(q) / q.truth - 1.0) for q in questions]))


def split(drives: Sequence[Drive]) -> str:
    """The section that takes the error of P50 apart: energy left and energy per metre, each estimated or true."""
    asked, course, charge = OF_ERRORS
    late = late_questions(drives)
    rows: list[tuple[str, str, Callable[[Question], float]]] = [
        ("estimated", "estimated", lambda q: q.answers[asked].distance_m.p50),
        ("estimated", "true", lambda q: q.truth * q.answers[asked].usable_J.p50 / q.left_J),
        ("estimated, charge and capacity known", "true", lambda q: q.truth * q.answers[charge].usable_J.p50 / q.left_J),
        ("true", "estimated", lambda q: q.left_J / q.answers[asked].energy_J_per_m.p50),
        ("true", "estimated, course known", lambda q: q.left_J / q.answers[course].energy_J_per_m.p50),
        ("true", "at best over unknown ground", lambda q: q.at_best),
    ]
    cells = [(left, per_m, f"{median_error(late, distance_m):.1f}") for left, per_m, distance_m in rows]
    header = ("energy left", "energy per metre", "median error [%]")
    return "\n".join([SPLIT, "", OF_SPLIT.format(count=len(drives)), *table(header, cells), ""])


if __name__ == "__main__":
    sys.exit(main())
