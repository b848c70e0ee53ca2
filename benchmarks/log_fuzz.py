"""Damaged logs, recordings, settings through each reader: only errors of ours, no log that cannot be, bounded memory.

python benchmarks/log_fuzz.py                                     1,000 files of each reader
python benchmarks/log_fuzz.py --files 1000000 --state fuzz.json   so many, going on where the last run ended
python benchmarks/log_fuzz.py --readers CAN                       of the readers with this word in their names
python benchmarks/log_fuzz.py --readers open_csv --only 17        this file alone, with its traceback; it is left behind

The file of a number is the same in every run with the same seed. The readers run in a process of their own, so that one
that crashes or hangs costs no more than its file; its memory is measured where the system has /proc (Linux).
"""

from __future__ import annotations

import argparse
import json
import re
import signal
import sys
import traceback
import warnings
import zlib
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

#: A reader may take so much memory [bytes], or so many times the size of the file.
MOST_BYTES, MOST_TIMES = 64 << 20, 10
#: Memory [bytes] at which the process of the readers is refused more.
LIMIT_BYTES = 16 << 30
#: Files that the process reads between two entries in the state, and time [s] after which a file is said to hang.
BLOCK, HANGS_S = 200, 60.0
FINE = ("read", "refused")
#: Readers of files that are no logs.
SETTINGS = ("battery", "robot", "floors")
#: A number in such a file, and what may stand there instead.
NUMBER = re.compile(rb"(?<![\w\"])-?\d+\.?\d*(?:e-?\d+)?(?![\w\"])")
NUMBERS = (b"nan", b"inf", b"-inf", b"0", b"-1", b"1e308", b"1e-308", b"1e400", b"9" * 400, b"true", b'"12"', b"[]")
#: Numbers of files that are noted for each other outcome.
EXAMPLES = 3


class Source(NamedTuple):
    """Damaged inputs of one kind.

    make: the input of a random generator, damaged.  size: of an input in bytes.
    """

    make: Callable[[Any], Any]
    size: Callable[[Any], int]


def recordings(folder: Path) -> list[Path]:
    """A recording of a bus, of ROS and of PX4 in each of their formats."""
    from rosbags import rosbag1, rosbag2

    from logs.bags.examples import START_NS, STEP_NS, TYPE, payloads, store, write_mcap
    from logs.test_can_file import WRITERS, hints, written
    from logs.test_ulog_file import write_ulog

    paths = []
    for name, write in {**WRITERS, "MDF 4": written("bus.mf4", "MF4Writer")}.items():
        place = folder / name
        place.mkdir()
        hints(place)
        paths.append(write(place))
    write_ulog(folder / "log.ulg")
    messages = payloads(300)
    for compression in ("NONE", "LZ4", "ZSTD"):
        write_mcap(folder / f"{compression}.mcap", {"/battery_state": (TYPE, messages)}, compression)
    with rosbag2.Writer(folder / "bag", version=8, storage_plugin=rosbag2.StoragePlugin.SQLITE3) as writer:
        topic = writer.add_connection("/battery_state", TYPE, typestore=store())
        for k, message in enumerate(messages):
            writer.write(topic, START_NS + k * STEP_NS, message)
    with rosbag1.Writer(folder / "one.bag") as writer:
        topic = writer.add_connection("/battery_state", TYPE, typestore=store(ros1=True))
        for k, message in enumerate(payloads(300, ros1=True)):
            writer.write(topic, START_NS + k * STEP_NS, message)
    return [*paths, *folder.glob("*.ulg"), *folder.glob("*.mcap"), *folder.glob("bag/*.db3"), folder / "one.bag"]


def drives(folder: Path) -> list[Path]:
    """Tables of drives: speeds and body, counts, and turns of the wheels."""
    import numpy as np

    t = 0.1 * np.arange(200)
    speed, yaw = 5.0 * np.sin(0.3 * t), 0.2 * np.cos(0.3 * t)
    body = {"yaw_rate_rad_s": yaw, "acceleration_m_s2": 0.1 * yaw, "speed_m_s": 0.12 * speed, "heading_deg": 40 * yaw}
    left, right = np.cumsum(0.1 * speed), np.cumsum(0.1 * (speed + yaw))
    tables = {
        "speeds": {"time_s": t, "left_wheel_speed_rad_s": speed, "right_wheel_speed_rad_s": speed + yaw, **body},
        "counts": {"t_ms": 1000 * t, "left_ticks": np.round(229 * left), "right_ticks": np.round(229 * right)},
        "turns": {"stamp": 1.77e9 + t, "left_wheel_turns": left / 6.28, "right_wheel_turns": right / 6.28},
    }
    for name, columns in tables.items():
        rows = zip(*(values.tolist() for values in columns.values()), strict=True)
        lines = [",".join(columns), *(",".join(f"{cell:.9g}" for cell in row) for row in rows)]
        (folder / f"{name}.csv").write_text("\n".join([*lines, ""]), encoding="utf-8")
    return sorted(folder.glob("*.csv"))


