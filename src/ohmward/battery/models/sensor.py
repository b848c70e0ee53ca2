"""Current sensor of a battery, as an estimator must assume it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ohmward.battery.models.noise import HOUR_S, walk_variance
from ohmward.checks import require_each_not_negative, require_finite
from ohmward.trace.expression import Scalar

#: Offset, its random walk in an hour and least noise of a sensor without a data sheet, as shares of 1 C. Measured cells
#: were published with offsets of 2 to 6.5 % of 1 C.
OFFSET_SHARE = 0.025
OFFSET_WALK_SHARE = 0.001
NOISE_SHARE = 0.002

#: An offset of more standard deviations is none: something else is wrong.
MOST_OFFSET = 3.0


@dataclass(frozen=True)
class CurrentSensor:
    """Standard deviations of a current sensor, from its data sheet if it has one, and its offset as logs show it."""

    noise_std_A: float = 0.05  #: white noise, of samples 1 s apart
    offset_std_A: float = 0.05  #: error of `offset_A`
    offset_walk_A: float = 0.002  #: random walk of the offset in one hour
    gain_std: float = 0.01  #: relative error of the gain
    offset_A: float = 0.0  #: reading at zero current; 0 where nothing is known of it

    def __post_init__(self) -> None:
        require_each_not_negative("sensor.", self, "noise_std_A", "offset_std_A", "offset_walk_A", "gain_std")
        require_finite("sensor.offset_A", self.offset_A)

    def offset_walk_variance(self, dt_s: Scalar) -> Scalar:
        """Process variance [A^2] of the offset in one step."""
        return walk_variance(self.offset_walk_A, HOUR_S, dt_s)

    def contradicts(self, offset_A: Scalar) -> Any:
        """True where this sensor cannot have such an offset."""
        return abs(offset_A - self.offset_A) > MOST_OFFSET * self.offset_std_A

    def rest_threshold_A(self, capacity_Ah: float, share: float) -> float:
        """Rest threshold of the measured current [A]: `share` of 1 C and three sigma of the noise."""
        return share * capacity_Ah + 3.0 * self.noise_std_A


def usual_sensor(capacity_Ah: float, noise_A: float = 0.0) -> CurrentSensor:
    """Current sensor without a data sheet; noise_A: its white noise, as far as a log has shown it."""
    return CurrentSensor(
        noise_std_A=max(noise_A, NOISE_SHARE * capacity_Ah),
        offset_std_A=OFFSET_SHARE * capacity_Ah,
        offset_walk_A=OFFSET_WALK_SHARE * capacity_Ah,
    )
