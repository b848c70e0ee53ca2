"""Sensors with errors of offset and gain, noise, resolution, range, spikes and missing samples."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from ohmward.checks import require_between, require_each_not_negative, require_positive
from ohmward.logs import Log
from ohmward.quantities import SECONDS_PER_HOUR


@dataclass(frozen=True)
class Sensor:
    """One analogue sensor and its converter; all in the unit of what it measures.

    Raises:
        InputError: a value out of its range.
    """

    #: range of the converter; values beyond it are limited to its ends
    low: float
    high: float
    resolution: float  #: of the converter, > 0
    noise_std: float  #: white, before the converter
    offset: float = 0.0  #: output at zero, constant over one recording
    offset_walk_std: float = 0.0  #: random walk of the offset over one hour
    gain_error: float = 0.0  #: share of the true value that is added to the output
    #: share of the samples that are hit by interference, and its size
    spike_share: float = 0.0
    spike_std: float = 0.0
    missing_share: float = 0.0  #: share of the samples that are NaN

    def __post_init__(self) -> None:
        require_positive("sensor.resolution", self.resolution)
        require_positive("sensor.high - sensor.low", self.high - self.low)
        require_each_not_negative("sensor.", self, "noise_std", "offset_walk_std", "spike_std")
        for name in ("spike_share", "missing_share"):
            require_between(f"sensor.{name}", getattr(self, name), 0.0, 1.0)

    def measure(self, true: np.ndarray, time_s: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Measured values of `true` (T,) at the times [s]: disturbed, rounded, limited, NaN where missing."""
        hours = np.diff(time_s, prepend=time_s[0]) / SECONDS_PER_HOUR
        drift = np.cumsum(self.offset_walk_std * np.sqrt(hours) * rng.standard_normal(time_s.size))
        signal = (1.0 + self.gain_error) * true + self.offset + drift
        signal = signal + self.noise_std * rng.standard_normal(true.size)
        hit = rng.random(true.size) < self.spike_share
        signal = signal + np.where(hit, self.spike_std * rng.standard_normal(true.size), 0.0)
        measured = np.clip(self.resolution * np.round(signal / self.resolution), self.low, self.high)
        return np.where(rng.random(true.size) < self.missing_share, np.nan, measured)


class BatterySensors(NamedTuple):
    """Sensors of a battery on board: current [A], voltage [V], temperature [degC]."""

    current: Sensor
    voltage: Sensor
    temperature: Sensor

    def log(self, name: str, time_s: np.ndarray, truth: Any, rng: np.random.Generator) -> Log:
        """Log of the truth at the times (T,) [s], with the true SoC as the extra column `soc_true`."""
        return Log(
            name,
            time_s,
            self.current.measure(truth.current_A, time_s, rng),
            self.voltage.measure(truth.voltage_V, time_s, rng),
            self.temperature.measure(truth.temperature_degC, time_s, rng),
            extra={"soc_true": truth.soc},
        )


def low_cost_sensors(rng: np.random.Generator) -> BatterySensors:
    """One specimen of the electronics of a robot like [P]'s; offsets and gains are drawn, since parts differ.

    Current: Hall sensor ACS712-20A, 100 mV/A, 5 V converter of 10 bit (49 mA), 16 readings averaged (12 mA); the
    datasheet's total error is 1.5 %, its noise about 20 mA, and its zero drifts by tens of mA with temperature and
    time. Voltage: divider by 5 on a 3.3 V converter of 12 bit (4 mV), resistors of 0.1 %. Temperature: DS18B20.
    """
    current = Sensor(
        low=-20.0,
        high=20.0,
        resolution=0.0122,
        noise_std=0.020,
        offset=float(rng.choice((-1.0, 1.0)) * rng.uniform(0.03, 0.06)),
        offset_walk_std=0.003,
        gain_error=float(rng.normal(0.0, 0.007)),
        spike_share=2e-4,
        spike_std=8.0,
        missing_share=5e-4,
    )
    voltage = Sensor(
        low=0.0,
        high=16.5,
        resolution=0.00403,
        noise_std=0.004,
        gain_error=float(rng.normal(0.0, 0.001)),
        spike_share=2e-4,
        spike_std=0.5,
        missing_share=5e-4,
    )
    temperature = Sensor(-55.0, 125.0, resolution=0.0625, noise_std=0.03, offset=float(rng.uniform(-0.4, 0.4)))
    return BatterySensors(current, voltage, temperature)


def on_the_bench(sensors: BatterySensors) -> BatterySensors:
    """The same sensors with the zero of the current just trimmed to 1 mA, without the interference of the drives."""
    current = replace(sensors.current, offset=0.001, offset_walk_std=0.0, spike_share=0.0, missing_share=0.0)
    return BatterySensors(current, replace(sensors.voltage, spike_share=0.0, missing_share=0.0), sensors.temperature)
