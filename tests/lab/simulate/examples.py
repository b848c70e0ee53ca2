"""A battery so simple that closed forms hold: straight OCV, constant resistances, no limits, no side reactions."""

from __future__ import annotations

from dataclasses import replace

from ohmward.battery.models.ocv import OcvCurve
from ohmward.battery.models.thevenin import Thevenin
from ohmward_lab.simulate.cells import SimulatedBattery


def simple_battery(**changes) -> SimulatedBattery:
    circuit = Thevenin(
        capacity_Ah=10.0,
        ocv=OcvCurve((12.0, 13.0), (0.02, 0.02), (1e-3, 1e-3)),
        r0_discharge_ohm=(0.02, 0.02),
        r0_charge_ohm=(0.03, 0.03),
        r_ohm=((0.01, 0.01), (0.02, 0.02), (0.03, 0.03)),
        tau_s=(5.0, 50.0, 500.0),
    )
    battery = SimulatedBattery(
        name="simulated straight line",
        chemistry="none",
        n_series=4,
        circuit=circuit,
        transfer_V=0.2,
        exchange_A=20.0,
        full_width=0.0,
        voltage_min_V=0.0,
        voltage_max_V=100.0,
        charge_current_A=5.0,
        heat_capacity_J_per_K=1000.0,
        cooling_W_per_K=0.5,
    )
    return replace(battery, **changes)
