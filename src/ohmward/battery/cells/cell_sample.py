"""Input, output and state vector of the filter of one cell beside the typical cell of its pack."""

from __future__ import annotations

from typing import Any, NamedTuple


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
