"""States of the robot as messages of ROS 2: units of REP-103, frames of REP-105, conditions of REP-107."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.filters.consistency import BAND_95
from ohmward.onboard.evidence import OF_CHARGE
from ohmward.onboard.robot_state import Diagnostic, Level, RobotState, soc_band
from ohmward.onboard.ros.types import BATTERY_STATE
from ohmward.quantities import QUANTITIES
from ohmward.traction.odometry.nav_msgs import UNKNOWN_VARIANCE, header, odometry_message, twist_with_covariance

Message = dict[str, Any]

#: A current of less than this share of the capacity in an hour neither charges nor discharges.
_NO_CURRENT_C = 0.01
#: Constants of BatteryState.
_UNKNOWN, _CHARGING, _DISCHARGING, _NOT_CHARGING, FULL = range(5)
_NIMH, _LION, _LIPO, _LIFE, _VRLA = 1, 2, 3, 4, 8
_TECHNOLOGY = {
    "lfp": _LIFE,
    "lipo": _LIPO,
    "lead-acid": _VRLA,
    "nimh": _NIMH,
    "sodium-ion": _UNKNOWN,
    "": _UNKNOWN,
}


def battery_date_s(state: RobotState) -> float:
    """Date of a message about the battery, seconds since 1970: of its sample, or now if its sensors are silent."""
    return state.unix_s if state.is_silent("battery") else state.date_s("battery")


def battery_state(
    state: RobotState, measured: Mapping[str, float], battery: Battery | None, base_frame: str, cautious: bool = False
) -> Message:
    """`sensor_msgs/BatteryState`; nan for an unknown quantity, not present if nothing is known.

    measured: signal -> latest value of the battery's sensors, nan for one that is silent.
    battery: for its label, if known.  base_frame: frame of the robot, REP-105.
    cautious: the percentage is the low end of the 95 % band, and falls to 0 while the sensors are silent.
    """
    charge, nan = None if state.is_silent("battery") else state.battery, math.nan
    capacity_Ah = battery.capacity_Ah if battery else nan
    now_Ah = capacity_Ah * float(charge.soh_capacity) if charge and charge.soh_capacity == charge.soh_capacity else nan
    now_Ah = capacity_Ah if math.isnan(now_Ah) else now_Ah
    soc = min(max(float(charge.soc), 0.0), 1.0) if charge else nan
    return {
        "header": header(battery_date_s(state), base_frame),
        **{q.ros_field: measured.get(q.name, nan) for q in QUANTITIES.values() if q.ros_type == BATTERY_STATE},
        "charge": soc * now_Ah,
        "capacity": now_Ah,
        "design_capacity": capacity_Ah,
        "percentage": _cautious(state) if cautious else soc,
        "power_supply_status": _status(measured, charge, capacity_Ah),
        "power_supply_health": _UNKNOWN,
        "power_supply_technology": _TECHNOLOGY.get(battery.chemistry, _LION) if battery else _UNKNOWN,
        "present": charge is not None
        or any(math.isfinite(v) for name, v in measured.items() if name.partition(".")[0] in OF_CHARGE),
        "cell_voltage": _cells(measured, battery),
        "cell_temperature": [],
        "location": "",
        "serial_number": battery.serial_number if battery else "",
    }


def _cautious(state: RobotState) -> float:
    """Low end of the band of the charge in [0, 1]; 0 if it is no longer known, nan if it is not known yet."""
    if state.battery is None:
        return 0.0 if state.is_silent("battery") else math.nan
    return soc_band(float(state.battery.soc), float(state.battery.soc_std))[0]


def home_probability(state: RobotState) -> float:
    """Probability of reaching home; 0 while the battery's sensors are silent, nan if the way is not known."""
    if state.is_silent("battery"):
        return 0.0
    return float(state.range.home_probability) if state.range else math.nan


def _cells(measured: Mapping[str, float], battery: Battery | None) -> list[float]:
    """Voltages of the cells, nan for one that is not measured; empty if none is."""
    voltages = {int(name.partition(".")[2]): v for name, v in measured.items() if name.startswith("cell_voltage_V.")}
    count = 0 if not voltages else int(battery.n_series) if battery else max(voltages) + 1
    return [voltages.get(k, math.nan) for k in range(count)]


def _status(measured: Mapping[str, float], charge: Any, capacity_Ah: float) -> int:
    """Status of the power supply, from the current corrected for the offset of its sensor."""
    offset_A = float(charge.current_offset_A) if charge and charge.current_offset_A == charge.current_offset_A else 0.0
    current_A = measured.get("battery_current_A", math.nan) - offset_A
    idle_A = _NO_CURRENT_C * capacity_Ah if math.isfinite(capacity_Ah) else 0.0
    if measured.get("battery_full", 0.0) >= 0.5 and not current_A < -idle_A:
        return FULL
    if math.isnan(current_A):
        return _UNKNOWN
    return _CHARGING if current_A > idle_A else _DISCHARGING if current_A < -idle_A else _NOT_CHARGING


