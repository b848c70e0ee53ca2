"""Names and functions of traced values."""

import cProfile
from typing import Any, NamedTuple

import numpy as np

from ohmward.trace import exp, linearize, table, trace
from ohmward.trace.elementary import F32, expand


class Pair(NamedTuple):
    left: Any
    right: Any


def squared(x):
    """Square of a number: the one."""
    square = x * x
    return square  # noqa: RET504 - the name is what is tested


def helper(x):
    return x + 7.0


def step(state, sample):
    """Next state."""
    growth = squared(sample) + helper(state)
    pair = Pair(growth * 2.0, np.array([growth * 3.0, growth * 4.0]))
    return pair.left, (exp(pair.right[0]) * 0.5, pair.right[1])


def traced(function) -> Any:
    return trace(function, 0.0, 0.0, with_origins=True)


def origins_of(program) -> dict[str, Any]:
    """Function of every value, by its name."""
    return {program.origins.name(node.serial): program.origins.origin(node.serial) for node in program.nodes}


def recorded(function) -> dict[str, Any]:
    return origins_of(traced(function))


def test_values_have_the_names_of_the_variables_that_held_them():
    assert set(recorded(step)) >= {"square", "growth", "pair_left", "pair_right_0", "pair_right_1"}


def test_the_function_of_a_value_has_a_docstring_and_is_named_with_its_file():
    found = recorded(step)
    assert tuple(found["square"]) == ("squared", "test_origins.py", "Square of a number")
    assert found["growth"].summary == "Next state"
    assert {origin.name for origin in found.values()} == {"squared", "step"}  # not `helper`, which says nothing


def test_the_names_stay_with_what_is_made_of_a_value():
    def f(x):
        """A curve."""
        bent = x[0] * x[0] * 3.0
        return np.array([bent])

    def outer(state, sample):
        """A line."""
        return state, linearize(f, np.array([sample + 1.0]))[0][0] + 1.0

    assert origins_of(expand(traced(outer), F32))["bent"].summary == "A curve"
    curved: Any = expand(traced(step), F32)
    assert {curved.origins.origin(node.serial).name for node in curved.nodes} == {"squared", "step"}


def test_a_look_up_belongs_to_the_function_that_asks():
    def curve(state, sample):
        """Voltage of a cell."""
        return state, table((1.0, 2.0, 4.0), 0.0, 1.0, sample)

    assert {origin.summary for origin in recorded(curve).values()} == {"Voltage of a cell"}


def test_values_come_in_the_order_of_the_text_each_after_its_arguments():
    program: Any = expand(traced(step), F32)
    order = program.in_order_made
    assert len(order) == len(program.nodes)
    place = {node.serial: k for k, node in enumerate(order)}
    for node in order:
        assert all(place[a.serial] < place[node.serial] for a in node.args if getattr(a, "serial", None) in place)
    names = [program.origins.name(node.serial) for node in order]
    assert names.index("square") < names.index("growth") < names.index("pair_right_0") < names.index("pair_right_1")


def test_nothing_is_recorded_unless_it_is_asked_for():
    assert trace(step, 0.0, 0.0).origins is None


def test_it_can_be_traced_under_a_profiler():
    with cProfile.Profile():
        assert traced(step).origins is not None
