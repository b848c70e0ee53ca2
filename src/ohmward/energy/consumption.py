"""Energy that a robot takes, by terrain, speed, slope and load: a linear model learned with its uncertainty.

A stretch of time t, distance d, mean speed v, potential and kinetic energy won L, and load share q = m / m_0 takes

E = idle t + q d [ f_k (1 + load + own_k) + c v ] + a (L + B) - b B + r (W / d)^2 d / v + e
W = q d f_k / a + L,     B = max(-W, 0),     e ~ N(0, sigma^2 (q f_k)^2 d)

f_k [N] is the resistance of terrain k, losses of the drive included; W is the work of the wheels, and its force heats
the windings by r. What is lost in height is saved as far as the resistance takes it; beyond that the robot brakes, and
b of the energy B comes back. `load` and `own_k` are what is different on this drive: payload, tyre pressure, wet grass;
each drive draws them anew from N(0, tau^2 / 2). So what was learned on many drives is told apart from what this one
shows, a mission under way sees its own day, and the next day is as uncertain as days are. Scatter comes in lumps of
ground: sigma^2 [m] is their length times the square of their relative deviation, and long stretches average them;
standing teaches the idle power only.

Coefficients are Gaussian; sigma^2 and tau^2 are inverse-gamma, so that what is predicted follows Student's t. For known
variances this is exact Bayesian regression. The variances are learned from the part of each surprise that the update
leaves to them (MacKay's count of well-determined parameters): with known coefficients that is the conjugate
normal-inverse-gamma rule. The fully conjugate prior is not used, because there a smooth floor would make the robot
sure of terrains that it has never seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ohmward.checks import require_between, require_finite
from ohmward.energy.consumption_prior import ConsumptionPrior
from ohmward.energy.leg import Stretch
from ohmward.errors import InputError
from ohmward.traction.robot.robot import GRAVITY

#: What every terrain shares, in the order of the vector; then `force` and `own` of each terrain.
SHARED = ("idle_W", "speed_N_s_per_m", "climb", "regain", "heat_W_per_N2", "load")
CLIMB, HEAT, LOAD = (SHARED.index(name) for name in ("climb", "heat_W_per_N2", "load"))
_DAYS_PER_MONTH = 30.0
#: Idle power is steadier than ground: it scatters as a resistance would at this speed.
_IDLE_SPEED_M_S = 30.0
_LEAST_FORCE = 0.1
#: A shorter stretch is a start or a stop: it says nothing of the ground.
_SHORTEST_M = 3.0
#: A drive tells of its own day only where it has narrowed it by this share.
_LEAST_INFORMATION = 0.02


class Variance(NamedTuple):
    """A variance with an inverse-gamma distribution: scale / dof its usual value, dof how surely it is known."""

    dof: float
    scale: float

    @property
    def value(self) -> float:
        """The variance to compute with."""
        return self.scale / self.dof

    def learned(self, square: float, share: float) -> Variance:
        """After an observation whose surprise leaves `share` of a degree of freedom to it, and this square."""
        return Variance(float(self.dof + share), float(self.scale + square))


class Visits(NamedTuple):
    """How much was driven on a terrain."""

    drives: int = 0
    distance_m: float = 0.0
    time_s: float = 0.0
    energy_J: float = 0.0


@dataclass(frozen=True, eq=False)
class Consumption:
    """What is known of a robot's consumption. Immutable: `learn` and `begin_drive` return a new one.

    Attributes:
        prior: what was believed at the start.
        terrains: (K,) names, in the order in which they were met.
        mean: (6 + 2 K,) coefficients: `SHARED`, then force [N] and own share of each terrain.
        cov: their covariance.
        reference_N: (K,) forces to which the shares of this drive belong.
        scatter: sigma^2 [m].
        day: tau^2.
        visits: (K,) what was driven there.
        on_this_drive: terrains of the drive under way.
        last_drive_unix_s: when the last drive ended, where its log had a wall clock.
    """

    prior: ConsumptionPrior
    terrains: tuple[str, ...]
    mean: np.ndarray
    cov: np.ndarray
    reference_N: tuple[float, ...]
    scatter: Variance
    day: Variance
    visits: tuple[Visits, ...] = ()
    on_this_drive: tuple[str, ...] = ()
    last_drive_unix_s: float | None = None

    def __post_init__(self) -> None:
        n = len(SHARED) + 2 * len(self.terrains)
        if self.mean.shape != (n,) or self.cov.shape != (n, n):
            raise InputError(
                f"consumption of {len(self.terrains)} terrains needs mean ({n},) and cov ({n}, {n}), "
                f"got {self.mean.shape} and {self.cov.shape}"
            )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the coefficients."""
        return SHARED + tuple(f"{kind}:{name}" for name in self.terrains for kind in ("force_N", "own"))

    def force_index(self, terrain: str) -> int:
        """Where the force of a terrain stands; its own share of this drive follows."""
        return len(SHARED) + 2 * self.terrains.index(terrain)


