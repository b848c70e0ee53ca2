"""Do the bands of range, of the way home and of the energy per metre hold? 300 simulated robots, see energy_world."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import reduce
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from energy_world import (
    BATTERY,
    DT_S,
    RESERVE_SOC,
    Course,
    Record,
    draw_course,
    draw_world,
    drive,
    reached,
)
from figure import Figure, at_least, at_most
from ohmward.energy import (
    BatteryState,
    Consumption,
    Leg,
    begin_drive,
    cut_drive,
    energy_demand,
    get_home,
    learn,
    prior_from_mass,
    prior_from_robot,
    range_left,
    start,
    stretch_of,
    with_terrain,
)
from ohmward.energy.consumption_prior import ConsumptionPrior
from ohmward.energy.points import normal_points, quantiles
from ohmward.energy.range import DIMENSIONS, needed_J
from ohmward.traction import RLMA

ROBOT = replace(RLMA, idle_W=12.0)
MISSIONS = 300
LEARNING_S, BEFORE_S, LONGEST_S = 1800.0, 900.0, 7 * 3600.0
CAPACITY_STD, RESISTANCE_STD = 0.02, 0.1
PLANT = "300 simulated robots"
#: Robots that meet a slope which is steeper than those of the drives that taught them, and the slope [rad].
SLOPES, SLOPE_DRIVES, STEEP_RAD = 60, 3, 0.12


class Mission(NamedTuple):
    """One robot at the moment of the question, with the answer that only the simulation knows.

    consumption: learned from some days and the first quarter of an hour of this one.
    charge: what is known of the battery.
    power_W, speed_m_s: what really comes, (T,).
    truth: (3,) state of charge, shares of capacity and resistance.
    bands: for each terrain of the first quarter of an hour whether the energy was inside the P10-P90 of the evening
        before, and after how many drives.
    """

    consumption: Consumption
    course: Course
    charge: BatteryState
    power_W: np.ndarray
    speed_m_s: np.ndarray
    truth: np.ndarray
    bands: list[tuple[bool, int]]


class Answer(NamedTuple):
    """Prediction and outcome: distances [m], the probability of a plan, and True where it was driven."""

    quantiles: tuple[float, float, float]
    distance_m: float
    drives: int
    probability: float
    got_home: bool


def rows() -> Iterator[Figure]:
    missions = [make_mission(seed) for seed in range(MISSIONS)]
    answers = answer(missions)
    yield from range_rows(answers)
    yield from home_rows(answers)
    yield from band_rows([band for m in missions for band in m.bands])
    for name, prior in (("robot file", prior_from_robot(ROBOT)), ("mass alone", prior_from_mass(ROBOT.mass_kg))):
        yield from slope_rows(name, np.array([on_a_slope(seed, prior) for seed in range(SLOPES)]))


def make_mission(seed: int) -> Mission:
    rng = np.random.default_rng([seed, 815])
    world, course = draw_world(rng), draw_course(rng)
    c, drives = start(prior_from_robot(ROBOT)), int(rng.integers(0, 9))
    for _ in range(drives):
        c = taught(begin_drive(c, days=1.0), drive(rng, world, draw_course(rng), LEARNING_S))
    c = begin_drive(c, days=1.0)
    payload_kg = float(rng.choice([0.0, 5.0], p=[0.7, 0.3]))
    today = drive(rng, world, course, BEFORE_S + LONGEST_S, payload_kg)
    now = int(BEFORE_S / DT_S)
    before = Record(*(column[:now] for column in today))
    bands = [(inside, drives) for inside in predicted_bands(c, before)]
    truth = np.array([rng.uniform(0.4, 0.95), 1 + CAPACITY_STD * rng.normal(), 1 + RESISTANCE_STD * rng.normal()])
    soc_std = rng.uniform(0.01, 0.05)
    soc = float(np.clip(truth[0] + soc_std * rng.standard_normal(), RESERVE_SOC + 0.01, 1.0))
    charge = BatteryState(
        soc, soc_std, capacity_std=CAPACITY_STD, resistance_std=RESISTANCE_STD, reserve_soc=RESERVE_SOC
    )
    ahead = today.power_W[now:].copy(), today.speed_m_s[now:].copy()
    c = reduce(with_terrain, (leg.terrain for leg in course.legs), taught(c, before))
    return Mission(c, course, charge, *ahead, truth, bands)


def taught(c: Consumption, seen: Record) -> Consumption:
    for driven in stretches(seen):
        c = learn(c, driven.stretch, driven.energy_J)
    return c


def stretches(seen: Record) -> list:
    return cut_drive(seen.time_s, seen.seen_speed_m_s, seen.seen_power_W, seen.terrain, seen.seen_grade_rad)


def predicted_bands(c: Consumption, seen: Record) -> Iterator[bool]:
    """For each terrain that comes and is known: is the energy within the band that was predicted the evening before?"""
    found = [d for d in stretches(seen) if d.stretch.terrain in c.terrains]
    for name in sorted({d.stretch.terrain for d in found}):
        there = [d for d in found if d.stretch.terrain == name]
        band = quantiles(needed_J(energy_demand(c, [d.stretch for d in there]), normal_points(DIMENSIONS)))
        yield band.p10 <= sum(d.energy_J for d in there) <= band.p90


def answer(missions: list[Mission]) -> list[Answer]:
    truth = np.array([m.truth for m in missions])
    steps = reached([m.power_W for m in missions], *truth.T)
    driven_m = [float(np.sum(m.speed_m_s[:k]) * DT_S) for m, k in zip(missions, steps, strict=True)]
    return [one_answer(k, m, d) for k, (m, d) in enumerate(zip(missions, driven_m, strict=True))]


def one_answer(seed: int, m: Mission, driven_m: float) -> Answer:
    predicted = range_left(m.consumption, [stretch_of(leg) for leg in m.course.legs], BATTERY, m.charge).distance_m
    plan = cut_plan(m.course, predicted.p50 * np.random.default_rng([seed, 7]).uniform(0.6, 1.4))
    outlook = get_home(m.consumption, plan, BATTERY, m.charge)
    length_m = outlook.milestones[-1].distance_m
    drives = max(v.drives for v in m.consumption.visits)
    return Answer(tuple(predicted), driven_m, drives, outlook.probability, driven_m >= length_m)


def cut_plan(course: Course, length_m: float) -> list[Leg]:
    """The loop again and again, up to a length, terrain by terrain and speed by speed as one long leg each."""
    loop_m = sum(leg.distance_m for leg in course.legs)
    return [
        replace(leg, distance_m=leg.distance_m * length_m / loop_m, stop_s=leg.stop_s * length_m / loop_m)
        for leg in course.legs
    ]


def range_rows(answers: list[Answer]) -> Iterator[Figure]:
    d = np.array([a.distance_m for a in answers])
    low, middle, high = np.array([a.quantiles for a in answers]).T
    few = np.array([a.drives for a in answers]) <= 3
    inside = (low <= d) & (d <= high)
    yield from within("range left", inside, "truth within P10-P90 [%]", 6.0)
    yield at_least(PLANT, "range left, <= 3 drives", "truth within P10-P90 [%]", 100 * inside[few].mean(), form=".1f")
    yield at_least(PLANT, "range left, > 3 drives", "truth within P10-P90 [%]", 100 * inside[~few].mean(), form=".1f")
    yield from within("range left", d < low, "truth below P10 [%]", 6.0, 10.0)
    yield at_most(PLANT, "range left", "median error of P50 [%]", 100 * np.median(np.abs(middle / d - 1)))
    yield at_most(PLANT, "range left", "median width of P10-P90 over P50 [%]", 100 * np.median((high - low) / middle))


def home_rows(answers: list[Answer]) -> Iterator[Figure]:
    p, home = np.array([a.probability for a in answers]), np.array([a.got_home for a in answers], dtype=float)
    brier, constant = np.mean((p - home) ** 2), np.mean((home.mean() - home) ** 2)
    yield at_most(PLANT, "way home", "Brier score", brier, 0.5 * constant)
    edges = [0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 1.0]
    for low, high in pairwise(edges):
        rows = (p >= low) & ((p < high) | (high == 1.0))
        quantity = f"home where {low:g}-{high:g} was predicted ({rows.sum()} plans, mean {p[rows].mean():.2f})"
        yield at_least(PLANT, "way home", quantity, home[rows].mean())


def band_rows(bands: list[tuple[bool, int]]) -> Iterator[Figure]:
    inside, drives = (np.array(values) for values in zip(*bands, strict=True))
    yield from within("energy by terrain, evening before", inside, "truth within P10-P90 [%]", 6.0)
    few = drives <= 3
    for name, rows in (("<= 3 drives", few), ("> 3 drives", ~few)):
        yield at_least(PLANT, f"energy by terrain, {name}", "truth within P10-P90 [%]", 100 * inside[rows].mean())


def on_a_slope(seed: int, prior: ConsumptionPrior) -> tuple[bool, bool]:
    """Is the energy of steep legs within its band, and is it above, after drives on gentle slopes?"""
    rng = np.random.default_rng([seed, 1234])
    world, c = draw_world(rng), start(prior)
    for _ in range(SLOPE_DRIVES):
        c = taught(begin_drive(c, days=1.0), drive(rng, world, draw_course(rng), LEARNING_S))
    legs = [replace(leg, grade_rad=STEEP_RAD, terrain=c.terrains[0]) for leg in draw_course(rng).legs[:4]]
    seen = drive(rng, world, Course(tuple(legs)), sum(leg.distance_m / leg.speed_m_s + leg.stop_s for leg in legs))
    demand = energy_demand(begin_drive(c, days=1.0), [d.stretch for d in stretches(seen)])
    band, true_J = quantiles(needed_J(demand, normal_points(DIMENSIONS))), float(np.sum(seen.power_W)) * DT_S
    return band.p10 <= true_J <= band.p90, true_J > band.p90


def slope_rows(name: str, found: np.ndarray) -> Iterator[Figure]:
    """found: (robots, 2) from `on_a_slope`."""
    plant = f"{len(found)} simulated robots, slope of {STEEP_RAD:g} after three drives on slopes of 0.03, {name}"
    inside, above = 100 * found.mean(axis=0)
    met = abs(inside - 80) <= 10
    yield Figure(plant, "energy of the climb", "truth within P10-P90 [%]", f"{inside:.1f}", "80 ± 10", met)
    yield at_most(plant, "energy of the climb", "truth above P90 [%]", above)


def within(method: str, hits: np.ndarray, quantity: str, tolerance: float, aim: float = 80.0) -> Iterator[Figure]:
    """A share that should be met within a tolerance: one figure, judged by its distance from the aim."""
    share = 100 * float(np.mean(hits))
    met = abs(share - aim) <= tolerance
    yield Figure(PLANT, method, quantity, f"{share:.1f}", f"{aim:g} ± {tolerance:g}", met)
