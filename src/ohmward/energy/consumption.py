"""Energy consumption of a robot by terrain, speed, slope and load: a regression with its uncertainty.

A stretch of duration t, with t_d of it under way over the distance d at the mean speed v, with the potential and
kinetic energy gained L and the mass ratio q = m / m_0, takes

E = idle t + q d [ f_k (1 + delta + delta_k) + c v ] + a (L + B) - b B + r (W / d)^2 t_d + e
W = q d (f_k + c v) / a + L,     B = max(-W, 0),     e ~ N(0, sigma^2 (q f_k)^2 d + s^2 t)

f_k [N] is the resistance of terrain k, losses of the drive included; W is the work of the wheels, whose force W / d
heats the windings; W depends on the coefficients, so the filter is an extended one. A descent saves energy as far as
the resistance takes it up; beyond that the robot brakes, and recovers the share b of the braking energy B
(regeneration efficiency). delta and delta_k are the day effects, of all terrains and of one: payload, tyre pressure,
wet grass; each drive has its own, from N(0, tau^2 / 2). This separates differences between drives from uncertainty
about the robot: a mission under way learns its own day effects, and the next day is uncertain by the usual variation
between days. The scatter e comes from uneven ground, sigma^2 [m] being its correlation length times the square of its
relative standard deviation, and from an idle power that varies with the noise density s^2 [W^2 s]; long stretches
average both out. Standing updates idle power and s^2 only, and not where it takes more than driving: that is work of a
tool.

Coefficients are Gaussian; sigma^2, s^2 and tau^2 are inverse-gamma, so that predictions follow Student's t. For known
variances this is Bayesian regression, exact where the wheels never brake and the windings do not heat. The variances
are learned from the part of each innovation that the update attributes to them (MacKay's count of well-determined
parameters): with known coefficients this is the conjugate normal-inverse-gamma rule. The fully conjugate prior is not
used: with it, a smooth floor would make the robot certain of terrains that it has never driven on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from ohmward.checks import require_between, require_finite
from ohmward.energy.consumption_prior import ConsumptionPrior
from ohmward.energy.discharge_end import DischargeEnd
from ohmward.energy.leg import Stretch
from ohmward.errors import InputError
from ohmward.filters import kalman
from ohmward.filters.belief import Belief, Innovation, nis
from ohmward.quantities import DAY_S, FIRST_DATE_S
from ohmward.traction.robot.robot import GRAVITY

#: Coefficients shared by all terrains, in order; `force_N` and `day_effect` of each terrain follow.
SHARED = ("idle_W", "speed_N_s_per_m", "climb", "regeneration", "heat_W_per_N2", "day_effect")
IDLE, SPEED, CLIMB, REGENERATION, HEAT, DAY_EFFECT = range(len(SHARED))
_DAYS_PER_MONTH = 30.0
#: Before the first drive, idle power varies less than resistance: it scatters like a resistance at this speed.
_IDLE_SPEED_M_S = 30.0
#: Smallest resistance used in squares, relative to the expected one.
_LEAST_FORCE = 0.1
#: Shortest stretch that updates the coefficients of a terrain: a shorter one is a start or a stop.
SHORTEST_M = 3.0
#: Shortest distance over which the wheels' work becomes a force: the speed may jump between two samples.
_LEAST_M = 0.01
#: NIS above which the filter iterates, with half steps, and the largest number of iterations. On ground as expected,
#: iterating would mistake scatter for heat.
_UNEXPECTED_NIS, _LINEARISATIONS = 9.0, 8
#: Time by which standing seems to begin or end late or early, as power and speed are measured with different lags [s].
_LAG_S = 1.0
#: Standard deviations by which the idle power must exceed the power under way to be refuted by it.
_REFUTED_STDS = 3.0
#: A drive updates the variance of the day effects only where it has reduced that of its own by this share.
_LEAST_NARROWED = 0.02


@dataclass(frozen=True, eq=False)
class Consumption:
    """Belief about a robot's consumption. Immutable: `learn` and `begin_drive` return a new one.

    >>> table = ow.load_consumption("table.toml")
    >>> table.terrains
    ('grass',)
    """

    prior: ConsumptionPrior  #: belief before the first drive
    terrains: tuple[str, ...]  #: (K,) names, in the order in which they were met
    mean: np.ndarray  #: (6 + 2 K,) coefficients: `SHARED`, then force [N] and day effect of each terrain
    cov: np.ndarray  #: their covariance
    reference_N: tuple[float, ...]  #: (K,) forces that the day effects of this drive are relative to
    scatter: Variance  #: sigma^2 [m]
    day: Variance  #: tau^2
    idle_noise: Variance  #: s^2 [W^2 s]
    visits: tuple[Visits, ...] = ()  #: (K,) totals of all drives there
    on_this_drive: tuple[str, ...] = ()  #: terrains of the drive under way
    last_drive_unix_s: float | None = None  #: when the last drive ended, where its log had a wall clock
    end: DischargeEnd | None = None  #: last discharge that ended at the cut-off

    def __post_init__(self) -> None:
        n = len(SHARED) + 2 * len(self.terrains)
        if self.mean.shape != (n,) or self.cov.shape != (n, n):
            raise InputError(
                f"consumption of {len(self.terrains)} terrains needs mean ({n},) and cov ({n}, {n}), "
                f"got {self.mean.shape} and {self.cov.shape}"
            )

    def days_until(self, unix_s: float | None) -> float | None:
        """Days from the last drive to a date, >= 0; None without the date of either."""
        before_s = self.last_drive_unix_s
        if before_s is None or unix_s is None or min(before_s, unix_s) < FIRST_DATE_S:
            return None
        return max(unix_s - before_s, 0.0) / DAY_S

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the coefficients."""
        return SHARED + tuple(f"{kind}:{name}" for name in self.terrains for kind in ("force_N", "day_effect"))

    @property
    def day_effects(self) -> list[int]:
        """Indices of all day effects."""
        return [DAY_EFFECT, *(self.day_effect_index(name) for name in self.terrains)]

    def force_index(self, terrain: str) -> int:
        """Index of the force of a terrain.

        Raises:
            InputError: a terrain that is not known; `with_terrain` adds one with the prior's uncertainty.
        """
        if terrain not in self.terrains:
            known = ", ".join(self.terrains) or "none yet"
            raise InputError(
                f"terrain {terrain!r} is not in the consumption table, which knows: {known}; name one of these, or "
                "drive there once and learn it"
            )
        return len(SHARED) + 2 * self.terrains.index(terrain)

    def day_effect_index(self, terrain: str) -> int:
        """Index of the day effect of a terrain."""
        return self.force_index(terrain) + 1


