"""From logs of tests to a battery: charge, segments, SoC, OCV curve, resistances, relaxation, circuit, noise."""

from ohmward.battery.identification.identify import (
    DEFAULT_MODEL,
    MODELS,
    IdentificationSettings,
    Identified,
    identify,
    identify_in_detail,
)
from ohmward.battery.identification.log_details import LogDetails

__all__ = [
    "DEFAULT_MODEL",
    "MODELS",
    "IdentificationSettings",
    "Identified",
    "LogDetails",
    "identify",
    "identify_in_detail",
]
