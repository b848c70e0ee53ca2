"""Cost of a step against states, length of the log and number of logs; part of `make bench`."""

from __future__ import annotations

import time
import tracemalloc
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from types import ModuleType
from typing import Any

import numpy as np

from ohmward.battery.soc.textbook import TextbookFilter
from ohmward.filters import Belief, extended, unscented
from ohmward.report import Figure, Series
from ohmward.trace import Kernel
from timing import Picture, Section, Times, duration, measure, ratio
from workloads import Drive, cell_model, cell_start, make_drive

STATES = (2, 3, 4, 6, 8, 10, 12)
LENGTHS = (1_000, 10_000, 100_000, 1_000_000, 10_000_000)
LOGS = (1, 8, 64, 512, 1024, 2048, 8192)
CHAIN_STEPS, PEER_STEPS, LANE_STEPS = 2000, 50, 200
METHODS: dict[str, ModuleType] = {"EKF": extended, "UKF": unscented}
RATE, DRAG, R = 0.1, 0.02, 1e-2
#: A log of any length is this one, over and over.
PIECE = 10_000


# ---- states


def states_section(repeats: int, states: tuple[int, ...] = STATES) -> Section:
    """A chain of n masses that pull at each other, the first one measured."""
    runs: dict[tuple[str, str, int], Callable[[], object]] = {}
    ready: dict[tuple[str, int], float] = {}
    sizes: dict[tuple[str, int], int] = {}
    for method in METHODS:
        for n in states:
            began = time.process_time()
            kernel = Kernel(partial(chain_step, METHODS[method]), chain_start(n), (0.0, 0.0), lowering="machine")
            runs[method, "ours", n] = run = partial(kernel.scan, chain_start(n), chain_log(CHAIN_STEPS))
            run()
            ready[method, n], sizes[method, n] = time.process_time() - began, len(kernel.machine.expanded.nodes)
            if peer := filterpy_chain(method, n):
                runs[method, "FilterPy", n] = peer
    times = {k: t.per(CHAIN_STEPS if k[1] == "ours" else PEER_STEPS) for k, t in measure(runs, repeats).items()}
    rows = [states_row(method, n, times, sizes[method, n], ready[method, n]) for method in METHODS for n in states]
    text = (
        "A chain of n states, each pulled at by its neighbours with a force that is not linear; the first one is "
        "measured. The same model by `ohmward.filters` in machine code and by FilterPy."
    )
    header = ("filter", "states", "operations", "ours", "FilterPy", "FilterPy over ours", "ours ready in")
    picture = Picture("speed-states", states_figure(times, states))
    return Section("Cost against the number of states", text, header, rows, picture=picture)


def states_figure(times: dict[Any, Times], states: tuple[int, ...]) -> Figure:
    """Time against states, logarithmic."""
    series = [
        Series(np.array(states, dtype=float), 1e6 * medians, f"{who}, {method}", style)
        for who, style in (("ours", "line"), ("FilterPy", "dashed"))
        for method in METHODS
        if len(medians := np.array([times[method, who, n].median for n in states if (method, who, n) in times]))
    ]
    title = "Time of a step against the number of states, one log"
    return Figure(title, "States", "Time of a step [us]", series, log_y=True)


def states_row(method: str, n: int, times: dict[Any, Times], operations: int, ready_s: float) -> tuple[str, ...]:
    ours, peer = times[method, "ours", n].median, times.get((method, "FilterPy", n))
    theirs = ("not installed", "") if peer is None else (duration(peer.median), ratio(peer.median, ours))
    return (method, str(n), str(operations), duration(ours), *theirs, duration(ready_s))


def chain_next(x: np.ndarray, u: Any) -> np.ndarray:
    """State (n,) a step later: neighbours pull, the input pushes the first, a cubic drag holds all back."""
    pulls = [0.0, *(RATE * (b - a) for a, b in pairwise(x)), 0.0]
    pushed = [u, *(0.0 for _ in x[1:])]
    drag = [DRAG * a * a * a for a in x]
    return np.array([x[k] + pushed[k] + pulls[k + 1] - pulls[k] - drag[k] for k in range(len(x))])


def chain_jacobian(x: np.ndarray) -> np.ndarray:
    """Of `chain_next`, (n, n)."""
    n = len(x)
    F = np.diag(1 - 3 * DRAG * x**2) + RATE * (np.eye(n, k=1) + np.eye(n, k=-1))
    neighbours = np.full(n, 2.0)
    neighbours[[0, -1]] -= 1.0
    return F - RATE * np.diag(neighbours)


def chain_step(filter_: ModuleType, belief: Belief, sample: tuple) -> tuple[Belief, Any]:
    u, y = sample
    Q = np.diag([1e-4] * len(belief.mean))
    prior = filter_.predict(belief, lambda x: chain_next(x, u), Q)
    after, _ = filter_.update(prior, np.array([y]), lambda x: x[:1], np.array([[R]]))
    return after, after.mean


def chain_start(n: int) -> Belief:
    return Belief(np.zeros(n), 0.1 * np.eye(n))


