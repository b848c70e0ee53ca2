"""An estimator's state as a dict of plain numbers, for JSON, and back: a resumed estimator continues bit for bit."""

from __future__ import annotations

import json
import math
import reprlib
from collections.abc import Mapping
from dataclasses import asdict
from functools import lru_cache
from hashlib import sha256
from itertools import zip_longest
from typing import Any

import numpy as np

from ohmward.errors import InputError
from ohmward.optional import require
from ohmward.toml_file import FILE_DIGITS
from ohmward.trace.structure import Structure, flatten, leaves, scalar_names, shaped, structure_of

#: Version of the dict's layout, raised when old snapshots can no longer be read. Version 1 had no checksum.
VERSION = 2

#: Largest number in a snapshot, times in seconds included; a step from larger ones overflows.
LARGEST = 1e12

_ADVICE = "start a new estimator from the first sample instead"


def take(estimator: Any, state: Any, time_s: float, **more: Any) -> dict[str, Any]:
    """Snapshot of the state after the sample at `time_s`, as a dict that `json.dumps` writes; NaN becomes None.

    more: further content, ready for JSON, that `resume` does not read.

    Raises:
        InputError: `state` is None, as before the first sample.
    """
    if state is None:
        raise InputError("there is nothing to take a snapshot of before the first sample; call update or run first")
    structure = structure_of(state, "state")
    values = [x for leaf in flatten(structure, state) for x in np.asarray(leaf, dtype=float).ravel().tolist()]
    return sealed(
        {
            "estimator": identity(estimator),
            "time_s": to_json(time_s),
            "state": dict(zip(scalar_names(structure), map(to_json, values), strict=True)),
            **more,
        }
    )


def resume(estimator: Any, example: Any, snapshot: Mapping[str, Any]) -> tuple[Any, float]:
    """State and time [s] of a snapshot that this estimator took; example: any state of it.

    Raises:
        InputError: the snapshot is of another version, of another estimator or of one with other settings, or damaged.
    """
    require_version(snapshot)
    require_identity(estimator, snapshot)
    structure = structure_of(example, "state")
    values = _values(structure, snapshot.get("state"))
    time_s = from_json("time_s", snapshot.get("time_s"))
    require_seal(snapshot)
    return shaped(structure, values), time_s


def sealed(content: Mapping[str, Any]) -> dict[str, Any]:
    """The content of a snapshot with its version and its checksum."""
    return {"version": VERSION, **content, "checksum": _checksum({"version": VERSION, **content})}


def require_version(snapshot: Any) -> None:
    """Raise InputError for anything other than a snapshot of this version."""
    if not isinstance(snapshot, Mapping):
        raise InputError(f"a snapshot must be the dict that snapshot() returned, got {type(snapshot).__name__}")
    if snapshot.get("version") != VERSION:
        raise InputError(f"snapshot version must be {VERSION}, got {snapshot.get('version')!r}; {_ADVICE}")


def require_identity(estimator: Any, snapshot: Mapping[str, Any]) -> None:
    """Raise InputError for a snapshot of another estimator or other settings."""
    here, there = identity(estimator), snapshot.get("estimator")
    if there != here:
        raise InputError(
            f"the snapshot is of {there!r}, but the estimator is {here!r}: another kind, model or settings. Files "
            f"round their numbers: load battery and robot from them before the first start, too. Now {_ADVICE}"
        )


def require_seal(snapshot: Mapping[str, Any]) -> None:
    """Raise InputError if the checksum does not match the content."""
    content = {name: value for name, value in snapshot.items() if name != "checksum"}
    if snapshot.get("checksum") != _checksum(content):
        raise InputError(f"the snapshot is damaged: its checksum does not fit its content; {_ADVICE}")


def identity(estimator: Any) -> str:
    """Kind and settings of an estimator (a dataclass) as a short text: its name and a digest of every field.

    The latest results are cached: a process on a robot takes snapshots between two samples.
    """
    try:
        return _cached_identity(estimator)
    except TypeError:  # settings that hold a list or an array have no hash
        return _identity(estimator)


def _identity(estimator: Any) -> str:
    settings = json.dumps(_as_in_files(asdict(estimator)), sort_keys=True, default=lambda a: np.asarray(a).tolist())
    return f"{type(estimator).__name__}-{sha256(settings.encode()).hexdigest()[:16]}"


def _as_in_files(value: Any) -> Any:
    """Settings with the digits that numbers have in a file, so that a saved battery is the same as before."""
    if isinstance(value, dict):
        return {key: _as_in_files(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_as_in_files(item) for item in value]
    return float(f"{value:.{FILE_DIGITS}g}") if isinstance(value, float) else value


_cached_identity = lru_cache(maxsize=32)(_identity)


def to_json(value: float) -> float | None:
    """A number for JSON, which has no NaN."""
    return None if math.isnan(value) else float(value)


def from_json(name: str, value: Any) -> float:
    """A number from JSON.

    Raises:
        InputError: it is not a number, or larger than `LARGEST`.
    """
    if value is None:
        return math.nan
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"snapshot {name} must be a number, got {value!r}; {_ADVICE}")
    if not abs(value) <= LARGEST:
        raise InputError(f"snapshot {name} must be within {LARGEST:g}, got {reprlib.repr(value)}; {_ADVICE}")
    return float(value)


def typed(hint: Any, name: str, value: Any, strict: bool = True) -> Any:
    """A part of a snapshot converted to a type, such as `tuple[float, str]`.

    strict: False converts the texts of numbers, too.

    Raises:
        InputError: it does not fit the type.
    """
    msgspec = require("msgspec", "reading snapshots")
    try:
        return msgspec.convert(value, hint, strict=strict)
    except msgspec.ValidationError as error:
        raise InputError(f"snapshot {name} cannot be read ({error}); {_ADVICE}") from error


def _checksum(content: Mapping[str, Any]) -> str:
    return sha256(json.dumps(content, sort_keys=True, default=str).encode()).hexdigest()[:16]


def _values(structure: Structure, state: Any) -> list[float]:
    """The scalars of a state, in the structure's order."""
    names = scalar_names(structure)
    if not isinstance(state, Mapping) or list(state) != names:
        held = list(state) if isinstance(state, Mapping) else []
        pairs = zip_longest(names, held, fillvalue="nothing")
        k, (expected, found) = next((k, pair) for k, pair in enumerate(pairs) if pair[0] != pair[1])
        raise InputError(
            f"snapshot state is of another version: number {k + 1} of {len(names)} must be {expected}, "
            f"it has {reprlib.repr(found)}; {_ADVICE}"
        )
    if any(leaf.boolean for _, leaf in leaves(structure)):
        raise InputError("a state of conditions cannot be resumed; store them as 0.0 and 1.0")
    return [from_json(name, state[name]) for name in names]
