"""What the tests of the observers share."""

from dataclasses import replace

import numpy as np

from kernels import kernel_of
from ohmward.traction import RLMA, ROBOTINO, Differential, RollingResistance, Terrain, scene
from ohmward.traction.friction.law import WardIagnemma
from ohmward.traction.motion.sample import RobotSample

DT_S = 0.01
FLOOR = Terrain("rubber on a hard floor", WardIagnemma(0.7, 20.0), RollingResistance(a3_s_per_m=0.0), "tests")
#: The observer takes static loads; so that a step has a closed form to compare with, no load moves here.
LOW = replace(RLMA, height_m=0.0)
SCENES = {
    "front-driven": scene(LOW, FLOOR),
    "all driven": scene(replace(LOW, chassis=Differential(0.314, 0.314, 0.30, driven="all")), FLOOR),
    "omni": scene(ROBOTINO, FLOOR),
}
RLMA_ON_FLOOR = SCENES["front-driven"]


def at_rest(observer):
    """A first sample of a robot that stands."""
    blank = observer.no_sample()
    return blank._replace(
        wheel_speed_rad_s=np.zeros_like(blank.wheel_speed_rad_s), current_A=np.zeros_like(blank.current_A)
    )


def observed(observer, samples, first=None):
    """The last state and the estimates (T, ...) of a log that starts at rest, or with this first sample."""
    first = at_rest(observer) if first is None else first
    return kernel_of(observer, observer.init(first), first).scan(observer.init(first), samples)


def log(wheel_speed_rad_s, current_A, **others):
    """Samples of a robot with two encoders on driven wheels, each (T,), both wheels alike."""
    speed, current = np.asarray(wheel_speed_rad_s, dtype=float), np.asarray(current_A, dtype=float)
    nothing = np.full(len(speed), np.nan)
    columns = {
        "dt_s": np.full(len(speed), DT_S),
        "wheel_speed_rad_s": np.column_stack([speed, speed, nothing, nothing]),
        "current_A": np.column_stack([current, current]),
    }
    blank = dict.fromkeys(RobotSample._fields, nothing) | {"speed_age_s": np.zeros(len(speed))}
    return RobotSample(**(blank | columns | others))
