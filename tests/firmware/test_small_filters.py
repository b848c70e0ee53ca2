"""How small the bare filters are on a Cortex-M4F: instructions of the longest step, bytes of code and tables."""

import shutil

import pytest

from scripts import script

pytest.importorskip("cffi", reason="pip install cffi for the twin")
measure, emulator = script("measure", "firmware"), script("emulator", "firmware")

MISSING = [tool for tool in (*emulator.TOOLS, "gcc") if not shutil.which(tool)]
needs_tools = pytest.mark.skipif(
    bool(MISSING), reason=f"no microcontroller to emulate here, {', '.join(MISSING)} missing: {emulator.INSTALL}"
)

#: How it is exported; instructions, bytes of code and bytes of flash at most, with -Os.
LIMITS = [
    ("textbook-ekf", {"sample_time_s": 1.0}, 225, 1100, 4400),
    ("textbook-ukf", {"sample_time_s": 1.0}, 310, 1400, 4700),
    ("textbook-ukf", {}, 450, 2048, 5200),
    ("textbook-ukf", {"sample_time_s": 1.0, "curve_error_V": 0.004}, 290, 1300, 2048),
    ("textbook-ukf", {"sample_time_s": 1.0, "curve_error_V": 0.004, "style": "loops"}, 700, 1250, 2048),
    ("textbook-joint", {}, 2000, 7500, 7500),
    ("textbook-joint", {"style": "loops"}, 6500, 1740, 1740),
]


@needs_tools
@pytest.mark.parametrize(("name", "options", "instructions", "code", "flash"), LIMITS)
def test_it_stays_as_small(name, options, instructions, code, flash):
    battery, hour = measure.battery_and_hour()
    samples = type(hour)(*(column[:300] for column in hour))
    case = measure.Case(name, measure.battery_export(battery, name, "filter", **options), samples)
    found = next(measure.measure(case, ["-Os"], measure.MACHINES[:1]))
    assert found.wrong == 0 and found.answer.vectors.steps == 64 and found.answer.log.steps == 300
    assert 0.8 * instructions < found.most <= instructions
    assert found.sizes.code <= code and found.flash <= flash
