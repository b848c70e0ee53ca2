"""A battery with every model, for the tests of what is exported."""

import dataclasses

from ohmward.battery.battery import Battery
from ohmward.battery.chemistries import generic_battery
from ohmward.battery.models.ocv import OcvCurve
from ohmward.battery.models.rc import RcModel

BATTERY: Battery = generic_battery("lfp", 12.0, 4)
WITH_RC = dataclasses.replace(
    BATTERY, rc=RcModel(9000.0, 900.0, 0.010, 0.010, 0.006, OcvCurve((12.0, 13.6)), BATTERY.capacity_Ah)
)