def settings(folder: Path) -> dict[str, list[Path]]:
    """Files of batteries, robots and floors, by the name of their reader."""
    from ohmward.battery.chemistries import CHEMISTRIES, generic_battery
    from ohmward.battery.file import save_battery
    from ohmward.traction import RLMA
    from ohmward.traction.robot.robot import save_robot
    from ohmward.traction.terrain.floor import Floor, Floors, save_floors

    batteries = [folder / f"{name}.toml" for name in CHEMISTRIES]
    for path in batteries:
        save_battery(generic_battery(path.stem, 5.0, 4), path)
    save_robot(RLMA, folder / "robot.toml")
    floors = (Floor("lawn", 0.6, 8.0, 0.05), Floor("tiles", 0.9, 20.0, 0.02))
    save_floors(Floors("rover", floors), folder / "floors.toml")
    return {"battery": batteries, "robot": [folder / "robot.toml"], "floors": [folder / "floors.toml"]}


def with_other_number(content: bytes, rng: Any) -> bytes:
    """The content of a settings file with one of its numbers replaced."""
    hits = list(NUMBER.finditer(content))
    hit = hits[rng.integers(len(hits))]
    scaled = f"{float(hit[0]) * 10 ** rng.uniform(-6, 6):.6g}".encode()
    other = rng.choice([*NUMBERS, scaled, b"-" + hit[0].lstrip(b"-")])
    return content[: hit.start()] + other + content[hit.end() :]


def sources(folder: Path) -> dict[str, Source]:
    """The damaged inputs of each reader, by its name."""
    from logs.formats.frames import damaged_frame
    from logs.formats.mutation import damage, written
    from ohmward.logs.bags.bag_table import is_recording
    from ohmward.logs.hints import HEAD_BYTES
    from ohmward.logs.read import opener_of

    places = {name: folder / name for name in ("formats", "recordings", "drives", "settings")}
    for place in places.values():
        place.mkdir()
    paths = [*written(places["formats"]).values(), *recordings(places["recordings"])]
    of_readers = {"drives": drives(places["drives"]), **settings(places["settings"])}
    for path in paths:
        opener: Any = opener_of(path.read_bytes()[:HEAD_BYTES])
        name = "open_bag" if is_recording(path) else getattr(opener, "func", opener).__name__
        keywords = getattr(opener, "keywords", {}).values()
        is_text = name in ("open_csv", "open_objects")
        of_readers.setdefault(" ".join([name, *keywords] + [path.suffix] * (not is_text)), []).append(path)

    def damaged(originals: list[tuple[Path, bytes]], rng: Any) -> Path:
        path, content = originals[rng.integers(len(originals))]
        renumbered = path.suffix == ".toml" and rng.integers(2)
        path.write_bytes(with_other_number(content, rng) if renumbered else damage(content, path.suffix, rng))
        return path

    found = {
        name: Source(partial(damaged, [(path, path.read_bytes()) for path in of_one]), lambda path: path.stat().st_size)
        for name, of_one in sorted(of_readers.items())
    }
    return found | {"open_frame": Source(damaged_frame, lambda frame: MOST_BYTES)}


def take(name: str, number: int, source: Any) -> None:
    """Read the input with this number of a reader.

    Raises:
        OhmwardError: it is refused.
        AssertionError: a log or an estimate that cannot be.
    """
    if name in SETTINGS:
        take_settings(name, source)
    else:
        take_log(source, 2 if name == "drives" and number % 4 < 2 else number % 4)


