"""Time per step in machine code, and how much of what the core can do that is; part of `make speed`."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.estimate import Sample
from ohmward.battery.soc_estimator import SocEstimator
from ohmward.trace import Kernel, trace
from ohmward.trace.llvm import machine_code
from ohmward.trace.llvm.peak import peak_flops
from ohmward.trace.llvm.run import MachineStep
from ohmward.trace.scan import state_row
from ohmward.trace.structure import size

#: Operations that a floating-point unit does; comparisons, choices and table look-ups come on top.
FLOPS = ("add", "subtract", "multiply", "divide", "sqrt", "negative", "absolute", "minimum", "maximum")
Median = Callable[[Callable[[], object]], float]


class Timed(NamedTuple):
    """Seconds of one step of one log, and the share of the core's peak, nan where it means nothing."""

    what: str
    how: str
    seconds: float
    share: float = float("nan")
    bar_s: float | None = None


def one_log(estimators: dict[str, Any], samples: Sample, median: Median) -> Iterator[Timed]:
    """Whole logs: the recurrence waits for itself, so the peak is out of reach."""
    for name, estimator in estimators.items():
        state = start(estimator, samples)
        kernel = Kernel(estimator.step, state, EXAMPLE, lowering="machine")
        kernel.scan(state, samples)
        seconds = median(lambda k=kernel, s=state: k.scan(s, samples)) / len(samples[0])
        yield Timed(name, "one log, machine code", seconds)


def many_logs(estimators: dict[str, Any], samples: Sample, lanes: Sample, median: Median) -> Iterator[Timed]:
    """One core, a log in each SIMD lane."""
    peaks = {precision: peak_flops(precision) for precision in ("f64", "f32")}
    steps, width = lanes[0].shape
    for name, estimator in estimators.items():
        state = start(estimator, samples)
        program = trace(estimator.step, state, EXAMPLE)
        n = size(program.argument_structure.children[0])
        row = np.array(state_row(program.argument_structure.children[0], state), dtype=float)
        for precision, peak in peaks.items():
            step = MachineStep(program, n, precision)
            outputs = [np.empty((steps, width)) for _ in range(len(program.outputs) - n)]

            def run(step: MachineStep = step, row: np.ndarray = row, outputs: list = outputs) -> None:
                step.many(np.repeat(row[:, None], width, axis=1), list(lanes), outputs, None, threads=1)

            run()
            seconds = median(run) / (steps * width)
            flops = sum(step.expanded.operations[name] for name in FLOPS)
            how = f"{width} logs, machine code, {precision}, {flops} flops"
            yield Timed(name, how, seconds, flops / seconds / peak)


def live(estimators: dict[str, Any], median: Median) -> Iterator[Timed]:
    """One sample through the public `update()`."""
    for name, estimator in estimators.items():
        for lowering, bar_s in (("machine", 3e-6), ("python", 40e-6)):
            public = SocEstimator(estimator, 0.8, lowering=lowering)

            def run(public: SocEstimator = public) -> None:
                for k in range(2000):
                    public.update(float(k), -0.5, 3.7)

            run()
            yield Timed(name, f"update(), {lowering}", median(run) / 2000, bar_s=bar_s)


def compilation(estimators: dict[str, Any], samples: Sample) -> Iterator[Timed]:
    """From the function to the first result, with an empty cache and from the cache."""
    before = os.environ.get("OHMWARD_CACHE")
    for name, estimator in estimators.items():
        state = start(estimator, samples)
        with tempfile.TemporaryDirectory() as folder:
            os.environ["OHMWARD_CACHE"] = folder
            machine_code.llvm()
            for how, bar_s in (("trace and compile", 0.15), ("the same from the cache", 0.02)):
                began = time.perf_counter()
                Kernel(estimator.step, state, EXAMPLE, lowering="machine").live(state)
                yield Timed(name, how, time.perf_counter() - began, bar_s=bar_s if "AUKF" in name else None)
    if before is None:
        del os.environ["OHMWARD_CACHE"]
    else:
        os.environ["OHMWARD_CACHE"] = before


EXAMPLE = Sample(0.0, 0.0, 0.0, 0.0)


def start(estimator: Any, samples: Sample) -> Any:
    """The state before the log."""
    return estimator.init(Sample(*(float(column[0]) for column in samples)))
