"""Damaged battery, robot and floors files through their readers: only errors of the package, and no NaN from what is
accepted.

python benchmarks/settings_fuzz.py                 100,000 files
python benchmarks/settings_fuzz.py 1000 7          so many, from this seed
"""

from __future__ import annotations

import random
import re
import sys
import time
import traceback
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np

from ohmward import Battery, Log, SocEstimator, generic_battery, load_battery, save_battery
from ohmward.battery.chemistries import CHEMISTRIES
from ohmward.errors import OhmwardError
from ohmward.traction import RLMA
from ohmward.traction.robot.packaged import load_robot
from ohmward.traction.robot.robot import save_robot
from ohmward.traction.terrain.floor import Floor, Floors, load_floors, save_floors

#: One accepted file in so many is used; for a battery a step is traced.
USED = 20
NUMBERS = ("nan", "inf", "-inf", "0", "-1", "1e308", "-1e308", "1e-308", "1e400", "9" * 400, "true", '"12"', "[]", "{}")
NUMBER = re.compile(r"(?<![\w\"])-?\d+\.?\d*(?:e-?\d+)?(?![\w\"])")


class Kind(NamedTuple):
    """Text of a good file, its reader, and what is done with some of those that are accepted."""

    text: str
    load: Callable[[Path], object]
    use: Callable[[object], None] = lambda accepted: None


def kinds(folder: Path) -> list[Kind]:
    """Every kind of file."""
    found, path = [], folder / "good.toml"
    for name in CHEMISTRIES:
        save_battery(generic_battery(name, 5.0, 4), path)
        found.append(Kind(path.read_text("utf-8"), load_battery, estimate))
    save_robot(RLMA, path)
    found.append(Kind(path.read_text("utf-8"), load_robot))
    save_floors(Floors("rover", (Floor("lawn", 0.6, 8.0, 0.05), Floor("tiles", 0.9, 20.0, 0.02))), path)
    found.append(Kind(path.read_text("utf-8"), load_floors))
    return found


def damaged(text: str, rng: random.Random) -> str:
    """The text with one to three changes: of a number, a line, a character, or the end cut off."""
    for _ in range(rng.randint(1, 3)):
        lines, kind = text.splitlines(keepends=True), rng.randrange(8)
        if kind < 4 and (numbers := list(NUMBER.finditer(text))):
            hit = rng.choice(numbers)
            other = rng.choice([*NUMBERS, f"{float(hit[0]) * 10 ** rng.uniform(-6, 6):.6g}", "-" + hit[0].lstrip("-")])
            text = text[: hit.start()] + other + text[hit.end() :]
        elif kind == 4 and lines:
            del lines[rng.randrange(len(lines))]
            text = "".join(lines)
        elif kind == 5 and lines:
            lines.insert(rng.randrange(len(lines)), rng.choice(lines))
            text = "".join(lines)
        elif kind == 6 and text:
            at = rng.randrange(len(text))
            text = text[:at] + chr(rng.choice([0, 9, 34, 39, 44, 61, 91, 93, 0x2212, 0xFEFF])) + text[at + 1 :]
        else:
            text = text[: rng.randrange(len(text) + 1)]
    return text


def estimate(battery: object) -> None:
    """Estimate a short log; every estimate is a number.

    Raises:
        ValueError: one is none.
    """
    assert isinstance(battery, Battery)
    time_s = np.arange(30.0)
    log = Log("short", time_s, np.where(time_s % 10 < 5, -2.0, 0.0), np.full(30, 0.5 * battery.voltage_max_V + 1.0))
    found = SocEstimator(battery, lowering="python").run(log).estimates
    if not (np.isfinite(found.soc).all() and np.isfinite(found.soc_std).all()):
        raise ValueError("an estimate is no number")


def outcome(kind: Kind, path: Path, text: str, use: bool) -> str:
    """`read`, `refused`, or the error that must not be."""
    path.write_text(text, "utf-8")
    try:
        accepted = kind.load(path)
        if use:
            kind.use(accepted)
    except OhmwardError:
        return "refused"
    except Exception as error:
        traceback.print_exc()
        return f"{type(error).__name__}: {error}"[:200]
    return "read"


def run(files: int, seed: int) -> Counter[str]:
    """Number of files with each outcome."""
    counts, rng = Counter[str](), random.Random(seed)
    with TemporaryDirectory() as folder:
        good = kinds(Path(folder))
        for _ in range(files):
            kind = rng.choice(good)
            counts[outcome(kind, Path(folder) / "file.toml", damaged(kind.text, rng), counts["read"] % USED == 0)] += 1
    return counts


if __name__ == "__main__":
    files, seed = (*map(int, sys.argv[1:]), *(100_000, 1)[len(sys.argv) - 1 :])
    began = time.perf_counter()
    found = run(files, seed)
    print(f"{files:,} damaged files in {time.perf_counter() - began:.0f} s")
    for what, count in found.most_common():
        print(f"{count:8,} {what}")
    sys.exit(bool(set(found) - {"read", "refused"}))