def take_log(source: Any, how: int) -> None:
    """Read an input as one of its users would, and examine what is in it.

    how: 0 and 1 for the log of a battery, 2 for a drive, 3 for whatever `ohmward doctor` finds in it.

    Raises:
        OhmwardError: it is refused.
        AssertionError: a log that cannot be.
    """
    import numpy as np

    from ohmward.cli.doctor import DriveOptions, GivenFiles, examine_log
    from ohmward.logs import FileHints, examine, read_drive, read_log
    from ohmward.logs.doctor import examine_drive
    from ohmward.logs.log import ReadOptions

    is_path = isinstance(source, Path)
    database = next(source.parent.glob("*.dbc"), None) if is_path else None
    hints = FileHints(dbc=str(database)) if database else FileHints()
    if how == 3 and is_path:
        drives = DriveOptions(None, ReadOptions(hints=hints), False, None)
        list(examine_log(str(source), GivenFiles(drives, "robot.toml", "battery.toml")))
    elif how == 2:
        log = read_drive(source, ("left", "right"), 2, hints=hints)
        examine_drive(log, ("left", "right"))
        assert (np.diff(log.time_s) > 0).all(), "the time does not increase"
        assert not np.isinf(log.wheel_speed_rad_s).any(), "an infinite speed"
    else:
        of_battery = read_log(source, hints=hints)
        examine(of_battery)
        degC = [] if of_battery.temperature_degC is None else [of_battery.temperature_degC]
        assert (np.diff(of_battery.time_s) > 0).all(), "the time does not increase"
        for column in (of_battery.current_A, of_battery.voltage_V, *degC):
            assert not np.isinf(column).any(), "an infinite number"


def take_settings(kind: str, path: Path) -> None:
    """Read a file of a battery, a robot or floors; with a battery, a short log is estimated.

    Raises:
        OhmwardError: it is refused.
        AssertionError: an estimate is no number.
    """
    import numpy as np

    from ohmward import Log, SocEstimator, load_battery
    from ohmward.traction.robot.packaged import load_robot
    from ohmward.traction.terrain.floor import load_floors

    if kind != "battery":
        (load_robot if kind == "robot" else load_floors)(path)
        return
    battery, time_s = load_battery(path), np.arange(30.0)
    current_A, voltage_V = np.where(time_s % 10 < 5, -2.0, 0.0), np.full(30, 0.5 * battery.voltage_max_V + 1.0)
    found = SocEstimator(battery, lowering="python").run(Log("short", time_s, current_A, voltage_V))
    assert np.isfinite(found.soc).all() and np.isfinite(found.soc_std).all(), "an estimate is no number"


def outcome(source: Source, name: str, seed: int, number: int) -> str:
    """`read`, `refused`, or what must not be, of the input with this number."""
    import numpy as np

    from ohmward.errors import OhmwardError

    made = source.make(np.random.default_rng([seed, zlib.crc32(name.encode()), number]))
    before = _start_memory()
    try:
        take(name, number, made)
        found = "read"
    except OhmwardError:
        found = "refused"
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        found = f"{type(error).__name__} at {Path(where.filename).name}:{where.lineno}: {error}"[:160]
    taken = _peak_memory() - before
    return f"took {taken >> 20} MiB" if taken > max(MOST_BYTES, MOST_TIMES * source.size(made)) else found


def _start_memory() -> int:
    """Begin to measure the peak of this process's memory; its memory now [bytes]."""
    try:
        Path("/proc/self/clear_refs").write_text("5")
    except OSError:
        return 0
    return _peak_memory()


def _peak_memory() -> int:
    """Largest memory [bytes] of this process since `_start_memory`, 0 where it cannot be measured."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return 0
    return next((1024 * int(line.split()[1]) for line in lines if line.startswith("VmHWM")), 0)


def serve(asked: Connection, at: Any, seed: int) -> None:
    """Answer blocks of numbers of a reader with the outcome of each; every warning is an error.

    at: shared number of the input that is being read.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with suppress(ImportError):
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (LIMIT_BYTES, LIMIT_BYTES))
    with TemporaryDirectory() as folder:
        found = sources(Path(folder))
        warnings.simplefilter("error")
        asked.send(list(found))
        while block := asked.recv():
            name, numbers = block
            answers = []
            for number in numbers:
                at.value = number
                answers.append(outcome(found[name], name, seed, number))
            asked.send(answers)


