"""Estimators side by side."""

import time
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ohmward.battery.soc.comparison import seconds_per_step
from ohmward.battery.soc.sample import SocSample
from ohmward.trace.kernel import WORTH_STEPS


def test_the_time_of_a_step_is_without_compilation():
    """A kernel that compiles for 0.3 s at its first log, and takes 20 ms for each."""
    scanned: list[tuple[str, int]] = []

    def scan(state, samples):
        time.sleep(0.02 if scanned else 0.32)
        scanned.append((state, len(samples.current_A)))

    samples = SocSample(*(np.zeros(7) for _ in SocSample._fields))
    slow: Any = SimpleNamespace(scan=scan)
    found_s = seconds_per_step(slow, "start", samples)
    assert found_s * WORTH_STEPS == pytest.approx(0.02, abs=0.2)
    assert set(scanned) == {("start", WORTH_STEPS)}
