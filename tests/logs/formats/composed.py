"""Text tables composed at random: names, order, notation and surroundings of a known log as loggers combine them."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime
from pathlib import Path

import numpy as np

from logs.formats.known import LOG, Format, Known, known_log, text_file

_STARTS = tuple(
    datetime(2026, *day, tzinfo=LOG.start.tzinfo) for day in ((3, 28, 9, 15), (12, 31, 23, 58), (7, 19, 0, 0))
)
_NAMES = (
    (("Time", "s"), ("Current", "A"), ("Voltage", "V"), ("Temperature", "°C")),
    (("Zeit", "s"), ("Strom", "A"), ("Spannung", "V"), ("Temperatur", "°C")),
    (("elapsed", "s"), ("battery_current", "A"), ("battery_voltage", "V"), ("battery_temp", "degC")),
    (("TestTime", "s"), ("I", "A"), ("U", "V"), ("T", "°C")),
    (("Temps", "s"), ("Courant", "A"), ("Tension", "V"), ("Température", "°C")),
)
_WITH_UNIT: tuple[Callable[[str, str], str], ...] = (
    lambda name, unit: f"{name} [{unit}]",
    lambda name, unit: f"{name} ({unit})",
    lambda name, unit: f"{name}/{unit}",
    lambda name, unit: f"{name}({unit})",
)
_DATES: tuple[Callable[[datetime], str], ...] = (
    lambda at: at.strftime("%Y-%m-%d %H:%M:%S"),
    lambda at: at.strftime("%Y-%m-%dT%H:%M:%S.000Z"),
    lambda at: at.strftime("%d.%m.%Y %H:%M:%S"),
    lambda at: at.strftime("%d/%m/%Y %H:%M:%S"),
    lambda at: at.strftime("%m/%d/%Y %I:%M:%S %p"),
    lambda at: at.strftime("%Y/%m/%d %H:%M:%S"),
    lambda at: at.strftime("%d-%b-%y %H:%M:%S"),
    lambda at: str(round(at.timestamp())),
    lambda at: str(round(at.timestamp() * 1000)),
)
_PREAMBLE = (
    "Logger BL-3000", "Serial number: 4711", "Start;28.03.2026 09:15", "Capacity,12.0,Ah", "", "# made by hand",
    "Cells\t4", "Channel 1 = voltage, channel 2 = current", "Firmware,1.2.3,2026-01-01", "-" * 40, "Test 7: 3 A, 12 V",
    "[Data]", '"quoted, text"', "Min 12.1 Max 13.4 Mean 12.9", "1;2;3",
)  # fmt: skip


def composed(rng: np.random.Generator) -> Format:
    """A format drawn from a generator."""
    known = known_log(_STARTS[rng.integers(len(_STARTS))])
    mark = str(rng.choice([",", ";", "\t", "|"]))
    comma = mark != "," and rng.random() < 0.4
    unit_row = rng.random() < 0.25
    dated = rng.random() < 0.5
    header, units, columns = _columns(rng, known, dated, unit_row)
    order = rng.permutation(len(header))
    rows = [[column[k] for column in columns] for k in range(known.time_s.size)]
    table = [header, *([units] if unit_row else []), *rows]
    lines = [mark.join(_cell(row[k], mark, comma and at > 0, rng) for k in order) for at, row in enumerate(table)]
    before = [str(rng.choice(_PREAMBLE)) for _ in range(rng.integers(0, 8) * (rng.random() < 0.4))]
    end = str(rng.choice(["\n", "\r\n"]))
    text = end.join([*before, *lines]) + end
    encoding = str(rng.choice(["utf-8", "utf-8-sig", "utf-16", "cp1252", "utf-16-le"]))
    description = f"{header} {units if unit_row else ''} {mark!r} comma={comma} {before} {encoding} {rows[0]}"
    return Format(description, "composed", text_file("log.csv", text, encoding), known, dated=dated)


def _columns(
    rng: np.random.Generator, known: Known, dated: bool, unit_row: bool
) -> tuple[list[str], list[str], list[list[str]]]:
    """Names, units and cells of the columns."""
    names = [*_NAMES[rng.integers(len(_NAMES))]]
    with_unit = _WITH_UNIT[rng.integers(len(_WITH_UNIT))]
    milli = rng.random() < 0.25
    sign = float(rng.choice([-1.0, 1.0]))
    times = [f"{t:.1f}" for t in known.time_s]
    if dated:
        names[0] = (str(rng.choice(["timestamp", "Date", "Date/Time", "time"])), "")
        times = list(map(_DATES[rng.integers(len(_DATES))], known.moments))
    if milli:
        names[1] = (names[1][0], "mA")
    current = [f"{sign * (1000 * i if milli else i):.{0 if milli else 3}f}" for i in known.current_A]
    cells = [times, current, [f"{u:.3f}" for u in known.voltage_V], [f"{c:.1f}" for c in known.temperature_degC]]
    for name, column in (
        ("SOC", [f"{80 - k / 10:.1f}" for k in range(len(times))]),
        ("Status", ["OK"] * len(times)),
        ("Cycle", ["1"] * len(times)),
        ("Comment", [""] * len(times)),
    ):
        if rng.random() < 0.3:
            names.append((name, ""))
            cells.append(column)
    header = [name if unit_row or not unit else with_unit(name, unit) for name, unit in names]
    return header, [unit for _, unit in names], cells


def _cell(text: str, mark: str, comma: bool, rng: np.random.Generator) -> str:
    """A cell as it is written: a decimal comma in numbers, quotes where they must be or by chance."""
    if comma and text.replace(".", "").replace("-", "").isdigit() and text.count(".") == 1:
        text = text.replace(".", ",")
    return f'"{text}"' if mark in text or rng.random() < 0.01 else text


def write(folder: Path, seed: int) -> tuple[Format, Path]:
    """The format of a seed and its file."""
    about = composed(np.random.default_rng(seed))
    return about, about.write(folder)
