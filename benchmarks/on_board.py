"""The process on the robot for hours: `make soak` measures every part and writes benchmarks/on_board.md.

    python benchmarks/on_board.py                  every part
    python benchmarks/on_board.py load kills       two of them; the others' sections of the page stay as they are
    python benchmarks/on_board.py load day --seconds 60 --hours 0.33 --dry      a minute of each, without a page

Parts: `load` at 1 kHz, `start` of the process, a simulated `day` at 20 times real time (72 minutes), `kills` of the
process and of its `store`, an `outage` of the databases in real time, the `silence` of sensors at random moments of
simulated drives, and `fuzz-...` of everything that listens. Each row says how long or how many it is of. Of inputs at
random every hundred thousand are kept in build/on_board, and --continue goes on after those of a run that was cut off.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime
from functools import partial
from typing import NamedTuple

import numpy as np

from figure import HERE, Figure, at_least, at_most, table
from on_board_day import RATE, drive_a_day, growth
from on_board_fuzz import LISTENERS, Fuzzed, fuzz
from on_board_http import fuzz_http
from on_board_load import SETTLE_S, measure
from on_board_silence import SILENCES, shares, silences
from on_board_start import starts

PAGE = HERE / "on_board.md"
KEPT = HERE.parent / "build" / "on_board"

#: Inputs at random after which what was found is kept.
CHUNK = 100_000
#: Starts of the process; the first one compiles.
STARTS = 6
#: An input takes no longer than this, and memory grows by no more, as the tests demand of ten thousand.
SLOWEST_S, GROWN_MB = 1.0, 10.0


class Scale(NamedTuple):
    """How much of each part: seconds of the load, simulated hours, kills, inputs, seconds without databases, drives.

    goes_on: a run that was cut off does.
    """

    seconds: float = 600.0
    hours: float = 24.0
    kills: int = 200
    inputs: int = 1_000_000
    goes_on: bool = False
    outage_s: float = 300.0
    drives: int = 10


#: A part of the page: measures, and gives its rows.
Part = Callable[[Scale], Iterator[Figure]]


def load_rows(scale: Scale) -> Iterator[Figure]:
    """Wheels and motors at 1 kHz, the battery at 100 Hz."""
    load = measure(scale.seconds)
    row = partial(
        at_most, f"1 kHz wheels and motors, 100 Hz battery, {scale.seconds:.0f} s", "JSON lines over a socket"
    )
    memory = load.memory_MB[int(SETTLE_S) :]
    yield row("samples lost", load.sent - load.estimated, 0.0, ".0f")
    yield row("sample to estimate, median [ms]", 1e3 * load.p50_s)
    yield row("sample to estimate, 99 % [ms]", 1e3 * load.p99_s, 2.0)
    yield row("share of one core", load.cpu, 0.25, ".1%")
    yield row("memory, most [MB]", memory.max(), 150.0, ".0f")
    yield row("memory at the end over that before", growth(list(memory)), 1.02)


def day_rows(scale: Scale) -> Iterator[Figure]:
    """A day at twenty times real time."""
    looks = drive_a_day(scale.hours)
    row = partial(at_most, f"{scale.hours:g} simulated hours at {RATE:g} x", "50 Hz wheels, 10 Hz battery")
    yield row("memory at the end over that before", growth([look.memory_MB for look in looks]), 1.02)
    yield row("open handles at the end over that before", growth([float(look.handles) for look in looks]), 1.0)
    yield row("time of a message at the end over that before", growth([look.message_s for look in looks]), 1.2)


def start_rows(scale: Scale) -> Iterator[Figure]:
    """Starts of the whole process."""
    first, *later = starts(STARTS)
    row = partial(at_most, "`ohmward run` until it is ready", "charge, slip, pose; page, store")
    yield row("first start, which compiles [s]", first)
    yield row(f"later starts, median of {len(later)} [s]", float(np.median(later)), 2.0)


def kill_rows(scale: Scale) -> Iterator[Figure]:
    """Kills of the whole process."""
    test = "test_state.py::test_the_charge_goes_on_after_every_kill"
    yield killed(test, scale.kills, "50 x replay", "snapshots that load, and the charge goes on inside its band")


def store_rows(scale: Scale) -> Iterator[Figure]:
    """Kills of a process that writes into the store."""
    test = "test_store.py::test_no_row_is_lost_or_stored_twice_when_the_process_is_killed"
    yield killed(test, scale.kills, "writing into the store", "stores intact, no acknowledged row lost or stored twice")


def outage_rows(scale: Scale) -> Iterator[Figure]:
    """Databases that are killed and come back while rows come at 10 Hz."""
    met = passes("test_outage.py::test_databases_that_are_away_get_every_row_once", OHMWARD_OUTAGE_S=scale.outage_s)
    yield Figure(
        f"InfluxDB and PostgreSQL killed, away for {scale.outage_s:g} s",
        "rows at 10 Hz, in real time",
        "estimates go on, the fault is named, and after it every row is there once",
        "all" if met else "not all",
        "all",
        met,
    )


def silence_rows(scale: Scale) -> Iterator[Figure]:
    """Sensors that fall silent at random moments of simulated drives."""
    data = f"{scale.drives} simulated drives, {SILENCES} silences of random sensors in each"
    for age_s, quantity, in_band, unknown in shares(list(silences(scale.drives))):
        text = f"{quantity} {age_s:g} s later: truth in the band, or unknown ({unknown:.0%})"
        yield at_least(data, "passed on by the process", text, in_band, 0.95, ".1%")


def killed(test: str, kills: int, method: str, quantity: str) -> Figure:
    """Kills at random moments; the test says what must hold after each."""
    met = passes(test, OHMWARD_KILLS=kills)
    value = f"all of {kills}" if met else "not all"
    return Figure(f"{kills} SIGKILLs at random moments", method, quantity, value, "all", met)


def passes(test: str, **settings: float) -> bool:
    """True where a test holds with settings in its environment."""
    words = [sys.executable, "-m", "pytest", "-q", f"{HERE.parent}/tests/onboard/{test}"]
    environment = {**os.environ, **{name: f"{value:g}" for name, value in settings.items()}}
    return subprocess.run(words, env=environment, check=False).returncode == 0


def fuzz_rows(listener: str, scale: Scale) -> Iterator[Figure]:
    """Inputs at random for what listens."""
    kept = KEPT / f"fuzz-{listener}.chunks.json"
    found = [Fuzzed(*chunk) for chunk in json.loads(kept.read_text())] if scale.goes_on and kept.exists() else []
    while (rest := scale.inputs - sum(chunk.inputs for chunk in found)) > 0:
        found.append(FUZZERS[listener](min(rest, CHUNK), seed=len(found) + 1))
        KEPT.mkdir(parents=True, exist_ok=True)
        kept.write_text(json.dumps(found, default=float), encoding="utf-8")
    inputs, crashes = (sum(getattr(chunk, name) for chunk in found) for name in ("inputs", "crashes"))
    row = partial(at_most, f"{inputs:,} inputs at random", listener)
    yield row("inputs that end it", crashes, 0.0, ".0f")
    yield row(
        f"longest time of {'an answer beside them' if listener == 'http' else 'an input'} [ms]",
        1e3 * max(c.slowest_s for c in found),
        1e3 * SLOWEST_S,
    )
    yield row(f"most growth of memory in {CHUNK:,} [MB]", max(c.grown_MB for c in found), GROWN_MB)


FUZZERS: dict[str, Callable[..., Fuzzed]] = {
    **{listener: partial(fuzz, listener) for listener in LISTENERS},
    "http": fuzz_http,
}

PARTS: dict[str, Part] = {
    "load": load_rows,
    "start": start_rows,
    "kills": kill_rows,
    "store": store_rows,
    **{f"fuzz-{listener}": partial(fuzz_rows, listener) for listener in FUZZERS},
    "outage": outage_rows,
    "silence": silence_rows,
    "day": day_rows,
}


def section(name: str, scale: Scale) -> str:
    """A part, measured now: its rows under the day, the minutes that it took, the machine and its load."""
    began_s = time.monotonic()
    rows = [figure.cells for figure in PARTS[name](scale)]
    minutes = (time.monotonic() - began_s) / 60.0
    machine = f"{platform.machine()}, {os.cpu_count()} processors, load {os.getloadavg()[2]:.1f} at the end"
    stamp = f"{datetime.now(UTC):%Y-%m-%d}, {minutes:.1f} minutes, {machine}."
    return "\n".join((name, "", stamp, "", *table(("", "by", "", "measured", "bar", ""), rows), ""))


def with_section(page: str, new: str) -> str:
    """The page with a new section instead of that of the same part, in the order of the parts."""
    title, *old = page.split("\n## ")
    found = {text.splitlines()[0]: text for text in (*old, new)}
    sections = [found.get(name, f"{name}\n\nNot measured.") for name in PARTS]
    return "\n\n## ".join(text.rstrip() for text in (title, *sections)) + "\n"


def arguments(words: Sequence[str] | None = None) -> argparse.Namespace:
    """What was asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"of {', '.join(PARTS)}; all by default")
    parser.add_argument("--seconds", type=float, default=Scale().seconds, help="of the load at 1 kHz")
    parser.add_argument("--hours", type=float, default=Scale().hours, help="simulated, at 20 x")
    parser.add_argument("--kills", type=int, default=Scale().kills)
    parser.add_argument("--inputs", type=int, default=Scale().inputs, help="at random, for each that listens")
    parser.add_argument("--outage", type=float, default=Scale().outage_s, metavar="S", help="without the databases")
    parser.add_argument("--drives", type=int, default=Scale().drives, help="simulated, with silences of sensors")
    parser.add_argument("--continue", action="store_true", dest="goes_on", help="go on with inputs of a run cut off")
    parser.add_argument("--dry", action="store_true", help="print the sections of these parts, write no page")
    found = parser.parse_args(words)
    if unknown := set(found.parts) - set(PARTS):
        parser.error(f"no part {', '.join(sorted(unknown))}; there are {', '.join(PARTS)}")
    return found


def main() -> None:
    args = arguments()
    scale = Scale(args.seconds, args.hours, args.kills, args.inputs, args.goes_on, args.outage, args.drives)
    for name in args.parts or PARTS:
        new = section(name, scale)
        print(new, flush=True)
        if not args.dry:
            PAGE.write_text(with_section(PAGE.read_text(encoding="utf-8"), new), encoding="utf-8")


if __name__ == "__main__":
    main()
