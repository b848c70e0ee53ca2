"""Positions of wheels, in radians or degrees, that go on or start anew each turn."""

import math

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.logs import read_drive, write_table
from ohmward.logs.wheel_columns import even_times
from ohmward.traction import RLMA

T = 0.05 * np.arange(400)
SPEED = 4.0 + np.sin(T)
ANGLE = np.concatenate([[0.0], np.cumsum(0.05 * SPEED[1:])])


@pytest.mark.parametrize(
    ("unit", "angle"),
    [
        ("rad", ANGLE),
        ("deg", np.degrees(ANGLE)),
        ("rad", np.mod(ANGLE, 2 * np.pi)),
        ("rad", np.mod(-ANGLE + np.pi, 2 * np.pi) - np.pi),
    ],
)
def test_the_speed_is_the_change_of_the_position(unit, angle, tmp_path):
    names = [f"front_{side}_wheel_position_{unit}" for side in ("left", "right")]
    write_table({"time_s": T, **dict.fromkeys(names, angle)}, tmp_path / "drive.csv")
    log = read_drive(tmp_path / "drive.csv", RLMA)
    sign = -1.0 if angle[1] < angle[0] or angle.min() < -1 else 1.0
    measured = log.wheel_speed_rad_s[np.isin(log.time_s, T[1:]), :2]
    np.testing.assert_allclose(measured[-399:], sign * np.column_stack([SPEED, SPEED])[1:], rtol=1e-5)


def test_positions_without_a_unit_in_their_name(tmp_path):
    names = ["position[0]", "position[1]"]
    write_table({"time_s": T, **dict.fromkeys(names, ANGLE)}, tmp_path / "drive.csv")
    log = read_drive(tmp_path / "drive.csv", RLMA, units={"wheel_speed": "rad"})
    assert np.nanmax(np.abs(log.wheel_speed_rad_s[-399:, 0] - SPEED[1:])) < 1e-5


@pytest.mark.parametrize(("names", "unit_m"), [("s_{}_m", 1.0), ("{} distance (mm)", 1e-3), ("way_{}_cm", 1e-2)])
def test_the_way_of_each_wheel_tells_its_speed(names, unit_m, tmp_path):
    way = ANGLE * RLMA.wheel.radius_m / unit_m
    write_table({"time_s": T, **{names.format(side): way for side in ("left", "right")}}, tmp_path / "drive.csv")
    log = read_drive(tmp_path / "drive.csv", RLMA)
    np.testing.assert_allclose(log.wheel_speed_rad_s[-399:, :2], np.column_stack([SPEED, SPEED])[1:], rtol=1e-4)
    assert any("the way of a rim" in note.text for note in log.notes)


@pytest.mark.parametrize("per_turn", [60, 1440])
@pytest.mark.parametrize("back", [False, True])
def test_counts_since_the_last_row_are_added_up(per_turn, back, tmp_path):
    angle = np.cumsum(np.where(T > 10.0, -1.0 if back else 1.0, 1.0) * 0.05 * SPEED)
    counts = np.floor(angle / (2 * np.pi) * per_turn)
    names = ("left_ticks", "right_ticks")
    totals = []
    for column in (counts, np.diff(counts, prepend=0.0)):
        write_table({"time_s": T, **dict.fromkeys(names, column)}, tmp_path / "drive.csv")
        log = read_drive(tmp_path / "drive.csv", RLMA, counts_per_turn=per_turn)
        totals.append(log.wheel_speed_rad_s[-390:, 0])
        added = [note for note in log.notes if "counts since the previous row" in note.text]
        assert bool(added) == (column is not counts)
    np.testing.assert_allclose(totals[0], totals[1], atol=1e-6)


@pytest.mark.parametrize(("scale", "named"), [(1.0, True), (40.0, False)])
def test_counts_that_never_leave_zero_far_are_doubted(scale, named, tmp_path):
    """Counts since the last row of a drive to and fro, so smooth that they may be a wheel that hardly turns."""
    counts = np.round(scale * 100.0 * np.sin(0.3 * T))
    write_table({"time_s": T, "left_ticks": counts, "right_ticks": counts}, tmp_path / "drive.csv")
    log = read_drive(tmp_path / "drive.csv", RLMA, counts_per_turn=4096)
    doubts = [note for note in log.notes if "if these are counts since the previous row" in note.text]
    assert [note.level for note in doubts] == ["warning", "warning"] * named


STOPS = np.where(T % 5.0 < 4.0, SPEED, 0.0)


@pytest.mark.parametrize(
    ("names", "values", "doubted"),
    [
        ("{}_encoder", 1440 / (2 * np.pi) * STOPS, True),
        ("{}_encoder", 1440 / (2 * np.pi) * np.cumsum(0.05 * STOPS), False),
        ("PPS_{}", 1440 / (2 * np.pi) * STOPS, False),
    ],
)
def test_counts_that_return_to_zero_at_each_stop_are_those_of_a_second(names, values, doubted, tmp_path):
    """With the unit of the advice, or with it in the name, they show the speed."""
    write_table({"time_s": T, **{names.format(side): np.round(values) for side in ("L", "R")}}, tmp_path / "drive.csv")
    log = read_drive(tmp_path / "drive.csv", RLMA, counts_per_turn=1440)
    doubts = [note for note in log.notes if "returns to zero" in note.text]
    assert len(doubts) == 2 * doubted
    if doubted:
        key, _, unit = doubts[0].options[1].partition("=")
        log = read_drive(tmp_path / "drive.csv", RLMA, counts_per_turn=1440, units={key: unit})
    np.testing.assert_allclose(log.wheel_speed_rad_s[5:, 0], STOPS[-len(log.time_s) :][5:], atol=0.1)


