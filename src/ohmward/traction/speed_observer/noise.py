"""Noise of sensors and model, on which the sigmas of the observer rest."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, fields

from ohmward.checks import require_between, require_positive
from ohmward.errors import InputError


@dataclass(frozen=True)
class ObserverNoise:
    """Standard deviations of sensors, random walks of states, and standard deviations before the first sample.

    A sensor with None does not exist: nothing is compiled for it.
    """

    encoder_std_rad_s: float = 0.07  #: of a driven wheel's speed; 2 pi / (counts sqrt(6) dt) from quantisation alone
    #: age of an encoder speed in steps: 0.5 for counts over the step, 0 for an instantaneous speed
    encoder_lag_share: float = 0.5
    torque_std_Nm: float = 0.1  #: of the torque at a wheel: current sensor, ripple, friction of the gear
    #: relative error of the nonlinear part of the slip, from the unknown curvature of the friction curve. No effect
    #: where the ground is known.
    curve_shape_std: float = 0.7
    #: correlation time of that error [s]: about as long as a slip is held. If it is shorter, the filter averages out an
    #: error that lasts: of 0.1, 0.2, 0.3, 0.5 and 0.8 s, on grounds with a corner and with encoders on the driven
    #: wheels only, 0.1 and 0.2 are overconfident, and 0.8 is needlessly wide.
    curve_shape_correlation_s: float = 0.5
    #: of a gyro (offset included), of encoders on wheels that are not driven, of an external speed without a std of its
    #: own, of a measured pitch
    gyro_std_rad_s: float | None = None
    passive_std_rad_s: float | None = None
    speed_std_m_s: float | None = None
    pitch_std_rad: float | None = None
    #: of unknown accelerations [m/s, rad/s, over the root of a second]
    speed_walk: float = 0.015
    yaw_rate_walk: float = 0.3
    #: relative, over the root of a second
    friction_walk: float = 0.3
    stiffness_walk: float = 0.3
    grade_walk: float = 0.006  #: [rad] over the root of a second
    rolling_walk: float = 0.05  #: relative, over the root of a second
    #: about the first motion by the encoders
    initial_speed_std_m_s: float = 0.05
    initial_yaw_rate_std_rad_s: float = 0.3
    #: relative, of the terrain's values
    friction_std: float = 0.7
    stiffness_std: float = 0.7
    #: about level; 1 degree is a disturbance of 0.17 m/s^2, of whatever origin
    grade_std_rad: float = math.radians(1.0)
    #: relative, of the robot's mass with its load; None where the mass is known. An error of it acts like a slope while
    #: wheels drive or brake, so the grade is at least that uncertain.
    mass_std: float | None = None
    rolling_std: float = 0.7  #: relative, of the terrain's rolling resistance
    radius_std: float = 0.005  #: relative, of the effective radius

    def __post_init__(self) -> None:
        stds = {field.name: getattr(self, field.name) for field in fields(self)}
        require_between("noise.encoder_lag_share", stds.pop("encoder_lag_share"), 0.0, 1.0)
        require_stds("noise", stds, [field.name for field in fields(self) if field.default is None])


def require_stds(prefix: str, values: Mapping[str, float | None], optional: Collection[str]) -> None:
    """Raise InputError unless standard deviations are > 0 and walks >= 0; an optional one may be None.

    Raises:
        InputError: names the value after the prefix.
    """
    for name, value in values.items():
        if value is None:
            if name not in optional:
                raise InputError(f"{prefix}.{name} is None; give it a number.")
        elif name.endswith("walk"):
            require_between(f"{prefix}.{name}", value, 0.0, math.inf)
        else:
            require_positive(f"{prefix}.{name}", value)
