"""Dates, times of day and time zones: texts in many notations as seconds; the time window of a log."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from contextlib import suppress
from datetime import UTC, date, datetime, timedelta
from functools import lru_cache
from typing import NamedTuple
from zoneinfo import ZoneInfo

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.hints import EXCEL, FileHints, zone_of
from ohmward.logs.table import can_read
from ohmward.quantities import DAY_S, SECONDS_PER_HOUR
from ohmward.runs import runs

_EPOCH = date(1970, 1, 1).toordinal()
#: Hours [h] that the abbreviation of a time zone is ahead of UTC. CST, IST and BST stand for several zones each.
_ZONE_HOURS = {
    "Z": 0, "UTC": 0, "GMT": 0, "WET": 0, "WEST": 1, "CET": 1, "MEZ": 1, "CEST": 2, "MESZ": 2, "EET": 2, "EEST": 3,
    "MSK": 3, "SAST": 2, "EST": -5, "EDT": -4, "CDT": -5, "MST": -7, "MDT": -6, "PST": -8, "PDT": -7, "AKST": -9,
    "AKDT": -8, "HST": -10, "JST": 9, "KST": 9, "AWST": 8, "ACST": 9.5, "ACDT": 10.5, "AEST": 10, "AEDT": 11,
    "NZST": 12, "NZDT": 13,
}  # fmt: skip
#: Beginnings of the names of months and of weekdays, in English.
MONTHS, _WEEKDAYS = "jan|feb|mar|apr|may|jun|jul|aug|sep|oct|nov|dec", "mon|tue|wed|thu|fri|sat|sun"
#: The offset from UTC or the abbreviation of a zone, no weekday or month, perhaps with another name behind it:
#: `+01:00`, `UTC+1`, `CET`, `+0100 CET`, `+01:00[Europe/Berlin]`, `GMT+0100 (Central European Standard Time)`.
_ZONE = (
    rf"(?:(?:UTC|GMT|Z)?(?P<ahead>[+-]\d{{1,2}}(?::?\d\d)?)|(?P<zone>Z|(?!(?i:{_WEEKDAYS}|{MONTHS}))[A-Z]{{3,5}}))"
    r"(?:\s?\[[^\]]*\]|\s\([^)]*\)|\s[A-Z]{3,5})?(?=$|\s)"
)
_TIME = re.compile(
    r"(?:^|[\sT_,:])(?P<h>\d{1,2})[:h](?P<m>\d\d)(?:[:m](?P<s>\d\d(?:[.,:]\d+)?)s?|m)?"
    rf"\s*(?P<half>[AaPp])?(?(half)\.?[Mm]\.?)(?:\s*{_ZONE}|(?=$|\s))"
)
#: 09.15.00 and 09-15-00 behind a date, in Finnish behind `klo`.
_DOTTED_TIME = re.compile(r"(?<=\d)[\sT_]+(?:klo\s+)?(\d{1,2})([.-])(\d\d)\2(\d\d(?:[.,]\d+)?)$")
_COMPACT = re.compile(r"^(\d{4})(\d\d)(\d\d)[T_ ]?(\d\d)(\d\d)(\d\d(?:[.,]\d+)?)(Z?)$")
_MARK, _NAME = r"\s*[-/.]\s*", rf"(?:{MONTHS})[a-z]*\.?"
#: 2026-03-28, 28.3.26, 28 March 2026, Mar 28
_DAY = re.compile(
    rf"\d{{4}}{_MARK}\d\d?{_MARK}\d\d?|\d\d?{_MARK}\d\d?{_MARK}\d\d(?:\d\d)?"
    rf"|\d\d?[-/\s.]+{_NAME}[-/\s,]+\d\d(?:\d\d)?|{_NAME}\s+\d\d?(?:,?\s+\d{{4}})?",
    re.IGNORECASE,
)
#: Signs of East Asian dates, weekdays and halves of a day: `2026/3/28(土) 午後 3:05:00`, `2026년 3월 28일 9시 5분`.
_SIGNS = str.maketrans("年月日년월일時时시分분秒초", "-- -- :::::  ")
_WEEKDAY_SIGN = re.compile(r"[(（][日月火水木金土一二三四五六일월화수목금토][)）]|星期.|.요일")
_HALF = re.compile(r"上午|午前|오전|(?P<pm>下午|午後|오후)")
#: Year of dates that name none, as those of syslog: it has a 29 February.
_ANY_YEAR = 2000
_WEEKDAY = re.compile(rf"\(?\b(?:{_WEEKDAYS})(?:[a-z]*day)?\b\.?\)?,?", re.IGNORECASE)
#: 0d 00:00:01.00, 0.00:00:01.00, 1 day, 2:03:04, 27:00:00.5
_DURATION = re.compile(
    r"^\s*(?:(?P<d>\d+)(?:\s*d(?:ays?)?,?\s*|\.|\s+))?(?P<h>\d+):(?P<m>\d\d):(?P<s>\d\d(?:[.,]\d*)?)\s*$"
)
_ISO_DURATION = re.compile(r"^\s*P(?:(\d+)D)?(?:T(?:(\d+)H)?(?:(\d+)M)?(?:(\d+(?:\.\d*)?)S)?)?\s*$")
#: Orders of three numbers; with points between them the day is first everywhere, and the year is first only with two
#: digits each.
_ORDERS = ("dmy", "mdy", "ymd")
#: Zero of Excel's serial dates, and their range [d], of the years 1955 to 2118.
_EXCEL_ZERO_S = (date(1899, 12, 30).toordinal() - _EPOCH) * DAY_S
EXCEL_DAYS = (20_000.0, 80_000.0)


class Moment(NamedTuple):
    """A date and time: the day as it is written, seconds of the day, whether they are UTC, a zone that is not known."""

    day: str
    second: float
    is_utc: bool
    zone: str = ""


class Dates(NamedTuple):
    """Dates as seconds."""

    seconds: np.ndarray  #: (T,) since 1970, of UTC or of local clocks; nan for an empty cell
    is_utc: bool  #: they name their zone
    day_known: bool = True  #: it is certain which number is the day and which the month
    year_known: bool = True  #: they name their year
    zone: str = ""  #: abbreviation of a zone that they name and that may stand for several


def from_excel(days: np.ndarray) -> np.ndarray:
    """Seconds since 1970 (T,) of serial dates, rounded to milliseconds."""
    return np.round((days * DAY_S + _EXCEL_ZERO_S) * 1e3) / 1e3


def from_compact(values: np.ndarray) -> np.ndarray | None:
    """Seconds since 1970 (T,) of numbers like 20260328091500; None if any of them is not a date."""
    try:
        return _read_any([f"{value:.0f}" if np.isfinite(value) else "" for value in values]).seconds
    except ValueError:
        return None


def duration_s(cell: str) -> float:
    """Seconds of a duration h:mm:ss, perhaps with days before it, or in ISO 8601; ValueError for another notation."""
    if found := _DURATION.match(cell):
        d, h, m, s = found.group("d", "h", "m", "s")
        return DAY_S * int(d or 0) + 3600.0 * int(h) + 60.0 * int(m) + float(s.replace(",", "."))
    if (found := _ISO_DURATION.match(cell)) and any(found.groups()):
        d, h, m, s = (float(part or 0) for part in found.groups())
        return DAY_S * d + 3600.0 * h + 60.0 * m + s
    raise ValueError(cell)


def has_date(cell: str) -> bool:
    """True where the cell names a day, with or without a time."""
    return can_read(_moment, cell)


def has_time_of_day(cell: str) -> bool:
    """True where the cell names a time, with or without a day."""
    text = _tidied(cell)
    return _TIME.search(text) is not None or _COMPACT.match(text) is not None


def _tidied(cell: str) -> str:
    """The cell without brackets around it, its time with colons; East Asian marks as those of others."""
    text = cell.strip()
    if not text.isascii():
        half = _HALF.search(text)
        text = _HALF.sub(" ", _WEEKDAY_SIGN.sub(" ", text)).translate(_SIGNS).replace(": ", ":").strip(" :")
        text = f"{text} {'pm' if half['pm'] else 'am'}" if half else text
    text = text[1:].removesuffix("]") if text.startswith("[") else text
    return text if ":" in text else _DOTTED_TIME.sub(r" \1:\3:\4", text)


def read_dates(cells: Sequence[str], time_format: str | None = None) -> Dates:
    """Dates of all cells in one notation; ValueError with a cell that is none.

    time_format: a format of `strptime`; None finds the notation from the cells.
    """
    if time_format is not None and time_format != EXCEL:
        parsed = [datetime.strptime(cell.strip(), time_format) if cell.strip() else None for cell in cells]
        return Dates(_timestamps(parsed), "%z" in time_format)
    try:
        moments = [datetime.fromisoformat(cell.strip()) if cell.strip() else None for cell in cells]
    except ValueError:
        return _read_any(cells)
    zones = {moment.tzinfo is not None for moment in moments if moment}
    return Dates(_timestamps(moments), zones == {True})


def _timestamps(moments: Sequence[datetime | None]) -> np.ndarray:
    """Seconds since 1970 (T,), nan for None; a time without a zone is assumed to be UTC."""
    return np.array([np.nan if m is None else (m if m.tzinfo else m.replace(tzinfo=UTC)).timestamp() for m in moments])


def _read_any(cells: Sequence[str]) -> Dates:
    moments = [_moment(cell) if cell.strip() else None for cell in cells]
    known = [moment for moment in moments if moment]
    days = dict.fromkeys(moment.day for moment in known)
    halves = any(re.search(r"[AaPp]\.?[Mm]", cell) for cell in cells[:3])
    number, certain = _day_numbers(list(days), halves, [(moment.day, moment.second) for moment in known])
    seconds = [np.nan if m is None else DAY_S * number[m.day] + m.second for m in moments]
    zone = next((m.zone for m in known if m.zone), "")
    has_year = all(len(re.findall(r"\d+", day)) > 1 for day in days)
    return Dates(np.array(seconds), all(m.is_utc for m in known), certain, has_year, zone)


def _moment(cell: str) -> Moment:
    """Day, as it is written, and time; ValueError for a cell that is not a date."""
    text = _tidied(cell)
    if found := _COMPACT.match(text):
        year, month, day, h, m, s, zone = found.groups()
        return Moment(f"{year}-{month}-{day}", 3600.0 * int(h) + 60.0 * int(m) + float(s.replace(",", ".")), bool(zone))
    second, ahead_h, zone = 0.0, None, ""
    if found := _TIME.search(text):
        second, ahead_h, zone = _second_of_day(found), _hours_ahead(found), found["zone"] or ""
        text = f"{text[: found.start()]} {text[found.end() :]}"
    if not (day := _day(text)):
        raise ValueError(cell)
    if ahead_h is None:
        return Moment(day, second, False, zone)
    return Moment(day, second - SECONDS_PER_HOUR * ahead_h, True)


@lru_cache(4096)
def _day(text: str) -> str:
    """The day in a date without its time, without the weekday; "" if there is none."""
    day = " ".join(_WEEKDAY.sub("", text).replace(",", ", ").split()).strip(" ,T")
    return day if _DAY.fullmatch(day) else ""


def _hours_ahead(found: re.Match[str]) -> float | None:
    """Hours that the zone of a time is ahead of UTC; None if it names none, or one that is not known."""
    if found["ahead"] is None:
        return _ZONE_HOURS.get(found["zone"])
    digits = found["ahead"][1:].replace(":", "")
    size = int(digits) if len(digits) <= 2 else int(digits[:-2]) + int(digits[-2:]) / 60
    return -size if found["ahead"][0] == "-" else size


def _second_of_day(found: re.Match[str]) -> float:
    """Seconds of the day as it is written."""
    hour = int(found["h"])
    if found["half"]:
        if not 1 <= hour <= 12:
            raise ValueError(found[0])
        hour = hour % 12 + 12 * (found["half"] in "Pp")
    if hour > 24:
        raise ValueError(found[0])
    return 3600.0 * hour + 60.0 * int(found["m"]) + float((found["s"] or "0").replace(",", ".").replace(":", "."))


def _day_numbers(
    days: Sequence[str], halves: bool, moments: Sequence[tuple[str, float]]
) -> tuple[dict[str, int], bool]:
    """Number of each day since 1970, and whether day, month and year are certain.

    halves: times are written with AM and PM, which is taken to mean that the month comes first.
    """
    read: dict[str, dict[str, int]] = {}
    for order in _ORDERS:
        with suppress(ValueError):  # a day that does not exist
            read[order] = {day: _day_number(day, order) for day in days}
    if not read:
        raise ValueError(days[0])
    if halves and "mdy" in read:
        return read["mdy"], True
    seconds = {order: [DAY_S * number[day] + second for day, second in moments] for order, number in read.items()}
    step = {order: np.abs(np.diff(of_order)).max(initial=0.0) for order, of_order in seconds.items()}
    best = [order for order in read if step[order] == min(step.values())]
    first = read[best[0]]
    return first, all(read[order] == first for order in best)


@lru_cache(4096)
def _day_number(text: str, order: str) -> int:
    """Number of a day since 1970; order: of three numbers of which none has four digits."""
    parts = [*re.findall(r"\d+|[a-z]+", text.lower()), str(_ANY_YEAR)][:3]
    if len(parts[0]) == 4:
        order = "ymd"
    elif not parts[0].isdecimal() or not parts[1].isdecimal():
        order = "dmy" if parts[0].isdecimal() else "mdy"
    elif (order == "ymd" and not re.fullmatch(r"\d\d([-/])\d\d\1\d\d", text)) or (order == "mdy" and "." in text):
        raise ValueError(text)
    of = dict(zip(order, parts, strict=True))
    year, day = int(of["y"]), int(of["d"])
    month = int(of["m"]) if of["m"].isdecimal() else MONTHS.split("|").index(of["m"][:3]) + 1
    return date(year + 2000 * (year < 100), month, day).toordinal() - _EPOCH


def unreadable(source: str, place: str, column: str, cell: str, first: str) -> InputError:
    """The error for a cell that is not a time."""
    like = "" if cell == first else f" like {first!r}"
    return InputError(
        f"{source}, {place}, column {column!r}: {cell!r} is not a time{like}; write seconds or ISO 8601 "
        f"(2026-01-31T12:00:00.5Z), or say how it is written with --time-format '{format_of(first)}' "
        "(FileHints(time_format=...))"
    )


def format_of(cell: str) -> str:
    """Probable format of a date for `strptime`, with the day before the month where both are possible."""
    text = cell.strip()
    for pattern, directives in _DIRECTIVES:
        text = pattern.sub(directives, text, count=1)
    return text if "%d" in text and not any(c.isdigit() for c in text) else "%d.%m.%Y %H:%M:%S"


#: Parts of a date and of a time, and their directives in `strptime`.
_DIRECTIVES = (
    (re.compile(r"\d{4}([-./])\d{1,2}\1\d{1,2}"), r"%Y\1%m\1%d"),
    (re.compile(r"\d{1,2}([-./])\d{1,2}\1\d{4}"), r"%d\1%m\1%Y"),
    (re.compile(r"\d{1,2}([-./])\d{1,2}\1\d{2}\b"), r"%d\1%m\1%y"),
    (re.compile(r"\d{1,2}:\d\d:\d\d"), "%H:%M:%S"),
    (re.compile(r"\d{1,2}:\d\d"), "%H:%M"),
    (re.compile(r"(?<=%S)([.,:])\d+"), r"\1%f"),
)


def text_of(seconds: float) -> str:
    """Seconds since 1970 as a date for a message."""
    return f"{datetime(1970, 1, 1) + timedelta(seconds=round(seconds)):%Y-%m-%d %H:%M:%S}"


#: Zones whose clocks change for daylight saving at different times.
_CHANGING = (
    "Europe/London", "Europe/Berlin", "Europe/Athens", "America/New_York", "America/Chicago", "America/Denver",
    "America/Los_Angeles", "Australia/Sydney",
)  # fmt: skip
#: Offsets change at full quarters of an hour.
_QUARTER_S = 900.0
#: Tolerance [s] of a step that is an hour longer or shorter than usual, where a change of clocks is looked for.
_ABOUT_S = 120.0


def to_utc(local_s: np.ndarray, timezone: str) -> np.ndarray:
    """Convert times (T,) of local clocks to seconds since 1970 in UTC; nan stays.

    In an hour that occurs twice, the rows from the fall of the time on belong to its second occurrence.
    """
    zone = zone_of(timezone)
    known = np.isfinite(local_s)
    quarter, at = np.unique(np.floor(local_s[known] / _QUARTER_S), return_inverse=True)
    offsets = np.array([[_offset_s(zone, q * _QUARTER_S, fold) for fold in (0, 1)] for q in quarter]).reshape(-1, 2)
    early, late = offsets[at, 0], offsets[at, 1]
    twice = early > late
    utc_s = local_s[known] - early
    falls = np.concatenate([[0.0], np.diff(local_s[known])]) < 0
    second = np.zeros(twice.size, dtype=bool)
    for first, stop in runs(twice):
        fallen = np.flatnonzero(falls[first:stop])
        if fallen.size:
            second[first + fallen[0] : stop] = True
    utc_s[second] = local_s[known][second] - late[second]
    found = np.full(local_s.size, np.nan)
    found[known] = utc_s
    return found


def require_no_change(source: str, column: str, local_s: np.ndarray) -> None:
    """Refuse dates without a zone that skip or repeat an hour where the clocks of some zone are changed.

    local_s: (T,) [s] as written.
    """
    known = local_s[np.isfinite(local_s)]
    steps = np.diff(known)
    usual = float(np.median(np.abs(steps))) if steps.size else 0.0
    for k in np.flatnonzero(np.abs(np.abs(steps - usual) - SECONDS_PER_HOUR) <= _ABOUT_S):
        before, after = float(known[k]), float(known[k + 1])
        for name in _CHANGING:
            if _changes(ZoneInfo(name), before, after):
                what = "from which clocks are put forward" if after > before else "at which clocks are put back"
                raise InputError(
                    f"{source}: column {column!r} goes from {text_of(before)} to {text_of(after)}, {what} in the zone "
                    f"of {name}; say the zone with --timezone {name} (FileHints(timezone={name!r})), or "
                    "--timezone UTC where the clock is never changed"
                )


def _changes(zone: ZoneInfo, before_s: float, after_s: float) -> bool:
    """True if clocks of the zone skip or repeat the hour between two readings."""
    if after_s > before_s:
        first = np.ceil(before_s / _QUARTER_S + 1e-9) * _QUARTER_S
        return _offset_s(zone, first, 0) < _offset_s(zone, first, 1)
    return _offset_s(zone, after_s, 0) > _offset_s(zone, after_s, 1)


def _offset_s(zone: ZoneInfo, local_s: float, fold: int) -> float:
    moment = datetime(1970, 1, 1, tzinfo=zone) + timedelta(seconds=float(local_s))
    offset = moment.replace(fold=fold).utcoffset()
    return offset.total_seconds() if offset else 0.0


def window_s(name: str, start_unix_s: float | None, hints: FileHints) -> tuple[float, float] | None:
    """Start and stop [s] on the clock of a log; None if all of it is wanted.

    name: of the log, for messages.  start_unix_s: Unix time of the clock's zero, None where it is not known.

    Raises:
        InputError: not a time, or a date for a log whose date is not known.
    """
    if hints.start is None and hints.stop is None:
        return None
    start = -math.inf if hints.start is None else _on_clock(name, "--from", hints.start, start_unix_s, hints)
    stop = math.inf if hints.stop is None else _on_clock(name, "--to", hints.stop, start_unix_s, hints)
    if start >= stop:
        raise InputError(f"--from {hints.start} must be before --to {hints.stop}")
    return start, stop


def _on_clock(name: str, option: str, text: str, start_unix_s: float | None, hints: FileHints) -> float:
    for read in (float, duration_s):
        with suppress(ValueError):
            if math.isfinite(value := read(text)):
                return value
    try:
        dates = read_dates([text], hints.time_format)
    except ValueError:
        raise InputError(
            f"{option} must be seconds of the log (3600), h:mm:ss, or a date (2026-01-31T12:00); got {text!r}"
        ) from None
    if start_unix_s is None:
        raise InputError(f"{option} {text}: log {name!r} names no date; give seconds from its start, or h:mm:ss")
    seconds = dates.seconds
    if hints.timezone and not dates.is_utc:
        seconds = to_utc(seconds, hints.timezone)
    return float(seconds[0]) - start_unix_s
