"""exp, log and their like made of plain operations: how far from the truth, and what they do at the ends."""

import math

import numpy as np
import pytest

from ohmward.trace import trace
from ohmward.trace.elementary import F32, F64, FORMULAS, expand
from ohmward.trace.expression import Expression
from ohmward.trace.lower import python_source
from ohmward.trace.operations import OPERATIONS

RNG = np.random.default_rng(0)
SMALL = np.concatenate([RNG.uniform(-1.0, 1.0, 4000), 1e-5 * RNG.standard_normal(1000)])

#: Arguments, and the error in ulp that the module's docstring states, in double precision.
DOUBLE = {
    "exp": (RNG.uniform(-700, 700, 6000), 1.0),
    "expm1": (np.concatenate([SMALL, RNG.uniform(-40, 700, 6000)]), 2.0),
    "log": (np.exp(RNG.uniform(-700, 700, 6000)), 1.0),
    "log1p": (np.concatenate([0.99 * SMALL, RNG.uniform(-0.99, 10, 6000)]), 2.0),
    "sin": (np.concatenate([SMALL, RNG.uniform(-1e5, 1e5, 6000)]), 3.0),
    "cos": (np.concatenate([SMALL, RNG.uniform(-1e5, 1e5, 6000)]), 3.0),
    "tan": (np.concatenate([SMALL, RNG.uniform(-1e5, 1e5, 6000)]), 4.0),
    "arctan": (np.concatenate([SMALL, RNG.uniform(-20, 20, 6000)]), 3.0),
    "sinh": (np.concatenate([SMALL, RNG.uniform(-700, 700, 6000)]), 3.0),
    "cosh": (np.concatenate([SMALL, RNG.uniform(-700, 700, 6000)]), 2.0),
    "tanh": (np.concatenate([SMALL, RNG.uniform(-20, 20, 6000)]), 3.0),
    "arcsinh": (np.concatenate([SMALL, RNG.uniform(-1e3, 1e3, 6000)]), 3.0),
}
#: The same in single precision, where the arguments are within its range.
SINGLE_RANGE = {"exp": 80.0, "expm1": 80.0, "sinh": 80.0, "cosh": 80.0, "sin": 1e3, "cos": 1e3, "tan": 1e3}


def compiled(name: str):
    """The formula on Python floats."""
    return python_source.compile_call(expand(trace(lambda x: getattr(x, name)(), 1.0), F64))


def single(name: str, x: np.ndarray) -> np.ndarray:
    """The formula in single precision, operation by operation in NumPy."""
    program = expand(trace(lambda x: getattr(x, name)(), 1.0), F32)
    values = {program.inputs[0].serial: x}
    with np.errstate(all="ignore"):
        for node in program.nodes:
            function = SINGLE_OPERATIONS.get(node.operation.name) or getattr(np, node.operation.name)
            arguments = (values[a.serial] if isinstance(a, Expression) else _constant(a) for a in node.args)
            values[node.serial] = function(*arguments)
    (y,) = program.outputs
    assert isinstance(y, Expression)
    return values[y.serial]


def _constant(a):
    return np.bool_(a) if isinstance(a, bool) else np.float32(a)


SINGLE_OPERATIONS = {
    "power_of_two": lambda n: np.ldexp(np.float32(1.0), np.where(np.isfinite(n), n, 0).astype(int)).astype(np.float32),
    "exponent": lambda x: (np.frexp(x)[1] - 1).astype(np.float32),
}


def ulp(result: np.ndarray, truth: np.ndarray, kind: type) -> np.ndarray:
    """Distance in units of the last place of the truth."""
    return np.abs((result - truth) / np.spacing(np.abs(truth).astype(kind))).astype(float)


@pytest.mark.parametrize("name", DOUBLE)
def test_double_precision_is_as_near_as_stated(name):
    x, most = DOUBLE[name]
    formula = compiled(name)
    result = np.array([formula(v) for v in x.tolist()])
    truth = getattr(np, name)(x.astype(np.longdouble))
    assert ulp(result, truth, float).max() <= most


@pytest.mark.parametrize("name", DOUBLE)
def test_single_precision_is_as_near_as_stated(name):
    x, most = DOUBLE[name]
    limit = SINGLE_RANGE.get(name, 1e30)
    x = np.exp(RNG.uniform(-80, 80, 6000)) if name == "log" else x * min(1.0, limit / np.abs(x).max())
    x = x.astype(np.float32)
    result = single(name, x)
    assert result.dtype == np.float32
    truth = getattr(np, name)(x.astype(float))
    assert ulp(result.astype(float), truth, np.float32).max() <= most


def test_arctan2_in_all_quadrants():
    formula = python_source.compile_call(expand(trace(lambda y, x: np.arctan2(y, x), 1.0, 1.0), F64))
    points = RNG.standard_normal((3000, 2))
    result = np.array([formula(y, x) for y, x in points.tolist()])
    truth = np.arctan2(points[:, 0].astype(np.longdouble), points[:, 1].astype(np.longdouble))
    assert ulp(result, truth, float).max() <= 3.0
    axes = [(0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0), (0.0, 0.0), (math.inf, math.inf), (1.0, -math.inf)]
    for y, x in axes:
        assert formula(y, x) == pytest.approx(math.atan2(y, x), rel=1e-15)


def test_power_of_both_signs():
    formula = python_source.compile_call(expand(trace(lambda a, b: a**b, 1.0, 1.0), F64))
    for a, b in [(2.0, 0.3), (0.7, -11.25), (-2.0, 3.0), (-2.0, 4.0), (5.0, 0.0), (1e-3, 2.5)]:
        assert formula(a, b) == pytest.approx(a**b, rel=1e-14)
    assert math.isnan(formula(-2.0, 0.5))


ENDS = [0.0, math.inf, -math.inf, math.nan, 5e-324, 1e-310, -1e-310, 1e308, -1e308, 709.0, -740.0]


@pytest.mark.parametrize("name", sorted(set(DOUBLE) - {"sin", "cos", "tan", "cosh", "sinh"}))
def test_the_ends_of_the_range(name):
    formula, function = compiled(name), getattr(np, name)
    for x in ENDS:
        with np.errstate(all="ignore"):
            truth = float(function(x))
        result = formula(x)
        assert math.isnan(result) if math.isnan(truth) else result == pytest.approx(truth, rel=1e-12, abs=1e-320), x


@pytest.mark.parametrize("name", ["sin", "cos", "tan"])
def test_no_angle_has_no_sine(name):
    formula = compiled(name)
    assert all(math.isnan(formula(x)) for x in (math.inf, -math.inf, math.nan))


def test_nothing_but_plain_operations_is_left():
    program = trace(lambda x, y: sum(getattr(x, name)() for name in DOUBLE) + np.arctan2(x, y) + x**y, 1.0, 1.0)
    assert not set(expand(program, F64).operations) & set(FORMULAS)


def test_a_program_without_functions_stays_as_it_is():
    program = trace(lambda x, y: x * y + np.sqrt(x), 1.0, 1.0)
    assert expand(program, F64).nodes == program.nodes


def test_numbers_taken_apart_and_put_together():
    for x in (1.0, 1.5, 2.0**-1022, 1.7e308, 3e-5):
        e = OPERATIONS["exponent"].compute(x)
        scale = OPERATIONS["power_of_two"].compute(e)
        assert e.is_integer() and scale <= x < 2.0 * scale


def test_a_program_is_expanded_once_for_each_precision():
    program = trace(lambda x: x.exp(), 1.0)
    assert expand(program, F32) is expand(program, F32) is not expand(program, F64)
