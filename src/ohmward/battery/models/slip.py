"""Slip of the electrodes of an aged lithium-ion cell, as a change of its open-circuit curve along SoC.

A cell that has lost lithium has not its first curve over less charge: the electrodes have slipped against each other.
Between oxides of nickel, manganese and cobalt and graphite the sloped curve of the oxide stays where it was below
full, and the knee of graphite comes earlier at empty; with iron phosphate, whose curve is flat, that of graphite stays
where it was above empty, and the knee comes earlier at full. With a loss L of the capacity, s = `share`,

OCV_aged(z) = OCV(z + s L (1 - z) z^2 / (z^2 + k^2))   where full stays (s > 0),
OCV_aged(z) = OCV(z + s L z (1 - z)^2 / ((1 - z)^2 + k^2))   where empty stays (s < 0).

Full and empty stay full and empty. |s| is 1 where all of the loss is lithium, and 0 where the active material of both
electrodes is lost alike (Birkl et al. 2017, J. Power Sources 341, 373).
"""

from __future__ import annotations

from typing import Any

from ohmward.trace import clip

#: Distance k of the knee from the end of the curve: at empty with layered oxides, at full with iron phosphate.
_KNEE_AT_EMPTY, _KNEE_AT_FULL = 0.2, 0.08


def slip_shape(soc: Any, share: float) -> Any:
    """Change of the SoC on the curve for each unit of `share` and of the loss; float, array or traced.

    share: its sign says the end that stays, >= 0 full.
    """
    z = clip(soc, 0.0, 1.0)
    moved, knee = (z, _KNEE_AT_EMPTY) if share >= 0.0 else (1.0 - z, _KNEE_AT_FULL)
    return (1.0 - moved) * (moved * moved) / (moved * moved + knee * knee)
