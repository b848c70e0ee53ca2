"""Numbers of a robot's state by their path, for sinks that send single ones.

"battery.soc", "slip.slip_ratio.0"; "sample.battery_current_A" is a measured value; "age_s.battery" is the time since
the sample behind the estimates of the battery, and so are those of drive and cells.
"""

from __future__ import annotations

import math
from typing import Any

from ohmward.battery.cells.pack_estimator import PackEstimate
from ohmward.battery.soc.sample import SocEstimate
from ohmward.checks import require_one_of
from ohmward.energy.range_step import RangeEstimate
from ohmward.errors import InputError
from ohmward.onboard.message import as_number
from ohmward.onboard.robot_state import RobotState
from ohmward.onboard.totals import Totals
from ohmward.quantities import quantity_of
from ohmward.traction.odometry.sample import OdometryEstimate
from ohmward.traction.speed_observer.estimate import SlipEstimate

#: Parts of a state that hold numbers by name.
PARTS: dict[str, type] = {
    "battery": SocEstimate,
    "cells": PackEstimate,
    "slip": SlipEstimate,
    "pose": OdometryEstimate,
    "range": RangeEstimate,
    "totals": Totals,
}

#: Estimates whose evidence has an age.
AGES = ("battery", "drive", "cells")


def require_path(path: str) -> None:
    """Raise InputError unless states can have such a number; the message lists the names that there are."""
    part, _, rest = path.partition(".")
    if part == "sample":
        quantity_of(rest)
        return
    if part == "age_s":
        require_one_of(f"{path!r}: the second word", rest, AGES)
        return
    require_one_of(f"{path!r}: the first word", part, [*PARTS, "sample", "age_s"])
    names: tuple[str, ...] = getattr(PARTS[part], "_fields", ())
    name = rest.partition(".")[0]
    if name not in names:
        raise InputError(f"{path!r}: {part} has no {name!r}; it has {', '.join(names)}")


def number_at(state: RobotState, path: str) -> float:
    """The number at a path of the state; nan where it is not known or no number."""
    part, _, rest = path.partition(".")
    if part == "age_s":
        return max(state.time_s - float(getattr(state, f"{rest}_time_s")), 0.0)
    value: Any = getattr(state, part)
    if part == "sample":
        return as_number(value.get(rest, math.nan))
    for word in rest.split("."):
        value = _item(value, word)
    try:
        return float(value)
    except (TypeError, ValueError):
        return math.nan


def _item(value: Any, word: str) -> Any:
    """Element of a record by its name or of an array by its number; None where there is none."""
    if word.isdecimal() and hasattr(value, "__len__"):
        return value[int(word)] if int(word) < len(value) else None
    return getattr(value, word, None) if word in getattr(value, "_fields", ()) else None
