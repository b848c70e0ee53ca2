"""A time column in any notation, as seconds."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.cells import are_words
from ohmward.logs.channels import TIME, letters
from ohmward.logs.columns import Column, fraction_column
from ohmward.logs.dates import (
    DAY_S,
    EXCEL_DAYS,
    Dates,
    duration_s,
    format_of,
    from_compact,
    from_excel,
    has_date,
    has_time_of_day,
    read_dates,
    require_no_change,
    text_of,
    to_utc,
    unreadable,
)
from ohmward.logs.hints import EXCEL, FileHints
from ohmward.logs.table import Note, Table, TableFile, can_read, held, number, numbers
from ohmward.logs.units import UNITS

# Unix times of the years 2000 to 2100; an elapsed time of 30 years does not occur in a log.
_UNIX_S = (946_684_800.0, 4_102_444_800.0)
#: Numbers like 20260328091500.
_COMPACT = (2.0e13, 2.1e13)
#: A time of day that falls by more than this has passed midnight.
_OVER_MIDNIGHT_S = 0.9 * DAY_S
#: 14:03 and 00:14, of hours and minutes or of minutes and seconds.
_TWO_NUMBERS = re.compile(r"^\s*\d+:\d\d(?:[.,]\d+)?\s*$")
_HOURS_OF_DAY = 24
#: A clock that jumps by at least this was set.
_SET_FROM_S = 365.0 * DAY_S
#: Largest interval of serial dates, 100 s in days; read as seconds it would be about 1 ms.
_SERIAL_STEP = 100.0 / DAY_S

#: Ranges of counters: 16 and 32 bits, and 32 bits of milliseconds or microseconds as seconds. Largest deviation of the
#: step over the end of the range, as a share of the usual step.
_RANGES = (2.0**16, 2.0**32, 1e-3 * 2.0**32, 1e-6 * 2.0**32)
_USUAL_STEP = 0.6


#: Names of columns of the parts of a date and of a time of day.
_DATE_PARTS = (("year", "yr"), ("month", "mon"), ("day",))
_TIME_PARTS = (("hour", "hours", "hr", "h"), ("minute", "minutes", "min"), ("second", "seconds", "sec"))
_JOINED = "time of its parts [s]"


class Clock(NamedTuple):
    """Seconds of each row."""

    #: (T,) float64 [s], NaN where the row has none
    time_s: np.ndarray
    start_unix_s: float | None  #: Unix time of its zero, None if elapsed
    notes: tuple[Note, ...] = ()
    guessed_unit: bool = False  #: the column names no unit, and is no Unix time
    time_zone: str = "UTC"  #: of a wall clock's dates, "" where they name none and are assumed to be UTC


def with_joined_time(file: TableFile) -> TableFile:
    """The file with the time from columns of hours, minutes and seconds, and of a date, if it has no other time."""
    lower = {name.strip().lower(): name for name in file.names}
    date, of_day = (
        [next((lower[w] for w in words if w in lower), "") for words in part] for part in (_DATE_PARTS, _TIME_PARTS)
    )
    others = set(file.names) - {*date, *of_day}
    if not all(of_day) or file.time or any(_TIME_WORDS & set(letters(name)) for name in others):
        return file
    sources = [*date, *of_day] if all(date) else of_day

    def join(table: Table) -> tuple[np.ndarray, Note]:
        *days, hours, minutes, seconds = (numbers(table, name) for name in sources)
        time_s = 3600.0 * hours + 60.0 * minutes + seconds
        if days:
            time_s += DAY_S * _days(*days)
        else:
            time_s = _over_midnight(Column(_JOINED, None), time_s).time_s
        return time_s, Note(f"time joined from {', '.join(map(repr, sources))}")

    return file.with_column(_JOINED, sources, join)._replace(time=_JOINED)


def _days(years: np.ndarray, months: np.ndarray, days: np.ndarray) -> np.ndarray:
    """Days since 1970 of dates (T,), NaN where a part is missing; years of two digits are of this century."""
    known = np.isfinite(years + months + days)
    year, month, day = (np.where(known, part, 1).astype(int) for part in (years, months, days))
    first = (12 * (np.where(year < 100, year + 2000, year) - 1970) + month - 1).astype("M8[M]").astype("M8[D]")
    return np.where(known, first.astype(float) + day - 1, np.nan)


def date_column(file: TableFile, name: str) -> str | None:
    """The column of the dates for the times of day in `name`, or of the times of day for its dates, or None."""
    cells = [cell for cell in file.head.get(name, ()) if cell.strip()]
    if not cells or has_date(cells[0]) == has_time_of_day(cells[0]):
        return None
    is_day = has_date(cells[0])
    others = [n for n in file.head if n != name and "step" not in letters(n) and _are_parts(file.head[n], not is_day)]
    return next((n for n in others if _TIME_WORDS & set(letters(n))), next(iter(others), None))


_TIME_WORDS = frozenset(word for words in TIME.words for word in words) | {"hour", "day", "clock"}


def _are_parts(cells: Sequence[str], of_days: bool) -> bool:
    """True where all cells are days without a time (of_days), or times of day without a day."""
    filled = [cell for cell in cells if cell.strip()]
    return bool(filled) and all(has_date(c) == of_days and has_time_of_day(c) != of_days for c in filled)


def read_clock(table: Table, column: Column, hints: FileHints | None = None, date: str | None = None) -> Clock:
    """Seconds from elapsed time, Unix time (s, ms, us or ns, by magnitude), dates, h:mm:ss, durations.

    Wall clocks become seconds since their first sample; elapsed times keep the file's own zero.

    date: the column from `date_column`.

    Raises:
        InputError: a cell is neither a number nor a date; names the line. Serial dates, or a clock change for daylight
            saving, that the user must explain.
    """
    return _with_checked_date(_set_at_boot(_read_clock(table, column, hints or FileHints(), date), column.name))


def _with_checked_date(clock: Clock) -> Clock:
    """Leave out a date before 2000, with a note: that of a clock that was never set, which logs of one boot share.

    A date in the future is only named: the clock of this computer may be the wrong one.
    """
    time_s = clock.time_s + (clock.start_unix_s or 0.0)
    if clock.start_unix_s is None or not np.isfinite(time_s).any():
        return clock
    begin = np.datetime64(0, "s") + int(np.fmin.reduce(time_s))
    if np.fmin.reduce(time_s) > time.time() + DAY_S:
        text = f"the first date is {begin}: in the future by the clock of this computer; which of the two is wrong?"
        return clock._replace(notes=(*clock.notes, Note(text, "warning")))
    if not np.fmin.reduce(time_s) < _UNIX_S[0]:
        return clock
    text = f"the first date is {begin}: before 2000, as of a clock that was not set, so the date is left out"
    return clock._replace(time_s=time_s, start_unix_s=None, notes=(*clock.notes, Note(text, "warning")))


def _set_at_boot(clock: Clock, name: str) -> Clock:
    """Remove the jump of a clock that was set within a day of its start, with a note.

    Such a clock starts at a New Year, or before 2000. The rows before the jump end a usual interval before the others.
    """
    if not np.fmax.reduce(clock.time_s) - np.fmin.reduce(clock.time_s) >= _SET_FROM_S:
        return clock
    known = np.flatnonzero(np.isfinite(clock.time_s))
    steps = np.diff(clock.time_s[known])
    if steps.max() < _SET_FROM_S:
        return clock
    last = int(np.argmax(steps))
    begin_s, end_s = clock.time_s[known[0]], clock.time_s[known[last]]
    begin_unix_s = begin_s + (clock.start_unix_s or 0.0)
    if not 0.0 <= begin_unix_s <= _UNIX_S[1]:
        return clock
    begin = np.datetime64(0, "s") + int(begin_unix_s)
    since_new_year_s = (begin - begin.astype("M8[Y]").astype("M8[s]")) / np.timedelta64(1, "s")
    jump_s = float(steps[last] - np.median(steps))
    start_unix_s = (clock.start_unix_s or 0.0) + jump_s
    began_unset = since_new_year_s <= 2 * DAY_S or begin_unix_s < _UNIX_S[0]
    if end_s - begin_s > DAY_S or not began_unset or not _is_unix(start_unix_s):
        return clock
    time_s = clock.time_s.copy()
    time_s[known[last + 1] :] -= jump_s
    text = (
        f"column {name!r}: the clock jumps by {jump_s / (365.25 * DAY_S):.1f} years after {end_s - begin_s:g} s: set "
        f"after the start at {begin}; the rows before are joined to those after it"
    )
    return clock._replace(
        time_s=time_s,
        start_unix_s=start_unix_s,
        notes=(*clock.notes, Note(text, "warning")),
        guessed_unit=False,
    )


def _read_clock(table: Table, column: Column, hints: FileHints, date: str | None) -> Clock:
    """The clock as it stands in the file; see `read_clock`."""
    values = table.columns[column.name]
    if date is not None and date in table.columns and values.dtype == object:
        values = _joined(values, table.columns[date])
    if fraction := fraction_column(tuple(table.columns), column.name):
        name, unit_ns = fraction
        values = _with_nanoseconds(numbers(table, column.name), unit_ns * numbers(table, name))
    if values.dtype.kind in "mM":
        clock = clock_of_dates(values)
        if values.dtype.kind == "M" and are_whole_days(values):
            _require_one_row_a_day(table, column, clock.time_s)
        return clock
    if values.dtype == object:
        return _from_text(table, column, values, hints)
    return _from_numbers(table, column, values, hints)


def are_whole_days(dates: np.ndarray) -> bool:
    """True for datetime64 values (T,) that have no time of day."""
    known = dates[~np.isnat(dates)]
    if np.any(known[:1] != known[:1].astype("M8[D]")):  # nearly always so: the others need no check
        return False
    return bool(np.all(known == known.astype("M8[D]")))


def _with_nanoseconds(seconds: np.ndarray, nanoseconds: np.ndarray) -> np.ndarray:
    """Times (T,) as datetime64 from whole seconds and nanoseconds, NaT where one is missing or not a time."""
    known = (np.abs(nanoseconds) < 1e10) & (np.abs(seconds) < _UNIX_S[1])
    stamps = np.full(seconds.size, "NaT", "M8[ns]")
    whole = seconds[known].astype(np.int64) * 1_000_000_000 + nanoseconds[known].astype(np.int64)
    stamps[known] = whole.view("M8[ns]")
    return stamps


def _joined(values: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Date and time (T,) joined from two columns."""
    pairs = zip(values, others, strict=True)
    first = next((str(value) for value in values if str(value).strip()), "")
    parts = (((b, a) if has_time_of_day(first) else (a, b)) for a, b in pairs)
    return np.array([f"{day} {time}" if str(day).strip() and str(time).strip() else "" for day, time in parts], object)


