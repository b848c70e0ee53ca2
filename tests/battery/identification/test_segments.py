from itertools import pairwise

import numpy as np
import pytest

from battery.identification.examples import pulse_phases, steps
from ohmward.battery.identification.circuit_uncertainty import current_noise_A
from ohmward.battery.identification.record import find_phases, find_pulses, find_rests, make_records
from ohmward.errors import InputError
from ohmward.logs import Log


def log(time_s, current_A, voltage_V=None, name="log"):
    return Log(name, time_s, current_A, np.full(time_s.size, 3.7) if voltage_V is None else voltage_V)


def test_phases_of_a_pulse_test_on_irregular_samples():
    time_s, current_A = steps([(100, 0, 10), (10, -2, 1), (300, 0, 7), (10, 1.5, 0.5), (60, 0, 3)])
    phases = find_phases(log(time_s, current_A), 2.0)
    assert [p.kind for p in phases] == ["rest", "constant", "rest", "constant", "rest"]
    assert [p.current_A for p in phases] == pytest.approx([0, -2, 0, 1.5, 0])
    assert phases[0].first == 0 and phases[-1].last == time_s.size - 1
    assert all(a.last + 1 == b.first for a, b in pairwise(phases))


def test_noise_below_the_thresholds_cuts_nothing():
    time_s, current_A = steps([(100, 0, 1), (200, -2, 1), (100, 0, 1)])
    noisy = current_A + np.random.default_rng(0).uniform(-0.015, 0.015, time_s.size)
    assert len(find_phases(log(time_s, noisy), 2.0)) == 3


def test_rest_lies_at_the_idle_current():
    time_s, current_A = steps([(100, -0.1, 1), (100, -2, 1), (100, -0.1, 1)])
    assert [p.kind for p in find_phases(log(time_s, current_A), 2.0, idle_current_A=-0.1)] == [
        "rest",
        "constant",
        "rest",
    ]
    assert [p.kind for p in find_phases(log(time_s, current_A), 2.0)] == ["constant"] * 3


def test_a_drive_is_one_varying_phase():
    time_s = np.arange(0.0, 500.0)
    current_A = -1.0 + np.random.default_rng(1).normal(0, 0.8, 500)
    kinds = [p.kind for p in find_phases(log(time_s, current_A), 2.0)]
    assert kinds.count("varying") < 60 and sum(k == "constant" for k in kinds) < 60


def test_pulses_follow_a_rest_and_are_short():
    time_s, current_A = steps([(60, 0, 1), (10, -2, 1), (60, 0, 1), (10, 1, 1), (500, -1, 1), (60, 0, 1)])
    phases = find_phases(log(time_s, current_A), 2.0)
    assert [p.current_A for p in find_pulses(phases, 2.0)] == pytest.approx([-2, 1])
    assert len(find_rests(phases, 50)) == 2 and len(find_rests(phases, 70)) == 0


@pytest.mark.parametrize(
    "phases, test",
    [
        (pulse_phases(count=3, rest_s=700), "pulses"),
        # after a charge that tapers
        ([(60, 0.03 * k, 10) for k in range(66, 0, -1)] + pulse_phases(count=3, rest_s=700), "pulses"),
        ([(600, 0, 60), (30 * 3600, -2 / 30, 60)], "low-rate"),
        ([(60, 0, 1), (3000, -2, 1), (60, 0, 1)], "dynamic"),
    ],
)
def test_kind_of_test(phases, test):
    (record,) = make_records(log(*steps(phases)), 2.0)
    assert record.test == test


@pytest.mark.parametrize("size", [1, 2, 4])
def test_a_log_shorter_than_a_pulse_is_refused(size):
    with pytest.raises(InputError, match=r"has \d samples; a pulse and its rest need at least 5"):
        make_records(log(np.arange(float(size)), np.full(size, -1.0)), 2.0)


def gapped(after_V, rest_s=700):
    time_s, current_A = steps([(100, 0, 1), (50, -2, 1), (rest_s, 0, 1), (100, 0, 1), (50, -2, 1), (100, 0, 1)])
    later = time_s > 150 + rest_s
    return log(time_s + 4000.0 * later, current_A, np.where(later, after_V, 3.7), "gapped")


