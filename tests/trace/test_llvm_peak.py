import pytest

from ohmward.trace.llvm.peak import peak_flops

pytest.importorskip("llvmlite")


def test_single_precision_has_twice_the_lanes():
    double, single = peak_flops("f64", repeats=9), peak_flops("f32", repeats=9)
    assert double > 1e9
    assert 1.2 < single / double < 3.0
