"""Direction and size of a number, so that odd functions keep their slope at zero.

A friction law is f(s) = sign(s) g(|s|). Written with `sign` and `abs` its traced derivative at s = 0 is 0 instead of
g'(0): a filter that linearises at rest would see ice. Written with the two parts from here it is right everywhere.
"""

from typing import Any

from ohmward.trace import where


def direction_and_size(x: Any) -> tuple[Any, Any]:
    """1 or -1, and |x|, with x = direction * size; zero counts as forward, nan stays nan in the size."""
    forward = x >= 0
    return where(forward, 1.0, -1.0), where(forward, x, -x)