def clock_of_dates(values: np.ndarray) -> Clock:
    """Seconds since the first of the datetime64 values (T,), or the seconds of timedelta64 values (T,)."""
    known = ~np.isnat(values)
    if values.dtype.kind == "m":
        return Clock(values / np.timedelta64(1, "s"), None)
    nanoseconds = values.astype("datetime64[ns]", copy=False).view(np.int64)
    start = int(nanoseconds[np.argmax(known)]) if known.any() else 0
    return Clock(np.where(known, (nanoseconds - start) * 1e-9, np.nan), start * 1e-9)


def _from_numbers(table: Table, column: Column, values: np.ndarray, hints: FileHints) -> Clock:
    known = np.isfinite(values)
    first = values[np.argmax(known)] if known.any() else 0
    if hints.time_format == EXCEL or (column.unit is None and _are_serial(table, column, values[known])):
        return _from_dates(table, column, Dates(from_excel(values), False), hints, "serial dates of Excel")
    if column.unit is None and _COMPACT[0] < first < _COMPACT[1] and (seconds := from_compact(values)) is not None:
        return _from_dates(table, column, Dates(seconds, False), hints, "dates")
    last = values[known][-1] if known.any() else 0  # of a clock that was set while it ran
    units = [UNITS[u] for value in (first, last) for u in ("s", "ms", "us", "ns") if _is_unix(value * UNITS[u].scale)]
    unit = column.unit or next(iter(units), None)
    notes: tuple[Note, ...] = ()
    if unit is None:
        unit = UNITS["s"]
        notes = (Note(f"column {column.name!r} names no unit: assumed to be seconds"),)
    if not _is_unix(first * unit.scale):
        values, wrapped = _without_wraps(values, column.name)
        return Clock(_scaled(values, unit.scale), None, (*notes, *wrapped), column.unit is None)
    if column.unit is None:
        notes = (Note(f"column {column.name!r} read as Unix time in {unit.symbol}"),)
    return Clock(_scaled(values - first, unit.scale), float(first * unit.scale), notes)


