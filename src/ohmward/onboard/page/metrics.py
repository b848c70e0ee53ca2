"""Metrics for Prometheus, in its text format 0.0.4."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from ohmward.onboard.robot_state import Level

#: Name, help, and where in the view of a state the value is.
_GAUGES = (
    ("ohmward_soc_ratio", "State of charge, 0 to 1.", ("charge", "soc")),
    ("ohmward_soc_low_ratio", "Lower end of the 95 % band of the state of charge.", ("charge", "low")),
    ("ohmward_soc_high_ratio", "Upper end of the 95 % band of the state of charge.", ("charge", "high")),
    ("ohmward_soh_capacity_ratio", "Capacity over that of the battery file.", ("charge", "soh_capacity")),
    ("ohmward_resistance_ratio", "Resistance over that of the battery file.", ("charge", "resistance_ratio")),
    ("ohmward_battery_power_watts", "Power that the battery gives.", ("power", "battery_W")),
    ("ohmward_range_metres", "Range left, median.", ("range", "distance_m", "p50")),
    ("ohmward_range_p10_metres", "Range left that is reached with 90 %.", ("range", "distance_m", "p10")),
    ("ohmward_time_left_seconds", "Time left, median.", ("range", "duration_s", "p50")),
    ("ohmward_speed_metres_per_second", "Speed of the body, forward.", ("drive", "speed_m_s")),
    ("ohmward_speed_band_metres_per_second", "Half of the 95 % band of the speed.", ("drive", "band_m_s")),
    ("ohmward_distance_metres", "Length of the path since the start.", ("pose", "distance_m")),
)

#: The same of the age of the samples behind the estimates, with the key of their time.
_AGES = (
    ("ohmward_battery_sample_age_seconds", "Age of the last sample of the battery.", "battery_time_s"),
    ("ohmward_drive_sample_age_seconds", "Age of the last sample of the drive.", "drive_time_s"),
)


def metrics(view: dict[str, Any]) -> str:
    """The view of a state as metrics; what is not known is left out."""
    return "\n".join(_lines(view)) + "\n"


def _lines(view: dict[str, Any]) -> Iterator[str]:
    robot = _label(view["name"])
    for name, text, path in _GAUGES:
        value = _at(view, path)
        if isinstance(value, float | int) and math.isfinite(value):
            yield from _head(name, text)
            yield f'{name}{{robot="{robot}"}} {value:.9g}'
    for name, text, key in _AGES:
        if (measured_s := view.get(key)) is not None:
            yield from _head(name, text)
            yield f'{name}{{robot="{robot}"}} {max(view["time_s"] - measured_s, 0.0):.9g}'
    wheels = (view.get("drive") or {}).get("wheels", [])
    if slips := [(wheel["name"], wheel["slip_ratio"]) for wheel in wheels if wheel["slip_ratio"] is not None]:
        yield from _head("ohmward_slip_ratio", "Slip of a driven wheel, -1 to 1.")
        for wheel, slip in slips:
            yield f'ohmward_slip_ratio{{robot="{robot}",wheel="{_label(wheel)}"}} {slip:.9g}'
    if sensors := view.get("sensors", []):
        yield from _head("ohmward_condition", "Condition: 0 well, 1 warning, 2 error, 3 silent.")
        for sensor in sensors:
            level = Level[sensor["level"]].value
            yield f'ohmward_condition{{robot="{robot}",name="{_label(sensor["name"])}"}} {level}'


def _head(name: str, text: str) -> Iterator[str]:
    yield f"# HELP {name} {text}"
    yield f"# TYPE {name} gauge"


def _at(view: Any, path: tuple[str, ...]) -> Any:
    for key in path:
        view = view.get(key) if isinstance(view, dict) else None
    return view


def _label(text: str) -> str:
    """A text as the value of a label."""
    return text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
