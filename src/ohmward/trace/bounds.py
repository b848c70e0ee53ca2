"""Range of a traced value for any data, as far as its operation shows it."""

from __future__ import annotations

import math
from typing import Any

from ohmward.trace.expression import Expression


def within(x: Any, low: float, high: float) -> bool:
    """True where x lies between low and high for any data."""
    found = bounds(x)
    return found is not None and low <= found[0] and found[1] <= high


def bounds(x: Any) -> tuple[float, float] | None:
    """Smallest and largest number that x can be; None where they are not known, or x may be nan."""
    if not isinstance(x, Expression):
        return (x, x) if isinstance(x, float) and x == x else None
    name, args = x.operation.name, x.args
    if name == "floor" and (found := bounds(args[0])):
        return math.floor(found[0]), found[1]
    if name == "where":
        return _of_choice(*args)
    if name == "gather":
        return min(args[1]), max(args[1])
    if name in ("minimum", "maximum") and (a := bounds(args[0])) and (b := bounds(args[1])):
        smaller = min if name == "minimum" else max
        return smaller(a[0], b[0]), smaller(a[1], b[1])
    return None


def _of_choice(condition: Expression, chosen: Any, otherwise: Any) -> tuple[float, float] | None:
    """Bounds of `x if low < x else low`, which is `low` for nan."""
    if condition.operation.name != "less":
        return None
    low, tested = condition.args
    same_limit = type(low) is float and type(otherwise) is float and low == otherwise
    return (low, math.inf) if tested is chosen and same_limit else None
