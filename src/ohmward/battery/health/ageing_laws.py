"""Laws of ageing: how much capacity a battery loses with time and use, and how sure that is before it has been seen.

A battery of age a (0 when new, 1 where four fifths of the capacity are left) has lost

    ln(Q_new / Q) = ln(1 / 0.8) a^p,        a = a_0 + t / T + n / N

after the time t and n full cycles: T is its life by the calendar alone, N by use alone, p the shape of the law. Growth
of the film on the graphite follows p = 0.5, loss of active material about 1, and a battery that is about to fail runs
ahead of both. Which of them holds cannot be told from a good year: they stand side by side until logs decide.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ohmward.battery.chemistries import Normal

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

#: Shapes of the law and how likely they are before anything is seen. The square root of time that films are said to
#: grow with holds better in storage than in use, and few of its published fits are statistically justified (Attia et
#: al., Revisiting the t^0.5 dependence of SEI growth, J. Electrochem. Soc. 167, 090535, 2020): no shape is left out.
_SHAPES = ((0.5, 0.25), (0.75, 0.2), (1.0, 0.3), (1.5, 0.15), (2.5, 0.1))
#: Age at the first log: most files are made for a battery that is new, many for one in its first years.
_FIRST_AGES = ((0.0, 0.4), (0.05, 0.15), (0.15, 0.15), (0.3, 0.1), (0.5, 0.1), (0.75, 0.05), (1.0, 0.03), (1.5, 0.02))
#: Grid of the two lives: this many points to this many standard deviations.
_POINTS, _REACH = 25, 4.0


class AgeingLaws(NamedTuple):
    """Laws side by side, each field (H,)."""

    #: life by the calendar alone and by use alone
    years: np.ndarray
    cycles: np.ndarray
    shape: np.ndarray  #: exponent p
    first_age: np.ndarray  #: age at the first log
    log_prior: np.ndarray  #: logarithm of their probability, up to a constant

    def age(self, days: np.ndarray, cycles: np.ndarray) -> np.ndarray:
        """(H, n) ages after days (n,) and full cycles (n,) since the first log."""
        by_time = np.asarray(days) / (DAYS_PER_YEAR * self.years[:, None])
        by_use = np.asarray(cycles) / self.cycles[:, None]
        return self.first_age[:, None] + by_time + by_use

    def loss(self, days: np.ndarray, cycles: np.ndarray) -> np.ndarray:
        """(H, n) lost logarithm of the capacity, >= 0."""
        return WORN_LOSS * self.age(days, cycles) ** self.shape[:, None]

    def chosen(self, rows: np.ndarray) -> AgeingLaws:
        """The laws in these rows."""
        return AgeingLaws(*(column[rows] for column in self))


def ageing_laws(chemistry: str = "") -> AgeingLaws:
    """Laws for a battery of this chemistry, "" where unknown, as likely as its population makes them."""
    of_years = _LEAD_ACID_YEARS if chemistry == "lead-acid" else _LITHIUM_YEARS
    of_cycles = _CYCLES.get(chemistry, _CYCLES_OF_ANY)
    z = np.linspace(-_REACH, _REACH, _POINTS)
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
