"""Robots, days, ground and batteries that exist only here, to test the predicted range and its bands.

Nothing here is shared with the estimator: power comes from torque and current of the motors at every instant, the
ground is rough along the way, days differ, sensors err, and the battery is stepped through time until it is empty.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.chemistries import generic_battery
from ohmward.energy.leg import Leg

GRAVITY = 9.80665
MASS_KG, RADIUS_M, TORQUE_NM_PER_A, WINDING_OHM = 42.0, 0.12, 0.517, 0.179
#: Median rolling resistance over load; each robot finds its own, by a factor of exp(0.4) either way.
TERRAINS = {"grass": 0.10, "gravel": 0.04, "asphalt": 0.025}
ROUGH_M, ROUGH_STD = 8.0, 0.25
DT_S = 1.0
BATTERY: Battery = generic_battery("lfp", 5.0, 8)
RESERVE_SOC = 0.1


class World(NamedTuple):
    """One robot and its surroundings.

    idle_W, efficiency, regeneration: of the electronics; battery to motor; motor to battery.
    rolling: (3,) resistance over load of each terrain; drag_s_per_m: its growth with speed.
    day_std: relative standard deviation from day to day.
    speed_gain, power_gain: of the sensors.
    """

    idle_W: float
    efficiency: float
    regeneration: float
    rolling: np.ndarray
    drag_s_per_m: float
    day_std: float
    speed_gain: float
    power_gain: float


class Course(NamedTuple):
    """A loop that the robot drives again and again."""

    legs: tuple[Leg, ...]


class Record(NamedTuple):
    """A drive as it was and as the sensors saw it, (T,) each."""

    time_s: np.ndarray
    terrain: np.ndarray
    speed_m_s: np.ndarray
    power_W: np.ndarray
    seen_speed_m_s: np.ndarray
    seen_power_W: np.ndarray
    seen_grade_rad: np.ndarray


def draw_world(rng: np.random.Generator) -> World:
    medians = np.array(list(TERRAINS.values()))
    return World(
        idle_W=rng.uniform(7.0, 18.0),
        efficiency=rng.uniform(0.8, 0.95),
        regeneration=rng.uniform(0.3, 0.8),
        rolling=medians * np.exp(0.4 * rng.standard_normal(3)),
        drag_s_per_m=0.02 * np.exp(0.5 * rng.standard_normal()),
        day_std=rng.uniform(0.03, 0.2),
        speed_gain=1 + 0.01 * rng.standard_normal(),
        power_gain=1 + 0.01 * rng.standard_normal(),
    )


def draw_course(rng: np.random.Generator) -> Course:
    """Twelve legs of 20 to 80 m with short stops; what is climbed is lost again."""
    lengths = rng.uniform(20.0, 80.0, 12)
    grades = 0.03 * rng.standard_normal(12)
    grades -= np.sum(grades * lengths) / np.sum(lengths)
    names = rng.choice(list(TERRAINS), 12, p=rng.dirichlet([1.5, 1.5, 1.5]))
    legs = (
        Leg(float(d), str(name), float(rng.uniform(0.3, 0.9)), float(g), float(rng.uniform(0.0, 30.0)))
        for d, name, g in zip(lengths, names, grades, strict=True)
    )
    return Course(tuple(legs))


def draw_day(rng: np.random.Generator, w: World) -> np.ndarray:
    """(3,) what a day makes of the resistance of each terrain."""
    return np.exp(w.day_std * (rng.standard_normal() + rng.standard_normal(3)) / np.sqrt(2))


def drive(
    rng: np.random.Generator,
    w: World,
    course: Course,
    duration_s: float,
    payload_kg: float = 0.0,
    day: np.ndarray | None = None,
) -> Record:
    """A drive of one day, drawn unless it is given: the loop over and over."""
    legs, speed, index = [], [], []
    total = 0
    while total < duration_s / DT_S:
        for k, leg in enumerate(course.legs):
            profile = _speed(leg, rng)
            speed.append(profile)
            index.append(np.full(profile.size, k))
            total += profile.size
    v, at = np.concatenate(speed)[: int(duration_s / DT_S)], np.concatenate(index)[: int(duration_s / DT_S)]
    legs = course.legs
    names = np.array([leg.terrain for leg in legs], dtype=object)[at]
    grade = np.array([leg.grade_rad for leg in legs])[at]
    numbers = np.array([list(TERRAINS).index(leg.terrain) for leg in legs])[at]
    day = draw_day(rng, w) if day is None else day
    resistance = (w.rolling * day)[numbers] * (1 + _roughness(rng, v)) + w.drag_s_per_m * v
    power = _power_W(w, v, grade, resistance, MASS_KG + payload_kg)
    return Record(
        DT_S * np.arange(v.size),
        names,
        v,
        power,
        w.speed_gain * v + np.where(v > 0, 0.02, 0.003) * rng.standard_normal(v.size),
        w.power_gain * power + 0.5 * rng.standard_normal(v.size),
        grade + 0.02 * rng.standard_normal(v.size),
    )


def soc_along(
    power_W: np.ndarray, soc: np.ndarray, soh_capacity: np.ndarray, resistance_ratio: np.ndarray
) -> np.ndarray:
    """(N, T) state of charge of N batteries after each second at the powers (N, T) of their own drives."""
    model = BATTERY.thevenin
    assert model is not None
    grid = np.linspace(0.0, 1.0, 1001)
    ocv = model.ocv.mean_V(grid, 25.0) - model.ocv.hysteresis_at(grid)
    r0, pairs = model.r0_discharge_ohm[0] * resistance_ratio, [row[0] * resistance_ratio for row in model.r_ohm]
    decays = [np.exp(-DT_S / tau) for tau in model.tau_s]
    z, volts = soc.copy(), np.full(soc.size, ocv[-1])
    polarised, along = [np.zeros(soc.size) for _ in pairs], np.empty(power_W.shape)
    for k in range(power_W.shape[1]):
        current = power_W[:, k] / volts
        z = z - current * DT_S / (3600.0 * BATTERY.capacity_Ah * soh_capacity)
        polarised = [d * u + (1 - d) * r * current for d, u, r in zip(decays, polarised, pairs, strict=True)]
        volts = np.interp(z, grid, ocv) - r0 * current - sum(polarised)
        along[:, k] = z
    return along


def reached(
    power_W: list[np.ndarray], soc: np.ndarray, soh_capacity: np.ndarray, resistance_ratio: np.ndarray
) -> np.ndarray:
    """(N,) number of steps that each battery lasts, stepped through time at the powers of its own drive."""
    steps = max(map(len, power_W))
    P = np.array([np.pad(p, (0, steps - len(p)), constant_values=p[-1]) for p in power_W])
    empty = soc_along(P, soc, soh_capacity, resistance_ratio) <= RESERVE_SOC
    return np.where(empty.any(axis=1), empty.argmax(axis=1), steps)


def _speed(leg: Leg, rng: np.random.Generator) -> np.ndarray:
    """Speed of each step of a leg: ramps of 0.4 m/s2, a cruise that is not quite the planned one, a stop."""
    cruise = leg.speed_m_s * (1 + 0.03 * rng.standard_normal())
    ramp_s = cruise / 0.4
    moving_s = leg.distance_m / cruise + ramp_s
    t = np.arange(0.0, moving_s + leg.stop_s, DT_S) + DT_S / 2
    return cruise * np.clip(np.minimum(t, moving_s - t) / ramp_s, 0.0, 1.0)


def _roughness(rng: np.random.Generator, v: np.ndarray) -> np.ndarray:
    """Share by which the resistance differs along the way, correlated over some metres."""
    from scipy.signal import lfilter

    place_m = np.cumsum(v) * DT_S
    decay = np.exp(-1.0 / ROUGH_M)
    noise = ROUGH_STD * np.sqrt(1 - decay**2) * rng.standard_normal(int(place_m[-1]) + 200)
    return np.interp(place_m, np.arange(noise.size - 100), lfilter([1.0], [1.0, -decay], noise)[100:])


def _power_W(w: World, v: np.ndarray, grade: np.ndarray, resistance: np.ndarray, mass_kg: float) -> np.ndarray:
    """Power [W] out of the battery: force, torque, current, heat of two windings, electronics."""
    moving = v > 0
    force = mass_kg * (np.gradient(v, DT_S) + GRAVITY * (np.sin(grade) + resistance) * moving)
    current = force * RADIUS_M / 2 / TORQUE_NM_PER_A
    electrical = force * v + 2 * WINDING_OHM * current**2
    return w.idle_W + np.where(electrical > 0, electrical / w.efficiency, electrical * w.regeneration)
