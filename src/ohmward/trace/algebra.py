"""Simplifications of single operations. Exact, but for the sign of a zero and for zero times inf or nan.

A literal 0.0 is a structural zero ("does not depend on"): multiplied or divided by anything, it stays zero. That
keeps Jacobians and block-diagonal covariances sparse.

Each rule takes `apply` and the arguments, at least one of them an expression, and returns the simpler scalar or None.
Of the arguments of a commutative operation a constant comes first.
"""

from collections.abc import Callable
from typing import Any

#: `expression.apply`, passed as an argument because that module imports this one.
Apply = Callable[..., Any]


def _is(x: Any, value: float) -> bool:
    return type(x) is float and x == value


def _is_result_of(name: str, x: Any) -> bool:
    return type(x) is not float and type(x) is not bool and x.operation.name == name


def _negated(x: Any) -> Any:
    """The argument if x is `-argument`, else None."""
    return x.args[0] if _is_result_of("negative", x) else None


def _add(apply: Apply, a: Any, b: Any) -> Any:
    if _is(a, 0.0):
        return b
    if (c := _negated(b)) is not None:
        return apply("subtract", a, c)
    if (c := _negated(a)) is not None:
        return apply("subtract", b, c)
    return None


def _subtract(apply: Apply, a: Any, b: Any) -> Any:
    if _is(a, 0.0):
        return apply("negative", b)
    if _is(b, 0.0):
        return a
    if (c := _negated(b)) is not None:
        return apply("add", a, c)
    return None


def _multiply(apply: Apply, a: Any, b: Any) -> Any:
    if _is(a, 0.0):
        return 0.0
    if _is(a, 1.0):
        return b
    if _is(a, -1.0):
        return apply("negative", b)
    if (d := _negated(b)) is None:
        return None
    if type(a) is float:
        return apply("multiply", -a, d)
    return None if (c := _negated(a)) is None else apply("multiply", c, d)


def _divide(apply: Apply, a: Any, b: Any) -> Any:
    if _is(a, 0.0):
        return 0.0
    if _is(b, 1.0):
        return a
    return apply("negative", a) if _is(b, -1.0) else None


def _negative(apply: Apply, a: Any) -> Any:
    if (c := _negated(a)) is not None:
        return c
    return apply("subtract", a.args[1], a.args[0]) if _is_result_of("subtract", a) else None


def _absolute(apply: Apply, a: Any) -> Any:
    if (c := _negated(a)) is not None:
        return apply("absolute", c)
    return a if _is_result_of("absolute", a) else None


def _equal_arguments(apply: Apply, a: Any, b: Any) -> Any:
    return a if a is b else None


def _where(apply: Apply, c: Any, a: Any, b: Any) -> Any:
    if type(c) is bool:
        return a if c else b
    if _is_result_of("logical_not", c):
        return apply("where", c.args[0], b, a)
    return a if a is b or (type(a) is float and _is(b, a)) else None


def _gather(apply: Apply, index: Any, values: tuple[float, ...]) -> Any:
    first = repr(values[0])
    return values[0] if all(repr(v) == first for v in values) else None


def _and(apply: Apply, a: Any, b: Any) -> Any:
    if a is False or b is False:
        return False
    if a is True or a is b:
        return b
    return a if b is True else None


def _or(apply: Apply, a: Any, b: Any) -> Any:
    if a is True or b is True:
        return True
    if a is False or a is b:
        return b
    return a if b is False else None


def _not(apply: Apply, a: Any) -> Any:
    return a.args[0] if _is_result_of("logical_not", a) else None


RULES: dict[str, Apply] = {
    "add": _add,
    "subtract": _subtract,
    "multiply": _multiply,
    "divide": _divide,
    "negative": _negative,
    "absolute": _absolute,
    "minimum": _equal_arguments,
    "maximum": _equal_arguments,
    "where": _where,
    "gather": _gather,
    "logical_and": _and,
    "logical_or": _or,
    "logical_not": _not,
}
