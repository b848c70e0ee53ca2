"""Damaged logs and recordings of all formats through the readers: only errors of ours, and no log that cannot be.

python benchmarks/log_fuzz.py                 100,000 files
python benchmarks/log_fuzz.py 1000 7          so many, from this seed
python benchmarks/log_fuzz.py 1000000 7 CAN   of the formats with this word in their names
"""

from __future__ import annotations

import sys
import time
import traceback
import tracemalloc
import warnings
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from rosbags import rosbag1, rosbag2

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from logs.bags.examples import START_NS, STEP_NS, TYPE, payloads, store, write_mcap
from logs.formats.mutation import damaged, written
from logs.test_can_file import WRITERS as CAN_WRITERS
from logs.test_can_file import hints as with_database
from logs.test_ulog_file import write_ulog
from ohmward.errors import OhmwardError
from ohmward.logs import FileHints, Log, examine, read_log

FILES, SEED = 100_000, 1
#: A reader may take so much memory [bytes], or so many times the size of the file.
MOST_BYTES, MOST_TIMES = 64 << 20, 10
#: The memory of so many files is traced, one in this number: tracing is slow.
TRACED_ONE_IN = 100


def recordings(folder: Path) -> dict[str, Path]:
    """A recording of a bus, of ROS and of PX4 in each of their formats, by its name."""
    paths = {}
    for name, write in CAN_WRITERS.items():
        place = folder / name
        place.mkdir()
        with_database(place)
        paths[f"CAN, {name}"] = write(place)
    paths["PX4, ULog"] = folder / "log.ulg"
    write_ulog(paths["PX4, ULog"])
    messages = payloads()
    for compression in ("NONE", "LZ4", "ZSTD"):
        paths[f"ROS, MCAP {compression}"] = folder / f"{compression}.mcap"
        write_mcap(paths[f"ROS, MCAP {compression}"], {"/battery_state": (TYPE, messages)}, compression)
    with rosbag2.Writer(folder / "bag", version=8, storage_plugin=rosbag2.StoragePlugin.SQLITE3) as writer:
        topic = writer.add_connection("/battery_state", TYPE, typestore=store())
        for k, message in enumerate(messages):
            writer.write(topic, START_NS + k * STEP_NS, message)
    paths["ROS, SQLite"] = next((folder / "bag").glob("*.db3"))
    paths["ROS, bag of ROS 1"] = folder / "one.bag"
    with rosbag1.Writer(paths["ROS, bag of ROS 1"]) as writer:
        topic = writer.add_connection("/battery_state", TYPE, typestore=store(ros1=True))
        for k, message in enumerate(payloads(ros1=True)):
            writer.write(topic, START_NS + k * STEP_NS, message)
    return paths


def outcome(path: Path, traced: bool) -> str:
    """`read`, `refused`, or the error that must not be."""
    database = next(path.parent.glob("*.dbc"), None)
    if traced:
        tracemalloc.start()
    try:
        log = read_log(path, hints=FileHints(dbc=str(database)) if database else None)
        examine(log)
    except OhmwardError:
        return _too_much(path) or "refused"
    except Exception as error:
        traceback.print_exc()
        return f"{type(error).__name__}: {error}"[:200]
    else:
        return _too_much(path) or ("read" if is_sound(log) else "a log that cannot be")
    finally:
        tracemalloc.stop()


def _too_much(path: Path) -> str:
    """The memory that a reader took, where it is more than it may; "" where it is not, or was not traced."""
    _, peak = tracemalloc.get_traced_memory()
    return f"took {peak >> 20} MiB" if peak > max(MOST_BYTES, MOST_TIMES * path.stat().st_size) else ""


def is_sound(log: Log) -> bool:
    """True where the time increases and no number is infinite."""
    columns = [log.current_A, log.voltage_V, *([] if log.temperature_degC is None else [log.temperature_degC])]
    return bool((np.diff(log.time_s) > 0).all()) and not any(np.isinf(column).any() for column in columns)


def run(files: int, seed: int, word: str = "") -> Counter[str]:
    """Number of files with each outcome, of the formats with the word in their names; every warning is an error."""
    with TemporaryDirectory() as folder, warnings.catch_warnings():
        paths = {**written(Path(folder)), **recordings(Path(folder))}
        chosen = [path for name, path in paths.items() if word.lower() in name.lower()]
        print(f"{len(chosen)} formats")
        warnings.simplefilter("error")
        files_of_them = damaged(chosen, np.random.default_rng(seed), files)
        return Counter(outcome(path, k % TRACED_ONE_IN == 0) for k, path in enumerate(files_of_them))


def fuzz(what: str, run: Callable[[], Counter[str]]) -> int:
    """Run, and tell; 1 where an error should not be."""
    began = time.perf_counter()
    counts = run()
    print(f"{what} in {time.perf_counter() - began:.0f} s")
    for outcome, count in counts.most_common():
        print(f"{count:8,} {outcome}")
    return int(bool(set(counts) - {"read", "refused"}))


if __name__ == "__main__":
    given = sys.argv[1:]
    count, seed = (int(word) for word in (*given[:2], *(str(n) for n in (FILES, SEED)[len(given[:2]) :])))
    sys.exit(fuzz(f"{count:,} damaged logs", lambda: run(count, seed, *given[2:3])))
