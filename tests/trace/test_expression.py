"""Traced scalars: identity, folding, what NumPy may do with them, and what is refused with which words."""

import copy
import gc
import math

import numpy as np
import pytest

from ohmward.errors import OhmwardError
from ohmward.trace import Expression, Kernel, TraceError, exp, logical_not, maximum, trace, where
from ohmward.trace.derivative import substitute
from ohmward.trace.expression import _nodes, symbol


@pytest.fixture
def x() -> Expression:
    return symbol("x")


@pytest.fixture
def y() -> Expression:
    return symbol("y")


# ---- equal nodes are one object


def test_equal_formulas_are_one_node(x, y):
    assert x * y + 1 is 1 + y * x
    assert (x - y).exp() is np.exp(x - y)
    assert x - y is not y - x


def test_common_subexpressions_are_computed_once():
    def norm(v):
        return np.sqrt(v @ v) + np.sqrt(v[1] * v[1] + v[0] * v[0])

    assert trace(norm, np.zeros(2)).operations == {"multiply": 2, "add": 2, "sqrt": 1}


def test_what_no_output_needs_is_dropped():
    def wasteful(a, b):
        np.exp(a)
        return a + b

    assert trace(wasteful, 0.0, 0.0).operations == {"add": 1}


def test_zero_and_minus_zero_are_two_constants(x):
    assert x / 0.0 is not x / -0.0


@pytest.mark.parametrize(
    "same",
    [
        lambda x: x + 0,
        lambda x: 0.0 + x,
        lambda x: x - 0,
        lambda x: x - False,
        lambda x: x * 1,
        lambda x: np.float64(1.0) * x,
        lambda x: x / 1,
        lambda x: 0 - (0 - x),
        lambda x: +x,
        lambda x: x**1,
        lambda x: where(True, x, 1.0),
        lambda x: where(x > 0, x, x),
        lambda x: maximum(x, x),
        lambda x: np.array([x, 1.0])[0],
        lambda x: np.array([[x]]).T[0, 0],
        lambda x: np.vstack([[x, 2.0], [1.0, x]])[1, 1],
        lambda x: (np.eye(2) @ np.array([x, 3.0]))[0],
        lambda x: copy.deepcopy(np.array([x]))[0],
    ],
)
def test_doing_nothing_keeps_the_node(x, same):
    assert same(x) is x


@pytest.mark.parametrize(
    "formula, expected",
    [
        (lambda x, y: x * 0, lambda x, y: 0.0),
        (lambda x, y: 0 / x, lambda x, y: 0.0),
        (lambda x, y: 0 - x, lambda x, y: -x),
        (lambda x, y: x * -1, lambda x, y: -x),
        (lambda x, y: x / -1, lambda x, y: -x),
        (lambda x, y: x + -y, lambda x, y: x - y),
        (lambda x, y: -x + y, lambda x, y: y - x),
        (lambda x, y: x - -y, lambda x, y: x + y),
        (lambda x, y: -(x - y), lambda x, y: y - x),
        (lambda x, y: -x * -y, lambda x, y: x * y),
        (lambda x, y: -x * 3, lambda x, y: x * -3),
        (lambda x, y: abs(-x), lambda x, y: abs(x)),
        (lambda x, y: abs(abs(x)), lambda x, y: abs(x)),
        (lambda x, y: x**2, lambda x, y: x * x),
        (lambda x, y: x**3, lambda x, y: x * x * x),
        (lambda x, y: x**-2.0, lambda x, y: 1 / (x * x)),
        (lambda x, y: x**0, lambda x, y: 1.0),
        (lambda x, y: x**0.5, lambda x, y: np.sqrt(x)),
        (lambda x, y: np.power(x, 2), lambda x, y: np.square(x)),
        (lambda x, y: x > y, lambda x, y: y < x),
        (lambda x, y: ~~(x < y), lambda x, y: x < y),
        (lambda x, y: (x < y) & True, lambda x, y: x < y),
        (lambda x, y: (x < y) | False, lambda x, y: x < y),
        (lambda x, y: (x < y) & False, lambda x, y: False),
        (lambda x, y: (x < y) | True, lambda x, y: True),
        (lambda x, y: True & (x < y), lambda x, y: x < y),
        (lambda x, y: logical_not(x < y), lambda x, y: ~(x < y)),
        (lambda x, y: (x < y) * 2, lambda x, y: where(x < y, 1.0, 0.0) * 2),
        (lambda x, y: where(~(x < y), x, y), lambda x, y: where(x < y, y, x)),
        (lambda x, y: math.floor(x), lambda x, y: np.floor(x)),
        (lambda x, y: np.arctan2(x, y), lambda x, y: x.arctan2(y)),
    ],
)
def test_simplified(x, y, formula, expected):
    found, wanted = formula(x, y), expected(x, y)
    assert found is wanted if isinstance(wanted, Expression) else (found == wanted and type(found) is type(wanted))


