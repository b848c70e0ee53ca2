import pytest

from ohmward.trace.lower.llvm_operations import SPELLINGS
from scripts import script

pytest.importorskip("llvmlite")
latency = script("latency")


def test_every_operation_of_machine_code_has_a_latency():
    assert set(SPELLINGS) <= {*latency.CHAINS, *latency.SAME, *latency.FREE}


@pytest.mark.parametrize("precision", ["f64", "f32"])
def test_latencies_are_those_of_a_processor(precision):
    found = latency.latencies(precision, repeats=9)
    assert 1e-11 < found["add"] < 1e-8
    assert found["fma"] < found["multiply"] + found["add"] + 1e-9
    assert found["divide"] > found["multiply"] and found["sqrt"] > found["add"]
    assert found["gather"] > found["add"]