def chain_log(steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Input and measurement."""
    rng = np.random.default_rng(0)
    return 0.1 * rng.standard_normal(steps), 0.3 * rng.standard_normal(steps)


def filterpy_chain(method: str, n: int) -> Callable[[], Belief] | None:
    """FilterPy's filter over the first samples; None where it is not installed."""
    try:
        from filterpy.kalman import ExtendedKalmanFilter, MerweScaledSigmaPoints, UnscentedKalmanFilter
    except ModuleNotFoundError:
        return None
    samples = list(zip(*chain_log(PEER_STEPS), strict=True))
    H = np.eye(1, n)

    class Extended(ExtendedKalmanFilter):
        def predict_x(self, u: Any = 0.0) -> None:
            self.F, self.x = chain_jacobian(self.x), chain_next(self.x, u)

    def made() -> Any:
        if method == "EKF":
            return Extended(n, 1)
        points = MerweScaledSigmaPoints(n, *unscented.DEFAULT)
        return UnscentedKalmanFilter(n, 1, 1.0, lambda x: x[:1], lambda x, dt, u: chain_next(x, u), points)

    def run() -> Belief:
        filter_ = made()
        filter_.x, filter_.P = chain_start(n)
        filter_.Q, filter_.R = 1e-4 * np.eye(n), np.array([[R]])
        for u, y in samples:
            filter_.predict(u=u)
            if method == "EKF":
                filter_.update(np.array([y]), lambda x: H, lambda x: x[:1])
            else:
                filter_.update(np.array([y]))
        return Belief(filter_.x, filter_.P)

    return run


# ---- length


def length_section(repeats: int, lengths: tuple[int, ...] = LENGTHS) -> Section:
    """One log after the other, ten times as long each."""
    ours = TextbookFilter(cell_model(), method="ekf")
    piece = make_drive(PIECE)
    kernel = Kernel(ours.step, cell_start(ours, piece), first_sample(piece), lowering="machine")
    rows = [length_row(kernel, cell_start(ours, piece), piece, length, repeats) for length in lengths]
    text = (
        "The textbooks' EKF of the cell over one log. Memory is what Python and NumPy hold at most during the run, "
        "beyond the log and its estimates."
    )
    return Section("Cost against the length of the log", text, ("samples", "whole log", "a step", "memory"), rows)


def length_row(kernel: Kernel, state: Any, piece: Drive, length: int, repeats: int) -> tuple[str, ...]:
    repeated = -(-length // len(piece.current_A))
    samples = Drive(*(np.tile(column, repeated)[:length] for column in piece)).samples
    seconds = measure({0: partial(kernel.scan, state, samples)}, 1 if length > 1_000_000 else repeats)[0].median
    beyond = memory_beyond(partial(kernel.scan, state, samples))
    return f"{length:,}", duration(seconds), duration(seconds / length), beyond


def memory_beyond(run: Callable[[], tuple[Any, Any]]) -> str:
    """Memory that Python and NumPy hold at most during a run, besides the estimates that it returns."""
    tracemalloc.start()
    _, estimates = run()
    beyond = tracemalloc.get_traced_memory()[1] - sum(column.nbytes for column in estimates)
    tracemalloc.stop()
    return f"{max(beyond, 0) / 1e6:.2g} MB"


def first_sample(drive: Drive) -> Any:
    return type(drive.samples)(*(float(column[0]) for column in drive.samples))


# ---- number of logs


def logs_section(repeats: int, numbers: tuple[int, ...] = LOGS) -> Section:
    """The same length, more and more logs, on one core."""
    ours, drive = TextbookFilter(cell_model(), method="ekf"), make_drive(PIECE)
    start = cell_start(ours, drive)
    kernels = {
        "machine code": Kernel(ours.step, start, first_sample(drive), lowering="machine"),
        "NumPy over lanes": Kernel(ours.step, start, first_sample(drive), lowering="python"),
    }
    runs = {
        (how, logs): partial(kernel.scan_lanes, start, lanes_of(drive, logs))
        for logs in numbers
        for how, kernel in kernels.items()
    }
    times = measure(runs, repeats)
    rows = [
        (
            str(logs),
            duration(times["machine code", logs].median),
            *(duration(times[how, logs].per(logs * LANE_STEPS).median) for how in kernels),
            memory_beyond(runs["machine code", logs]),
        )
        for logs in numbers
    ]
    text = (
        f"The textbooks' EKF of the cell, {LANE_STEPS} samples of each log, through `Kernel.scan_lanes`: processor "
        "time of all threads. Memory is that of machine code beyond logs and estimates."
    )
    header = ("logs", "all of them, machine code", "a step of a log, machine code", "NumPy over lanes", "memory")
    picture = Picture("speed-logs", logs_figure(times, numbers, tuple(kernels)))
    return Section("Cost against the number of logs", text, header, rows, picture=picture)


def logs_figure(times: dict[Any, Times], numbers: tuple[int, ...], ways: tuple[str, ...]) -> Figure:
    """Time against the number of logs, both logarithmic."""
    x = np.log2(numbers)
    series = [
        Series(x, np.array([1e6 * times[how, n].per(n * LANE_STEPS).median for n in numbers]), how) for how in ways
    ]
    title = "Time of a step of each log against the number of logs"
    return Figure(title, "Logs, as power of two", "Time of a step of a log [us]", series, log_y=True)


def lanes_of(drive: Drive, logs: int) -> Any:
    """Pieces of the drive (T, B)."""
    starts = np.random.default_rng(3).integers(0, len(drive.current_A) - LANE_STEPS, logs)
    return Drive(*(np.stack([c[s : s + LANE_STEPS] for s in starts], axis=1) for c in drive)).samples
