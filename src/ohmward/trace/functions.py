"""Functions that give the same result for floats, arrays of floats and traced scalars, alone or in object arrays.

`np.exp(x)` and other functions of NumPy work on traced scalars and on object arrays whose elements all are traced. The
functions here also take object arrays that mix floats with traced scalars, and only they can choose values by data.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from ohmward.trace.expression import Expression, Scalar, apply, condition, number, select

#: Types of scalars without and with traced values; a function need look no further at these.
_FLOATS = frozenset({float, np.float64, bool, np.bool_})
_SCALARS = _FLOATS | {Expression}


def is_traced(x: Any) -> bool:
    """True for a traced scalar and for an array that may hold some."""
    return isinstance(x, Expression) or (isinstance(x, np.ndarray) and x.dtype == object)


def elementwise(scalar: Callable[..., Scalar], floats: Callable[..., Any], arity: int) -> Callable[..., Any]:
    """Function of arrays: `scalar` for each element if an argument is traced, else `floats`."""
    traced = np.frompyfunc(scalar, arity, 1)

    def call(*args: Any) -> Any:
        types = {*map(type, args)}
        if types <= _FLOATS:
            return floats(*args)
        if Expression in types and types <= _SCALARS:
            return scalar(*args)
        args = tuple(np.array(a, dtype=object) if isinstance(a, list | tuple) else a for a in args)
        return traced(*args) if any(is_traced(a) for a in args) else floats(*args)

    return call


def _numeric(name: str, arity: int) -> Callable[..., Any]:
    def scalar(*args: Any) -> Scalar:
        return apply(name, *(number(a) for a in args))

    return elementwise(scalar, getattr(np, name), arity)


def _where_floats(c: Any, a: Any, b: Any) -> Any:
    chosen: Any = np.where(c, a, b)
    return chosen[()]


#: `a` where a condition (first argument) holds, else `b`; an inf or nan in the one not taken has no effect.
where = elementwise(select, _where_floats, 3)
#: The smaller of two values; nan if either is nan.
minimum = _numeric("minimum", 2)
#: The larger of two values; nan if either is nan.
maximum = _numeric("maximum", 2)
#: -1, 0 or 1; nan stays nan.
sign = _numeric("sign", 1)
#: True where a value is neither inf nor nan.
isfinite = _numeric("isfinite", 1)
#: The opposite of a condition (`~c` of a Python bool is an integer).
logical_not = elementwise(lambda c: apply("logical_not", condition(c)), np.logical_not, 1)

exp = _numeric("exp", 1)
log = _numeric("log", 1)
sqrt = _numeric("sqrt", 1)
tanh = _numeric("tanh", 1)
sin = _numeric("sin", 1)
cos = _numeric("cos", 1)
arctan2 = _numeric("arctan2", 2)
floor = _numeric("floor", 1)


def clip(x: Any, low: Any, high: Any) -> Any:
    """`x` within [low, high]; nan stays nan."""
    return minimum(maximum(x, low), high)