class EnergyDemand(NamedTuple):
    """Energy that stretches will take: mean, and variances by their cause; numbers, or (K,) along a route."""

    mean_J: Any  #: expected
    learned_J2: Any  #: coefficients and model
    day_J2: Any  #: day effects, which differ from drive to drive
    scatter_J2: Any  #: uneven ground, which differs from place to place
    #: degrees of freedom of the last two
    day_dof: float
    scatter_dof: float

    def at(self, rows: Any) -> EnergyDemand:
        """Demand up to some points of a route, by their indices."""
        along = {name: getattr(self, name)[rows] for name in ("mean_J", "learned_J2", "day_J2", "scatter_J2")}
        return self._replace(**along)

    @property
    def std_J(self) -> float:
        """Standard deviation from all causes together."""
        return float(np.sqrt(self.learned_J2 + self.day_J2 + self.scatter_J2))


def start(prior: ConsumptionPrior) -> Consumption:
    """Belief before the first drive."""
    p = prior
    mean = np.array([p.idle_W, p.speed_N_s_per_m, p.climb, p.regeneration, p.heat_W_per_N2, 0.0])
    std = [p.idle_std_W, p.speed_std_N_s_per_m, p.climb_std, p.regeneration_std, p.heat_std_W_per_N2, 0.0]
    day = Variance(p.dof, p.dof * p.day_std**2)
    scatter = Variance(p.dof, p.dof * p.scatter_m)
    idle_noise = Variance(p.dof, p.dof * p.scatter_m * p.idle_W**2 / _IDLE_SPEED_M_S)
    return begin_drive(Consumption(p, (), mean, np.diag(np.square(std)), (), scatter, day, idle_noise))


