"""Speed of this checkout over that of another commit, in turns; also `python benchmarks/speed.py --against COMMIT`.

    python benchmarks/against.py COMMIT

The other commit is checked out beside this one for the while. Both run the same lines, each time in a process of its
own, one after the other, so that all of them see the same machine; figures are medians of processor time.
"""

from __future__ import annotations

import json
import math
import os
import statistics
import subprocess
import sys
import tempfile
from collections import defaultdict
from pathlib import Path

from timing import Goal, Section, duration, page, ratio

HOME = Path(__file__).resolve().parents[1]
ROUNDS = 5
#: The filters that are compared: the extended filter with itself, and the default with the extended filter of then.
EKF, DEFAULT = "ekf", "default"
#: What each line measures, and the most that it may take over the other commit's: of `ekf`, and of the default.
LINES = {
    "update": ("`update()`", 1.1, 1.4),
    "log": ("one log, a sample", 1.1, 1.5),
    "lanes": ("64 logs side by side, a sample", 1.1, 1.5),
    "fleet": ("`ohmward fleet`, a log of 36,000 samples", 1.1, 1.5),
    "soc": ("`ohmward soc`, 2 million samples of Parquet", 1.1, 1.5),
}

#: What both run, in a folder of their own; prints the seconds of every line as JSON.
_MEASURED = """
import contextlib, io, json, os, resource, subprocess, sys, time
import numpy as np
from ohmward import SocEstimator, make_estimator
from ohmward.battery.chemistries import generic_battery
from ohmward.fleet import Job
from ohmward.fleet.lanes import estimate_logs
from ohmward.logs import Log, write_log

FILTERS = {"ekf": "ekf", "default": "gsf"}
battery, found = generic_battery("nmc", 12.0, 3), {}

def log_of(samples, seed):
    rng = np.random.default_rng(seed)
    loads_A = rng.normal(0.0, 3.0, samples // 400 + 1)
    current_A = np.repeat(np.stack([loads_A, -loads_A], axis=1).ravel(), 200)[:samples]
    current_A = current_A + 0.05 * rng.standard_normal(samples)
    voltage_V = 11.2 + 0.03 * current_A + 0.005 * rng.standard_normal(samples)
    return Log(f"log {seed}", np.arange(float(samples)), current_A, voltage_V)

def seconds(run, count):
    run()
    began = time.process_time()
    run()
    return (time.process_time() - began) / count

def update(name):
    live = SocEstimator(make_estimator(name, battery), 0.6)
    times = iter(range(10**9))
    def run():
        for _ in range(5000):
            live.update(float(next(times)), -0.5, 11.2)
    return seconds(run, 5000)

def log(name):
    whole = log_of(200_000, 1)
    return seconds(lambda: SocEstimator(make_estimator(name, battery), 0.6).run(whole), len(whole))

def lanes(name):
    logs = [log_of(10_000, k) for k in range(64)]
    return seconds(lambda: estimate_logs(make_estimator(name, battery), logs, 0.6), 640_000)

def fleet(name):
    paths = []
    for k in range(16):
        paths.append(f"robot{k}.parquet")
        write_log(log_of(36_000, k), paths[-1])
    job = Job(open("battery.toml").read(), filter=name)
    return seconds(lambda: job.run(paths), len(paths))

def soc(name):
    def run():
        program = "import sys; from ohmward.cli.main import main; sys.exit(main())"  # the same in every commit
        words = [sys.executable, "-c", program, "soc", "log.parquet", "--battery", "battery.toml", "--json"]
        done = subprocess.run([*words, "--filter", name], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        assert json.loads(done.stdout)["steps"] == 2_000_000
    def children():
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        return used.ru_utime + used.ru_stime
    run()
    began = children()
    run()
    return children() - began

with contextlib.redirect_stderr(io.StringIO()):
    from ohmward import save_battery
    save_battery(battery, "battery.toml")
    if not os.path.exists("log.parquet"):
        write_log(log_of(2_000_000, 0), "log.parquet")
    for line in (update, log, lanes, fleet, soc):
        for title, name in FILTERS.items():
            with contextlib.suppress(Exception):
                found[f"{line.__name__} {title}"] = line(name)
print(json.dumps(found))
"""


def against(commit: str, rounds: int = ROUNDS) -> Section:
    """The table of both, and what this checkout may take."""
    ours, theirs = defaultdict(list), defaultdict(list)
    with tempfile.TemporaryDirectory() as name:
        tree = Path(name) / "tree"
        subprocess.run(["git", "-C", HOME, "worktree", "add", "-q", "--detach", tree, commit], check=True)
        try:
            for k in range(rounds):
                for root, found in ((tree, theirs), (HOME, ours)):
                    for line, seconds in _measured(root, Path(name) / root.name).items():
                        found[line].append(seconds)
                print(f"round {k + 1} of {rounds}", file=sys.stderr, flush=True)
        finally:
            subprocess.run(["git", "-C", HOME, "worktree", "remove", "--force", tree], check=True)
    rows, goals = [], []
    for line, (what, *most) in LINES.items():
        before = statistics.median(theirs[f"{line} {EKF}"]) if theirs[f"{line} {EKF}"] else math.nan
        for title, bar in zip((EKF, DEFAULT), most, strict=True):
            now = statistics.median(ours[f"{line} {title}"])
            if math.isnan(before):
                rows.append((what, title, "cannot be run there", duration(now), ""))
                continue
            rows.append((what, title, duration(before), duration(now), ratio(now, before)))
            goals.append(Goal(f"{what}, {title}: over `ekf` of {commit}", now / before, bar, "x"))
    text = (
        f"Processor time of this checkout beside that of commit {commit}, median of {rounds} rounds in turns. The "
        "default has no counterpart there: it stands beside the extended filter, which was the default then."
    )
    return Section(
        f"Against {commit}", text, ("what", "filter", f"`ekf` of {commit}", "now", "over it"), rows, tuple(goals)
    )


def _measured(root: Path, folder: Path) -> dict[str, float]:
    """Seconds of every line in a checkout, its files and compiled code in a folder of its own."""
    folder = folder.with_name(f"{folder.name} files")
    folder.mkdir(exist_ok=True)
    places = os.pathsep.join(map(str, (root / "src", root / "lab")))
    # an installed package has its byte code: `run` makes it here before it measures
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    alone = {"OMP_NUM_THREADS": "1", "OHMWARD_THREADS": "1", "OHMWARD_CACHE": str(folder / "cache")}
    alone |= {"OHMWARD_LOWERING": "machine"}  # no first steps in Python
    done = subprocess.run(
        [sys.executable, "-c", _MEASURED],
        check=True,
        cwd=folder,
        env={**kept, **alone, "PYTHONPATH": places},
        stdout=subprocess.PIPE,
    )
    return json.loads(done.stdout)


if __name__ == "__main__":
    print("\n".join(page(against(sys.argv[1]))))
