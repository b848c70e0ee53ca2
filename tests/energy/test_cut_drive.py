"""Stretches of a recorded drive, and of one as it goes on: the same, and nothing lost in between."""

import numpy as np
import pytest

from ohmward.energy.cut_drive import DriveMeter, DriveSample, advance, cut_drive
from ohmward.errors import InputError

T = np.arange(0.0, 301.0)


def metered(speed, power, terrain="grass", grade=None, time_s=T):
    """Stretches and energies of a drive, and the meter at its end."""
    meter, found = DriveMeter(), []
    grade = np.zeros(len(time_s)) if grade is None else grade
    names = [terrain] * len(time_s) if isinstance(terrain, str) else terrain
    for row in zip(time_s.tolist(), speed.tolist(), power.tolist(), grade.tolist(), names, strict=True):
        meter, finished = advance(meter, DriveSample(*row))
        found += finished
    end = DriveSample(float(time_s[-1]) + 1e6, 0.0, 0.0, 0.0, "")
    return found + advance(meter, end)[1]


def recorded(speed, power, grade=None):
    return cut_drive(T, speed, power, "grass", grade)


both = pytest.mark.parametrize("cut", [recorded, metered])


def test_a_drive_on_two_terrains_with_a_stop():
    speed = np.where(T < 100, 0.5, np.where(T < 160, 0.0, 0.8))
    power = np.where(speed > 0, 30.0, 8.0)
    terrain = np.where(T < 200, "grass", "gravel")
    found = cut_drive(T, speed, power, terrain)
    assert {d.stretch.terrain for d in found} == {"grass", "gravel", ""}
    assert sum(d.stretch.time_s for d in found) == pytest.approx(300.0)
    assert sum(d.energy_J for d in found) == pytest.approx(np.trapezoid(power, T))
    assert sum(d.stretch.distance_m for d in found) == pytest.approx(np.trapezoid(speed, T))
    assert sum(d.stretch.speed_distance_m2_s for d in found) == pytest.approx(np.trapezoid(speed**2, T))
    standing = [d for d in found if not d.stretch.terrain]
    assert sum(d.stretch.time_s for d in standing) == pytest.approx(59.0)
    assert max(d.stretch.time_s for d in found) <= 180.0


@both
def test_short_stops_belong_to_the_drive(cut):
    speed = np.where((T > 50) & (T < 54), 0.0, 0.5)
    found = cut(speed, np.full(301, 20.0))
    assert all(d.stretch.terrain for d in found)
    assert sum(d.stretch.standing_s for d in found) == 2.0


@both
def test_time_at_a_charger_is_left_out_until_the_robot_moves(cut):
    speed = np.where((T < 50) | (T > 260), 0.5, 0.0)
    power = np.where(speed > 0.0, 20.0, np.where(T < 200, -60.0, 0.0))  # full at 200 s, still connected
    assert [d.stretch.terrain for d in cut(speed, power)] == ["grass", "grass"]


@both
def test_heights_of_a_hill_without_the_noise_of_the_pitch(cut):
    noise = 0.03 * np.random.default_rng(0).standard_normal(301)
    grade = np.where(T < 150, 0.1, -0.05) + noise
    found = cut(np.full(301, 0.5), np.full(301, 20.0), grade=grade)
    assert sum(d.stretch.climb_m for d in found) == pytest.approx(7.5 * np.sin(0.1) * 10, rel=0.08)
    assert sum(d.stretch.descent_m for d in found) == pytest.approx(7.5 * np.sin(0.05) * 10, rel=0.15)


@both
def test_backward_up_a_hill_the_nose_is_down(cut):
    found = cut(np.full(301, -0.5), np.full(301, 20.0), grade=np.full(301, -0.1))
    assert sum(d.stretch.climb_m for d in found) == pytest.approx(150.0 * np.sin(0.1))
    assert sum(d.stretch.distance_m for d in found) == pytest.approx(150.0)


def test_speed_that_is_won_is_kinetic_energy():
    (found,) = cut_drive(T[:100], 0.1 + 0.005 * T[:100], np.full(100, 20.0), "grass")
    assert found.stretch.kinetic_m2_s2 == pytest.approx(0.5 * (0.595**2 - 0.1**2))


