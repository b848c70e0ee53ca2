"""A battery for the tests of what is exported, and its exports, each made once in a process."""

from collections.abc import Mapping
from functools import cache
from types import MappingProxyType
from typing import Any

from ohmward.battery.battery import Battery
from ohmward.battery.chemistries import generic_battery
from ohmward.embedded import Export, battery_export, library

BATTERY: Battery = generic_battery("lfp", 12.0, 4)


@cache
def soc_export(estimator: str, name: str = "soc", **options: Any) -> Export:
    """An estimator of the battery, exported."""
    return battery_export(BATTERY, estimator, name, **options)


@cache
def soc_library(estimator: str, name: str = "soc", **options: Any) -> Mapping[str, str]:
    """Its library in C: text of each file."""
    return MappingProxyType(library(soc_export(estimator, name, **options)))
