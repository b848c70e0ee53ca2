import numpy as np
import pytest

from ohmward.battery.charge_count import count_charge, find_counter, find_gaps, require_followed
from ohmward.battery.identification.identify import identify
from ohmward.errors import InputError
from ohmward.logs import Log


def log(time_s, current_A, **extra):
    time_s = np.asarray(time_s, float)
    return Log("log", time_s, np.asarray(current_A, float), np.full(time_s.size, 3.7), extra=extra)


def test_one_C_for_one_hour():
    charge = count_charge(log(np.arange(3601.0), np.full(3601, -2.0)))
    assert charge.total_Ah[-1] == pytest.approx(-2.0, rel=1e-12)
    assert 3600 * charge.moved_Ah[1:] == pytest.approx(-2.0)


def test_current_is_linear_between_irregular_samples():
    time_s = np.array([0.0, 1.0, 4.0, 10.0])
    charge = count_charge(log(time_s, 3.0 + 2.0 * time_s))
    assert charge.total_Ah * 3600 == pytest.approx(3.0 * time_s + time_s**2)


def test_nan_current_is_bridged():
    current = np.full(100, -1.0)
    current[40:60] = np.nan
    assert count_charge(log(np.arange(100.0), current)).total_Ah[-1] == pytest.approx(-99 / 3600)


@pytest.mark.parametrize("current", [np.zeros(50), np.full(50, np.nan)])
def test_no_current_is_refused(current):
    with pytest.raises(InputError, match="never other than zero"):
        count_charge(log(np.arange(50.0), current))


def stepped(dt_s=60.0):
    """10 A until the step at 600 s, which falls just after a sample: the trapezoid is wrong by half an interval."""
    time_s = np.concatenate([np.arange(0.0, 601.0), np.arange(660.0, 1261.0, dt_s)])
    current_A = np.where(time_s <= 600.0, -10.0, 0.0)
    truth_Ah = -10.0 * np.minimum(time_s, 600.0) / 3600
    return time_s, current_A, truth_Ah


def test_counter_settles_a_step_within_a_long_interval():
    time_s, current_A, truth_Ah = stepped()
    alone = count_charge(log(time_s, current_A)).total_Ah[-1]
    assert alone - truth_Ah[-1] == pytest.approx(-10 * 30 / 3600)
    rounded = np.round(truth_Ah, 2)
    with_counter = count_charge(log(time_s, current_A, capacity_Ah=rounded))
    assert with_counter.total_Ah[-1] == pytest.approx(truth_Ah[-1], abs=0.011)
    assert "capacity_Ah" in with_counter.notes[0].text


@pytest.mark.parametrize("name, scale", [("ah", 1.0), ("Q / mAh", 1000.0), ("Net Capacity / Ah", -1.0)])
def test_counter_is_known_by_its_unit_whatever_its_sign(name, scale):
    time_s, current_A, truth_Ah = stepped()
    total = count_charge(log(time_s, current_A, **{name: scale * truth_Ah})).total_Ah
    assert total[-1] == pytest.approx(truth_Ah[-1], abs=2e-3)


def test_pair_of_counters():
    time_s = np.arange(2000.0)
    current_A = np.where(time_s % 400 < 200, -2.0, 1.0)
    moved = np.diff(time_s, prepend=0.0) * 0.5 * (current_A + np.append(current_A[0], current_A[:-1])) / 3600
    extra = {"chg_Ah": np.cumsum(np.maximum(moved, 0)), "dis_Ah": np.cumsum(np.maximum(-moved, 0))}
    counter = find_counter(log(time_s, current_A, **extra), moved, find_gaps(time_s))
    assert counter is not None and counter.name == "chg_Ah - dis_Ah"
    assert counter.step_Ah == pytest.approx(moved, abs=1e-9)


def test_counter_that_starts_again_at_every_step():
    time_s = np.arange(3000.0)
    current_A = np.where(time_s < 1000, -5.0, np.where(time_s < 2000, 0.0, -3.0))
    truth_Ah = count_charge(log(time_s, current_A)).total_Ah
    per_step = truth_Ah - np.where(time_s < 1001, 0.0, np.where(time_s < 2000, truth_Ah[1000], truth_Ah[1999]))
    assert count_charge(log(time_s, current_A, capacity_Ah=per_step)).total_Ah[-1] == pytest.approx(
        truth_Ah[-1], abs=2e-3
    )


def test_a_column_that_disagrees_is_no_counter():
    time_s, current_A, truth_Ah = stepped()
    charge = count_charge(log(time_s, current_A, capacity_Ah=1.2 * truth_Ah))
    assert not charge.notes


def test_a_counter_without_a_sign_is_not_believed_where_the_current_changes_direction():
    time_s = np.concatenate([np.arange(0.0, 9000.0, 20.0), np.arange(9000.0, 12600.0, 2.0)])
    current_A = np.where(time_s < 9000.0, 1.0, -2.5)
    alone = count_charge(log(time_s, current_A))
    throughput_Ah = np.cumsum(np.abs(alone.moved_Ah))
    charge = count_charge(log(time_s, current_A, **{"Capacity(Ah)": throughput_Ah}))
    assert charge.moved_Ah.tolist() == alone.moved_Ah.tolist() and not charge.notes


def test_gap_with_counter_is_resolved_and_without_is_unknown():
    time_s = np.concatenate([np.arange(0.0, 1000.0), np.arange(4000.0, 5000.0)])
    current_A = np.where((time_s > 100) & (time_s < 900), -1.0, np.where(time_s > 4500, -1.0, 0.0))
    lost_Ah = np.where(time_s > 2000, -0.3, 0.0)
    inside = count_charge(log(time_s, current_A))
    assert inside.unknown.sum() == 1 and inside.moved_Ah[1000] == 0
    whole = count_charge(log(time_s, current_A, ah=inside.total_Ah + lost_Ah))
    assert whole.total_Ah[-1] == pytest.approx(inside.total_Ah[-1] - 0.3, abs=1e-3)
    assert not whole.unknown.any()


def test_long_regular_intervals_are_no_gaps():
    assert not find_gaps(np.arange(0.0, 6000.0, 60.0)).any()


def a_drive(every):
    """An hour of a current that is new every two seconds, of which every so many rows are kept."""
    current_A = np.repeat(np.random.default_rng(1).normal(-1.0, 3.0, 1800), 2)
    return log(np.arange(0.0, 3600.0, every), current_A[::every])


def test_a_log_that_follows_its_current_is_taken():
    require_followed(a_drive(1))


def test_a_log_whose_rows_miss_most_of_its_current_is_refused_with_the_way_out():
    with pytest.raises(InputError, match=r"rows are 30 s apart.*log a row a second"):
        require_followed(a_drive(30))


def test_pulses_of_ten_minutes_may_be_sampled_once_a_minute():
    current_A = np.tile(np.repeat([0.0, -2.0], 10), 30)
    require_followed(log(60.0 * np.arange(current_A.size), current_A))


def test_no_resistances_are_identified_from_a_log_that_misses_its_current():
    with pytest.raises(InputError, match="more charge may have flowed between them"):
        identify(a_drive(30), capacity_Ah=2.0, chemistry="nmc")
