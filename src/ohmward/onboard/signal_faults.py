"""Faults of signals, one sentence with its fix for each: in a setup, in its trial, and while it runs."""

from __future__ import annotations

import math
from collections.abc import Iterable

#: Counts without the size of one turn.
NOT_COUNTED = "counts need counts_per_turn = ... in the setup"

#: Scales that are forgotten most often, and their names; the first that fits is proposed.
SCALES = {
    "V": ((0.001, "millivolts"), (0.01, "hundredths of a volt"), (0.1, "tenths of a volt")),
    "A": ((0.001, "milliamperes"), (0.01, "hundredths of an ampere"), (0.1, "tenths of an ampere")),
    "degC": ((0.1, "tenths of a degree"), (0.01, "hundredths of a degree"), (0.001, "millidegrees")),
    "rad_s": ((2 * math.pi / 60.0, "rpm"), (math.pi / 180.0, "degrees per second"), (0.001, "milliradians per second")),
}


def doubled(sources: Iterable[str], used: str = "") -> str:
    """A signal that several sources send; used: the one whose values are taken."""
    choice = f"{used} is used, " if used else ""
    return f"{' and '.join(sources)} both send it; {choice}leave it out of one of them"


def missing(came: str) -> str:
    """A signal that its source promises and does not send; came: "never came from can0"."""
    return f"{came}; check its wiring and its name there, or leave it out of signals"


def no_number(often: str) -> str:
    """A sensor that sends nan; often: "in 5% of its values"."""
    return f"no number {often}; look at the sensor and its wire"


def implausible(signal: str, lowest: float, highest: float, limits: tuple[float, float], fault: str = "") -> str:
    """Values of a signal from lowest to highest, beyond its limits; fault: a clause on them."""
    low, high = limits
    seen = f"{lowest:.4g}" if lowest == highest else f"{lowest:.4g} to {highest:.4g}"
    advice = _unit_advice(signal.partition(".")[0], lowest, highest, low, high)
    return f"reads {seen}{fault}, plausible are {low:.3g} to {high:.3g}; {advice}"


def _unit_advice(name: str, lowest: float, highest: float, low: float, high: float) -> str:
    unit = next((unit for unit in SCALES if name.endswith(f"_{unit}")), "")
    if unit == "degC" and low <= lowest - 273.15 and highest - 273.15 <= high:
        return "kelvins? then offset = -273.15"
    for scale, named in SCALES.get(unit, ()):
        if low <= scale * lowest and scale * highest <= high:
            return f"{named}? then scale = {scale:.4g}"
    return "check its unit, scale and offset, its wire, and that battery and robot file are those of this robot"
