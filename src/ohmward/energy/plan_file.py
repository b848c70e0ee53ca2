"""The plan file: legs of a mission as TOML that people write. Units are part of the names; every key is known."""

from __future__ import annotations

import difflib
import math
import tomllib
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields
from os import PathLike
from pathlib import Path
from typing import Any

from ohmward.checks import require_between
from ohmward.energy.leg import Leg
from ohmward.errors import InputError

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
    """A mission.

    Attributes:
        legs: in the order in which they are driven; at least one.
        reserve_soc: state of charge that must be left, in [0, 1); None where the plan does not say.
        cutoff_V: terminal voltage at which the robot stops; 0 where nothing watches it.
        temperature_degC: of the battery.
    """

    legs: tuple[Leg, ...]
    reserve_soc: float | None = None
    cutoff_V: float = 0.0
    temperature_degC: float = 25.0

    def __post_init__(self) -> None:
        if not self.legs:
            raise InputError("the plan has no leg; add at least one [[leg]]")
        if self.reserve_soc is not None:
            require_between("reserve_soc", self.reserve_soc, 0.0, 0.99)
        require_between("cutoff_V", self.cutoff_V, 0.0, math.inf)
        require_between("temperature_degC", self.temperature_degC, -60.0, 120.0)


def load_plan(path: str | PathLike[str]) -> Plan:
    """The plan in a file.

    Raises:
        InputError: the file cannot be read or is no plan; names file, key, rule and fix.
    """
    try:
        return parse_plan(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}); check the path") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is not text in UTF-8; is it a plan?") from error
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def parse_plan(text: str) -> Plan:
    """The plan in a text.

    Raises:
        InputError: not TOML, another format, an unknown or missing key, a value of another kind or outside its range.
    """
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"is not valid TOML: {error}; correct the line") from error
    if (found := data.pop("format", None)) != FORMAT:
        raise InputError(f'format must be "{FORMAT}", got {found!r}; `ohmward mission --plan-example` prints a plan')
    legs = data.pop("leg", [])
    payload_kg = _number("payload_kg", data.pop("payload_kg", 0.0))
    if not isinstance(legs, list) or not all(isinstance(leg, dict) for leg in legs):
        raise InputError("leg must be a list of tables, each beginning with [[leg]]")
    _require_keys(data, [f.name for f in fields(Plan) if f.name != "legs"], "")
    values = {key: _number(key, value) for key, value in data.items()}
    return Plan(tuple(_leg(leg, f"leg {k}", payload_kg) for k, leg in enumerate(legs, start=1)), **values)


def _leg(table: Mapping[str, Any], place: str, payload_kg: float) -> Leg:
    _require_keys(table, [f.name for f in fields(Leg)], f"{place}: ")
    for f in fields(Leg):
        if f.default is MISSING and f.name not in table:
            raise InputError(f"{place}: {f.name} is missing; add it")
    values = {key: _number(f"{place}: {key}", value) for key, value in table.items() if key != "terrain"}
    values["payload_kg"] = values.get("payload_kg", 0.0) + payload_kg
    if not isinstance(table["terrain"], str):
        raise InputError(f"{place}: terrain must be a name in quotes, got {table['terrain']!r}")
    try:
        return Leg(terrain=table["terrain"], **values)
    except InputError as error:
        raise InputError(f"{place}: {error}") from error


def _require_keys(table: Mapping[str, Any], known: list[str], place: str) -> None:
    for key in table:
        if key not in known:
            stem = key.rsplit("_", 1)[0]
            near = [n for n in known if n.startswith(f"{stem}_")] or difflib.get_close_matches(key, known, n=1)
            advice = (
                f"did you mean {near[0]}? Units are part of the names" if near else f"there are: {', '.join(known)}"
            )
            raise InputError(f"{place}{key} is not a key of a plan; {advice}")


def _number(name: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{name} must be a number, got {value!r}")
    return float(value)
