"""Numbers of a robot for other systems: metrics for Prometheus, in its text format 0.0.4, and Home Assistant."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from ohmward import __version__
from ohmward.onboard.page.view import total_words
from ohmward.onboard.robot_state import Level, Totals


class Gauge(NamedTuple):
    """A number of a robot's view for other systems."""

    metric: str  #: its name in Prometheus, with its unit
    help: str  #: a sentence on it
    path: tuple[str, ...]  #: its place in the view
    label: str = ""  #: its label in Home Assistant; "" leaves it out there
    unit: str = ""  #: its unit in Home Assistant
    scale: float = 1.0  #: factor to that unit
    kind: str = ""  #: device class of Home Assistant, which chooses its icon and its units


_GAUGES = (
    Gauge("ohmward_soc_ratio", "State of charge, 0 to 1.", ("charge", "soc"), "Charge", "%", 100.0, "battery"),
    Gauge("ohmward_soc_low_ratio", "Lower end of the 95 % band of the state of charge.", ("charge", "low"),
          "Charge at least", "%", 100.0),
    Gauge("ohmward_soc_high_ratio", "Upper end of the 95 % band of the state of charge.", ("charge", "high"),
          "Charge at most", "%", 100.0),
    Gauge("ohmward_battery_volts", "Voltage of the battery.", ("charge", "voltage_V"), "Voltage", "V", 1.0, "voltage"),
    Gauge("ohmward_battery_amperes", "Current of the battery, > 0 charges.", ("charge", "current_A"),
          "Current", "A", 1.0, "current"),
    Gauge("ohmward_battery_celsius", "Temperature of the battery.", ("charge", "temperature_degC"),
          "Temperature", "°C", 1.0, "temperature"),
    Gauge("ohmward_soh_capacity_ratio", "Capacity relative to the battery file's.", ("charge", "soh_capacity"),
          "Capacity", "%", 100.0),
    Gauge("ohmward_resistance_ratio", "Resistance relative to the battery file's.", ("charge", "resistance_ratio"),
          "Resistance", "%", 100.0),
    Gauge("ohmward_battery_power_watts", "Power that the battery gives.", ("power", "battery_W"),
          "Power", "W", 1.0, "power"),
    Gauge("ohmward_range_metres", "Range left, median.", ("range", "distance_m", "p50"), "Range", "m", 1.0, "distance"),
    Gauge("ohmward_range_p10_metres", "Range left that is reached with 90 %.", ("range", "distance_m", "p10"),
          "Range at least", "m", 1.0, "distance"),
    Gauge("ohmward_time_left_seconds", "Time left, median.", ("range", "duration_s", "p50"),
          "Time left", "s", 1.0, "duration"),
    Gauge("ohmward_speed_metres_per_second", "Speed of the body, forward.", ("drive", "speed_m_s"),
          "Speed", "m/s", 1.0, "speed"),
    Gauge("ohmward_speed_band_metres_per_second", "Half of the 95 % band of the speed.", ("drive", "band_m_s")),
    Gauge("ohmward_distance_metres", "Length of the path since the start.", ("pose", "distance_m")),
)  # fmt: skip

#: Metric, help and key of the time, for the age of the samples behind the estimates.
_AGES = (
    ("ohmward_battery_sample_age_seconds", "Age of the last sample of the battery.", "battery_time_s"),
    ("ohmward_drive_sample_age_seconds", "Age of the last sample of the drive.", "drive_time_s"),
)


def metrics(view: dict[str, Any]) -> str:
    """The view of a state as metrics; unknown values are left out."""
    return "\n".join(_lines(view)) + "\n"


