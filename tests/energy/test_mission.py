"""A mission analysis from logs made by hand: what it learns, what it looks ahead to, what it refuses."""

from dataclasses import replace

import numpy as np
import pytest

from energy.examples import PRIOR, battery
from ohmward.energy.consumption import start
from ohmward.energy.drive_record import record_figures, terrain_figures
from ohmward.energy.leg import Leg
from ohmward.energy.mission import DEFAULT_RESERVE, MissionSettings, Plan, analyse, battery_at_end
from ohmward.errors import InputError
from ohmward.logs import Log

TIME_S = np.arange(0.0, 1800.0)
SPEED = np.where(TIME_S % 600 < 540, 0.5, 0.0)
IDLE_W, FORCE_N = 12.0, 30.0
LOG = Log(
    "drive",
    TIME_S,
    -(IDLE_W + FORCE_N * SPEED) / 24.0,
    np.full(TIME_S.size, 24.0),
    temperature_degC=np.full(TIME_S.size, 15.0),
    extra={"speed_m_s": SPEED},
    start_unix_s=1e9,
)
SOC = MissionSettings(soc=0.8, soc_std=0.001)
PLAN = Plan((Leg(500.0, "grass", 0.5),), reserve_soc=0.2, cutoff_V=20.0, temperature_degC=5.0)


def test_a_drive_teaches_what_it_took():
    result = analyse(battery(), start(PRIOR), LOG, ground="grass", settings=SOC)
    assert result.record is not None and result.forecast is None
    figures = record_figures(result.record, result.consumption)
    assert figures.distance_m == pytest.approx(np.trapezoid(SPEED, TIME_S), rel=1e-3)
    assert figures.energy_J == pytest.approx(np.trapezoid(IDLE_W + FORCE_N * SPEED, TIME_S), rel=1e-3)
    assert figures.split_J is None
    assert result.consumption.mean[0] == pytest.approx(IDLE_W, rel=0.02)
    assert list(result.advice) == ["grass"]
    found = terrain_figures(result.consumption, "grass")
    assert found.speed_m_s == pytest.approx(0.5, rel=0.02)
    assert found.energy_J_per_m == pytest.approx(FORCE_N + IDLE_W / 0.5, rel=0.02)
    assert found.expected_J_per_m.p10 < FORCE_N + IDLE_W / 0.5 < found.expected_J_per_m.p90


def test_the_ground_may_change_on_the_way():
    ground = np.where(TIME_S < 900, "grass", "gravel")
    result = analyse(battery(), start(PRIOR), LOG, ground=ground, settings=SOC)
    assert result.consumption.terrains == ("grass", "gravel")
    assert list(result.advice) == ["grass", "gravel"]


def test_the_case_of_letters_makes_no_other_ground():
    known = analyse(battery(), start(PRIOR), LOG, ground="Grass", settings=SOC).consumption
    ground = np.array(["grass ", "GRASS", "gravel"])[np.arange(TIME_S.size) // 300 % 3]
    result = analyse(battery(), known, LOG, ground=ground, plan=PLAN, settings=SOC)
    assert result.consumption.terrains == ("Grass", "gravel")


def test_days_between_drives_count():
    first = analyse(battery(), start(PRIOR), LOG, ground="grass", settings=SOC)
    assert first.consumption.last_drive_unix_s == pytest.approx(1e9 + TIME_S[-1])
    second = analyse(battery(), first.consumption, LOG, ground="grass", settings=SOC)
    assert "0.0 days since the last drive that was learned from" in [note.text for note in second.notes]


def test_days_count_from_the_first_sample_of_a_part_of_a_log():
    first = analyse(battery(), start(PRIOR), LOG, ground="grass", settings=SOC)
    later = replace(LOG, time_s=TIME_S + 2 * 86400.0)
    second = analyse(battery(), first.consumption, later, ground="grass", settings=SOC)
    assert "2.0 days since the last drive that was learned from" in [note.text for note in second.notes]


def test_a_plan_alone_is_looked_ahead_to():
    result = analyse(battery(), start(PRIOR), plan=PLAN, settings=SOC)
    assert result.record is None
    assert result.forecast is not None and result.forecast.probability > 0.99
    assert [note.text for note in result.notes] == ["nobody has driven on 'grass': its resistance is a broad guess"]


def test_the_state_of_the_battery_is_that_of_plan_and_log():
    of_plan, _ = battery_at_end(battery(), SOC, PLAN, LOG)
    assert (of_plan.reserve_soc, of_plan.cutoff_V, of_plan.temperature_degC) == (0.2, 20.0, 5.0)
    of_log, notes = battery_at_end(battery(), SOC, None, LOG)
    assert (of_log.reserve_soc, of_log.cutoff_V, of_log.temperature_degC) == (DEFAULT_RESERVE, 0.0, 15.0)
    assert notes == []


def test_the_cut_off_of_a_plan_can_be_switched_off():
    state, _ = battery_at_end(battery(), replace(SOC, cutoff_V=0.0), PLAN, LOG)
    assert state.cutoff_V == 0.0


def test_a_log_that_ends_at_the_cut_off_is_remembered():
    settings = MissionSettings(initial_soc=0.9, initial_soc_std=0.01, reserve_soc=0.0, cutoff_V=24.0)
    end = analyse(battery((20.0, 28.0)), start(PRIOR), LOG, ground="grass", settings=settings).consumption.end
    assert end is not None and end.temperature_degC == 15.0
    above = replace(settings, cutoff_V=20.0)
    assert analyse(battery((20.0, 28.0)), start(PRIOR), LOG, ground="grass", settings=above).consumption.end is None


def test_a_drive_that_costs_nothing_is_warned_of_and_forecasts_nothing():
    charging = replace(LOG, current_A=-LOG.current_A)
    result = analyse(battery(), start(PRIOR), charging, ground="grass", settings=SOC)
    assert result.notes[-1].text.startswith("the drive seems to take next to nothing")
    assert result.range.distance_m.p50 < 432e3 / 10.0


def test_a_log_that_ends_below_the_usual_reserve_reaches_to_empty():
    state, notes = battery_at_end(battery(), MissionSettings(soc=0.05), None, LOG)
    assert state.reserve_soc == 0.0
    assert [note.level for note in notes] == ["warning"]


def test_the_state_of_charge_is_estimated_where_nobody_says_it():
    sloped = battery(ocv_V=(22.0, 26.0), r_ohm=0.05)
    result = analyse(sloped, start(PRIOR), LOG, ground="grass", settings=MissionSettings(initial_soc=0.6))
    assert 0.4 < result.state.soc < 0.6


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({}, "needs a log, a plan, or both"),
        ({"plan": PLAN}, "settings.soc is needed with a plan alone"),
        ({"log": LOG, "settings": MissionSettings(soc=0.5, speed_column="v")}, "there is no speed"),
    ],
)
def test_what_is_refused(arguments, message):
    with pytest.raises(InputError, match=message):
        analyse(battery(), start(PRIOR), **arguments)


def test_a_log_of_another_battery_is_refused():
    tested = replace(battery(), voltage_min_V=40.0, voltage_max_V=56.0)
    with pytest.raises(InputError, match="is it a log of another battery"):
        analyse(tested, start(PRIOR), LOG, settings=SOC)
