"""Steps of bare filters as loops over their states in C: a fraction of the code of the straight line, some time more.

The loops stand in templates/loops; what is the model's (its next state, its curve, what a sample says, what is known
after it) is traced as everything is, and written as straight lines that the loops call. The operations and their order
are those of the filter in NumPy, so the vectors of the straight line hold for the loops too, to the last bit.
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
from ohmward.trace.lower.c_operations import literal
from ohmward.trace.lower.c_source import Function, Loops, members, places
from ohmward.trace.structure import Structure

_EXAMPLE = SocSample(0.0, 0.0, 0.0, 0.0)

#: Bytes of Thumb-2 code of the loops themselves, compiled with -Os.
_CODE_BYTES = {"textbook-joint": 690, "unscented": 640, "extended": 440}

#: A filter's step as it is exported: with a constant time step, or as it is.
AtRate = Callable[[Callable], Callable]


def joint_loops(joint: TextbookJoint, state: Any, name: str, at_rate: AtRate) -> Loops:
    """The loops of the joint filter of states and parameters."""
    read = trace(at_rate(joint.sanitize), state, _EXAMPLE)
    constant_s = read.outputs[0] if isinstance(read.outputs[0], float) else None
    reading = members(read.result_structure)
    n = len(state.belief.mean)

    def move(x: np.ndarray, reading: Any) -> np.ndarray:
        dt_s = reading.dt_s if constant_s is None else constant_s
        return joint.next_state(x, reading.mean_A, dt_s)[PARAMETERS:]

    def conclude(state: Any, innovation_V: Any, reading: Any) -> Any:
        return joint.concluded(state, innovation_V, reading)

    example = joint.sanitize(state, _EXAMPLE)
    concluded = trace(conclude, state, 0.0, example)
    w = unscented.pair_weights(n, joint.scaling)
    words = {
        "N": str(n),
        "KEPT": str(PARAMETERS),
        "WALK": ", ".join(literal(s * s) for s in joint.walk),
        "SCALE": literal(math.sqrt(w.spread)),
        "MEAN_0": literal(w.central_mean),
        "SIDE": literal(w.side),
        "CENTRE": literal(math.sqrt(w.central_cov / w.pair)),
        "PAIR": literal(w.pair),
        "VOLTAGE_VARIANCE": literal(joint.voltage_std_V**2),
    }
    state_struct, output_struct = (members(s) for s in _parts(concluded.result_structure))
    sample = members(read.argument_structure.children[1])
    functions = [
        Function(
            "What a sample says.",
            f"static void {name}_read(const {name}_state *state, const {name}_sample *sample, {name}_reading *reading)",
            read,
            places("state", state_struct) + places("sample", sample),
            places("reading", reading),
        ),
        Function(
            "The states that move, after the step.",
            f"static void {name}_move(const float *x, const {name}_reading *reading, float *y)",
            trace(move, np.zeros(n), example),
            [f"x[{i}]" for i in range(n)] + places("reading", reading),
            [f"y[{i}]" for i in range(n - PARAMETERS)],
        ),
        Function(
            "What is known then.",
            f"static void {name}_conclude({name}_state *state, const {name}_reading *reading, float innovation, "
            f"{name}_output *output)",
            concluded,
            [*places("state", state_struct), "innovation", *places("reading", reading)],
            places("state", state_struct) + places("output", output_struct),
        ),
    ]
    return _loops("textbook-joint", "textbook-joint", name, words, read.result_structure, functions)


def textbook_loops(textbook: TextbookFilter, state: Any, name: str, at_rate: AtRate) -> Loops:
    """The loops of the filter of SoC and RC voltages, extended or unscented."""
    predicted = trace(at_rate(textbook.predicted), state, _EXAMPLE)
    before, read = _parts(predicted.result_structure)
    state_struct, reading = members(before), members(read)
    example = textbook.predicted(state, _EXAMPLE)[1]
    estimate = trace(textbook.estimate, 0.0, 0.0, 0.0, 0.0, example)
    n = len(state.belief.mean)
    w = unscented.pair_weights(n)
    words = {
        "N": str(n),
        "SCALE": literal(math.sqrt(w.spread)),
        "SIDE": literal(w.side),
        "PAIR": literal(w.pair),
        "BENT": literal(unscented.DEFAULT.beta - unscented.DEFAULT.alpha**2),
        "VOLTAGE_VARIANCE": literal(textbook.voltage_variance),
    }
    linearised = "unscented" if textbook.method == "ukf" else "extended"
    words["LINEARISED"] = _text(linearised, name, words)
    sample = members(predicted.argument_structure.children[1])
    functions = [
        Function(
            "The state before the voltage is used, and what the sample says.",
            f"static void {name}_predict({name}_state *state, const {name}_sample *sample, {name}_reading *reading)",
            predicted,
            places("state", state_struct) + places("sample", sample),
            places("state", state_struct) + places("reading", reading),
        ),
        _curve(textbook, name, example, places("reading", reading)),
        Function(
            "What is known then.",
            f"static void {name}_conclude(const {name}_state *state, const {name}_reading *reading, float innovation, "
            f"float S, {name}_output *output)",
            estimate,
            ["state->belief_mean[0]", "state->belief_lower[0]", "innovation", "S", *places("reading", reading)],
            places("output", members(estimate.result_structure)),
        ),
    ]
    return _loops("textbook", linearised, name, words, read, functions)


def _curve(textbook: TextbookFilter, name: str, example: Any, reading: list[str]) -> Function:
    """The voltage but for the RC voltages; with its slope for the extended filter."""

    def value(soc: Any, reading: Any) -> Any:
        return textbook.curve_V(soc, reading.drop_V)

    def value_and_slope(soc: Any, reading: Any) -> Any:
        y, slope = linearize(lambda x: np.array([value(x[0], reading)]), np.array([soc]))
        return y[0], slope[0, 0]

    prototype = f"{name}_curve(float soc, const {name}_reading *reading"
    comment, inputs = "The voltage but for the RC voltages.", ["soc", *reading]
    if textbook.method == "ukf":
        return Function(comment, f"static float {prototype})", trace(value, 0.0, example), inputs, ["return"])
    program = trace(value_and_slope, 0.0, example)
    return Function(comment, f"static void {prototype}, float *y, float *slope)", program, inputs, ["*y", "*slope"])


def _loops(
    file: str, kind: str, name: str, words: dict[str, str], reading: Structure, functions: list[Function]
) -> Loops:
    return Loops({"reading": reading}, functions, _text(file, name, words), _CODE_BYTES[kind])


def _text(file: str, name: str, words: dict[str, str]) -> str:
    """A file of the loops with its words filled in."""
    common = {"NAME": name, "PIVOT_FLOOR": literal(PIVOT_FLOOR), "TINY": literal(TINY)}
    return filled(template(f"loops/{file}.c"), common | words)


def _parts(structure: Structure) -> tuple[Structure, Structure]:
    first, second = structure.children  # type: ignore[union-attr]
    return first, second
