"""A filter on the emulated microcontroller; skipped where the cross compiler or the emulator is missing."""

import importlib.util
import shutil
from pathlib import Path

import pytest

from ohmward.battery.chemistries import generic_battery
from ohmward.export import battery_export

PATH = Path(__file__).parents[2] / "firmware" / "measure.py"
SPEC = importlib.util.spec_from_file_location("measure", PATH)
assert SPEC is not None and SPEC.loader is not None
measure = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(measure)

MISSING = [tool for tool in measure.TOOLS if not shutil.which(tool)]
needs_tools = pytest.mark.skipif(bool(MISSING), reason=f"no microcontroller to emulate here: {', '.join(MISSING)}")


@needs_tools
@pytest.mark.parametrize("machine", measure.MACHINES, ids=lambda m: m.name)
def test_every_bit_is_right_and_nothing_is_hidden(machine):
    export = battery_export(generic_battery("nmc", 2.0), "textbook-ekf", "filter", sample_time_s=1.0)
    found = measure.measure(export, "textbook-ekf", "-Os", machine)
    assert found.wrong == 0 and found.vectors == 64
    assert found.state == 40 and 1000 < found.flash < 2048
    assert 100 < found.least <= found.mean <= found.most < 450
    assert 0 < found.stack < 256


@needs_tools
def test_a_wrong_bit_is_seen(tmp_path, monkeypatch):
    export = battery_export(generic_battery("nmc", 2.0), "coulomb", "filter")
    whole = measure.library(export)
    broken = whole["filter.c"].replace("output->soc = ", "output->soc = 0.5f * ")
    monkeypatch.setattr(measure, "library", lambda _: whole | {"filter.c": broken})
    assert measure.measure(export, "coulomb", "-O2", measure.MACHINES[0]).wrong > 0
