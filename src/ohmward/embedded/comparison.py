"""Effect of single precision: the outputs of a twin against those of the same program in double precision."""

from __future__ import annotations

from typing import Any

import numpy as np

from ohmward.embedded.c_library import Export
from ohmward.embedded.twin import Twin
from ohmward.errors import InputError
from ohmward.trace import scan
from ohmward.trace.lower import python_source
from ohmward.trace.lower.c_source import members
from ohmward.trace.lower.llvm_logs import run_log
from ohmward.trace.lower.llvm_machine_code import NoMachineCodeError
from ohmward.trace.lower.llvm_run import MachineStep
from ohmward.trace.structure import flatten, shaped, size


def compare(twin: Twin, export: Export, found: Any, samples: Any, arguments: tuple[float, ...]) -> dict[str, float]:
    """Largest difference of each member of the output over a log, |single - double|; nan against a number is inf.

    found:     the twin's outputs (T, ...).
    samples:   of the log (T, ...); the start uses the first.
    arguments: of the start.

    Raises:
        InputError: the library in the twin's folder is another estimator's.
    """
    check_same(twin, export)
    exact = flatten(export.step.step_structure.output, in_double_precision(export, samples, arguments))
    named = zip(twin.Output._fields, found, (x for x in exact if np.size(x)), strict=True)
    return {member: _largest(np.asarray(single, float), np.asarray(double, float)) for member, single, double in named}


def check_same(twin: Twin, export: Export) -> None:
    """Raise InputError for a library of another estimator."""
    for word, structure in export.step.step_structure._asdict().items():
        wanted, has = [m.name for m in members(structure)], list(twin.dtype(word).names or ())
        if wanted != has:
            other = sorted(set(wanted) ^ set(has)) or ["another order"]
            raise InputError(
                f"library {twin.name!r} is not {export.title!r}: its {word} differs in {', '.join(other)}; "
                "name with --filter what was exported"
            )


def in_double_precision(export: Export, samples: Any, arguments: tuple[float, ...]) -> Any:
    """Outputs (T, ...) of the exported step over a log, in machine code where it is installed."""
    step, structure = export.step, export.step.step_structure
    columns, _ = scan.sample_columns(structure.sample, samples)
    first = shaped(structure.sample, [float(column[0]) for column in columns])
    state = python_source.compile_call(export.start)(first, *arguments)
    state_size = size(structure.state)
    try:
        _, outputs = run_log(MachineStep(step, state_size), state, samples)
    except NoMachineCodeError:
        _, outputs = scan.run(python_source.compile_scan(step, state_size), structure, state, samples)
    return outputs


def _largest(single: np.ndarray, double: np.ndarray) -> float:
    if (np.isnan(single) != np.isnan(double)).any():
        return float("inf")
    return float(np.max(np.abs(single - double), initial=0.0, where=np.isfinite(double)))
