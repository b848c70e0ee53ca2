"""The one table of operations: name, arity, value on floats, spelling in Python, derivative.

The name is NumPy's name of the same function, so the NumPy lowering needs no spelling of its own; another lowering
(machine code, C99) brings one table of spellings keyed by these names.
"""

import math
import operator
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ohmward.trace import ieee

# Python's binding strengths, weakest first: an operation within a stronger one needs parentheses.
CHOICE, OR, AND, NOT, COMPARE, SUM, PRODUCT, SIGN, ATOM = range(9)


@dataclass(frozen=True, eq=False)
class Operation:
    """Kind of node."""

    name: str  #:        NumPy's name of the function, where NumPy has it
    arity: int  #:       number of arguments
    compute: Callable[..., Any]  #:     value on Python floats, with IEEE 754 results: the definition of the operation
    python: str  #:      template of the fast Python spelling, `{0}` the first argument
    binding: int  #:     binding strength of that spelling
    #:  (result, arguments, their tangents) -> tangent of the result: the chain rule in one direction
    derivative: Callable[[Any, tuple[Any, ...], tuple[Any, ...]], Any]
    risky: bool = False  #:       the Python spelling raises where `compute` has a result (1/0, exp(1000))
    commutative: bool = False  #: exchanging the arguments changes no bit of the result
    boolean: bool = False  #:     the result is True or False


def _flat(r: Any, a: tuple[Any, ...], d: tuple[Any, ...]) -> float:
    """Tangent of a function that is constant almost everywhere."""
    return 0.0


#: The operation of an input of a program.
INPUT = Operation("input", 0, lambda: None, "", ATOM, _flat)


def _log(x: Any) -> Any:
    return ieee.log(x) if isinstance(x, float) else x.log()


