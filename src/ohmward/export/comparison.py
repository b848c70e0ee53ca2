"""What single precision changes: a twin's answer to a log against the same program in double precision."""

from __future__ import annotations

from typing import Any

import numpy as np

from ohmward.errors import InputError
from ohmward.export.c_library import Export
from ohmward.export.twin import Twin
from ohmward.trace import scan
from ohmward.trace.lower import python_source
from ohmward.trace.lower.c_source import members
from ohmward.trace.lower.llvm_logs import run_log
from ohmward.trace.lower.llvm_machine_code import NoMachineCodeError
from ohmward.trace.lower.llvm_run import MachineStep
from ohmward.trace.structure import flatten, size


def compare(twin: Twin, export: Export, found: Any, samples: Any, arguments: tuple[float, ...]) -> dict[str, float]:
    """Largest difference of each member of the output over a log, |single - double|; nan against a number is inf.

    found:     the twin's outputs (T, ...).
    samples:   of the log (T, ...), whose first the start looks at.
    arguments: of the start.

    Raises:
        InputError: the library in the twin's folder is another estimator's.
    """
    check_same(twin, export)
    exact = flatten(_structures(export)[2], in_double_precision(export, samples, arguments))
    named = zip(twin.Output._fields, found, (x for x in exact if np.size(x)), strict=True)
    return {member: _largest(np.asarray(single, float), np.asarray(double, float)) for member, single, double in named}


def check_same(twin: Twin, export: Export) -> None:
    """Refuse a library that another estimator was exported to."""
    for word, structure in zip(("state", "sample", "output"), _structures(export), strict=True):
        wanted, has = [m.name for m in members(structure)], list(twin.dtype(word).names or ())
        if wanted != has:
            other = sorted(set(wanted) ^ set(has)) or ["another order"]
            raise InputError(
                f"library {twin.name!r} is not {export.title!r}: its {word} differs in {', '.join(other)}; "
                "name with --filter what was exported"
            )


def in_double_precision(export: Export, samples: Any, arguments: tuple[float, ...]) -> Any:
    """Outputs (T, ...) of the exported step over a log, in machine code where it is installed."""
    structures = _structures(export)
    columns, _ = scan.sample_columns(structures[1], samples)
    first = scan.state_tree(structures[1], [float(column[0]) for column in columns])
    state = python_source.compile_call(export.start)(first, *arguments)
    count = size(structures[0])
    try:
        return run_log(MachineStep(export.step, count), structures, state, samples)[1]
    except NoMachineCodeError:
        return scan.run(python_source.compile_scan(export.step, count), *structures, state, samples)[1]


def _structures(export: Export) -> tuple[Any, Any, Any]:
    """Of state, sample and output."""
    (before, sample), result = export.step.argument_structure.children, export.step.result_structure
    return before, sample, result.children[1]  # type: ignore[union-attr]


def _largest(single: np.ndarray, double: np.ndarray) -> float:
    if (np.isnan(single) != np.isnan(double)).any():
        return float("inf")
    return float(np.max(np.abs(single - double), initial=0.0, where=np.isfinite(double)))
