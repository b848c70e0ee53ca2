"""Ageing of a battery: laws of the lost capacity, which of them the logs have shown, and the end of life.

A battery of age a (0 when new, 1 where four fifths of the capacity are left) has lost

    ln(Q_new / Q) = ln(1 / 0.8) a^p,        a = a_0 + t / T + n / N

after the time t and n full cycles: T is its life by the calendar alone, N by use alone, p the shape of the law. Growth
of the film on the graphite follows p = 0.5, loss of active material about 1, and a battery that is about to fail runs
ahead of both. A good year of logs does not show which of them holds: all are kept side by side until logs decide.

With y = ln(Q / Q_reference), the logs see

    y_k = u(t_k) - loss_h(t_k) + e_k,        u(t) = q + w(t)

for each law h: q is the capacity of this battery when new over the reference, with the error that all logs share
(sensor gain, end of the curve), w a random walk for what no law describes, e_k the error of one log. Given h all of
them are normal, so its likelihood and the capacity have closed forms, and the mixture over all laws is the result. No
log can show the common error; it widens the band.

The end of life is sampled from the laws that fit: the capacity now, the random walk ahead, the use ahead, and a knee,
after which a battery loses capacity faster than ever before (Attia et al., J. Electrochem. Soc. 169, 2022). No log
shows a knee beforehand.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.chemistries import Normal
from ohmward.battery.models.noise import walk_variance
from ohmward.quantities import DAY_S, SECONDS_PER_HOUR

#: Share of the capacity at which a battery counts as worn out.
WORN_SHARE = 0.8
WORN_LOSS = -math.log(WORN_SHARE)
DAYS_PER_YEAR = 365.25

#: ln of the years to WORN_SHARE by the calendar alone: cars lose 1.8 to 2.3 % a year, use included (Geotab 2019, 2024,
#: 2026), cells stored full and warm 5 % (Keil et al., J. Electrochem. Soc. 163, A1872, 2016); lead-acid floats for 3 to
#: 12 years.
_LITHIUM_YEARS = Normal(math.log(10.0), 0.6)
_LEAD_ACID_YEARS = Normal(math.log(6.0), 0.5)
#: ln of the full cycles to WORN_SHARE by use alone, from commercial 18650 cells at 15 to 35 degC, 0.5 to 3 C (Preger et
#: al., J. Electrochem. Soc. 167, 120532, 2020): LFP 2500 to 9000, NMC 200 to 2500, NCA 250 to 1500. Heat and high
#: currents make it a tenth.
_CYCLES = {
    "lfp": Normal(math.log(3000.0), 1.0),
    "nmc": Normal(math.log(800.0), 1.0),
    "nca": Normal(math.log(600.0), 1.0),
    "lipo": Normal(math.log(500.0), 1.0),
    "lead-acid": Normal(math.log(300.0), 0.8),
}
_CYCLES_OF_ANY = Normal(math.log(800.0), 1.3)

#: Shapes of the law and their prior probabilities. Growth with the square root of time, as usually assumed for films,
#: holds better in storage than in use, and few of its published fits are statistically justified (Attia et
#: al., Revisiting the t^0.5 dependence of SEI growth, J. Electrochem. Soc. 167, 090535, 2020): no shape is left out.
_SHAPES = ((0.5, 0.25), (0.75, 0.2), (1.0, 0.3), (1.5, 0.15), (2.5, 0.1))
#: Age at the first log: most files are made for a battery that is new, many for one in its first years.
_FIRST_AGES = ((0.0, 0.4), (0.05, 0.15), (0.15, 0.15), (0.3, 0.1), (0.5, 0.1), (0.75, 0.05), (1.0, 0.03), (1.5, 0.02))
#: Grid of the two lives: this many points to this many standard deviations.
_GRID_POINTS, _REACH = 25, 4.0


class AgeingLaws(NamedTuple):
    """Laws side by side, each field (H,)."""

    #: life by the calendar alone and by use alone
    years: np.ndarray
    cycles: np.ndarray
    shape: np.ndarray  #: exponent p
    first_age: np.ndarray  #: age at the first log
    log_prior: np.ndarray  #: logarithm of their probability, up to a constant

    def age(self, days: np.ndarray, cycles: np.ndarray) -> np.ndarray:
        """(H, n) ages after days and full cycles since the first log, (n,) or (H, n)."""
        by_time = np.asarray(days) / (DAYS_PER_YEAR * self.years[:, None])
        by_use = np.asarray(cycles) / self.cycles[:, None]
        return self.first_age[:, None] + by_time + by_use

    def loss(self, days: np.ndarray, cycles: np.ndarray) -> np.ndarray:
        """(H, n) loss of the logarithm of the capacity, >= 0."""
        return WORN_LOSS * self.age(days, cycles) ** self.shape[:, None]

    def chosen(self, rows: np.ndarray) -> AgeingLaws:
        """The laws in these rows."""
        return AgeingLaws(*(column[rows] for column in self))


def ageing_laws(chemistry: str = "") -> AgeingLaws:
    """Laws for a battery of this chemistry, "" where unknown, with the prior probabilities of its population."""
    of_years = _LEAD_ACID_YEARS if chemistry == "lead-acid" else _LITHIUM_YEARS
    of_cycles = _CYCLES.get(chemistry, _CYCLES_OF_ANY)
    z = np.linspace(-_REACH, _REACH, _GRID_POINTS)
    shapes, shape_weights = np.array(_SHAPES).T
    ages, age_weights = np.array(_FIRST_AGES).T
    z_years, z_cycles, shape, age = (grid.ravel() for grid in np.meshgrid(z, z, shapes, ages, indexing="ij"))
    weights = np.meshgrid(z, z, np.log(shape_weights), np.log(age_weights), indexing="ij")[2:]
    log_prior = -0.5 * (z_years**2 + z_cycles**2) + sum(grid.ravel() for grid in weights)
    years = np.exp(of_years.mean + of_years.std * z_years)
    cycles = np.exp(of_cycles.mean + of_cycles.std * z_cycles)
    return AgeingLaws(years, cycles, shape, age, log_prior)


def no_law() -> AgeingLaws:
    """The one law of a quantity that does not age."""
    never = np.array([math.inf])
    return AgeingLaws(never, never, np.ones(1), np.zeros(1), np.zeros(1))


#: A log that by itself gives the logarithm of a quantity no better than this says nothing about it.
UNINFORMATIVE_STD = 0.5
_UNKNOWN = Normal(math.nan, math.inf)


class HealthPoint(NamedTuple):
    """State of health as one log shows it."""

    log: str  #: its name
    time_s: float  #: Unix time of the middle of the log [s]
    hours: float  #: its length
    cycles: float  #: charge that it moved, in full cycles
    #: ln of the capacity over that when new, from this log alone; std inf where it says nothing
    log_capacity: Normal = _UNKNOWN
    log_resistance: Normal = _UNKNOWN  #: ln of the resistance at 25 degC over that when new, likewise
    temperature_degC: float = math.nan  #: mean, nan where not measured
    full: bool = False  #: True where the battery was full in it

    @property
    def shows_capacity(self) -> bool:
        """True where the log alone says something about the capacity."""
        return self.log_capacity.std < UNINFORMATIVE_STD

    @property
    def shows_resistance(self) -> bool:
        """True where the log alone says something about the resistance."""
        return self.log_resistance.std < UNINFORMATIVE_STD


def logarithm(quantity: Normal, reference: float) -> Normal:
    """Distribution of ln(quantity / reference); its std is inf where the quantity is not known."""
    if not (quantity.mean > 0.0 and math.isfinite(quantity.std)):
        return _UNKNOWN
    return Normal(math.log(quantity.mean / reference), quantity.relative_std)


class Track(NamedTuple):
    """A quantity of several logs in the order of time."""

    days: np.ndarray  #: (n,) since the first log of all
    cycles: np.ndarray  #: (n,) full cycles since then, up to the middle of the log
    #: (n,) natural logarithm over the value when new
    value: np.ndarray
    std: np.ndarray

    @classmethod
    def of(cls, points: Sequence[HealthPoint], quantity: str) -> Track:
        """The logs that say something about this quantity, a field of `HealthPoint`."""
        start_s = min((point.time_s for point in points), default=0.0)
        moved = np.cumsum([point.cycles for point in points])
        rows = [
            ((point.time_s - start_s) / DAY_S, upto - point.cycles / 2, *getattr(point, quantity))
            for point, upto in zip(points, moved, strict=True)
            if getattr(point, quantity).std < UNINFORMATIVE_STD
        ]
        return cls(*np.array(rows, dtype=float).reshape(-1, 4).T)


#: Reversible change of the capacity from log to log: after days of rest it is 1 % larger (Epding et al.,
#: J. Electrochem. Soc. 166, 2019; the cells of NASA), and it changes with temperature.
REVERSIBLE_STD = 0.01
#: Beyond this many standard deviations a log counts less the further off it is (Huber), as an error of its own.
_HUBER = 2.0
_ROBUST_ROUNDS = 6
#: Laws that are less likely than this share of the best are left out of the mixture.
_NEGLIGIBLE = 1e-5


class CapacityUncertainty(NamedTuple):
    """Standard deviations of ln(capacity) that hold for a battery and its sensor."""

    new: float  #: of the capacity when new against the reference
    common: float  #: of an error that all logs share
    walk: float  #: of a random walk in 1000 hours

    def covariance(self, days: np.ndarray, other_days: np.ndarray) -> np.ndarray:
        """(n, m) covariance of u at these times since the first log."""
        shared = np.minimum(days[:, None], other_days[None, :])
        return self.new**2 + self.common**2 + self.walk_variance(shared)

    def walk_variance(self, days: np.ndarray) -> np.ndarray:
        """(n,) variance of the random walk over these times."""
        span_s: Any = DAY_S * days
        return np.asarray(walk_variance(self.walk, 1000 * SECONDS_PER_HOUR, span_s))


class AgeingFit(NamedTuple):
    """Laws that fit a track, their weights, and the capacity that follows."""

    #: (H,) those that are not negligible; the weights add up to 1
    laws: AgeingLaws
    weight: np.ndarray
    uncertainty: CapacityUncertainty  #: as assumed
    track: Track  #: with the standard deviations as used, enlarged for logs that are off by more than usual
    residual: np.ndarray  #: (n,) y_k minus the mean of the mixture, in standard deviations of that log alone

    def level(self, days: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean (H, m) and covariance (m, m) of u at these times, given all logs."""
        cross = self.uncertainty.covariance(days, self.track.days)
        gain = np.linalg.solve(observed_covariance(self.uncertainty, self.track), cross.T).T
        u = self.track.value + self.laws.loss(self.track.days, self.track.cycles)
        return u @ gain.T, self.uncertainty.covariance(days, days) - gain @ cross.T

    def band(self, days: np.ndarray, cycles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean and standard deviation (m,) of ln(Q / Q_reference) at these times (m,), of the mixture over the laws."""
        mean, cov = self.level(days)
        each = mean - self.laws.loss(days, cycles)
        middle = self.weight @ each
        variance = np.diag(cov) + self.uncertainty.common**2 + self.weight @ (each - middle) ** 2
        return middle, np.sqrt(variance)


def fit_ageing(
    laws: AgeingLaws, track: Track, uncertainty: CapacityUncertainty, reversible_std: float = REVERSIBLE_STD
) -> AgeingFit:
    """The laws weighted by a track of capacities; without logs by their prior alone.

    reversible_std: of the reversible change from log to log.
    """
    own_std = np.hypot(track.std, reversible_std)
    u = track.value + laws.loss(track.days, track.cycles)
    u_cov = uncertainty.covariance(track.days, track.days)
    std = own_std
    for _ in range(_ROBUST_ROUNDS):
        used = track._replace(std=std)
        observed_cov = observed_covariance(uncertainty, used)
        weight = _weights(laws.log_prior, u, observed_cov)
        mean = weight @ u  # the expected value of a log is linear in u: that of the mixture follows from its mean
        residual = (mean - u_cov @ np.linalg.solve(observed_cov, mean)) / own_std
        std = own_std * np.sqrt(np.maximum(1.0, np.abs(residual) / _HUBER))
    likely = weight > 0.0
    return AgeingFit(laws.chosen(likely), weight[likely], uncertainty, used, residual)


def _weights(log_prior: np.ndarray, u: np.ndarray, cov: np.ndarray) -> np.ndarray:
    """(H,) posterior probabilities: prior times N(u; 0, cov) of u = y + loss (H, n); 0 where negligible."""
    log_weight = log_prior - 0.5 * np.einsum("hn,hn->h", u @ np.linalg.inv(cov), u)
    weight = np.exp(log_weight - log_weight.max())
    weight[weight <= _NEGLIGIBLE] = 0.0
    return weight / weight.sum()


def observed_covariance(uncertainty: CapacityUncertainty, track: Track) -> np.ndarray:
    """(n, n) covariance of u + e at the times of the logs."""
    return uncertainty.covariance(track.days, track.days) + np.diag(track.std**2)


#: Number of simulated batteries, and how far ahead they are followed; later counts as never.
DRAWS = 4000
HORIZON_YEARS = 30.0
_STEPS_AHEAD = 400
#: First step [days]; the others grow with the time ahead.
_FIRST_STEP_DAYS = 0.5
#: Standard deviation of ln(use ahead over use so far): the use of a robot next year is not known.
USE_AHEAD_STD = 0.3
#: Standard deviation of ln(age of the knee), median of that age, and by how much the loss is steeper after it: most
#: cells reach the knee after the end of life.
_KNEE_AGE_STD, _KNEE_AGE = 0.5, 1.3
_KNEE_STEEPER = 2.0


class LifeAhead(NamedTuple):
    """Capacity from now on, as a distribution."""

    share: float  #: of the capacity when new, at which the battery is worn out
    days: np.ndarray  #: (m,) from now
    probability: np.ndarray  #: (m,) that it will be worn out by then
    log_capacity: np.ndarray  #: (3, m) 2.5, 50 and 97.5 % quantiles of ln(capacity over that when new)

    def quantile(self, probability: float) -> float:
        """Days from now after which it will be worn out with this probability; inf beyond the horizon."""
        reached = self.probability >= probability
        return float(self.days[np.argmax(reached)]) if reached.any() else math.inf

    def within(self, days: float) -> float:
        """Probability that it will be worn out within this many days."""
        return float(np.interp(days, self.days, self.probability))


def life_ahead(
    fit: AgeingFit, now_days: float, now_cycles: float, rng: np.random.Generator, share: float = WORN_SHARE
) -> LifeAhead:
    """Distribution of the capacity from now on, with the use per day as it was so far."""
    rows = rng.choice(len(fit.weight), DRAWS, p=fit.weight)
    ahead = _FIRST_STEP_DAYS * np.expm1(
        np.linspace(0.0, math.log1p(HORIZON_YEARS * DAYS_PER_YEAR / _FIRST_STEP_DAYS), _STEPS_AHEAD)
    )
    loss = _loss_ahead(fit.laws.chosen(rows), now_days, now_cycles, ahead, rng)
    log_capacity = _level_ahead(fit, rows, now_days, ahead, rng) - loss
    worn = np.logical_or.accumulate(log_capacity < math.log(share), axis=1)
    return LifeAhead(share, ahead, worn.mean(axis=0), np.quantile(log_capacity, (0.025, 0.5, 0.975), axis=0))


def _loss_ahead(
    laws: AgeingLaws, now_days: float, now_cycles: float, ahead: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """(M, m) loss of each sampled law at the times ahead (m,), with a knee of its own."""
    use = np.exp(USE_AHEAD_STD * rng.standard_normal(len(laws.years)))
    per_day = now_cycles / now_days if now_days > 0.0 else 0.0
    age = laws.age(now_days + ahead, now_cycles + per_day * use[:, None] * ahead)
    knee = np.maximum(_KNEE_AGE * np.exp(_KNEE_AGE_STD * rng.standard_normal(len(use))), age[:, 0])
    steeper = _KNEE_STEEPER * WORN_LOSS * np.maximum(age - knee[:, None], 0.0)
    return WORN_LOSS * age ** laws.shape[:, None] + steeper


def _level_ahead(
    fit: AgeingFit, rows: np.ndarray, now_days: float, ahead: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """(M, m) draws of u at the times ahead: u now given all logs, then its random walk."""
    mean, cov = fit.level(np.array([now_days]))
    std = math.sqrt(max(cov[0, 0], 0.0) + fit.uncertainty.common**2)
    now = mean[rows, 0] + std * rng.standard_normal(len(rows))
    walk_std = np.sqrt(fit.uncertainty.walk_variance(np.diff(ahead, prepend=0.0)))
    return now[:, None] + np.cumsum(walk_std * rng.standard_normal((len(rows), len(ahead))), axis=1)
