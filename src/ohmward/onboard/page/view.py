"""State of the robot as the page, its history and the metrics show it: bands of 95 %, power, an ellipse."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ohmward.battery.soc.causes import time_in_words
from ohmward.filters.consistency import BAND_95, ELLIPSE_95
from ohmward.json_values import plain
from ohmward.onboard.alarms import ANYTHING, not_known, width_of_charge
from ohmward.onboard.robot_state import Level, RobotState, Totals, is_charging, soc_band, stale
from ohmward.quantities import EVENTS, QUANTITIES, Quantity
from ohmward.traction.speed_observer.estimate import SlipFlag

#: Columns of the history.
HISTORY = ("unix_s", "soc", "soc_low", "soc_high", "speed_m_s", "speed_std_m_s", "slip_ratio", "power_W", "range_m")
#: Columns of the store from which the history is made; the slip ratio has one for each wheel.
BATTERY = ("soc", "soc_std", "battery_current_A", "battery_voltage_V", "range_p50_m")
DRIVE = ("estimated_speed_m_s", "estimated_speed_std_m_s")
SLIP = "slip_ratio."


def view(state: RobotState) -> dict[str, Any]:
    """The state as the page shows it, for JSON; unknown values are None."""
    return plain(
        {
            "time_s": state.time_s,
            "unix_s": state.unix_s,
            "battery_time_s": state.battery_time_s,
            "drive_time_s": state.drive_time_s,
            "stale": stale(state),
            "advice": advice(state),
            "alarms": state.alarms,
            "charge": _charge(state),
            "range": _range(state),
            "drive": _drive(state),
            "pose": _pose(state),
            "power": _power(state),
            "total": state.totals,
            "totals": [_total(name, value) for name, value in (state.totals or Totals())._asdict().items() if value],
            "sensors": [{"name": d.name, "level": d.level, "message": d.message} for d in state.diagnostics],
            "level": max((d.level for d in state.diagnostics), default=Level.OK),
        }
    )


def advice(state: RobotState) -> str:
    """Sentence on what the operator should do now, from the most urgent alarm if there is one; "" for nothing."""
    if state.alarms:
        return state.alarms[0].text
    if state.battery is None or is_charging(state.sample.get("battery_current_A", 0.0), state.battery):
        return ""
    return not_known(state) if width_of_charge(state) > ANYTHING else ""


def history_row(unix_s: float, columns: Mapping[str, float]) -> tuple[float, ...]:
    """Values of `HISTORY` from columns of the store, nan for unknown ones."""

    def value(name: str) -> float:
        return float(columns.get(name, math.nan))

    slips = np.array([slip for name, slip in columns.items() if name.startswith(SLIP)])
    return (
        unix_s,
        value("soc"),
        *soc_band(value("soc"), value("soc_std")),
        value("estimated_speed_m_s"),
        value("estimated_speed_std_m_s"),
        largest(slips),
        battery_power_W(columns),
        value("range_p50_m"),
    )


def battery_power_W(sample: Mapping[str, float]) -> float:
    """Power that the battery gives [W], nan if current or voltage was not measured."""
    return -sample.get("battery_current_A", math.nan) * sample.get("battery_voltage_V", math.nan)


def largest(ratios: np.ndarray) -> float:
    """The ratio of the largest magnitude, nan if none is known."""
    known = ratios[np.isfinite(ratios)]
    return float(known[np.argmax(np.abs(known))]) if len(known) else math.nan


def ellipse(cov: np.ndarray) -> dict[str, float]:
    """Semi-axes [m] and angle of the major one [rad] of the ellipse that contains x and y with 95 %."""
    variances, axes = np.linalg.eigh(cov[:2, :2])
    minor_m, major_m = ELLIPSE_95 * np.sqrt(np.maximum(variances, 0.0))
    return {"major_m": major_m, "minor_m": minor_m, "angle_rad": math.atan2(axes[1, 1], axes[0, 1])}


def _charge(state: RobotState) -> dict[str, Any] | None:
    if (charge := state.battery) is None:
        return None
    low, high = soc_band(charge.soc, charge.soc_std)
    since = ""
    if state.is_silent("battery"):
        since = f"; last measured {time_in_words(state.time_s - state.battery_time_s)} ago"
    of_battery = [quantity for quantity in QUANTITIES.values() if quantity.owner == "battery"]
    beside = [q for q in of_battery if q.name in state.sample and not q.estimated_from and q.name not in EVENTS]
    return {
        "soc": charge.soc,
        "low": low,
        "high": high,
        "sentence": f"Between {100 * low:.0f} and {100 * high:.0f} % with a probability of 95 %{since}.",
        **{q.field: state.sample.get(q.name, math.nan) for q in of_battery if q.words and q.estimated_from},
        "soh_capacity": charge.soh_capacity,
        "soh_capacity_band": BAND_95 * charge.soh_capacity_std,
        "resistance_ratio": charge.resistance_ratio,
        "resistance_ratio_band": BAND_95 * charge.resistance_ratio_std,
        "flags": charge.flags,
        "beside": [*(_reading(q, state.sample) for q in beside), *_cells(state)],
    }


def _cells(state: RobotState) -> list[dict[str, Any]]:
    """Lowest and highest voltage of the cells, and the spread of their charge, if cells are measured."""
    voltages = {s: v for s, v in state.sample.items() if s.startswith("cell_voltage_V.") and math.isfinite(v)}
    if state.cells is None or not voltages:
        return []
    least, most = min(voltages, key=voltages.__getitem__), max(voltages, key=voltages.__getitem__)
    number = {signal: int(signal.rpartition(".")[2]) + 1 for signal in (least, most)}
    return [
        {"label": f"Lowest cell, number {number[least]}", "value": voltages[least], "unit": "V"},
        {"label": f"Highest cell, number {number[most]}", "value": voltages[most], "unit": "V"},
        {"label": "Between their charges", "value": 100.0 * state.cells.pack.soc_spread, "unit": "points"},
    ]


def _reading(quantity: Quantity, sample: Mapping[str, float]) -> dict[str, Any]:
    """A measured value with label and unit; the charge reported by a BMS in percent."""
    value, label = sample[quantity.name], quantity.label.replace("Bms ", "BMS: ")
    if quantity.name == "bms_soc":
        return {"label": "BMS: charge", "value": 100.0 * value, "unit": "%"}
    return {"label": label, "value": value, "unit": quantity.unit.replace("1", "")}


def total_words(name: str) -> tuple[str, str]:
    """Label and unit of a total: `energy_out_kWh` is "Energy out", kWh."""
    words = name.split("_")
    unit = words.pop() if len(words) > 1 else ""
    return " ".join(words).capitalize(), unit


def _total(name: str, value: float) -> dict[str, Any]:
    label, unit = total_words(name)
    return {"name": name, "label": label, "value": value, "unit": unit}


def _range(state: RobotState) -> dict[str, Any] | None:
    if (reach := state.range) is None or math.isnan(reach.distance_m.p50):
        return None
    return {
        "distance_m": reach.distance_m,
        "duration_s": reach.duration_s,
        "home_probability": reach.home_probability,
        "energy_J_per_m": reach.energy_J_per_m,
        "assumed": bool(reach.assumed),
        "charge_known": width_of_charge(state) <= ANYTHING,
    }


def _drive(state: RobotState) -> dict[str, Any] | None:
    if (slip := state.slip) is None:
        return None
    return {
        "speed_m_s": slip.speed_m_s,
        "band_m_s": BAND_95 * slip.speed_std_m_s,
        "yaw_rate_rad_s": slip.yaw_rate_rad_s,
        "grade_rad": slip.grade_rad,
        "immobilised": bool(slip.immobilised),
        "wheels": [
            {
                "name": name,
                "slip_ratio": slip.slip_ratio[k],
                "slip_speed_m_s": slip.slip_speed_m_s[k],
                "traction_N": slip.traction_N[k],
                "slipping": bool(slip.slipping[k]),
            }
            for k, name in enumerate(state.wheels)
        ],
        "flags": slip.flags,
    }


def _pose(state: RobotState) -> dict[str, Any] | None:
    if (pose := state.pose) is None:
        return None
    names = ("x_m", "y_m", "yaw_rad", "distance_m")
    return {name: getattr(pose, name) for name in names} | {"ellipse": ellipse(pose.pose_cov)}


def _power(state: RobotState) -> dict[str, Any]:
    """Power of the battery [W] and its parts: motion of the robot, slip, and the rest.

    Ground force times speed of the body is motion, ground force times slip speed is slip; the rest goes into motors,
    gears and electronics.
    """
    whole_W = battery_power_W(state.sample)
    slip = state.slip
    if slip is None or int(slip.flags) & SlipFlag.NO_CURRENT:  # without currents the forces are unknown
        return {"battery_W": whole_W}
    motion_W = float(np.sum(slip.traction_N) * slip.speed_m_s)
    slip_W = float(np.sum(slip.traction_N * slip.slip_speed_m_s))
    return {"battery_W": whole_W, "motion_W": motion_W, "slip_W": slip_W, "rest_W": whole_W - motion_W - slip_W}
