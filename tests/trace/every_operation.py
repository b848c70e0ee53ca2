"""A step with each operation in it: what every lowering has to take."""

from typing import Any, NamedTuple

import numpy as np

from ohmward.trace import exp, isfinite, log, maximum, minimum, sign, sqrt, table, tanh, where


class Memory(NamedTuple):
    level: Any
    armed: Any
    held: Any  # (2,)


class Seen(NamedTuple):
    u: Any
    on: Any
    w: Any


def step(state: Memory, sample: Seen) -> tuple:
    """Conditions and numbers, alone and in an array, as state and as output."""
    u, on, w = sample
    level = 0.9 * state.level + minimum(u, 1.5) - maximum(w, state.held[0]) / 3.0
    level = where(on, level, tanh(level) + sign(u))
    curve = table([0.0, 1.0, 0.5, 3.0], -2.0, 1.5, level, kind="hermite")
    good = isfinite(w) & ~(u == w) | (u != 2.0)
    armed = (on & good) | (state.armed & (abs(u) <= 1.0))
    held = np.array([sqrt(abs(level)), log(1.0 + exp(u)) + np.sin(level) + (w % 0.7) + w // 0.3])
    return Memory(level, armed, held), (curve, where(armed, -curve, held[1]), armed, held[0])
