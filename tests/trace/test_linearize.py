"""Jacobians: exact, sparse, with floats and inside a trace."""

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.trace import Expression, Kernel, TraceError, jacobian, linearize, trace, where

A = np.array([[1.0, 2.0, 0.0], [0.0, -1.0, 4.0]])


def bicycle(x):
    """Position, heading and speed of a kinematic bicycle after 0.1 s."""
    return np.array([x[0] + 0.1 * x[3] * np.cos(x[2]), x[1] + 0.1 * x[3] * np.sin(x[2]), x[2] + 0.1 * x[3], x[3]])


def bicycle_jacobian(x):
    c, s = np.cos(x[2]), np.sin(x[2])
    return np.array([[1, 0, -0.1 * x[3] * s, 0.1 * c], [0, 1, 0.1 * x[3] * c, 0.1 * s], [0, 0, 1, 0.1], [0, 0, 0, 1]])


X = np.array([1.0, -2.0, 0.6, 3.0])


def test_jacobian_of_a_linear_map_is_its_matrix():
    np.testing.assert_array_equal(jacobian(lambda x: A @ x)(np.ones(3)), A)


def test_value_and_jacobian_in_closed_form():
    value, J = linearize(bicycle, X)
    np.testing.assert_allclose(value, bicycle(X), rtol=1e-15)
    np.testing.assert_allclose(J, bicycle_jacobian(X), rtol=1e-15)
    assert value.dtype == J.dtype == float


def test_inside_a_trace_it_is_the_same():
    kernel = Kernel(lambda x: linearize(bicycle, x), X)
    value, J = kernel(X)
    np.testing.assert_allclose(value, bicycle(X), rtol=1e-15)
    np.testing.assert_allclose(J, bicycle_jacobian(X), rtol=1e-15)


def test_structural_zeros_and_ones_are_literals():
    found = {}

    def look(x):
        found["value"], found["J"] = linearize(bicycle, x)
        found["x"] = x
        return found["value"]

    trace(look, X)
    constant = [[isinstance(entry, float) for entry in row] for row in found["J"]]
    assert constant == [[True, True, False, False], [True, True, False, False], [True] * 4, [True] * 4]
    assert found["value"][3] is found["x"][3]


def test_outer_traced_values_are_constants_of_the_inner_derivative():
    def outer(a, b):
        return jacobian(lambda x: np.array([a * x[0] ** 2 + a * a]))(np.array([b]))[0, 0]

    assert Kernel(outer, 0.0, 0.0)(3.0, 5.0) == 30.0


def test_arguments_that_depend_on_each_other_are_independent_inside():
    def f(a):
        return jacobian(lambda x: np.array([x[0] * x[1]]))(np.array([a, a]))

    np.testing.assert_array_equal(Kernel(f, 0.0)(7.0), [[7.0, 7.0]])


def test_floats_and_traced_values_mix():
    J = Kernel(lambda a: jacobian(lambda x: np.array([x[0] * x[1]]))(np.array([a, 2.0])), 0.0)(7.0)
    np.testing.assert_array_equal(J, [[2.0, 7.0]])


def test_second_derivative_by_nesting():
    def gradient(x):
        return jacobian(lambda z: np.array([z[0] ** 3 * z[1] + np.sin(z[1])]))(x)[0]

    x, y = 1.3, 0.4
    np.testing.assert_allclose(
        jacobian(gradient)(np.array([x, y])), [[6 * x * y, 3 * x**2], [3 * x**2, -np.sin(y)]], rtol=1e-15
    )


def test_the_branch_that_is_not_taken_cannot_spoil_the_derivative():
    J = jacobian(lambda x: np.array([where(x[0] > 0, np.sqrt(x[0]), 0.0)]))
    assert J(np.array([0.0]))[0, 0] == 0.0
    assert J(np.array([4.0]))[0, 0] == 0.25


def test_constant_outputs_have_zero_rows():
    value, J = linearize(lambda x: np.array([1.0, x[0]]), np.array([2.0]))
    assert value.tolist() == [1.0, 2.0]
    assert J.tolist() == [[0.0], [1.0]]


def test_expression_of_a_traced_jacobian_is_shared_with_the_value():
    program = trace(lambda x: linearize(lambda z: np.exp(z), x), np.zeros(2))
    assert program.operations == {"exp": 2}
    assert all(isinstance(y, Expression) or y == 0.0 for y in program.outputs)


@pytest.mark.parametrize(
    "f, x, error, words",
    [
        (lambda x: x, np.eye(2), InputError, r"x must be one row of numbers \(n,\), got shape \(2, 2\)"),
        (lambda x: x[0], np.ones(2), InputError, r"f must return one row of numbers \(m,\), got shape \(\)"),
        (lambda x: np.array([np.exp(np.array([x[0], 1.0]))[1]]), np.ones(1), TraceError, "mixes traced values"),
    ],
)
def test_refused(f, x, error, words):
    with pytest.raises(error, match=words):
        linearize(f, x)
