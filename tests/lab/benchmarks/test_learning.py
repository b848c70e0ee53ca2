"""The page of files that learn: its scores, its bars, its table, and truths of the parts."""

import numpy as np
import pytest

from ohmward.battery.chemistries import Normal, generic_battery
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.logs import Log
from scripts import script

figure = script("figure")
score = script("learning_score")
parts = script("learning_parts")
page = script("learning")
measured = script("learning_measured")


def test_parts_are_named_apart_and_belong_to_a_section():
    found = parts.parts()
    assert len({part.name for part in found}) == len(found)
    assert {part.section for part in found} == set(page.SECTIONS)


def test_an_error_in_sigmas_is_judged_by_the_band():
    percent, sigmas = score.value_figures("cell", "learn", "capacity", Normal(2.1, 0.05), 2.0, 4.0)
    assert (percent.value, percent.met) == ("5.0", False)
    assert (sigmas.value, sigmas.met) == ("2.00", False)


def test_a_figure_between_bars_is_met_at_both():
    met = [figure.between("cell", "learn", "covered, %", value, (90.0, 98.0)).met for value in (89.9, 90.0, 98.0, 98.1)]
    assert met == [False, True, True, False]


def test_errors_are_those_of_the_filter_on_a_rest():
    time_s = np.arange(0.0, 7200.0, 10.0)
    log = Log("rest", time_s, np.zeros(time_s.size), np.full(time_s.size, 3.74))
    recording = score.Recording(log, np.full(time_s.size, 0.5))
    battery = generic_battery("nmc", 2.0)
    soc = SocEstimator(battery, 0.5).run(log).estimates.soc
    found = score.errors(battery, [recording, recording], 0.0)
    assert found.rmse == pytest.approx(100 * np.sqrt(np.mean((soc - 0.5) ** 2)))
    assert found.covered == pytest.approx(100.0)


def test_the_table_has_a_column_for_each_file_and_one_verdict():
    rows = [
        figure.at_most("cell", "label", "RMSE, points", 4.0),
        figure.at_most("cell", "learn", "RMSE, points", 2.0, 3.0),
    ]
    *_, line = page.table(rows, kept_out=False)
    assert line == "| RMSE, points | 4 | 2 | <= 3 | met |"


def test_half_a_discharge_is_half_of_the_time_to_its_lowest_voltage():
    time_s = np.arange(0.0, 100.0)
    log = Log("discharge", time_s, np.full(100, -1.0), np.concatenate([np.linspace(4.2, 2.0, 81), np.full(19, 3.0)]))
    assert measured.half_s(log) == pytest.approx(40.0)