class EnergyDemand(NamedTuple):
    """Energy that stretches will take: mean, and variances by what is not known.

    mean_J: expected.
    learned_J2: coefficients and model.
    day_J2: what differs from drive to drive.
    scatter_J2: what differs from place to place.
    day_dof, scatter_dof: how well the last two are known.
    """

    mean_J: float
    learned_J2: float
    day_J2: float
    scatter_J2: float
    day_dof: float
    scatter_dof: float

    @property
    def std_J(self) -> float:
        """Standard deviation of all together."""
        return float(np.sqrt(self.learned_J2 + self.day_J2 + self.scatter_J2))


def start(prior: ConsumptionPrior) -> Consumption:
    """What is known before the first drive."""
    p = prior
    mean = np.array([p.idle_W, p.speed_N_s_per_m, p.climb, p.regain, p.heat_W_per_N2, 0.0])
    std = [p.idle_std_W, p.speed_std_N_s_per_m, p.climb_std, p.regain_std, p.heat_std_W_per_N2, 0.0]
    day = Variance(prior.dof, prior.dof * prior.day_std**2)
    scatter = Variance(prior.dof, prior.dof * prior.scatter_m)
    return begin_drive(Consumption(prior, (), mean, np.diag(np.square(std)), (), scatter, day))


def begin_drive(c: Consumption, days: float = 0.0) -> Consumption:
    """A new drive after so many days: the last one teaches how much drives differ, and what it was is forgotten."""
    require_between("days", days, 0.0, np.inf)
    day = _learn_day(c)
    shares = [LOAD, *(c.force_index(name) + 1 for name in c.terrains)]
    mean, cov = c.mean.copy(), c.cov.copy()
    mean[shares] = 0.0
    cov[shares, :] = cov[:, shares] = 0.0
    cov[shares, shares] = day.value / 2
    cov += np.diag(_drift_variance(c, days))
    reference = tuple(max(mean[c.force_index(name)], 0.0) for name in c.terrains)
    return replace(c, mean=mean, cov=cov, reference_N=reference, day=day, on_this_drive=())


def learn(c: Consumption, stretch: Stretch, energy_J: float) -> Consumption:
    """What is known after a stretch took this much from the battery; one of less than 3 m is counted only.

    Raises:
        InputError: a time, distance or height below zero, or an energy that is no number.
    """
    _check(stretch, energy_J)
    c = with_terrain(c, stretch.terrain) if stretch.terrain else c
    x, scattered = features(c, stretch), lumps(c, stretch)
    if scattered <= 0.0 or (stretch.terrain and stretch.distance_m < _SHORTEST_M):
        return _visited(c, stretch, energy_J) if stretch.terrain else c
    noise_J2 = c.scatter.value * scattered
    spread_J2 = x @ c.cov @ x + noise_J2
    surprise_J = energy_J - x @ c.mean
    gain = c.cov @ x / spread_J2
    keep = np.eye(len(x)) - np.outer(gain, x)
    cov = keep @ c.cov @ keep.T + noise_J2 * np.outer(gain, gain)
    c = replace(c, mean=c.mean + gain * surprise_J, cov=cov)
    if not stretch.terrain:
        return c
    left_J = surprise_J * noise_J2 / spread_J2
    scatter = c.scatter.learned(left_J**2 / scattered, noise_J2 / spread_J2)
    return _visited(replace(c, scatter=scatter), stretch, energy_J)


