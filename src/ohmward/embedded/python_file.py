"""An estimator of a battery as one Python file that does not need the package: blind benchmarks, reviews, teaching.

The file is the traced program in double precision, operation by operation, and the definitions of these operations.
"""

from __future__ import annotations

import inspect
from collections.abc import Sequence
from keyword import iskeyword
from types import ModuleType

from ohmward import __version__
from ohmward.battery.soc import start_density
from ohmward.battery.soc.sample import INITIAL_SOC_STD
from ohmward.embedded.c_library import Export, filled, template
from ohmward.errors import InputError
from ohmward.trace import ieee
from ohmward.trace.lower.python_source import Body, body
from ohmward.trace.structure import scalar_names, size

#: Interval of the rows of `Model` [s] where the export has no constant sample time: that of blind benchmarks.
USUAL_INTERVAL_S = 1.0


def python_file(
    export: Export, sample_time_s: float | None = None, soc: float | None = None, soc_std: float = INITIAL_SOC_STD
) -> str:
    """Text of the file: `start` and `step`, and `Model(X, z)` over rows of current, voltage and temperature.

    sample_time_s: that the export was made with; None assumes one row a second.
    soc, soc_std: initial state of charge, combined with the first voltage; None takes it from that voltage alone.

    Raises:
        InputError: the export is not an estimator that starts from the first voltage, or its name not a module name.
    """
    if export.voltage_start is None:
        raise InputError(
            f"{export.title}: Python is written for estimators of the state of charge that start from the first "
            "voltage, such as gsf, ekf, rc and coulomb; choose one of them, or leave out --language"
        )
    if not export.name.isidentifier() or iskeyword(export.name):
        raise InputError(
            f"name must be one that Python can import, letters, digits and underscores, got {export.name!r}"
        )
    structure = export.step.step_structure
    step = body(export.step, safe=True)
    expected, start = (body(program, safe=True) for program in export.voltage_start)
    states, samples = size(structure.state), size(structure.sample)
    count = len(export.voltage_start.state.argument_structure.children) - 1
    words = {
        "TITLE": " ".join(export.title.replace("\\", "/").replace('"', "'").split()),  # it stands in a docstring
        "VERSION": __version__,
        "NAME": export.name,
        "INTERVAL": repr(float(sample_time_s or USUAL_INTERVAL_S)),
        "START": repr((soc, soc_std)),
        "COUNT": str(count),
        "SAMPLE": repr(scalar_names(structure.sample)),
        "OUTPUT": repr(scalar_names(structure.output)),
        "FLAGS": repr({flag.name: flag.value for flag in export.flags}),
        "OPERATIONS": _definitions(ieee),
        "DENSITY": _definitions(start_density),
        "EXPECTED_FUNCTION": _function(
            f"expected_voltage({expected.inputs[0]}, sample)",
            '"""Mean and standard deviations of the first voltage at a state of charge."""',
            [f"{_row(expected.inputs[1:])} = sample"],
            expected,
            f"ExpectedVoltage{_row(expected.outputs)}",
        ),
        "START_FUNCTION": _function(
            "start_from(sample, *parts)",
            '"""State before the first sample, for each part of the density of the state of charge."""',
            [f"{_row(start.inputs[:samples])} = sample", f"{_parts(start.inputs[samples:], count)} = parts"],
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
    tables = [f"{name} = {values!r}" for name, values in code.tables.items()]
    return "\n    ".join([f"def {head}:", docstring, *unpacked, *tables, *code.lines, f"return {result}"])


def _row(names: Sequence[str]) -> str:
    return f"({''.join(f'{name}, ' for name in names).rstrip()})"


def _parts(names: Sequence[str], count: int) -> str:
    """The names as `count` hypotheses: each a weight, and the numbers of its start."""
    length = len(names) // count
    parts = [names[k * length : (k + 1) * length] for k in range(count)]
    return _row([_row([weight, _row(start)]) for weight, *start in parts])


def _definitions(module: ModuleType) -> str:
    """The definitions of a module that needs NumPy alone, below its imports."""
    return inspect.getsource(module).split("\nimport numpy as np\n", 1)[1].strip()
