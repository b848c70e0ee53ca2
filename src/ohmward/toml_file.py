"""TOML files that people read and edit: one frozen dataclass for each, no unknown key, and a fix in every error.

A file that is written again keeps the comments that people have written into it. A comment belongs to the key or table
below it, or to the one before it on the same line; one inside a list moves above its key. The comments of keys that are
gone, and those after the last key, move to the end.
"""

from __future__ import annotations

import codecs
import difflib
import re
import reprlib
import sys
import tomllib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, dataclass, field, fields, is_dataclass
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any, Generic, NamedTuple, TypeVar, get_args, get_origin, get_type_hints

from ohmward.atomic import write_text
from ohmward.checks import path_of, require_credible
from ohmward.errors import InputError
from ohmward.optional import require

T = TypeVar("T")
#: Significant digits of a number in a file.
FILE_DIGITS = 6
_NUMBERS_PER_LINE = 10
_PREFIX = "ohmward-"
_KEY_PARTS = 64
_KEY_PART = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')"""
#: A dotted key longer than in any real file: the parser's time and memory grow with the square of its parts.
_LONG_KEY = re.compile(rf"(?<![\w-])(?:{_KEY_PART}[ \t]*+\.[ \t]*+){{{_KEY_PARTS}}}")


@dataclass(frozen=True)
class TomlFile(Generic[T]):
    """One kind of file."""

    cls: type[T]  #: the dataclass that it holds, which may contain others and tuples of them, and checks its values
    format: str  #: name and version, such as "ohmward-battery/1"; the first key of every file
    header: str  #: comments at the head, lines that start with "#"
    digits: int = FILE_DIGITS  #: significant digits of the numbers written
    #: class -> value of its key `kind`, for fields that may hold one of several dataclasses
    kinds: Mapping[type, str] = field(default_factory=dict)
    #: sub-table -> keys that it shares with the head of the file and that are written only there
    once: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    #: keys that may name another file (.toml), such as "battery.file": its path is relative to the folder of the file
    #: that names it
    paths: tuple[str, ...] = ()
    made_by: str = ""  #: commands that make one, for the error where there is none

    @property
    def noun(self) -> str:
        """Kind of the file in a word, "battery" or "robot"."""
        return _noun(self.format)

    def save(self, value: T, path: str | PathLike[str]) -> None:
        """Write the file, complete or not at all; comments in the file that it replaces are kept.

        Raises:
            OhmwardError: the file cannot be written.
        """
        path, text = path_of(path), self.dump(value)
        if noun_of(path) == self.noun:
            text = with_comments(text, text_of(path))
        write_text(path, text)

    def load(self, path: str | PathLike[str]) -> T:
        """Read the value from a file.

        Raises:
            InputError: the file cannot be read or has an invalid value; names file, key, rule and fix.
        """
        parse = partial(self.parse, folder=path_of(path).parent)
        return parse_file(path, parse, f"{self.noun} file", self.made_by)

    def dump(self, value: T) -> str:
        """The text of the file; numbers are rounded to `digits`, fields that are None left out."""
        table = self._plain(value, self.cls)
        for name, keys in self.once.items():
            if table.get(name):
                table[name] = {key: item for key, item in table[name].items() if key not in keys}
        lines = _table_lines(table, "")
        return "\n".join([self.header, f'format = "{self.format}"', *lines]) + "\n"

    def parse(self, text: str, folder: str | PathLike[str] = "") -> T:
        """Parse the text of a file; folder: the one that `paths` are relative to, by default the current one.

        Raises:
            InputError: not TOML, another format, an unknown or missing key, a value of another kind or out of range.
        """
        data = parse_toml(text)
        self._require_format(data.pop("format", None))
        for key in self.paths:
            _start_path_from(Path(folder), data, key)
        value: T = self._from_table(self.cls, self._with_common_keys(data), "")
        return value

    def _with_common_keys(self, data: dict[str, Any]) -> dict[str, Any]:
        """The table with the keys of the head copied into the sub-tables that share them."""
        for name, keys in self.once.items():
            if not isinstance(data.get(name), dict):
                continue
            if twice := [key for key in keys if key in data[name]]:
                raise InputError(
                    f"{name}.{twice[0]} stands at the head of the file as {twice[0]}, and only there; remove the one "
                    f"in [{name}]"
                )
            data = data | {name: data[name] | {key: data[key] for key in keys if key in data}}
        return data

    def _require_format(self, found: Any) -> None:
        if found is None:
            raise InputError(f'the key format is missing; a {self.noun} file starts with format = "{self.format}"')
        other = _noun(str(found))
        if other != self.noun and str(found).startswith(_PREFIX):
            raise InputError(f"this is a {other} file; give a {self.noun} file, whose format is {self.format!r}")
        if found != self.format:
            raise InputError(f"format must be {self.format!r}, got {found!r}; update ohmward or make the file again")

    def _from_table(self, cls: type, table: Any, place: str) -> Any:
        if not isinstance(table, dict):
            raise InputError(f"{place} must be a table [{place}], got {table!r}")
        known = {f.name: f for f in fields(cls)}
        for key in table:
            if key not in known:
                head: type = self.cls
                of_head = [f.name for f in fields(head)] if place else []
                raise InputError(
                    f"{_join(place, key)} is not a key of a {self.noun} file{_advice(key, list(known), of_head)}"
                )
        for name, f in known.items():
            if name not in table and f.default is MISSING and f.default_factory is MISSING:
                raise InputError(f"{_join(place, name)} is missing; add it")
        hints = get_type_hints(cls)
        values = {key: self._from_value(hints[key], value, _join(place, key)) for key, value in table.items()}
        try:
            return cls(**values)
        except InputError as error:
            raise InputError(f"{place}: {error}" if place.endswith("]") else str(error)) from error

    def _from_value(self, hint: Any, value: Any, place: str) -> Any:
        if get_origin(hint) is tuple and _classes(get_args(hint)[0]):
            if not isinstance(value, list):
                raise InputError(f"{place} must be a list of tables [[{place}]], got {value!r}")
            return tuple(self._from_value(get_args(hint)[0], row, f"{place}[{i}]") for i, row in enumerate(value))
        if get_origin(hint) is dict and _classes(get_args(hint)[1]) and isinstance(value, dict):
            return {key: self._from_entry(get_args(hint)[1], v, f"{place}[{key}]") for key, v in value.items()}
        classes = _classes(hint)
        if len(classes) > 1 or (isinstance(value, dict) and "kind" in value and self.kinds.keys() & set(classes)):
            return self._from_choice(classes, value, place)
        return self._from_table(classes[0], value, place) if classes else _converted(hint, value, place)

    def _from_entry(self, hint: Any, value: Any, place: str) -> Any:
        """An entry that is a table or a plain value, such as a signal with or without its scale."""
        return (
            self._from_table(_classes(hint)[0], value, place)
            if isinstance(value, dict)
            else _converted(hint, value, place)
        )

    def _from_choice(self, classes: list[type], table: Any, place: str) -> Any:
        """An instance of the class that `kind` names."""
        kinds = {kind: cls for cls, kind in self.kinds.items() if cls in classes}
        kind = table.get("kind") if isinstance(table, dict) else table
        if not isinstance(kind, str) or kind not in kinds or kind is table:
            raise InputError(f"{place}.kind must be one of {', '.join(kinds)}; got {kind!r}")
        return self._from_table(kinds[kind], {k: v for k, v in table.items() if k != "kind"}, place)

    def _plain(self, value: Any, hint: Any) -> Any:
        """Dataclasses as tables, numbers rounded to `digits`, everything else unchanged."""
        if is_dataclass(value):
            hints = get_type_hints(type(value))
            kind = self.kinds.get(type(value)) if len(_classes(hint)) > 1 else None
            return {"kind": kind} | {f.name: self._plain(getattr(value, f.name), hints[f.name]) for f in fields(value)}
        if isinstance(value, tuple):
            return [self._plain(v, (*get_args(hint), None)[0]) for v in value]
        return float(f"{value:.{self.digits}g}") if isinstance(value, float) else value


