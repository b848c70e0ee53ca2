"""A robot on four wheels in MuJoCo, whose contact and rigid-body dynamics are independent of ours.

Torques go in, the truth comes out. Needs the extra `sim`; MuJoCo is imported when a plant is made, not before. Grade
tilts gravity, not the ground. Contacts, rigid bodies and integrator are MuJoCo's own; ours are the numbers that make a
contact behave as a wheel.

Wheels are spheres and touch one plane through explicit pairs, whose friction can change in time. A contact should act
as a spring and damper, N = k depth + c speed, and, below mu N, as traction C N_0 s. MuJoCo regularises: an impedance d
adds a mass d / ((1 - d) A) to the normal direction and `impratio` times that along the ground, A being the inverse
mass that it assigns to the contact. With its defaults, d = 0.9 and ratio 1, slip of 0.2 m/s lifts a wheel, which then
chatters, and slip follows torque 0.1 s late. The smallest d that MuJoCo takes makes these masses small, 1.5 g and
0.45 kg; the large ratio leaves the wheel on the ground up to s of about ratio / (mu C), 60 m/s on mu = 0.8.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields
from typing import Any, cast

import numpy as np

from ohmward.checks import (
    require_between,
    require_each_not_negative,
    require_each_positive,
    require_finite,
    require_positive,
)
from ohmward.errors import InputError
from ohmward.optional import require
from ohmward.traction.dynamics.slip import slip_ratio
from ohmward.traction.robot.chassis import Differential
from ohmward.traction.robot.packaged import RLMA
from ohmward.traction.robot.robot import GRAVITY
from ohmward_lab.simulate.ground import Grade, Patch, adhesion, surface
from ohmward_lab.simulate.robot_sensors import WHEELS, RobotTruth, driven_torques, stack

FRONT = (0, 1)
FRONT_AND_REAR = (0, 1, 2, 3)

_CHASSIS = cast(Differential, RLMA.chassis)


@dataclass(frozen=True)
class RlmaParameters:
    """Robot of four wheels on two axles.

    Mass, axles, track, radius, outer size and driven wheels are those of [T], the other values are assumed. All four
    wheels are fixed to the body: to turn, it must slide sideways, unlike the planar model of [T].

    Raises:
        InputError: a value out of its range.
    """

    mass_kg: float = RLMA.mass_kg  #: with the wheels
    wheel_mass_kg: float = 1.5  #: of each wheel, a solid disc of `wheel_width_m`
    rotor_inertia_kg_m2: float = 0.0  #: of each motor, as felt at the wheel (n^2 J_rotor)
    wheel_radius_m: float = RLMA.wheel.radius_m  #: rolling radius under the static load
    wheel_width_m: float = RLMA.wheel.width_m
    #: from the centre of gravity to the axles (L_f, L_r)
    front_m: float = _CHASSIS.front_m
    rear_m: float = _CHASSIS.rear_m
    track_m: float = _CHASSIS.track_m  #: between left and right wheels (b)
    #: length, width, height of the body, which gives its moments of inertia
    body_m: tuple[float, float, float] = (0.68, 0.38, 0.20)
    centre_height_m: float = RLMA.height_m  #: of the centre of gravity, wheels included
    driven: tuple[int, ...] = FRONT  #: wheels with a motor, numbered as `WHEELS`: `FRONT` or `FRONT_AND_REAR`
    rolling_resistance: float = 0.01  #: moment against the turning of each wheel, over static load times radius
    drag_N_s2_per_m2: float = 0.0  #: drag over the square of the speed, at the centre of the body
    slip_stiffness_s_per_m: float = 6.25  #: traction over static load and slip speed, below the friction limit
    #: of each wheel against the ground
    contact_stiffness_N_per_m: float = 60e3
    contact_damping_N_s_per_m: float = 1000.0

    def __post_init__(self) -> None:
        may_be_zero = ("rotor_inertia_kg_m2", "rolling_resistance", "drag_N_s2_per_m2")
        positive = [f.name for f in fields(self) if f.name not in (*may_be_zero, "driven")]
        require_each_positive("rlma.", self, *positive)
        require_each_not_negative("rlma.", self, *may_be_zero)
        if not self.body_mass_kg > 0:
            raise InputError(f"rlma.mass_kg must exceed that of the 4 wheels, {4 * self.wheel_mass_kg:g} kg")
        if not self.driven or not set(self.driven) <= set(FRONT_AND_REAR) or len(set(self.driven)) < len(self.driven):
            raise InputError(f"rlma.driven must name wheels out of {FRONT_AND_REAR}, each once, got {self.driven}")

    @property
    def body_mass_kg(self) -> float:
        """Mass without the wheels."""
        return self.mass_kg - 4 * self.wheel_mass_kg

    @property
    def body_height_m(self) -> float:
        """Height of the centre of gravity without the wheels."""
        return (self.mass_kg * self.centre_height_m - 4 * self.wheel_mass_kg * self.wheel_radius_m) / self.body_mass_kg

    @property
    def body_x_m(self) -> float:
        """Distance of the body's centre of gravity ahead of the robot's; it balances the wheels."""
        return -2 * self.wheel_mass_kg * (self.front_m - self.rear_m) / self.body_mass_kg

    @property
    def wheel_inertia_kg_m2(self) -> float:
        """Moment of inertia of one wheel about its axle, without the rotor."""
        return 0.5 * self.wheel_mass_kg * self.wheel_radius_m**2

    @property
    def wheel_position_m(self) -> np.ndarray:
        """(4, 2) positions of the wheels ahead of and to the left of the centre of gravity."""
        x, y = (self.front_m, self.front_m, -self.rear_m, -self.rear_m), 0.5 * self.track_m
        return np.column_stack([x, (y, -y, y, -y)])

    @property
    def static_load_N(self) -> np.ndarray:
        """(4,) normal load of the wheels at rest on level ground."""
        share = np.array([self.rear_m, self.rear_m, self.front_m, self.front_m]) / (self.front_m + self.rear_m)
        return 0.5 * share * self.mass_kg * GRAVITY


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
    """(4,) depth to which the wheels sink in at rest on level ground."""
    return p.static_load_N / p.contact_stiffness_N_per_m


def _body(p: RlmaParameters) -> str:
    length, width, height = p.body_m
    inertia = (width**2 + height**2, length**2 + height**2, length**2 + width**2)
    x, z = p.body_x_m, p.body_height_m - p.wheel_radius_m
    return _inertial((x, 0.0, z), p.body_mass_kg, tuple(p.body_mass_kg / 12 * square for square in inertia))


def _wheel(i: int, p: RlmaParameters) -> str:
    """Body of wheel i; MuJoCo's contact is half the depth inside the sphere, where its radius is the rolling one."""
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


