"""Conditions of the study of traction: a base case, and each of its assumptions broken by itself."""

from __future__ import annotations

from typing import NamedTuple

from ohmward.traction.speed_observer.default_observer import DEFAULT_TERRAIN
from ohmward_lab.assess.recommendation import Remedy, Situation


class World(NamedTuple):
    """Ground and robot, beside what the robot's file says."""

    ground: str = DEFAULT_TERRAIN  #: name of the terrain
    patch: str | None = None  #: of the one that takes its place for a while, again and again; None where there is none
    one_side: bool = False  #: the patch lies under the wheels of the left side alone
    grade_rad: float = 0.0  #: of the slopes, up and down
    #: of wheels and robot over those of the file
    radius_ratio: float = 1.0
    mass_ratio: float = 1.0


class DriveCondition(NamedTuple):
    """One condition."""

    #: in words
    factor: str
    level: str
    world: World = World()  #: ground and robot
    told: str = DEFAULT_TERRAIN  #: name of the ground that the observer is told
    interval_s: float = 0.02  #: between samples
    all_encoders: bool = False  #: of free wheels too
    counts_per_turn: int = 4096  #: of each encoder
    glitches: float = 0.0  #: share of an encoder's speeds that are wrong by 20 rad/s
    has_currents: bool = True  #: the motor currents are measured
    #: of these sensors; their signs alternate from run to run
    current_gain: float = 0.03
    gyro_offset_rad_s: float = 0.002
    current_noise_A: float = 0.1  #: standard deviation
    #: there is one, of a MEMS sensor and of an attitude filter
    has_gyro: bool = True
    has_pitch: bool = False
    speed_interval_s: float = 0.0  #: between speeds from outside, as of GNSS; 0 where there are none
    speed_delay_s: float = 0.0  #: by which they come late, with their age
    missing: float = 0.0  #: share of the encoders' and of the motors' samples that are lost

    @property
    def name(self) -> str:
        """In tables and files."""
        return f"{self.factor}: {self.level}"


#: The base case: the ground and the robot of the files, everyday sensors at 50 Hz, encoders on the driven wheels.
BASE_DRIVE = DriveCondition("base", "everyday sensors")

_ICE = World(patch="ice")

DRIVE_CONDITIONS: tuple[DriveCondition, ...] = (
    BASE_DRIVE,
    *(DriveCondition("ground", f"{name}, told asphalt", World(name)) for name in ("gravel", "wet asphalt", "ice")),
    DriveCondition("ground", "sand, told asphalt", World("LETE sand")),
    *(DriveCondition("ground told", name, World(name), told=name) for name in ("gravel", "wet asphalt", "ice")),
    DriveCondition("ground told", "sand", World("LETE sand"), told="LETE sand"),
    DriveCondition("patches of ice", "under all wheels", _ICE),
    DriveCondition("patches of ice", "under the left wheels", _ICE._replace(one_side=True)),
    DriveCondition("ice and more sensors", "encoders on free wheels", _ICE, all_encoders=True),
    *(
        DriveCondition("ice and more sensors", text, _ICE, speed_interval_s=every_s, speed_delay_s=late_s)
        for text, every_s, late_s in (
            ("speed from outside at 10 Hz", 0.1, 0.0),
            ("the same 0.2 s late", 0.1, 0.2),
            ("speed from outside at 1 Hz", 1.0, 0.0),
        )
    ),
    *(DriveCondition("slope", f"{percent} %", World(grade_rad=percent / 100)) for percent in (5, 15)),
    *(DriveCondition("wheel radius", f"{100 * (1 - r):.0f} % less", World(radius_ratio=r)) for r in (0.98, 0.95)),
    *(DriveCondition("mass", f"{100 * (r - 1):.0f} % more", World(mass_ratio=r)) for r in (1.2, 1.5)),
    *(DriveCondition("motor current", f"gain {gain:.0%} off", current_gain=gain) for gain in (0.1, 0.3)),
    DriveCondition("motor current", "noise of 1 A", current_noise_A=1.0),
    DriveCondition("motor current", "not measured", has_currents=False),
    DriveCondition("IMU", "gyro 0.05 rad/s off", gyro_offset_rad_s=0.05),
    DriveCondition("IMU", "none", has_gyro=False),
    DriveCondition("IMU", "with pitch, slope 15 %", World(grade_rad=0.15), has_pitch=True),
    DriveCondition("encoders", "64 counts a turn", counts_per_turn=64),
    DriveCondition("encoders", "1 % glitches", glitches=0.01),
    DriveCondition("interval", "0.1 s", interval_s=0.1),
    *(DriveCondition("lost samples", f"{share:.0%}", missing=share) for share in (0.05, 0.3)),
)

#: Names of conditions that differ in the ground alone that the observer is told: the true one, and another.
GROUND_PAIRS = tuple(
    (right.name, wrong.name)
    for right in DRIVE_CONDITIONS
    for wrong in DRIVE_CONDITIONS
    if wrong.told != right.told == right.world.ground
    and wrong == right._replace(factor=wrong.factor, level=wrong.level, told=wrong.told)
)


def _as_in_the_base_case(name: str) -> tuple[Remedy, ...]:
    return (Remedy(name, (BASE_DRIVE.factor,)),)


_FOR_ICE = (
    Remedy("encoders on free wheels", ("ice and more sensors: encoders on free wheels",)),
    Remedy("a speed from outside at 10 Hz", ("ice and more sensors: speed from outside at 10 Hz",)),
)
DRIVE_SITUATIONS = (
    Situation("ground and robot as in their files", ("base",)),
    Situation("another ground than told", ("ground",), (Remedy("the ground told right", ("ground told",)),)),
    Situation("another ground than asphalt, told", ("ground told",)),
    Situation("patches of ice", ("patches of ice",), _FOR_ICE),
    Situation("patches of ice, more sensors", ("ice and more sensors",), _FOR_ICE),
    Situation("slopes", ("slope",), (Remedy("an attitude filter", ("IMU: with pitch, slope 15 %",)),)),
    Situation("worn wheels, a load", ("wheel radius", "mass"), _as_in_the_base_case("calibration")),
    Situation(
        "motor currents wrong, noisy or none", ("motor current",), _as_in_the_base_case("better current sensors")
    ),
    Situation("gyro off or none, or an attitude filter", ("IMU",), _as_in_the_base_case("level ground and a gyro")),
    Situation("coarse encoders, glitches", ("encoders",), _as_in_the_base_case("better encoders")),
    Situation("samples seldom or lost", ("interval", "lost samples"), _as_in_the_base_case("50 samples a second")),
)
