"""Start values for a battery without any test, by chemistry and capacity, with a noise to match.

The curves are read off published open-circuit curves of such cells and rounded; single cells differ by some 10 mV.
Resistances scale with 1 / capacity. The filter carries the resistance as a state, with a standard deviation of a half,
and finds it; an identified battery is always better.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.models.noise import BatteryNoise
from ohmward.battery.models.ocv import OcvCurve
from ohmward.battery.models.sensor import usual_sensor
from ohmward.battery.models.thevenin import Thevenin
from ohmward.checks import require_one_of, require_positive

#: Points of the uniform SoC grid of an OCV curve made here.
GRID = 201
#: Lowest voltage over that of an empty battery, highest over that of a full one; lead-acid is charged further above it.
_LOWEST, _HIGHEST, _GASSING = 0.9, 1.05, 1.2


@dataclass(frozen=True)
class Chemistry:
    """Properties common to cells of one chemistry.

    Attributes:
        title: in words.
        soc, ocv_V: open-circuit voltage of one cell at 25 degC.
        hysteresis_V: half the distance of charge and discharge branch.
        r0_ohm_Ah, r1_ohm_Ah, r2_ohm_Ah: resistance times capacity.
        tau_s: of both RC pairs.
        coulombic_efficiency: share of the charging current that is stored.
        activation_K: of the resistances (Arrhenius).
    """

    title: str
    soc: tuple[float, ...]
    ocv_V: tuple[float, ...]
    hysteresis_V: float
    r0_ohm_Ah: float
    r1_ohm_Ah: float
    r2_ohm_Ah: float
    tau_s: tuple[float, float]
    coulombic_efficiency: float = 1.0
    activation_K: float = 3000.0

    def ocv(self) -> OcvCurve:
        """The curve on a uniform grid."""
        grid = np.linspace(0.0, 1.0, GRID)
        voltage = np.interp(grid, self.soc, self.ocv_V)
        return OcvCurve(tuple(voltage.tolist()), (self.hysteresis_V,) * GRID)


_TENTHS = (0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
_NMC = (3.00, 3.40, 3.47, 3.56, 3.61, 3.65, 3.70, 3.79, 3.90, 4.00, 4.08, 4.19)
_NCA = (2.90, 3.20, 3.33, 3.47, 3.55, 3.61, 3.68, 3.78, 3.88, 3.97, 4.06, 4.18)
_LCO = (3.00, 3.55, 3.66, 3.72, 3.76, 3.79, 3.83, 3.89, 3.96, 4.03, 4.10, 4.19)
_LFP_SOC = (0.0, 0.01, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.65, 0.7, 0.8, 0.9, 0.96, 0.98, 1.0)
_LFP = (
    2.60, 2.80, 2.95, 3.12, 3.20, 3.22, 3.25, 3.28, 3.290, 3.295, 3.300, 3.31, 3.325, 3.330, 3.335, 3.345, 3.36, 3.50,
)  # fmt: skip

CHEMISTRIES: dict[str, Chemistry] = {
    "nmc": Chemistry("lithium nickel manganese cobalt oxide", _TENTHS, _NMC, 0.005, 0.10, 0.03, 0.04, (20.0, 500.0)),
    "nca": Chemistry("lithium nickel cobalt aluminium oxide", _TENTHS, _NCA, 0.005, 0.10, 0.03, 0.04, (20.0, 500.0)),
    "lipo": Chemistry("lithium polymer (cobalt oxide)", _TENTHS, _LCO, 0.005, 0.06, 0.03, 0.04, (20.0, 500.0)),
    "lfp": Chemistry("lithium iron phosphate", _LFP_SOC, _LFP, 0.010, 0.05, 0.03, 0.10, (20.0, 1500.0)),
    "lead-acid": Chemistry(
        "sealed lead-acid (AGM, gel)", (0.0, 1.0), (1.94, 2.14), 0.01, 0.06, 0.05, 0.10, (60.0, 3000.0), 0.95, 1500.0
    ),
}


def chemistry(name: str) -> Chemistry:
    """The chemistry called `name`; InputError lists what there is."""
    require_one_of("chemistry", name, CHEMISTRIES)
    return CHEMISTRIES[name]


def start_model(name: str, capacity_Ah: float, n_series: int = 1, ocv: OcvCurve | None = None) -> Thevenin:
    """A Thevenin model with two RC pairs for a pack of `n_series` cells of this chemistry and capacity.

    ocv: open-circuit voltage of one cell where it is known; by default the chemistry's.
    """
    require_positive("capacity_Ah", capacity_Ah)
    c = chemistry(name)

    def flat(ohm_Ah: float) -> tuple[float, float]:
        return (ohm_Ah / capacity_Ah,) * 2

    cell = Thevenin(
        capacity_Ah,
        ocv or c.ocv(),
        flat(c.r0_ohm_Ah),
        flat(c.r0_ohm_Ah),
        (flat(c.r1_ohm_Ah), flat(c.r2_ohm_Ah)),
        c.tau_s,
        coulombic_efficiency=c.coulombic_efficiency,
        activation_K=c.activation_K,
    )
    return cell.in_series(n_series)


def generic_battery(name: str, capacity_Ah: float, n_series: int = 1, label: str = "") -> Battery:
    """Battery of a chemistry and capacity without any test, and with the noise that follows.

    label: its name; by default "generic" and the chemistry.
    """
    c, model = chemistry(name), start_model(name, capacity_Ah, n_series)
    curve_V = model.ocv.voltage_V
    return Battery(
        name=label or f"generic {name}",
        capacity_Ah=capacity_Ah,
        chemistry=name,
        n_series=n_series,
        voltage_min_V=_LOWEST * curve_V[0],
        voltage_max_V=(_GASSING if name == "lead-acid" else _HIGHEST) * curve_V[-1],
        thevenin=model,
        noise=start_noise(n_series),
        sensor=usual_sensor(capacity_Ah),
        not_identified=(
            f"everything: these are start values that cells of {c.title} have in common",
            "capacity: as given, taken as right within 5 %",
            "resistances: taken as right within 50 %; the filter carries them as a state",
        ),
    )


def start_noise(n_series: int = 1, ocv_known: bool = False) -> BatteryNoise:
    """Noise of a battery without a test; `ocv_known` where its OCV curve was measured."""
    curve_V = 0.008 if ocv_known else 0.030
    return BatteryNoise(
        voltage_std_V=0.005 * n_series,
        model_std_V=(curve_V * n_series,) * 2,
        model_soc_length=0.1 if ocv_known else 0.3,
        overpotential_share=0.15,
        soc_axis_std=0.01 if ocv_known else 0.03,
        capacity_std=0.05,
        resistance_std=0.5,
    )
