"""Input, output and state vector of the filter of one cell beside the typical cell of its pack."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

from ohmward.battery.models.noise import walk_variance
from ohmward.checks import require_each_not_negative
from ohmward.trace.expression import Scalar

DAY_S = 86400.0


@dataclass(frozen=True)
class CellSpread:
    """Standard deviations of one cell about the typical one of its pack. All voltages are of one cell.

    New cells of one batch differ by 0.5 to 2 % in capacity and by 1 to 6 % in resistance (Dubarry et al. 2010, J. Power
    Sources 195, 7117; Rumpf et al. 2017, J. Energy Storage 14, 224). Aged ones differ by 2 to 6 and by 5 to 20 %, with
    a few far below the others (Baumhofer et al. 2014, J. Power Sources 247, 332); these are what a pack is watched for.
    """

    soc_std: float = 0.05  #: of the state of charge, where nothing balances the cells
    capacity_std: float = 0.1  #: relative, of the capacity
    resistance_std: float = 0.3  #: of the logarithm of the resistance
    #: of the open-circuit voltage at the same state of charge, and of the channels that measure it
    curve_std_V: float = 0.003
    soc_axis_std: float = 0.005  #: of the SoC axis of that curve
    #: relative error of the overpotential beyond a common factor of the cell: a pack is not equally warm everywhere
    overpotential_share: float = 0.05
    voltage_std_V: float = 0.002  #: white noise of a cell's channel
    soc_walk: float = 0.002  #: random walk of the state of charge in a day, by leakage and by balancing
    efficiency_std: float = 0.01  #: the same for each full charge that flows

    def __post_init__(self) -> None:
        require_each_not_negative("spread.", self, *self.__dataclass_fields__)

    def soc_walk_variance(self, dt_s: Scalar) -> Scalar:
        """Process variance of the state of charge of one cell in one step."""
        return walk_variance(self.soc_walk, DAY_S, dt_s)


class Differences(NamedTuple):
    """State vector taken apart."""

    common_soc: Any  #: error of the state of charge of the typical cell, its mean always 0
    soc: Any  #: of the cell minus that of the typical one
    charge_gain: Any  #: the same of the inverse of the capacity, over that of the battery file
    #: ln of the ohmic resistance and of the RC pairs' over the typical cell's
    ohmic_log: Any
    pair_log: Any
    curve: Any  #: difference of the open-circuit voltages at the same state of charge, in its own standard deviations


COMMON, SOC, GAIN, OHMIC, PAIR, CURVE = range(len(Differences._fields))
"""Indices of the state."""


class TypicalCell(NamedTuple):
    """Estimate of the typical cell, as in `SocEstimate`, and its voltage."""

    soc: Any
    soc_std: Any
    current_offset_A: Any
    soh_capacity: Any
    resistance_ratio: Any
    voltage_V: Any  #: measured, of a pack of such cells


class CellSample(NamedTuple):
    """One sample of a cell.

    dt_s, current_A, temperature_degC: as in `SocSample`.
    voltage_V: measured, of a pack of such cells; nan where there is none.
    typical: estimate of the typical cell after this sample.
    """

    dt_s: Any
    current_A: Any
    voltage_V: Any
    temperature_degC: Any
    typical: TypicalCell


class CellEstimate(NamedTuple):
    """Estimate of a cell after a sample."""

    soc: Any  #: state of charge of the cell and its standard deviation
    soc_std: Any  #: its standard deviation
    soc_difference: Any  #: state of charge minus the typical cell's
    soc_difference_std: Any  #: its standard deviation
    capacity_ratio: Any  #: capacity over that of the typical cell
    capacity_ratio_std: Any  #: its standard deviation
    resistance_ratio: Any  #: resistance over that of the typical cell
    resistance_ratio_std: Any  #: its standard deviation
    flags: Any  #: sum of `SocFlag` values
