"""Simplifications of single operations. Exact, but for the sign of a zero and for zero times inf or nan.

A literal 0.0 is a structural zero ("does not depend on"): whatever it is multiplied with, or divided by, it stays
zero. That is what keeps Jacobians and block-diagonal covariances sparse.

Each rule takes `apply` and the arguments, of which one at least is an expression, and returns the simpler
scalar, or None.
"""

from collections.abc import Callable
from typing import Any


def _is(x: Any, value: float) -> bool:
    return type(x) is float and x == value


def _does(x: Any, name: str) -> bool:
    return not isinstance(x, float | bool) and x.operation.name == name


def _negated(x: Any) -> Any:
    """The argument if x is `-argument`, else None."""
    return x.args[0] if _does(x, "negative") else None


def _add(apply: Callable, a: Any, b: Any) -> Any:
    if _is(a, 0.0):
        return b
    if _is(b, 0.0):
        return a
    if (c := _negated(b)) is not None:
        return apply("subtract", a, c)
    if (c := _negated(a)) is not None:
        return apply("subtract", b, c)
    return None


def _subtract(apply: Callable, a: Any, b: Any) -> Any:
    if _is(a, 0.0):
        return apply("negative", b)
    if _is(b, 0.0):
        return a
    if (c := _negated(b)) is not None:
        return apply("add", a, c)
    return None


def _multiply(apply: Callable, a: Any, b: Any) -> Any:
    for x, y in ((a, b), (b, a)):
        if _is(x, 0.0):
            return 0.0
        if _is(x, 1.0):
            return y
        if _is(x, -1.0):
            return apply("negative", y)
        if (c := _negated(x)) is not None and type(y) is float:
            return apply("multiply", c, -y)
    if (c := _negated(a)) is not None and (d := _negated(b)) is not None:
        return apply("multiply", c, d)
    return None


def _divide(apply: Callable, a: Any, b: Any) -> Any:
    if _is(a, 0.0):
        return 0.0
    if _is(b, 1.0):
        return a
    return apply("negative", a) if _is(b, -1.0) else None


def _negative(apply: Callable, a: Any) -> Any:
    if (c := _negated(a)) is not None:
        return c
    return apply("subtract", a.args[1], a.args[0]) if _does(a, "subtract") else None


def _absolute(apply: Callable, a: Any) -> Any:
    if (c := _negated(a)) is not None:
        return apply("absolute", c)
    return a if _does(a, "absolute") else None


def _same(apply: Callable, a: Any, b: Any) -> Any:
    return a if a is b else None


def _where(apply: Callable, c: Any, a: Any, b: Any) -> Any:
    if type(c) is bool:
        return a if c else b
    return a if a is b or (type(a) is float and _is(b, a)) else None


def _gather(apply: Callable, index: Any, values: tuple[float, ...]) -> Any:
    return values[0] if len({repr(v) for v in values}) == 1 else None


def _and(apply: Callable, a: Any, b: Any) -> Any:
    if a is False or b is False:
        return False
    return b if a is True or a is b else a if b is True else None


def _or(apply: Callable, a: Any, b: Any) -> Any:
    if a is True or b is True:
        return True
    return b if a is False or a is b else a if b is False else None


def _not(apply: Callable, a: Any) -> Any:
    return a.args[0] if _does(a, "logical_not") else None


RULES: dict[str, Callable] = {
    "add": _add,
    "subtract": _subtract,
    "multiply": _multiply,
    "divide": _divide,
    "negative": _negative,
    "absolute": _absolute,
    "minimum": _same,
    "maximum": _same,
    "where": _where,
    "gather": _gather,
    "logical_and": _and,
    "logical_or": _or,
    "logical_not": _not,
}
