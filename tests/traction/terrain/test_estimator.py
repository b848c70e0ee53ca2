"""Slip on floors live: the step of the log, through a restart, and through all that sensors and clocks can do."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from ohmward.errors import InputError
from ohmward.traction import RLMA
from ohmward.traction.motion.sample import RobotSample
from ohmward.traction.terrain.slip_on_floors import (
    FloorEstimate,
    FloorFlag,
    FloorSlipEstimator,
    floor_samples,
    slip_on_floors,
)
from traction.terrain.drives import OMNI, SMOOTH, SOFT, omni_drive
from traction.terrain.whole_log import whole_log

FLOORS = slip_on_floors(OMNI, (SMOOTH, SOFT))
LATE = slice(100, None)
#: Fields that are a number at every moving sample.
ALWAYS = ("rim", "motion", "motion_std", "speed_m_s", "speed_std_m_s", "force_N", "floor_probability", "drag_after")


def live(lowering="python"):
    """A new estimator; those in Python share what is traced and compiled."""
    estimator = FloorSlipEstimator(FLOORS, lowering)
    if lowering == "python":
        estimator._kernel = kernel()
    return estimator


@cache
def kernel():
    return FLOORS.compiled("python")


def drive(seed=1, seconds=8.0, later=None):
    return omni_drive([SOFT] * 3, 20.0, seconds=seconds, rng=np.random.default_rng(seed), later=later).log


def samples_of(log):
    """As lists that a test may spoil."""
    return RobotSample(*(np.array(values) for values in floor_samples(log, OMNI)))


def watch(samples, estimator=None):
    """Estimates (T, ...) of live samples."""
    estimator = estimator or live()
    T = len(samples.dt_s)
    columns = (values if np.ndim(values) else np.full(T, values) for values in samples)
    found = [estimator.step(RobotSample(*row)) for row in zip(*columns, strict=True)]
    return FloorEstimate(*(np.array(values) for values in zip(*found, strict=True)))


def has(estimates, flag):
    return (estimates.flags.astype(int) & flag) > 0


def true_slip(log_drive):
    return 1 - np.hypot(*log_drive.motion[LATE, :2].mean(axis=0)) / 0.15


def test_live_samples_and_a_log_give_the_same_to_the_bit():
    log = drive(later=[SOFT, SMOOTH, SOFT])
    track, single = live().run(log), watch(samples_of(log))
    for name in FloorEstimate._fields:
        assert_array_equal(getattr(single, name), getattr(track, name), err_msg=name)
    assert [c.time_s for c in track.crossings] == log.time_s[single.crossing > 0].tolist()
    assert len(track.crossings) == 1


@pytest.mark.slow
def test_machine_code_gives_the_same_but_for_rounding():
    pytest.importorskip("llvmlite")
    log = drive(later=[SOFT, SMOOTH, SOFT])
    python, machine = watch(samples_of(log)), watch(samples_of(log), live("machine"))
    for name in FloorEstimate._fields:
        assert_allclose(getattr(machine, name), getattr(python, name), rtol=1e-6, atol=1e-7, err_msg=name)


def test_a_step_on_floats_is_the_compiled_one():
    samples = samples_of(drive(seconds=0.6))
    compiled, state = watch(samples), None
    for k, row in enumerate(zip(*samples, strict=True)):
        state = FLOORS.init(RobotSample(*row)) if state is None else state
        state, estimate = FLOORS.step(state, RobotSample(*row))
        assert_allclose(estimate.slip_ratio, compiled.slip_ratio[k], rtol=1e-12)
        assert_allclose(estimate.floor_probability, compiled.floor_probability[k], rtol=1e-9, atol=1e-30)


@pytest.mark.parametrize("later", [None, [SOFT, SMOOTH, SOFT], [SMOOTH] * 3])
def test_it_is_what_whole_arrays_give(later):
    log = drive(seed=12, seconds=6.0, later=later)
    track, (slip, std, share, crossed) = live().run(log), whole_log(FLOORS, log)
    assert_allclose(track.travel_slip[LATE], slip[LATE], atol=0.01)
    assert_allclose(track.travel_slip_std[LATE], std[LATE], atol=0.01)
    assert np.abs(track.floor_probability[LATE] - share[LATE]).mean() < 0.01
    assert_allclose([c.time_s for c in track.crossings], crossed, atol=0.1)
    assert (len(crossed) > 0) == (later is not None)


def test_a_log_in_two_parts_is_the_log():
    log, estimator = drive(), live()
    parts = [estimator.run(log.select(slice(0, 90))), estimator.run(log.select(slice(90, None)))]
    whole = live().run(log)
    assert_array_equal(np.concatenate([p.travel_slip_std for p in parts]), whole.travel_slip_std)
    assert estimator.time_s == log.time_s[-1]


def test_samples_may_follow_a_log():
    log, estimator = drive(), live()
    estimator.run(log.select(slice(0, 90)))
    rest = RobotSample(*(values[90:] for values in samples_of(log)))
    assert_array_equal(watch(rest, estimator).speed_m_s, live().run(log).speed_m_s[90:])


def test_a_restart_from_a_snapshot_goes_on_to_the_bit():
    log, before = drive(), live()
    before.run(log.select(slice(0, 90)))
    taken = json.loads(json.dumps(before.snapshot(), allow_nan=False))
    after = FloorSlipEstimator.restore(FLOORS, taken, lowering="python")
    rest = log.select(slice(90, None))
    ours, theirs = after.run(rest), before.run(rest)
    assert_array_equal(ours.travel_slip, theirs.travel_slip)
    assert_array_equal(ours.floor_probability, theirs.floor_probability)
    assert_array_equal(ours.crossing_delay_s, theirs.crossing_delay_s)


def test_a_snapshot_of_other_floors_is_refused():
    with pytest.raises(InputError, match="before the first sample"):
        live().snapshot()
    estimator = live()
    estimator.run(drive(seconds=0.3))
    other = slip_on_floors(OMNI, (SMOOTH, replace(SOFT, stiffness=3.1)))
    with pytest.raises(InputError, match="another kind, model or settings"):
        FloorSlipEstimator.restore(other, estimator.snapshot())


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e30])
@pytest.mark.parametrize("column", ["wheel_speed_rad_s", "current_A"])
def test_numbers_that_are_none_are_missed_and_the_band_holds(column, value):
    known = omni_drive([SOFT] * 3, 20.0, rng=np.random.default_rng(1))
    samples = samples_of(known.log)
    getattr(samples, column)[150:180, 0] = value
    e, clean = watch(samples), watch(samples_of(known.log))
    flag = FloorFlag.NO_CURRENT if column == "current_A" else FloorFlag.NO_ENCODER
    assert_array_equal(np.flatnonzero(has(e, flag)), np.arange(150, 180))
    assert np.all(np.abs(e.travel_slip - true_slip(known))[LATE] < 4 * e.travel_slip_std[LATE])
    assert e.speed_std_m_s[179] > 1.1 * clean.speed_std_m_s[179]
    assert_allclose(e.travel_slip[-20:], clean.travel_slip[-20:], atol=0.01)


@pytest.mark.parametrize("dt_s", [-1.0, np.nan, np.inf, -np.inf, 1e9])
def test_clocks_that_run_backwards_or_jump_are_stopped_for_a_sample(dt_s):
    samples = samples_of(drive())
    samples.dt_s[150] = 0.0
    stands = watch(samples)
    samples.dt_s[150] = dt_s
    estimator = live()
    jumps = watch(samples, estimator)
    assert_array_equal(jumps.travel_slip_std, stands.travel_slip_std)
    assert_array_equal(np.flatnonzero(has(jumps, FloorFlag.BAD_TIME)), [150])
    assert not has(stands, FloorFlag.BAD_TIME).any()
    assert estimator.time_s == pytest.approx(np.sum(np.delete(samples.dt_s, 150)))


def test_sensors_with_messages_of_their_own_come_at_one_time():
    """An encoder's message and a motor's of the same time, one after the other, are one sample."""
    samples = samples_of(drive(seconds=3.0))
    T = len(samples.dt_s)
    apart = RobotSample(*(np.repeat(values, 2, axis=0) for values in samples))
    apart.dt_s[1::2] = 0.0
    apart.current_A[::2] = np.nan
    apart.wheel_speed_rad_s[1::2] = np.nan
    both, one = watch(apart), watch(samples)
    assert_allclose(both.rim[1::2], one.rim, rtol=1e-6, atol=1e-9)
    assert_allclose(both.force_N[1::2], one.force_N, rtol=1e-3, atol=1e-3)
    assert has(both, FloorFlag.NO_CURRENT).sum() == has(both, FloorFlag.NO_ENCODER).sum() == T


def test_samples_may_come_at_any_time():
    """Every third sample of a drive at 100 Hz, or some at random, are the same drive."""
    log, rng = omni_drive([SOFT] * 3, 20.0, later=[SOFT, SMOOTH, SOFT]).log, np.random.default_rng(7)
    fine = np.arange(0.0, log.time_s[-1], 0.01)
    rows = np.searchsorted(log.time_s, fine, side="right") - 1
    noisy = RobotSample(
        np.diff(fine, prepend=0.0),
        log.wheel_speed_rad_s[rows] + rng.normal(0.0, 0.1, (fine.size, 3)),
        log.motor_current_A[rows] + rng.normal(0.0, 0.15, (fine.size, 3)),
    )
    found = []
    for kept in (np.arange(fine.size), np.arange(0, fine.size, 3), np.sort(rng.choice(fine.size, 250, replace=False))):
        e = watch(RobotSample(np.diff(fine[kept], prepend=fine[kept[0]]), noisy[1][kept], noisy[2][kept]))
        at = fine[kept][e.crossing > 0]
        assert at.shape == (1,) and 4.0 < at[0] < 5.0
        found.append([np.mean(e.travel_slip[(fine[kept] > a) & (fine[kept] < b)]) for a, b in ((2.5, 4.0), (5.5, 7.9))])
    assert_allclose(found[1:], [found[0]] * 2, atol=0.015)


def test_a_sample_of_other_wheels_is_refused():
    with pytest.raises(InputError, match=r"wheel_speed_rad_s must have the shape \(3,\) .* got \(4,\)"):
        live().step(RobotSample(0.03, np.ones(4), np.ones(3)))


def test_a_gap_is_flagged_and_one_sample_after_it_is_one_look():
    samples = samples_of(drive())
    samples.dt_s[150] = 20.0
    e = watch(samples)
    assert_array_equal(np.flatnonzero(has(e, FloorFlag.GAP)), [150])
    assert not e.crossing.any()
    assert_allclose(e.travel_slip[-20:], watch(samples_of(drive())).travel_slip[-20:], atol=0.02)


def test_an_encoder_that_repeats_itself_while_others_move_is_not_used_until_it_moves():
    samples = samples_of(drive(seconds=15.0))
    samples.wheel_speed_rad_s[150:300, 0] = samples.wheel_speed_rad_s[149, 0]
    e = watch(samples)
    stopped = np.flatnonzero(has(e, FloorFlag.ENCODER_STOPPED))
    assert stopped[0] == pytest.approx(150 + 2.0 / 0.03, abs=1.5) and stopped[-1] == 299
    assert not has(e, FloorFlag.ENCODER_STOPPED)[300:].any()
    assert e.motion_std[299, 0] > 3 * e.motion_std[149, 0]
    assert_allclose(e.travel_slip[-50:], watch(samples_of(drive(seconds=15.0))).travel_slip[-50:], atol=0.01)


def test_wheels_that_turn_evenly_or_stand_are_no_stopped_encoders():
    assert not has(watch(samples_of(omni_drive([SOFT] * 3, 20.0).log)), FloorFlag.ENCODER_STOPPED).any()
    samples = samples_of(drive())
    samples.wheel_speed_rad_s[:, 2] = 0.0
    e = watch(samples)
    assert not has(e, FloorFlag.ENCODER_STOPPED).any()
    assert_finite(e)


def test_without_a_motor_current_the_band_opens_until_nothing_is_known():
    samples = samples_of(drive(seconds=30.0))
    samples.current_A[100:, 1] = np.nan
    e = watch(samples)
    assert e.slip_ratio_std[-1, 1] > 5 * e.slip_ratio_std[99, 1]
    assert e.slip_ratio_std[-1, 0] < 2 * e.slip_ratio_std[99, 0]
    assert_finite(e)


def test_a_first_sample_without_encoders_starts_from_the_next():
    samples = samples_of(drive())
    samples.wheel_speed_rad_s[:3] = np.nan
    e = watch(samples)
    assert has(e, FloorFlag.MOTION_UNKNOWN)[:3].all() and not has(e, FloorFlag.MOTION_UNKNOWN)[4:].any()
    assert_allclose(e.travel_slip[LATE], watch(samples_of(drive())).travel_slip[LATE], atol=0.005)


def test_a_robot_that_stands_has_no_slip_ratio_and_learns_no_floor():
    samples = samples_of(drive())
    samples.wheel_speed_rad_s[:] = samples.current_A[:] = 0.0
    e = watch(samples)
    assert has(e, FloorFlag.MOTION_UNKNOWN).all() and np.isnan(e.travel_slip).all()
    assert_allclose(e.floor_probability[-1, :, 0], e.floor_probability[-1, :, 1], rtol=1e-9)
    assert np.isinf(e.crossing_delay_s).all() and not e.crossing.any()


def assert_finite(e):
    for name in ALWAYS:
        assert np.isfinite(getattr(e, name)).all(), name
    assert_allclose(e.floor_probability.sum(axis=-1), 1.0, rtol=1e-9)


@pytest.mark.parametrize("method", ["ukf", "aukf", "ekf", "aekf"])
def test_nothing_that_a_sensor_can_say_makes_it_stop(method):
    rng = np.random.default_rng(5)
    garbage = np.array([np.nan, np.inf, -np.inf, 0.0, 1e30, -1e30, 1e-300, 400.0, -400.0, 5.0, -0.1])
    samples = samples_of(drive(seconds=30.0))
    for column in samples:
        spoilt = rng.random(column.shape) < 0.05
        column[spoilt] = rng.choice(garbage, spoilt.sum())
    e = watch(samples, FloorSlipEstimator(slip_on_floors(OMNI, (SMOOTH, SOFT), method), "python"))
    assert_finite(e)


def test_a_robot_with_two_driven_wheels_and_no_floor():
    estimator = FloorSlipEstimator(slip_on_floors(RLMA), "python")
    speeds = np.full((100, 4), [3.0, 3.0, np.nan, np.nan])
    e = watch(RobotSample(np.full(100, 0.01), speeds, np.full((100, 2), 1.0)), estimator)
    assert e.floor_probability.shape == (100, 4, 1) and e.slip_ratio.shape == (100, 2)
    assert 0.0 < e.travel_slip[-1] < 0.2


def test_very_many_floors_are_not_compiled_by_themselves():
    many = [replace(SOFT, name=str(k)) for k in range(6)]
    assert FloorSlipEstimator(slip_on_floors(OMNI, many)).lowering == "python"
    assert FloorSlipEstimator(slip_on_floors(OMNI, many), "machine").lowering == "machine"
    assert FloorSlipEstimator(FLOORS).lowering is None
