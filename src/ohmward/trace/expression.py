"""Traced scalars: what NumPy does with them is written down as a graph of operations.

Equal nodes are one object (hash consing): `a + b` and `b + a` built anywhere are the same node, so common
subexpressions cost nothing and structure can be seen with `is`. Constants are plain Python floats; what can be
computed while tracing is computed, and `x + 0`, `x * 1`, `x * 0` vanish as they are built.
"""

import math
import os
import sys
from itertools import count
from pathlib import Path
from typing import Any, Union
from weakref import WeakValueDictionary

import numpy as np

from ohmward.errors import OhmwardError
from ohmward.trace.algebra import RULES
from ohmward.trace.operations import INPUT, OPERATIONS, Operation

#: What may stand in a traced formula: a node, or a constant.
Scalar = Union["Expression", float, bool]

_serials = count()
_NOT_THE_CALLER = tuple(f"{Path(file).parent}{os.sep}" for file in (__file__, np.__file__))


class TraceError(OhmwardError, TypeError):
    """The traced function asks for what tracing cannot give; the message says where, and what to write instead."""


class Expression:
    """A scalar whose value is known only when the program runs: an input, or an operation on other scalars.

    operation: the `Operation`; INPUT for an input.
    args:      its arguments: Expressions, floats, for a gather the tuple of values.
    name:      name of an input, "" otherwise.
    serial:    order of creation; a node comes after its arguments.
    boolean:   True for a condition.
    """

    __slots__ = ("__weakref__", "args", "boolean", "name", "operation", "serial")

    def __init__(self, operation: Operation, args: tuple, name: str, boolean: bool):
        self.operation = operation
        self.args = args
        self.name = name
        self.boolean = boolean
        self.serial = next(_serials)

    # ---- arithmetic; NotImplemented hands arrays over to NumPy, which works element by element
    def __add__(self, other: Any) -> Any:
        return _binary("add", self, other)

    def __radd__(self, other: Any) -> Any:
        return _binary("add", other, self)

    def __sub__(self, other: Any) -> Any:
        return _binary("subtract", self, other)

    def __rsub__(self, other: Any) -> Any:
        return _binary("subtract", other, self)

    def __mul__(self, other: Any) -> Any:
        return _binary("multiply", self, other)

    def __rmul__(self, other: Any) -> Any:
        return _binary("multiply", other, self)

    def __truediv__(self, other: Any) -> Any:
        return _binary("divide", self, other)

    def __rtruediv__(self, other: Any) -> Any:
        return _binary("divide", other, self)

    def __mod__(self, other: Any) -> Any:
        return _binary("remainder", self, other)

    def __rmod__(self, other: Any) -> Any:
        return _binary("remainder", other, self)

    def __floordiv__(self, other: Any) -> Any:
        return _binary("floor_divide", self, other)

    def __rfloordiv__(self, other: Any) -> Any:
        return _binary("floor_divide", other, self)

    def __pow__(self, exponent: Any) -> Any:
        return _power(self, exponent)

    def __rpow__(self, base: Any) -> Any:
        return _binary("power", base, self)

    def __neg__(self) -> Scalar:
        return apply("negative", number(self))

    def __pos__(self) -> Scalar:
        return number(self)

    def __abs__(self) -> Scalar:
        return apply("absolute", number(self))

    # ---- comparisons and logic
    def __lt__(self, other: Any) -> Any:
        return _binary("less", self, other)

    def __le__(self, other: Any) -> Any:
        return _binary("less_equal", self, other)

    def __gt__(self, other: Any) -> Any:
        return _binary("less", other, self)

    def __ge__(self, other: Any) -> Any:
        return _binary("less_equal", other, self)

    def __eq__(self, other: Any) -> Any:
        return _binary("equal", self, other)

    def __ne__(self, other: Any) -> Any:
        return _binary("not_equal", self, other)

    def __hash__(self) -> int:
        return object.__hash__(self)

    def __and__(self, other: Any) -> Any:
        return _logical("logical_and", self, other)

    def __or__(self, other: Any) -> Any:
        return _logical("logical_or", self, other)

    def __invert__(self) -> Any:
        return _logical("logical_not", self)

    __rand__ = __and__
    __ror__ = __or__

    def select(self, a: Any, b: Any) -> Scalar:
        """`a` where this condition holds, else `b`."""
        return select(self, a, b)

    # ---- what NumPy calls on the elements of an object array: np.exp(x) is x.exp()
    def conjugate(self) -> "Expression":
        """Itself: np.vdot asks for it."""
        return self

    def __floor__(self) -> Scalar:
        return apply("floor", number(self))

    def arctan2(self, x: Any) -> Any:
        """Angle of the point (x, self)."""
        return _binary("arctan2", self, x)

    def square(self) -> Scalar:
        """The product with itself."""
        return _binary("multiply", self, self)

    # ---- what a traced scalar cannot do
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

    def __deepcopy__(self, memo: dict) -> "Expression":
        return self

    def __repr__(self) -> str:
        return f"Expression({describe(self)})"


