"""The plan file: legs of a mission as TOML that people write. Units are part of the names; every key is known."""

from __future__ import annotations

from dataclasses import dataclass, replace
from os import PathLike

from ohmward.battery.models.temperature import ROOM_DEGC
from ohmward.checks import require_between, require_each_not_negative
from ohmward.energy.leg import Leg
from ohmward.errors import InputError
from ohmward.quantities import COLDEST_DEGC, HOTTEST_DEGC
from ohmward.toml_file import TomlFile

FORMAT = "ohmward-plan/1"

EXAMPLE = f"""\
# A mission as ohmward plans it. Units are part of the names. Legs are driven in this order.
format = "{FORMAT}"
reserve_soc = 0.1          # state of charge that must be left at the end, 0 to 1
# cutoff_V = 21.0          # terminal voltage at which the robot stops
# temperature_degC = 15.0  # of the battery
# payload_kg = 0.0         # on every leg, on top of the leg's own

[[leg]]
distance_m = 400.0
terrain = "grass"          # a name of the consumption table
speed_m_s = 0.5
grade_rad = 0.02           # mean slope, > 0 uphill; 0.01745 is one degree
stop_s = 120.0             # standing time at the end of the leg

[[leg]]
distance_m = 400.0
terrain = "grass"
speed_m_s = 0.5
grade_rad = -0.02
"""


@dataclass(frozen=True)
class Plan:
    """A mission as its file has it."""

    leg: tuple[Leg, ...]  #: in the order in which they are driven; at least one
    #: state of charge that must be left, in [0, 1); None where the plan does not give it
    reserve_soc: float | None = None
    cutoff_V: float = 0.0  #: terminal voltage at which the robot stops; 0 where nothing watches it
    temperature_degC: float = ROOM_DEGC  #: of the battery
    payload_kg: float = 0.0  #: on every leg, on top of its own

    def __post_init__(self) -> None:
        if not self.leg:
            raise InputError("the plan has no leg; add at least one [[leg]]")
        if self.reserve_soc is not None:
            require_between("reserve_soc", self.reserve_soc, 0.0, 0.99)
        require_between("temperature_degC", self.temperature_degC, COLDEST_DEGC, HOTTEST_DEGC)
        require_each_not_negative("", self, "cutoff_V", "payload_kg")

    @property
    def legs(self) -> tuple[Leg, ...]:
        """The legs with all that they carry."""
        return tuple(replace(leg, payload_kg=leg.payload_kg + self.payload_kg) for leg in self.leg)


_FILE = TomlFile(Plan, FORMAT, "# A mission as ohmward plans it.")


def load_plan(path: str | PathLike[str]) -> Plan:
    """The plan in a file.

    Raises:
        InputError: the file cannot be read or is no plan; names file, key, rule and fix.
    """
    return _FILE.load(path)