#: Ground without a patch.
DRY = Patch(friction=0.8)
_BODY = 1
_WHEELS = slice(2, 6)


class RlmaPlant:
    """The robot on a ground. Nothing in it is random: the same torques give the same truth.

    Args:
        parameters: of the robot.
        patches: of hard ground, of which only the adhesion is used; dry everywhere where there are none.
        grade: along x.
        longest_step_s: of the physics; `step` divides longer steps.
        wheels: their names in the patches.

    Raises:
        InputError: MuJoCo is not installed, a ground without an adhesion, patches that overlap or name unknown wheels,
            or a step so long that the slip of the wheels oscillates.
    """

    def __init__(
        self,
        parameters: RlmaParameters | None = None,
        patches: Sequence[Patch] = (DRY,),
        grade: Grade | None = None,
        longest_step_s: float = 1e-3,
        wheels: Sequence[str] = WHEELS,
    ) -> None:
        self.parameters = parameters or RlmaParameters()
        self._surface, self._grade = surface(patches, wheels), grade or Grade()
        adhesions = [adhesion(patch.ground(RLMA)) for patch in self._surface.patches]
        require_finite("adhesion of the ground", adhesions)
        self._adhesion = np.array(adhesions)
        self._longest_step_s = longest_step_s
        self._mujoco = require("mujoco", "this plant")
        self._model = self._mujoco.MjModel.from_xml_string(robot_xml(self.parameters))
        inverse_mass_per_kg = self._model.body_invweight0[_WHEELS, 0]
        contact = contact_stiffness(self.parameters, inverse_mass_per_kg)
        self._model.pair_solref[:], self._model.pair_solreffriction[:] = contact
        stable_s = stable_step_s(self.parameters, inverse_mass_per_kg)
        require_between("longest_step_s", longest_step_s, 1e-5, stable_s)
        self._data = self._mujoco.MjData(self._model)
        self._friction = self._model.pair_friction[:, :2].T
        self.reset()

    def reset(self, speed_m_s: float = 0.0, heading_rad: float = 0.0) -> RobotTruth:
        """Put the robot back to the origin, rolling without slip at `speed_m_s`; return the truth there."""
        require_between("speed_m_s", speed_m_s, -10.0, 10.0)
        require_finite("heading_rad", heading_rad)
        d = self._data
        self._mujoco.mj_resetData(self._model, d)
        d.qpos[3:7] = math.cos(0.5 * heading_rad), 0.0, 0.0, math.sin(0.5 * heading_rad)
        d.qvel[:2] = speed_m_s * math.cos(heading_rad), speed_m_s * math.sin(heading_rad)
        d.qvel[6:] = speed_m_s / self.parameters.wheel_radius_m
        return self._settled()

    def step(self, torque_N_m: Any, dt_s: float) -> RobotTruth:
        """Hold the torque for `dt_s`; return the truth at the end, with forces and accelerations under this torque.

        torque_N_m: of each driven wheel, a number or one for each in the order of `parameters.driven`.

        Raises:
            InputError: a wrong number of torques, a number that is not finite, dt_s <= 0.
        """
        require_positive("dt_s", dt_s)
        driven = self.parameters.driven
        self._data.ctrl[list(driven)] = driven_torques(torque_N_m, driven)
        parts = math.ceil(dt_s / self._longest_step_s - 1e-9)
        self._model.opt.timestep = dt_s / parts
        for _ in range(parts):
            self._surroundings()
            self._mujoco.mj_step(self._model, self._data)
        return self._settled()

    def _surroundings(self) -> float:
        """Set friction, gravity and drag of the next step; return the grade."""
        d, p = self._data, self.parameters
        self._friction[:] = self._adhesion[list(self._surface.under(d.xpos[_WHEELS, 0].tolist(), d.time))]
        grade = self._grade.at(float(d.xpos[_BODY, 0]))
        self._model.opt.gravity[:] = -GRAVITY * math.sin(grade), 0.0, -GRAVITY * math.cos(grade)
        if p.drag_N_s2_per_m2:
            vx, vy = d.qvel[:2]
            factor = -p.drag_N_s2_per_m2 * math.hypot(vx, vy)
            d.xfrc_applied[_BODY, :2] = factor * vx, factor * vy
        return grade

    def _settled(self) -> RobotTruth:
        """Forces and accelerations for the present state, and the truth."""
        self._mujoco.mj_kinematics(self._model, self._data)
        grade = self._surroundings()
        self._mujoco.mj_forward(self._model, self._data)
        return _truth(self._data, self.parameters, self._friction[0].copy(), grade)


