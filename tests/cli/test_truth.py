import numpy as np
import pytest

from ohmward.cli.truth import read_truth
from ohmward.errors import InputError
from ohmward.logs import Log

TIME_S = np.arange(0.0, 3601.0)


def log(**extra) -> Log:
    # 1 A out for one hour: 1 Ah
    return Log("x", TIME_S, np.full(TIME_S.size, -1.0), np.full(TIME_S.size, 12.0), None, extra)


def test_one_ampere_for_one_hour():
    truth = read_truth(log(ah=-TIME_S / 3600), "ah", 2.0, 0.8)
    assert truth.soc[[0, -1]] == pytest.approx([0.8, 0.3])


@pytest.mark.parametrize("name", ["Ah", "capacity_Ah", "Charge / Ah", "Q [A.h]", "A h"])
def test_a_counter_that_counts_up_while_discharging(name):
    truth = read_truth(log(**{name: 5.0 + TIME_S / 3600}), name, 2.0, 1.0)
    assert truth.soc[[0, -1]] == pytest.approx([1.0, 0.5])


def test_milliampere_hours():
    assert read_truth(log(mAh=TIME_S / 3.6), "mAh", 2.0, 1.0).soc[-1] == pytest.approx(0.5)


def test_one_counter_for_each_direction():
    extra = {"chg_Ah": np.zeros(TIME_S.size), "dis_Ah": TIME_S / 3600}
    assert read_truth(log(**extra), "chg_Ah - dis_Ah", 2.0, 1.0).soc[-1] == pytest.approx(0.5)


def test_the_first_value_counts_where_the_first_samples_have_none():
    counter = np.where(TIME_S < 1800, np.nan, TIME_S / 3600)
    soc = read_truth(log(Ah=counter), "Ah", 2.0, 0.9).soc
    assert np.isnan(soc[0])
    assert soc[[1800, -1]] == pytest.approx([0.9, 0.65])


def test_a_counter_that_starts_again_from_zero():
    counter = np.where(TIME_S < 1800, TIME_S, TIME_S - 1800) / 3600
    truth = read_truth(log(Ah=counter), "Ah", 2.0, 1.0)
    assert truth.soc[[0, -1]] == pytest.approx([1.0, 0.5], abs=1e-3)
    assert truth.note.endswith("resets undone")


def test_a_share_and_a_percentage():
    share = 0.5 + TIME_S / 1e4
    assert read_truth(log(soc=share), "soc", 2.0).soc == pytest.approx(share)
    assert read_truth(log(soc=100 * share), "soc", 2.0).soc == pytest.approx(share)


def test_a_percentage_below_one_percent_is_known_by_its_name():
    assert read_truth(log(soc_pct=TIME_S / 3600), "soc_pct", 2.0).soc[-1] == pytest.approx(0.01)


@pytest.mark.parametrize(
    ("extra", "column", "start", "message"),
    [
        ({"soc": TIME_S}, "sox", None, "did you mean 'soc'"),
        ({}, "soc", None, "no further numeric columns"),
        ({"soc": TIME_S}, "soc", None, "runs from 0 to 3600"),
        ({"soc": np.full(TIME_S.size, np.nan)}, "soc", None, "has no value"),
        ({"Ah": TIME_S / 3600}, "Ah", None, "--truth-start"),
        ({"Ah": TIME_S / 360}, "Ah", 1.0, "would lead from -4 to 1"),
        ({"a": TIME_S}, "a - b", None, "no column 'b'"),
    ],
)
def test_what_is_refused(extra, column, start, message):
    with pytest.raises(InputError, match=message):
        read_truth(log(**extra), column, 2.0, start)
