"""An estimator of a battery as one file of Python, for where the package is not: blind benchmarks, reviews, teaching.

The file is the traced program in double precision, operation by operation, and the definitions of these operations.
"""

from __future__ import annotations

import inspect
from collections.abc import Sequence
from keyword import iskeyword

from ohmward import __version__
from ohmward.battery.soc.sample import SocFlag
from ohmward.errors import InputError
from ohmward.export.c_library import Export
from ohmward.export.template import filled, template
from ohmward.trace import ieee
from ohmward.trace.lower.python_source import Body, body
from ohmward.trace.structure import scalar_names, size

#: Interval of the rows of `Model` where the export leaves the time between samples free [s]: that of blind benchmarks.
USUAL_INTERVAL_S = 1.0


def python_file(export: Export, sample_time_s: float | None = None) -> str:
    """Text of the file: `start` and `step`, and `Model(X, z)` over rows of current, voltage and temperature.

    sample_time_s: that the export was made with; None takes the rows to come once a second.

    Raises:
        InputError: the export is no estimator of the state of charge, or its name is none of a module.
    """
    if export.flags is not SocFlag:
        raise InputError(
            f"{export.title}: Python is written for estimators of the state of charge; leave out --language"
        )
    if not export.name.isidentifier() or iskeyword(export.name):
        raise InputError(
            f"name must be one that Python can import, letters, digits and underscores, got {export.name!r}"
        )
    structure = export.step.step_structure
    step, start = body(export.step, safe=True), body(export.start, safe=True)
    states, samples = size(structure.state), size(structure.sample)
    words = {
        "TITLE": _safe(export.title),
        "VERSION": __version__,
        "NAME": export.name,
        "INTERVAL": repr(float(sample_time_s or USUAL_INTERVAL_S)),
        "ARGUMENTS": repr(export.arguments),
        "SAMPLE": repr(scalar_names(structure.sample)),
        "OUTPUT": repr(scalar_names(structure.output)),
        "FLAGS": repr({flag.name: flag.value for flag in export.flags}),
        "OPERATIONS": _definitions(),
        "START_FUNCTION": _function(
            f"start({', '.join(['sample', *start.inputs[samples:]])})",
            '"""State before the first sample, which is looked at."""',
            [f"{_row(start.inputs[:samples])} = sample"],
            start,
            _row(start.outputs),
        ),
        "STEP_FUNCTION": _function(
            "step(state, sample)",
            '"""State and Output after a sample."""',
            [f"{_row(step.inputs[:states])} = state", f"{_row(step.inputs[states:])} = sample"],
            step,
            f"{_row(step.outputs[:states])}, Output{_row(step.outputs[states:])}",
        ),
    }
    return filled(template("python/model.py.in"), words)


def _function(head: str, docstring: str, unpacked: Sequence[str], code: Body, result: str) -> str:
    """Source of a function: its tables, then one line for each value."""
    tables = [f"{name} = {values!r}" for name, values in code.tables.items()]
    return "\n    ".join([f"def {head}:", docstring, *unpacked, *tables, *code.lines, f"return {result}"])


def _row(names: Sequence[str]) -> str:
    return f"({''.join(f'{name}, ' for name in names).rstrip()})"


def _safe(title: str) -> str:
    """The title as it can stand in a docstring."""
    return " ".join(title.replace("\\", "/").replace('"', "'").split())


def _definitions() -> str:
    """The definitions of the operations, below their imports."""
    text = inspect.getsource(ieee)
    return text[text.index("#: Errors") :].strip()