def parse_toml(text: str) -> dict[str, Any]:
    """Parse TOML text into a table.

    Raises:
        InputError: not TOML, or nested deeper or longer than any file of ohmward; names the line where it can.
    """
    if found := _LONG_KEY.search(text):
        line = text.count("\n", 0, found.start()) + 1
        raise InputError(f"is not valid TOML: a key of more than {_KEY_PARTS} parts in line {line}; correct the line")
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"is not valid TOML: {error}; correct the line") from error
    except ValueError as error:
        digits = sys.get_int_max_str_digits()
        raise InputError(f"is not valid TOML: an integer of more than {digits} digits; correct it") from error
    except RecursionError:
        raise InputError("is not valid TOML: arrays or tables nested too deep; correct the line") from None


def _classes(hint: Any) -> list[Any]:
    """The dataclasses in a type or a choice of types."""
    return [h for h in (hint, *get_args(hint)) if is_dataclass(h)]


def _converted(hint: Any, value: Any, place: str) -> Any:
    """Convert a value to the type of its field; errors are msgspec's with the place first, "tau_s[0]: expected ..."."""
    msgspec = require("msgspec", "reading TOML")

    require_credible(place, value)
    try:
        return msgspec.convert(value, hint)
    except msgspec.ValidationError as error:
        what, _, where = str(error).partition(" - at `$")
        reason = f"{what[:1].lower()}{what[1:]}, got {reprlib.repr(value)}"
        raise InputError(f"{place}{where.rstrip('`')}: {reason}; correct it") from error


