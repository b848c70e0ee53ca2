"""Rows of the table of lives: what counts from when, the bars, and what is pooled."""

from typing import Any

import numpy as np
import pytest

from ohmward.battery.chemistries import generic_battery
from ohmward.battery.soc.registry import DEFAULT
from ohmward.battery.soc.score import Score
from ohmward.logs import Log
from scripts import script

lives = script("lives_table")
peers = script("lives_peers")
GOOD = Score(0.004, 0.003, 0.0, 0.004, 0.01, 0.95, 0.02, 0.9, 0.0, 100)


def life(soc: float | None, **options: Any) -> Any:
    """A rest of two hours at half charge, sampled each minute."""
    battery = generic_battery("nmc", 2.0)
    time_s = np.arange(0.0, 7200.0, 60.0)
    voltage_V = np.full(len(time_s), battery.thevenin.ocv.mean_V(0.5, 25.0))
    log = Log("rest", time_s, np.zeros(len(time_s)), voltage_V)
    return lives.life_row("nmc", "cell", "label", "rest", battery, log, np.full(len(time_s), 0.5), soc, **options)


def row(rmse: float = 0.004, rival: float = 0.01, bar: float | None = 0.01, **figures: Any) -> Any:
    scores = {DEFAULT: GOOD._replace(rmse=rmse, **figures), "textbook-ukf": GOOD._replace(rmse=rival), "rc": None}
    return lives.LifeRow("nmc", "cell", "label", "rest", scores, scores, bar)


@pytest.mark.parametrize("soc, options, samples", [(0.5, {}, 120), (0.2, {}, 60), (None, {"settled_s": 300.0}, 110)])
def test_a_right_start_counts_from_the_beginning_and_any_other_later(soc, options, samples):
    found = life(soc, **options)
    assert found.errors[DEFAULT].samples == samples
    assert found.bands[DEFAULT].samples == (115 if options else 90)


def test_a_method_without_a_model_has_no_score():
    assert life(0.5, methods=(DEFAULT, "no such method")).bands["no such method"] is None


@pytest.mark.parametrize(
    "made, missed",
    [
        (row(), ()),
        (row(rmse=0.011), ("RMSE <= 1.0",)),
        (row(rmse=0.011, bar=None), ()),
        (row(rmse=0.009, rival=0.005), ("plain filter + 0.3",)),
        (row(coverage_95=0.89), ("covered >= 90 %",)),
        (row(confidently_wrong=0.002), ("4 sigma",)),
    ],
)
def test_bars_are_missed_in_words(made, missed):
    assert lives.missed_bars(made) == missed
    assert ("met" in lives.markdown(made)) is not bool(missed)


def test_pooling_takes_every_row_alike_at_any_sampling_rate():
    rows = [
        row(coverage_95=1.0, error_over_std=0.6, samples=10),
        row(coverage_95=0.9, error_over_std=0.8, samples=9999),
    ]
    found = lives.pooled(rows)
    assert found.coverage_95 == pytest.approx(0.95)
    assert found.error_over_std == pytest.approx(np.sqrt(0.5))
    assert found.samples == 10009
    assert lives.pooled(rows, "rc") is None


@pytest.mark.parametrize(
    "ours, theirs, met",
    [
        (GOOD, GOOD, True),
        (GOOD, GOOD._replace(rmse=0.003), False),
        (GOOD._replace(coverage_95=0.8), GOOD, False),
        (GOOD, "KeyError: 'a_2'", True),
    ],
)
def test_a_peer_is_matched_by_error_and_band(ours, theirs, met):
    found = peers.PeerRow("cell", "record", "drive", "right", ours, theirs)
    assert found.met is met
    assert ("met" in peers.table([found])[-1]) is met


def test_a_peer_that_is_not_installed_gives_no_rows(monkeypatch, capsys):
    def absent(name):
        raise ModuleNotFoundError("No module named 'pybatteryse'")

    monkeypatch.setattr(peers, "import_module", absent)
    assert list(peers.rows()) == []
    assert "pip install pybatteryse" in capsys.readouterr().err
