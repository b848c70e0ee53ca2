"""A battery for the tests of what is exported."""

from ohmward.battery.battery import Battery
from ohmward.battery.chemistries import generic_battery

BATTERY: Battery = generic_battery("lfp", 12.0, 4)
