"""Slip on floors from whole arrays: the same model in other code, with scipy's densities and the rule that the curves
of the step stand for. The acceleration of the rims is a difference over 0.3 s, the floors' belief and the test for
other floors are loops over floats."""

import math
from itertools import product

import numpy as np
from scipy.stats import multivariate_normal

from ohmward.traction.motion.sample import samples_of
from ohmward.traction.terrain.floor import (
    drag_columns,
    inertial_forces,
    slip_scale,
    static_loads,
    undetermined_force_std,
)
from ohmward.traction.terrain.recognition import (
    LIKE_SHARE,
    MIXED_SHARE,
    MU_MEMORY_S,
    NEW_FLOOR_ODDS,
    PERSISTENT_SHARE,
    RIGHT_SHARE,
    SETTLING_S,
)
from traction.terrain.drives import along
from traction.terrain.slip_rule import slip_belief

RATE_S = 0.3


def whole_log(estimator, log):
    """travel_slip (T,), its sigma (T,), probability (T, wheels, floors) and times of crossings of a log."""
    wheels, robot, t = estimator.wheels, estimator.wheels.robot, log.time_s
    _, belief = along(wheels, samples_of(log, robot))
    turning = belief.rim @ robot.rolling.T / robot.wheel.radius_m
    std = np.hypot(belief.force_std_N, undetermined_force_std(robot, turning))
    before = np.searchsorted(t, t - RATE_S)
    rate = (belief.rim - belief.rim[before]) / np.maximum(t - t[before], RATE_S)[:, None]
    force = belief.force_N - inertial_forces(robot, rate)
    friction = undetermined_force_std(robot, turning)
    events = crossings(estimator.crossing, robot, t, belief.rim, force)
    share = floors_under(estimator.recognition, t, belief.rim, force, belief.force_std_N, friction, events)
    slip, slip_std = slip_of(estimator.recognition, belief, std, share)
    known = len(estimator.recognition.floors)
    by_name = np.concatenate([share[..., :known], share[..., known:].sum(axis=-1, keepdims=True)], axis=-1)
    return slip, slip_std, by_name, t[events == 2].tolist()


def floors_under(recognition, t, rim, force, noise, friction, events):
    """Bayes' rule over all combinations, from the mean force since the last event: -1 stands, 1 starts, 2 crosses."""
    floors, robot, known = recognition.all_floors, recognition.robot, len(recognition.floors)
    single = [*range(known), len(floors) - 1]
    odds = [*[1.0] * known, *[NEW_FLOOR_ODDS * LIKE_SHARE / known] * known, NEW_FLOOR_ODDS * (1 - LIKE_SHARE)]
    mixed = [c for c in product(single, repeat=3) if len(set(c)) > 1]
    combinations = [*((k, k, k) for k in range(len(floors))), *mixed]
    weight = np.array([odds[c[0]] if len(set(c)) == 1 else np.prod([odds[f] for f in c]) for c in combinations])
    alone = np.arange(len(combinations)) < len(floors)
    usual = np.where(
        alone, (1 - MIXED_SHARE) * weight / weight[alone].sum(), MIXED_SHARE * weight / weight[~alone].sum()
    )
    apart = np.array([[sum(x != y for x, y in zip(a, b, strict=True)) for b in combinations] for a in combinations])
    near = np.array([[weight[i] * (row[i] == row[row > 0].min()) for i in range(len(row))] for row in apart])
    near /= near.sum(axis=1, keepdims=True)
    load = static_loads(robot).mean()
    D = drag_columns(robot, rim)
    p, prior, mean, averaged, found = usual, usual, np.zeros(3), -SETTLING_S, []
    for k, dt in enumerate(np.diff(t, prepend=t[0])):
        prior = {1: p if averaged > 0 else prior, 2: (1 - RIGHT_SHARE) * p + RIGHT_SHARE * p @ near}.get(
            events[k], prior
        )
        averaged = {1: -SETTLING_S, 2: 0.0}.get(events[k], min(averaged + dt, MU_MEMORY_S))
        mean = force[k] if averaged <= dt else mean + dt / averaged * (force[k] - mean)
        kept = math.exp(-recognition.crossing_rate * dt)
        prior = kept * prior + (1 - kept) * usual
        white = min(recognition.correlation_s / max(averaged, 1e-9), 1.0) if averaged > 0 else 1.0
        likelihood = np.zeros(len(combinations))
        for i, c in enumerate(combinations):
            asked = np.column_stack([D[k, :, w] @ [floors[f].rolling, floors[f].roller] for w, f in enumerate(c)])
            off = asked * [floors[f].drag_std for f in c]
            own = (PERSISTENT_SHARE + (1 - PERSISTENT_SHARE) * white) * (
                load * max(floors[f].force_std for f in c)
            ) ** 2
            S = off @ off.T + np.diag(own + white * noise[k] ** 2 + friction[k] ** 2)
            likelihood[i] = multivariate_normal.logpdf(mean, asked.sum(axis=1), S)
        p = prior * np.exp(likelihood - likelihood.max())
        p = p / p.sum()
        by_wheel = [[p[[c[w] == f for c in combinations]].sum() for f in range(len(floors))] for w in range(3)]
        found.append(by_wheel)
    return np.array(found)


