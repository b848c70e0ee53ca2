"""Scalar functions on Python floats with IEEE 754 results: 1/0 is inf, sqrt(-1) is nan, nothing raises."""

import math
import operator
from collections.abc import Callable

import numpy as np

#: Errors that Python raises where IEEE 754 has a result.
ERRORS = (ZeroDivisionError, OverflowError, ValueError)


def _silent(function: Callable[..., float], ufunc: np.ufunc) -> Callable[..., float]:
    """`function`, and NumPy's answer where `function` raises."""

    def call(*args: float) -> float:
        try:
            return function(*args)
        except ERRORS:
            with np.errstate(all="ignore"):
                return float(ufunc(*args))

    call.__name__ = ufunc.__name__
    return call


divide = _silent(operator.truediv, np.divide)
remainder = _silent(operator.mod, np.remainder)
floor_divide = _silent(operator.floordiv, np.floor_divide)
power = _silent(math.pow, np.power)
sqrt = _silent(math.sqrt, np.sqrt)
exp = _silent(math.exp, np.exp)
expm1 = _silent(math.expm1, np.expm1)
log = _silent(math.log, np.log)
log1p = _silent(math.log1p, np.log1p)
sin = _silent(math.sin, np.sin)
cos = _silent(math.cos, np.cos)
tan = _silent(math.tan, np.tan)
sinh = _silent(math.sinh, np.sinh)
cosh = _silent(math.cosh, np.cosh)
tanh, arctan, arctan2, arcsinh = math.tanh, math.atan, math.atan2, math.asinh


def floor(x: float) -> float:
    """Largest whole number <= x, as a float; inf and nan stay."""
    return x // 1.0 if -(2.0**52) < x < 2.0**52 else x


def sign(x: float) -> float:
    """-1, 0 or 1; nan stays."""
    return 1.0 if x > 0.0 else -1.0 if x < 0.0 else 0.0 if x == 0.0 else x


def minimum(a: float, b: float) -> float:
    """The smaller one; nan if either is nan."""
    return a if a < b or a != a else b


def maximum(a: float, b: float) -> float:
    """The larger one; nan if either is nan."""
    return a if a > b or a != a else b


def where(condition: bool, a: float, b: float) -> float:
    """`a` if the condition holds, else `b`."""
    return a if condition else b


def gather(index: float, values: tuple[float, ...]) -> float:
    """Entry of a table at a whole-numbered index within it; entry 0 at nan."""
    return values[int(index)] if index == index else values[0]


def power_of_two(n: float) -> float:
    """2^n for a whole n from -1022 to 1023, where it is a normal number; undefined elsewhere."""
    return math.ldexp(1.0, int(n)) if -1022 <= n <= 1023 else math.nan


def exponent(x: float) -> float:
    """The whole e with 2^e <= x < 2^(e+1), for a normal x > 0; undefined elsewhere."""
    return math.frexp(x)[1] - 1.0
