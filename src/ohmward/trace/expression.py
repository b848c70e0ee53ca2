"""Traced scalars: NumPy's arithmetic on them becomes a graph of operations.

Equal nodes are one object (hash consing): `a + b` and `b + a` built anywhere are the same node, so common
subexpressions cost nothing and structure can be seen with `is`. Constants are plain Python floats: operations on
constants alone are computed while tracing, and `x + 0`, `x * 1`, `x * 0` vanish as they are built.
"""

import math
import os
import sys
from itertools import count
from pathlib import Path
from typing import Any, Union
from weakref import ref

import numpy as np

from ohmward.errors import OhmwardError
from ohmward.trace.algebra import RULES
from ohmward.trace.operations import INPUT, OPERATIONS, Operation

#: A traced number, or a constant.
Scalar = Union["Expression", float, bool]
#: A traced condition, or True or False.
Condition = Union["Expression", bool]

#: Whole powers up to this size are products; beyond it one call of `power` takes fewer operations.
_LARGEST_PRODUCT = 16

_serials = count()
#: Folders of the compiler and of NumPy, whose functions count as part of the one that called them.
OF_THE_CALLER = tuple(f"{Path(file).parent}{os.sep}" for file in (__file__, np.__file__))


class TraceError(OhmwardError, TypeError):
    """A traced function needs a number where there is none yet; the message says where and names the remedy."""


class Expression:
    """Scalar whose value is known only when the program runs: an input, or an operation on other scalars.

    operation: the `Operation`; INPUT for an input.
    args:      its arguments: Expressions, floats, for a gather the tuple of values.
    name:      name of an input, "" otherwise.
    serial:    order of creation; a node comes after its arguments.
    boolean:   True for a condition.
    """

    __slots__ = ("__weakref__", "args", "boolean", "name", "operation", "serial")

    def __init__(self, operation: Operation, args: tuple[Any, ...], name: str, boolean: bool):
        self.operation = operation
        self.args = args
        self.name = name
        self.boolean = boolean
        self.serial = next(_serials)

    # ---- arithmetic; NotImplemented hands arrays over to NumPy, which works element by element
    def __add__(self, other: Any) -> Scalar:
        return _binary("add", self, other)

    def __radd__(self, other: Any) -> Scalar:
        return _binary("add", other, self)

    def __sub__(self, other: Any) -> Scalar:
        return _binary("subtract", self, other)

    def __rsub__(self, other: Any) -> Scalar:
        return _binary("subtract", other, self)

    def __mul__(self, other: Any) -> Scalar:
        return _binary("multiply", self, other)

    def __rmul__(self, other: Any) -> Scalar:
        return _binary("multiply", other, self)

    def __truediv__(self, other: Any) -> Scalar:
        return _binary("divide", self, other)

    def __rtruediv__(self, other: Any) -> Scalar:
        return _binary("divide", other, self)

    def __mod__(self, other: Any) -> Scalar:
        return _binary("remainder", self, other)

    def __rmod__(self, other: Any) -> Scalar:
        return _binary("remainder", other, self)

    def __floordiv__(self, other: Any) -> Scalar:
        return _binary("floor_divide", self, other)

    def __rfloordiv__(self, other: Any) -> Scalar:
        return _binary("floor_divide", other, self)

    def __pow__(self, exponent: Any) -> Scalar:
        return _power(self, exponent)

    def __rpow__(self, base: Any) -> Scalar:
        return _binary("power", base, self)

    def __neg__(self) -> Scalar:
        return apply("negative", number(self))

    def __pos__(self) -> Scalar:
        return number(self)

    def __abs__(self) -> Scalar:
        return apply("absolute", number(self))

    # ---- comparisons and logic
    def __lt__(self, other: Any) -> Condition:
        return _comparison("less", self, other)

    def __le__(self, other: Any) -> Condition:
        return _comparison("less_equal", self, other)

    def __gt__(self, other: Any) -> Condition:
        return _comparison("less", other, self)

    def __ge__(self, other: Any) -> Condition:
        return _comparison("less_equal", other, self)

    def __eq__(self, other: Any) -> Condition:  # type: ignore[override]
        return _comparison("equal", self, other)

    def __ne__(self, other: Any) -> Condition:  # type: ignore[override]
        return _comparison("not_equal", self, other)

    def __hash__(self) -> int:
        return object.__hash__(self)

    def __and__(self, other: Any) -> Condition:
        return _logical("logical_and", self, other)

    def __or__(self, other: Any) -> Condition:
        return _logical("logical_or", self, other)

    def __invert__(self) -> Condition:
        return _logical("logical_not", self)

    __rand__ = __and__
    __ror__ = __or__

    def select(self, a: Scalar, b: Scalar) -> Scalar:
        """`a` where this condition holds, else `b`."""
        return select(self, a, b)

    # ---- methods that NumPy calls on the elements of an object array: np.exp(x) is x.exp()
    def conjugate(self) -> "Expression":
        """The scalar itself; np.vdot calls this."""
        return self

    def __floor__(self) -> Scalar:
        return apply("floor", number(self))

    def arctan2(self, x: Scalar) -> Scalar:
        """Angle of the point (x, self)."""
        return _binary("arctan2", self, x)

    def square(self) -> Scalar:
        """The product with itself."""
        return _binary("multiply", self, self)

    # ---- refused: these need a number while the function is traced
    def __bool__(self) -> bool:
        raise _refuse(
            "a traced function cannot branch on data: `if`, `and`, `min`, `np.where`, `np.minimum` and comparisons of "
            "whole arrays need a number here. Use where(condition, a, b), minimum, maximum or clip from ohmward.trace"
        )

    def __float__(self) -> float:
        raise _refuse(
            "a traced value has no number yet. Use np.exp(x) instead of math.exp(x), and store traced values in "
            "np.array([...]) or np.zeros(n, dtype=object), not in an array of floats"
        )

    __int__ = __float__
    __complex__ = __float__

    def __index__(self) -> int:
        raise _refuse("a traced value cannot be an index or a count. Use table(values, start, spacing, x) to look up")

    def __copy__(self) -> "Expression":
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> "Expression":
        return self

    def __repr__(self) -> str:
        return f"Expression({describe(self)})"