def test_a_counter_that_rolls_over_within_a_turn_is_not_added_up(tmp_path):
    counts = np.mod(np.floor(40.0 * ANGLE), 256)
    write_table({"time_s": T, "left_ticks": counts, "right_ticks": counts}, tmp_path / "drive.csv")
    log = read_drive(tmp_path / "drive.csv", RLMA, counts_per_turn=4096)
    assert not any("counts since the previous row" in note.text for note in log.notes)


@pytest.mark.parametrize(("unit", "scale"), [("rpm", 30 / np.pi), ("rad_s", 1.0)])
def test_wheels_that_report_in_turns_are_known_at_once(unit, scale, tmp_path):
    speed = np.interp(T, T, SPEED)
    turn = np.arange(T.size) % 3
    columns = {f"{side}_{unit}": np.where(turn == k, scale * speed, np.nan) for k, side in enumerate(("left", "right"))}
    yaw = {"gyro_z_rad_s": np.where(turn == 2, 0.0, np.nan)}
    write_table({"time_s": T, **columns, **yaw}, tmp_path / "drive.csv")
    log = read_drive(tmp_path / "drive.csv", RLMA)
    both = np.isfinite(log.wheel_speed_rad_s[:, :2]).all(axis=1)
    assert np.count_nonzero(both) > 130
    expected = 4.0 + np.sin(log.time_s[both])
    np.testing.assert_allclose(log.wheel_speed_rad_s[both, :2], np.column_stack([expected] * 2), atol=0.01)


@pytest.mark.parametrize(
    ("name", "warns"), [("vel_left", True), ("velL", True), ("left_rad_s", False), ("v_left", False)]
)
def test_a_speed_that_is_only_a_guess_is_a_warning(name, warns, tmp_path):
    right = name.replace("left", "right").replace("velL", "velR")
    write_table({"time_s": T, name: SPEED, right: SPEED}, tmp_path / "drive.csv")
    notes = read_drive(tmp_path / "drive.csv", RLMA).notes
    assert any(n.level == "warning" and "--unit wheel_speed=m/s" in n.text for n in notes) == warns


@pytest.mark.parametrize("held_up", [0.1, 0.6])
def test_positions_that_arrive_in_bursts_lose_no_way_and_show_no_spike(held_up, tmp_path):
    """A share of the rows waits for up to half a second; those that came meanwhile arrive with it."""
    rng = np.random.default_rng(1)
    waited_s = np.where(rng.random(T.size) < held_up, rng.uniform(0.0, 0.5, T.size), 0.002)
    arrived_s = np.maximum.accumulate(T + waited_s) + 1e-4 * np.arange(T.size)
    names = [f"front_{side}_wheel_position_rad" for side in ("left", "right")]
    write_table({"time_s": arrived_s, **dict.fromkeys(names, ANGLE)}, tmp_path / "drive.csv")
    log = read_drive(tmp_path / "drive.csv", RLMA)
    speed = log.wheel_speed_rad_s[:, 0]
    turned = np.nansum(speed * np.diff(log.time_s, prepend=log.time_s[0]))
    assert turned == pytest.approx(ANGLE[-1] - ANGLE[1], abs=1e-6)
    assert np.nanmax(speed) < 1.25 * SPEED.max()
    assert any("arrived in bursts" in note.text for note in log.notes)


@pytest.mark.parametrize("together", [2, 3, 7])
def test_bursts_of_equal_size_are_spread_over_the_time_in_which_they_were_measured(together):
    """Rows are measured every 0.05 s and arrive with the last one of their burst."""
    last = np.minimum(together * (np.arange(T.size) // together + 1) - 1, T.size - 1)
    even_s = even_times(T[last] + 2e-4 * (np.arange(T.size) % together))
    assert np.abs(even_s - T).max() < 0.01


def test_positions_that_come_evenly_or_with_pauses_keep_their_times(tmp_path):
    kept = (T < 3.0) | (T > 5.0)
    names = [f"front_{side}_wheel_position_rad" for side in ("left", "right")]
    write_table({"time_s": T[kept], **dict.fromkeys(names, ANGLE[kept])}, tmp_path / "drive.csv")
    log = read_drive(tmp_path / "drive.csv", RLMA)
    assert not any("bursts" in note.text for note in log.notes)
    np.testing.assert_allclose(np.diff(log.time_s)[:50], 0.05, rtol=1e-9)


def test_counts_a_second_are_a_speed(tmp_path):
    (tmp_path / "drive.csv").write_text("t,left_tps,right_tps\n" + "".join(f"{k / 20},2048,-1024\n" for k in range(9)))
    with pytest.raises(InputError, match="say how far with --counts-per-turn"):
        read_drive(tmp_path / "drive.csv", RLMA)
    log = read_drive(tmp_path / "drive.csv", RLMA, counts_per_turn=2048)
    np.testing.assert_allclose(log.wheel_speed_rad_s[:, :2], [[2 * math.pi, -math.pi]] * 9, rtol=1e-15)
