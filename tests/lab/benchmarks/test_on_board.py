"""A minute of what `make soak` does for hours; latency and share of a core want a machine that does nothing else."""

import sys

import numpy as np
import pytest

from scripts import script

on_board = script("on_board")
on_board_load = script("on_board_load")
on_board_day = script("on_board_day")


@pytest.mark.slow
def test_no_sample_is_lost_at_1_khz():
    found = on_board_load.measure(5.0)
    assert found.estimated == found.sent == 5000
    assert 0.0 < found.p50_s <= found.p99_s
    assert found.memory_MB.max() < 200.0


@pytest.mark.slow
def test_memory_and_handles_stay_flat_along_simulated_hours():
    looks = on_board_day.drive_a_day(0.21)
    assert len(looks) == 6
    assert on_board_day.growth([look.memory_MB for look in looks]) < 1.05
    assert on_board_day.growth([float(look.handles) for look in looks]) == 1.0


def test_growth_is_that_of_the_last_quarter():
    assert on_board_day.growth([5.0, 5.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0]) == 1.0
    assert on_board_day.growth([1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 2.0, 2.0]) == 2.0


def test_quantiles_of_latencies():
    histogram = on_board_load.Histogram()
    skipped = int(on_board_load.SETTLE_S * on_board_load.WHEELS_HZ)
    for latency_s in [9.0] * skipped + list(np.linspace(0.0, 0.01, 1001)) + [5.0]:
        histogram.add(latency_s)
    assert histogram.quantile(0.5) == pytest.approx(0.005, abs=2e-5)
    assert histogram.quantile(0.9999) == pytest.approx(1.0)
    assert histogram.number == skipped + 1002


def test_a_part_replaces_its_own_section_and_leaves_the_others(tmp_path, monkeypatch):
    monkeypatch.setattr(on_board, "KEPT", tmp_path)
    monkeypatch.setattr(on_board, "PAGE", page := tmp_path / "page.md")
    monkeypatch.setattr(on_board, "SLOWEST_S", 0.0)
    page.write_text("# Title\n\nText.\n\n## day\n\n2026-11-23, elsewhere.\n")
    for part, inputs in (("fuzz-serial", 300), ("fuzz-can", 200), ("fuzz-serial", 100)):
        monkeypatch.setattr(sys, "argv", ["on_board.py", part, "--inputs", str(inputs)])
        on_board.main()
    title, *sections = page.read_text().split("\n\n## ")
    assert title == "# Title\n\nText."
    found = {text.splitlines()[0]: text for text in sections}
    assert [*found] == [*on_board.PARTS]
    assert found["fuzz-serial"].count("100 inputs at random | serial") == 3
    assert found["fuzz-serial"].count("**missed**") == 1
    assert found["fuzz-can"].count("200 inputs at random | can") == 3
    assert found["kills"] == "kills\n\nNot measured."
    assert found["day"] == "day\n\n2026-11-23, elsewhere.\n"


def test_inputs_of_a_run_that_was_cut_off_are_gone_on_with(tmp_path, monkeypatch):
    monkeypatch.setattr(on_board, "KEPT", tmp_path)
    monkeypatch.setattr(on_board, "CHUNK", 50)
    seeds, fuzz = [], on_board.FUZZERS["serial"]

    def watched(inputs, seed):
        seeds.append(seed)
        return fuzz(inputs, seed)

    monkeypatch.setitem(on_board.FUZZERS, "serial", watched)
    list(on_board.fuzz_rows("serial", on_board.Scale(inputs=100)))
    rows = list(on_board.fuzz_rows("serial", on_board.Scale(inputs=200, goes_on=True)))
    assert seeds == [1, 2, 3, 4]
    assert rows[0].data == "200 inputs at random"
    assert rows[0].met
