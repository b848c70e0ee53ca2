"""Several outputs with independent noise, used one after the other: divisions instead of a factorisation."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ohmward.filters.belief import Belief, Function, Innovation
from ohmward.filters.shapes import require_shape

Update = Callable[[Belief, np.ndarray, Function, np.ndarray], tuple[Belief, Innovation]]


def update_sequentially(
    belief: Belief, y: np.ndarray, h: Function, variances: np.ndarray, update: Update
) -> tuple[Belief, tuple[Innovation, ...]]:
    """Belief after the outputs y_i = h_i(x) + v_i, v_i ~ N(0, variances_i), one at a time, in their order.

    The same as the joint update where h is linear; elsewhere each output is linearised where the last one left the
    mean, which is usually better. The sum of the innovations' NIS is the joint one.

    Args:
        belief: before the measurements.
        y: (m,) measured outputs.
        h: outputs (m,) of a state (n,).
        variances: (m,), the diagonal of R.
        update: `extended.update` or `unscented.update`.

    Returns:
        The belief after the last output, and the m innovations, each of one element.

    Raises:
        InputError: y and variances do not fit each other.
    """
    require_shape("variances", variances, np.shape(y))
    innovations = []
    for i, variance in enumerate(variances):
        belief, innovation = update(belief, y[i : i + 1], _element(h, i), np.array([[variance]]))
        innovations.append(innovation)
    return belief, tuple(innovations)


def _element(h: Function, i: int) -> Function:
    """Output i of h alone, as (1,)."""
    return lambda x: h(x)[i : i + 1]