# In the rules, r is the result, a the arguments, d their tangents. A tangent that is the literal 0.0 costs nothing:
# 0.0 times an expression is 0.0.
# fmt: off
_ARITHMETIC = (
    Operation("add", 2, operator.add, "{0} + {1}", SUM, lambda r, a, d: d[0] + d[1], commutative=True),
    Operation("subtract", 2, operator.sub, "{0} - {1}", SUM, lambda r, a, d: d[0] - d[1]),
    Operation("multiply", 2, operator.mul, "{0} * {1}", PRODUCT, lambda r, a, d: d[0] * a[1] + a[0] * d[1],
              commutative=True),
    Operation("divide", 2, ieee.divide, "{0} / {1}", PRODUCT, lambda r, a, d: (d[0] - r * d[1]) / a[1], risky=True),
    Operation("remainder", 2, ieee.remainder, "{0} % {1}", PRODUCT, lambda r, a, d: d[0] - (a[0] // a[1]) * d[1],
              risky=True),
    Operation("floor_divide", 2, ieee.floor_divide, "{0} // {1}", PRODUCT, _flat, risky=True),
    Operation("power", 2, ieee.power, "power({0}, {1})", ATOM,
              lambda r, a, d: a[1] * a[0] ** (a[1] - 1.0) * d[0] + r * _log(a[0]) * d[1], risky=True),
    Operation("negative", 1, operator.neg, "-{0}", SIGN, lambda r, a, d: -d[0]),
    Operation("absolute", 1, abs, "abs({0})", ATOM, lambda r, a, d: a[0].sign() * d[0]),
)
_FUNCTIONS = (
    Operation("sqrt", 1, ieee.sqrt, "sqrt({0})", ATOM, lambda r, a, d: (0.5 / r) * d[0], risky=True),
    Operation("exp", 1, ieee.exp, "exp({0})", ATOM, lambda r, a, d: r * d[0], risky=True),
    Operation("expm1", 1, ieee.expm1, "expm1({0})", ATOM, lambda r, a, d: (r + 1.0) * d[0], risky=True),
    Operation("log", 1, ieee.log, "log({0})", ATOM, lambda r, a, d: d[0] / a[0], risky=True),
    Operation("log1p", 1, ieee.log1p, "log1p({0})", ATOM, lambda r, a, d: d[0] / (1.0 + a[0]), risky=True),
    Operation("sin", 1, ieee.sin, "sin({0})", ATOM, lambda r, a, d: a[0].cos() * d[0], risky=True),
    Operation("cos", 1, ieee.cos, "cos({0})", ATOM, lambda r, a, d: -(a[0].sin() * d[0]), risky=True),
    Operation("tan", 1, ieee.tan, "tan({0})", ATOM, lambda r, a, d: (1.0 + r * r) * d[0], risky=True),
    Operation("arctan", 1, ieee.arctan, "arctan({0})", ATOM, lambda r, a, d: d[0] / (1.0 + a[0] * a[0])),
    Operation("arctan2", 2, ieee.arctan2, "arctan2({0}, {1})", ATOM,
              lambda r, a, d: (a[1] * d[0] - a[0] * d[1]) / (a[0] * a[0] + a[1] * a[1])),
    Operation("sinh", 1, ieee.sinh, "sinh({0})", ATOM, lambda r, a, d: a[0].cosh() * d[0], risky=True),
    Operation("cosh", 1, ieee.cosh, "cosh({0})", ATOM, lambda r, a, d: a[0].sinh() * d[0], risky=True),
    Operation("tanh", 1, ieee.tanh, "tanh({0})", ATOM, lambda r, a, d: (1.0 - r * r) * d[0]),
    Operation("arcsinh", 1, ieee.arcsinh, "arcsinh({0})", ATOM, lambda r, a, d: d[0] / (1.0 + a[0] * a[0]).sqrt()),
)
# Piecewise: where two pieces meet, the derivative is that of the piece that gives the value.
_PIECEWISE = (
    Operation("minimum", 2, ieee.minimum, "({0} if {0} < {1} or {0} != {0} else {1})", ATOM,
              lambda r, a, d: (a[0] < a[1]).select(d[0], d[1])),
    Operation("maximum", 2, ieee.maximum, "({0} if {0} > {1} or {0} != {0} else {1})", ATOM,
              lambda r, a, d: (a[0] > a[1]).select(d[0], d[1])),
    Operation("where", 3, ieee.where, "{1} if {0} else {2}", CHOICE, lambda r, a, d: a[0].select(d[1], d[2])),
    Operation("sign", 1, ieee.sign, "(1.0 if {0} > 0.0 else -1.0 if {0} < 0.0 else 0.0 if {0} == 0.0 else {0})", ATOM,
              _flat),
    Operation("floor", 1, ieee.floor, "({0} // 1.0 if -4503599627370496.0 < {0} < 4503599627370496.0 else {0})", ATOM,
              _flat),
    Operation("gather", 2, ieee.gather, "{1}[int({0})]", ATOM, _flat, risky=True),
)
# Parts of exp, log and the like where there is no libm, see `elementary`; their derivatives are never needed.
_BITS = (
    Operation("power_of_two", 1, ieee.power_of_two, "ldexp(1.0, int({0}))", ATOM, _flat, risky=True),
    Operation("exponent", 1, ieee.exponent, "(frexp({0})[1] - 1.0)", ATOM, _flat),
)
_LOGIC = (
    Operation("less", 2, operator.lt, "{0} < {1}", COMPARE, _flat, boolean=True),
    Operation("less_equal", 2, operator.le, "{0} <= {1}", COMPARE, _flat, boolean=True),
    Operation("equal", 2, operator.eq, "{0} == {1}", COMPARE, _flat, commutative=True, boolean=True),
    Operation("not_equal", 2, operator.ne, "{0} != {1}", COMPARE, _flat, commutative=True, boolean=True),
    Operation("logical_and", 2, operator.and_, "{0} and {1}", AND, _flat, commutative=True, boolean=True),
    Operation("logical_or", 2, operator.or_, "{0} or {1}", OR, _flat, commutative=True, boolean=True),
    Operation("logical_not", 1, operator.not_, "not {0}", NOT, _flat, boolean=True),
    Operation("isfinite", 1, math.isfinite, "isfinite({0})", ATOM, _flat, boolean=True),
)
# fmt: on
#: Operations that only `elementary` writes into a program.
BITS = frozenset(o.name for o in _BITS)
OPERATIONS = {o.name: o for o in (*_ARITHMETIC, *_FUNCTIONS, *_PIECEWISE, *_BITS, *_LOGIC)}