def next_serial() -> int:
    """Serial between those of the values made before and after."""
    return next(_serials)


def symbol(name: str, boolean: bool = False) -> Expression:
    """Fresh input of a program."""
    return Expression(INPUT, (), name, boolean)


def apply(name: str, *args: Any) -> Scalar:
    """Result of an operation: a constant if all arguments are, else the simplified node; equal nodes are one object."""
    operation = OPERATIONS[name]
    if Expression not in map(type, args):
        value: Scalar = operation.compute(*args)
        return value
    if operation.commutative:
        a, b = args
        if type(b) is not Expression or (type(a) is Expression and b.serial < a.serial):
            args = b, a
    rule = RULES.get(name)
    simpler: Scalar | None = rule(apply, *args) if rule else None
    return _node(operation, args) if simpler is None else simpler


class _Reference(ref[Expression]):
    """Weak reference to a node under its key."""

    __slots__ = ("key",)
    key: tuple[Any, ...]


#: Every node that is in use.
_nodes: dict[tuple[Any, ...], _Reference] = {}


def _node(operation: Operation, args: tuple[Any, ...]) -> Expression:
    key = (operation.name, *[arg.serial if type(arg) is Expression else constant_key(arg) for arg in args])
    found = _nodes.get(key)
    node = found() if found else None
    if node is None:
        node = Expression(operation, args, "", operation.boolean)
        reference = _nodes[key] = _Reference(node, _forget)
        reference.key = key
    return node


def _forget(reference: _Reference) -> None:
    """Remove a node that is no longer in use."""
    if _nodes.get(reference.key) is reference:
        del _nodes[reference.key]


def constant_key(value: Any) -> Any:
    """Key under which equal constants are found: 0.0 is not -0.0."""
    return (value, math.copysign(1.0, value)) if isinstance(value, float) else value


#: Types of the constants of a formula, and of everything that may occur in one; arrays are left to NumPy.
_CONSTANTS = (int, float, np.floating, np.integer, np.bool_)
_SCALARS = (Expression, *_CONSTANTS)


