"""The robots of a fleet: their logs, and charge, capacity, resistance and alarms of each, the worst first."""

from __future__ import annotations

import filecmp
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ohmward.errors import InputError, OhmwardError
from ohmward.filters.consistency import BAND_95
from ohmward.logs.battery_columns import serial_column
from ohmward.logs.hints import FileHints
from ohmward.logs.read import open_table
from ohmward.logs.selection import labels_in, split_selection
from ohmward.logs.table import TableFile, counted
from ohmward.quantities import SECONDS_PER_HOUR
from ohmward.signals.survey import spread

#: Ways to identify the robot, besides the name of a column; the first tries the others in turn.
AUTO, ALONE, SERIAL, NAME, FOLDER = "auto", "log", "serial", "name", "folder"
WAYS = (AUTO, ALONE, SERIAL, NAME, FOLDER)
_COLUMN = re.compile(r"^(?:robot|vehicle|device|machine|agv|amr|unit)(?:[ _]?(?:id|name|no|number))?$", re.IGNORECASE)
#: A name with a date, or a number after a separator, at its end: `amr-00_2026-01-01`, `mower 3 run 12`.
_DATED = re.compile(r"^(?P<robot>.*?[^\W_].*?)[ _.-]+(?:\d{4}[-_.]?\d{2}[-_.]?\d{2}|\d{9,}).*$")
_NUMBERED = re.compile(r"^(?P<robot>.*?[^\W_].*?)[ _.-]+(?:run|log|part|day|trip|bag)?[ _.-]*\d+$", re.IGNORECASE)
#: A date before the name: `2026-01-31_amr-3`.
_DATE_FIRST = re.compile(r"^(?:19|20)\d\d[-_.]?\d\d[-_.]?\d\d(?:[T _.-]+\d[\d_.:-]*)?[ _.-]+(?P<robot>[^\W\d_].*)$")
#: What logs of every robot are called, in a folder of its own: `amr-3/2026-01-31`, `amr-3/run_1`, `amr-3/rosbag2_...`.
_OF_NO_ROBOT = re.compile(
    r"^(?:(?:19|20)\d\d[\d\W_]*|(?:run|log|day|part|trip|data|(?:ros)?bag2?|battery|drive|recording|session)s?)$",
    re.IGNORECASE,
)
#: Marks of a copy: `Copy of amr-1_1`, `amr-1_1 - Copy`, `amr-1_1 (2)`; the number is one of a log.
_COPY = re.compile(r"^copy of +| - copy(?: *\(\d+\))?$|(?<=\d) *\(\d+\)$", re.IGNORECASE)
_BRACKETED = re.compile(r" *\((\d+)\)$")


class Robots(NamedTuple):
    """Logs by their robots."""

    by: str  #: the way, or the name of the column, by which most logs were identified
    logs: dict[str, list[str]]  #: robot -> its logs; with a selection of rows if a file holds several robots
    #: another way, or column, -> logs identified by it; `ALONE` for those of no robot
    otherwise: Mapping[str, Sequence[str]] = {}
    unreadable: tuple[str, ...] = ()  #: logs that cannot be opened and belong to no robot of the others


def robots_of(texts: Sequence[str], by: str | None = None, hints: FileHints | None = None) -> Robots:
    """Assign logs to their robots; a log that is unreadable or names no robot does not change those of the others.

    texts: names of logs, perhaps with a selection of their rows.
    by: one of `WAYS`, or the name of a column, whose spaces and capitals may vary; logs without it are of no robot,
        except those that cannot be read. `auto`, the default, takes for each log the first that it has: a column of
        robots, a serial number, a name before a date or number. If most logs have none of them, their folders count.
        If no robot has several logs, each log counts as a robot.

    Raises:
        InputError: no log has the column, or a serial number.
    """
    by = by or AUTO
    if by == ALONE:
        return _each_alone(texts)
    copies = _copies(texts)
    files = {text: file for text in texts if text not in copies and (file := _opened(text, hints)) is not None}
    finds = _finds(by)
    if by not in (AUTO, NAME, FOLDER) and not any(find(file.names) for file in files.values() for find in finds):
        what = "a serial number" if by == SERIAL else f"the column {by!r}"
        raise InputError(f"by={by!r} (--by {by}): no log has {what}; name another column, or one of {', '.join(WAYS)}")
    labels = {text: label for text, file in files.items() if (label := _label(file, finds)) is not None}
    readable = [text for text, file in files.items() if text in labels or _has_rows(text, file)]
    otherwise = by if by in (NAME, FOLDER) else ALONE
    way = _way(readable, labels) if by == AUTO else otherwise
    found = _assigned(readable, labels, way)
    is_split = any(len(label.robots) > 1 for label in labels.values())
    if by == AUTO and not is_split and all(len(logs) == 1 for logs in found.logs.values()):
        return _each_alone(texts)
    unreadable = [text for text in texts if text not in readable and text not in copies]
    found = _with_unreadable(found, unreadable, FOLDER if way == FOLDER else NAME)
    for text, original in copies.items():
        for logs in found.logs.values():
            logs += [log.replace(original, text, 1) for log in logs if split_selection(log)[0] == Path(original)]
    return found


