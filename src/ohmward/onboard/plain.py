"""States of the robot as plain dicts, for JSON and tables: numbers, lists and text, None for what is not known."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ohmward.filters.flags import SampleFlag
from ohmward.onboard.robot_state import Level, RobotState


def plain_state(state: RobotState) -> dict[str, Any]:
    """The state as a dict for JSON, parts that are not estimated left out."""
    return {name: plain(value) for name, value in zip(state._fields, state, strict=True) if value is not None}


def plain(value: Any) -> Any:
    """A value as JSON knows it: null for a number that is not finite, flags and levels by name, records as dicts."""
    if isinstance(value, SampleFlag):
        return [flag.name for flag in value]
    if isinstance(value, Level):
        return value.name
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if hasattr(value, "_asdict"):
        return {name: plain(item) for name, item in value._asdict().items()}
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return value