def drive(
    plant: RlmaPlant, torque_N_m: float | Callable[[RobotTruth], Any], duration_s: float, dt_s: float = 0.01
) -> RobotTruth:
    """Reset the plant, drive for `duration_s` and stack the truth, (T, ...), the start included.

    torque_N_m: a number, or a controller, called every `dt_s` with the truth.

    Raises:
        InputError: as `RlmaPlant.step`.
    """
    truths = [plant.reset()]
    for _ in range(round(duration_s / dt_s)):
        torque = torque_N_m(truths[-1]) if callable(torque_N_m) else torque_N_m
        truths.append(plant.step(torque, dt_s))
    return stack(truths)


def _truth(d: Any, p: RlmaParameters, friction: np.ndarray, grade_rad: float) -> RobotTruth:
    x, y = d.xmat[_BODY, 0], d.xmat[_BODY, 3]  # the body's x axis, seen from above
    cos, sin = x / math.hypot(x, y), y / math.hypot(x, y)
    forward, left = np.array([cos, sin, 0.0]), np.array([-sin, cos, 0.0])
    speed, yaw_rate = float(d.qvel[:3] @ forward), float(d.sensordata[2])
    wheel_speed = d.qvel[6:].copy()
    centre_speed = speed - p.wheel_position_m[:, 1] * yaw_rate
    rolling = p.wheel_radius_m * wheel_speed
    force = ground_forces(d)
    return RobotTruth(
        time_s=d.time,
        position_m=d.qpos[:3].copy(),
        heading_rad=math.atan2(sin, cos),
        speed_m_s=speed,
        lateral_speed_m_s=float(d.qvel[:3] @ left),
        yaw_rate_rad_s=yaw_rate,
        wheel_angle_rad=d.qpos[7:].copy(),
        wheel_speed_rad_s=wheel_speed,
        torque_N_m=d.ctrl.copy(),
        wheel_centre_speed_m_s=centre_speed,
        slip_speed_m_s=rolling - centre_speed,
        slip_ratio=slip_ratio(rolling, centre_speed),
        traction_N=force @ forward,
        lateral_N=force @ left,
        normal_N=force[:, 2],
        friction=friction,
        grade_rad=grade_rad,
        gyro_rad_s=d.sensordata[:3].copy(),
        specific_force_m_s2=d.sensordata[3:6].copy(),
    )


def ground_forces(d: Any) -> np.ndarray:
    """(4, 3) force of the ground on each wheel in the world [N], zero for a wheel that does not touch it."""
    force = np.zeros((4, 3))
    contact = d.contact
    rows = contact.efc_address[:, None] + np.arange(3)
    frames = contact.frame.reshape(-1, 3, 3)
    force[contact.geom[:, 1] - 1] = np.einsum("ci,cij->cj", d.efc_force[rows], frames)
    return force