def _start_path_from(folder: Path, data: dict[str, Any], key: str) -> None:
    """Make the path under "table.key" absolute; anything but the path of a .toml file is left unchanged."""
    *tables, name = key.split(".")
    table: Any = data
    for part in tables:
        table = table.get(part, {}) if isinstance(table, dict) else {}
    if isinstance(table, dict) and isinstance(value := table.get(name), str) and value.endswith(".toml"):
        table[name] = str((folder / value).absolute())


def _join(place: str, key: str) -> str:
    return f"{place}.{key}" if place else key


def _advice(key: str, names: list[str], of_head: list[str]) -> str:
    """What to do about an unknown key: names of its table, and those at the head of the file."""
    if key in of_head:
        return f"; {key} stands at the head of the file, above the first table"
    stem = key.rsplit("_", 1)[0]
    of_stem = [n for n in names if n.rsplit("_", 1)[0] == stem]
    near = difflib.get_close_matches(key, of_stem or names, n=1, cutoff=0.0 if of_stem else 0.6)
    return f"; did you mean {near[0]}? Units are part of the names" if near else f"; there are: {', '.join(names)}"


def _table_lines(table: Mapping[str, Any], name: str) -> Iterator[str]:
    """Lines of one table: its values, then its sub-tables under their headers."""
    inner = {key: value for key, value in table.items() if isinstance(value, dict) or _are_tables(value)}
    for key, value in table.items():
        if key not in inner and value is not None:
            yield f"{key} = {_literal(value)}"
    for key, value in inner.items():
        place = _join(name, key)
        for row in [value] if isinstance(value, dict) else value:
            yield from ("", f"[{place}]" if isinstance(value, dict) else f"[[{place}]]", *_table_lines(row, place))


def _are_tables(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(v, dict) for v in value)


def _literal(value: Any) -> str:
    """TOML text of a value; a list has ten numbers a line, or one other item a line."""
    if type(value) in (int, float):
        return str(value)
    if not isinstance(value, list):
        return require("tomli_w", "writing TOML").dumps({"v": value})[4:].strip()
    items = [_literal(v) for v in value]
    numbers = all(isinstance(v, float | int) for v in value)
    if numbers and len(items) <= _NUMBERS_PER_LINE:
        return f"[{', '.join(items)}]"
    per_line = _NUMBERS_PER_LINE if numbers else 1
    lines = [", ".join(items[i : i + per_line]) for i in range(0, len(items), per_line)]
    return "[\n" + "".join(f"    {line},\n" for line in lines) + "]"


def parse_file(path: str | PathLike[str], parse: Callable[[str], T], what: str, made_by: str = "") -> T:
    """Result of `parse` on the text of a file; what: the kind of file that it should be; made_by: see `TomlFile`.

    Raises:
        InputError: the file cannot be read, or `parse` rejects its text; names the file.
    """
    try:
        return parse(text_of(path))
    except OSError as error:
        make = f", or make one with {made_by}" if made_by and isinstance(error, FileNotFoundError) else ""
        raise InputError(f"{path}: cannot be read ({error.strerror or error}); check the path{make}") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is not text in UTF-8; is it a {what}? Save it as UTF-8") from error
    except InputError as error:
        other = isinstance(error.__cause__, tomllib.TOMLDecodeError) and Path(path).suffix.lower() != ".toml"
        raise InputError(f"{path}: is no TOML; is it a {what}?" if other else f"{path}: {error}") from error


