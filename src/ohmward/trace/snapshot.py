"""An estimator's state as a dict of plain numbers, for JSON, and back: a restart goes on to the bit."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict
from hashlib import sha256
from typing import Any

import numpy as np

from ohmward.errors import InputError
from ohmward.trace.structure import Structure, flatten, leaves, scalar_names, shaped, structure_of

#: Of the layout of the dict; raised when old snapshots can no longer be read.
VERSION = 1

_ADVICE = "start a new estimator from the first sample instead"


def take(estimator: Any, state: Any, time_s: float) -> dict[str, Any]:
    """The state after the sample at `time_s`, as a dict that `json.dumps` writes; a number that is none is None.

    Raises:
        InputError: `state` is None, there is none before the first sample.
    """
    if state is None:
        raise InputError("there is nothing to take a snapshot of before the first sample; call update or run first")
    structure = structure_of(state, "state")
    values = [x for leaf in flatten(structure, state) for x in np.asarray(leaf, dtype=float).ravel().tolist()]
    return {
        "version": VERSION,
        "estimator": identity(estimator),
        "time_s": _to_json(time_s),
        "state": dict(zip(scalar_names(structure), map(_to_json, values), strict=True)),
    }


def resume(estimator: Any, example: Any, snapshot: Mapping[str, Any]) -> tuple[Any, float]:
    """State and time [s] of a snapshot that this estimator took; example: any state of it.

    Raises:
        InputError: the snapshot is of another version, of another estimator or of one with other settings, or damaged.
    """
    found = {key: snapshot.get(key) for key in ("version", "estimator", "time_s", "state")}
    if found["version"] != VERSION:
        raise InputError(f"snapshot version must be {VERSION}, got {found['version']!r}; {_ADVICE}")
    if found["estimator"] != identity(estimator):
        raise InputError(
            f"the snapshot is of {found['estimator']!r}, but the estimator is {identity(estimator)!r}: another kind, "
            f"model or settings; {_ADVICE}"
        )
    structure = structure_of(example, "state")
    return shaped(structure, _values(structure, found["state"])), _from_json("time_s", found["time_s"])


def identity(estimator: Any) -> str:
    """Kind and settings of an estimator (a dataclass) as a short text: its name and a digest of every field."""
    settings = json.dumps(asdict(estimator), sort_keys=True, default=lambda a: np.asarray(a).tolist())
    return f"{type(estimator).__name__}-{sha256(settings.encode()).hexdigest()[:16]}"


def _values(structure: Structure, state: Any) -> list[float]:
    """The scalars of a state, in the structure's order."""
    names = scalar_names(structure)
    if not isinstance(state, Mapping) or list(state) != names:
        raise InputError(f"snapshot state must hold {', '.join(names)}, in this order; {_ADVICE}")
    if any(leaf.boolean for _, leaf in leaves(structure)):
        raise InputError("a state of conditions cannot be resumed; store them as 0.0 and 1.0")
    return [_from_json(name, state[name]) for name in names]


def _to_json(value: float) -> float | None:
    """JSON has no NaN."""
    return None if math.isnan(value) else float(value)


def _from_json(name: str, value: Any) -> float:
    if value is None:
        return math.nan
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"snapshot {name} must be a number, got {value!r}; {_ADVICE}")
    return float(value)
