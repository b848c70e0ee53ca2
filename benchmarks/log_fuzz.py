"""Damaged logs of all formats through the readers: only errors of the package, and no log that cannot be.

python benchmarks/log_fuzz.py                 100,000 files
python benchmarks/log_fuzz.py 1000 7          so many, from this seed
"""

from __future__ import annotations

import sys
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from logs.formats.mutation import damaged
from ohmward.errors import OhmwardError
from ohmward.logs import Log, examine, read_log

FILES, SEED = 100_000, 1


def outcome(path: Path) -> str:
    """`read`, `refused`, or the error that must not be."""
    try:
        log = read_log(path)
        examine(log)
    except OhmwardError:
        return "refused"
    except Exception as error:
        traceback.print_exc()
        return f"{type(error).__name__}: {error}"[:200]
    return "read" if is_sound(log) else "a log that cannot be"


def is_sound(log: Log) -> bool:
    """True where the time increases and no number is infinite."""
    columns = [log.current_A, log.voltage_V, *([] if log.temperature_degC is None else [log.temperature_degC])]
    return bool((np.diff(log.time_s) > 0).all()) and not any(np.isinf(column).any() for column in columns)


def run(files: int, seed: int) -> Counter[str]:
    """Number of files with each outcome; every warning is an error."""
    with TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("error")
        return Counter(map(outcome, damaged(Path(folder), np.random.default_rng(seed), files)))


def fuzz(words: list[str], what: str, run: Callable[[int, int], Counter[str]]) -> int:
    """Run with the number of files and the seed of the command line, and tell; 1 where an error should not be."""
    files, seed = (int(word) for word in (*words, *(str(n) for n in (FILES, SEED)[len(words) :])))
    began = time.perf_counter()
    counts = run(files, seed)
    print(f"{files:,} damaged {what} in {time.perf_counter() - began:.0f} s")
    for outcome, count in counts.most_common():
        print(f"{count:8,} {outcome}")
    return int(bool(set(counts) - {"read", "refused"}))


if __name__ == "__main__":
    sys.exit(fuzz(sys.argv[1:], "logs", run))
