"""Measured lives: what is absent is skipped with a message, and truths are what their data sets say."""

from typing import Any

import numpy as np
import pytest

from ohmward.battery.chemistries import generic_battery
from ohmward.errors import InputError
from scripts import script

cells = script("measured_cells")
measured = script("measured_lives")
figure = script("figure")


def test_absent_data_are_named(monkeypatch, tmp_path):
    monkeypatch.setattr(figure, "DATA", tmp_path)
    monkeypatch.setattr(measured, "PARTS", (measured.others,))
    cells._table.cache_clear()
    with pytest.raises(FileNotFoundError, match="ornl_nissan_leaf_cell"):
        list(measured.rows())


def test_a_battery_that_is_not_identified_is_skipped_with_a_message(monkeypatch, capsys):
    def refuse():
        raise InputError("no rests")

    case = measured.Case("nmc", "cell", "one trip", "another", refuse, lambda: None)
    monkeypatch.setattr(measured, "PARTS", (lambda: iter([case]),))
    assert list(measured.rows()) == []
    assert "cell, one trip: no rests" in capsys.readouterr().err


def test_a_life_that_is_over_before_it_is_judged_is_skipped_with_a_message(monkeypatch, capsys):
    log = cells.Log("drive", np.arange(0.0, 3000.0, 10.0), np.zeros(300), np.full(300, 3.7))
    recording = cells.Recording(log, np.full(300, 0.5))
    case = measured.Case("nmc", "cell", "label", "drive", lambda: generic_battery("nmc", 2.0), lambda: recording)
    case = case._replace(starts=(measured.RIGHT, measured.Start("restart", from_share=0.5)))
    monkeypatch.setattr(measured, "PARTS", (lambda: iter([case]),))
    monkeypatch.setattr(measured, "lived", lambda *words: words[-1].words)
    assert list(measured.rows()) == ["right"]
    assert "cell, drive, restart: over before it is judged" in capsys.readouterr().err


def test_a_start_reaches_the_estimator(monkeypatch):
    told: dict[str, Any] = {}
    monkeypatch.setattr(measured, "life_row", lambda *words, **options: told.update(words=words, options=options))
    battery = generic_battery("nmc", 2.0)
    log = cells.Log("rest", np.arange(10.0), np.zeros(10), np.full(10, 3.7))
    case = measured.Case("nmc", "cell", "label", "rest", lambda: battery, lambda: None, rmse_bar=0.01)
    recording = cells.Recording(log, np.linspace(0.5, 0.41, 10))
    measured.lived(case, battery, recording, measured.Start("restart", -0.3, offset_C=0.1, from_share=0.5))
    *_, life, _, sensed, truth, soc = told["words"]
    assert life == "rest, restart"
    assert sensed.time_s[0] == 5.0
    assert sensed.current_A == pytest.approx(np.full(5, 0.2))
    assert truth == pytest.approx(np.linspace(0.45, 0.41, 5))
    assert soc == pytest.approx(0.15)
    assert told["options"]["rmse_bar"] is None


def test_a_full_discharge_runs_from_one_to_nothing_and_a_broken_one_is_no_truth():
    time_s = np.linspace(0, 3600, 101)
    voltage_V = np.linspace(4.2, 2.0, 101)
    log = cells.Log("discharge", time_s, np.full(101, -2.0), voltage_V)
    assert cells.full_discharge(log) == pytest.approx(np.linspace(1, 0, 101), abs=1e-9)
    short = cells.Log("discharge", time_s, np.full(101, -1.0), voltage_V)
    assert np.isnan(cells.full_discharge(short)).all()


@pytest.mark.parametrize("part", measured.PARTS, ids=lambda part: part.__name__)
def test_lives_are_named_apart(part):
    places = [case[:4] for case in part()]
    assert places
    assert len(set(places)) == len(places)


def test_bars_follow_the_temperature_of_the_life():
    bars = [measured._bar_at(degC, measured.ONE_TEMPERATURE["lfp"]) for degC in (45, 25, 5, -15)]
    assert bars == [0.01, 0.01, 0.02, 0.03]
    assert measured._bar_at(25, None) is None