def text_of(path: str | PathLike[str]) -> str:
    """Text of a file in UTF-8, or in UTF-16 with a byte order mark, as some Windows editors and shells write it.

    Raises:
        OSError: it cannot be read.
        UnicodeDecodeError: it is neither.
    """
    data = Path(path).read_bytes()
    encoding = "utf-16" if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) else "utf-8-sig"
    return data.decode(encoding).replace("\r\n", "\n")


def noun_of(path: str | PathLike[str]) -> str | None:
    """Kind of a file by its key `format`, "battery" or "robot"; None for one that cannot be read or has no such key."""
    try:
        return _noun(str(parse_toml(text_of(path))["format"]))
    except (InputError, OSError, ValueError, KeyError):
        return None


def _noun(format_: str) -> str:
    """Kind of a file format: battery for ohmward-battery/1."""
    return format_.removeprefix(_PREFIX).partition("/")[0]


_TABLE = re.compile(r"\[+\s*([^\[\]]+?)\s*\]+")
_KEY = re.compile(r"""([\w-]+|"[^"]*"|'[^']*')\s*=""")
#: Code in front of a comment; strings may have a `#` in them.
_CODE = re.compile(r"""(?:[^"'#]|"(?:[^"\\]|\\.)*"|'[^']*')*""")
_STRINGS = re.compile(r""""(?:[^"\\]|\\.)*"|'[^']*'""")
_END = ""


class _Comments(NamedTuple):
    """Comments of one key or table."""

    above: list[str]
    behind: str


def with_comments(text: str, old: str) -> str:
    """The text of a file with the comments that people have written into the old one; common ones appear once."""
    own = {line.strip() for line in text.splitlines() if line.startswith("#")}
    found = _comments(old, own)
    lines = []
    for name, line in _named_lines(text):
        comments = found.pop(name, _Comments([], "")) if name else _Comments([], "")
        lines += [*comments.above, f"{line}  {comments.behind}" if comments.behind else line]
    left = [each for comments in found.values() for each in (*comments.above, comments.behind) if each]
    return "\n".join([*lines, *([""] if left else []), *left]) + "\n"


def _comments(text: str, known: set[str]) -> dict[str, _Comments]:
    """Comments by the name of their key or table, without the known ones."""
    found: dict[str, _Comments] = {}
    above: list[str] = []
    last = _END
    for name, line in _named_lines(text):
        comment = line[_CODE.match(line).end() :].strip()  # type: ignore[union-attr]
        if name:
            found[name] = _Comments(above, comment)
            above, last = [], name
        elif comment and comment not in known:
            if line.lstrip().startswith("#") and not line.startswith(" "):
                above = [*above, comment]
            else:
                found.setdefault(last, _Comments([], "")).above.append(comment)
    found[_END] = _Comments(above, "")
    return {name: comments for name, comments in found.items() if comments.above or comments.behind}


def _named_lines(text: str) -> Iterator[tuple[str, str]]:
    """Each line with the name of the key or table that it begins, "" for all others."""
    table, depth = "", 0
    seen: dict[str, int] = {}
    for line in text.splitlines():
        code = _CODE.match(line)[0]  # type: ignore[index]
        name = ""
        if depth == 0 and (head := _TABLE.match(code)):
            table = head[1]
            if code.startswith("[["):
                seen[table] = seen.get(table, 0) + 1
                table = f"{table}#{seen[table]}"
            name = f"[{table}]"
        elif depth == 0 and (key := _KEY.match(code)):
            name = f"{table}.{key[1]}"
            depth = _opened(code[key.end() :])
        elif depth:
            depth += _opened(code)
        yield name, line


def _opened(code: str) -> int:
    """Brackets that a line opens and does not close."""
    bare = _STRINGS.sub("", code)
    return bare.count("[") + bare.count("{") - bare.count("]") - bare.count("}")