def symbol(name: str, boolean: bool = False) -> Expression:
    """A fresh input."""
    return Expression(INPUT, (), name, boolean)


def apply(name: str, *args: Any) -> Scalar:
    """The node for an operation on scalars: computed if all are constants, simplified, and found if it exists."""
    operation = OPERATIONS[name]
    if not any(isinstance(a, Expression) for a in args):
        return operation.compute(*args)
    if operation.commutative and _order(args[1]) < _order(args[0]):
        args = args[1], args[0]
    rule = RULES.get(name)
    simpler = rule(apply, *args) if rule else None
    return _node(operation, args) if simpler is None else simpler


_nodes: WeakValueDictionary[tuple, Expression] = WeakValueDictionary()


def _node(operation: Operation, args: tuple) -> Expression:
    key = (operation.name, *(_key(a) for a in args))
    node = _nodes.get(key)
    if node is None:
        node = _nodes[key] = Expression(operation, args, "", operation.boolean)
    return node


def _key(arg: Any) -> Any:
    """What makes arguments equal: being one node, or one constant (0.0 is not -0.0)."""
    if isinstance(arg, Expression):
        return arg.serial
    return (arg, math.copysign(1.0, arg)) if isinstance(arg, float) else arg


def _order(arg: Any) -> float:
    return arg.serial if isinstance(arg, Expression) else -1


def number(x: Any) -> Scalar:
    """A scalar as float or numeric Expression; conditions become 1.0 and 0.0. NotImplemented for anything else."""
    if isinstance(x, Expression):
        return apply("where", x, 1.0, 0.0) if x.boolean else x
    if isinstance(x, int | float | np.floating | np.integer | np.bool_):
        return float(x)
    return NotImplemented


def condition(x: Any) -> Scalar:
    """A scalar as bool or boolean Expression; TraceError for a traced number, NotImplemented for anything else."""
    if isinstance(x, Expression):
        if not x.boolean:
            raise _refuse("a traced number is no condition: write `x != 0`")
        return x
    return bool(x) if isinstance(x, int | float | np.floating | np.integer | np.bool_) else NotImplemented


def select(c: Any, a: Any, b: Any) -> Scalar:
    """`a` if c else `b`, for scalars; of two conditions a condition."""
    c = condition(c)
    if _is_condition(a) and _is_condition(b):
        a, b = condition(a), condition(b)
        return apply("logical_or", apply("logical_and", c, a), apply("logical_and", apply("logical_not", c), b))
    return apply("where", c, number(a), number(b))


def _is_condition(x: Any) -> bool:
    return x.boolean if isinstance(x, Expression) else isinstance(x, bool | np.bool_)


def _binary(name: str, a: Any, b: Any) -> Any:
    a, b = number(a), number(b)
    return NotImplemented if a is NotImplemented or b is NotImplemented else apply(name, a, b)


def _logical(name: str, *args: Any) -> Any:
    conditions = [condition(a) for a in args]
    return NotImplemented if any(c is NotImplemented for c in conditions) else apply(name, *conditions)


def _power(base: Expression, exponent: Any) -> Any:
    """Small whole powers as products, 0.5 as a square root."""
    n = number(exponent)
    if isinstance(n, float) and n.is_integer() and abs(n) <= 16:
        return _whole_power(number(base), int(n))
    if isinstance(n, float) and n == 0.5:
        return apply("sqrt", number(base))
    return _binary("power", base, exponent)


def _whole_power(x: Scalar, n: int) -> Scalar:
    if n < 0:
        return apply("divide", 1.0, _whole_power(x, -n))
    if n == 0:
        return 1.0
    half = _whole_power(x, n // 2)
    square = apply("multiply", half, half)
    return apply("multiply", square, x) if n % 2 else square


def describe(x: Any, depth: int = 3) -> str:
    """A formula to look at, cut off below `depth`."""
    if not isinstance(x, Expression):
        return repr(x)
    if x.operation is INPUT:
        return x.name
    return f"{x.operation.name}({', '.join(describe(a, depth - 1) for a in x.args) if depth else '...'})"


def _refuse(advice: str) -> TraceError:
    """The error, at the line of the caller's code that asked for the impossible."""
    frame = sys._getframe(2)
    while frame.f_back is not None and frame.f_code.co_filename.startswith(_NOT_THE_CALLER):
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