def _without_wraps(values: np.ndarray, name: str) -> tuple[np.ndarray, tuple[Note, ...]]:
    """Times (T,) of a counter that goes on where it began again at 0, and a note if it did.

    Everywhere that it falls, the range of the counter added makes the usual step, as it would not if the logger had
    been restarted.
    """
    if not np.any(values[1:] < values[:-1]):  # nearly always so
        return values, ()
    known = np.flatnonzero(np.isfinite(values))
    steps = np.diff(values[known].astype(float))
    falls = steps < 0.0
    if not (steps > 0.0).any():
        return values, ()
    usual = np.median(steps[steps > 0.0])
    for counts in _RANGES:
        if np.all(np.abs(steps[falls] + counts - usual) <= _USUAL_STEP * usual):
            added = np.zeros(values.size)
            added[known[1:][falls]] = counts
            note = Note(f"column {name!r}: a counter that begins again after {counts:.10g}: joined", "warning")
            return values + np.cumsum(added), (note,)
    return values, ()


def _are_serial(table: Table, column: Column, values: np.ndarray) -> bool:
    """True for days since 1899 in a column that is called a date; InputError where they may be seconds."""
    if not values.size or not (values.min() > EXCEL_DAYS[0] and values.max() < EXCEL_DAYS[1]):
        return False
    steps = np.abs(np.diff(values.astype(float)))
    rising = steps[steps > 0]
    if not rising.size or np.median(rising) > _SERIAL_STEP:
        return False
    if {"date", "datum"} & set(letters(column.name)):
        return True
    raise InputError(
        f"{table.source}: column {column.name!r} runs from {values[0]:.6f} in steps of {np.median(rising):.3g}: serial "
        "dates of Excel, or seconds? say --time-format excel (FileHints(time_format='excel')) or --unit time=s"
    )