def need(c: Consumption, stretches: Sequence[Stretch]) -> EnergyDemand:
    """Energy that stretches of the drive under way will take; for another day call `begin_drive` first.

    Raises:
        InputError: a terrain that is not known; `with_terrain` adds one with the prior's uncertainty.
    """
    x = np.sum([features(c, s) for s in stretches], axis=0)
    shares = np.zeros(len(x), dtype=bool)
    shares[[LOAD, *(c.force_index(name) + 1 for name in c.terrains)]] = True
    all_J2, day_J2 = x @ c.cov @ x, x[shares] @ c.cov[np.ix_(shares, shares)] @ x[shares]
    scattered = sum(lumps(c, s) for s in stretches)
    return EnergyDemand(
        float(x @ c.mean),
        float(max(all_J2 - day_J2, 0.0) + (c.prior.model_std * (x @ c.mean)) ** 2),
        float(min(day_J2, all_J2)),
        c.scatter.value * scattered,
        c.day.dof,
        c.scatter.dof,
    )


def with_terrain(c: Consumption, name: str) -> Consumption:
    """The same with a terrain that has not been met; unchanged where it has."""
    if name in c.terrains:
        return c
    force_N = c.prior.force_of(name)
    std_N = c.prior.force_std_N * force_N / c.prior.force_N
    n = len(c.mean)
    cov = np.zeros((n + 2, n + 2))
    cov[:n, :n] = c.cov
    cov[n, n], cov[n + 1, n + 1] = std_N**2, c.day.value / 2
    return replace(
        c,
        terrains=(*c.terrains, name),
        mean=np.concatenate([c.mean, [force_N, 0.0]]),
        cov=cov,
        reference_N=(*c.reference_N, force_N),
        visits=(*c.visits, Visits()),
    )


def features(c: Consumption, stretch: Stretch) -> np.ndarray:
    """What each coefficient is multiplied by (6 + 2 K,) on this stretch."""
    x = np.zeros(len(c.mean))
    lift_J, braking_J = energy_won_J(c, stretch), max(-work_J(c, stretch), 0.0)
    x[:2] = stretch.time_s, loaded(c, stretch) * stretch.speed_distance_m2_s
    x[2:4] = lift_J + braking_J, -braking_J
    if stretch.terrain:
        _require_known(c, stretch.terrain)
        k, q_d = c.force_index(stretch.terrain), loaded(c, stretch) * stretch.distance_m
        share_J = q_d * c.reference_N[c.terrains.index(stretch.terrain)]
        x[[k, k + 1, LOAD]] = q_d, share_J, share_J
        x[HEAT] = pull_N(c, stretch) ** 2 * moving_s(stretch)
    return x


def loaded(c: Consumption, stretch: Stretch) -> float:
    """q: mass with payload over the mass that the forces belong to."""
    return (c.prior.mass_kg + stretch.payload_kg) / c.prior.mass_kg


def force_N(c: Consumption, terrain: str) -> float:
    """Resistance [N] as it is known now; never below a tenth of what was expected, where squares are made of it."""
    return max(float(c.mean[c.force_index(terrain)]), _LEAST_FORCE * c.prior.force_of(terrain))


def energy_won_J(c: Consumption, stretch: Stretch) -> float:
    """L: potential and kinetic energy won, < 0 where it is lost."""
    per_kg = GRAVITY * (stretch.climb_m - stretch.descent_m) + stretch.kinetic_m2_s2
    return (c.prior.mass_kg + stretch.payload_kg) * per_kg


