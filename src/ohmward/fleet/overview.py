"""Robots of a fleet side by side: charge, capacity, resistance and alarms of each, the worst first."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ohmward.logs.table import counted
from ohmward.signals.survey import spread

#: One-sided 95 % of a normal distribution: what is claimed holds with that probability.
_SURELY = 1.645
#: A battery below this share of its capacity is worn out, one above this ratio of its resistance is doubtful.
WORN, HIGH_RESISTANCE = 0.8, 2.0
#: A robot differs from the fleet by so many standard deviations, of the fleet and its own together, and by this share
#: at least; fewer robots show no spread.
_OUTLIER, _LEAST_SHARE, _FEWEST_ROBOTS = 3.5, 0.1, 5
#: What is known of a robot as it stands in the row of its last log.
_AS_IN_THE_ROW = (
    "soh_capacity", "soh_capacity_std", "resistance_ratio", "resistance_ratio_std", "current_offset_A",
)  # fmt: skip
#: Charge below which a battery should not be used.
LOW_SOC = 0.1


class RobotRecord(NamedTuple):
    """A robot at the end of its last log; a quantity that its estimator does not have is None."""

    robot: str
    logs: int  #: that were used
    refused: int
    hours: float
    begins: str | None  #: time of the first and of the last log, ISO 8601
    last: str | None
    throughput_Ah: float
    soc: float | None
    soc_std: float | None
    soh_capacity: float | None  #: over the battery file's
    soh_capacity_std: float | None
    soh_change: float | None  #: since the end of the first log
    resistance_ratio: float | None  #: over the battery file's
    resistance_ratio_std: float | None
    current_offset_A: float | None
    battery: str | None  #: its battery file, as it was learnt
    alarms: tuple[str, ...]


def robot_states(rows: Sequence[Mapping[str, Any]]) -> list[RobotRecord]:
    """The robots of a finished job, the worst first: by the number of their alarms, then by their capacity.

    rows: of `RobotJob.run`.
    """
    rows = [row if "logs" in row else _lost(row) for row in rows]
    states = [_state(row) for row in rows]
    fleet = {name: _of_fleet(states, name) for name in ("soh_capacity", "resistance_ratio")}
    judged = []
    for state, row in zip(states, rows, strict=True):
        own = tuple(_alarms(state, row))
        named = {alarm.split()[0] for alarm in own}
        beside = (alarm for alarm in _outliers(state, fleet) if alarm.split()[0] not in named)
        judged.append(state._replace(alarms=(*own, *beside)))
    return sorted(judged, key=lambda one: (-len(one.alarms), one.soh_capacity or 0.0, one.robot))


def _lost(row: Mapping[str, Any]) -> dict[str, Any]:
    """The row of a robot whose job ended without one, as on a worker that died."""
    robot = row["path"].rpartition(" ")[0]
    return {"robot": robot, "battery": None, "logs": [{**row, "robot": robot}]}


def _state(row: Mapping[str, Any]) -> RobotRecord:
    used = [log for log in row["logs"] if not log["error"]]
    last: Mapping[str, Any] = used[-1] if used else {}
    dates = [log["begins"] for log in used if log["begins"]]
    soh = [log["soh_capacity"] for log in used if log["soh_capacity"] is not None]
    return RobotRecord(
        robot=row["robot"],
        logs=len(used),
        refused=len(row["logs"]) - len(used),
        hours=sum(log["duration_s"] for log in used) / 3600.0,
        begins=dates[0] if dates else None,
        last=dates[-1] if dates else None,
        throughput_Ah=sum(log["throughput_Ah"] for log in used),
        soc=last.get("soc_final"),
        soc_std=last.get("soc_std_final"),
        soh_change=soh[-1] - soh[0] if len(soh) > 1 else None,
        battery=row.get("battery"),
        alarms=(),
        **{name: last.get(name) for name in _AS_IN_THE_ROW},
    )


def _alarms(state: RobotRecord, row: Mapping[str, Any]) -> Iterator[str]:
    """What is wrong with a robot by itself."""
    used = [log for log in row["logs"] if not log["error"]]
    if not used:
        yield "none of its logs could be used"
        return
    if used[-1]["misfit"]:
        yield used[-1]["misfit"]
    if state.soh_capacity is not None and state.soh_capacity + _SURELY * (state.soh_capacity_std or 0.0) < WORN:
        yield f"capacity {_with_std(state.soh_capacity, state.soh_capacity_std)} of the battery file's: worn out"
    ratio, std = state.resistance_ratio, state.resistance_ratio_std
    if ratio is not None and ratio - _SURELY * (std or 0.0) > HIGH_RESISTANCE:
        yield f"resistance {_with_std(ratio, std)} of the battery file's: worn, or a bad contact"
    low = sum(log["soc_min"] < LOW_SOC for log in used)
    if low:
        yield f"below {100 * LOW_SOC:.0f} % of charge in {counted(low, 'log')}"


def _outliers(state: RobotRecord, fleet: Mapping[str, tuple[float, float] | None]) -> Iterator[str]:
    """In what a robot is worse than the fleet."""
    for name, what, way in (("soh_capacity", "capacity", -1.0), ("resistance_ratio", "resistance", 1.0)):
        value, own_std, known = getattr(state, name), getattr(state, f"{name}_std") or 0.0, fleet[name]
        if value is None or known is None:
            continue
        usual, std = known
        worse = way * (value - usual)
        if worse > _OUTLIER * float(np.hypot(std, own_std)) and worse > _LEAST_SHARE * usual:
            yield f"{what} {_with_std(value, own_std)} of the battery file's, of the fleet {_with_std(usual, std)}"


def _of_fleet(states: Sequence[RobotRecord], name: str) -> tuple[float, float] | None:
    """Median and robust standard deviation of a quantity; None for too few robots."""
    values = np.array([value for state in states if (value := getattr(state, name)) is not None])
    return (float(np.median(values)), spread(values)) if values.size >= _FEWEST_ROBOTS else None


def _with_std(value: float, std: float | None) -> str:
    return f"{value:.0%}" if std is None else f"({100 * value:.0f} ± {100 * std:.0f}) %"
