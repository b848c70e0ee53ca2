"""Batteries and consumptions that the tests share."""

from dataclasses import replace

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.models.ocv import OcvCurve
from ohmward.battery.models.thevenin import Thevenin
from ohmward.energy.consumption import Consumption, Variance, begin_drive, learn, start, with_terrain
from ohmward.energy.consumption_prior import ConsumptionPrior
from ohmward.energy.leg import Leg, stretch_of

PRIOR = ConsumptionPrior(
    mass_kg=40.0,
    idle_W=10.0,
    idle_std_W=3.0,
    force_N=20.0,
    force_std_N=10.0,
    speed_N_s_per_m=5.0,
    speed_std_N_s_per_m=4.0,
)


def battery(ocv_V=(24.0, 24.0), r_ohm=0.0, capacity_Ah=10.0):
    """A battery with this curve and all its resistance in R0."""
    model = Thevenin(capacity_Ah, OcvCurve(tuple(ocv_V)), (r_ohm,) * 2, (r_ohm,) * 2, (), ())
    return Battery("test", capacity_Ah, thevenin=model)


def certain(idle_W=10.0, force_N=20.0, speed_N_s_per_m=0.0, climb=1.0, regeneration=0.0) -> Consumption:
    """A consumption without any doubt, on grass."""
    c = with_terrain(start(PRIOR), "grass")
    mean = np.array([idle_W, speed_N_s_per_m, climb, regeneration, 0.0, 0.0, force_N, 0.0])
    nothing = Variance(1e12, 1e-12)
    return replace(
        c,
        prior=replace(PRIOR, model_std=0.0, slope_std=0.0),
        mean=mean,
        cov=np.zeros((8, 8)),
        scatter=nothing,
        day=nothing,
        idle_noise=nothing,
    )


def learned(drives=3, seed=0) -> Consumption:
    """What some drives over grass and gravel have taught, a fourth under way."""
    rng, c = np.random.default_rng(seed), start(PRIOR)
    for _ in range(drives):
        c = begin_drive(c, days=1.0)
        for k in range(12):
            name, force_N = (("grass", 30.0), ("gravel", 15.0))[k // 3 % 2]
            s = stretch_of(Leg(40.0, name, 0.3 + 0.05 * k, stop_s=5.0))
            c = learn(
                c,
                s,
                12.0 * s.time_s + force_N * 40.0 + 6.0 * s.speed_distance_m2_s + rng.normal(0.0, 0.1 * force_N * 40.0),
            )
    return begin_drive(c, days=1.0)
