import json

import numpy as np
import pytest

from ohmward.battery.chemistries import generic_battery
from ohmward.battery.file import save_battery
from ohmward.cli.main import main

COMPARE = ("compare", "day.csv", "--battery", "battery.toml", "--filters", "coulomb,ekf")


def test_figures_are_those_of_soc(here, as_json):
    compared = as_json(*COMPARE, "--truth", "soc_true")["estimators"]
    alone = as_json("soc", "day.csv", "--battery", "battery.toml", "--truth", "soc_true", "--filter", "ekf")
    for key in ("soc_final", "soc_rmse", "soc_max_error_after_1h", "coverage_95", "voltage_rmse_V"):
        assert compared["ekf"][key] == pytest.approx(alone[key], rel=1e-12)  # one may be in machine code
    assert compared["coulomb"]["voltage_rmse_V"] is None
    assert compared["ekf"]["us_per_step"] > 0


def test_a_mean_square_is_the_mean_squared_plus_the_variance(here, as_json):
    figures = as_json(*COMPARE, "--truth", "soc_true")["estimators"]["ekf"]
    assert figures["soc_rmse"] == pytest.approx(np.hypot(figures["soc_error_mean"], figures["soc_error_std"]))
    assert figures["voltage_rmse_V"] == pytest.approx(
        np.hypot(figures["voltage_error_mean_V"], figures["voltage_error_std_V"])
    )


def test_mutual_differences_are_symmetric(here, as_json):
    differences = as_json(*COMPARE)["soc_rms_differences"]
    assert differences["ekf"]["coulomb"] == differences["coulomb"]["ekf"] > 0


def test_tables_with_and_without_a_truth(here, capsys):
    main([*COMPARE, "--truth", "soc_true"])
    out = capsys.readouterr().out
    assert "RMSE after 1 h" in out and "voltage error: mean" in out
    assert "SoC difference" not in out
    main(list(COMPARE))
    assert "SoC difference, RMS" in capsys.readouterr().out


def test_a_battery_that_no_estimator_can_use(here, refused, monkeypatch):
    monkeypatch.setattr("ohmward.battery.soc.comparison.available", lambda battery: ())
    assert "no estimator works with the models" in refused(*COMPARE[:4])


def test_all_estimators_of_the_battery_by_default(here, as_json, monkeypatch):
    monkeypatch.setattr("ohmward.battery.soc.comparison.available", lambda battery: ("coulomb", "ocv"))
    assert list(as_json(*COMPARE[:4])["estimators"]) == ["coulomb", "ocv"]


def test_those_that_reproduce_a_publication_on_demand(here, as_json):
    names = list(as_json(*COMPARE[:4], "--published")["estimators"])
    assert names[-4:] == [f"published.{name}" for name in ("aekf", "aukf", "hybrid", "rc-kf")]


def test_a_file_that_does_not_fit_is_told_as_by_soc(here, capsys):
    """A pack of three cells and a file of four; a filter that cannot judge stands first."""
    save_battery(generic_battery("nmc", 12.0, 4), here / "four.toml")
    assert main(["soc", "day.csv", "--battery", "four.toml", "--filter", "ekf", "--json"]) == 1
    alone = json.loads(capsys.readouterr().out)
    assert main(["compare", "day.csv", "--battery", "four.toml", "--filters", "coulomb,ekf", "--json"]) == 1
    compared = json.loads(capsys.readouterr().out)
    assert alone["fits"] is compared["fits"] is False
    (sentence,) = [note for note in alone["notes"] if "does not fit the log" in note]
    assert sentence in compared["notes"]


def test_a_file_that_fits(here, as_json):
    assert as_json(*COMPARE)["fits"] is True
