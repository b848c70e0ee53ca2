"""All formats, and what becomes of each."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from logs.formats.containers import CONTAINERS
from logs.formats.cyclers import CYCLERS
from logs.formats.known import Format
from logs.formats.layouts import LAYOUTS
from logs.formats.recorders import RECORDERS
from logs.formats.telemetry import TELEMETRY
from logs.formats.times import TIMES
from ohmward.errors import OhmwardError
from ohmward.logs import Log, read_log

FORMATS = (*LAYOUTS, *TIMES, *CYCLERS, *TELEMETRY, *CONTAINERS, *RECORDERS)
RIGHT, REFUSED, WRONG = "right", "refused", "wrong"


def difference(log: Log, about: Format) -> str:
    """What of a log is not as it is known to be; "" where all is."""
    known = about.known
    time_s = log.time_s - log.time_s[0]
    at = np.rint(time_s).astype(int)
    if not about.sparse and len(log) != known.time_s.size:
        return f"{len(log)} samples of {known.time_s.size}"
    if len(log) < 0.7 * known.time_s.size or at[-1] >= known.time_s.size or np.abs(time_s - at).max() > 2e-3:
        return f"times {time_s[:3]} to {time_s[-1]}"
    pairs = {"current": (log.current_A, known.current_A), "voltage": (log.voltage_V, known.voltage_V)}
    if about.warm:
        temperature = np.full(len(log), np.nan) if log.temperature_degC is None else log.temperature_degC
        pairs["temperature"] = (temperature, known.temperature_degC)
    for name, (found, true) in pairs.items():
        if not np.allclose(found, true[at], rtol=0, atol=0.15 if name == "temperature" else 2e-3):
            return f"{name} {found[:3]} for {true[at][:3]}"
    start = known.start.timestamp()
    if log.start_unix_s is None and about.dated:
        return "no wall clock"
    if log.start_unix_s is not None and abs(log.start_unix_s + log.time_s[0] - start) > 1.0:
        return f"starts {log.start_unix_s + log.time_s[0] - start:g} s late"
    return ""


def verdict(about: Format) -> tuple[str, str]:
    """What becomes of a format at once: `right`, `refused` with the message, or `wrong` and in what."""
    with TemporaryDirectory() as folder:
        path = about.write(Path(folder))
        try:
            found = difference(read_log(path), about)
        except OhmwardError as error:
            return REFUSED, str(error)
        except Exception as error:
            return WRONG, f"{type(error).__name__}: {error}"
        return (WRONG, found) if found else (RIGHT, "")


if __name__ == "__main__":
    verdicts = {about.name: verdict(about) for about in FORMATS}
    for name, (what, text) in verdicts.items():
        if what != RIGHT:
            print(f"{what:8} {name}: {text[:260]}")
    print(len(FORMATS), Counter(what for what, _ in verdicts.values()))
