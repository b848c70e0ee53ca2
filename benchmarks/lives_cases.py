"""Lives of the simulated half of the table: a base case for each test, and what is changed about it.

[K] P. Kollmeyer et al., A blind modeling tool for standardized evaluation of battery state of charge estimation
algorithms, IEEE Transportation Electrification Conference, 2022.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from lives_cells import (
    DAYS_AFTER,
    EVERYDAY,
    LABEL,
    PULSES,
    PULSES_SLOW,
    TWO_TEMPERATURES,
    Life,
    LifeCell,
    battery_from,
    make_sensors,
    measured,
    truth_of_life,
)
from lives_table import METHODS, LifeRow, life_row
from ohmward.errors import InputError
from ohmward.logs import Log
from ohmward_lab.simulate.electrochemical import FINE_V, CellTruth
from ohmward_lab.simulate.mission import DayPlan

#: RMSE to reach from a right start, at 25, 5 and -10 degC, with a file from pulses at 25 degC.
_BARS = {
    "lfp": (0.01, 0.02, 0.03),
    "nmc": (0.01, 0.015, 0.025),
    "nca": (0.01, 0.015, 0.025),
    "lipo": (0.01, 0.015, 0.025),
    "lead-acid": (0.015, 0.025, 0.04),
}
#: The same with a file from two temperatures; and what an unknown start may add, once it was found.
_TWO_TEMPERATURE_BARS, _UNKNOWN_ADDS = (0.008, 0.01, 0.02), 0.01
_TEMPERATURES = (25.0, 5.0, -10.0)
_SWING_K = 3.0
#: Load of a day without charges; of a full one the day with two takes 110 % of the capacity.
_WITHOUT_CHARGES = 0.7
#: A logger of 10 Hz, and how long it runs: two drives and a charge.
_FAST_S, _FAST_HOURS = 0.1, 4.0
#: A cheap converter: 10 bits over 10 V a cell.
_COARSE_V = 0.01
#: Offsets of the current sensor in a blind benchmark of the field, 0.1 and 0.3 A on 4.6 Ah [K].
_BLIND_OFFSETS = tuple(ampere / 4.6 for ampere in (0.1, -0.1, 0.3, -0.3))


class Case(NamedTuple):
    """One row: a file, a life, a start and a sensor.

    start: error of the initial value; None where it is unknown.
    offset, gain: of the current sensor, as shares of C and of the current; voltage_step_V: of a cheap voltage sensor.
    interval_s: of the logger.
    restart: the estimator is switched on in the middle of a drive and has seen no current before.
    full_charge: two days with a full charge between them.
    """

    tested: str
    temperature_degC: float = 25.0
    capacity_ratio: float = 1.0
    start: float | None = 0.0
    offset: float = 0.0
    gain: float = 0.0
    interval_s: float = 1.0
    swing_K: float = _SWING_K
    charges: bool = True
    voltage_step_V: float = FINE_V
    restart: bool = False
    full_charge: bool = False

    def life(self, chemistry: str) -> Life:
        """The day of this case: without charges an easier one, and one of aged lead-acid too, that do not end empty."""
        load = 1.0 if self.charges else _WITHOUT_CHARGES
        if chemistry == "lead-acid":
            load *= self.capacity_ratio
        plan = DayPlan(self.temperature_degC, self.swing_K, load, opportunity_charges=self.charges)
        return Life((plan._replace(charged_fully=True), plan) if self.full_charge else (plan,), self.capacity_ratio)

    @property
    def words(self) -> str:
        """What is special about this life, in words."""
        start = {None: "start unknown", 0.0: "", -0.3: "start 30 points low", 0.05: "start 5 points high"}[self.start]
        parts = (
            f"{self.temperature_degC:g} degC" + (f" +- {self.swing_K:g}" if self.swing_K != _SWING_K else ""),
            f"aged to {100 * self.capacity_ratio:.0f} %" if self.capacity_ratio < 1 else "",
            start,
            f"offset {100 * self.offset:+.2g} % of C" if self.offset else "",
            f"gain {100 * self.gain:+.0f} %" if self.gain else "",
            f"every {self.interval_s:g} s" if self.interval_s != 1.0 else "",
            "" if self.charges else "no charges",
            f"voltage in steps of {1000 * self.voltage_step_V:g} mV" if self.voltage_step_V != FINE_V else "",
            "restart in mid-drive" if self.restart else "",
            "two days, a full charge between" if self.full_charge else "",
        )
        return ", ".join(part for part in parts if part)


def cases(cell: LifeCell) -> list[Case]:
    """The rows of a cell: of one that was kept out a part of them, of one whose model is slow a few."""
    if cell.slow:
        return [Case(PULSES), Case(PULSES, -10.0), Case(PULSES, -10.0, start=None), Case(LABEL)]
    base = [
        *(Case(PULSES, T) for T in (*_TEMPERATURES, 40.0)),
        *(Case(PULSES, T, start=None) for T in _TEMPERATURES),
        Case(PULSES, 5.0, capacity_ratio=0.8),
        Case(PULSES, offset=0.01),
        *(Case(TWO_TEMPERATURES, T) for T in _TEMPERATURES),
        Case(TWO_TEMPERATURES, -10.0, start=None),
        *(Case(EVERYDAY, T) for T in (25.0, 5.0)),
        *(Case(LABEL, T) for T in (25.0, 5.0)),
    ]
    return base if cell.kept_out else base + _variations() + _restarts()


def _variations() -> list[Case]:
    """One factor at a time, and the pairs that are worst together."""
    return [
        *(Case(PULSES, T, start=-0.3) for T in _TEMPERATURES),
        *(Case(PULSES, T, capacity_ratio=0.9) for T in (25.0, 5.0)),
        *(Case(PULSES, T, capacity_ratio=0.8) for T in (25.0, -10.0)),
        *(Case(PULSES, T, offset=o) for T, o in ((25.0, -0.01), (5.0, 0.01), (5.0, -0.01), (-10.0, 0.01))),
        *(Case(PULSES, T, gain=0.02) for T in (25.0, 5.0)),
        *(Case(PULSES, interval_s=s) for s in (_FAST_S, 10.0, 60.0)),
        *(Case(PULSES, start=start, voltage_step_V=_COARSE_V) for start in (0.0, None)),
        *(Case(PULSES, T, start=start, full_charge=True) for T in (25.0, -10.0) for start in (0.0, None)),
        Case(PULSES, 15.0, swing_K=12.0),
        *(Case(PULSES, T, charges=False) for T in (25.0, 5.0)),
        Case(PULSES, 5.0, start=None, offset=-0.01),
        Case(PULSES, 25.0, start=None, offset=0.01),
        Case(PULSES, 5.0, capacity_ratio=0.8, start=None),
        Case(PULSES, 25.0, capacity_ratio=0.8, offset=-0.01),
        *(Case(PULSES_SLOW, T) for T in _TEMPERATURES),
        *(Case(PULSES_SLOW, T, start=None) for T in (25.0, 5.0)),
        Case(PULSES_SLOW, 25.0, capacity_ratio=0.8),
        Case(TWO_TEMPERATURES, 5.0, start=None),
        Case(TWO_TEMPERATURES, 5.0, capacity_ratio=0.8),
        Case(EVERYDAY, -10.0),
        Case(EVERYDAY, 25.0, start=None),
        Case(LABEL, -10.0),
        Case(LABEL, 25.0, start=None),
        Case(LABEL, 25.0, offset=0.01),
    ]


def _restarts() -> list[Case]:
    """The protocol of a blind benchmark [K]: a restart in mid-drive, with an offset of the sensor."""
    return [
        case
        for T in (25.0, -10.0)
        for case in (
            *(Case(PULSES, T, start=start, restart=True) for start in (None, -0.3)),
            *(Case(PULSES, T, start=None, offset=offset, restart=True) for offset in _BLIND_OFFSETS),
        )
    ]


def rows(cell: LifeCell) -> Iterator[LifeRow]:
    """The rows of a cell, one after the other."""
    for case in cases(cell):
        yield row(cell, case)


def row(cell: LifeCell, case: Case) -> LifeRow:
    """One row; without scores where identification refuses the tests."""
    bar = rmse_bar(cell.chemistry, case)
    try:
        battery = battery_from(cell, case.tested)
    except InputError:
        nothing = dict.fromkeys(METHODS)
        return LifeRow(cell.chemistry, cell.name, case.tested, case.words, nothing, nothing, bar, cell.kept_out)
    log, soc = recorded(cell, case)
    initial = None if case.start is None else float(soc[0] + case.start)
    return life_row(
        cell.chemistry, cell.name, case.tested, case.words, battery, log, soc, initial, rmse_bar=bar,
        kept_out=cell.kept_out,
    )  # fmt: skip


def recorded(cell: LifeCell, case: Case) -> tuple[Log, np.ndarray]:
    """The log of a case and the state of charge (T,) at its times."""
    life = case.life(cell.chemistry)
    fast = case.interval_s < 1.0
    truth = truth_of_life(cell, life, case.interval_s, _FAST_HOURS) if fast else truth_of_life(cell, life)
    sensors = make_sensors(cell, case.offset, case.gain, case.voltage_step_V)
    log = measured(truth, cell, case.words, sensors, DAYS_AFTER[case.capacity_ratio])
    if case.interval_s > 1.0:
        return averaged(log, truth, round(case.interval_s))
    if not case.restart:
        return log, truth.soc
    middle = len(log) // 2
    return log.between(log.time_s[middle], np.inf), truth.soc[middle:]


def averaged(log: Log, truth: CellTruth, count: int) -> tuple[Log, np.ndarray]:
    """The log of a logger that stores means over `count` samples, and the state of charge at the end of each."""
    groups = len(log) // count

    def mean(values: np.ndarray) -> np.ndarray:
        return values[: groups * count].reshape(groups, count).mean(axis=1)

    ends = np.arange(1, groups + 1) * count - 1
    assert log.temperature_degC is not None
    stored = replace(
        log.select(ends),
        current_A=mean(log.current_A),
        voltage_V=mean(log.voltage_V),
        temperature_degC=mean(log.temperature_degC),
    )
    return stored, truth.soc[ends]


def rmse_bar(chemistry: str, case: Case) -> float | None:
    """RMSE to reach: of new cells with a clean sensor, at the temperatures that have a bar."""
    plain = case == Case(case.tested, case.temperature_degC, start=case.start)
    if not plain or case.temperature_degC not in _TEMPERATURES or case.start not in (0.0, None):
        return None
    at = _TEMPERATURES.index(case.temperature_degC)
    bars = {PULSES: _BARS[chemistry], PULSES_SLOW: _BARS[chemistry], TWO_TEMPERATURES: _TWO_TEMPERATURE_BARS}
    if case.tested not in bars:
        return None
    if case.start is None:
        # the flat curve of LFP tells nothing until it is left: there only the band is judged
        return None if chemistry == "lfp" else bars[case.tested][at] + _UNKNOWN_ADDS
    return bars[case.tested][at]