def _lines(view: dict[str, Any]) -> Iterator[str]:
    robot = _label("robot", view["name"])
    for name, text, path, *_ in _GAUGES:
        value = _at(view, path)
        if isinstance(value, float | int) and math.isfinite(value):
            yield from _metric(name, text, {robot: value})
    for name, text, key in _AGES:
        if (measured_s := view.get(key)) is not None:
            yield from _metric(name, text, {robot: max(view["time_s"] - measured_s, 0.0)})
    wheels = [w for w in (view.get("drive") or {}).get("wheels", []) if w["slip_ratio"] is not None]
    slips = {f"{robot},{_label('wheel', wheel['name'])}": wheel["slip_ratio"] for wheel in wheels}
    yield from _metric("ohmward_slip_ratio", "Slip of a driven wheel, -1 to 1.", slips)
    for total in view.get("totals", []):
        unit = f" [{total['unit']}]" if total["unit"] else ""
        name, text = f"ohmward_{total['name'].lower()}_total", f"{total['label']} since ever{unit}."
        yield from _metric(name, text, {robot: total["value"]}, "counter")
    alarms = {f"{robot},{_label('name', alarm['name'])}": 1 for alarm in view.get("alarms", [])}
    yield from _metric("ohmward_alarm", "Alarm that is raised.", alarms)
    levels = {f"{robot},{_label('name', one['name'])}": Level[one["level"]].value for one in view.get("sensors", [])}
    yield from _metric("ohmward_condition", "Condition: 0 well, 1 warning, 2 error, 3 silent.", levels)


def _metric(name: str, text: str, values: Mapping[str, float], type_: str = "gauge") -> Iterator[str]:
    """Lines of a metric, its values by their labels; none without a value."""
    if values:
        yield f"# HELP {name} {text}"
        yield f"# TYPE {name} {type_}"
        yield from (f"{name}{{{labels}}} {value:.9g}" for labels, value in values.items())


def home_assistant(topic: str, robot: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Topics below the discovery prefix, and their objects, that make Home Assistant show a robot as a device.

    https://www.home-assistant.io/integrations/mqtt/#mqtt-discovery

    topic: of the robot; TOPIC/now is its view, TOPIC/status says whether it is online.
    """
    node = re.sub(r"\W+", "_", topic.encode("ascii", "backslashreplace").decode())  # no other letters are allowed
    device = {"identifiers": [node], "name": robot, "manufacturer": "ohmward", "sw_version": __version__}
    common = {"device": device, "state_topic": f"{topic}/now", "availability_topic": f"{topic}/status"}
    common |= {"payload_available": "online", "payload_not_available": "offline"}
    sensors = [(gauge.path, gauge.label, gauge.unit, gauge.scale, gauge.kind, "measurement") for gauge in _GAUGES]
    sensors += [(("total", name), *total_words(name), 1.0, "", "total_increasing") for name in Totals._fields]
    for path, label, unit, scale, kind, of_state in sensors:
        if label:
            key = "_".join(path)
            about = {"name": label, "unique_id": f"{node}_{key}", "state_class": of_state}
            about |= {"unit_of_measurement": unit} if unit else {}
            kind = "energy" if unit == "kWh" else kind
            about |= {"device_class": kind} if kind else {}
            yield f"sensor/{node}/{key}/config", common | about | {"value_template": _template(path, scale)}
    alarm = {"name": "Alarm", "unique_id": f"{node}_alarm", "device_class": "problem"}
    alarm |= {"value_template": "{{ 'ON' if value_json.alarms else 'OFF' }}"}
    alarm |= {"json_attributes_topic": f"{topic}/now", "json_attributes_template": _ALARMS}
    yield f"binary_sensor/{node}/alarm/config", common | alarm


#: Sentences of the alarms as attributes, in Jinja.
_ALARMS = "{{ {'alarms': value_json.alarms | map(attribute='text') | list} | tojson }}"


def _template(path: Sequence[str], scale: float) -> str:
    """The number at a path of the view in Jinja; none if it is unknown."""
    places = [".".join(("value_json", *path[: k + 1])) for k in range(len(path))]
    known = " and ".join([*places[:-1], f"{places[-1]} is number"])
    factor = f" * {scale:g}" if scale != 1.0 else ""
    return f"{{{{ ({places[-1]}{factor}) | round(4) if {known} else none }}}}"


def _at(view: Any, path: tuple[str, ...]) -> Any:
    for key in path:
        view = view.get(key) if isinstance(view, dict) else None
    return view


def _label(name: str, text: str) -> str:
    """A label with its text escaped."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
    return f'{name}="{escaped}"'
