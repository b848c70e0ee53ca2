"""Slip on floors from whole arrays: the same model in other code, with scipy's densities and the rule that the curves
of the step stand for. The acceleration of the rims is a difference over 0.3 s, the floors' belief and the test for
other floors are loops over floats."""

import math
from itertools import product

import numpy as np
from scipy.stats import multivariate_normal

from kernels import kernel_of
from ohmward.traction.terrain.demand import drag_columns, inertial_forces, static_loads, undetermined_force_std
from ohmward.traction.terrain.floor import slip_belief
from ohmward.traction.terrain.recognition import MIXED_SHARE, UNSEEN_SHARE
from ohmward.traction.terrain.wheel_filter import WheelSample

RATE_S = 0.3


def whole_log(estimator, log):
    """travel_slip (T,), its sigma (T,), probability (T, wheels, floors) and times of crossings of a log."""
    wheels, robot, t = estimator.wheels, estimator.wheels.robot, log.time_s
    dt = np.diff(t, prepend=t[0])
    samples = WheelSample(dt, log.wheel_speed_rad_s, log.motor_current_A)
    first = WheelSample(0.0, *(values[0] for values in samples[1:]))
    _, belief = kernel_of(wheels, wheels.init(first), first).scan(wheels.init(first), samples)
    turning = belief.rim @ robot.rolling.T / robot.wheel.radius_m
    std = np.hypot(belief.force_std_N, undetermined_force_std(robot, turning))
    before = np.searchsorted(t, t - RATE_S)
    rate = (belief.rim - belief.rim[before]) / np.maximum(t - t[before], RATE_S)[:, None]
    force = belief.force_N - inertial_forces(robot, rate)
    share = floors_under(estimator.recognition, dt, belief.rim, force, std)
    slip, slip_std = slip_of(estimator.recognition, belief, std, share)
    return slip, slip_std, share, crossings(estimator.crossing, robot, t, belief.rim, force)


def floors_under(recognition, dt, rim, force, std):
    """Bayes' rule over all combinations."""
    floors, robot = recognition.all_floors, recognition.robot
    combinations = list(product(range(len(floors)), repeat=3))
    load = static_loads(robot).mean()
    D = drag_columns(robot, rim)
    weight = np.array([np.prod([1.0 if f < len(floors) - 1 else UNSEEN_SHARE for f in c]) for c in combinations])
    p = weight * [1.0 if len(set(c)) == 1 else MIXED_SHARE for c in combinations]
    apart = np.array([[sum(x != y for x, y in zip(a, b, strict=True)) for b in combinations] for a in combinations])
    near = (apart == 1) * weight
    near /= near.sum(axis=1, keepdims=True)
    p, found = p / p.sum(), []
    for k, step in enumerate(dt):
        likelihood = np.zeros(len(combinations))
        for i, c in enumerate(combinations):
            asked = np.column_stack([D[k, :, w] @ [floors[f].rolling, floors[f].roller] for w, f in enumerate(c)])
            off = asked * [floors[f].drag_std for f in c]
            S = off @ off.T + np.diag((load * max(floors[f].force_std for f in c)) ** 2 + std[k] ** 2)
            likelihood[i] = multivariate_normal.logpdf(force[k], asked.sum(axis=1), S)
        change = 1 - math.exp(-recognition.crossing_rate * step)
        p = ((1 - change) * p + change * p @ near) * np.exp(
            min(step / recognition.correlation_s, 1.0) * (likelihood - likelihood.max())
        )
        p = p / p.sum()
        found.append(
            [
                [sum(q for q, c in zip(p, combinations, strict=True) if c[w] == f) for f in range(len(floors))]
                for w in range(3)
            ]
        )
    return np.array(found)


def slip_of(recognition, belief, std, share):
    """Slip of the robot and its sigma, as a mixture over the floors."""
    robot = recognition.robot
    load = static_loads(robot)
    beliefs = [slip_belief(f, belief.force_N / load, std / load) for f in recognition.all_floors]
    mean = sum(share[..., k] * b.mean for k, b in enumerate(beliefs))
    travel, back = np.hypot(*belief.rim[:, :2].T), np.linalg.inv(robot.rolling)
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
    """Times of the alarms of Page's test."""
    load = static_loads(robot).mean()
    sums, mean, tested, motion, found = np.zeros((2, 3)), np.zeros(3), 0.0, np.zeros(2), []
    for k, dt in enumerate(np.diff(time_s, prepend=time_s[0])):
        f, now = force[k] / load, rim[k, :2]
        if np.linalg.norm(now - motion) > 0.3 * np.linalg.norm(motion):
            sums, mean, tested, motion = np.zeros((2, 3)), f, -test.settling_s, now
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
            found.append(time_s[k])
            sums, mean, tested, motion = np.zeros((2, 3)), f, 0.0, now
        else:
            mean = mean + dt / (min(tested, 3.0) + 0.3) * (f - mean)
    return found
