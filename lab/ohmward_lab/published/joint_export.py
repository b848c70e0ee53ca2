"""Joint filter of states and parameters of the RC model as a C99 library, which `ohmward.embedded` loads by name."""

from __future__ import annotations

import math
from enum import IntFlag
from functools import partial
from typing import Any

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.models.temperature import ROOM_DEGC
from ohmward.battery.soc.sample import SocSample
from ohmward.embedded.battery import Style, at_fixed_rate, interval_words, usual_voltage, vector_samples
from ohmward.embedded.c_library import Export
from ohmward.embedded.loops import EXAMPLE, AtRate, loops_of, parts_of
from ohmward.filters import unscented
from ohmward.trace import Program, trace
from ohmward.trace.lower.c_operations import literal
from ohmward.trace.lower.c_source import Function, Loops, members, places
from ohmward_lab.published.rc import nominal_of, rc_of_thevenin
from ohmward_lab.published.textbook_joint import PARAMETERS, TextbookJoint

#: Bytes of Thumb-2 code of the loops themselves, compiled with -Os.
_CODE_BYTES = 690

#: Standard deviation of the open-circuit voltage about the first voltage, in the test of the joint filter [V].
EXAMPLE_BULK_STD_V = 0.05


class NoFlag(IntFlag):
    """Flags of an output that has none."""


def joint_export(battery: Battery, name: str, sample_time_s: float | None, style: Style) -> Export:
    """The published filter of states and parameters of the RC model; it starts at rest at the first voltage."""
    model = rc_of_thevenin(battery.thevenin)
    highest_V = model.ocv.voltage_V[-1]
    joint = TextbookJoint(nominal_of(model), voltage_std_V=battery.noise.voltage_std_V, highest_ocv_V=highest_V)
    state = joint.init(SocSample(0.0, 0.0, usual_voltage(battery), ROOM_DEGC))
    at_rate = partial(at_fixed_rate, sample_time_s=sample_time_s)
    return Export(
        name=name,
        title=f"States and parameters of the RC model of {battery.name}: adaptive unscented filter as published"
        f"{interval_words(sample_time_s)}",
        step=trace(at_rate(joint.step), state, EXAMPLE, with_origins=True),
        start=trace(joint.start, EXAMPLE, EXAMPLE_BULK_STD_V, with_origins=True),
        flags=NoFlag,
        arguments=(EXAMPLE_BULK_STD_V,),
        samples=vector_samples(battery),
        loops=_loops(joint, state, name, at_rate) if style == "loops" else None,
    )


def _loops(joint: TextbookJoint, state: Any, name: str, at_rate: AtRate) -> Loops:
    """Loops of the joint filter of states and parameters."""
    sanitized = trace(at_rate(joint.sanitize), state, EXAMPLE, with_origins=True)
    n = len(state.belief.mean)
    w = unscented.pair_weights(n)
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
    functions = _functions(joint, state, name, sanitized)
    return loops_of("textbook-joint", name, words, sanitized.result_structure, functions, _CODE_BYTES)


def _functions(joint: TextbookJoint, state: Any, name: str, sanitized: Program) -> list[Function]:
    """Straight-line functions: sanitise a sample, move the states, state and output after the step."""
    dt_s = sanitized.outputs[0]  # a constant, where samples always come at equal intervals

    def move(x: np.ndarray, clean: Any) -> np.ndarray:
        step_s = dt_s if isinstance(dt_s, float) else clean.dt_s
        return joint.next_state(x, clean.mean_A, clean.current_A, step_s)[PARAMETERS:]

    n = len(state.belief.mean)
    example = joint.sanitize(state, EXAMPLE)
    concluded = trace(joint.concluded, state, 0.0, example, with_origins=True)
    state_struct, output_struct = (members(s) for s in parts_of(concluded.result_structure))
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
            trace(move, np.zeros(n), example, with_origins=True),
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
