"""End of life: when the capacity will have fallen to a share of that when new, as a distribution.

Drawn from the laws that fit: the capacity now, the random walk ahead, the use ahead, and a knee, after which a battery
loses capacity faster than ever before (Attia et al., J. Electrochem. Soc. 169, 2022). No log shows a knee beforehand.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ohmward.battery.health.ageing_fit import AgeingFit
from ohmward.battery.health.ageing_laws import DAYS_PER_YEAR, WORN_LOSS, WORN_SHARE, AgeingLaws

#: Batteries drawn, and how far ahead they are looked at; later counts as never.
DRAWS = 4000
HORIZON_YEARS = 30.0
_STEPS_AHEAD = 400
#: First step [days]; the others grow with the time ahead.
_FIRST_STEP_DAYS = 0.5
#: Standard deviation of ln(use ahead over use so far): what a robot does next year nobody knows.
USE_AHEAD_STD = 0.3
#: ln of the age of the knee, and by how much the loss is steeper after it: most cells pass it beyond the end of life.
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
        """Probability that it will be worn out within so many days."""
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
    """(M, m) loss of each drawn law at the times ahead (m,), with a knee of its own."""
    use = np.exp(USE_AHEAD_STD * rng.standard_normal(len(laws.years)))
    per_day = now_cycles / now_days if now_days > 0.0 else 0.0
    by_time = (now_days + ahead) / (DAYS_PER_YEAR * laws.years[:, None])
    by_use = (now_cycles + per_day * use[:, None] * ahead) / laws.cycles[:, None]
    age = laws.first_age[:, None] + by_time + by_use
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
