"""Lives of simulated cells: which rows there are, what they have to reach, and what their loggers store."""

import numpy as np
import pytest

from ohmward.logs import Log
from ohmward_lab.simulate.electrochemical import CellTruth
from scripts import script

cases = script("lives_cases")
cells = script("lives_cells")


DAY_S = np.arange(0.0, 7200.0)


@pytest.fixture
def day(monkeypatch):
    """A day of two hours that discharges half of every cell, without its simulation; how it was asked for."""
    asked = []

    def truth_of_life(cell, life, *how):
        asked.append((life, *how))
        return CellTruth(DAY_S, np.full(7200, -1.0), np.full(7200, 3.7), np.full(7200, 25.0), 0.9 - 0.5 * DAY_S / 7200)

    monkeypatch.setattr(cells, "capacity_of", lambda cell: 4.6)
    monkeypatch.setattr(cases, "truth_of_life", truth_of_life)
    return asked


@pytest.mark.parametrize("cell", cells.CELLS, ids=lambda cell: cell.name)
def test_a_page_of_rows_that_differ_in_their_words(cell):
    words = [(case.tested, case.words) for case in cases.cases(cell)]
    assert len(set(words)) == len(words) <= 75
    tested = {cells.PULSES, cells.LABEL}
    if not cell.slow:
        tested |= {cells.TWO_TEMPERATURES, cells.EVERYDAY}
    assert {tested for tested, _ in words} >= tested


@pytest.mark.parametrize("chemistry", sorted({cell.chemistry for cell in cells.CELLS}))
def test_each_chemistry_has_loggers_from_ten_times_a_second_to_once_a_minute_and_restarts(chemistry):
    if all(cell.kept_out for cell in cells.CELLS if cell.chemistry == chemistry):
        pytest.skip("every cell of this chemistry was kept out")
    rows = [case for cell in cells.CELLS if cell.chemistry == chemistry for case in cases.cases(cell)]
    assert {case.interval_s for case in rows} >= {0.1, 1.0, 60.0}
    offsets_A = {round(4.6 * case.offset, 3) for case in rows if case.restart}
    assert offsets_A == {0.0, 0.1, -0.1, 0.3, -0.3}


def test_a_restart_sees_nothing_of_the_first_half(day):
    log, soc = cases.recorded(cells.CELLS[0], cases.Case(cells.PULSES, restart=True, start=None))
    assert len(log) == 3600 and log.time_s[0] == 3600.0
    assert soc[0] == pytest.approx(0.65)


def test_a_fast_logger_asks_for_a_truth_of_its_own(day):
    cases.recorded(cells.CELLS[0], cases.Case(cells.PULSES, interval_s=0.1))
    assert day[0][1:] == (0.1, 4.0)


def test_a_slow_logger_is_that_of_the_case(day):
    log, soc = cases.recorded(cells.CELLS[0], cases.Case(cells.PULSES, interval_s=60.0))
    assert len(log) == len(soc) == 120 and log.time_s[0] == 59.0


def test_a_cheap_converter_and_an_offset_are_in_the_log(day):
    log, _ = cases.recorded(cells.CELLS[0], cases.Case(cells.PULSES, voltage_step_V=0.01, offset=0.1 / 4.6))
    assert np.allclose(log.voltage_V, np.round(log.voltage_V, 2))
    assert np.mean(log.current_A) == pytest.approx(-0.9, abs=1e-3)


def test_a_full_charge_lies_between_two_days(day):
    cases.recorded(cells.CELLS[0], cases.Case(cells.PULSES, full_charge=True))
    assert [plan.charged_fully for plan in day[0][0].plans] == [True, False]


@pytest.mark.parametrize(
    "chemistry, case, bar",
    [
        ("lfp", cases.Case(cells.PULSES), 0.01),
        ("lfp", cases.Case(cells.PULSES, -10.0), 0.03),
        ("nmc", cases.Case(cells.PULSES, 5.0, start=None), 0.025),
        ("lead-acid", cases.Case(cells.PULSES, 5.0), 0.025),
        ("nca", cases.Case(cells.TWO_TEMPERATURES, -10.0), 0.02),
        ("lfp", cases.Case(cells.PULSES, start=None), None),
        ("nmc", cases.Case(cells.PULSES, 40.0), None),
        ("nmc", cases.Case(cells.PULSES, capacity_ratio=0.8), None),
        ("nmc", cases.Case(cells.LABEL), None),
    ],
)
def test_what_a_row_has_to_reach(chemistry, case, bar):
    assert cases.rmse_bar(chemistry, case) == (None if bar is None else pytest.approx(bar))


def test_words_name_what_is_special():
    case = cases.Case(cells.PULSES, 5.0, capacity_ratio=0.8, start=None, offset=-0.01, interval_s=60.0, charges=False)
    assert case.words == "5 degC, aged to 80 %, start unknown, offset -1 % of C, every 60 s, no charges"
    case = cases.Case(cells.PULSES, start=None, offset=0.3 / 4.6, voltage_step_V=0.01, restart=True)
    assert case.words == "25 degC, start unknown, offset +6.5 % of C, voltage in steps of 10 mV, restart in mid-drive"


def test_a_slow_logger_stores_means_and_its_truth_is_that_of_the_end():
    ramp = np.arange(12.0)
    truth = CellTruth(ramp, ramp, ramp, ramp, ramp / 12.0)
    log, soc = cases.averaged(Log("ramp", ramp, ramp, 3.0 + ramp, 20.0 + ramp), truth, 5)
    assert log.current_A == pytest.approx([2.0, 7.0]) and log.voltage_V == pytest.approx([5.0, 10.0])
    assert list(log.time_s) == [4.0, 9.0] and soc == pytest.approx([4 / 12, 9 / 12])
