"""Update of a battery file by one log, or the reason why there is none."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.chemistries import Normal
from ohmward.battery.learning.parameters import TITLES, Parameters
from ohmward.battery.soc.anchors import Anchor


class LogUpdate(NamedTuple):
    """Update by one log."""

    log: str  #: its name
    verdict: str  #: "learnt", "set aside" or "seen"
    reason: str  #: why it was set aside, or what it taught, in a sentence
    hours: float  #: its length
    #: range of SoC in it
    soc_min: float
    soc_max: float
    #: what is known after this log; the resistance to ten seconds of 1 C at half charge and the temperature of the file
    capacity_Ah: Normal
    resistance_ohm: Normal
    offset_A: Normal
    #: by what factor the standard deviation of each group of parameters narrowed, by its name
    information: Mapping[str, float]
    residual_rms_V: float  #: measured minus expected voltage
    misfit: float  #: factor by which the squares of these errors exceed what the file expects of them, at least 1
    #: SoC at the first and the last sample
    soc_start: Normal
    soc_end: Normal
    #: what this log alone says of them, all other parameters as they are known after it; the standard deviation is inf
    #: where it says nothing
    own_capacity_Ah: Normal
    own_resistance_ohm: Normal
    given_Ah: Normal  #: charge from full down to the lowest SoC of the log
    anchors: tuple[Anchor, ...] = ()  #: what told SoC beside the voltage
    left_out: tuple[str, ...] = ()  #: stretches and samples of the log that were not used, and why

    def as_dict(self) -> dict[str, Any]:
        """The update for JSON; a number that is not known is None."""
        records = {name: value._asdict() for name, value in self._asdict().items() if isinstance(value, Normal)}
        found = self._asdict() | records | {"anchors": [anchor._asdict() for anchor in self.anchors]}
        return {name: None if value != value else value for name, value in found.items()}


def narrowed(p: Parameters, before: np.ndarray, after: np.ndarray) -> dict[str, float]:
    """Factor by which the standard deviation of each group became smaller, the mean of its parameters."""
    factors = {}
    for name, size in p.sizes.items():
        if size:
            k = p.group(name)
            ratio = np.diag(before)[k] / np.maximum(np.diag(after)[k], 1e-300)
            factors[name] = float(np.exp(0.5 * np.mean(np.log(ratio))))
    return factors


def what_narrowed(information: Mapping[str, float]) -> str:
    """The groups that narrowed most, in a line."""
    most = sorted(information.items(), key=lambda item: -item[1])[:3]
    parts = [f"{TITLES[name]} {factor:.2g} times narrower" for name, factor in most if factor >= 1.05]
    return ", ".join(parts) if parts else "nothing new"