def test_gaps_are_left_out_and_short_ones_bridged():
    power = np.full(301, 20.0)
    power[100:150] = np.nan
    power[200:203] = np.nan
    found = cut_drive(T, np.full(301, 0.5), power, "grass")
    assert sum(d.stretch.time_s for d in found) == pytest.approx(300.0 - 51.0)


def test_the_payload_is_that_of_the_drive():
    assert all(d.stretch.payload_kg == 5.0 for d in cut_drive(T, T * 0 + 0.5, T * 0 + 9.0, "a", payload_kg=5.0))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((T, T[1:], T, "grass"), "length of time_s"),
        ((T[:1], T[:1], T[:1], "grass"), "at least 2 samples"),
        ((T, T, np.full(301, np.nan), "grass"), "no stretch: speed and battery power"),
    ],
)
def test_what_is_refused(arguments, message):
    with pytest.raises(InputError, match=message):
        cut_drive(*arguments)


def test_a_drive_on_two_terrains_with_a_stop_is_that_of_the_recorded_one():
    speed = np.where(T < 100, 0.5, np.where(T < 160, 0.0, 0.8))
    power = np.where(speed > 0, 30.0, 8.0)
    terrain = np.where(T < 200, "grass", "gravel").tolist()
    found = metered(speed, power, terrain)
    assert [m.stretch.terrain for m in found] == ["grass", "", "grass", "gravel"]
    for m, d in zip(found, cut_drive(T, speed, power, terrain), strict=True):
        assert m.stretch == pytest.approx(d.stretch)
        assert m.energy_J == pytest.approx(d.energy_J)


def test_a_long_stand_is_cut_too():
    found = metered(0.0 * T, np.full(301, 8.0))
    assert [m.stretch.terrain for m in found] == ["", ""]
    assert sum(m.energy_J for m in found) == pytest.approx(8.0 * 300.0)


def test_what_was_not_measured_is_left_out():
    power = np.full(301, 20.0)
    power[100:150] = np.nan
    found = metered(np.full(301, 0.5), power)
    assert [m.stretch.time_s for m in found] == [99.0, 150.0]
    gap = np.delete(T, slice(100, 150))
    assert [m.stretch.time_s for m in metered(np.full(251, 0.5), np.full(251, 20.0), time_s=gap)] == [99.0, 150.0]


def test_missing_samples_are_bridged_as_in_a_recorded_drive():
    speed = np.where(T < 100, 0.5, 0.8)
    power = np.where(T < 200, 20.0, 30.0)
    speed[1::2], power[50:58] = np.nan, np.nan
    recorded = cut_drive(T, speed, power, "grass")
    found = metered(speed, power)
    assert sum(m.stretch.time_s for m in found) == sum(d.stretch.time_s for d in recorded) == 300.0
    assert sum(m.stretch.distance_m for m in found) == pytest.approx(sum(d.stretch.distance_m for d in recorded))
    assert sum(m.energy_J for m in found) == pytest.approx(sum(d.energy_J for d in recorded), rel=1e-3)


def test_a_robot_that_stands_between_two_gaps_stands():
    speed = np.full(301, 0.5)
    speed[100:103] = 1e-9
    speed[80:100] = speed[103:120] = np.nan
    power = np.full(301, 20.0)
    found = metered(speed, power)
    assert [m.stretch.terrain for m in found] == ["grass", "", "grass"]
    assert found[1].stretch.time_s == 2.0 and found[1].energy_J == pytest.approx(40.0)
    assert [d.stretch for d in cut_drive(T, speed, power, "grass")] == [m.stretch for m in found]


def test_a_short_stop_before_a_gap_belongs_to_the_stretch_before_it():
    speed = np.full(301, 0.5)
    speed[100:103] = 0.0
    speed[103:120] = np.nan
    found = metered(speed, np.full(301, 20.0))
    assert [(m.stretch.terrain, m.stretch.standing_s) for m in found] == [("grass", 2.0), ("grass", 0.0)]
