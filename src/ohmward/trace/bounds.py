"""What is known of a value whatever the data: the range that its operations show."""

from __future__ import annotations

import math
from typing import Any

from ohmward.trace.expression import Expression


def bounds(x: Any) -> tuple[float, float] | None:
    """Between which numbers a value lies whatever happens, as far as its operation shows; None where it may be nan."""
    if not isinstance(x, Expression):
        return (x, x) if isinstance(x, float) and x == x else None
    name, args = x.operation.name, x.args
    if name == "floor" and (found := bounds(args[0])):
        return math.floor(found[0]), found[1]
    if name == "where" and args[0].operation.name == "less":  # low < x ? x : low
        (low, tested), (_, chosen, otherwise) = args[0].args, args
        return (low, math.inf) if tested is chosen and _same_number(low, otherwise) else None
    if name == "gather":
        return min(args[1]), max(args[1])
    if name in ("minimum", "maximum") and (a := bounds(args[0])) and (b := bounds(args[1])):
        smaller = min if name == "minimum" else max
        return smaller(a[0], b[0]), smaller(a[1], b[1])
    return None


def _same_number(a: Any, b: Any) -> bool:
    return type(a) is float and type(b) is float and a == b
