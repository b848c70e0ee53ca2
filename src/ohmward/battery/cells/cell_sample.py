"""Input, output and state vector of the filter of one cell beside the typical cell of its pack."""

from __future__ import annotations

from typing import Any, NamedTuple


class Differences(NamedTuple):
    """State vector taken apart.

    common_soc: error of the state of charge of the typical cell, its mean always 0.
    soc: of the cell minus that of the typical one.
    charge_gain: the same of the inverse of the capacity, over that of the battery file.
    ohmic_log, pair_log: ln of the ohmic resistance and of the RC pairs' over the typical cell's.
    curve: difference of the open-circuit voltages at the same state of charge, in its own standard deviations.
    """

    common_soc: Any
    soc: Any
    charge_gain: Any
    ohmic_log: Any
    pair_log: Any
    curve: Any


COMMON, SOC, GAIN, OHMIC, PAIR, CURVE = range(len(Differences._fields))
"""Indices of the state."""


class TypicalCell(NamedTuple):
    """Estimate of the typical cell, as in `SocEstimate`, and its voltage.

    voltage_V: measured, of a pack of such cells.
    """

    soc: Any
    soc_std: Any
    current_offset_A: Any
    soh_capacity: Any
    resistance_ratio: Any
    voltage_V: Any


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
    """Estimate of a cell after a sample.

    soc, soc_std: state of charge of the cell and its standard deviation.
    soc_difference, soc_difference_std: state of charge minus the typical cell's.
    capacity_ratio, capacity_ratio_std: capacity over that of the typical cell.
    resistance_ratio, resistance_ratio_std: resistance over that of the typical cell.
    flags: sum of `SocFlag` values.
    """

    soc: Any
    soc_std: Any
    soc_difference: Any
    soc_difference_std: Any
    capacity_ratio: Any
    capacity_ratio_std: Any
    resistance_ratio: Any
    resistance_ratio_std: Any
    flags: Any
