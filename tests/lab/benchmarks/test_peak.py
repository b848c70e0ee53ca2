import pytest

from scripts import script

pytest.importorskip("llvmlite")
peak_flops = script("peak").peak_flops


@pytest.mark.parametrize("precision", ["f64", "f32"])
def test_the_peak_is_that_of_a_processor(precision):
    assert 1e8 < peak_flops(precision, repeats=2) < 1e13
