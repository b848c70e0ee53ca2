"""Noise of the sensors and of the battery model, as an estimator must assume it."""

from __future__ import annotations

from dataclasses import dataclass, fields

from ohmward.checks import require_between, require_positive


@dataclass(frozen=True)
class BatteryNoise:
    """Standard deviations, never variances. The error of a battery model is not white: it stays as long as SoC does.

    Attributes:
        voltage_std_V: white noise of the voltage sensor and of what the model leaves unexplained from sample to sample.
        model_std_V: (M,) standard deviation of the model's voltage error on a uniform grid of SoC from 0 to 1; it is
            large where the identification had no data.
        model_soc_length: correlation length of that error, as a change of SoC.
        overpotential_share: relative error of the overpotential.
        soc_axis_std: error of the SoC axis of the OCV curve.
        correlation_s: correlation time of the errors that depend on current; samples further apart are independent.
        current_std_A: white noise of the current sensor, of samples 1 s apart.
        current_offset_std_A: offset of the current sensor when nothing is known of it.
        current_offset_walk_A: random walk of the offset in one hour.
        capacity_std: relative error of the capacity and of the current sensor's gain.
        capacity_walk: random walk of that error in 1000 hours.
        resistance_std: relative error of all resistances together.
        resistance_walk: random walk of that error in 100 hours.
    """

    voltage_std_V: float = 0.005
    model_std_V: tuple[float, ...] = (0.008, 0.008)
    model_soc_length: float = 0.1
    overpotential_share: float = 0.05
    soc_axis_std: float = 0.01
    correlation_s: float = 200.0
    current_std_A: float = 0.05
    current_offset_std_A: float = 0.05
    current_offset_walk_A: float = 0.002
    capacity_std: float = 0.01
    capacity_walk: float = 0.01
    resistance_std: float = 0.05
    resistance_walk: float = 0.05

    def rest_threshold_A(self, capacity_Ah: float, share: float) -> float:
        """Rest threshold of the measured current [A]: `share` of 1 C and three sigma of the sensor."""
        return share * capacity_Ah + 3.0 * self.current_std_A

    def __post_init__(self) -> None:
        for f in fields(self):
            value = getattr(self, f.name)
            if f.name in ("voltage_std_V", "model_soc_length"):
                require_positive(f"noise.{f.name}", value)
            else:
                require_between(f"noise.{f.name}", value, 0.0, float("inf"))