def _copies(texts: Sequence[str]) -> dict[str, str]:
    """Log -> an earlier one with the same bytes, whatever its name: of the same robot, recorded once."""
    of_size: dict[int, list[str]] = {}
    copies: dict[str, str] = {}
    for text in texts:
        path = Path(text)
        size = path.stat().st_size if path.is_file() else 0
        alike = (other for other in of_size.setdefault(size, []) if filecmp.cmp(other, text, shallow=False))
        original = next(alike, None) if size else None
        if original is None:
            of_size[size].append(text)
        else:
            copies[text] = original
    return copies


class _RobotLabel(NamedTuple):
    """Robots in a log by one of its columns."""

    column: str
    robots: list[str]


Find = Callable[[tuple[str, ...]], str | None]


def _finds(by: str) -> tuple[Find, ...]:
    """Functions that find the column of a way, the first preferred."""
    if by == AUTO:
        return (lambda names: next((name for name in names if _COLUMN.match(name)), None)), serial_column
    if by == SERIAL:
        return (serial_column,)
    if by in WAYS:
        return ()
    return (lambda names: next((name for name in names if _bare(name) == _bare(by)), None),)


def _bare(name: str) -> str:
    """The name of a column without capitals and separators: `robotid` of `Robot ID`."""
    return re.sub(r"[\W_]+", "", name.casefold())


def _label(file: TableFile, finds: Sequence[Find]) -> _RobotLabel | None:
    """The robots by the first column that names any."""
    for find in finds:
        column = find(file.names)
        try:
            robots = [] if column is None else labels_in(file, column)
        except OhmwardError:
            robots = []
        if column is not None and robots:
            return _RobotLabel(column, robots)
    return None


def _way(readable: Sequence[str], labels: Mapping[str, _RobotLabel]) -> str:
    """The way to assign logs without a label, by what most logs have."""
    without = [text for text in readable if text not in labels]
    robots = [robot for text in without if (robot := _in_name(text)) is not None]
    several = len({_of_folder(text) for text in without}) > 1
    known = len(labels) + sum(not (several and _OF_NO_ROBOT.match(robot)) for robot in robots)
    if 2 * known > len(readable):
        return NAME
    return FOLDER if several else ALONE


def _assigned(readable: Sequence[str], labels: Mapping[str, _RobotLabel], way: str) -> Robots:
    """Robots of the logs that can be read: by their labels, else by the way, else each alone."""
    robots: dict[str, list[str]] = {}
    found_by: dict[str, str] = {}
    for text in readable:
        robot = _ROBOT[way](text)
        if text in labels:
            column, values = labels[text]
            mark = "," if split_selection(text)[1] else ":"
            for value in values:
                robots.setdefault(value, []).append(text if len(values) == 1 else f"{text}{mark}{column}={value}")
            found_by[text] = column
        elif robot is not None:
            robots.setdefault(robot, []).append(text)
            found_by[text] = way
    known = set(robots)
    for text in readable:
        if text not in found_by:
            stem = _stem(text)
            robots.setdefault(stem if stem in known or stem not in robots else text, []).append(text)
    ways = list(found_by.values())
    by = max(ways, key=ways.count, default=way)
    otherwise: dict[str, list[str]] = {}
    for text in readable:
        if _bare(found := found_by.get(text, ALONE)) != _bare(by):
            otherwise.setdefault(found, []).append(text)
    return Robots(by, robots, otherwise)


