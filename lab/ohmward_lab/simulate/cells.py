"""Batteries that exist only here: plausible parameters, richer than the models that are fitted to them.

Testing a filter on its own model proves nothing. Besides a ladder of four RC pairs (diffusion) these have charge
transfer that saturates (Butler-Volmer), one-state hysteresis, resistances that depend on SoC, on the direction of the
current and on temperature, self-heating, and a charge that is lost to side reactions. Values are of the order that
textbooks and datasheets give for such cells (Plett, Battery Management Systems I, 2015, for the shape of the circuit;
Linden, Handbook of Batteries, for voltages and resistances); none is fitted to a measured cell.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.models.ocv import OcvCurve
from ohmward.battery.models.thevenin import Thevenin
from ohmward.checks import require_between, require_each_positive, require_positive

#: 2 R T / F at 25 degC [V]: overpotential of one electrode reaction per unit of arcsinh(i / 2 i_0), symmetry 1/2.
REACTION_V = 0.0514
_SOC = np.linspace(0.0, 1.0, 201)
_SOC_COARSE = np.linspace(0.0, 1.0, 21)


@dataclass(frozen=True)
class SimulatedBattery:
    """The truth of a simulation.

    Raises:
        InputError: a value out of its range.
    """

    name: str  #: marks it as simulated
    chemistry: str  #: "lfp", "lead-acid" or "nca"; of a battery file, its own
    n_series: int  #: cells in series
    #: the whole pack as a circuit with many RC pairs; its OCV meets the limits where the battery is full or empty, or
    #: the charge is lost there, so that the SoC stays in [0, 1]
    circuit: Thevenin
    #: charge transfer, transfer_V * arcsinh(i / exchange_A), of the whole pack at 25 degC
    transfer_V: float
    exchange_A: float
    full_width: float  #: SoC below full over which less and less of a charge is stored (gassing); 0 for none
    #: limits that the protection and the charger keep
    voltage_min_V: float
    voltage_max_V: float
    charge_current_A: float  #: of the charger, before its constant-voltage phase
    #: of the whole pack, to the ambient air
    heat_capacity_J_per_K: float
    cooling_W_per_K: float

    def __post_init__(self) -> None:
        require_each_positive(
            "battery.", self, "exchange_A", "charge_current_A", "heat_capacity_J_per_K", "cooling_W_per_K"
        )
        require_between("battery.transfer_V", self.transfer_V, 0.0, np.inf)
        require_between("battery.full_width", self.full_width, 0.0, 1.0)
        require_between("battery.voltage_min_V", self.voltage_min_V, 0.0, self.voltage_max_V)
        require_positive("battery.r0_discharge_ohm", self.circuit.r0_discharge_ohm)
        require_positive("battery.r0_charge_ohm", self.circuit.r0_charge_ohm)


def lfp_12V8() -> SimulatedBattery:
    """Four LiFePO4 cells of 12 Ah in series.

    The plateau has the two steps of the graphite stages, near 27 % and 68 %, 35 and 40 mV high; half the distance of
    the branches is about 12 mV (Plett 2015, 2.8). 6 mohm a cell include the wiring and the protection's transistors.
    The charger stops at 13.8 V, the protection at 11 V: gentle limits, at which the cell at rest is full and empty.
    """
    cell = Thevenin(
        capacity_Ah=12.0,
        ocv=OcvCurve(_lfp_ocv(_SOC), tuple(0.012 * _inside(_SOC, 0.05)), tuple(1.5e-4 * np.sin(2 * np.pi * _SOC))),
        r0_discharge_ohm=_low_soc(0.0060, 0.7, 0.08),
        r0_charge_ohm=_low_soc(0.0056, 0.4, 0.08),
        r_ohm=(
            _low_soc(0.0010, 0.5, 0.10),
            _low_soc(0.0012, 1.0, 0.10),
            _low_soc(0.0018, 1.5, 0.12),
            _low_soc(0.0030, 1.5, 0.15),
        ),
        tau_s=(3.0, 25.0, 220.0, 1800.0),
        hysteresis_rate=40.0,
        activation_K=3000.0,
    )
    return SimulatedBattery(
        name="simulated LFP 12.8 V 12 Ah",
        chemistry="lfp",
        n_series=4,
        circuit=cell.in_series(4),
        transfer_V=4 * REACTION_V,
        exchange_A=24.0,
        full_width=0.0,
        voltage_min_V=4 * cell.ocv.voltage_V[0],
        voltage_max_V=4 * cell.ocv.voltage_V[-1],
        charge_current_A=6.0,
        heat_capacity_J_per_K=1400.0,
        cooling_W_per_K=0.5,
    )


def lead_acid_12V() -> SimulatedBattery:
    """Six sealed lead-acid (AGM) cells of 12 Ah in series.

    The open-circuit voltage follows the acid: nearly linear, 11.6 to 12.9 V, until the last per cent. Acid diffuses for
    hours; acid and plates have more resistance when the acid is dilute. 95 % of a charge is stored, and less and less
    near full, where the last lead sulphate is hard to reach and the voltage rises (Linden, chapter 24).
    """
    linear = 1.933 + 0.217 * _SOC - 0.010 * np.sin(np.pi * _SOC)
    cell = Thevenin(
        capacity_Ah=12.0,
        ocv=OcvCurve(tuple(linear - 0.183 * _fall(_SOC, 0.008)), (), tuple(2e-4 * _inside(_SOC, 0.05))),
        r0_discharge_ohm=_low_soc(0.0035, 2.5, 0.15),
        r0_charge_ohm=tuple(np.array(_low_soc(0.0045, 1.0, 0.15)) + _fall(1.0 - _SOC_COARSE, 0.015)),
        r_ohm=(
            _low_soc(0.0015, 1.0, 0.15),
            _low_soc(0.0030, 2.0, 0.15),
            _low_soc(0.0070, 2.5, 0.20),
            _low_soc(0.0150, 2.5, 0.20),
        ),
        tau_s=(4.0, 60.0, 900.0, 7200.0),
        hysteresis_rate=0.0,
        coulombic_efficiency=0.95,
        activation_K=2000.0,
    )
    return SimulatedBattery(
        name="simulated sealed lead-acid 12 V 12 Ah",
        chemistry="lead-acid",
        n_series=6,
        circuit=cell.in_series(6),
        transfer_V=6 * REACTION_V,
        exchange_A=12.0,
        full_width=0.03,
        voltage_min_V=6 * cell.ocv.voltage_V[0],
        voltage_max_V=14.4,
        charge_current_A=4.0,
        heat_capacity_J_per_K=3600.0,
        cooling_W_per_K=0.7,
    )


def nca_18650() -> SimulatedBattery:
    """One nickel-cobalt-aluminium 18650 cell of 2.9 Ah; 25 mohm as in datasheets of such cells at 1 kHz."""
    ocv = np.interp(_SOC, _SOC_NCA, _OCV_NCA) - 0.55 * (_fall(_SOC, 0.02) - _fall(np.ones(1), 0.02))
    circuit = Thevenin(
        capacity_Ah=2.9,
        ocv=OcvCurve(tuple(ocv), tuple(0.004 * _inside(_SOC, 0.05)), tuple(-1e-4 * np.sin(2 * np.pi * _SOC))),
        r0_discharge_ohm=_low_soc(0.025, 0.5, 0.08),
        r0_charge_ohm=_low_soc(0.024, 0.4, 0.08),
        r_ohm=(
            _low_soc(0.004, 1.0, 0.10),
            _low_soc(0.006, 1.5, 0.10),
            _low_soc(0.009, 2.0, 0.10),
            _low_soc(0.012, 2.0, 0.15),
        ),
        tau_s=(2.0, 18.0, 160.0, 1500.0),
        hysteresis_rate=30.0,
        activation_K=3500.0,
    )
    return SimulatedBattery(
        name="simulated NCA 18650 2.9 Ah",
        chemistry="nca",
        n_series=1,
        circuit=circuit,
        transfer_V=REACTION_V,
        exchange_A=5.8,
        full_width=0.0,
        voltage_min_V=circuit.ocv.voltage_V[0],
        voltage_max_V=circuit.ocv.voltage_V[-1],
        charge_current_A=1.4,
        heat_capacity_J_per_K=45.0,
        cooling_W_per_K=0.06,
    )


def scaled(name: str, battery: SimulatedBattery, factor: float, n_series: int = 1) -> SimulatedBattery:
    """A battery of `factor` times the capacity, and `n_series` of it in series: the same cells, larger and more."""
    return replace(
        battery,
        name=name,
        n_series=n_series * battery.n_series,
        circuit=battery.circuit.in_parallel(factor).in_series(n_series),
        transfer_V=n_series * battery.transfer_V,
        exchange_A=factor * battery.exchange_A,
        voltage_min_V=n_series * battery.voltage_min_V,
        voltage_max_V=n_series * battery.voltage_max_V,
        charge_current_A=factor * battery.charge_current_A,
        heat_capacity_J_per_K=factor * n_series * battery.heat_capacity_J_per_K,
        cooling_W_per_K=factor * n_series * battery.cooling_W_per_K,
    )


def lithium_polymer_pack() -> SimulatedBattery:
    """[T] 3.4: ten cells of 8 Ah in series, 37 V; their curve and overpotentials are those of NCA, a layered oxide."""
    cell = nca_18650()
    return scaled("simulated pack of ten 8 Ah cells, 37 V", cell, 8.0 / cell.circuit.capacity_Ah, n_series=10)


def of_battery_file(battery: Battery) -> SimulatedBattery:
    """The battery of a battery file as a plant: its Thevenin model unchanged, without charge transfer as above.

    A battery file does not describe heat, gassing and charger: these are taken from the simulated battery of its
    chemistry, or from NCA where there is none, in proportion to energy or capacity. Where the battery does not gas, its
    limits are the ends of the open-circuit voltage less the hysteresis, so that the SoC stays in [0, 1].
    """
    circuit = battery.thevenin
    like = BATTERIES.get(battery.chemistry, BATTERIES["nca"])
    more_Ah = circuit.capacity_Ah / like.circuit.capacity_Ah
    more_Wh = more_Ah * circuit.ocv.voltage_V[-1] / like.circuit.ocv.voltage_V[-1]
    lowest_V, highest_V = (circuit.ocv.voltage_V[k] for k in (0, -1))
    hysteresis_V = circuit.ocv.hysteresis_V or (0.0, 0.0)
    gases = like.full_width > 0
    return replace(
        like,
        name=battery.name,
        chemistry=battery.chemistry,
        n_series=battery.n_series,
        circuit=circuit,
        transfer_V=0.0,
        voltage_min_V=lowest_V + hysteresis_V[0],
        voltage_max_V=max(highest_V, battery.voltage_max_V) if gases else highest_V - hysteresis_V[-1],
        charge_current_A=more_Ah * like.charge_current_A,
        heat_capacity_J_per_K=more_Wh * like.heat_capacity_J_per_K,
        cooling_W_per_K=more_Wh * like.cooling_W_per_K,
    )


def _lfp_ocv(soc: np.ndarray) -> tuple[float, ...]:
    """Two flat stages and a half, a fall at empty, a rise at full: 2.75 to 3.45 V."""
    plateau = 3.245 + 0.02 * soc + 0.035 * _step(soc, 0.27, 0.03) + 0.040 * _step(soc, 0.68, 0.02)
    return tuple(plateau - 0.495 * _fall(soc, 0.025) + 0.11 * _fall(1.0 - soc, 0.006))


def _step(soc: np.ndarray, at: float, width: float) -> np.ndarray:
    return 1.0 / (1.0 + np.exp((at - soc) / width))


def _fall(distance: np.ndarray, length: float) -> np.ndarray:
    """1 at distance 0, e^-1 at `length`."""
    return np.exp(-distance / length)


def _inside(soc: np.ndarray, length: float) -> np.ndarray:
    """1 in the middle, 0 at both ends."""
    return (1.0 - _fall(soc, length)) * (1.0 - _fall(1.0 - soc, length))


def _low_soc(ohm: float, rise: float, length: float) -> tuple[float, ...]:
    """A resistance that is (1 + rise) times as large at empty."""
    return tuple(ohm * (1.0 + rise * _fall(_SOC_COARSE, length)))


_SOC_NCA = (0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.96, 1.0)
_OCV_NCA = (3.15, 3.28, 3.37, 3.49, 3.56, 3.61, 3.68, 3.79, 3.89, 3.98, 4.06, 4.11, 4.19)

BATTERIES: Mapping[str, SimulatedBattery] = {
    battery.chemistry: battery for battery in (lfp_12V8(), lead_acid_12V(), nca_18650())
}
