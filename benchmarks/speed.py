"""Time per step with NumPy alone and in machine code: `make speed` writes benchmarks/speed.md.

Everything is measured side by side in one run, on one core, as the median of several repetitions: absolute times belong
to the machine, ratios are what travels. FilterPy is the peer: the same models, as its users would write them.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import platform
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter, MerweScaledSigmaPoints, UnscentedKalmanFilter

import machine_speed
from observer_speed import step_times
from ohmward.battery import rc
from ohmward.battery.chemistries import start_model, start_noise
from ohmward.battery.estimate import Sample
from ohmward.battery.rc.adaptive_soc import adaptive_soc_of
from ohmward.battery.simulation import simulate_voltage
from ohmward.battery.textbook_filter import TextbookFilter
from ohmward.battery.thevenin_filter import TheveninFilter
from ohmward.logs import Log
from ohmward.trace import Kernel

HERE = Path(__file__).resolve().parent
STEPS, LANES, LANE_STEPS, REPEATS = 20_000, 1024, 200, 5


class Row(NamedTuple):
    """One line of the table: seconds of one step of one log."""

    what: str
    how: str
    seconds: float
    bar_s: float | None = None
    share: float = float("nan")


def main() -> int:
    log = drive()
    rows = [*one_log(log), *many_logs(log), *observers(), *machine(log), *peers(log), *start_up()]
    for row in rows:
        print(_cells(row))
    (HERE / "speed.md").write_text(_page(rows))
    return 0


def drive() -> Log:
    """A drive of an NMC cell with its voltage, 1 s apart."""
    rng = np.random.default_rng(1)
    current_A = np.repeat(rng.normal(-0.15, 1.0, STEPS // 20), 20)
    log = Log("drive", np.arange(STEPS, dtype=float), current_A, np.full(STEPS, 3.7))
    voltage_V = simulate_voltage(MODEL, log, 0.95).voltage_V + 0.002 * rng.standard_normal(STEPS)
    return Log("drive", log.time_s, current_A, voltage_V)


MODEL = start_model("nmc", 2.0)
CAPACITANCE_F = rc.capacitance_for(MODEL.capacity_Ah, MODEL.ocv)
RC = rc.RcModel(0.97 * CAPACITANCE_F, 0.03 * CAPACITANCE_F, 0.03, 0.03, 0.06, MODEL.ocv, MODEL.capacity_Ah)
ESTIMATORS = {
    "seven-state joint AUKF of [T] (RC parameters), faults handled": adaptive_soc_of(RC).joint,
    "Thevenin EKF, 8 states, faults handled": TheveninFilter(MODEL, start_noise(2.0)),
    "Thevenin UKF, 8 states, faults handled": TheveninFilter(MODEL, start_noise(2.0), method="ukf"),
}


def samples_of(log: Log) -> Sample:
    return Sample(np.diff(log.time_s, prepend=log.time_s[0]), log.current_A, log.voltage_V, np.full(STEPS, np.nan))


def one_log(log: Log) -> list[Row]:
    samples, rows = samples_of(log), []
    for name, estimator in ESTIMATORS.items():
        state = estimator.init(Sample(*(float(c[0]) for c in samples)))
        kernel = Kernel(estimator.step, state, Sample(0.0, 0.0, 0.0, 0.0), lowering="python")
        kernel.scan(state, Sample(*(c[:10] for c in samples)))
        seconds = median(lambda k=kernel, s=state: k.scan(s, samples)) / STEPS
        rows.append(Row(name, "one log, Python source", seconds, 30e-6 if "AUKF" in name else None))
    return rows


def many_logs(log: Log) -> list[Row]:
    columns, rows = samples_of(log), []
    lanes = lanes_of(columns)
    for name, estimator in ESTIMATORS.items():
        state = estimator.init(Sample(*(float(c[0]) for c in columns)))
        kernel = Kernel(estimator.step, state, Sample(0.0, 0.0, 0.0, 0.0), lowering="python")
        kernel.scan_lanes(state, Sample(*(c[:2] for c in lanes)))
        seconds = median(lambda k=kernel, s=state: k.scan_lanes(s, lanes)) / (LANES * LANE_STEPS)
        rows.append(Row(name, f"{LANES} logs, NumPy over lanes", seconds, 700e-9 if "AUKF" in name else None))
    return rows


def lanes_of(columns: Sample) -> Sample:
    """Pieces of the drive, one for each lane: (T, B)."""
    starts = np.random.default_rng(2).integers(0, STEPS - LANE_STEPS, LANES)
    return Sample(*(np.stack([c[s : s + LANE_STEPS] for s in starts], axis=1) for c in columns))


def machine(log: Log) -> list[Row]:
    """The same estimators and that of the textbooks in machine code."""
    samples = samples_of(log)
    estimators = ESTIMATORS | {"Thevenin UKF of the textbooks, 3 states": TextbookFilter(MODEL)}
    public = {name: e for name, e in estimators.items() if "AUKF" not in name}
    timed = [
        *machine_speed.one_log(estimators, samples, median),
        *machine_speed.many_logs(estimators, samples, lanes_of(samples), median),
        *machine_speed.live(public, median),
        *machine_speed.compilation(estimators, samples),
    ]
    return [Row(t.what, t.how, t.seconds, t.bar_s, t.share) for t in timed]


def observers() -> list[Row]:
    """The speed observer of the traction half on one log."""
    rows = []
    for name, step_s, operations, _ in step_times():
        how = f"one log, Python source, {operations} operations"
        rows.append(Row(f"speed observer: {name}", how, step_s, 30e-6 if "AUKF" in name else None))
    return rows


def peers(log: Log) -> list[Row]:
    """FilterPy on the bare Thevenin model (4 states, no fault handling), and its UKF with seven states."""
    count = 300
    current_A, voltage_V = log.current_A[:count], log.voltage_V[:count]
    return [
        Row(
            "FilterPy EKF, 4 states, given Jacobians",
            "one log",
            median(lambda: _run_extended(current_A, voltage_V)) / count,
        ),
        Row("FilterPy UKF, 4 states", "one log", median(lambda: _run_unscented(4, current_A, voltage_V)) / count),
        Row("FilterPy UKF, 7 states", "one log", median(lambda: _run_unscented(7, current_A, voltage_V)) / count),
    ]


def _f(x: np.ndarray, dt: float, i: float = 0.0) -> np.ndarray:
    """The bare Thevenin model by hand; states beyond the third are constant."""
    decay_1, decay_2 = np.exp(-dt / 20.0), np.exp(-dt / 500.0)
    v1, v2 = decay_1 * x[1] + 0.015 * (1 - decay_1) * i, decay_2 * x[2] + 0.02 * (1 - decay_2) * i
    return np.array([x[0] + i * dt / 7200, v1, v2, *x[3:]])


def _h(x: np.ndarray, i: float = 0.0) -> np.ndarray:
    return np.array([3.4 + 0.7 * x[0] + x[1] + x[2] + 0.05 * i])


def _run_extended(current_A: np.ndarray, voltage_V: np.ndarray) -> None:
    filter_ = ExtendedKalmanFilter(dim_x=4, dim_z=1)
    filter_.x = np.array([0.9, 0.0, 0.0, 0.0])
    filter_.F = np.diag([1.0, np.exp(-1 / 20.0), np.exp(-1 / 500.0), 1.0])
    filter_.Q, filter_.R = 1e-8 * np.eye(4), 1e-4 * np.eye(1)
    H = np.array([[0.7, 1.0, 1.0, 0.0]])
    for i, y in zip(current_A, voltage_V, strict=True):
        filter_.predict()
        filter_.update(np.array([y]), lambda x: H, lambda x, i=i: _h(x, i))


def _run_unscented(n: int, current_A: np.ndarray, voltage_V: np.ndarray) -> None:
    filter_ = UnscentedKalmanFilter(n, 1, 1.0, _h, _f, MerweScaledSigmaPoints(n, 0.85, 2.0, 0.0))
    filter_.x = np.array([0.9] + [0.0] * (n - 1))
    filter_.P = 1e-3 * np.eye(n)
    filter_.Q, filter_.R = 1e-8 * np.eye(n), 1e-4 * np.eye(1)
    for i, y in zip(current_A, voltage_V, strict=True):
        filter_.predict(i=i)
        filter_.update(np.array([y]), i=i)


def start_up() -> list[Row]:
    """Whole processes."""

    def process(*words: str) -> Callable[[], object]:
        return lambda: subprocess.run([sys.executable, *words], check=True, capture_output=True)

    numpy_s = median(process("-c", "import numpy"))
    ours_s = median(process("-c", "import numpy, ohmward"))
    return [
        Row("import ohmward, beyond NumPy", "process", max(ours_s - numpy_s, 0.0), 0.1),
        Row("ohmward --help", "process", median(process("-m", "ohmward.cli", "--help")), 0.2),
    ]


def median(run: Callable[[], object]) -> float:
    """Median wall time of a call [s]."""
    times = []
    for _ in range(REPEATS):
        began = time.perf_counter()
        run()
        times.append(time.perf_counter() - began)
    return statistics.median(times)


def _cells(row: Row) -> str:
    bar = "" if row.bar_s is None else f"{_time(row.bar_s)}"
    verdict = "" if row.bar_s is None else "met" if row.seconds <= row.bar_s else "**missed**"
    share = f"{row.share:.0%}" if np.isfinite(row.share) else ""
    return f"| {row.what} | {row.how} | {_time(row.seconds)} | {share} | {bar} | {verdict} |"


def _time(seconds: float) -> str:
    for unit, factor in (("s", 1.0), ("ms", 1e3), ("us", 1e6)):
        if seconds * factor >= 1.0:
            return f"{seconds * factor:.3g} {unit}"
    return f"{seconds * 1e9:.3g} ns"


def _page(rows: list[Row]) -> str:
    lines = [
        "# Speed",
        "",
        "Written by `make speed`: medians on one core, everything in one run; Python source and NumPy over lanes need",
        "NumPy alone, machine code needs llvmlite. The peak is that of the core's fused multiply-adds, measured in the",
        f"same run: {machine_speed.peak_flops('f64') / 1e9:.0f} GFLOP/s in f64; comparisons, choices and look-ups do",
        "not count as operations. Absolute times belong",
        f"to the machine ({platform.machine()}, Python {platform.python_version()}, NumPy {np.__version__}): compare",
        "ratios. Our filters are the public ones: they survive bad samples, gate, and carry current offset, capacity",
        "and model error. FilterPy's run the bare model.",
        "",
        "| what | how | time per step and log | of the peak | to reach | |",
        "|---|---|---|---|---|---|",
    ]
    return "\n".join([*lines, *map(_cells, rows), ""])


if __name__ == "__main__":
    sys.exit(main())