def number(x: Any) -> Scalar:
    """A scalar as float or numeric Expression; conditions become 1.0 and 0.0.

    Raises:
        TraceError: it is not a scalar.
    """
    if isinstance(x, Expression):
        return apply("where", x, 1.0, 0.0) if x.boolean else x
    if isinstance(x, _CONSTANTS):
        return float(x)
    raise _refuse(f"a traced formula takes numbers and traced values, got {type(x).__name__}")


def condition(x: Any) -> Condition:
    """A scalar as bool or boolean Expression.

    Raises:
        TraceError: it is a traced number, or not a scalar.
    """
    if isinstance(x, Expression) and x.boolean:
        return x
    if isinstance(x, _CONSTANTS):
        return bool(x)
    if isinstance(x, Expression):
        raise _refuse("a traced number is no condition: write `x != 0`")
    raise _refuse(f"a condition is True, False or a comparison, got {type(x).__name__}")


def select(c: Scalar, a: Scalar, b: Scalar) -> Scalar:
    """`a` if c else `b`, for scalars; a condition if both are conditions."""
    c = condition(c)
    if is_condition(a) and is_condition(b):
        a, b = condition(a), condition(b)
        return apply("logical_or", apply("logical_and", c, a), apply("logical_and", apply("logical_not", c), b))
    return apply("where", c, number(a), number(b))


def is_condition(x: Any) -> bool:
    """True for a traced condition, True and False; False for numbers."""
    return x.boolean if isinstance(x, Expression) else isinstance(x, bool | np.bool_)


def _binary(name: str, a: Any, b: Any) -> Scalar:
    if isinstance(a, _SCALARS) and isinstance(b, _SCALARS):
        return apply(name, number(a), number(b))
    return NotImplemented  # type: ignore[no-any-return]


def _comparison(name: str, a: Any, b: Any) -> Condition:
    if isinstance(a, _SCALARS) and isinstance(b, _SCALARS):
        return condition(apply(name, number(a), number(b)))
    return NotImplemented  # type: ignore[no-any-return]


def _logical(name: str, *args: Any) -> Condition:
    if all(isinstance(a, _SCALARS) for a in args):
        return condition(apply(name, *map(condition, args)))
    return NotImplemented  # type: ignore[no-any-return]


def _power(base: Expression, exponent: Any) -> Scalar:
    """Small whole powers as products, 0.5 as a square root."""
    if not isinstance(exponent, _SCALARS):
        return NotImplemented  # type: ignore[no-any-return]
    n = number(exponent)
    if isinstance(n, float) and n.is_integer() and abs(n) <= _LARGEST_PRODUCT:
        return _whole_power(number(base), int(n))
    if isinstance(n, float) and n == 0.5:
        return apply("sqrt", number(base))
    return apply("power", number(base), n)


def _whole_power(x: Scalar, n: int) -> Scalar:
    if n < 0:
        return apply("divide", 1.0, _whole_power(x, -n))
    if n == 0:
        return 1.0
    half = _whole_power(x, n // 2)
    square = apply("multiply", half, half)
    return apply("multiply", square, x) if n % 2 else square


def describe(x: Any, depth: int = 3) -> str:
    """Text of a formula, cut off below `depth`."""
    if not isinstance(x, Expression):
        return repr(x)
    if x.operation is INPUT:
        return x.name
    return f"{x.operation.name}({', '.join(describe(a, depth - 1) for a in x.args) if depth else '...'})"


def _refuse(advice: str) -> TraceError:
    """TraceError that names the line of the caller's code."""
    frame = sys._getframe(2)
    while frame.f_back is not None and frame.f_code.co_filename.startswith(OF_THE_CALLER):
        frame = frame.f_back
    return TraceError(f"{frame.f_code.co_filename}:{frame.f_lineno}: {advice}")


def _method(name: str) -> Any:
    def call(self: Expression) -> Scalar:
        return apply(name, number(self))

    call.__name__ = name
    return call


for _operation in OPERATIONS.values():
    if _operation.arity == 1 and _operation.name not in ("negative", "absolute", "logical_not"):
        setattr(Expression, _operation.name, _method(_operation.name))
