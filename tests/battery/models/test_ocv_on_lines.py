"""A curve on straight lines: never further off than allowed, never falling, and small."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from battery.examples import LFP, NMC
from ohmward.battery.models.ocv import OcvCurve
from ohmward.battery.models.ocv_on_lines import on_lines
from ohmward.errors import InputError
from ohmward.trace import trace

SOC = np.linspace(0.0, 1.0, 20_001)


@pytest.mark.parametrize("ocv", [NMC.ocv, LFP.ocv], ids=["nmc", "lfp"])
@pytest.mark.parametrize("error_V", [5e-3, 1e-3, 5e-4])
def test_it_stays_within_the_error_and_says_which(ocv, error_V):
    curve, said_V, lines = on_lines(ocv, error_V)
    difference = np.abs(curve.mean_V(SOC, 25.0) - ocv.mean_V(SOC, 25.0)).max()
    assert difference <= error_V * 1.001 and said_V == pytest.approx(difference, rel=0.02)
    assert np.diff(curve.mean_V(SOC, 25.0)).min() >= -1e-12
    assert 5 < lines < 60
    assert curve.voltage_V[0] == pytest.approx(ocv.voltage_V[0], abs=error_V)


def test_its_table_holds_the_lines_alone():
    curve, _, lines = on_lines(NMC.ocv, 1e-3)
    program = trace(lambda soc: curve.mean_V(soc, 25.0), 0.0)
    tables = {n.args[1] for n in program.nodes if n.operation.name == "gather"}
    assert sorted(map(len, tables)) == [lines, lines, len(curve.voltage_V) + 1]
    assert sum(map(len, tables)) < 220


def test_a_straight_curve_is_one_line():
    curve, error_V, lines = on_lines(OcvCurve(tuple(np.linspace(3.0, 4.0, 40))), 1e-3)
    assert lines == 1 and error_V < 1e-12
    assert trace(lambda soc: curve.mean_V(soc, 25.0), 0.0).operations["gather"] == 0


def test_less_error_takes_more_lines():
    counts = [on_lines(LFP.ocv, error_V).lines for error_V in (8e-3, 4e-3, 2e-3, 1e-3)]
    assert counts == sorted(counts) and counts[-1] > counts[0]


def test_where_lines_would_be_larger_the_curve_stays():
    curve, error_V, lines = on_lines(OcvCurve((3.0, 3.4, 3.5, 4.2)), 1e-6)
    assert (curve.voltage_V, error_V, lines) == ((3.0, 3.4, 3.5, 4.2), 0.0, 0)


@given(st.lists(st.floats(0.0, 0.3), min_size=3, max_size=12), st.sampled_from([1e-3, 1e-2]))
def test_any_rising_curve(steps, error_V):
    ocv = OcvCurve(tuple((3.0 + np.cumsum(steps)).tolist()))
    curve, _, _ = on_lines(ocv, error_V)
    assert np.abs(curve.mean_V(SOC, 25.0) - ocv.mean_V(SOC, 25.0)).max() <= error_V * 1.1
    assert np.diff(curve.mean_V(SOC, 25.0)).min() >= -1e-12


def test_an_error_must_be_positive():
    with pytest.raises(InputError, match="error_V"):
        on_lines(NMC.ocv, 0.0)
