"""Every error that is listed is one: the printed form fails where the correct one holds."""

import numpy as np
import pytest
import sympy as sp

from ohmward_lab.published import rc
from ohmward_lab.reproduce.errata import ERRATA, _p_rate, check
from ohmward_lab.reproduce.row import Erratum, differs


@pytest.mark.parametrize("erratum", ERRATA, ids=lambda e: f"{e.text} {e.place}")
def test_the_correct_form_holds_and_the_printed_one_does_not(erratum):
    assert erratum.check() is True


def test_a_wrong_correction_fails():
    assert not differs(1.0, 2.0, 3.0, 1e-6)
    assert not differs(3.0, 3.0, 3.0, 1e-6)
    assert check([Erratum("", "", "", "", lambda: False)]) == [False]


def test_both_publications_have_some_and_no_line_stands_twice():
    lines = [(e.text, e.place, e.printed) for e in ERRATA]
    assert len(set(lines)) == len(lines)
    assert {e.text for e in ERRATA} == {"[T]", "[P]"}


def test_B31_by_symbolic_algebra():
    """dV/dt of the circuit at constant current, divided as in [P] 2.2: B31 has R_s R_t."""
    cb, cs, rb, rs, rt, vb, vs, i = sp.symbols("c_b c_s r_b r_s r_t v_b v_s i")
    D = rb + rs
    V = (rs * vb + rb * vs) / D + (rt + rb * rs / D) * i
    rate = rs / D * (vs - vb + rs * i) / (D * cb) + rb / D * (vb - vs + rb * i) / (D * cs)
    A33 = rs / (cb * rb * D) - 1 / (cs * D)
    B31 = rb**2 / (cs * D**2) - rs * rt / (cb * rb * D) + rt / (cs * D) + rs * rb / (cs * D**2)
    assert sp.simplify(rate - A33 * (V - vb) - B31 * i) == 0
    printed = B31.subs(rs * rt, rs * rs)
    numbers = {cb: 60.0, cs: 40.0, rb: 0.09, rs: 0.06, rt: 0.05}
    p = rc.Circuit(60.0, 40.0, 0.09, 0.06, 0.05)
    x = np.array([12.5, 12.3])
    right = _p_rate(p, p.r_terminal_ohm)
    assert float(rate.subs(numbers | {vb: x[0], vs: x[1], i: -2.0})) == pytest.approx(right, rel=1e-9)
    assert float(printed.subs(numbers)) != pytest.approx(float(B31.subs(numbers)), rel=1e-3)