def begin_drive(c: Consumption, days: float = 0.0) -> Consumption:
    """Belief at the start of a new drive, `days` after the last one.

    The finished drive updates the variance of the day effects, which then restart from their prior; coefficients drift.
    """
    require_between("days", days, 0.0, np.inf)
    day = _learn_day(c)
    effects = c.day_effects
    mean, cov = c.mean.copy(), c.cov.copy()
    mean[effects] = 0.0
    cov[effects, :] = 0.0
    cov[:, effects] = 0.0
    cov[effects, effects] = day.value / 2
    drift_std = np.zeros(len(mean))  # of a month
    drift_std[IDLE] = c.prior.drift_std * c.prior.idle_W
    for name in c.terrains:
        drift_std[c.force_index(name)] = c.prior.drift_std * c.prior.force_of(name)
    cov += np.diag(drift_std**2 * days / _DAYS_PER_MONTH)
    reference = tuple(max(mean[c.force_index(name)], 0.0) for name in c.terrains)
    return replace(c, mean=mean, cov=cov, reference_N=reference, day=day, on_this_drive=())


def learn(c: Consumption, stretch: Stretch, energy_J: float) -> Consumption:
    """Belief after a stretch took this energy from the battery; one of less than 3 m only adds to the visits.

    Raises:
        InputError: a time, distance or height below zero, or an energy that is not finite.
    """
    for name in ("time_s", "distance_m", "speed_distance_m2_s", "climb_m", "descent_m", "payload_kg"):
        require_between(f"stretch.{name}", getattr(stretch, name), 0.0, np.inf)
    require_between("stretch.standing_s", stretch.standing_s, 0.0, stretch.time_s)
    require_finite("stretch.kinetic_m2_s2", stretch.kinetic_m2_s2)
    if not np.isfinite(energy_J):
        raise InputError(f"energy_J must be finite, got {energy_J}; leave out stretches without a battery power")
    c = with_ground(c, [stretch])
    if standing_work_J(c, stretch, energy_J):
        return c
    ground_J2, idle_J2 = scatter_J2(c, stretch)
    R = ground_J2 + idle_J2
    if not stretch.terrain and c.on_this_drive:
        R += (_LAG_S * _under_way_W(c.visits)) ** 2
    teaches = R > 0.0 and (not stretch.terrain or stretch.distance_m >= SHORTEST_M)
    if not teaches:
        return _visited(c, stretch, energy_J) if stretch.terrain else c
    c = _without_refuted_idle(c, stretch, energy_J)
    belief, innovation = _corrected(c, stretch, energy_J, R)
    c = replace(c, mean=belief.mean, cov=belief.cov)
    if not stretch.terrain:
        return _with_idle_noise(c, c.idle_noise.after(innovation, idle_J2))
    return _visited(replace(c, scatter=c.scatter.after(innovation, ground_J2)), stretch, energy_J)


def energy_demand(c: Consumption, stretches: Sequence[Stretch]) -> EnergyDemand:
    """Energy that stretches of the drive under way will take; for another day call `begin_drive` first.

    Raises:
        InputError: a terrain that is not known; `with_terrain` adds one with the prior's uncertainty.
    """
    return energy_demands(c, stretches).at(-1)


