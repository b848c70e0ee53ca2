"""Notations of time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from datetime import UTC, datetime, timedelta
from zoneinfo import ZoneInfo

from logs.formats.known import LOG, NIGHT, Format, Known, known_log, lines, rows_of, text_file

FAMILY = "time"
REST = ("current_A", "voltage_V", "temperature_degC")
LATE = known_log(NIGHT)
BERLIN = ZoneInfo("Europe/Berlin")
#: Local clocks jump from 02:00 to 03:00, and back from 03:00 to 02:00.
SPRING, AUTUMN = (known_log(datetime(2026, *day, 0, 58, tzinfo=UTC)) for day in ((3, 29), (10, 25)))


def dated(
    name: str,
    write: Callable[[datetime], str],
    known: Known = LOG,
    column: str = "timestamp",
    flags: tuple[str, ...] = (),
    mark: str = ",",
    wall: bool = True,
) -> Format:
    rows = rows_of(known, lambda t, i, u, c, at: (write(at), i, u, c))
    return Format(name, FAMILY, text_file("log.csv", lines((column, *REST), rows, mark)), known, flags, wall)


def timed(name: str, column: str, write: Callable[[float], object], flags: tuple[str, ...] = ()) -> Format:
    rows = rows_of(LOG, lambda t, i, u, c, at: (write(t), i, u, c))
    return Format(name, FAMILY, text_file("log.csv", lines((column, *REST), rows)), LOG, flags)


def two(name: str, names: Sequence[str], dates: str, times: str, known: Known) -> Format:
    rows = rows_of(known, lambda t, i, u, c, at: (at.strftime(dates), at.strftime(times), i, u, c))
    return Format(name, FAMILY, text_file("log.csv", lines((*names, *REST), rows)), known, dated=True)


def as_(form: str) -> Callable[[datetime], str]:
    return lambda at: at.strftime(form)


def local(form: str) -> Callable[[datetime], str]:
    return lambda at: at.astimezone(BERLIN).strftime(form)


def ahead(hours: float, form: str) -> Callable[[datetime], str]:
    return lambda at: (at + timedelta(hours=hours)).strftime(form)


def serial(at: datetime) -> str:
    return f"{(at - datetime(1899, 12, 30, tzinfo=UTC)) / timedelta(days=1):.10f}"


def epoch(scale: float) -> Callable[[datetime], str]:
    return lambda at: str(round(at.timestamp() * scale))


def clock(seconds: float, before: str = "") -> str:
    minutes, s = divmod(seconds, 60)
    hours, m = divmod(int(minutes), 60)
    return f"{before}{hours:02d}:{m:02d}:{s:05.2f}"


SHORT = known_log(datetime(2026, 5, 3, 9, 15, tzinfo=UTC))
OVER_MIDNIGHT = known_log(datetime(2026, 5, 3, 23, 58, tzinfo=UTC))
MARCH = known_log(datetime(2026, 3, 31, 23, 58, tzinfo=UTC))
US = "%m/%d/%Y %I:%M:%S %p"

TIMES = (
    dated("ISO 8601 with Z", as_("%Y-%m-%dT%H:%M:%SZ")),
    dated("ISO 8601 with a zone", lambda at: at.astimezone(BERLIN).isoformat()),
    dated("ISO 8601 with a decimal comma", as_("%Y-%m-%d %H:%M:%S,000"), mark=";"),
    dated("2026-03-28 09:15:00", as_("%Y-%m-%d %H:%M:%S")),
    dated("2026-03-28 09:15:00 UTC", as_("%Y-%m-%d %H:%M:%S UTC")),
    dated("20260328T091500", as_("%Y%m%dT%H%M%S")),
    dated("20260328091500", as_("%Y%m%d%H%M%S")),
    dated("2026/03/28 09:15:00", as_("%Y/%m/%d %H:%M:%S")),
    dated("2026.03.28 09:15:00", as_("%Y.%m.%d %H:%M:%S")),
    dated("28.03.2026 09:15:00", as_("%d.%m.%Y %H:%M:%S"), mark=";"),
    dated("28.03.26 09:15:00", as_("%d.%m.%y %H:%M:%S")),
    dated("26-03-28 09:15:00, over midnight", as_("%y-%m-%d %H:%M:%S"), LATE, wall=False),
    dated("31/03/26 09:15:00, over midnight", as_("%d/%m/%y %H:%M:%S"), MARCH, wall=False),
    dated("28/03/2026 09:15:00", as_("%d/%m/%Y %H:%M:%S")),
    dated("28-03-2026 09:15:00", as_("%d-%m-%Y %H:%M:%S")),
    dated("03/28/2026 09:15:00 AM", as_(US)),
    dated("3/28/26 9:15 AM with seconds", lambda at: at.strftime("%-m/%-d/%y %-I:%M:%S %p")),
    dated("03/05/2026, day or month first, over midnight", as_("%d/%m/%Y %H:%M:%S"), OVER_MIDNIGHT),
    dated("03/05/2026, day or month first, one day", as_("%d/%m/%Y %H:%M:%S"), SHORT, wall=False),
    dated("05/03/2026 with AM and PM", as_(US), SHORT),
    dated("28-Mar-2026 09:15:00", as_("%d-%b-%Y %H:%M:%S")),
    dated("28 March 2026 09:15:00", as_("%d %B %Y %H:%M:%S")),
    dated("Mar 28, 2026 9:15:00 AM", lambda at: '"' + at.strftime("%b %d, %Y %I:%M:%S %p") + '"'),
    dated("Sat Mar 28 09:15:00 2026", as_("%a %b %d %H:%M:%S %Y")),
    dated("Sat Mar 28 10:15:00 CET 2026", lambda at: at.astimezone(BERLIN).strftime("%a %b %d %H:%M:%S %Z %Y")),
    dated("Sat 2026-03-28 09:15:00", as_("%a %Y-%m-%d %H:%M:%S")),
    dated("2026-03-28 (Sat) 09:15:00", as_("%Y-%m-%d (%a) %H:%M:%S")),
    dated("2026-10-25 CEST and CET", local("%Y-%m-%d %H:%M:%S %Z"), AUTUMN),
    dated("03/28/2026 04:15:00 AM EST", ahead(-5, US + " EST")),
    dated("2026-03-28 14:45:00 IST", ahead(5.5, "%Y-%m-%d %H:%M:%S IST"), flags=("--timezone", "Asia/Kolkata")),
    dated("2026-03-28 10:15:00 UTC+1", ahead(1, "%Y-%m-%d %H:%M:%S UTC+1")),
    dated("2026-03-28T10:15:00+01:00[Europe/Berlin]", ahead(1, "%Y-%m-%dT%H:%M:%S+01:00[Europe/Berlin]")),
    dated("Sat Mar 28 2026 10:15:00 GMT+0100 (CET)", ahead(1, "%a %b %d %Y %H:%M:%S GMT+0100 (CET)")),
    dated("Mar 28 09:15:00 of syslog", as_("%b %d %H:%M:%S"), wall=False),
    dated("[28/Mar/2026:09:15:00 +0000]", as_("[%d/%b/%Y:%H:%M:%S +0000]")),
    dated("28.03.2026 09h15m00s", as_("%d.%m.%Y %Hh%Mm%Ss")),
    dated("28.03.2026 09.15.00", as_("%d.%m.%Y %H.%M.%S")),
    dated("2026-03-28_09-15-00", as_("%Y-%m-%d_%H-%M-%S")),
    dated("09:15:00 28/03/2026", as_("%H:%M:%S %d/%m/%Y")),
    dated("2026年03月28日 09:15:00", as_("%Y年%m月%d日 %H:%M:%S")),
    dated("2026년 3월 28일 09시 15분 00초", lambda at: f"{at:%Y}년 {at.month}월 {at.day}일 {at:%H시 %M분 %S초}"),
    dated("2026/03/28(土) 午前 09:15:00", as_("%Y/%m/%d(土) 午前 %I:%M:%S")),
    dated("2026-087 09:15:00, day of the year", as_("%Y-%j %H:%M:%S"), flags=("--time-format", "%Y-%j %H:%M:%S")),
    two("date and time in two columns", ("Date", "Time"), "%d.%m.%Y", "%H:%M:%S", LATE),
    two("date and time in two columns, US", ("DATE", "TIME"), "%m/%d/%Y", "%I:%M:%S %p", LATE),
    two("date and time of day in two columns", ("date", "time of day"), "%Y-%m-%d", "%H:%M:%S", LATE),
    dated("time of day over midnight", as_("%H:%M:%S"), LATE, "time", wall=False),
    dated("serial dates of Excel", serial, column="Date"),
    dated("serial dates of Excel in a column named time", serial, column="Time", flags=("--time-format", "excel")),
    dated("Unix time in s", epoch(1)),
    dated("Unix time in ms", epoch(1e3)),
    dated("Unix time in us", epoch(1e6)),
    dated("Unix time in ns", epoch(1e9)),
    dated("local time, clocks go forward", local("%Y-%m-%d %H:%M:%S"), SPRING, flags=("--timezone", "Europe/Berlin")),
    dated("local time, clocks go back", local("%d.%m.%Y %H:%M:%S"), AUTUMN, flags=("--timezone", "Europe/Berlin")),
    timed("hh:mm:ss since the start", "time", clock),
    timed("0d 00:00:01.00", "time", lambda t: clock(t, "0d ")),
    timed("0.00:00:01.00 of .NET", "time", lambda t: clock(t, "0.")),
    timed("P0DT0H0M1S of ISO 8601", "time", lambda t: f"PT{t:g}S"),
    timed("ms, named", "time_ms", lambda t: round(1e3 * t)),
    timed("millis of Arduino", "millis", lambda t: round(1e3 * t) + 5210),
    timed("ms without a unit", "time", lambda t: round(1e3 * t), ("--unit", "time=ms")),
    timed("us without a unit", "timestamp", lambda t: round(1e6 * t) + 12_345_678, ("--unit", "time=us")),
    Format("seconds and microseconds in two columns", FAMILY, text_file("log.csv", lines(
        ("sec", "usec", *REST), rows_of(LOG, lambda t, i, u, c, at: (int(at.timestamp()), 250_000, i, u, c)))),
        LOG, dated=True),
    dated("dates in a first column without a name", as_("%Y-%m-%d %H:%M:%S"), column=""),
    timed("hours", "Time [h]", lambda t: f"{t / 3600:.9f}"),
    Format("no time at all", FAMILY, text_file("log.csv", lines(REST, rows_of(LOG, lambda t, i, u, c, at: (i, u, c)))),
           LOG, ("--sample-time", "1")),
)  # fmt: skip
