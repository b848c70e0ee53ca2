"""Values of any kind in the types of JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, is_dataclass
from enum import IntEnum, IntFlag
from pathlib import Path
from typing import Any


def plain(value: Any) -> Any:
    """A value in JSON types.

    Numbers that are not finite become null, records objects, tuples and arrays lists, paths text, members of a numeric
    enumeration their name, and flags the list of their names.
    """
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, IntFlag):
        return [flag.name for flag in value]
    if isinstance(value, IntEnum):
        return value.name
    if isinstance(value, Path):
        return str(value)
    if hasattr(value, "tolist"):  # an array, or a number of NumPy
        return plain(value.tolist())
    if is_dataclass(value) and not isinstance(value, type):
        value = asdict(value)
    if hasattr(value, "_asdict"):
        value = value._asdict()
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return value
