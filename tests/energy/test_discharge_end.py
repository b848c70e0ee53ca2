"""The end of a discharge: its charge and loads, live and from a log, and what becomes of it afterwards."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from energy.examples import battery, learned
from ohmward.battery.chemistries import generic_battery
from ohmward.energy import RangeEstimator
from ohmward.energy.consumption_file import dump_consumption, parse_consumption
from ohmward.energy.discharge_end import DischargeEnd, DischargeMeter, end_along
from ohmward.logs.log import Log

END = DischargeEnd(8.1, 0.95, 0.01, 1.0, 5.0, 6.0, 22.0, 25.0)
#: An hour at 5 A out of 10 Ah, the last half minute at 6 A and at the cut-off of 22 V.
TIME_S = np.arange(0.0, 3601.0)
CURRENT_A = np.where(TIME_S <= 3570.0, -5.0, -6.0)
VOLTAGE_V = np.where(TIME_S <= 3570.0, 25.0, 22.0)
SOC = 0.9 - np.append(0.0, np.cumsum(-CURRENT_A[1:])) / 36000.0
LOG = Log("drive", TIME_S, CURRENT_A, VOLTAGE_V)


def found(log=LOG, cutoff_V=22.0) -> DischargeEnd | None:
    return end_along(log, SOC, np.full(SOC.shape, 0.01), cutoff_V)


def test_the_charge_is_counted_down_to_the_cut_off():
    end = found()
    assert end is not None and (end.start_soc, end.start_soc_std, end.temperature_degC) == (0.9, 0.01, 25.0)
    assert end.given_Ah == pytest.approx((3570.0 * 5.0 + 30.0 * 6.0) / 3600.0) and end.hours == pytest.approx(1.0)
    assert end.mean_A == pytest.approx(6.0 - math.exp(-30.0 / 180.0)) and end.last_A == pytest.approx(6.0, rel=1e-3)
    assert end.voltage_V == pytest.approx(22.0, rel=1e-3)


def test_a_voltage_above_the_cut_off_is_no_end():
    assert found(cutoff_V=21.0) is None and found(cutoff_V=0.0) is None


def test_a_discharge_from_below_half_charge_is_no_end():
    assert end_along(LOG, SOC - 0.45, np.full(SOC.shape, 0.01), 22.0) is None


def test_a_charge_restarts_the_count():
    meter = DischargeMeter().with_soc(0.9, 0.01).with_sample(60.0, -5.0, 25.0)
    assert meter.given_Ah == pytest.approx(5.0 / 60.0)
    assert meter.with_soc(0.8, 0.01) == meter
    assert meter.with_soc(0.95, 0.02)[:4] == (0.95, 0.02, 0.0, 0.0)


def test_a_gap_restarts_the_count():
    assert DischargeMeter().with_soc(0.9, 0.01).with_sample(61.0, -5.0, 25.0) == DischargeMeter()


def test_a_missing_current_is_the_mean():
    meter = DischargeMeter(mean_A=4.0)
    assert meter.with_sample(36.0, math.nan, 25.0).given_Ah == pytest.approx(0.04)
    for dt_s in (0.0, -1.0, math.nan):
        assert meter.with_sample(dt_s, -5.0, 25.0) == meter


def live() -> RangeEstimator:
    estimator = RangeEstimator(battery((20.0, 28.0)), learned(), refresh_s=1e9, reserve_soc=0.0, cutoff_V=22.0)
    for t, soc, amperes, volts in zip(TIME_S, SOC, CURRENT_A, VOLTAGE_V, strict=True):
        estimator.update(t, soc, 0.5, amperes, volts, terrain="grass")
    return estimator


def test_a_robot_remembers_its_last_end_until_its_battery_is_changed():
    estimator, end = live(), found()
    assert end is not None and estimator.consumption.end == pytest.approx(end._replace(start_soc_std=0.0))
    taken = json.loads(json.dumps(estimator.snapshot(), allow_nan=False))
    back = RangeEstimator.restore(battery((20.0, 28.0)), taken, refresh_s=1e9, reserve_soc=0.0, cutoff_V=22.0)
    assert back.consumption.end == estimator.consumption.end
    estimator.change_battery()
    assert estimator.consumption.end is None


def test_the_consumption_table_has_the_last_end():
    c = replace(learned(), end=END)
    assert parse_consumption(dump_consumption(c)).end == END
    assert parse_consumption(dump_consumption(learned())).end is None


def test_a_range_is_that_of_the_battery_whose_end_is_known():
    pack = generic_battery("lfp", 10.0, 8)
    worn = replace(learned(), end=END._replace(given_Ah=6.0, voltage_V=20.0))
    new, known = (
        RangeEstimator(pack, c, reserve_soc=0.0, cutoff_V=20.0).update(0.0, 0.9).distance_m for c in (learned(), worn)
    )
    assert known.p50 < 0.8 * new.p50
