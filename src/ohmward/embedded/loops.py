"""Steps of bare filters as loops over their states in C: a fraction of the size of straight-line code, but slower.

The loops are written by hand in templates/loops, as a second source of these filters. The model's part (next state,
curve, sanitised sample, output) is traced and becomes straight-line code that the loops call. The operations and their
order are those of the filter in NumPy, so the test vectors of the straight-line code hold for the loops bit for bit.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from ohmward.battery.soc.sample import SocSample
from ohmward.battery.soc.textbook import TextbookFilter
from ohmward.embedded.c_library import filled, template
from ohmward.filters import unscented
from ohmward.filters.linear_algebra import PIVOT_FLOOR, TINY
from ohmward.trace import Program, Scalar, linearize, trace
from ohmward.trace.lower.c_operations import literal
from ohmward.trace.lower.c_source import Function, Loops, members, places
from ohmward.trace.structure import Structure

EXAMPLE = SocSample(0.0, 0.0, 0.0, 0.0)

#: Bytes of Thumb-2 code of the loops themselves, compiled with -Os.
_CODE_BYTES = {"unscented": 640, "extended": 440}

#: Gives a function of state and sample a constant time step, if the library is exported for one.
AtRate = Callable[[Callable[..., Any]], Callable[..., Any]]


def textbook_loops(textbook: TextbookFilter, state: Any, name: str, at_rate: AtRate) -> Loops:
    """Loops of the filter of SoC and RC voltages, extended or unscented."""
    predicted = trace(at_rate(textbook.predicted), state, EXAMPLE, with_origins=True)
    n = len(state.belief.mean)
    w = unscented.pair_weights(n)
    words = {
        "N": str(n),
        "SCALE": literal(math.sqrt(w.spread)),
        "SIDE": literal(w.side),
        "PAIR": literal(w.pair),
        "CENTRE": literal(unscented.DEFAULT.beta - unscented.DEFAULT.alpha**2),
        "VOLTAGE_VARIANCE": literal(textbook.voltage_variance),
    }
    linearised = "unscented" if textbook.method == "ukf" else "extended"
    words["LINEARISED"] = _text(linearised, name, words)
    _, clean = parts_of(predicted.result_structure)
    functions = _textbook_functions(textbook, state, name, predicted)
    return loops_of("textbook", name, words, clean, functions, _CODE_BYTES[linearised])


def _textbook_functions(textbook: TextbookFilter, state: Any, name: str, predicted: Program) -> list[Function]:
    """Straight-line code of the textbook filter: predict, the voltage of a state of charge, the output."""
    example = textbook.predicted(state, EXAMPLE)[1]
    estimate = trace(textbook.estimate, 0.0, 0.0, 0.0, 0.0, example, with_origins=True)
    before, clean = parts_of(predicted.result_structure)
    in_state, in_clean = places("state", members(before)), places("clean", members(clean))
    in_sample = places("sample", members(predicted.argument_structure.children[1]))
    return [
        Function(
            "The state before the voltage is used, and the sanitised sample.",
            f"static void {name}_predict({name}_state *state, const {name}_sample *sample, {name}_clean *clean)",
            predicted,
            in_state + in_sample,
            in_state + in_clean,
        ),
        _curve(textbook, name, example, in_clean),
        Function(
            "The output after the step.",
            f"static void {name}_conclude(const {name}_state *state, const {name}_clean *clean, float innovation, "
            f"float S, {name}_output *output)",
            estimate,
            ["state->belief_mean[0]", "state->belief_lower[0]", "innovation", "S", *in_clean],
            places("output", members(estimate.result_structure)),
        ),
    ]


def _curve(textbook: TextbookFilter, name: str, example: Any, in_clean: list[str]) -> Function:
    """The voltage without the RC pairs; with its slope for the extended filter."""

    def value(soc: Scalar, clean: Any) -> Any:
        return textbook.curve_V(soc, clean.drop_V)

    def value_and_slope(soc: Scalar, clean: Any) -> Any:
        y, slope = linearize(lambda x: np.array([value(x[0], clean)]), np.array([soc]))
        return y[0], slope[0, 0]

    prototype = f"{name}_curve(float soc, const {name}_clean *clean"
    comment, inputs = "The voltage minus that of the RC pairs.", ["soc", *in_clean]
    if textbook.method == "ukf":
        program = trace(value, 0.0, example, with_origins=True)
        return Function(comment, f"static float {prototype})", program, inputs, ["return"])
    program = trace(value_and_slope, 0.0, example, with_origins=True)
    return Function(comment, f"static void {prototype}, float *y, float *slope)", program, inputs, ["*y", "*slope"])


def loops_of(
    file: str, name: str, words: dict[str, str], clean: Structure, functions: list[Function], code_bytes: int
) -> Loops:
    """Loops of a file of templates/loops, with its words filled in.

    clean: structure of the sanitised sample.  code_bytes: of the loops themselves, Thumb-2 code compiled with -Os.
    """
    return Loops({"clean": clean}, functions, _text(file, name, words), code_bytes)


def _text(file: str, name: str, words: dict[str, str]) -> str:
    common = {"NAME": name, "PIVOT_FLOOR": literal(PIVOT_FLOOR), "TINY": literal(TINY)}
    return filled(template(f"loops/{file}.c"), common | words)


def parts_of(structure: Structure) -> tuple[Structure, Structure]:
    """Both parts of what a step returns."""
    first, second = structure.children  # type: ignore[union-attr]
    return first, second