def energy_demands(c: Consumption, stretches: Sequence[Stretch]) -> EnergyDemand:
    """Energy from the start of the first stretch to the end of each, (K,); raises as `energy_demand`."""
    effects = c.day_effects
    rows = [design_row(c, s) for s in stretches]
    mean_J = np.cumsum(rows, axis=0) @ c.mean + np.cumsum([s.task_J for s in stretches])
    H = np.cumsum([jacobian(c, s, x) for s, x in zip(stretches, rows, strict=True)], axis=0)
    all_J2 = np.einsum("ki,ij,kj->k", H, c.cov, H)
    day_J2 = np.einsum("ki,ij,kj->k", H[:, effects], c.cov[np.ix_(effects, effects)], H[:, effects])
    flat = [s._replace(climb_m=0.0, descent_m=0.0, kinetic_m2_s2=0.0) if s.terrain else s for s in stretches]
    slope_J = np.cumsum([float((x - design_row(c, s)) @ c.mean) for s, x in zip(flat, rows, strict=True)])
    model_J2 = (c.prior.model_std * mean_J) ** 2 + (c.prior.slope_std * slope_J) ** 2
    return EnergyDemand(
        mean_J,
        np.maximum(all_J2 - day_J2, 0.0) + model_J2,
        np.minimum(day_J2, all_J2),
        np.cumsum([sum(scatter_J2(c, s)) for s in stretches]),
        c.day.dof,
        c.scatter.dof,
    )


def with_terrain(c: Consumption, name: str) -> Consumption:
    """The belief with a new terrain; unchanged for a known one."""
    if name in c.terrains:
        return c
    force_N = c.prior.force_of(name)
    std_N = c.prior.force_std_N * force_N / c.prior.force_N
    n = len(c.mean)
    cov = np.zeros((n + 2, n + 2))
    cov[:n, :n] = c.cov
    cov[n, n] = std_N**2
    cov[n + 1, n + 1] = c.day.value / 2
    return replace(
        c,
        terrains=(*c.terrains, name),
        mean=np.concatenate([c.mean, [force_N, 0.0]]),
        cov=cov,
        reference_N=(*c.reference_N, force_N),
        visits=(*c.visits, Visits()),
    )


def with_ground(c: Consumption, stretches: Sequence[Stretch]) -> Consumption:
    """The belief with the terrains of these stretches."""
    for stretch in stretches:
        c = with_terrain(c, stretch.terrain) if stretch.terrain else c
    return c


def design_row(c: Consumption, stretch: Stretch) -> np.ndarray:
    """Row of the design matrix (6 + 2 K,): the factor of each coefficient on this stretch."""
    x = np.zeros(len(c.mean))
    q = mass_ratio(c, stretch)
    work_J = wheel_work_J(c, stretch)
    braking_J = max(-work_J, 0.0)
    x[IDLE] = stretch.time_s
    x[SPEED] = q * stretch.speed_distance_m2_s
    x[CLIMB] = energy_gained_J(c, stretch) + braking_J
    x[REGENERATION] = -braking_J
    if stretch.terrain:
        k = c.force_index(stretch.terrain)
        reference_N = c.reference_N[c.terrains.index(stretch.terrain)]
        x[k] = q * stretch.distance_m
        x[c.day_effect_index(stretch.terrain)] = x[DAY_EFFECT] = x[k] * reference_N
        x[HEAT] = (work_J / max(stretch.distance_m, _LEAST_M)) ** 2 * moving_time_s(stretch)
    return x


