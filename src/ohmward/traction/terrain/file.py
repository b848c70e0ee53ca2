"""Floors file: the floors that one robot has learnt, as TOML that people read and edit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike

from ohmward.errors import InputError
from ohmward.toml_file import TomlFile
from ohmward.traction.terrain.floor import Floor

_HEADER = """\
# Floors that a robot has learnt, one [[floor]] each. friction: traction over load of a wheel that spins; stiffness:
# traction over load and slip where the slip is small; rolling, roller: what a wheel takes along its motion, and an
# omni-wheel's rollers along its axle, over its load; across: share of the motion along an omni-wheel's axle that its
# slip relates to; side: by which share it slips more as it moves to its left; speed_power: of the speed, from
# slowest_m_s to fastest_m_s, with which the stiffness grows. Every *_std is relative, but those of side and
# speed_power; slip_std is a slip, force_std a share of the load.
"""


@dataclass(frozen=True)
class Floors:
    """robot: name of the robot that learnt them; floor: each with its own name."""

    robot: str
    floor: tuple[Floor, ...] = ()

    def __post_init__(self) -> None:
        names = [f.name for f in self.floor]
        if twice := {name for name in names if names.count(name) > 1}:
            raise InputError(f"floor.name must differ from floor to floor; {sorted(twice)[0]!r} comes twice")

    def with_floor(self, floor: Floor) -> Floors:
        """With this floor, in the place of one with its name."""
        return Floors(self.robot, (*(f for f in self.floor if f.name != floor.name), floor))

    def named(self, names: Sequence[str]) -> Floors:
        """Only the floors of these names.

        Raises:
            InputError: no floor of such a name.
        """
        known = {f.name: f for f in self.floor}
        for name in names:
            if name not in known:
                raise InputError(f"no floor {name!r} has been learnt; the file has {', '.join(known) or 'none'}")
        return Floors(self.robot, tuple(known[name] for name in dict.fromkeys(names)))


_FILE = TomlFile(Floors, "ohmward-floors/1", _HEADER)


def save_floors(floors: Floors, path: str | PathLike[str]) -> None:
    """Write the floors file; it is either whole or not there.

    Raises:
        OhmwardError: the file cannot be written.
    """
    _FILE.save(floors, path)


def load_floors(path: str | PathLike[str]) -> Floors:
    """The floors in a file.

    Raises:
        InputError: the file cannot be read or says something that floors cannot be; names file, key, rule and fix.
    """
    return _FILE.load(path)
