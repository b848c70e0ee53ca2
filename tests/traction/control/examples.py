"""A wheel, its controller, and a plant of two states that is quick enough for tests without MuJoCo."""

from typing import NamedTuple

from kernels import kernel_of
from ohmward.traction import RLMA
from ohmward.traction.control import Limits, Measurement, SlidingMode, Uncertainty, driven_wheel
from ohmward.traction.control.slip_law import Motion
from ohmward.traction.friction.law import CoulombCreep, TractionLaw, contact

WHEEL = driven_wheel(RLMA)
LIMITS = Limits(torque_Nm=12.0, rate_Nm_per_s=5000.0)
#: Friction is taken as 0.5, give or take 0.5.
UNSURE = Uncertainty(force_N=0.5 * WHEEL.load_N)
SLIDING = SlidingMode(UNSURE)
DRY, SLIPPERY = CoulombCreep(0.8, 6.25), CoulombCreep(0.2, 6.25)
SUBSTEPS = 5


class Truth(NamedTuple):
    wheel_speed_rad_s: float = 0.0
    speed_m_s: float = 0.0


def measured(x: Truth) -> Measurement:
    return Measurement(x.wheel_speed_rad_s, x.speed_m_s)


def turn(x: Truth, torque_Nm: float, law: TractionLaw, dt_s: float, pull_N: float = 0.0) -> Truth:
    """The wheel and its share of the robot after `dt_s`; pull_N holds the robot back."""
    omega, v = x
    h = dt_s / SUBSTEPS
    for _ in range(SUBSTEPS):
        F = law.force_N(contact(WHEEL.radius_m * omega, v, WHEEL.load_N))
        omega += h * (torque_Nm - WHEEL.radius_m * F) / WHEEL.inertia_kg_m2
        v += h * (F - pull_N) / WHEEL.mass_kg
    return Truth(omega, v)


def drive(controller, command, law, duration_s, dt_s=1e-3, start=None, pull_N=0.0):
    """Truth, torque and report of every step; command: of time."""
    x = start or Truth()
    state = controller.init(measured(x))
    step = kernel_of(controller, state, command(0.0), measured(x), dt_s)
    steps = []
    for k in range(round(duration_s / dt_s)):
        state, torque, report = step(state, command(k * dt_s), measured(x), dt_s)
        x = turn(x, torque, law, dt_s, pull_N)
        steps.append((x, float(torque), report))
    return steps


def motion(**changes) -> Motion:
    usual = Motion(
        rim_m_s=1.1,
        travel_m_s=1.0,
        acceleration_m_s2=0.3,
        force_N=20.0,
        slip_target=0.12,
        target_rate_per_s=0.0,
        floor_m_s=0.2,
        dt_s=1e-3,
    )
    return usual._replace(**changes)
