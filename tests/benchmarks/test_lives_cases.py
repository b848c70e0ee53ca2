"""Lives of simulated cells: which rows there are, what they have to reach, and what their loggers store."""

import numpy as np
import pytest

from benchmarks.scripts import script
from ohmward.logs import Log
from ohmward.simulate.electrochemical import CellTruth

cases = script("lives_cases")
cells = script("lives_cells")


@pytest.mark.parametrize("kept_out", [False, True])
def test_a_page_of_rows_that_differ_in_their_words(kept_out):
    words = [(case.tested, case.words) for case in cases.cases(kept_out)]
    assert len(set(words)) == len(words) <= 60
    assert {tested for tested, _ in words} >= {cells.PULSES, cells.TWO_TEMPERATURES, cells.EVERYDAY, cells.LABEL}


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


def test_a_slow_logger_stores_means_and_its_truth_is_that_of_the_end():
    ramp = np.arange(12.0)
    truth = CellTruth(ramp, ramp, ramp, ramp, ramp / 12.0)
    log, soc = cases.averaged(Log("ramp", ramp, ramp, 3.0 + ramp, 20.0 + ramp), truth, 5)
    assert log.current_A == pytest.approx([2.0, 7.0]) and log.voltage_V == pytest.approx([5.0, 10.0])
    assert list(log.time_s) == [4.0, 9.0] and soc == pytest.approx([4 / 12, 9 / 12])