class Readers:
    """The process of the readers, started again whenever a file ends it."""

    def __init__(self, seed: int) -> None:
        self._seed = seed
        self._start()

    def _start(self) -> None:
        context = get_context("spawn")
        self._answers, theirs = context.Pipe()
        self._at = context.Value("q", -1)
        self._process = context.Process(target=serve, args=(theirs, self._at, self._seed), daemon=True)
        self._process.start()
        theirs.close()
        self.names: list[str] = self._answers.recv()

    def read(self, name: str, numbers: range) -> list[str]:
        """The outcomes of the inputs with these numbers, up to the first that ends the process."""
        self._answers.send((name, numbers))
        at = -1
        while not self._answers.poll(HANGS_S):
            if at == self._at.value:
                return self._ended(name, numbers, f"more than {HANGS_S:g} s")
            at = self._at.value
        try:
            answers: list[str] = self._answers.recv()
        except EOFError:
            self._process.join()
            return self._ended(name, numbers, f"the process ended ({self._process.exitcode})")
        return answers

    def _ended(self, name: str, numbers: range, what: str) -> list[str]:
        at = self._at.value
        self._process.kill()
        self._process.join()
        self._start()
        return [*(self.read(name, range(numbers.start, at)) if at > numbers.start else []), what]

    def close(self) -> None:
        """End the process, once it has answered."""
        with suppress(OSError):
            self._answers.send(None)
        self._process.join(HANGS_S)


class Tally:
    """Outcomes of each reader, written to a file where one is named."""

    def __init__(self, path: Path | None, seed: int) -> None:
        self._path = path
        known = json.loads(path.read_text("utf-8")) if path and path.exists() else {"seed": seed, "readers": {}}
        if known["seed"] != seed:
            sys.exit(f"{path} is of seed {known['seed']}; name another file, or --seed {known['seed']}")
        self._known = known

    def done(self, reader: str) -> int:
        """Number of the inputs of a reader so far."""
        return sum(count for count, _ in self._known["readers"].get(reader, {}).values())

    def add(self, reader: str, first: int, outcomes: list[str]) -> None:
        """Count outcomes of the inputs from the first number on."""
        counts = self._known["readers"].setdefault(reader, {})
        for number, found in enumerate(outcomes, first):
            count, examples = counts.get(found, (0, []))
            more = [number] if found not in FINE and len(examples) < EXAMPLES else []
            counts[found] = (count + 1, [*examples, *more])
        if self._path:
            beside = self._path.with_name(self._path.name + ".new")
            beside.write_text(json.dumps(self._known, indent=1), "utf-8")
            beside.replace(self._path)

    def show(self) -> bool:
        """Print all; False where an outcome must not be."""
        readers: Mapping[str, Mapping[str, Any]] = self._known["readers"]
        for name, counts in readers.items():
            print(f"{self.done(name):10,} {name}: {', '.join(f'{counts.get(f, (0,))[0]:,} {f}' for f in FINE)}")
            for found, (count, examples) in counts.items():
                if found not in FINE:
                    print(f"{count:14,} {found}; numbers {examples}")
        return all(found in FINE for counts in readers.values() for found in counts)


def run(files: int, seed: int, word: str, state: Path | None) -> bool:
    """Read so many inputs of each reader with the word in its name; False where an outcome must not be."""
    tally, readers = Tally(state, seed), Readers(seed)
    chosen = [name for name in readers.names if word.lower() in name.lower()]
    try:
        while wanted := [name for name in chosen if tally.done(name) < files]:
            for name in wanted:
                first = tally.done(name)
                tally.add(name, first, readers.read(name, range(first, min(first + BLOCK, files))))
    except KeyboardInterrupt:
        print("stopped")
    else:
        readers.close()
    return tally.show()


def run_one(seed: int, word: str, number: int) -> bool:
    """Read one input of a reader, and leave its file in the folder; False where its outcome must not be."""
    import numpy as np

    with TemporaryDirectory() as folder:
        name, source = next((n, s) for n, s in sources(Path(folder)).items() if word.lower() in n.lower())
        made = source.make(np.random.default_rng([seed, zlib.crc32(name.encode()), number]))
        if isinstance(made, Path):
            left = Path(f"{number}{made.suffix}")
            left.write_bytes(made.read_bytes())
            print(f"{name}: {left}, once {made.relative_to(folder)}")
        warnings.simplefilter("error")
        take(name, number, made)
    return True


if __name__ == "__main__":
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--files", type=int, default=1000)
    arguments.add_argument("--seed", type=int, default=1)
    arguments.add_argument("--readers", default="", metavar="WORD")
    arguments.add_argument("--state", type=Path, metavar="FILE")
    arguments.add_argument("--only", type=int, metavar="NUMBER")
    given = arguments.parse_args()
    if given.only is not None:
        sys.exit(not run_one(given.seed, given.readers, given.only))
    sys.exit(not run(given.files, given.seed, given.readers, given.state))
