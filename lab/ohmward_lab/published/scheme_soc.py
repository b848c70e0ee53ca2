"""The scheme of [T] with its own constants as an estimator of the state of charge, to compare with others."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ohmward.battery.models.noise import BatteryNoise
from ohmward.battery.soc.rc_soc_link import SocByCurve
from ohmward.battery.soc.sample import SocEstimate, SocSample
from ohmward.errors import InputError
from ohmward.trace import maximum
from ohmward_lab.published.scheme_by_method import SchemeByMethod, SchemeByMethodState


@dataclass(frozen=True)
class SchemeSoc:
    """The scheme; its estimates are nan but for SoC and its standard deviation."""

    scheme: SchemeByMethod

    def init(self, first: SocSample, soc: float | None = None, soc_std: float = 0.03) -> SchemeByMethodState:
        """State before the first sample; a SoC that is None is where the OCV curve passes its voltage.

        A first sample without a voltage is taken to be at rest at that SoC.

        Raises:
            InputError: neither a SoC nor a voltage.
        """
        model, known = self.scheme.model, math.isfinite(first.voltage_V)
        if soc is None and not known:
            raise InputError("the first sample has no voltage: give soc, the state of charge at the start")
        if soc is None:
            beyond: Any = SocByCurve(model, BatteryNoise()).soc_beyond(first.voltage_V)
            soc = min(max(float(beyond), 0.0), 1.0)
        voltage_V = first.voltage_V if known else float(model.at_rest(soc)[0])
        return self.scheme.init(first._replace(voltage_V=voltage_V), soc, soc_std)

    def step(self, state: SchemeByMethodState, sample: SocSample) -> tuple[SchemeByMethodState, SocEstimate]:
        """State and estimate after a sample."""
        after, found = self.scheme.step(state, sample)
        unknown = SocEstimate(*[math.nan] * len(SocEstimate._fields))
        soc_std = np.sqrt(maximum(found.soc.soc_variance, 0.0))
        return after, unknown._replace(soc=found.soc.soc, soc_std=soc_std, flags=0.0)