def test_x_minus_x_stays_because_it_is_nan_at_infinity(x):
    assert isinstance(x - x, Expression)


@pytest.mark.parametrize("exponent", range(-16, 17))
def test_whole_powers_are_right(exponent):
    program = trace(lambda a: a**exponent, 0.0)
    assert program.operations.keys() <= {"multiply", "divide"}
    assert program.operations["multiply"] <= 6
    assert eval_at(program, 1.5) == pytest.approx(1.5**exponent, rel=1e-15)


def eval_at(program, value):
    return substitute(program.outputs, {program.inputs[0].serial: value})[0]


# ---- what NumPy may do


def test_numpy_code_runs_on_object_arrays():
    def textbook(A, b):
        L = np.zeros_like(A)
        L[0, 0] = np.sqrt(A[0, 0])
        L[1, 0] = A[1, 0] / L[0, 0]
        outer = np.outer(b, b) + np.diag(b) - 2 * np.eye(2)
        stacked = np.vstack([L @ b, b.sum() * b, np.exp(-b), np.abs(b), np.square(b), np.tanh(b)])
        return stacked, outer.T, np.dot(A, b), (A * b[:, None])[::-1], np.append(b, [1.0]), np.trace(A), b.mean()

    A, b = np.array([[4.0, 1.0], [1.0, 3.0]]), np.array([0.3, -0.7])
    for found, expected in zip(Kernel(textbook, A, b)(A, b), textbook(A, b), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-15)


def test_own_functions_take_arrays_that_mix_floats_and_traced(x):
    first, second = exp(np.array([0.0, x], dtype=object))
    assert first == 1.0
    assert second is np.exp(x)


# ---- what is refused, with advice


@pytest.mark.parametrize(
    "use, words",
    [
        (lambda x: 1 if x > 0 else 2, r"branch on data.*where\(condition, a, b\)"),
        (lambda x: min(x, 1.0), "branch on data.*minimum"),
        (lambda x: np.minimum(np.array([x]), 1.0), "branch on data.*minimum"),
        (lambda x: np.array([x]) > 0, "comparisons of whole arrays"),
        (lambda x: np.where(x > 0, 1, 2), "branch on data"),
        (lambda x: math.exp(x), r"no number yet.*np.exp\(x\)"),
        (lambda x: np.zeros(2).__setitem__(0, x), r"no number yet.*dtype=object"),
        (lambda x: float(x), "no number yet"),
        (lambda x: [1, 2, 3][x], "cannot be an index.*table"),
        (lambda x: range(x), "cannot be an index or a count"),
        (lambda x: np.exp(np.array([x, 1.0])), "mixes traced values with floats: use exp"),
        (lambda x: (x > 0) & x, "a traced number is no condition"),
    ],
)
def test_refused_with_file_line_and_advice(use, words):
    with pytest.raises(TraceError, match=rf"test_expression.py:\d+: (?s:.*){words}"):
        trace(use, 0.0)


def test_the_refusal_belongs_to_the_family_and_is_a_type_error():
    assert issubclass(TraceError, OhmwardError)
    assert issubclass(TraceError, TypeError)


def test_a_complex_number_is_refused(x):
    with pytest.raises(TypeError, match="unsupported operand"):
        x + 1j


def test_repr_shows_the_formula(x):
    assert repr(np.exp(x) * 2.0) == "Expression(multiply(2.0, exp(x)))"


def test_nodes_are_forgotten_with_their_program():
    gc.collect()
    before = len(_nodes)
    program = trace(lambda a: np.exp(np.sin(a) * 1.2345), 0.0)
    assert len(_nodes) == before + 3
    del program
    gc.collect()
    assert len(_nodes) == before