def test_a_gap_of_unknown_charge_divides_the_log():
    records = make_records(gapped(3.6), 2.0)
    assert len(records) == 2 and "divided at 1 gap" in records[0].charge.notes[0].text
    assert records[0].log.time_s[-1] < 4000 < records[1].log.time_s[0]


def test_rows_every_minute_fill_a_log_of_the_changes_of_its_current():
    """As the warning advises: a discharge of an hour, at both ends of which a second has its own row."""
    changes = log(np.array([0.0, 1, 2, 3602, 3603, 3604, 3605]), np.array([0.0, 0, -2, -2, 0, 0, 0]))
    with pytest.raises(InputError, match=r"0 of 2 parts are used; .* add rows of it every 60 s without a voltage"):
        make_records(changes, 2.0)
    time_s = np.union1d(changes.time_s, np.arange(62.0, 3602.0, 60.0))
    at = np.searchsorted(changes.time_s, time_s, side="right") - 1
    voltage_V = np.where(np.isin(time_s, changes.time_s), 3.7, np.nan)
    (record,) = make_records(log(time_s, changes.current_A[at], voltage_V), 2.0)
    assert record.charge.total_Ah[-1] == pytest.approx(-2.0 * 3601 / 3600, rel=1e-12)


def test_a_long_stretch_without_a_current_is_a_gap_and_no_rest():
    time_s = np.arange(0.0, 3000.0)
    current_A = np.where((time_s >= 500) & (time_s < 2000), np.nan, -2.0)
    records = make_records(log(time_s, current_A), 2.0)
    assert [record.log.time_s[0] for record in records] == [0.0, 2000.0]
    assert [phase.kind for record in records for phase in record.phases] == ["constant", "constant"]


def test_samples_without_a_current_at_the_end_are_left_out():
    time_s = np.arange(0.0, 1000.0)
    (record,) = make_records(log(time_s, np.where(time_s < 500, -2.0, np.nan)), 2.0)
    assert record.log.time_s[-1] == 499.0


def test_a_short_hole_in_a_current_is_no_rest():
    time_s = np.arange(0.0, 1000.0)
    (record,) = make_records(log(time_s, np.where((time_s > 500) & (time_s < 560), np.nan, -2.0)), 2.0)
    assert [phase.kind for phase in record.phases] == ["constant"]


def test_a_gap_at_rest_and_the_same_voltage_divides_nothing():
    assert len(make_records(gapped(3.7), 2.0)) == 1


def test_a_voltage_that_has_not_settled_tells_nothing_of_a_gap():
    """It would have risen after the discharge: the same or a higher one may hide another discharge."""
    for after_V, came_from in ((3.7, 0), (3.75, 0), (3.6, -1)):
        records = make_records(gapped(after_V, rest_s=100), 2.0)
        assert [record.came_from for record in records] == [0, came_from]
    _, charged = make_records(gapped(3.75), 2.0)
    assert charged.came_from == 1


def test_a_part_of_a_pulse_test_is_a_pulse_test():
    pulses = [(50, 0, 1), (20, -2, 1)]
    time_s, current_A = steps([*(5 * pulses), (700, 0, 1), *pulses, (50, 0, 1)])
    later = time_s > 700
    parts = make_records(log(time_s + 4000.0 * later, current_A, np.where(later, 3.5, 3.7), "pulses"), 2.0)
    assert [part.test for part in parts] == ["pulses", "pulses"]


def test_the_noise_of_a_current_is_that_of_its_rests_and_steady_loads():
    time_s, current_A = steps([(400, 0, 1), (300, -2, 1), (400, 0, 1)])
    noisy_A = current_A + 2e-3 * np.random.default_rng(1).standard_normal(time_s.size)
    (record,) = make_records(log(time_s, noisy_A), 2.0)
    assert current_noise_A(record) == pytest.approx(2e-3, rel=0.1)
