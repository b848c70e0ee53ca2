"""Numbers with their units and 95 % bands, as text for a terminal, a page or a notebook."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TypeGuard

from ohmward.battery.chemistries import Normal
from ohmward.filters.consistency import BAND_95


def percent(share: float | None, digits: int = 2) -> str:
    """A share as a percentage, "-" where it is not known."""
    if not known(share):
        return "-"
    return f"{100 * share:.{digits}f} %" if abs(share) < 100 else f"{100 * share:.1e} %"


def percent_band(share: float, std: float) -> str:
    """A share and the half width of its 95 % band as percentages."""
    return f"{percent(share, 1)} ± {percent(BAND_95 * std, 1)}"


def quantity(value: float | None, unit: str, scale: float = 1.0, digits: int = 3) -> str:
    """A number with its unit, "-" where it is not known."""
    return f"{float(f'{scale * value:.{digits}g}'):g} {unit}".rstrip() if known(value) else "-"


def known(value: float | None) -> TypeGuard[float]:
    """True where there is a finite number."""
    return value is not None and math.isfinite(value)


def normal(value: Mapping[str, float], unit: str, scale: float = 1.0) -> str:
    """A mean and its 95 % band, rounded to two digits of the band; "-" where it is not known."""
    if not known(value["mean"]):
        return "-"
    mean, half = scale * value["mean"], scale * BAND_95 * value["std"]
    digits = _digits(half)
    return f"{mean:.{digits}f} ± {half:.{digits}f} {unit}"


def ratio(logarithm: Normal) -> dict[str, float]:
    """Mean and standard deviation of a ratio, from those of its logarithm."""
    mean = math.exp(logarithm.mean)
    return {"mean": mean, "std": mean * float(logarithm.std)}


def lognormal(value: Mapping[str, float], unit: str, scale: float = 1.0) -> str:
    """A mean and the 95 % band of a quantity whose logarithm is in error; "-" where it is not known."""
    if not known(value["mean"]):
        return "-"
    mean, ratio = scale * value["mean"], BAND_95 * value["std"] / value["mean"]
    low, high = mean * math.exp(-ratio), mean * math.exp(ratio)
    digits = _digits(0.5 * (high - low))
    return f"{mean:.{digits}f} ({low:.{digits}f} to {high:.{digits}f}) {unit}"


def _digits(half: float) -> int:
    """Decimals that show two digits of a half width."""
    return max(0, 1 - math.floor(math.log10(half))) if half > 0 else 3


def band(share: float, std: float) -> str:
    """A share and the half width of its 95 % band, both in percentage points."""
    return f"{100 * share:.1f} ± {100 * BAND_95 * std:.1f}"


def flagged(counts: Mapping[str, int]) -> str:
    """Flags with their counts in one line, "none" without any."""
    return ", ".join(f"{name.replace('_', ' ')} {count:,}" for name, count in counts.items()) or "none"
