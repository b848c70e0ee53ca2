"""One known log, written in the formats of common loggers, so that what is read can be compared with what is true."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import NamedTuple

import numpy as np

#: 28 March 2026, 09:15: the day before the clocks of Europe change.
MORNING = datetime(2026, 3, 28, 9, 15, tzinfo=UTC)
#: Two minutes before midnight.
NIGHT = datetime(2026, 3, 28, 23, 58, tzinfo=UTC)
SAMPLES = 300


class Known(NamedTuple):
    """time_s (T,) from the first sample, current_A > 0 charging, voltage_V, temperature_degC; the time of its zero."""

    time_s: np.ndarray
    current_A: np.ndarray
    voltage_V: np.ndarray
    temperature_degC: np.ndarray
    start: datetime

    @property
    def moments(self) -> list[datetime]:
        """(T,) the wall clock, UTC."""
        return [self.start + timedelta(seconds=float(t)) for t in self.time_s]

    def rows(self) -> list[tuple[float, float, float, float]]:
        """Time, current, voltage, temperature."""
        return list(zip(*(column.tolist() for column in self[:4]), strict=True))


class Format(NamedTuple):
    """A format of a log.

    name: for people.  family: heading in the table.
    write: makes the file in a folder and returns its path.
    known: the log in it.
    flags: what must be said of it on the command line, if anything.
    dated: its wall clock can be known.  warm: it has a temperature.  sparse: only changes are written.
    package: what reads it, where that is optional.
    """

    name: str
    family: str
    write: Callable[[Path], Path]
    known: Known
    flags: tuple[str, ...] = ()
    dated: bool = False
    warm: bool = True
    sparse: bool = False
    package: str = ""


def known_log(start: datetime = MORNING, step_s: float = 1.0) -> Known:
    """Pulses of both signs on a source of 30 mohm that is slowly emptied; no digit that a format would round."""
    k = np.arange(SAMPLES)
    current = np.where((k // 25) % 3 == 1, -5.2, 0.0) + np.where((k // 25) % 6 == 5, 3.1, 0.0)
    voltage = np.round(13.2 + 0.03 * current - 2e-4 * k + 0.002 * np.cos(k), 3)
    temperature = np.round(21.0 + 0.01 * k, 1)
    return Known(k * step_s, current, voltage, temperature, start)


LOG = known_log()


def rows_of(known: Known, cells: Callable[[float, float, float, float, datetime], Iterable[object]]) -> list[list[str]]:
    """The cells of each row as text, from time, current, voltage, temperature and moment."""
    return [[str(cell) for cell in cells(*row, at)] for row, at in zip(known.rows(), known.moments, strict=True)]


def lines(header: Sequence[str], rows: Iterable[Sequence[str]], mark: str = ",", end: str = "\n") -> str:
    """Rows as lines, the header's first."""
    return "".join(mark.join(row) + end for row in (*((header,) if header else ()), *rows))


def text_file(name: str, text: str, encoding: str = "utf-8") -> Callable[[Path], Path]:
    """Write a text into a folder."""
    return binary_file(name, text.encode(encoding))


def binary_file(name: str, content: bytes) -> Callable[[Path], Path]:
    """Write bytes into a folder."""

    def write(folder: Path) -> Path:
        path = folder / name
        path.write_bytes(content)
        return path

    return write
