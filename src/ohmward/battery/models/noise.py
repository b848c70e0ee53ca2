"""Noise of voltage and current sensor and of the battery model, as an estimator must assume it."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import Any

from ohmward.battery.models.temperature import coldness_per_K
from ohmward.battery.models.thevenin import CircuitInput, Thevenin, log_ratio_by_weather
from ohmward.checks import require_between, require_each_not_negative, require_finite, require_positive
from ohmward.errors import InputError
from ohmward.quantities import DAY_S, FIRST_DATE_S, SECONDS_PER_HOUR
from ohmward.trace import Scalar, clip, maximum, sqrt, table

#: Assumed size of a current that is not measured, in multiples of the capacity per hour: a usual one where it acts over
#: the time for which it is unknown, a large one where it acts at one instant.
USUAL_C, MOMENTARY_C = 0.3, 1.0

#: Standard deviation of an unknown SoC; none is larger.
SOC_UNKNOWN_STD = 0.5

#: Standard deviation of an unknown hysteresis state: evenly spread over [-1, 1] it would be 0.58, but
#: after a long charge or discharge the state is at one of the ends.
HYSTERESIS_UNKNOWN_STD = 0.7

#: Variance that the hysteresis state gains per unit of SoC moved: branches of a real cell follow one state within a
#: tenth over a full charge.
HYSTERESIS_VARIANCE_PER_SOC = 0.01

#: Random walk of an RC voltage about its model, as the current through its resistance that would cause it, in multiples
#: of the capacity per hour: a resistance from a battery file is accurate to about that at the currents of a drive.
PAIR_CURRENT_C = 0.005

#: Between two samples the current is assumed linear. Samples far apart are like draws from a current that fluctuates:
#: the charge that they sum up is off by a standard deviation for each, which is their change over the root of two;
#: close together they follow the current. At this distance [s] it is half of that. Over an hour of the drives of six
#: cells, sampled every 2, 10, 30 and 120 s, the error was 0.2 to 0.4, 0.2 to 0.6, 0.3 to 1.0 and 0.5 to 0.9 of the
#: change, as if independent from step to step.
PATH_S = 3.7

#: Correlation of the errors of R_0 and of the pairs: age and contacts act on both, the shapes of the two curves differ.
RESISTANCE_CORRELATION = 0.7

#: Correlation length of the error of the curve's level, as a change of SoC. The error of a model on one pass over the
#: curve recurs on the next, on LFP and in the cold on NMC; a level that stayed for ever would absorb the error that a
#: wrong resistance leaves in the cold.
LEVEL_SOC_LENGTH = 1.0

#: Share of the level in the variance of the curve by temperature: the entropy of the electrodes changes its sign along
#: SoC, on graphite with iron phosphate as with layered oxides.
TEMPERATURE_LEVEL_SHARE = 0.5

#: Charge that flows in one pass over the curve, over the capacity. What voltages show of the capacity on another pass
#: in the same direction has the same error.
PASS_SOC = 1.0

#: Relative error of the capacity and error of the logarithm of the resistances because a file does not know how old its
#: battery is. Cells with 80 % of their capacity have about 1.5 times the resistance.
AGED_CAPACITY_STD = 0.1
AGED_RESISTANCE_STD = 0.3
#: They are reached this many days after a log that showed capacity and resistances, growing linearly until then: in
#: daily use a battery loses 5 to 10 % of its capacity in a year. From then on they grow with the root of time, up to
#: twice as large in four years, after which most batteries have been replaced.
AGED_AFTER_DAYS = 365
OLDEST_YEARS = 4

#: A shorter step counts as this one [s] where errors persist from sample to sample, so that R stays finite at dt = 0.
_SHORTEST_STEP_S = 1e-3


def age_after(days: float) -> float:
    """Error by age this many days after a log that showed the battery, over that after `AGED_AFTER_DAYS`."""
    years = min(abs(days) // 1.0 / AGED_AFTER_DAYS, OLDEST_YEARS)
    return min(years, math.sqrt(years))


def on_soc_grid(values: tuple[float, ...], soc: Any) -> Any:
    """Linear between values on a uniform grid of SoC from 0 to 1, constant beyond."""
    return table(values, 0.0, 1.0 / (len(values) - 1), clip(soc, 0.0, 1.0))


def walk_variance(std: Scalar, period_s: float, dt_s: Scalar) -> Scalar:
    """Process variance of one step of a random walk whose standard deviation after `period_s` is `std`."""
    return std**2 * dt_s / period_s


def path_std_A(change_A: Any, dt_s: Any) -> Any:
    """Standard deviation [A] of the mean current over a step about the middle of its two samples (`PATH_S`)."""
    return math.sqrt(0.5) * change_A * (dt_s / (dt_s + PATH_S))


@dataclass(frozen=True)
class BatteryNoise:
    """Standard deviations, never variances. The error of a battery model is not white: it stays as long as SoC does."""

    voltage_std_V: float = 0.005  #: white noise of the voltage sensor and of the model from sample to sample
    #: (M,) standard deviation of the model's voltage error on a uniform grid of SoC from 0 to 1; large where the
    #: identification had no data
    model_std_V: tuple[float, ...] = (0.008, 0.008)
    model_soc_length: float = 0.1  #: correlation length of `model_std_V`, as a change of SoC
    #: relative error of the overpotential: one number, or (M,) on a uniform grid of SoC
    overpotential_share: float | tuple[float, ...] = 0.05
    soc_axis_std: float = 0.01  #: error of the SoC axis of the OCV curve
    #: error of that axis at full, in addition: the limit of the charger is not known; less in proportion below full
    full_soc_std: float = 0.0
    #: error of the level of the OCV curve, common to all SoC, in addition to `model_std_V`; 0 if that already holds it
    level_std_V: float = 0.0
    #: relative error of the voltage sensor's gain against that of the test's sensor; 0 if it is the same one
    voltage_gain_std: float = 0.0
    correlation_s: float = 200.0  #: correlation time of the errors that depend on the current
    capacity_std: float = 0.01  #: relative error of the capacity
    capacity_walk: float = 0.01  #: random walk of the capacity error in 1000 hours
    #: Unix time of the last log that showed the capacity; 0 if none did or it has no date
    capacity_known_unix_s: float = 0.0
    capacity_known_std: float = 0.0  #: relative error of the capacity on that day
    resistance_std: float = 0.05  #: relative error common to all resistances
    resistance_walk: float = 0.05  #: random walk of the resistance error in 100 hours
    ageing_correlation: float = 0.0  #: correlation of capacity loss and resistance growth by ageing
    #: error common to all activation temperatures: R grows by exp(error (1/T - 1/T_reference))
    activation_std_K: float = 0.0
    empty_activation_std_K: float = 0.0  #: error of `empty_activation_K` of the circuit
    hysteresis_std: float = 0.0  #: relative error of the hysteresis voltage
    ocv_std_V_per_K: float = 0.0  #: error of the OCV curve per degree from its reference temperature
    ocv_slip_std: float = 0.5  #: error of `ocv_slip` of the circuit

    def __post_init__(self) -> None:
        for f in fields(self):
            value = getattr(self, f.name)
            if f.name in ("voltage_std_V", "model_soc_length"):
                require_positive(f"noise.{f.name}", value)
            else:
                require_between(f"noise.{f.name}", value, 0.0, 1.0 if f.name == "ageing_correlation" else float("inf"))
            if isinstance(value, tuple | list) and len(value) < 2:
                raise InputError(f"noise.{f.name} must have 2 values or more on its grid of SoC, got {value}")

    def on(self, unix_s: float) -> BatteryNoise:
        """The noise on a day: capacity and resistances are less certain the more time has passed since the last log.

        Without a date of either, or if the clock had not been set on either day, the noise is unchanged.
        """
        days = (unix_s - self.capacity_known_unix_s) / DAY_S
        is_date = self.capacity_known_unix_s >= FIRST_DATE_S
        if not (is_date and -OLDEST_YEARS * AGED_AFTER_DAYS < days < math.inf):
            return self
        age = age_after(days)
        of_age_std = age * AGED_CAPACITY_STD
        most = max(1.0, age)
        most_capacity_std = most * max(self.capacity_std, AGED_CAPACITY_STD)
        most_resistance_std = most * max(self.resistance_std, AGED_RESISTANCE_STD)
        capacity_std = min(math.hypot(self.capacity_known_std, of_age_std), most_capacity_std)
        resistance_std = math.hypot(self.resistance_std, age * AGED_RESISTANCE_STD)
        return replace(
            self,
            capacity_std=capacity_std,
            resistance_std=min(resistance_std, most_resistance_std),
            ageing_correlation=self.ageing_correlation * min(of_age_std / capacity_std, 1.0) if capacity_std else 0.0,
        )

    @property
    def ageing_covariance(self) -> float:
        """Covariance of a relative loss of capacity with the logarithm of R_0, and with that of the RC pairs."""
        together_std = self.resistance_std * math.sqrt((1.0 + RESISTANCE_CORRELATION) / 2.0)
        return self.ageing_correlation * self.capacity_std * together_std

    @property
    def capacity_std_at_resistance(self) -> float:
        """Relative error of the capacity of a battery whose resistances are known."""
        return self.capacity_std * math.sqrt(1.0 - self.ageing_correlation**2)

    def model_std_at(self, soc: Any) -> Any:
        """Standard deviation of the model's voltage error [V] at this SoC."""
        return on_soc_grid(self.model_std_V, soc)

    def axis_std_at(self, soc: Any) -> Any:
        """Standard deviation of the SoC axis of the curve at this SoC."""
        if not self.full_soc_std:
            return self.soc_axis_std
        at_full = self.full_soc_std * soc
        return sqrt(self.soc_axis_std**2 + at_full * at_full)

    def curve_stds(self, soc: Scalar, away_K: Scalar) -> tuple[Scalar, Scalar]:
        """Standard deviations [V] of the curve at this SoC and of its level, `away_K` from the curve's temperature.

        The error by temperature adds to both by `TEMPERATURE_LEVEL_SHARE`; without an error of the level to the curve.
        """
        own_V, thermal_V2 = self.model_std_at(soc), (self.ocv_std_V_per_K * away_K) ** 2
        level_V2 = TEMPERATURE_LEVEL_SHARE * thermal_V2 if self.level_std_V else 0.0
        return sqrt(own_V**2 + thermal_V2 - level_V2), sqrt(self.level_std_V**2 + level_V2)

    def gain_error_V(self, soc: Scalar, u: CircuitInput, p: Thevenin) -> Scalar:
        """Standard deviation [V] of the error that the gain of the sensor causes in the open-circuit voltage."""
        if not self.voltage_gain_std:
            return 0.0
        return self.voltage_gain_std * p.ocv.mean_V(soc, u.temperature_degC)

    def overpotential_share_at(self, soc: Any) -> Any:
        """Relative error of the overpotential at this SoC."""
        share = self.overpotential_share
        return on_soc_grid(share, soc) if isinstance(share, tuple) else share

    def capacity_walk_variance(self, dt_s: Scalar) -> Scalar:
        """Process variance of the relative error of the capacity in one step."""
        return walk_variance(self.capacity_walk, 1000 * SECONDS_PER_HOUR, dt_s)

    def resistance_walk_variance(self, dt_s: Scalar) -> Scalar:
        """Process variance of the relative error of the resistances in one step."""
        return walk_variance(self.resistance_walk, 100 * SECONDS_PER_HOUR, dt_s)

    def resistance_variance(self, coldness_per_K: Any) -> Any:
        """Variance of ln R at this distance from the temperature of the test (`temperature.coldness_per_K`)."""
        return self.resistance_std**2 + (self.activation_std_K * coldness_per_K) ** 2

    def resistance_variance_at(self, u: CircuitInput, p: Thevenin) -> Any:
        """Variance of ln R at this temperature, which may not be known itself."""
        weather = log_ratio_by_weather(u, p)
        return self.resistance_variance(coldness_per_K(u.error_degC, p.reference_degC)) + weather * weather

    def samples_per_error(self, dt_s: Scalar) -> Scalar:
        """Number of voltages, dt_s apart, that share an error that persists for `correlation_s`: the factor of R."""
        return maximum(1.0, 2 * self.correlation_s / maximum(dt_s, _SHORTEST_STEP_S))


