"""Ten thousand inputs of any kind for everything that listens; `make soak` takes a million of each."""

import random

import pytest

from scripts import script

FUZZ = script("on_board_fuzz")
HTTP = script("on_board_http")


@pytest.mark.parametrize("listener", FUZZ.LISTENERS)
def test_no_crash_no_hang_no_memory(listener):
    inputs = 1_000 if listener == "bags" else 10_000  # each is a file, with definitions to parse
    found = FUZZ.fuzz(listener, inputs)
    assert found.inputs == inputs
    assert found.crashes == 0
    assert found.slowest_s < 1.0
    assert found.grown_MB < 10.0


def test_requests_of_any_kind_leave_the_page_well():
    found = HTTP.fuzz_http(10_000)
    assert found.inputs == 10_000
    assert found.crashes == 0
    assert found.slowest_s < 5.0
    assert found.grown_MB < 10.0


def test_damage_leaves_some_inputs_good_and_changes_most():
    rng, good = random.Random(1), [b'{"battery_current_A": 1}']
    found = [FUZZ.damaged(good, rng) for _ in range(1000)]
    assert 100 < found.count(good[0]) < 500
