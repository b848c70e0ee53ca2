"""Totals since ever, counted live, over restarts, and from a store."""

import math

import numpy as np
import pytest

from ohmward import generic_battery
from ohmward.battery.file import BATTERY_FILE
from ohmward.onboard.assembly import assemble
from ohmward.onboard.estimation import Estimation
from ohmward.onboard.page.view import view
from ohmward.onboard.resume import remember, resume
from ohmward.onboard.robot_setup import SETUP_FILE
from ohmward.onboard.robot_state import Totals, number_at, require_path, totals_from
from ohmward.onboard.store.rows import Row, RowMaker
from ohmward.onboard.store.store import Store, totals_of_store
from ohmward.traction.robot.packaged import RLMA

BATTERY = generic_battery("lfp", 12.0, 4)


def hour(estimation, current_A, start_s=0.0, step_s=10.0):
    """States of an hour at a current and 13 V."""
    found = []
    for k in range(int(3600 / step_s) + 1):
        values = {"battery_current_A": current_A, "battery_voltage_V": 13.0}
        found += estimation.put(start_s + step_s * k, values)
    return found


def test_an_hour_each_way_is_a_sixth_of_a_cycle_each():
    estimation = Estimation(BATTERY)
    hour(estimation, -2.0)
    hour(estimation, 2.0, 7200.0)  # the hour between was not measured
    totals = estimation.state.totals
    assert totals == pytest.approx(Totals(2.0, 2.0, 0.026, 0.026, 2.0 / 12.0, 0.0))
    require_path("totals.energy_out_kWh")
    assert number_at(estimation.state, "totals.energy_out_kWh") == pytest.approx(0.026)
    shown = {one["label"]: (round(one["value"], 4), one["unit"]) for one in view(estimation.state)["totals"]}
    assert shown["Energy out"] == (0.026, "kWh") and shown["Cycles"] == (0.1667, "")


def test_what_is_not_measured_is_not_counted():
    totals = Totals()
    assert totals.after_battery(10.0, math.nan, 13.0, 12.0) == totals
    assert totals.after_battery(3600.0, -2.0, 13.0, 12.0) == totals
    assert totals.after_battery(math.nan, -2.0, 13.0, 12.0) == totals
    assert totals.after_battery(36.0, -2.0, math.nan, 12.0).charge_out_Ah == pytest.approx(0.02)


def test_the_way_goes_on_where_the_pose_begins_again():
    estimation = Estimation(robot=RLMA)

    def ahead(first, last):
        for k in range(first, last):
            wheels = {f"wheel_speed_rad_s.{place.name}": 5.0 for place in RLMA.places}
            estimation.put(0.1 * k, wheels | {"yaw_rate_rad_s": 0.0})

    ahead(0, 100)
    estimation.put(10.0, {"pose_reset": 1.0})
    ahead(100, 200)
    totals, pose = estimation.state.totals, estimation.state.pose
    assert totals is not None and pose is not None
    assert totals.distance_km == pytest.approx(0.012, rel=0.1)
    assert float(pose.distance_m) == pytest.approx(6.0, rel=0.1)


def test_they_go_on_after_a_restart():
    before = Estimation(BATTERY)
    hour(before, -2.0)
    content = remember(before, 3600.0)
    after = Estimation(BATTERY)
    assert resume(after, content, 10.0, 0.0) == []
    hour(after, -2.0)
    assert after.totals.charge_out_Ah == pytest.approx(4.0)
    assert totals_from({"cycles": "many", "distance_km": -1.0, "energy_in_kWh": 2}) == Totals(energy_in_kWh=2.0)


def test_they_go_on_where_the_time_of_a_robot_went_back():
    estimation = Estimation(BATTERY)
    hour(estimation, -2.0, start_s=7200.0)
    estimation.restart()
    assert estimation.soc is not None and estimation.soc.last is None
    hour(estimation, -2.0)
    totals = estimation.state.totals
    assert totals is not None and totals.charge_out_Ah == pytest.approx(4.0)


def test_a_store_gives_those_of_its_rows(tmp_path):
    estimation, maker = Estimation(BATTERY), RowMaker()
    states = [*hour(estimation, -2.0), *hour(estimation, 3.0, 7200.0)]
    store = Store(tmp_path / "store")
    store.add(row for state in states for row in maker.rows(state._replace(unix_s=1.8e9 + state.time_s)))
    metres = np.concatenate([np.linspace(0.0, 500.0, 50), np.linspace(0.0, 300.0, 50)])  # two starts
    store.add(Row("drive", round(1e9 * (1.8e9 + 10.0 * k)), {"distance_m": x}) for k, x in enumerate(metres))
    store.close()
    found = totals_of_store(tmp_path / "store", 12.0)
    assert found == pytest.approx(Totals(3.0, 2.0, 0.039, 0.026, 5.0 / 24.0, 0.8))


def test_a_store_counts_the_steps_between_its_days(tmp_path):
    """Five days, a row every 50 s, none of them at the border of a day."""
    days, step_s = 5, 50.0
    store = Store(tmp_path / "store")
    rows = round(days * 86_400.0 / step_s) + 1
    for kind, values in (
        ("battery", lambda k: {"battery_current_A": -2.0, "battery_voltage_V": 13.0}),
        ("drive", lambda k: {"distance_m": 25.0 * k}),
    ):
        store.add(Row(kind, round(1e9 * (1.8e9 + 0.3 + (step_s + 1e-3) * k)), values(k)) for k in range(rows))
    store.close()
    found = totals_of_store(tmp_path / "store", 12.0)
    hours = (rows - 1) * (step_s + 1e-3) / 3600.0
    assert found.charge_out_Ah == pytest.approx(2.0 * hours, rel=1e-6)
    assert found.energy_out_kWh == pytest.approx(0.026 * hours, rel=1e-6)
    assert found.distance_km == pytest.approx(0.025 * (rows - 1), rel=1e-9)


def test_a_robot_that_has_counted_none_begins_with_those_of_its_store(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    store = Store(tmp_path / "ohmward-store")
    rows = ({"battery_current_A": -2.0, "battery_voltage_V": 13.0} for _ in range(361))
    store.add(Row("battery", round(1e9 * (1.8e9 + 10.0 * k)), values) for k, values in enumerate(rows))
    store.close()
    BATTERY_FILE.save(BATTERY, tmp_path / "battery.toml")
    text = 'format = "ohmward-setup/1"\nbattery = "battery.toml"\n[[source]]\nkind = "json-lines"\n'
    process = assemble(SETUP_FILE.parse(text + '[[sink]]\nkind = "store"\n'))
    assert process.estimation.totals.charge_out_Ah == pytest.approx(2.0)
