"""Differences between the cells of one pack, before a voltage of theirs was seen."""

from __future__ import annotations

from dataclasses import dataclass

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
