"""Tables and figures with results of [T], chapters 3 to 5, in its order."""

from __future__ import annotations

from ohmward_lab.reproduce import thesis_battery, thesis_cases, thesis_observer
from ohmward_lab.reproduce.row import Item

ITEMS = (
    Item(
        ("3.1", "3.6", "3.7", "3.8", "3.9"), "Offline and updated model, parameters", thesis_battery.offline_and_updated
    ),
    Item(("3.2", "3.11", "3.12"), "Voltage by EKF, AEKF, UKF and AUKF", thesis_battery.voltage_by_method),
    Item(("3.3", "3.10", "3.13", "3.14", "3.15"), "State of charge, 98 to 90 %", thesis_battery.soc_by_method),
    Item(("3.3-whole",), "State of charge over the whole range", thesis_battery.whole_range),
    Item(tuple(f"4.{k}" for k in range(7, 17)), "Observer of speed, slip and yaw rate", thesis_observer.observers),
    Item(("5.6", "5.7"), "Case I: braking on the slippery floor", thesis_cases.case_1),
    Item(("5.8", "5.9"), "Case II: from the normal to the slippery floor", thesis_cases.case_2),
)