def jacobian(c: Consumption, stretch: Stretch, x: np.ndarray) -> np.ndarray:
    """Derivative (6 + 2 K,) of the energy with respect to the coefficients, also through the work of the wheels.

    dE/dW = 2 r W t_d / d^2, plus b - a where the wheels brake.

    x: (6 + 2 K,) design row of the stretch.
    """
    if not stretch.terrain:
        return x
    work_J = wheel_work_J(c, stretch)
    heat = 2 * max(float(c.mean[HEAT]), 0.0) * work_J * moving_time_s(stretch) / max(stretch.distance_m, _LEAST_M) ** 2
    by_work = heat + (c.mean[REGENERATION] - c.mean[CLIMB] if work_J < 0.0 else 0.0)
    climb = max(float(c.mean[CLIMB]), 1.0)
    forces = [SPEED, c.force_index(stretch.terrain)]
    H = x.copy()
    H[forces] += by_work * x[forces] / climb
    H[CLIMB] -= by_work * (work_J - energy_gained_J(c, stretch)) / climb
    return H


def scatter_J2(c: Consumption, stretch: Stretch) -> tuple[float, float]:
    """Variances of a stretch by uneven ground and by the noise of the idle power."""
    resistance_N = mass_ratio(c, stretch) * force_N(c, stretch.terrain) if stretch.terrain else 0.0
    return c.scatter.value * resistance_N**2 * stretch.distance_m, c.idle_noise.value * stretch.time_s


def mass_ratio(c: Consumption, stretch: Stretch) -> float:
    """q: mass with payload over the mass that the forces refer to."""
    return (c.prior.mass_kg + stretch.payload_kg) / c.prior.mass_kg


def force_N(c: Consumption, terrain: str) -> float:
    """Estimated resistance [N] for use in squares, at least a tenth of the expected one."""
    return max(float(c.mean[c.force_index(terrain)]), _LEAST_FORCE * c.prior.force_of(terrain))


def energy_gained_J(c: Consumption, stretch: Stretch) -> float:
    """L: potential and kinetic energy gained, < 0 where it is lost."""
    per_kg = GRAVITY * (stretch.climb_m - stretch.descent_m) + stretch.kinetic_m2_s2
    return (c.prior.mass_kg + stretch.payload_kg) * per_kg


def wheel_work_J(c: Consumption, stretch: Stretch) -> float:
    """W: work of the wheels; < 0 where they brake."""
    if not stretch.terrain:
        return 0.0
    steady_J = force_N(c, stretch.terrain) * stretch.distance_m
    with_speed_J = max(float(c.mean[SPEED]), 0.0) * stretch.speed_distance_m2_s
    at_wheels_J = mass_ratio(c, stretch) * (steady_J + with_speed_J) / max(float(c.mean[CLIMB]), 1.0)
    return at_wheels_J + energy_gained_J(c, stretch)


def moving_time_s(stretch: Stretch) -> float:
    """Time [s] under way, without the stops."""
    return stretch.time_s - stretch.standing_s


def standing_work_J(c: Consumption, stretch: Stretch, energy_J: float) -> float:
    """Energy [J] of work at standstill, a tool's or an arm's, beside the idle power; 0 where there may be none.

    The idle power is part of the power under way: a stand that takes more than that on average is work.
    """
    if stretch.terrain or energy_J <= _under_way_W(c.visits) * stretch.time_s:
        return 0.0
    return energy_J - float(c.mean[IDLE]) * stretch.time_s


def _without_refuted_idle(c: Consumption, stretch: Stretch, energy_J: float) -> Consumption:
    """The idle power of before the first drive, where work at standstill was taken for it: the drives take less."""
    now = Visits(1, stretch.distance_m, stretch.time_s, energy_J)
    surely_W = float(c.mean[IDLE] - _REFUTED_STDS * np.sqrt(c.cov[IDLE, IDLE]))
    if not stretch.terrain or surely_W <= _under_way_W((*c.visits, now)):
        return c
    mean, cov = c.mean.copy(), c.cov.copy()
    cov[IDLE, :] = cov[:, IDLE] = 0.0
    mean[IDLE], cov[IDLE, IDLE] = c.prior.idle_W, c.prior.idle_std_W**2
    return replace(c, mean=mean, cov=cov)