def _scaled(values: np.ndarray, scale: float) -> np.ndarray:
    if scale == 1.0:
        return values.astype(float, copy=False)
    with np.errstate(over="ignore"):  # an infinite result is not a time
        return values * scale


def _is_unix(seconds: float) -> bool:
    return _UNIX_S[0] <= seconds <= _UNIX_S[1]


def _from_text(table: Table, column: Column, values: np.ndarray, hints: FileHints) -> Clock:
    values = np.where(are_words(values), "", values)  # as of a row `Average` below the others
    first = next((cell for cell in values if cell.strip()), "")
    if hints.time_format is None and can_read(number, first):
        return _from_numbers(table, column, numbers(table, column.name), hints)
    if hints.time_format is None and _TWO_NUMBERS.match(first):
        return _of_two_numbers(table, column, values, hints)
    if hints.time_format is None and can_read(duration_s, first):
        return _over_midnight(column, _each(table, column, values, duration_s, first))
    if hints.time_format is None and has_time_of_day(first) and not has_date(first):
        return _times_of_day(table, column, values, first, hints)
    return _from_dates(table, column, _dates(table, column, values, first, hints), hints, "dates", first)


def _times_of_day(table: Table, column: Column, values: np.ndarray, first: str, hints: FileHints) -> Clock:
    days = [f"1970-01-01 {cell}" if cell.strip() else "" for cell in values]
    return _over_midnight(column, _dates(table, column, days, first, hints).seconds)


def _of_two_numbers(table: Table, column: Column, values: np.ndarray, hints: FileHints) -> Clock:
    """Seconds of hours and minutes, or of minutes and seconds if the first number exceeds the hours of a day.

    If it does not, a log from 0:00 on in steps of one may be either, and is refused.
    """
    first = next(cell for cell in values if cell.strip())
    if any(_TWO_NUMBERS.match(cell) is None for cell in values if cell.strip()):
        return _times_of_day(table, column, values, first, hints)
    pairs = np.array([cell.replace(",", ".").split(":") if cell.strip() else ("nan", "nan") for cell in values], float)
    if np.nanmax(pairs[:, 0]) >= _HOURS_OF_DAY:
        note = Note(f"column {column.name!r} read as minutes and seconds")
        return Clock(pairs @ (60.0, 1.0), None, (note,))
    steps = np.diff(pairs @ (60.0, 1.0))
    if not pairs[0].any() and steps.size > 1 and np.all(steps == 1.0):
        raise InputError(
            f"{table.source}: column {column.name!r} runs from {first} to {values[-1]} in steps of one: hours and "
            "minutes, or minutes and seconds? say --time-format '%H:%M' or --time-format '%M:%S' "
            "(FileHints(time_format=...))"
        )
    return _times_of_day(table, column, values, first, hints)


