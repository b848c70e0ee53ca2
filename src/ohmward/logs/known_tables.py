"""Tables that are known by their columns alone: those without a header, those whose units are not in their names."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

#: Fields of sensor_msgs/BatteryState up to the cells, as `ros2 topic echo --csv` writes them in a row without names.
_BATTERY_STATE = (
    "header.stamp.sec", "header.stamp.nanosec", "header.frame_id", "voltage [V]", "temperature [degC]", "current [A]",
    "charge", "capacity", "design_capacity", "percentage", "power_supply_status", "power_supply_health",
    "power_supply_technology", "present",
)  # fmt: skip
_PRESENT = _BATTERY_STATE.index("present")


class KnownTable(NamedTuple):
    """A table that its columns give away."""

    columns: frozenset[str]  #: all of which it has.  time: the column of its time.  units: quantity -> unit.
    time: str
    units: Mapping[str, str]
    positive_current: str | None = None  #: "charge" or "discharge"


_KNOWN = (
    # battery_status of PX4, as `ulog2csv` writes it: time since it was switched on
    KnownTable(
        frozenset(("timestamp", "voltage_v", "current_a", "discharged_mah")), "timestamp", {"time": "us"}, "discharge"
    ),
)


def known_table(names: Collection[str]) -> KnownTable | None:
    """The known table that has these columns, or None."""
    return next((table for table in _KNOWN if table.columns <= set(names)), None)


def names_without_header(row: Sequence[str]) -> list[str] | None:
    """Names of the columns of a row as `ros2 topic echo --csv` writes a BatteryState; None for any other."""
    cells = [cell.strip() for cell in row]
    if len(cells) <= _PRESENT or cells[_PRESENT] not in ("True", "False"):
        return None
    whole = [cells[k] for k in (0, 1, 10, 11, 12)]
    if not all(re.fullmatch(r"\d+", cell) for cell in whole):
        return None
    rest = len(cells) - len(_BATTERY_STATE)
    return [*_BATTERY_STATE, *(f"field_{k}" for k in range(rest))]