def odometry(state: RobotState, odom_frame: str, base_frame: str) -> Message:
    """`nav_msgs/Odometry`: pose in a frame in which it is continuous, twist in the frame of the robot, REP-105.

    state: must have a pose.
    """
    pose = state.pose
    assert pose is not None
    return odometry_message(pose, state.date_s("drive"), odom_frame, base_frame)


def transform(state: RobotState, odom_frame: str, base_frame: str) -> Message:
    """`tf2_msgs/TFMessage` with the pose as the transform from odom to base."""
    found = odometry(state, odom_frame, base_frame)
    pose = found["pose"]["pose"]
    stamped = {
        "header": found["header"],
        "child_frame_id": base_frame,
        "transform": {"translation": pose["position"], "rotation": pose["orientation"]},
    }
    return {"transforms": [stamped]}


def twist(state: RobotState, base_frame: str) -> Message:
    """`geometry_msgs/TwistWithCovarianceStamped`: speed and yaw rate corrected for slip.

    state: must have an estimate of the slip.
    """
    slip = state.slip
    assert slip is not None
    left = 0.0 if state.pose is None else float(state.pose.speed_left_m_s)
    left_var = UNKNOWN_VARIANCE if state.pose is None else float(state.pose.twist_cov[1, 1])
    covariance = np.diag([float(slip.speed_std_m_s) ** 2, left_var, float(slip.yaw_rate_std_rad_s) ** 2])
    moved = twist_with_covariance(slip.speed_m_s, left, slip.yaw_rate_rad_s, covariance)
    return {"header": header(state.date_s("drive"), base_frame), "twist": moved}


def diagnostics(state: RobotState, robot: str, stamp_s: float, node: str = "ohmward") -> Message:
    """`diagnostic_msgs/DiagnosticArray`: charge, drive, and the condition of every sensor, source and sink.

    robot: its name.  stamp_s: date of the message, seconds since 1970.
    node: its full name, which tells the conditions of several robots apart.
    """
    conditions = [*_estimates(state), *state.diagnostics]
    return {
        "header": header(stamp_s, ""),
        "status": [_status_message(condition, robot, node) for condition in conditions],
    }


def _status_message(condition: Diagnostic, robot: str, node: str) -> Message:
    values = [
        {"key": key, "value": value if isinstance(value, str) else f"{value:.9g}"}
        for key, value in condition.values.items()
    ]
    return {
        "level": int(condition.level),
        "name": f"{node}: {condition.name}",
        "message": condition.message,
        "hardware_id": robot,
        "values": values,
    }


def _estimates(state: RobotState) -> list[Diagnostic]:
    """Estimates with their standard deviations, which the other messages have no room for."""
    found: list[Diagnostic] = []
    if charge := state.battery:
        names = ("soc", "soc_std", "soh_capacity", "resistance_ratio", "current_offset_A")
        values: dict[str, str | float] = {name: float(getattr(charge, name)) for name in names}
        if reach := state.range:
            values["range_assumed"] = str(bool(reach.assumed))
            quantiles = zip(("p10", "p50", "p90"), reach.distance_m, reach.duration_s, strict=True)
            for quantile, distance_m, duration_s in quantiles:
                values |= {f"range_{quantile}_m": float(distance_m), f"time_left_{quantile}_s": float(duration_s)}
        text = f"{100 * float(charge.soc):.0f} ± {100 * BAND_95 * float(charge.soc_std):.0f} %"
        found.append(Diagnostic("charge", Level.OK, text, values))
    if state.is_silent("battery"):
        found = [_stale("charge", "battery", state.time_s - state.battery_time_s, found)]
    if slip := state.slip:
        ratios = {f"slip_ratio.{k}": float(ratio) for k, ratio in enumerate(slip.slip_ratio)}
        stuck = float(slip.immobilised) >= 0.5
        level = Level.ERROR if stuck else Level.WARN if np.any(np.asarray(slip.slipping) >= 0.5) else Level.OK
        text = "wheels turn, the robot does not" if stuck else "wheels slip" if level else "wheels grip"
        found.append(Diagnostic("drive", level, text, {"speed_m_s": float(slip.speed_m_s), **ratios}))
    elif state.is_silent("drive"):
        found.append(_stale("drive", "wheels", state.time_s - state.drive_time_s))
    return found


def _stale(estimate: str, sensors: str, age_s: float, known: Sequence[Diagnostic] = ()) -> Diagnostic:
    """Condition of an estimate whose sensors are silent.

    known: the estimate, if it is still known in part.
    """
    causes = " ".join(condition.message for condition in known) or "unknown"
    message = f"{causes}: the sensors of the {sensors} are silent; look at them, their wires and their driver"
    values = {key: value for condition in known for key, value in condition.values.items()}
    return Diagnostic(estimate, Level.STALE, message, {**values, "age_s": age_s})