def _with_idle_noise(c: Consumption, noise: Variance) -> Consumption:
    """The belief with another noise of the idle power, which the stands so far had, too: their information scales."""
    learned = max(1.0 - c.cov[IDLE, IDLE] / (c.prior.idle_std_W**2 or np.inf), 0.0)
    scale = np.ones(len(c.mean))
    scale[IDLE] = (1.0 + learned * (c.idle_noise.value / noise.value - 1.0)) ** -0.5
    return replace(c, cov=np.outer(scale, scale) * c.cov, idle_noise=noise)


def _under_way_W(visits: Sequence[Visits]) -> float:
    """Mean power of all drives [W]; infinite before the first."""
    time_s = sum(v.time_s for v in visits)
    return sum(v.energy_J for v in visits) / time_s if time_s > 0.0 else np.inf


def _corrected(c: Consumption, stretch: Stretch, energy_J: float, R: float) -> tuple[Belief, Innovation]:
    """Extended Kalman update; on unexpected ground iterated, with the iterate that explains the energy best."""
    before, fits = Belief(c.mean, c.cov), []
    for _ in range(_LINEARISATIONS):
        x = design_row(c, stretch)
        H = jacobian(c, stretch, x)
        y = np.array([energy_J + (H - x) @ c.mean])
        belief, innovation = kalman.update(before, y, H[None, :], np.array([[R]]))
        after = replace(c, mean=belief.mean)
        left_J = energy_J - float(design_row(after, stretch) @ after.mean)
        S = float(innovation.cov[0, 0])
        cost = left_J**2 / R + (S - R) * float(innovation.value[0] / S) ** 2
        fits.append((cost, belief, innovation))
        if nis(innovation) < _UNEXPECTED_NIS:
            break
        c = replace(c, mean=(c.mean + belief.mean) / 2)
    _, belief, innovation = min(fits, key=lambda fit: fit[0])
    return belief, innovation


def _learn_day(c: Consumption) -> Variance:
    """tau^2 after a drive: each day effect has the variance tau^2 / 2 and counts as far as the drive determined it."""
    if not c.on_this_drive:
        return c.day
    day = c.day
    for k in [DAY_EFFECT, *(c.day_effect_index(name) for name in c.on_this_drive)]:
        information = 1.0 - c.cov[k, k] / (c.day.value / 2)
        if information > _LEAST_NARROWED:
            day = day.updated(2 * c.mean[k] ** 2, information)
    return day


def _visited(c: Consumption, stretch: Stretch, energy_J: float) -> Consumption:
    """The belief with a stretch added to the totals of its terrain."""
    k = c.terrains.index(stretch.terrain)
    first = stretch.terrain not in c.on_this_drive
    v = c.visits[k]
    now = Visits(v.drives + first, v.distance_m + stretch.distance_m, v.time_s + stretch.time_s, v.energy_J + energy_J)
    drive = (*c.on_this_drive, stretch.terrain) if first else c.on_this_drive
    return replace(c, visits=(*c.visits[:k], now, *c.visits[k + 1 :]), on_this_drive=drive)


class Variance(NamedTuple):
    """A variance with an inverse-gamma distribution."""

    dof: float  #: degrees of freedom of its distribution
    sum: float  #: dof times its value

    @property
    def value(self) -> float:
        """Value of the variance for computations."""
        return self.sum / self.dof

    def updated(self, square: float, dof: float) -> Variance:
        """The variance after a squared deviation that counts as `dof` degrees of freedom."""
        return Variance(float(self.dof + dof), float(self.sum + square))

    def after(self, innovation: Innovation, part_J2: float) -> Variance:
        """The variance after an innovation of which it caused this part."""
        share = part_J2 / float(innovation.cov[0, 0])
        return self.updated(self.value * nis(innovation) * share, share)


class Visits(NamedTuple):
    """Totals of all drives on a terrain."""

    drives: int = 0
    distance_m: float = 0.0
    time_s: float = 0.0
    energy_J: float = 0.0
