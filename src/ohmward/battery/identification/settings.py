"""Knowledge of the user about the battery and its logs."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

#: "thevenin" chooses the number of RC pairs by evidence.
MODELS = ("thevenin", "thevenin-0rc", "thevenin-1rc", "thevenin-2rc", "thevenin-3rc", "rc")
DEFAULT_MODEL = "thevenin"


class IdentificationSettings(NamedTuple):
    """Knowledge of the user about the battery and its logs; see `identify`."""

    capacity_Ah: float
    model: str = DEFAULT_MODEL
    chemistry: str = ""
    n_series: int = 1
    name: str = ""
    initial_soc: Mapping[str, float] = MappingProxyType({})
    idle_current_A: float | None = None
    ocv: Any = None