def slip_of(recognition, belief, std, share):
    """Slip of the robot and its sigma, as a mixture over the floors."""
    robot = recognition.robot
    load = static_loads(robot)
    travel = np.hypot(*belief.rim[:, :2].T)
    moved = belief.rim @ robot.rolling.T, belief.rim @ robot.sideways.T, travel[:, None]
    beliefs = [slip_belief(f, belief.force_N / load, std / load, slip_scale(f, *moved)) for f in recognition.all_floors]
    weight = share**2 / (share**2).sum(axis=-1, keepdims=True)
    mean = sum(weight[..., k] * b.mean for k, b in enumerate(beliefs))
    back = np.linalg.inv(robot.rolling)
    motion = belief.rim - travel[:, None] * mean @ back.T
    speed = np.hypot(*motion[:, :2].T)
    variance = []
    for t in range(len(mean)):
        cov = np.zeros((3, 3))
        for k, b in enumerate(beliefs):
            p = share[t, :, k]
            part = np.outer(p, p) * b.cov[t]
            np.fill_diagonal(part, p * (np.diag(b.cov[t]) + (b.mean[t] - mean[t]) ** 2))
            cov += part
        along = motion[t, :2] / max(speed[t], 1e-6) @ back[:2]
        variance.append(along @ cov @ along)
    return 1 - speed / np.maximum(travel, 1e-6), np.sqrt(variance)


def crossings(test, robot, time_s, rim, force):
    """Events (T,) of Page's test: 2 for an alarm, 1 where it starts anew."""
    load = static_loads(robot).mean()
    sums, mean, tested, motion, found = np.zeros((2, 3)), np.zeros(3), 0.0, np.zeros(2), np.zeros(len(time_s))
    for k, dt in enumerate(np.diff(time_s, prepend=time_s[0])):
        f, now = force[k] / load, rim[k, :2]
        if np.linalg.norm(now - motion) > 0.3 * np.linalg.norm(motion):
            sums, mean, tested, motion = np.zeros((2, 3)), f, -test.settling_s, now
            found[k] = 1
            continue
        tested += dt
        if tested < 0:
            mean, motion = mean + 0.5 * dt / 0.3 * (f - mean), now
            continue
        e = drag_columns(robot, rim[k]) @ [test.rolling_step, test.roller_step] / load
        tau = max(test.ripple_m / np.linalg.norm(now), 0.1)
        variance = test.ripple_share**2 + test.ripple_growth**2 * (mean @ mean)
        k2 = np.sum(e * e, axis=0) / variance
        g = (f - mean) @ e / variance
        sums = np.maximum(0.0, sums + dt / tau * (np.array([g, -g]) - k2 / 2))
        wanted = 3600 / test.false_alarms_per_hour * 6 * k2 / (2 * tau)
        h = np.log(wanted + 2)
        for _ in range(50):
            h = np.log(wanted + 1 + h)
        if (sums > h).any():
            found[k] = 2
            sums, mean, tested, motion = np.zeros((2, 3)), f, 0.0, now
        else:
            mean = mean + dt / (min(tested, 3.0) + 0.3) * (f - mean)
    return found