def _with_unreadable(found: Robots, texts: Sequence[str], way: str) -> Robots:
    """The robots with the logs that cannot be opened: of a robot of the others, or of one that names give."""
    robots = {robot: list(logs) for robot, logs in found.logs.items()}
    unknown = []
    for text in texts:
        robot = _ROBOT[way](text) or _stem(text)
        if robot in found.logs or (found.by == NAME and robot == _in_name(text)):
            robots.setdefault(robot, []).append(text)
        else:
            unknown.append(text)
    return found._replace(logs=robots, unreadable=tuple(unknown))


def _each_alone(texts: Sequence[str]) -> Robots:
    return Robots(ALONE, {text: [text] for text in texts})


def _in_name(text: str) -> str | None:
    """The name of a log beside its date, or before its number; None without one."""
    stem = _BRACKETED.sub(r"_\1", _COPY.sub("", _stem(text)))
    found = _DATE_FIRST.match(stem) or _DATED.match(stem) or _NUMBERED.match(stem)
    return found["robot"] if found else None


def _stem(text: str) -> str:
    """The name of a log before its ending."""
    name = Path(split_selection(text)[0]).name
    return name.partition(".")[0] or name


def _of_folder(text: str) -> str:
    return Path(split_selection(text)[0]).resolve().parent.name


#: Robot of a log without a label by each way; None leaves it alone.
_ROBOT: Mapping[str, Callable[[str], str | None]] = {NAME: _in_name, FOLDER: _of_folder, ALONE: lambda text: None}


def _opened(text: str, hints: FileHints | None) -> TableFile | None:
    try:
        return open_table(split_selection(text)[0], hints)
    except OhmwardError:
        return None


#: A larger file has rows [bytes]; it is not read to find out.
_LARGEST_EMPTY_FILE = 50_000


def _has_rows(text: str, file: TableFile) -> bool:
    """False for a table of which only the header is there."""
    if file.head or file.choose or split_selection(text)[0].stat().st_size > _LARGEST_EMPTY_FILE:
        return True
    try:
        return bool(file.load(set(file.names)).line.size)
    except OhmwardError:
        return False


#: One-sided 95 % of a normal distribution: an alarm holds with that probability.
_SURELY = 1.645
#: A battery below this share of its capacity is worn out, one above this ratio of its resistance is suspect.
WORN, HIGH_RESISTANCE = 0.8, 2.0
#: An outlier differs from the fleet by this many standard deviations, fleet and robot combined, and by at least this
#: share; fewest robots that show a spread.
_OUTLIER_STDS, _OUTLIER_SHARE, _FEWEST_ROBOTS = 3.5, 0.1, 5
#: Fields of a robot that are those in the row of its last log.
_AS_IN_THE_ROW = (
    "soh_capacity", "soh_capacity_std", "resistance_ratio", "resistance_ratio_std", "current_offset_A",
)  # fmt: skip
#: Charge below which a battery should not be used.
LOW_SOC = 0.1


class RobotRecord(NamedTuple):
    """A robot at the end of its last log; a quantity that its estimator does not provide is None."""

    robot: str
    logs: int  #: number used
    refused: int
    hours: float
    begins: str | None  #: time of the first and of the last log, ISO 8601
    last: str | None
    throughput_Ah: float
    soc: float | None
    soc_std: float | None
    soh_capacity: float | None  #: over the battery file's; None too where its logs do not show it
    soh_capacity_std: float | None
    soh_change: float | None  #: of `soh_capacity` from the end of the first log to that of the last
    soh_change_std: float | None
    resistance_ratio: float | None  #: over the battery file's
    resistance_ratio_std: float | None
    current_offset_A: float | None
    battery: str | None  #: its learnt battery file
    alarms: tuple[str, ...]


