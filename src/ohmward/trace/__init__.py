"""The kernel compiler: a model or filter step written as NumPy, traced once and lowered to the best form installed."""

from ohmward.trace.derivative import jacobian, linearize
from ohmward.trace.expression import Condition, Expression, Scalar, TraceError
from ohmward.trace.functions import (
    arctan2,
    clip,
    cos,
    exp,
    floor,
    isfinite,
    log,
    logical_not,
    maximum,
    minimum,
    sign,
    sin,
    sqrt,
    tanh,
    where,
)
from ohmward.trace.kernel import Kernel
from ohmward.trace.program import Program, trace
from ohmward.trace.table import monotone_slopes, table

__all__ = [
    "Condition",
    "Expression",
    "Kernel",
    "Program",
    "Scalar",
    "TraceError",
    "arctan2",
    "clip",
    "cos",
    "exp",
    "floor",
    "isfinite",
    "jacobian",
    "linearize",
    "log",
    "logical_not",
    "maximum",
    "minimum",
    "monotone_slopes",
    "sign",
    "sin",
    "sqrt",
    "table",
    "tanh",
    "trace",
    "where",
]
