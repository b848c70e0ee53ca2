"""Every operation: its value against NumPy in every lowering, its derivative against SymPy."""

import itertools

import numpy as np
import pytest
import sympy

from ohmward.trace import Kernel, TraceError, jacobian, where
from ohmward.trace.expression import apply
from ohmward.trace.operations import BITS, INPUT, OPERATIONS

SPECIAL = [0.0, -0.0, 0.5, -0.5, 1.0, -1.0, 2.5, -3.75, 700.0, -700.0, 1e4, 1e-310, 1e308, -1e308, 2.0**52 + 1]
SPECIAL += [np.inf, -np.inf, np.nan]
# NumPy's own exp, log, sin, ... and libm's differ by a few units in the last place.
ROUNDED = {"power", "exp", "expm1", "log", "log1p", "sin", "cos", "tan", "arctan", "arctan2", "sinh", "cosh", "tanh"}
ROUNDED |= {"arcsinh"}

TRACED = OPERATIONS.keys() - BITS


def on_conditions(name, *x):
    return apply(name, *(value > 0.0 for value in x))


def formula(name):
    """The operation as a function of numbers, returning a number."""
    if name == "where":
        return lambda a, b: where(a > 0.0, a, b), 2
    if name == "gather":
        return lambda a: apply("gather", where(abs(a) < 4.0, np.floor(abs(a)), a - a), (1.5, 2.5, 3.5, 4.5)), 1
    operation = OPERATIONS[name]
    inner = on_conditions if name.startswith("logical") else apply
    if operation.boolean:
        return lambda *x: where(inner(name, *x), 1.0, 0.0), operation.arity
    return lambda *x: inner(name, *x), operation.arity


def with_numpy(name, *x):
    if name == "where":
        return np.where(x[0] > 0.0, *x)
    if name == "gather":
        return np.array([1.5, 2.5, 3.5, 4.5])[np.where(abs(x[0]) < 4.0, abs(x[0]), 0).astype(int)]
    if name.startswith("logical"):
        x = tuple(value > 0.0 for value in x)
    with np.errstate(all="ignore"):
        return getattr(np, name)(*x).astype(float)


def assert_same(name, value, expected):
    np.testing.assert_allclose(value, expected, rtol=1e-14 if name in ROUNDED else 0, atol=0, err_msg=name)


@pytest.mark.parametrize("name", sorted(TRACED))
def test_value_is_numpys_even_at_zero_infinity_and_nan(name):
    function, arity = formula(name)
    x = np.array(list(itertools.product(SPECIAL, repeat=arity))).T
    expected = with_numpy(name, *x)
    kernel = Kernel(lambda state, sample: (state, function(*sample)), (), (0.0,) * arity)

    _, scanned = kernel.scan((), tuple(x))
    _, lanes = kernel.scan_lanes((), tuple(row[None] for row in x))
    called = [kernel((), tuple(values))[1] for values in x.T]

    assert_same(name, scanned, expected)
    assert_same(name, called, expected)
    assert_same(name, lanes[0], expected)


@pytest.mark.parametrize("name", sorted(TRACED))
def test_constants_are_folded_to_the_same_value(name):
    function, arity = formula(name)
    x = np.array(list(itertools.product([0.5, -0.5, 2.5, -3.75, np.nan], repeat=arity))).T
    if name == "gather":
        folded = [OPERATIONS[name].compute(index, (1.5, 2.5)) for index in (0.0, 1.0, np.nan)]
        assert folded == [1.5, 2.5, 1.5]
        return
    folded = [function(*values) for values in x.T.tolist()]
    assert_same(name, folded, with_numpy(name, *x))


SYMPY = {
    "add": lambda x, y: x + y,
    "subtract": lambda x, y: x - y,
    "multiply": lambda x, y: x * y,
    "divide": lambda x, y: x / y,
    "power": lambda x, y: x**y,
    "arctan2": sympy.atan2,
    "minimum": sympy.Min,
    "maximum": sympy.Max,
    "where": lambda x, y: x,
    "negative": lambda x: -x,
    "absolute": lambda x: sympy.sqrt(x**2),
    "sqrt": sympy.sqrt,
    "exp": sympy.exp,
    "expm1": lambda x: sympy.exp(x) - 1,
    "log": sympy.log,
    "log1p": lambda x: sympy.log(1 + x),
    "sin": sympy.sin,
    "cos": sympy.cos,
    "tan": sympy.tan,
    "arctan": sympy.atan,
    "sinh": sympy.sinh,
    "cosh": sympy.cosh,
    "tanh": sympy.tanh,
    "arcsinh": sympy.asinh,
}
FLAT = {name for name, o in OPERATIONS.items() if o.boolean} | {"sign", "floor", "floor_divide", "gather"}
SMOOTH = sorted(TRACED - FLAT - {"remainder"})


@pytest.mark.parametrize("name", SMOOTH)
def test_derivative_is_sympys(name):
    function, arity = formula(name)
    symbols = sympy.symbols("x y", positive=True)[:arity]
    value = SYMPY[name](*symbols)
    for point in ([0.7, 1.9], [2.3, 0.4], [3.1, 2.9]):
        x = np.array(point[:arity])
        at = dict(zip(symbols, x, strict=True))
        exact = [float(sympy.diff(value, s).subs(at)) for s in symbols]
        found = jacobian(lambda z: np.array([function(*z)]))(x)
        np.testing.assert_allclose(found, [exact], rtol=2e-15, atol=1e-16)


@pytest.mark.parametrize("name", sorted(FLAT))
def test_derivative_of_steps_is_zero(name):
    function, arity = formula(name)
    assert not jacobian(lambda z: np.array([function(*z)]))(np.array([1.3, 0.6])[:arity]).any()


def test_derivative_of_the_remainder_is_that_of_x_minus_floor_of_x_by_y_times_y():
    found = jacobian(lambda z: np.array([z[0] % z[1]]))(np.array([2.3, 0.4]))
    np.testing.assert_array_equal(found, [[1.0, -5.0]])


def test_inputs_are_no_operation():
    assert INPUT.name not in OPERATIONS


def test_a_number_is_no_condition():
    with pytest.raises(TraceError, match=r"test_operations.py:\d+: a traced number is no condition: write `x != 0`"):
        Kernel(lambda x: where(x, 1.0, 2.0), 0.0)