def robot_states(rows: Sequence[Mapping[str, Any]]) -> list[RobotRecord]:
    """The robots of a finished job, the worst first: by their alarms, their capacity, where known, and resistance.

    rows: from `RobotJob.run`; logs of no robot are left out.
    """
    rows = [row for each in rows if (row := each if "logs" in each else _lost(each))["robot"]]
    states = [_state(row) for row in rows]
    fleet: dict[str, tuple[float, float] | None] = {}  # median and robust standard deviation; None for too few robots
    for name in ("soh_capacity", "resistance_ratio"):
        values = np.array([value for state in states if (value := getattr(state, name)) is not None])
        fleet[name] = (float(np.median(values)), spread(values)) if values.size >= _FEWEST_ROBOTS else None
    judged = []
    for state, row in zip(states, rows, strict=True):
        own = tuple(_alarms(state, row))
        named = {alarm.split()[0] for alarm in own}
        beside = (alarm for alarm in _outliers(state, fleet) if alarm.split()[0] not in named)
        judged.append(state._replace(alarms=(*own, *beside)))
    return sorted(judged, key=_rank)


def _rank(state: RobotRecord) -> tuple[int, float, float, str]:
    capacity = np.inf if state.soh_capacity is None else state.soh_capacity
    return -len(state.alarms), capacity, -(state.resistance_ratio or 0.0), state.robot


def _lost(row: Mapping[str, Any]) -> dict[str, Any]:
    """The row of a robot whose job ended without one, as on a worker that died."""
    robot = row["path"].rpartition(" ")[0]
    return {"robot": robot, "battery": None, "logs": [{**row, "robot": robot}]}


def _state(row: Mapping[str, Any]) -> RobotRecord:
    used = [log for log in row["logs"] if not log["error"]]
    last: Mapping[str, Any] = used[-1] if used else {}
    dates = [log["begins"] for log in used if log["begins"]]
    return RobotRecord(
        robot=row["robot"],
        logs=len(used),
        refused=len(row["logs"]) - len(used),
        hours=sum(log["duration_s"] for log in used) / SECONDS_PER_HOUR,
        begins=dates[0] if dates else None,
        last=dates[-1] if dates else None,
        throughput_Ah=sum(log["throughput_Ah"] for log in used),
        soc=last.get("soc_final"),
        soc_std=last.get("soc_std_final"),
        soh_change=row.get("soh_change"),
        soh_change_std=row.get("soh_change_std"),
        battery=row.get("battery"),
        alarms=(),
        **{name: last.get(name) for name in _AS_IN_THE_ROW},
    )


def _alarms(state: RobotRecord, row: Mapping[str, Any]) -> Iterator[str]:
    """Alarms of a robot by itself."""
    used = [log for log in row["logs"] if not log["error"]]
    if not used:
        yield "none of its logs could be used"
        return
    if used[-1]["misfit"]:
        yield used[-1]["misfit"]
    if state.soh_capacity is not None and state.soh_capacity + _SURELY * (state.soh_capacity_std or 0.0) < WORN:
        yield f"capacity {with_band(state.soh_capacity, state.soh_capacity_std)} of the battery file's: worn out"
    ratio, std = state.resistance_ratio, state.resistance_ratio_std
    if ratio is not None and ratio - _SURELY * (std or 0.0) > HIGH_RESISTANCE:
        yield f"resistance {with_band(ratio, std)} of the battery file's: worn, or a bad contact"
    low = sum(log["soc_min"] < LOW_SOC for log in used)
    if low:
        yield f"below {100 * LOW_SOC:.0f} % of charge in {counted(low, 'log')}"


def _outliers(state: RobotRecord, fleet: Mapping[str, tuple[float, float] | None]) -> Iterator[str]:
    """Alarms of a robot that is worse than the fleet."""
    for name, what, way in (("soh_capacity", "capacity", -1.0), ("resistance_ratio", "resistance", 1.0)):
        value, own_std, known = getattr(state, name), getattr(state, f"{name}_std") or 0.0, fleet[name]
        if value is None or known is None:
            continue
        usual, std = known
        worse = way * (value - usual)
        if worse > _OUTLIER_STDS * float(np.hypot(std, own_std)) and worse > _OUTLIER_SHARE * usual:
            yield f"{what} {with_band(value, own_std)} of the battery file's, of the fleet {with_band(usual, std)}"


def with_band(share: float | None, std: float | None) -> str:
    """A share with its 95 % band, in percent; "-" where it is not known."""
    if share is None:
        return "-"
    return f"{100 * share:.0f} %" if std is None else f"{100 * share:.0f} ± {100 * BAND_95 * std:.0f} %"
