"""Start values for a battery without any test, by chemistry and capacity, with a noise to match.

The curves are read off published open-circuit curves of such cells and rounded; single cells differ by some 10 mV.
Resistances scale with 1 / capacity. The filter carries them as states known to within a factor of two, and estimates
them; an identified battery is always better.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.models.noise import BatteryNoise, usual_sensor
from ohmward.battery.models.ocv import OCV_GRID, OCV_POINTS, OcvCurve
from ohmward.battery.models.thevenin import Thevenin
from ohmward.checks import require_one_of, require_positive
from ohmward.errors import InputError
from ohmward.filters.consistency import BAND_95

#: Standard deviations for a label: relative, of the capacity, of which batteries some years old have lost 10 to 30 %;
#: of the logarithm of the resistances, which were 0.3 to 3.6 times the label's on ten measured cells and packs.
_LABEL_CAPACITY_STD = 0.1
_LABEL_RESISTANCE_STD = 0.8
#: Voltage of a lithium-ion cell [V].
CELL_V = 3.7
#: Standard deviation of a lithium charger's limit, over the voltage of a full cell: 4.1 V a cell as well as 4.2.
_CHARGER_SHARE = 0.012
#: Voltage above which a battery gases, relative to a full one at rest: about 2.23 V for a lead-acid cell.
_GASSING_SHARE = 1.03
#: Distance of a curve from that of a chemistry, in standard deviations of its cells, beyond which the chemistry is
#: another one: NMC, NCA and LCO are up to 4 apart, LFP is 10 from them.
_OTHER_CHEMISTRY = 5.0
#: Lowest voltage relative to an empty battery, and highest relative to a full one; the last for batteries that gas.
_LOWEST, _HIGHEST, _GASSING = 0.9, 1.05, 1.2


class Normal(NamedTuple):
    """Mean and standard deviation of a normal distribution."""

    mean: float
    std: float

    @property
    def relative_std(self) -> float:
        """Standard deviation over the mean."""
        return self.std / self.mean


class CurvePrior(NamedTuple):
    """Distribution over cells of the difference between their open-circuit voltage and the curve of their chemistry."""

    std_V: tuple[float, ...]  #: (M,) of one cell, on a uniform grid of SoC from 0 to 1
    soc_std: float = 0.03  #: error of the SoC axis, which shifts the steep parts of the curve
    soc_length: float = 1.0  #: correlation length of the difference, as a change of SoC
    middle_soc_std: float = 0.0  #: error of the SoC axis that is largest in the middle, full and empty being known
    line_std_V: Any = 0.0  #: (K,) error of a straight line beyond its logs, for the whole battery, on OCV_KNOTS


class HysteresisPrior(NamedTuple):
    """Distribution over cells of the hysteresis: its share of the low-rate gap, and its rate gamma, log-normal."""

    #: the low-rate gap includes slow overpotential as well
    share: Normal = Normal(0.5, 0.2)
    rate: float = 40.0
    rate_log_std: float = 0.7


class ChemistryPrior(NamedTuple):
    """Distribution over cells of the values that a test may leave open, and circuit errors of such cells.

    The prior regularises an identification where data are thin, and so gives honest covariances. Its voltages are for a
    cell of CELL_V and are scaled, so that a pack or a lead-acid battery needs no other numbers.
    """

    activation_K: Normal  #: activation temperature of the ohmic resistance, from edges of the current within a second
    #: activation temperature of the RC resistances, and of the time constants
    pair_activation_K: Normal
    tau_activation_K: Normal
    activation_std_K: float  #: error common to all of them: of the total resistance
    ocv_std_V_per_K: float  #: change of the open-circuit voltage with temperature, about 0, per CELL_V of the battery
    curve: CurvePrior  #: deviation of the open-circuit voltage from the chemistry's [V] per cell, between the ends
    hysteresis_V: float  #: typical half distance of the branches, per CELL_V
    #: activation temperature of the RC pairs at empty, in addition to pair_activation_K
    empty_activation_K: Normal = Normal(0.0, 8000.0)
    #: share of a capacity loss by which the electrodes shift against each other: if positive, the full end of the curve
    #: stays, if negative, the empty end
    ocv_slip: Normal = Normal(0.0, 0.5)
    hysteresis_activation_K: float = 0.0  #: activation temperature of the hysteresis, where that follows the net charge
    #: SoC that a warm load leaves at the cut-off for each C of its rate: of six cells of porous electrodes 0.002 to
    #: 0.045 at C/3 and 0.006 to 0.15 at 1 C
    left_per_C: Normal = Normal(0.04, 0.06)
    #: correlation of capacity loss and resistance growth by ageing, for a given capacity and for one measured from full
    #: to empty at a low rate: an unchanged resistance then gives the capacity to within 7 and 4 %
    ageing_correlation: tuple[float, float] = (0.7, 0.9)

    walk_share: float = 0.25  #: random walk of a resistance over 0.1 of SoC, as a share of its level
    #: random walk of a resistance over 0.1 of SoC, as a share of its level, where rests gave the curve
    walk_share_from_rests: float | None = None
    direction_share: float = 0.1  #: difference between r0 in charge and discharge, as a share
    slow_tau_s: float = 700.0  #: median of the slowest of several time constants (log-normal)
    slow_tau_log_std: float = 0.6  #: standard deviation of its logarithm
    #: hysteresis as a share of the low-rate gap, and its rate over the moved charge
    hysteresis: HysteresisPrior = HysteresisPrior()
    #: the same where the circuit is also fitted to a low-rate discharge and charge
    hysteresis_on_branches: HysteresisPrior | None = None
    #: error of a curve that is given or from low-rate tests [V]
    measured_curve: CurvePrior = CurvePrior((0.004,) * 2, 0.01, 0.05)
    rested_curve: CurvePrior = CurvePrior((0.010,) * 2, 0.02, 0.05)  #: error of a curve through rests [V]
    #: error of a measured curve on a battery that the circuit was not fitted to [V]; its level has that error in
    #: addition
    unfitted_curve: CurvePrior = CurvePrior((0.008,) * 2, 0.01, 0.1)
    discharging_factor: float = 1.0  #: model error in a discharge, over that of a lithium-ion cell
    charging_factor: float = 1.0  #: the same in a charge and the rest after it
    gassing_factor: float = 1.0  #: the same while part of the charge makes gas
    gassing_soc: float = 0.85  #: SoC above which it does
    rest_V: float = 0.002  #: standard deviation of each RC voltage at the start of a record that starts at rest
    start_V: float = 0.03  #: the same for any other record
    model_V: float = 0.003  #: smallest model error at any SoC, however good the fit
    #: the same where no low-rate test has shown the curve: the residual of a drive is the best case
    unmeasured_model_V: float | None = None
    #: the same where there are only short pulses, which show only the start of slow processes; less where the test
    #: predicts itself better
    pulses_V: float = 0.008
    model_soc_length: float = 0.1  #: correlation length of the model error, as a change of SoC
    seeks_transfer: bool = True  #: fit the charge transfer in the ohmic drop, from tests at two temperatures

    @property
    def activations_K(self) -> tuple[Normal, Normal, Normal]:
        """Activations of the ohmic resistance, of the RC resistances and of the time constants."""
        return self.activation_K, self.pair_activation_K, self.tau_activation_K


#: RMS difference between published open-circuit curves of cells and the curve here, at every tenth of SoC, times 1.2 to
#: 1.4, the factor by which so few cells may underestimate it (quantile of Student's t over that of a normal
#: distribution). Six NCA and LCO cells: Panasonic PF, two of Samsung, NCA_Kim2011, Ramadass2004, Ai2020.
_NCA_CURVE = CurvePrior((0.20, 0.08, 0.06, 0.05, 0.04, 0.04, 0.04, 0.04, 0.04, 0.02, 0.015))
#: The same for eleven cells labelled NMC: LG M50 in three versions, Molicel P42A, NMC111 pouch of About:Energy,
#: Mohtat2020, Samsung 20R, two of TU Eindhoven, and the blends with LMO of two cars, which lie 0.1 to 0.19 V higher.
_NMC_CURVE = CurvePrior((0.35, 0.17, 0.125, 0.11, 0.10, 0.095, 0.08, 0.07, 0.05, 0.02, 0.015))
#: The same for seven LFP cells: two kinds of A123 and that of Safari and Delacourt 2011, Lithium Werks 18650, 18650 of
#: About:Energy, one of TU Eindhoven (its plateau 55 mV higher), Prada2013 (20 to 80 mV lower). They pass 3.1 V at 3 to
#: 15 % SoC, the curve here at 5 %; the errors at that knee and on the plateau are hardly correlated.
_LFP_CURVE = CurvePrior((0.25, 0.12, 0.06, 0.05, 0.04, 0.04, 0.04, 0.04, 0.04, 0.04, 0.04), 0.05, 0.5)

#: Lithium-ion cells. Fitted from -15 to 45 degC: A123 LFP 2500 and 3100 to 4000 K (ohmic and pairs), Panasonic NCA 2700
#: and 3100 to 4800, an NMC cell of TU Eindhoven 2800 and 2600, the pack of an i3 3100 in all; time constants 1600 to
#: 3400. Conduction in electrolytes has about 2000 K, charge transfer 6000 to 8000 (Jow et al., J. Electrochem. Soc.
#: 2012), so activations grow towards the cold: 1200 K between 25 and 45, 4300 between 5 and -15 degC. The OCV of the
#: NMC cell changes by 0.17 mV/K (rms along SoC), that of the LFP cell by 0.10.
_LITHIUM = ChemistryPrior(
    Normal(2700.0, 900.0), Normal(3700.0, 1200.0), Normal(1800.0, 1200.0), 1000.0, 2e-4, _NCA_CURVE, 0.003
)
#: The OCV of a full cell with cobalt oxide changes by 0.1 to 0.7 mV/K (Ai et al., J. Electrochem. Soc. 2020, measured);
#: their cell slips by 0.3 of the loss where two thirds of it are lithium, otherwise by -0.34 to 0.6. Lithium polymer is
#: a pouch, and what is in it may be any oxide with cobalt: its curve is as uncertain as that of NMC.
_COBALT = _LITHIUM._replace(ocv_std_V_per_K=3.5e-4, curve=_NMC_CURVE, ocv_slip=Normal(0.3, 0.4))
#: Ageing makes one LFP cell slip by 0.64 +- 0.19 of the loss, and its empty end stays.
#: In fits of an A123 cell from 45 to -15 degC the activation of the hysteresis is 1500 K, of its gap at C/30 1800 K.
#: On the plateau hysteresis and a slow overpotential look alike in a drive that discharges: the residual is the same
#: with either, and only a charge separates them. So the prior fixes their split, and the noise has its width. Half the
#: gap of an A123 cell at C/30 is 17 mV at 25, 25 at 5 and 50 at -15 degC: 12 mV and a resistance. Low-rate branches
#: have another current, which separates the two: then 0.71 to 0.87 of the gap at -15 to 45 degC is hysteresis, which
#: reverses over 2/17 of the charge. A pair of a few hundred seconds fits a drive as well as a slow one, and then fails
#: elsewhere.
#: Models of two LFP cells err by 6 to 17 mV (mean over 10 min) on other records, and by up to 4 mV on their own.
#: Between two rests, a resistance that is free to walk absorbs the shape of the curve. From pulses at 25 degC, four
#: simulated cells: RMSE 1.3 % with a walk of 0.25, 0.8 % with half of it.
_IRON_PHOSPHATE = _LITHIUM._replace(
    ocv_std_V_per_K=1.2e-4,
    curve=_LFP_CURVE,
    hysteresis_V=0.01,
    ocv_slip=Normal(-0.6, 0.25),
    hysteresis_activation_K=1500.0,
    walk_share_from_rests=0.12,
    slow_tau_s=2200.0,
    slow_tau_log_std=0.3,
    hysteresis=HysteresisPrior(Normal(0.4, 0.05), 15.0, 0.5),
    hysteresis_on_branches=HysteresisPrior(Normal(0.8, 0.15), 18.0, 0.3),
    unfitted_curve=CurvePrior((0.012,) * 2, 0.01, 0.1),
    model_V=0.004,
    unmeasured_model_V=0.008,
)
#: Two thirds of a loss are lithium (60 to 80 % in cars), the rest material of both electrodes: half-cell curves of four
#: NMC cells then slip by 0.44 of it; by 0.65 with lithium alone, by -0.24 to 0.77 with lithium and one electrode.
_NICKEL_MANGANESE_COBALT = _LITHIUM._replace(curve=_NMC_CURVE, ocv_slip=Normal(0.45, 0.35))
#: Activation at empty from pulses of a Panasonic NCA cell at -10 to 25 degC: transfer of lithium into a nearly full
#: layered oxide. Slip of a cell whose positive electrode ends the discharge: -0.18 +- 0.27, and as much again in
#: another shape.
_NICKEL_COBALT_ALUMINIUM = _LITHIUM._replace(empty_activation_K=Normal(11000.0, 8000.0), ocv_slip=Normal(0.0, 0.6))
#: Lithium titanate stays at 1.55 V against lithium, so that a cell follows its positive electrode: mostly NMC, as here,
#: or manganese oxide, whose cells lie 0.1 V higher in the middle. No cell was measured here.
_TITANATE = _LITHIUM._replace(curve=CurvePrior((0.3, 0.12, *(0.09,) * 7, 0.06, 0.05), 0.05), ocv_slip=Normal(0.0, 0.5))
#: Hard carbon against a layered oxide, as in the first cells on the market, 1.5 to 3.95 V; a cell with a vanadium
#: fluorophosphate (Chayambuka et al., Electrochimica Acta 404, 139764, 2022) is 0.35 to 0.85 V higher. No cell was
#: measured here: a test is worth more than with any other chemistry.
_SODIUM = _LITHIUM._replace(
    activation_K=Normal(2700.0, 1200.0),
    curve=CurvePrior((0.6, 0.5, *(0.45,) * 6, 0.35, 0.25, 0.15), 0.05),
    hysteresis_V=0.01,
)
#: Rested voltages after charge and discharge differ by some 50 mV over most of the charge (Verbrugge and Tate, J. Power
#: Sources 126, 236, 2004); the electrolyte is alkaline water, and a cell's OCV changes by some 0.4 mV/K. No cell was
#: measured here: rests are taken to show its flat curve as well as that of an LFP cell, to within 7 mV.
_NICKEL = ChemistryPrior(
    Normal(1500.0, 1000.0),
    Normal(2500.0, 1500.0),
    Normal(1500.0, 1500.0),
    1200.0,
    1.2e-3,
    CurvePrior((0.12, 0.04, *(0.025,) * 7, 0.03, 0.04), 0.05, 0.5),
    0.07,
    ageing_correlation=(0.0, 0.0),
    unfitted_curve=CurvePrior((0.015,) * 2, 0.03, 0.3),
    charging_factor=6.0,
    gassing_factor=100.0,
    unmeasured_model_V=0.02,
)
#: Near full a growing part of the charging current makes oxygen instead.
_NICKEL_EFFICIENCY = 0.95
#: Conduction in acid has about 1500 K; a 2 V cell changes by 0.2 mV/K (Bode, Lead-Acid Batteries, 1977). Acid diffuses
#: for hours, which is worth a tenth of the charge in a day of work.
#: Charging is a different reaction from discharging and makes gas near full; no two discharges are quite alike. The
#: curve has no phases, so an error of it extends over half of the charge: with a correlation length of 0.1 it would
#: average out in one discharge, and the band would cover 80 % of the true values instead of 98.
_LEAD_ACID = ChemistryPrior(
    Normal(1500.0, 700.0),
    Normal(2000.0, 1000.0),
    Normal(1000.0, 1000.0),
    800.0,
    3.7e-4,
    CurvePrior((0.027,) * 2, soc_length=0.5),
    0.0,
    # acid and sulphate change the resistances more than age does
    ageing_correlation=(0.0, 0.0),
    direction_share=1.0,
    left_per_C=Normal(1.0, 1.0),
    slow_tau_s=7200.0,
    slow_tau_log_std=0.3,
    measured_curve=CurvePrior((0.020,) * 2, 0.03, 0.3),
    rested_curve=CurvePrior((0.020,) * 2, 0.03, 0.3),
    unfitted_curve=CurvePrior((0.020,) * 2, 0.03, 0.3),
    discharging_factor=2.0,
    charging_factor=6.0,
    gassing_factor=100.0,
    model_V=0.005,
    pulses_V=0.005,
    model_soc_length=0.5,
    seeks_transfer=False,
)
#: Measured from full to full, a sealed battery stores 93 % of what a charger delivers, most of the loss being gas near
#: full; in the middle it stores more, and all of it in a model of porous electrodes without gas.
_LEAD_ACID_EFFICIENCY = 0.97
#: A battery of unknown chemistry: all of the above are within one standard deviation or two.
_UNNAMED = ChemistryPrior(
    Normal(2500.0, 1300.0),
    Normal(3200.0, 1600.0),
    Normal(1500.0, 1500.0),
    1500.0,
    3e-4,
    CurvePrior((0.1,) * 2, soc_length=0.5),
    0.005,
)


@dataclass(frozen=True)
class Chemistry:
    """Properties common to cells of one chemistry."""

    title: str  #: in words
    #: open-circuit voltage of one cell at 25 degC
    soc: tuple[float, ...]
    ocv_V: tuple[float, ...]
    hysteresis_V: float  #: half the distance between charge and discharge branch
    #: resistance times capacity
    r0_ohm_Ah: float
    r1_ohm_Ah: float
    r2_ohm_Ah: float
    tau_s: tuple[float, float]  #: of both RC pairs
    coulombic_efficiency: float = 1.0  #: share of the charging current that is stored
    prior: ChemistryPrior = _LITHIUM  #: for what a test may leave open
    #: True where part of a charge makes gas near full, so that the voltage of a charge is not that of the cell
    gases: bool = False
    #: True where charge transfer, which makes the ohmic drop nonlinear, may dominate it at room temperature
    charge_transfer: bool = False

    def gassing_V(self, ocv: OcvCurve) -> float | None:
        """Terminal voltage above which part of a charge makes gas [V]; None where none does."""
        return _GASSING_SHARE * ocv.voltage_V[-1] if self.gases else None

    @property
    def full_soc_std(self) -> float:
        """Error of the SoC of a full battery, as the limit of its charger is not known; gas defines that limit."""
        lower_soc = float(self.ocv().soc_at((1.0 - _CHARGER_SHARE) * self.ocv_V[-1]))
        return 0.0 if self.gases else round(1.0 - lower_soc, 3)

    def ocv(self) -> OcvCurve:
        """The curve on a uniform grid."""
        voltage = np.interp(OCV_GRID, self.soc, self.ocv_V)
        return OcvCurve(tuple(voltage.tolist()), (self.hysteresis_V,) * OCV_POINTS)


_TENTHS = (0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
_NMC = (3.00, 3.42, 3.50, 3.60, 3.65, 3.69, 3.74, 3.83, 3.93, 4.02, 4.09, 4.19)
_NCA = (2.90, 3.20, 3.33, 3.47, 3.55, 3.61, 3.68, 3.78, 3.88, 3.97, 4.06, 4.18)
_LCO = (3.00, 3.55, 3.66, 3.72, 3.76, 3.79, 3.83, 3.89, 3.96, 4.03, 4.10, 4.19)
_LFP_SOC = (0.0, 0.01, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.65, 0.7, 0.8, 0.9, 0.96, 0.98, 1.0)
_LFP = (
    2.60, 2.80, 2.95, 3.12, 3.20, 3.22, 3.25, 3.28, 3.290, 3.295, 3.300, 3.31, 3.325, 3.330, 3.335, 3.345, 3.36, 3.50,
)  # fmt: skip

_LTO = (1.75, 2.02, 2.10, 2.18, 2.22, 2.26, 2.31, 2.39, 2.48, 2.56, 2.63, 2.72)
_SODIUM_ION = (1.60, 2.30, 2.48, 2.69, 2.83, 2.94, 3.05, 3.17, 3.30, 3.45, 3.64, 3.90)
_NIMH = (1.00, 1.215, 1.240, 1.262, 1.275, 1.285, 1.295, 1.303, 1.312, 1.325, 1.345, 1.40)

CHEMISTRIES: dict[str, Chemistry] = {
    "nmc": Chemistry(
        "lithium nickel manganese cobalt oxide",
        _TENTHS,
        _NMC,
        0.005,
        0.10,
        0.03,
        0.04,
        (20.0, 500.0),
        prior=_NICKEL_MANGANESE_COBALT,
    ),
    "nca": Chemistry(
        "lithium nickel cobalt aluminium oxide",
        _TENTHS,
        _NCA,
        0.005,
        0.10,
        0.03,
        0.04,
        (20.0, 500.0),
        prior=_NICKEL_COBALT_ALUMINIUM,
    ),
    "lipo": Chemistry(
        "lithium polymer (cobalt oxide)", _TENTHS, _LCO, 0.005, 0.06, 0.03, 0.04, (20.0, 500.0), prior=_COBALT
    ),
    "lfp": Chemistry(
        "lithium iron phosphate", _LFP_SOC, _LFP, 0.010, 0.05, 0.03, 0.10, (20.0, 1500.0), 1.0, _IRON_PHOSPHATE
    ),
    "lead-acid": Chemistry(
        "sealed lead-acid (AGM, gel)",
        (0.0, 0.1, 0.5, 1.0),
        (1.88, 1.93, 2.04, 2.165),
        0.01,
        0.06,
        0.05,
        0.10,
        (60.0, 3000.0),
        _LEAD_ACID_EFFICIENCY,
        _LEAD_ACID,
        gases=True,
        charge_transfer=True,
    ),
    "lto": Chemistry(
        "lithium titanate against lithium nickel manganese cobalt oxide",
        _TENTHS,
        _LTO,
        0.003,
        0.03,
        0.015,
        0.02,
        (20.0, 500.0),
        prior=_TITANATE,
    ),
    "sodium-ion": Chemistry(
        "sodium-ion (layered oxide and hard carbon)",
        _TENTHS,
        _SODIUM_ION,
        0.01,
        0.06,
        0.03,
        0.05,
        (20.0, 500.0),
        prior=_SODIUM,
    ),
    "nimh": Chemistry(
        "nickel metal hydride",
        _TENTHS,
        _NIMH,
        0.025,
        0.05,
        0.02,
        0.04,
        (30.0, 1500.0),
        _NICKEL_EFFICIENCY,
        _NICKEL,
        gases=True,
    ),
}

#: Other names of the chemistries, on labels and in shops. A cell labelled only lithium-ion may be any of those with
#: cobalt, and the band of NMC is the widest.
_OTHER_NAMES = {
    "lfp": ("lifepo4", "life", "lifepo", "lithium-iron-phosphate"),
    "nmc": ("ncm", "linimncoo2", "li-ion", "liion", "lithium-ion", "lion"),
    "nca": ("lincao2",),
    "lipo": ("li-po", "li-poly", "lithium-polymer", "lco", "licoo2"),
    "lead-acid": ("lead", "pb", "agm", "sla", "vrla", "gel"),
    "lto": ("lithium-titanate", "li4ti5o12"),
    "sodium-ion": ("na-ion", "sodium", "sib"),
    "nimh": ("ni-mh", "nickel-metal-hydride"),
}
_NAMES = {other: name for name, others in _OTHER_NAMES.items() for other in (name, *others)}


def chemistry_name(name: str) -> str:
    """Name of a chemistry as used here: "lfp" for "LiFePO4", "lead-acid" for "AGM"; "" stays, for an unknown one.

    Raises:
        InputError: there is no such chemistry; the message lists those that exist.
    """
    if not name:
        return ""
    if not isinstance(name, str):
        raise InputError(f"chemistry must be the name of one, {', '.join(CHEMISTRIES)}, got {name!r:.80}")
    words = name.lower().replace("_", " ").replace("-", " ").split()
    known = _NAMES.get("-".join(words))
    if known is None:
        raise InputError(f"chemistry must be one of {', '.join(CHEMISTRIES)}, got {name!r}")
    return known


def chemistry(name: str) -> Chemistry:
    """The chemistry called `name`, by any of its names; InputError lists those that exist."""
    name = chemistry_name(name)
    require_one_of("chemistry", name, CHEMISTRIES)
    return CHEMISTRIES[name]


def chemistry_prior(name: str) -> ChemistryPrior:
    """Prior of the chemistry called `name`; a wide one for "", a battery of unknown chemistry."""
    return chemistry(name).prior if name else _UNNAMED


def start_model(name: str, capacity_Ah: float, n_series: int = 1, ocv: OcvCurve | None = None) -> Thevenin:
    """A Thevenin model with two RC pairs for a pack of `n_series` cells of this chemistry and capacity.

    ocv: open-circuit voltage of one cell where it is known; by default the chemistry's.
    """
    require_positive("capacity_Ah", capacity_Ah)
    c = chemistry(name)

    def flat(ohm_Ah: float) -> tuple[float, float]:
        return (ohm_Ah / capacity_Ah,) * 2

    curve = ocv or c.ocv()
    cell = Thevenin(
        capacity_Ah,
        curve,
        flat(c.r0_ohm_Ah),
        flat(c.r0_ohm_Ah),
        (flat(c.r1_ohm_Ah), flat(c.r2_ohm_Ah)),
        c.tau_s,
        coulombic_efficiency=c.coulombic_efficiency,
        activation_K=c.prior.activation_K.mean,
        pair_activation_K=c.prior.pair_activation_K.mean,
        tau_activation_K=c.prior.tau_activation_K.mean,
        empty_activation_K=c.prior.empty_activation_K.mean,
        gassing_V=c.gassing_V(curve),
        ocv_slip=c.prior.ocv_slip.mean,
    )
    return cell.in_series(n_series)


def generic_battery(name: str, capacity_Ah: float, n_series: int = 1, label: str = "") -> Battery:
    """Battery of a chemistry and capacity without any test, with noise to match.

    >>> battery = ow.generic_battery("lfp", capacity_Ah=20, n_series=8)
    >>> battery.voltage_max_V
    29.4...

    label: its name; by default "generic" and the chemistry.
    """
    name = chemistry_name(name)
    c, model = chemistry(name), start_model(name, capacity_Ah, n_series)
    curve_V = model.ocv.voltage_V
    return Battery(
        name=label or f"generic {name}",
        capacity_Ah=capacity_Ah,
        chemistry=name,
        n_series=n_series,
        voltage_min_V=_LOWEST * curve_V[0],
        voltage_max_V=(_GASSING if c.gases else _HIGHEST) * curve_V[-1],
        thevenin=model,
        noise=start_noise(name, n_series),
        sensor=usual_sensor(capacity_Ah),
        not_identified=(
            f"everything: these are start values that cells of {c.title} have in common",
            assumed_capacity("as given"),
            f"resistances: assumed to be right within a factor of {np.exp(BAND_95 * _LABEL_RESISTANCE_STD):.1f} "
            "(95 %); the filter carries them as states",
        ),
    )


def assumed_capacity(origin: str) -> str:
    """Sentence on a capacity that no test has shown; origin: where it is from."""
    return f"capacity: {origin}, assumed to be right within ± {BAND_95 * _LABEL_CAPACITY_STD:.0%} (95 %)"


def curve_misfit(name: str, voltage_V: Sequence[float]) -> float:
    """Distance of a cell's curve from that of a chemistry, between 10 and 90 % of charge: RMS over its std.

    voltage_V: (M,) [V] of one cell on a uniform grid of SoC from 0 to 1.
    """
    soc, c = np.linspace(0.1, 0.9, OCV_POINTS), chemistry(name)
    std_V = c.prior.curve.std_V
    given_V = np.interp(soc, np.linspace(0.0, 1.0, len(voltage_V)), voltage_V)
    usual_V = np.interp(soc, c.soc, c.ocv_V)
    usual_std_V = np.interp(soc, np.linspace(0.0, 1.0, len(std_V)), std_V)
    return float(np.sqrt(np.mean(((given_V - usual_V) / usual_std_V) ** 2)))


def chemistry_contradiction(name: str, voltage_V: Sequence[float]) -> str:
    """Clause on the curve of a cell that is none of the chemistry, with those that it fits; "" if it may be one.

    name: "" if unknown; voltage_V: (M,) [V] of one cell on a uniform grid of SoC from 0 to 1.
    """
    misfits = {each: curve_misfit(each, voltage_V) for each in CHEMISTRIES}
    if not misfits.get(name, 0.0) > _OTHER_CHEMISTRY:
        return ""
    fitting = sorted((each for each, misfit in misfits.items() if misfit <= _OTHER_CHEMISTRY), key=misfits.__getitem__)
    advice = f"; the curve fits {' or '.join(fitting)}" if fitting else ""
    deviations = f"{misfits[name]:.0f} of their standard deviations"
    return f"differs from that of {name} cells by {deviations}; correct the chemistry{advice}"


def start_noise(name: str = "", n_series: int = 1, ocv_known: bool = False) -> BatteryNoise:
    """Noise of a battery of the chemistry `name` without a test; `ocv_known` where its OCV curve was measured."""
    prior, cell_V = chemistry_prior(name), float(np.mean(chemistry(name).ocv_V)) if name else CELL_V
    curve = prior.unfitted_curve if ocv_known else prior.curve
    return BatteryNoise(
        voltage_std_V=0.005 * n_series,
        model_std_V=tuple(n_series * std_V for std_V in curve.std_V),
        model_soc_length=curve.soc_length,
        overpotential_share=0.15,
        level_std_V=n_series * max(curve.std_V) if ocv_known else 0.0,
        soc_axis_std=curve.soc_std,
        full_soc_std=chemistry(name).full_soc_std if name and not ocv_known else 0.0,
        capacity_std=_LABEL_CAPACITY_STD,
        resistance_std=_LABEL_RESISTANCE_STD,
        activation_std_K=prior.activation_std_K,
        empty_activation_std_K=prior.empty_activation_K.std,
        ocv_std_V_per_K=prior.ocv_std_V_per_K * n_series * cell_V / CELL_V,
        ocv_slip_std=prior.ocv_slip.std,
    )
