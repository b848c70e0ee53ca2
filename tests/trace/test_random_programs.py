"""Random formulas: every lowering against the same formula with floats, Jacobians against CasADi."""

import casadi
import numpy as np
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from ohmward.trace import Kernel, jacobian, maximum, minimum, where

INPUTS = 3
CONSTANTS = (-2.0, -1.0, 0.5, 1.0, 3.0)
UNARY = ("sin", "cos", "tanh", "exp", "sqrt", "log", "arctan", "negative", "absolute")
BINARY = ("add", "subtract", "multiply", "divide", "minimum", "maximum")

leaves = st.integers(0, INPUTS - 1) | st.sampled_from(CONSTANTS)


def grow(smaller):
    return (
        st.tuples(st.sampled_from(UNARY), smaller)
        | st.tuples(st.sampled_from(BINARY), smaller, smaller)
        | st.tuples(st.just("where"), smaller, smaller, smaller, smaller)
    )


formulas = st.recursive(leaves, grow, max_leaves=25)
numbers = st.floats(0.3, 3.0).map(lambda v: round(v, 6))
rows = st.lists(st.tuples(*[numbers] * INPUTS), min_size=1, max_size=4)
quick = settings(max_examples=150, suppress_health_check=[HealthCheck.filter_too_much, HealthCheck.too_slow])


def evaluate(formula, x, functions):
    """The value of a formula tree; an int is an input, a float a constant."""
    if isinstance(formula, int):
        return x[formula]
    if isinstance(formula, float):
        return formula
    name, *parts = formula
    values = [evaluate(part, x, functions) for part in parts]
    if name == "where":
        return functions["where"](values[0] < values[1], values[2], values[3])
    return functions[name](*values)


NUMPY = {name: getattr(np, name) for name in (*UNARY, *BINARY)}
NUMPY |= {"minimum": minimum, "maximum": maximum, "where": where}
CASADI = {
    "add": lambda a, b: a + b,
    "subtract": lambda a, b: a - b,
    "multiply": lambda a, b: a * b,
    "divide": lambda a, b: a / b,
    "negative": lambda a: -a,
    "absolute": casadi.fabs,
    "arctan": casadi.atan,
    "minimum": casadi.fmin,
    "maximum": casadi.fmax,
    "where": casadi.if_else,
} | {name: getattr(casadi, name) for name in ("sin", "cos", "tanh", "exp", "sqrt", "log")}


def assume_ordinary(value):
    """No infinities and no zeros on the way: there 0 x = 0 and the sign of zero may differ, as documented."""
    assume(np.all(np.isfinite(value)) and np.all(np.abs(value) > 1e-9) and np.all(np.abs(value) < 1e6))
    return value


def assume_no_tie(a, b):
    """Where two pieces meet the derivative is a matter of taste."""
    assume(np.all(np.abs(np.subtract(a, b)) > 1e-9))


def ordinary(name):
    def call(*args):
        if name in ("minimum", "maximum"):
            assume_no_tie(*args)
        return assume_ordinary(NUMPY[name](*args))

    return call


def with_floats(formula, x):
    with np.errstate(all="ignore"):
        return evaluate(formula, x, {name: ordinary(name) for name in NUMPY})


@quick
@given(formulas, rows)
def test_every_lowering_gives_the_value_with_floats(formula, samples):
    columns = np.array(samples).T
    expected = np.broadcast_to(with_floats(formula, columns), columns.shape[1])
    kernel = Kernel(lambda s, x: (s, evaluate(formula, x, NUMPY)), (), (0.0,) * INPUTS)

    _, scanned = kernel.scan((), tuple(columns))
    _, lanes = kernel.scan_lanes((), tuple(c[None] for c in columns))
    called = [kernel((), sample)[1] for sample in samples]

    for found in (scanned, lanes[0], called):
        np.testing.assert_allclose(found, expected, rtol=1e-9)


@quick
@given(formulas, rows)
def test_recurrences_agree_over_time_and_lanes(formula, samples):
    """The value goes back into the state: registers and names must not be mixed up from step to step."""

    def step(state, u):
        a, b = state
        value = np.tanh(evaluate(formula, (a, b, u), NUMPY))
        return (b, value), (value, a, 1.0)

    u = np.array(samples).T
    with np.errstate(all="ignore"):
        kernel = Kernel(step, (0.0, 0.0), 0.0)
    state, outputs = kernel.scan_lanes((0.4, 0.7), u)
    for lane in range(u.shape[1]):
        one_state, one = kernel.scan((0.4, 0.7), u[:, lane])
        for found, expected in zip((*state, *outputs), (*one_state, *one), strict=True):
            np.testing.assert_allclose(found[..., lane], expected, rtol=1e-6, atol=1e-9)


@quick
@given(formulas, st.tuples(*[numbers] * INPUTS))
def test_jacobian_is_casadis(formula, sample):
    x = np.array(sample)
    with_floats(formula, x)
    symbols = casadi.SX.sym("x", INPUTS)
    value = casadi.SX(evaluate(formula, [symbols[i] for i in range(INPUTS)], CASADI))
    expected = np.array(casadi.Function("J", [symbols], [casadi.jacobian(value, symbols)])(x))
    assume(np.isfinite(expected).all() and (abs(expected) < 1e9).all())
    found = jacobian(lambda z: np.array([evaluate(formula, z, NUMPY)]))(x)
    np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-9)
