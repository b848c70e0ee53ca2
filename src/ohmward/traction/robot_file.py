"""The robot file: one robot as TOML that people read and edit. Units are part of the names; every key is known."""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Mapping
from dataclasses import MISSING, asdict, fields, is_dataclass
from os import PathLike
from pathlib import Path
from typing import Any, get_args, get_type_hints

from ohmward.errors import InputError
from ohmward.traction.chassis import Differential, Omni, SkidSteer
from ohmward.traction.robot import Robot

FORMAT = "ohmward-robot/1"
DIGITS = 9
#: What `kind` in the table [chassis] may be.
CHASSIS: Mapping[str, type] = {"differential": Differential, "skid-steer": SkidSteer, "omni": Omni}
_HEADER = """\
# A robot as ohmward knows it. Edit what you know better; every key carries its unit.
# x points forward, y to the left, both from the centre of gravity. [chassis] kind is one of:
#   differential (front_m, rear_m, track_m, driven = "front" or "all"), skid-steer (front_m, rear_m, track_m),
#   omni (arm_m, bearings_deg).
# [motor] is each of the motors: constant, resistance and rotor of the bare motor, friction and damping at the wheel.
"""


def save_robot(robot: Robot, path: str | PathLike[str]) -> None:
    """Write the robot file; it is either whole or not there.

    Raises:
        OhmwardError: the file cannot be written.
    """
    from ohmward.atomic import replacing

    with replacing(Path(path)) as temporary:
        temporary.write_text(dump_robot(robot), encoding="utf-8")


def load_robot(path: str | PathLike[str]) -> Robot:
    """The robot in a file.

    Raises:
        InputError: the file cannot be read or says something that a robot cannot be; names file, key, rule and fix.
    """
    try:
        return parse_robot(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}); check the path") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is not text in UTF-8; is it a robot file?") from error
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def dump_robot(robot: Robot) -> str:
    """The text of the robot file; numbers are rounded to 9 digits."""
    import tomli_w

    kinds = {cls: kind for kind, cls in CHASSIS.items()}
    tables = _short(asdict(robot))
    tables["chassis"] = {"kind": kinds[type(robot.chassis)], **tables["chassis"]}
    return f"{_HEADER}\n{tomli_w.dumps({'format': FORMAT, **tables})}"


def parse_robot(text: str) -> Robot:
    """The robot in the text of a robot file.

    Raises:
        InputError: not TOML, another format, an unknown or missing key, a value of another kind or outside its range.
    """
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"is not valid TOML: {error}; correct the line") from error
    found = data.pop("format", None)
    if found != FORMAT:
        raise InputError(f'format must be "{FORMAT}", got {found!r}; a robot file starts with format = "{FORMAT}"')
    return _from_table(Robot, data, "")


def _from_table(cls: type, table: Any, place: str) -> Any:
    """An instance of a dataclass from a table; the dataclass itself checks the values."""
    if not isinstance(table, dict):
        raise InputError(f"{place} must be a table [{place}], got {table!r}")
    known = {f.name: f for f in fields(cls)}
    for key in table:
        if key not in known:
            raise InputError(f"{_join(place, key)} is not a key of a robot file{_advice(key, list(known))}")
    for name, f in known.items():
        if name not in table and f.default is MISSING:
            raise InputError(f"{_join(place, name)} is missing; add it")
    hints = get_type_hints(cls)
    return cls(**{key: _from_value(hints[key], value, _join(place, key)) for key, value in table.items()})


def _from_value(hint: Any, value: Any, place: str) -> Any:
    import msgspec

    if any(is_dataclass(choice) for choice in get_args(hint)):
        return _from_choice(value, place)
    if is_dataclass(hint):
        return _from_table(hint, value, place)  # type: ignore[arg-type]
    try:
        return msgspec.convert(value, hint)
    except msgspec.ValidationError as error:
        raise InputError(f"{place}: {str(error)[:1].lower()}{str(error)[1:]}, got {value!r}; correct it") from error


def _from_choice(table: Any, place: str) -> Any:
    """The chassis that `kind` names."""
    if not isinstance(table, dict) or table.get("kind") not in CHASSIS:
        kind = table.get("kind") if isinstance(table, dict) else table
        raise InputError(f"{place}.kind must be one of {', '.join(CHASSIS)}; got {kind!r}")
    return _from_table(CHASSIS[table["kind"]], {k: v for k, v in table.items() if k != "kind"}, place)


def _join(place: str, key: str) -> str:
    return f"{place}.{key}" if place else key


def _advice(key: str, names: list[str]) -> str:
    near = difflib.get_close_matches(key, names, n=1)
    return f"; did you mean {near[0]}? Units are part of the names" if near else f"; there are: {', '.join(names)}"


def _short(value: Any) -> Any:
    """Numbers with as many digits as mean something, in tables and lists."""
    if isinstance(value, dict):
        return {key: _short(v) for key, v in value.items()}
    if isinstance(value, tuple):
        return [_short(v) for v in value]
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value