def _dates(table: Table, column: Column, cells: Any, first: str, hints: FileHints) -> Dates:
    try:
        return read_dates(cells, hints.time_format)
    except (ValueError, OverflowError):
        _each(table, column, cells, lambda cell: float(read_dates([cell], hints.time_format).seconds[0]), first)
        raise unreadable(table.source, table.place, column.name, str(first), "others in it") from None


def _each(table: Table, column: Column, cells: Any, read: Callable[[str], float], first: str) -> np.ndarray:
    """Read the cells (T,) one by one; InputError for the first that is not a time."""
    seconds = np.empty(len(cells))
    for row, cell in enumerate(cells):
        try:
            seconds[row] = read(cell) if cell.strip() else np.nan
        except (ValueError, OverflowError):
            place = f"{table.place} {table.line[row]}"
            raise unreadable(table.source, place, column.name, cell.removeprefix("1970-01-01 "), first) from None
    return seconds


def _over_midnight(column: Column, seconds: np.ndarray) -> Clock:
    """Seconds of durations, or of times of day, which go on to the next day where they fall by almost a day."""
    days = np.cumsum(np.diff(held(seconds), prepend=np.nan) < -_OVER_MIDNIGHT_S)
    if not days.any() or np.nanmax(seconds) >= DAY_S:
        return Clock(seconds, None)
    note = Note(f"column {column.name!r} holds times of day: it goes over midnight", "warning")
    return Clock(seconds + DAY_S * days, None, (note,))


def _require_one_row_a_day(table: Table, column: Column, seconds: np.ndarray) -> None:
    """Raise InputError where days without a time (T,) [s] have several rows."""
    known = seconds[np.isfinite(seconds)]
    if np.unique(known).size < known.size:
        raise InputError(
            f"{table.source}: column {column.name!r} names the day alone, and {table.place}s share one; name the "
            "column of the time of day with --column time=NAME (columns={'time': NAME}), or give the interval between "
            "rows with --sample-time 1 (FileHints(sample_time_s=1))"
        )


def _from_dates(table: Table, column: Column, dates: Dates, hints: FileHints, what: str, first: object = None) -> Clock:
    """Seconds since the first of dates, which are UTC, in the zone of the hints, or assumed to be UTC."""
    seconds = dates.seconds
    if isinstance(first, str) and not has_time_of_day(first):
        _require_one_row_a_day(table, column, seconds)
    if dates.zone and hints.timezone is None:
        raise InputError(
            f"{table.source}: column {column.name!r} names the time zone {dates.zone!r}, which may be one of several; "
            "say which with --timezone, as --timezone Asia/Kolkata (FileHints(timezone=...))"
        )
    zone, time_zone = "", "UTC"
    if not dates.is_utc and hints.timezone:
        seconds = to_utc(seconds, hints.timezone)
        zone, time_zone = f", of {hints.timezone}", hints.timezone
    elif not dates.is_utc:
        require_no_change(table.source, column.name, seconds)
        zone, time_zone = "; no time zone given, UTC assumed", ""
    known = seconds[np.isfinite(seconds)]
    start = float(known[0]) if known.size else 0.0
    excerpt = str(first if first is not None else text_of(start)).strip()
    note = Note(f"column {column.name!r} read as {what}: time counts from {excerpt}{zone}")
    if dates.day_known and dates.year_known:
        return Clock(seconds - start, start, (note,), time_zone=time_zone)
    why = "names no year"
    fix = ""
    if not dates.day_known:
        why = "may name the day or the month first"
        fix = f"; say it with --time-format '{format_of(excerpt)}' (FileHints(time_format=...))"
    unsure = Note(f"column {column.name!r}: {excerpt} {why}, so the date is left out{fix}", "warning")
    return Clock(seconds - start, None, (unsure,))
