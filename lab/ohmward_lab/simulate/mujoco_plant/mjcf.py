"""The robot as MJCF, MuJoCo's own language.

Wheels are spheres and touch one plane through explicit pairs, whose friction can change in time. A contact is meant
as a spring and damper, N = k depth + c speed, and, below mu N, as traction C N_0 s. MuJoCo regularises: an impedance d
adds a mass d / ((1 - d) A) to the normal direction and `impratio` times that along the ground, A being the inverse
mass that it assigns to the contact. With its defaults, d = 0.9 and ratio 1, slip of 0.2 m/s lifts a wheel, which then
chatters, and slip follows torque 0.1 s late. The smallest d that MuJoCo takes makes these masses small, 1.5 g and
0.45 kg; the large ratio leaves the wheel on the ground up to s of about ratio / (mu C), 60 m/s on mu = 0.8.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ohmward.traction.robot.robot import GRAVITY
from ohmward_lab.simulate.mujoco_plant.parameters import RlmaParameters
from ohmward_lab.simulate.robot_sensors import WHEELS

#: d, the smallest impedance that MuJoCo takes; see the module.
IMPEDANCE = 1e-4
#: `impratio`; see the module.
FRICTION_RATIO = 300.0


def robot_xml(p: RlmaParameters) -> str:
    """MJCF of the robot at rest on level ground; contacts still lack stiffness, damping and creep.

    Bodies, joints, geoms, motors and pairs of the wheels come in the order of `WHEELS`.
    """
    axle_height_m = p.wheel_radius_m - 0.5 * float(np.mean(static_depth_m(p)))
    return f"""
<mujoco model="rlma">
  <option cone="elliptic" impratio="{FRICTION_RATIO}" gravity="0 0 {-GRAVITY}"/>
  <default>
    <geom contype="0" conaffinity="0"/>
    <joint solreffriction="0.01 1" solimpfriction="0.999 0.999 0.001"/>
    <pair condim="3" solimp="{IMPEDANCE} {IMPEDANCE} 0.001" solref="-1 -1" solreffriction="0 -1"/>
  </default>
  <worldbody>
    <geom name="ground" type="plane" size="0 0 1"/>
    <body name="body" pos="0 0 {axle_height_m}">
      <freejoint/>
      {_body(p)}
      <site name="imu"/>
      {_lines(_wheel(i, p) for i in range(4))}
    </body>
  </worldbody>
  <contact>{_lines(f'<pair geom1="ground" geom2="{name}"/>' for name in WHEELS)}</contact>
  <actuator>{_lines(f'<motor joint="{name}"/>' for name in WHEELS)}</actuator>
  <sensor><gyro site="imu"/><accelerometer site="imu"/></sensor>
</mujoco>"""


def contact_stiffness(p: RlmaParameters, inverse_mass_per_kg: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`solref` (4, 2) and `solreffriction` (4, 2) of the pairs, in MuJoCo's direct form (-stiffness, -damping).

    inverse_mass_per_kg: (4,) that MuJoCo assigns to each wheel (`body_invweight0`).

    MuJoCo's force is (k' depth + c' speed) / R with k' = stiffness / d, c' = damping / d and R = (1 - d) A / d for the
    normal direction, R / impratio along the ground, so stiffness = k R d gives k (chapter Computation of its manual).
    """
    normal = (1 - IMPEDANCE) * inverse_mass_per_kg
    along = normal / FRICTION_RATIO
    spring = np.array([p.contact_stiffness_N_per_m, p.contact_damping_N_s_per_m])
    creep = p.slip_stiffness_s_per_m * p.static_load_N
    return -np.outer(normal, spring), np.column_stack([np.zeros(4), -creep * along])


def stable_step_s(p: RlmaParameters, inverse_mass_per_kg: np.ndarray) -> float:
    """Longest step [s]; slip decays at C N_0 over the mass of the wheel, and with this step overshoots by half."""
    regularising_kg = FRICTION_RATIO * IMPEDANCE / ((1 - IMPEDANCE) * inverse_mass_per_kg)
    spinning_kg = p.wheel_inertia_kg_m2 / p.wheel_radius_m**2
    return 1.5 * float(np.min((spinning_kg + regularising_kg) / (p.slip_stiffness_s_per_m * p.static_load_N)))


def static_depth_m(p: RlmaParameters) -> np.ndarray:
    """(4,) how deep the wheels sink in at rest on level ground."""
    return p.static_load_N / p.contact_stiffness_N_per_m


def _body(p: RlmaParameters) -> str:
    length, width, height = p.body_m
    inertia = (width**2 + height**2, length**2 + height**2, length**2 + width**2)
    x, z = p.body_x_m, p.body_height_m - p.wheel_radius_m
    return _inertial((x, 0.0, z), p.body_mass_kg, tuple(p.body_mass_kg / 12 * square for square in inertia))


def _wheel(i: int, p: RlmaParameters) -> str:
    """Touches the ground, as MuJoCo sees it, half the depth inside the sphere: there its radius is the rolling one."""
    name, (x, y) = WHEELS[i], p.wheel_position_m[i]
    spin = p.wheel_inertia_kg_m2
    across = 0.5 * spin + p.wheel_mass_kg * p.wheel_width_m**2 / 12
    friction_N_m = p.rolling_resistance * p.static_load_N[i] * p.wheel_radius_m
    rotor = p.rotor_inertia_kg_m2 if i in p.driven else 0.0
    return f"""<body name="{name}" pos="{x} {y} 0">
        <joint name="{name}" axis="0 1 0" frictionloss="{friction_N_m}" armature="{rotor}"/>
        {_inertial((0.0, 0.0, 0.0), p.wheel_mass_kg, (across, spin, across))}
        <geom name="{name}" type="sphere" size="{p.wheel_radius_m + 0.5 * static_depth_m(p)[i]}"/>
      </body>"""


def _inertial(centre_m: tuple[float, ...], mass_kg: float, moments_kg_m2: tuple[float, ...]) -> str:
    return f'<inertial pos="{_numbers(centre_m)}" mass="{mass_kg}" diaginertia="{_numbers(moments_kg_m2)}"/>'


def _numbers(values: tuple[float, ...]) -> str:
    return " ".join(str(value) for value in values)


def _lines(parts: Iterable[str]) -> str:
    return "\n      ".join(parts)
