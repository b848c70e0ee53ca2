"""From logs of tests to a battery: charge, segments, SoC, OCV curve, resistances, relaxation, circuit, noise."""

from ohmward.battery.identification.first_ocv import DEFAULT_MODEL, MODELS, IdentificationSettings
from ohmward.battery.identification.identify import Identified, identify, identify_in_detail
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
