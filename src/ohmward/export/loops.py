"""Steps of bare filters as loops over their states in C: a fraction of the code of the straight line, and slower.

The loops are written by hand in templates/loops: a second text of these filters. The model's part (next state, curve,
sanitised sample, output) is traced and becomes straight lines that the loops call. The operations and their order are
those of the filter in NumPy, so the test vectors of the straight line hold for the loops too, to the last bit.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from ohmward.battery.soc.sample import SocSample
from ohmward.battery.soc.textbook import TextbookFilter
from ohmward.export.template import filled, template
from ohmward.filters import unscented
from ohmward.filters.linear_algebra import PIVOT_FLOOR, TINY
from ohmward.published.rc_joint import PARAMETERS
from ohmward.published.textbook_joint import TextbookJoint
from ohmward.trace import linearize, trace
from ohmward.trace.expression import Scalar
from ohmward.trace.lower.c_operations import literal
from ohmward.trace.lower.c_source import Function, Loops, members, places
from ohmward.trace.program import Program
from ohmward.trace.structure import Structure

_EXAMPLE = SocSample(0.0, 0.0, 0.0, 0.0)

#: Bytes of Thumb-2 code of the loops themselves, compiled with -Os.
_CODE_BYTES = {"textbook-joint": 690, "unscented": 640, "extended": 440}

#: Gives a function of state and sample a constant time step, if the library is exported for one.
AtRate = Callable[[Callable[..., Any]], Callable[..., Any]]


def joint_loops(joint: TextbookJoint, state: Any, name: str, at_rate: AtRate) -> Loops:
    """Loops of the joint filter of states and parameters."""
    sanitized = trace(at_rate(joint.sanitize), state, _EXAMPLE)
    n = len(state.belief.mean)
    w = unscented.pair_weights(n, joint.scaling)
    words = {
        "N": str(n),
        "PARAMETERS": str(PARAMETERS),
        "WALK": ", ".join(literal(s * s) for s in joint.walk),
        "SCALE": literal(math.sqrt(w.spread)),
        "MEAN_0": literal(w.central_mean),
        "SIDE": literal(w.side),
        "CENTRE": literal(math.sqrt(w.central_cov / w.pair)),
        "PAIR": literal(w.pair),
        "VOLTAGE_VARIANCE": literal(joint.voltage_std_V**2),
    }
    functions = _joint_functions(joint, state, name, sanitized)
    return _loops("textbook-joint", "textbook-joint", name, words, sanitized.result_structure, functions)


def _joint_functions(joint: TextbookJoint, state: Any, name: str, sanitized: Program) -> list[Function]:
    """Straight lines of the joint filter: sanitise a sample, move the states, state and output after the step."""
    dt_s = sanitized.outputs[0]  # a constant, where samples always come equally far apart

    def move(x: np.ndarray, clean: Any) -> np.ndarray:
        step_s = dt_s if isinstance(dt_s, float) else clean.dt_s
        return joint.next_state(x, clean.mean_A, clean.current_A, step_s)[PARAMETERS:]

    n = len(state.belief.mean)
    example = joint.sanitize(state, _EXAMPLE)
    concluded = trace(joint.concluded, state, 0.0, example)
    state_struct, output_struct = (members(s) for s in _parts(concluded.result_structure))
    in_state, in_output = places("state", state_struct), places("output", output_struct)
    in_clean = places("clean", members(sanitized.result_structure))
    in_sample = places("sample", members(sanitized.argument_structure.children[1]))
    return [
        Function(
            "The sanitised sample.",
            f"static void {name}_sanitize(const {name}_state *state, const {name}_sample *sample, {name}_clean *clean)",
            sanitized,
            in_state + in_sample,
            in_clean,
        ),
        Function(
            "The states that move, after the step.",
            f"static void {name}_move(const float *x, const {name}_clean *clean, float *y)",
            trace(move, np.zeros(n), example),
            [f"x[{i}]" for i in range(n)] + in_clean,
            [f"y[{i}]" for i in range(n - PARAMETERS)],
        ),
        Function(
            "State and output after the step.",
            f"static void {name}_conclude({name}_state *state, const {name}_clean *clean, float innovation, "
            f"{name}_output *output)",
            concluded,
            [*in_state, "innovation", *in_clean],
            in_state + in_output,
        ),
    ]


def textbook_loops(textbook: TextbookFilter, state: Any, name: str, at_rate: AtRate) -> Loops:
    """Loops of the filter of SoC and RC voltages, extended or unscented."""
    predicted = trace(at_rate(textbook.predicted), state, _EXAMPLE)
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
    _, clean = _parts(predicted.result_structure)
    return _loops("textbook", linearised, name, words, clean, _textbook_functions(textbook, state, name, predicted))


def _textbook_functions(textbook: TextbookFilter, state: Any, name: str, predicted: Program) -> list[Function]:
    """Straight lines of the textbook filter: predict, the voltage of a state of charge, the output."""
    example = textbook.predicted(state, _EXAMPLE)[1]
    estimate = trace(textbook.estimate, 0.0, 0.0, 0.0, 0.0, example)
    before, clean = _parts(predicted.result_structure)
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
    """The voltage without that of the RC pairs; with its slope for the extended filter."""

    def value(soc: Scalar, clean: Any) -> Any:
        return textbook.curve_V(soc, clean.drop_V)

    def value_and_slope(soc: Scalar, clean: Any) -> Any:
        y, slope = linearize(lambda x: np.array([value(x[0], clean)]), np.array([soc]))
        return y[0], slope[0, 0]

    prototype = f"{name}_curve(float soc, const {name}_clean *clean"
    comment, inputs = "The voltage without that of the RC pairs.", ["soc", *in_clean]
    if textbook.method == "ukf":
        return Function(comment, f"static float {prototype})", trace(value, 0.0, example), inputs, ["return"])
    program = trace(value_and_slope, 0.0, example)
    return Function(comment, f"static void {prototype}, float *y, float *slope)", program, inputs, ["*y", "*slope"])


def _loops(
    file: str, kind: str, name: str, words: dict[str, str], clean: Structure, functions: list[Function]
) -> Loops:
    return Loops({"clean": clean}, functions, _text(file, name, words), _CODE_BYTES[kind])


def _text(file: str, name: str, words: dict[str, str]) -> str:
    """Text of a file of the loops with its words filled in."""
    common = {"NAME": name, "PIVOT_FLOOR": literal(PIVOT_FLOOR), "TINY": literal(TINY)}
    return filled(template(f"loops/{file}.c"), common | words)


def _parts(structure: Structure) -> tuple[Structure, Structure]:
    first, second = structure.children  # type: ignore[union-attr]
    return first, second
