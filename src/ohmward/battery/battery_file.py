"""The battery file: everything that an estimator needs to know about one battery, as TOML that people read and edit."""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, asdict, fields, is_dataclass
from os import PathLike
from pathlib import Path
from types import UnionType
from typing import Any, get_args, get_origin, get_type_hints

from ohmward.battery.battery import Battery
from ohmward.errors import InputError

FORMAT = "ohmward-battery/1"
DIGITS = 6
_NUMBERS_PER_LINE = 10
_HEADER = """\
# A battery as ohmward knows it. Edit what you know better; every key carries its unit.
# Currents > 0 charge. SoC runs from 0 (empty) to 1 (full). Voltages and resistances are those of the whole pack.
# A list along SoC stands on a uniform grid from SoC 0 to SoC 1, ends included. *_std are standard deviations.
"""


def save_battery(battery: Battery, path: str | PathLike[str]) -> None:
    """Write the battery file; numbers are rounded to 6 digits. The file is either whole or not there.

    Raises:
        OhmwardError: the file cannot be written.
    """
    from ohmward.atomic import replacing

    with replacing(Path(path)) as temporary:
        temporary.write_text(dump_battery(battery), encoding="utf-8")


def load_battery(path: str | PathLike[str]) -> Battery:
    """The battery in a file.

    Raises:
        InputError: the file cannot be read or says something that a battery cannot be; names file, key, rule and fix.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}); check the path") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is not text in UTF-8; is it a battery file?") from error
    try:
        return parse_battery(text)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def dump_battery(battery: Battery) -> str:
    """The text of the battery file."""
    return "\n".join([_HEADER, f'format = "{FORMAT}"', *_table_lines(asdict(battery), "")]) + "\n"


def parse_battery(text: str) -> Battery:
    """The battery in the text of a battery file.

    Raises:
        InputError: not TOML, another format, an unknown or missing key, a value of another kind or outside its range.
    """
    import msgspec

    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"is not valid TOML: {error}; correct the line") from error
    _require_format(data.pop("format", None))
    _require_known(data, Battery, "")
    try:
        return msgspec.convert(data, Battery)
    except msgspec.ValidationError as error:
        raise InputError(f"{_located(str(error))}; correct it by hand or identify the battery again") from error


def _require_format(found: Any) -> None:
    if found is None:
        raise InputError(f'the key format is missing; a battery file starts with format = "{FORMAT}"')
    if found != FORMAT:
        raise InputError(f"format must be {FORMAT!r}, got {found!r}; update ohmward or identify the battery again")


def _require_known(data: Mapping[str, Any], cls: type, table: str) -> None:
    """Every key is a field of the class, in this table and those below; every field without a default is there."""
    hints = get_type_hints(cls)
    for key, value in data.items():
        place = f"{table}.{key}" if table else key
        if key not in hints:
            raise InputError(f"{place} is not a key of a battery file{_advice(key, list(hints))}")
        inner = _dataclass_in(hints[key])
        tables = value if isinstance(value, list) else [value]
        for i, row in enumerate(tables if inner else []):
            if isinstance(row, dict):
                _require_known(row, inner, f"{place}[{i}]" if isinstance(value, list) else place)
    for f in fields(cls):
        if f.name not in data and f.default is MISSING and f.default_factory is MISSING:
            raise InputError(f"{f'{table}.' if table else ''}{f.name} is missing; add it")


def _dataclass_in(hint: Any) -> Any:
    """The dataclass in a type, a tuple of it or a choice with None; None if there is none."""
    if is_dataclass(hint):
        return hint
    inner = get_args(hint) if get_origin(hint) in (tuple, UnionType) else ()
    return next((found for h in inner if (found := _dataclass_in(h))), None)


def _advice(key: str, names: list[str]) -> str:
    stem = key.rsplit("_", 1)[0]
    near = [n for n in names if n.rsplit("_", 1)[0] == stem] or difflib.get_close_matches(key, names, n=1)
    return f"; did you mean {near[0]}? Units are part of the names" if near else f"; there are: {', '.join(names)}"


def _located(message: str) -> str:
    """Msgspec's message with the place first: "`$.thevenin.tau_s[0]`" becomes "thevenin.tau_s[0]"."""
    what, _, where = message.partition(" - at `$.")
    return f"{where.rstrip('`')}: {what[:1].lower()}{what[1:]}" if where else message


def _table_lines(table: Mapping[str, Any], name: str) -> Iterator[str]:
    """Lines of one table: its values, then its sub-tables under their headers."""
    import tomli_w

    for key, value in table.items():
        if not isinstance(value, dict) and value is not None and not _are_tables(value):
            yield (
                f"{key} = {_array(value)}" if isinstance(value, tuple) else tomli_w.dumps({key: _short(value)}).strip()
            )
    for key, value in table.items():
        inner = f"{name}.{key}" if name else key
        if isinstance(value, dict):
            yield from ("", f"[{inner}]", *_table_lines(value, inner))
        elif _are_tables(value):
            for row in value:
                yield from ("", f"[[{inner}]]", *_table_lines(row, inner))


def _are_tables(value: Any) -> bool:
    return isinstance(value, tuple) and bool(value) and all(isinstance(v, dict) for v in value)


def _array(values: tuple) -> str:
    """A list, ten numbers a line, anything else one a line."""
    import tomli_w

    items = [_array(v) if isinstance(v, tuple) else tomli_w.dumps({"v": _short(v)})[4:].strip() for v in values]
    if not items or (isinstance(values[0], float | int) and len(items) <= _NUMBERS_PER_LINE):
        return f"[{', '.join(items)}]"
    per_line = _NUMBERS_PER_LINE if isinstance(values[0], float | int) else 1
    lines = [", ".join(items[i : i + per_line]) for i in range(0, len(items), per_line)]
    return "[\n" + "".join(f"    {line},\n" for line in lines) + "]"


def _short(value: Any) -> Any:
    """A number with as many digits as mean something; all else as it is."""
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value
