"""`ohmward simulate --cell` from the outside: the log, JSON, the page, refusals."""

import re
import sys
from dataclasses import replace

import numpy as np
import pytest

from markdown_pages import ROOT
from ohmward.cli.main import main
from ohmward.logs import Log, read_log
from ohmward_lab.cli import arguments
from ohmward_lab.cli import simulate_cell as command
from ohmward_lab.simulate.electrochemical import MODELS, RECORDS

CELL = ("simulate", "--cell", "Prada2013")


@pytest.fixture
def recorded(tmp_path, monkeypatch):
    """The current folder is empty, and any record is a rest of a minute; how it was asked for."""
    asked = []

    def record_cell(cell, *how, **more):
        asked.append((cell, *how, more))
        time_s = np.arange(0.0, 60.0)
        voltage_V, degC = np.full(60, 3.3 * cell.n_series), np.full(60, 5.0)
        return Log("rest", time_s, np.zeros(60), voltage_V, degC, extra={"soc_true": np.full(60, 0.5)})

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(command, "record_cell", record_cell)
    monkeypatch.setattr(command, "capacity_Ah", lambda cell: 2.0 * (1.0 - cell.lost_material))
    return asked


def test_the_choices_are_those_of_the_simulation():
    assert tuple(RECORDS) == arguments.RECORDS and MODELS == arguments.MODELS


def test_the_figures_of_a_record(recorded, as_json):
    found = as_json(*CELL, "--record", "pulse-test", "--ambient-degc", "5", "--n-series", "4", "--seed", "7")
    cell, record, degC, more = recorded[0]
    assert (cell.parameter_set, cell.model, cell.n_series) == ("Prada2013", "SPMe", 4)
    assert (record, degC, more) == ("pulse-test", 5.0, {"new_Ah": 2.0, "seed": 7})
    assert (found["record"], found["samples"], found["soc_final"]) == ("pulse-test", 60, 0.5)
    assert found["voltage_min_V"] == found["voltage_max_V"] == pytest.approx(13.2)
    assert found["capacity_Ah"] == found["capacity_new_Ah"] == 2.0


def test_keys_are_all_listed(recorded, as_json):
    page = (ROOT / "docs" / "electrochemical-cells.md").read_text(encoding="utf-8")
    assert as_json(*CELL).keys() - set(re.findall(r"`(\w+)`", page)) == set()


def test_a_day_is_the_default_and_lead_acid_has_its_own_model(recorded, as_json):
    found = as_json("simulate", "--cell", "Sulzer2019")
    assert (found["record"], found["model"]) == ("day", "lead-acid")


def test_an_aged_cell_keeps_the_currents_of_the_new_one(recorded, as_json, monkeypatch):
    def aged(cell, left, ohm):
        return replace(cell, lost_material=1 - left, resistance_ratio=ohm)

    monkeypatch.setattr(command, "aged", aged)
    found = as_json(*CELL, "--aged-to", "0.8", "--resistance", "1.5")
    assert recorded[0][-1] == {"new_Ah": 2.0}
    assert (found["capacity_Ah"], found["resistance_ratio"]) == (pytest.approx(1.6), 1.5)


def test_the_text_says_what_comes_next(recorded, capsys):
    assert main([*CELL, "--record", "pulse-test", "--n-series", "4", "-o", "test.csv", "--report", "test.html"]) == 0
    assert "next: ohmward identify test.csv --capacity-ah 2 --n-series 4" in capsys.readouterr().out
    assert read_log("test.csv").extra["soc_true"][0] == 0.5
    assert main([*CELL, "-o", "day.csv"]) == 0
    assert "next: ohmward soc day.csv --battery FILE.toml --initial-soc 1 --truth soc_true" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("simulate", "--record", "day"), "--record is of a battery alone: name it with --cell"),
        (("simulate", "onto-ice", "--aged-to", "0.8"), "--aged-to is of a battery alone"),
        (("simulate", "onto-ice", "--cell", "Prada2013"), "name a scenario (onto-ice) or --cell Prada2013, not both"),
        ((*CELL, "--n-series", "0"), "--n-series"),
        ((*CELL, "-o", "test.bdf"), "the name must end in .csv, .parquet or .mcap"),
    ],
)
def test_contradictions_are_refused(words, message, recorded, refused):
    assert message in refused(*words)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("simulate", "--cell", "Prada"), "parameter_set must be one of Ai2020,"),
        (("simulate", "--cell", "Xu2019"), "'Xu2019' does not describe a cell of model 'SPMe'"),
        ((*CELL, "--aged-to", "0.1"), "capacity_ratio"),
    ],
)
def test_cells_that_do_not_exist_are_refused(words, message, refused):
    pytest.importorskip("pybamm")
    assert message in refused(*words)


def test_a_missing_package_is_named(refused, monkeypatch):
    monkeypatch.setitem(sys.modules, "pybamm", None)
    assert "needs pybamm, which is not installed: pip install pybamm\n" in refused(*CELL)


@pytest.mark.slow
def test_a_test_and_a_day_of_a_cell_that_no_model_describes(tmp_path, monkeypatch, as_json):
    pytest.importorskip("pybamm")
    monkeypatch.chdir(tmp_path)
    test = as_json(*CELL, "--record", "pulse-test", "-o", "test.csv")
    assert as_json(*CELL, "--ambient-degc", "10", "-o", "day.csv")["soc_initial"] == 1.0
    capacity = f"{test['capacity_new_Ah']:.3g}"
    as_json("identify", "test.csv", "--capacity-ah", capacity, "--chemistry", "lfp", "-o", "cell.toml")
    found = as_json("soc", "day.csv", "--battery", "cell.toml", "--initial-soc", "1", "--truth", "soc_true")
    assert found["soc_rmse"] < 0.03 and found["coverage_95"] > 0.9
