"""Measured lives: what is absent is skipped with a message, and truths are what their data sets say."""

import numpy as np
import pytest

from benchmarks.scripts import script

cells = script("measured_cells")
measured = script("measured_lives")
figure = script("figure")


def test_absent_data_are_skipped_with_a_message(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(figure, "DATA", tmp_path)
    monkeypatch.setattr(measured, "PARTS", (measured.others,))
    cells._table.cache_clear()
    assert list(measured.rows()) == []
    assert "is absent, skipped" in capsys.readouterr().err


def test_a_full_discharge_runs_from_one_to_nothing_and_a_broken_one_is_no_truth():
    time_s = np.linspace(0, 3600, 101)
    voltage_V = np.linspace(4.2, 2.0, 101)
    log = cells.Log("discharge", time_s, np.full(101, -2.0), voltage_V)
    assert cells._full_discharge(log) == pytest.approx(np.linspace(1, 0, 101), abs=1e-9)
    short = cells.Log("discharge", time_s, np.full(101, -1.0), voltage_V)
    assert np.isnan(cells._full_discharge(short)).all()


@pytest.mark.parametrize("part", measured.PARTS, ids=lambda part: part.__name__)
def test_lives_are_named_apart(part):
    places = [case[:4] for case in part()]
    assert places
    assert len(set(places)) == len(places)


def test_bars_follow_the_temperature_of_the_life():
    bars = [measured._bar_at(degC, measured.ONE_TEMPERATURE["lfp"]) for degC in (45, 25, 5, -15)]
    assert bars == [0.01, 0.01, 0.02, 0.03]
    assert measured._bar_at(25, None) is None