def work_J(c: Consumption, stretch: Stretch) -> float:
    """W: work of the wheels; < 0 where they brake."""
    if not stretch.terrain:
        return 0.0
    _require_known(c, stretch.terrain)
    resistance_N = loaded(c, stretch) * force_N(c, stretch.terrain) / max(float(c.mean[CLIMB]), 1.0)
    return resistance_N * stretch.distance_m + energy_won_J(c, stretch)


def pull_N(c: Consumption, stretch: Stretch) -> float:
    """W / d: mean force [N] of the wheels."""
    return work_J(c, stretch) / stretch.distance_m if stretch.distance_m else 0.0


def moving_s(stretch: Stretch) -> float:
    """Time [s] without the stops, at the mean speed."""
    return stretch.distance_m**2 / stretch.speed_distance_m2_s if stretch.speed_distance_m2_s else 0.0


def lumps(c: Consumption, stretch: Stretch) -> float:
    """What sigma^2 is multiplied by [N^2 m]: resistance squared times distance, and idle power as if at 30 m/s."""
    idle = c.prior.idle_W**2 * stretch.time_s / _IDLE_SPEED_M_S
    if not stretch.terrain:
        return idle
    _require_known(c, stretch.terrain)
    resistance_N = loaded(c, stretch) * force_N(c, stretch.terrain)
    return idle + resistance_N**2 * stretch.distance_m


def _learn_day(c: Consumption) -> Variance:
    """tau^2 after the drive that ends: each share has the variance tau^2 / 2, as far as the drive has shown it."""
    day = c.day
    shares = [c.force_index(name) + 1 for name in c.on_this_drive]
    for k in [LOAD, *shares] if shares else []:
        information = 1.0 - c.cov[k, k] / (c.day.value / 2)
        if information > _LEAST_INFORMATION:
            day = day.learned(2 * c.mean[k] ** 2, information)
    return day


def _drift_variance(c: Consumption, days: float) -> np.ndarray:
    """What the coefficients have changed in so many days: a random walk."""
    std = np.zeros(len(c.mean))
    std[SHARED.index("idle_W")] = c.prior.drift_std * c.prior.idle_W
    for name in c.terrains:
        std[c.force_index(name)] = c.prior.drift_std * c.prior.force_of(name)
    return std**2 * days / _DAYS_PER_MONTH


def _visited(c: Consumption, stretch: Stretch, energy_J: float) -> Consumption:
    """With the counts of its terrain after a stretch."""
    k, first = c.terrains.index(stretch.terrain), stretch.terrain not in c.on_this_drive
    v = c.visits[k]
    now = Visits(v.drives + first, v.distance_m + stretch.distance_m, v.time_s + stretch.time_s, v.energy_J + energy_J)
    drive = (*c.on_this_drive, stretch.terrain) if first else c.on_this_drive
    return replace(c, visits=(*c.visits[:k], now, *c.visits[k + 1 :]), on_this_drive=drive)


def _require_known(c: Consumption, terrain: str) -> None:
    if terrain not in c.terrains:
        known = ", ".join(c.terrains) or "none yet"
        raise InputError(
            f"terrain {terrain!r} is not in the consumption table, which knows: {known}; name one of these, or drive "
            "there once and learn it"
        )


def _check(stretch: Stretch, energy_J: float) -> None:
    for name in ("time_s", "distance_m", "speed_distance_m2_s", "climb_m", "descent_m", "payload_kg"):
        require_between(f"stretch.{name}", getattr(stretch, name), 0.0, np.inf)
    require_finite("stretch.kinetic_m2_s2", stretch.kinetic_m2_s2)
    if not np.isfinite(energy_J):
        raise InputError(f"energy_J must be finite, got {energy_J}; leave out stretches without a battery power")
