"""A drive to be simulated: robot, battery, ground, sensors, observer, controller and commands; and its file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from importlib.resources import files
from itertools import pairwise
from os import PathLike
from pathlib import Path

import numpy as np

from ohmward.checks import require_between, require_finite, require_one_of
from ohmward.errors import InputError
from ohmward.quantities import DAY_S
from ohmward.toml_file import TomlFile
from ohmward.traction.robot.packaged import PACKAGED, RLMA, load_robot
from ohmward.traction.robot.robot import Robot
from ohmward_lab.simulate.closed_loop.control import Command, Control
from ohmward_lab.simulate.closed_loop.observing import Observing
from ohmward_lab.simulate.closed_loop.sensing import Sensing
from ohmward_lab.simulate.closed_loop.supply import Pack
from ohmward_lab.simulate.ground import Grade, GroundSurface, Patch, surface

PLANTS = ("own", "mujoco")
SHORTEST_RUN_S, LONGEST_RUN_S = 0.01, DAY_S
#: Robots by name. RLMA's electronics draw what a small computer does; [T] does not say.
ROBOTS: Mapping[str, Robot] = {**PACKAGED, "rlma": replace(RLMA, idle_W=10.0)}


@dataclass(frozen=True)
class Scenario:
    """Everything that a run depends on: the same scenario gives the same run.

    Raises:
        InputError: a value out of its range, or parts that do not fit each other.
    """

    duration_s: float  #: at least 0.01 and one interval of the sensors, at most a day
    commands: tuple[Command, ...]  #: over time, the first from 0 s on
    robot: str = "rlma"  #: one of `ROBOTS`, or a robot file
    plant: str = "own"  #: "own", our equations with load transfer, or "mujoco", independent contacts and bodies
    battery: Pack = field(default_factory=Pack)  #: its kind or file, and start
    ground: tuple[Patch, ...] = ()  #: patches; the one without an edge lies under all others
    grade: Grade = field(default_factory=Grade)  #: of the ground along x
    sensors: Sensing = field(default_factory=Sensing)  #: of the robot
    observer: Observing = field(default_factory=Observing)  #: of its speed and slip
    controller: Control = field(default_factory=Control)  #: of its torque
    start_speed_m_s: float = 0.0  #: speed along x at which the robot rolls at the start, known to the observer
    drag_N_s2_per_m2: float = 0.0  #: drag over the square of the speed, >= 0
    seed: int = 1  #: draws the random errors of the sensors
    name: str = ""  #: in words

    def __post_init__(self) -> None:
        require_between("duration_s", self.duration_s, max(SHORTEST_RUN_S, self.sensors.interval_s), LONGEST_RUN_S)
        require_between("seed", self.seed, 0, 2**32)
        require_one_of("plant", self.plant, PLANTS)
        require_finite("start_speed_m_s", self.start_speed_m_s)
        require_between("drag_N_s2_per_m2", self.drag_N_s2_per_m2, 0.0, math.inf)
        if self.observer.method == "momentum" and self.start_speed_m_s:
            raise InputError(
                'observer.method = "momentum" knows its speed from a standstill; leave out start_speed_m_s'
            )
        self._check_commands()
        self.sensors.encoder_wheels(self.model)
        _ = self.surface
        if self.sensors.interval_s < self.controller.interval_s:
            raise InputError(
                f"sensors.interval_s must be at least controller.interval_s = {self.controller.interval_s:g}, got "
                f"{self.sensors.interval_s:g}; sensors sample in the steps of the controller"
            )

    @cached_property
    def model(self) -> Robot:
        """The robot itself.

        Raises:
            InputError: a name that is not known, or a file that cannot be read.
        """
        if self.robot in ROBOTS:
            return ROBOTS[self.robot]
        if not self.robot.endswith(".toml"):
            raise InputError(f"robot must be one of {', '.join(ROBOTS)}, or a robot file (.toml); got {self.robot!r}")
        return load_robot(self.robot)

    @cached_property
    def surface(self) -> GroundSurface:
        """The ground under the robot's wheels."""
        return surface(self.ground, [p.name for p in self.model.places])

    def _check_commands(self) -> None:
        times = [c.from_s for c in self.commands]
        if not times or times[0] != 0.0 or any(b <= a for a, b in pairwise(times)):
            raise InputError(f"commands must begin with from_s = 0 and follow each other in time, got from_s = {times}")
        if times[-1] >= self.duration_s:
            raise InputError(
                f"commands.from_s must be below duration_s = {self.duration_s:g}, got {times[-1]:g}; drive for longer"
            )
        for command in self.commands:
            self.controller.check(command)
            _check_speed(command, self.model, self.battery)