#: Offset, its random walk in an hour and least noise of a sensor without a data sheet, as shares of 1 C. Measured cells
#: were published with offsets of 2 to 6.5 % of 1 C.
OFFSET_SHARE = 0.025
OFFSET_WALK_SHARE = 0.001
NOISE_SHARE = 0.002

#: Relative error of the gain of a robot's voltage sensor against that of the battery's test. Battery monitors and
#: dividers are specified within 0.2 to 0.5 %.
VOLTAGE_GAIN_STD = 0.002

#: An offset of more standard deviations is not credible: something else is wrong.
MOST_OFFSET = 3.0
#: A smaller difference of two offsets is rounding.
_ROUNDING_A = 1e-9


@dataclass(frozen=True)
class CurrentSensor:
    """Standard deviations of a current sensor, from its data sheet if it has one, and its offset as logs show it."""

    noise_std_A: float = 0.05  #: white noise of samples 1 s apart
    offset_std_A: float = 0.05  #: error of `offset_A`
    offset_walk_A: float = 0.002  #: random walk of the offset in one hour
    gain_std: float = 0.01  #: relative error of the gain
    offset_A: float = 0.0  #: reading at zero current; 0 if unknown

    def __post_init__(self) -> None:
        require_each_not_negative("sensor.", self, "noise_std_A", "offset_std_A", "offset_walk_A", "gain_std")
        require_finite("sensor.offset_A", self.offset_A)

    def offset_walk_variance(self, dt_s: Scalar) -> Scalar:
        """Process variance [A^2] of the offset in one step."""
        return walk_variance(self.offset_walk_A, SECONDS_PER_HOUR, dt_s)

    @property
    def offset_after_a_day_std_A(self) -> float:
        """Error of `offset_A` after a day of its random walk; never 0."""
        return max(math.sqrt(self.offset_std_A**2 + self.offset_walk_variance(DAY_S)), _ROUNDING_A)

    def contradicts(self, offset_A: Scalar) -> Any:
        """True where this sensor cannot have such an offset."""
        return abs(offset_A - self.offset_A) > MOST_OFFSET * self.offset_after_a_day_std_A

    def rest_threshold_A(self, capacity_Ah: float, share: float) -> float:
        """Rest threshold of the measured current [A]: `share` of 1 C plus three sigma of the noise."""
        return share * capacity_Ah + 3.0 * self.noise_std_A


def usual_sensor(capacity_Ah: float, noise_A: float = 0.0) -> CurrentSensor:
    """Current sensor without a data sheet; noise_A: its white noise, as far as a log has shown it."""
    return CurrentSensor(
        noise_std_A=max(noise_A, NOISE_SHARE * capacity_Ah),
        offset_std_A=OFFSET_SHARE * capacity_Ah,
        offset_walk_A=OFFSET_WALK_SHARE * capacity_Ah,
    )
