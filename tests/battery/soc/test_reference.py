from dataclasses import replace

import numpy as np
import pytest

from ohmward.battery.soc.score import SocReference, soc_reference
from ohmward.errors import InputError
from ohmward.logs import Log

TIME_S = np.arange(0.0, 3601.0)


# 1 A out for one hour: 1 Ah
LOG = Log("x", TIME_S, np.full(TIME_S.size, -1.0), np.full(TIME_S.size, 12.0))


def reference(column: str, values, capacity_Ah: float, start_soc: float | None = None) -> SocReference:
    return soc_reference(replace(LOG, extra={column: values}), column, capacity_Ah, start_soc)


def test_one_counter_for_each_direction():
    log = replace(LOG, extra={"chg_Ah": np.zeros(TIME_S.size), "dis_Ah": TIME_S / 3600})
    assert soc_reference(log, "chg_Ah - dis_Ah", 2.0, 1.0).soc[-1] == pytest.approx(0.5)


def test_one_ampere_for_one_hour():
    truth = reference("ah", -TIME_S / 3600, 2.0, 0.8)
    assert truth.soc[[0, -1]] == pytest.approx([0.8, 0.3])


@pytest.mark.parametrize("name", ["Ah", "capacity_Ah", "Charge / Ah", "Q [A.h]", "A h"])
def test_a_counter_that_counts_up_while_discharging(name):
    truth = reference(name, 5.0 + TIME_S / 3600, 2.0, 1.0)
    assert truth.soc[[0, -1]] == pytest.approx([1.0, 0.5])


def test_milliampere_hours():
    assert reference("mAh", TIME_S / 3.6, 2.0, 1.0).soc[-1] == pytest.approx(0.5)


def test_the_first_value_counts_where_the_first_samples_have_none():
    counter = np.where(TIME_S < 1800, np.nan, TIME_S / 3600)
    soc = reference("Ah", counter, 2.0, 0.9).soc
    assert np.isnan(soc[0])
    assert soc[[1800, -1]] == pytest.approx([0.9, 0.65])


def test_a_counter_that_starts_again_from_zero():
    counter = np.where(TIME_S < 1800, TIME_S, TIME_S - 1800) / 3600
    truth = reference("Ah", counter, 2.0, 1.0)
    assert truth.soc[[0, -1]] == pytest.approx([1.0, 0.5], abs=1e-3)
    assert truth.note.endswith("resets undone")


def test_a_share_and_a_percentage():
    share = 0.5 + TIME_S / 1e4
    assert reference("soc", share, 2.0).soc == pytest.approx(share)
    assert reference("soc", 100 * share, 2.0).soc == pytest.approx(share)


def test_a_percentage_below_one_percent_is_known_by_its_name():
    assert reference("soc_pct", TIME_S / 3600, 2.0).soc[-1] == pytest.approx(0.01)


@pytest.mark.parametrize(
    ("column", "values", "start", "message"),
    [
        ("soc", TIME_S, None, "runs from 0 to 3600"),
        ("soc", np.full(TIME_S.size, np.nan), None, "has no value"),
        ("Ah", TIME_S / 3600, None, "--truth-start"),
        ("Ah", TIME_S / 360, 1.0, "would lead from -4 to 1"),
    ],
)
def test_what_is_refused(column, values, start, message):
    with pytest.raises(InputError, match=message):
        reference(column, values, 2.0, start)


@pytest.mark.parametrize(
    ("extra", "column", "message"),
    [
        ({"soc": TIME_S}, "sox", "did you mean 'soc'"),
        ({}, "soc", "no further numeric columns"),
        ({"a": TIME_S}, "a - b", "no column 'b'"),
    ],
)
def test_a_column_that_is_not_there(extra, column, message):
    with pytest.raises(InputError, match=message):
        soc_reference(replace(LOG, extra=extra), column, 2.0)