def _check_speed(command: Command, robot: Robot, pack: Pack) -> None:
    """Refuse a speed at which the motors would need more than the battery's voltage."""
    if command.speed_m_s is None:
        return
    most = pack.battery.voltage_min_V / robot.motor.wheel_constant_Nm_per_A * robot.wheel.radius_m
    motion = np.zeros(robot.freedoms)
    motion[0], motion[-1] = command.speed_m_s, command.yaw_rate_rad_s or 0.0
    fastest = float(np.max(np.abs(robot.rolling[: robot.driven] @ motion)))
    if fastest > most:
        raise InputError(
            f"commands.speed_m_s must keep the wheels below {most:.3g} m/s, where the motors need all of the "
            f"{pack.battery.voltage_min_V:.3g} V of an empty battery; {command.speed_m_s:g} with yaw_rate_rad_s = "
            f"{command.yaw_rate_rad_s or 0.0:g} takes {fastest:.3g} m/s; ask for less"
        )


_HEADER = """\
# A drive for `ohmward simulate`. Every key carries its unit; what is left out has a default, and
# `ohmward simulate --example` prints all keys with what they mean.
"""
_FILE = TomlFile(Scenario, "ohmward-scenario/1", _HEADER, digits=12, paths=("robot", "battery.file"))
#: The packaged scenario that shows every key.
EXAMPLE = "example"


def load_scenario(path: str | PathLike[str]) -> Scenario:
    """The scenario in a file; paths of robot and battery files in it are relative to its folder.

    Raises:
        InputError: the file cannot be read or has an impossible value; names file, key, rule and fix.
    """
    scenario = _FILE.load(path)
    return scenario if scenario.name else replace(scenario, name=Path(path).stem)


def save_scenario(scenario: Scenario, path: str | PathLike[str]) -> None:
    """Write the scenario file, all of it or none. Paths in it are relative to its folder when it is read.

    Raises:
        OhmwardError: the file cannot be written.
    """
    _FILE.save(scenario, path)


def parse_scenario(text: str) -> Scenario:
    """The scenario in the text of a scenario file.

    Raises:
        InputError: as `load_scenario`.
    """
    return _FILE.parse(text)


def packaged() -> Mapping[str, str]:
    """The scenarios that come with the package: name -> its first line."""
    return {name: text.partition("\n")[0].lstrip("# ") for name, text in sorted(_packaged_texts().items())}


def packaged_text(name: str) -> str:
    """The file of a packaged scenario.

    Raises:
        InputError: there is none of that name.
    """
    texts = _packaged_texts()
    if name not in texts:
        raise InputError(f"{name}: no such file, and no scenario of that name; there are: {', '.join(sorted(texts))}")
    return texts[name]


def find_scenario(name: str) -> Scenario:
    """The scenario in a file, or the packaged one of this name.

    Raises:
        InputError: as `load_scenario` and `packaged_text`.
    """
    if Path(name).is_file() or name.endswith(".toml"):
        return load_scenario(name)
    scenario = parse_scenario(packaged_text(name))
    return scenario if scenario.name else replace(scenario, name=name)


def _packaged_texts() -> dict[str, str]:
    folder = files("ohmward_lab.simulate").joinpath("scenarios")
    found = [file for file in folder.iterdir() if file.name.endswith(".toml")]
    return {file.name.removesuffix(".toml"): file.read_text(encoding="utf-8") for file in found}
