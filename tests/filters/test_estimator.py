"""The live shell, with an estimator of charge, of slip and of slip on floors in it."""

import copy
import json
import math
import pickle
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from ohmward.battery.chemistries import generic_battery
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.battery.soc.sample import SocEstimate, SocFlag, SocSample
from ohmward.errors import InputError
from ohmward.filters.estimator import LiveEstimator, number, numbers
from ohmward.logs import DriveLog, Log
from ohmward.traction import RLMA, ROBOTINO, hard_terrain, scene
from ohmward.traction.motion.sample import RobotSample
from ohmward.traction.robot.packaged import PACKAGED
from ohmward.traction.speed_observer.estimator import SlipEstimator
from ohmward.traction.speed_observer.speed_observer import SpeedObserver
from ohmward.traction.speed_observer.states import KNOWN_GROUND
from ohmward.traction.terrain.floor import Floor
from ohmward.traction.terrain.slip_on_floors import FloorSlipEstimator, slip_on_floors

BATTERY = generic_battery("lfp", 12.0, n_series=4)
OBSERVER = SpeedObserver(scene(RLMA, hard_terrain("gravel")), KNOWN_GROUND, method="ekf")
FLOORS = slip_on_floors(ROBOTINO, [Floor("carpet", friction=1.4, stiffness=3.0, rolling=0.1, roller=0.2)], "ekf")
T = 60
TIME_S = 100.0 + 0.02 * np.arange(T)
RNG = np.random.default_rng(2)


class Subject(NamedTuple):
    """An estimator, arguments of `update` at every time, the same as records, and a log of them."""

    kind: type[LiveEstimator]
    settings: Any
    values: list[tuple]
    record: type
    log: Any

    def new(self, lowering: str | None = "python") -> Any:
        return self.kind(self.settings, lowering=lowering)


def subjects() -> dict[str, Subject]:
    current, voltage = RNG.normal(-3.0, 1.0, T), RNG.normal(13.1, 0.02, T)
    wheels, motors = RNG.normal(3.0, 0.05, (T, 2)), RNG.normal(0.5, 0.1, (T, 2))
    four = np.hstack([wheels, np.full((T, 2), math.nan)])
    rims, torques = RNG.normal([-2.0, 0.0, 2.0], 0.05, (T, 3)), RNG.normal([-1.0, 0.0, 1.0], 0.1, (T, 3))
    soc_rows = [(float(i), float(v)) for i, v in zip(current, voltage, strict=True)]
    return {
        "soc": Subject(SocEstimator, BATTERY, soc_rows, SocSample, Log("log", TIME_S, current, voltage)),
        "slip": Subject(
            SlipEstimator,
            OBSERVER,
            list(zip(wheels, motors, strict=True)),
            RobotSample,
            DriveLog("log", TIME_S, four, motors),
        ),
        "floors": Subject(
            FloorSlipEstimator,
            FLOORS,
            list(zip(rims, torques, strict=True)),
            RobotSample,
            DriveLog("log", TIME_S, rims, torques),
        ),
    }


SUBJECTS = subjects()
each = pytest.mark.parametrize("subject", SUBJECTS.values(), ids=SUBJECTS.keys())


def live(estimator, subject, rows=slice(None)):
    times = TIME_S[rows].tolist()
    return [estimator.update(t, *values) for t, values in zip(times, subject.values[rows], strict=True)]


def assert_equal(found, expected):
    for ours, theirs in zip(found, expected, strict=True):
        for a, b in zip(ours, theirs, strict=True):
            assert_array_equal(a, b)


@each
def test_a_log_at_once_is_its_samples_one_by_one(subject):
    run = subject.new().run(subject.log)
    assert_equal(zip(*live(subject.new(), subject), strict=True), run.estimates)
    assert_array_equal(run.time_s, TIME_S)


@each
@pytest.mark.parametrize("duplicate", [copy.copy, copy.deepcopy, lambda e: pickle.loads(pickle.dumps(e))])
@pytest.mark.parametrize("lowering", ["python", "machine"])
def test_a_copy_goes_on_to_the_bit_and_by_itself(subject, duplicate, lowering):
    if lowering == "machine" and subject.kind is FloorSlipEstimator:
        pytest.skip("takes seconds to compile, and is not of another kind")
    estimator = subject.new(lowering)
    live(estimator, subject, slice(0, 30))
    twin = duplicate(estimator)
    ours = live(twin, subject, slice(30, T))
    assert_equal(ours, live(estimator, subject, slice(30, T)))
    assert twin.snapshot() == estimator.snapshot()


@each
def test_a_restored_one_goes_on_to_the_bit(subject):
    estimator = subject.new()
    live(estimator, subject, slice(0, 30))
    taken = json.loads(json.dumps(estimator.snapshot(), allow_nan=False))
    again = subject.kind.restore(subject.settings, taken, lowering="python")
    assert_equal(live(again, subject, slice(30, T)), live(estimator, subject, slice(30, T)))


@each
def test_what_is_no_snapshot_is_refused(subject):
    with pytest.raises(InputError, match=r"the dict that snapshot\(\) returned, got str"):
        subject.kind.restore(subject.settings, "state.json")


@each
def test_flags_are_printed_by_name_and_are_numbers(subject):
    estimator = subject.new()
    live(estimator, subject, slice(0, 3))
    missing = [None] * len(np.atleast_1d(subject.values[3][1]))
    values = (None, 13.1) if subject.kind is SocEstimator else (subject.values[3][0], missing)
    estimator.update(TIME_S[3], *values)  # a current that is missing once may hold for its usual interval
    flags = estimator.update(TIME_S[3] - 1.0, *values).flags
    kind = estimator.flag_type
    assert flags == kind["BAD_TIME"] | kind["NO_CURRENT"] and isinstance(flags, kind)
    assert set(str(flags).split("|")) == set(f"{flags}".split("|")) == {"BAD_TIME", "NO_CURRENT"}
    assert repr(flags) == f"{kind.__name__}.{flags}"
    assert json.loads(json.dumps(flags)) == int(flags)
    assert str(kind(0)) == "0"


@each
@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_state_that_is_no_number_is_started_again_and_says_so(subject, value):
    estimator = subject.new()
    live(estimator, subject, slice(0, 30))
    estimator.state = spoilt(estimator.state, value)
    found = live(estimator, subject, slice(30, T))
    assert ["RESTARTED" in str(e.flags) for e in found] == [True] + [False] * 29
    assert all(np.isfinite(e[k]).all() for e in found for k in estimator.known)


@each
def test_a_run_from_a_state_that_is_no_number_starts_again_and_says_so(subject):
    estimator = subject.new()
    live(estimator, subject, slice(0, 2))
    estimator.state = spoilt(estimator.state, math.nan)
    run = estimator.run(subject.log)
    assert run.counts()["restarted"] == 1
    assert run.flags[0] & estimator.flag_type["RESTARTED"]
    assert all(np.isfinite(run.estimates[k]).all() for k in estimator.known)


def test_a_state_that_is_lost_on_the_way_is_noticed_although_the_charge_is_known():
    """A resistance that is no number lets no voltage pass the gate, and would leave the charge to the counting."""
    estimator: Any = SocEstimator(BATTERY, 0.5, lowering="machine")
    live(estimator, SUBJECTS["soc"], slice(0, 30))
    state = estimator._live.state
    state.members[0].belief.mean[-2] = math.nan
    estimator._live.state = state
    now = estimator.update(TIME_S[30], -3.0, 13.1)
    assert now.flags & SocFlag.RESTARTED and math.isfinite(now.resistance_ratio)


def spoilt(state, value):
    """The state with one number of its first array replaced."""
    if isinstance(state, np.ndarray):
        changed = state.copy()
        changed.flat[0] = value
        return changed
    parts = (spoilt(state[0], value), *state[1:])
    return type(state)(*parts) if hasattr(state, "_fields") else parts


@each
def test_time_or_a_record_are_the_same(subject):
    by_time, by_record = subject.new(), subject.new()
    for k, values in enumerate(subject.values):
        t, before = 0.25 * k, 0.25 * max(k - 1, 0)
        expected = by_time.update(t, *values)
        if subject.kind is SlipEstimator:
            values = (np.append(values[0], [math.nan, math.nan]), values[1])
        nothing = by_record.no_sample()
        names = [name for name in nothing._fields if name != "dt_s"]
        record = nothing._replace(dt_s=t - before, **dict(zip(names, values, strict=False)))
        assert_equal([by_record.step(record)], [expected])
    assert by_time.time_s == by_record.time_s == 0.25 * (T - 1)


@each
def test_the_representation_says_what_it_is_and_what_it_knows(subject):
    estimator = subject.new()
    name = type(estimator).__name__
    assert repr(estimator).startswith(f"{name}(") and "±" not in repr(estimator)
    live(estimator, subject, slice(0, 2))
    assert "±" in repr(estimator)
    assert repr(SocEstimator(BATTERY, filter="UKF")) == "SocEstimator(ukf, lfp 12 Ah)"


@each
def test_a_run_shows_itself_in_a_line(subject):
    run = subject.new().run(subject.log)
    assert repr(run).startswith(f"{type(run).__name__}({T} samples in 1.18 s, flags ")
    assert len(repr(run)) < 200


@each
def test_a_run_as_a_table(subject):
    pandas = pytest.importorskip("pandas")
    run = subject.new().run(subject.log)
    frame = run.to_pandas()
    assert frame.index.name == "time_s" and len(frame) == T
    assert frame["flags"].dtype == int and pandas.api.types.is_float_dtype(frame.iloc[:, 0])
    if subject.kind is SlipEstimator:
        assert_array_equal(frame["slip_speed_m_s_1"], run.slip_speed_m_s[:, 1])
    assert run.estimates._fields[0] in dir(run)
    with pytest.raises(AttributeError, match=f"'{type(run).__name__}' object has no attribute 'sock'"):
        run.sock  # noqa: B018


def test_none_and_nan_are_missing_values():
    ours, theirs = SocEstimator(BATTERY, 0.5), SocEstimator(BATTERY, 0.5)
    for k, (i, v) in enumerate([(-3.0, 13.1), (None, 13.1), (-3.0, None), (None, None), (-3, float(np.float32(13.1)))]):
        nan = [math.nan if x is None else float(x) for x in (i, v)]
        assert_equal([ours.update(k, i, v, None)], [theirs.update(float(k), *nan)])
    assert isinstance(ours.last, SocEstimate)


def test_missing_wheels_and_motors():
    ours, theirs = SlipEstimator(OBSERVER, "python"), SlipEstimator(OBSERVER, "python")
    for k in range(3):
        found = ours.update(0.01 * k, [1.0, None], None if k else [0.5, None], yaw_rate_rad_s=None)
        wheels, motors = np.array([1.0, *[math.nan] * 3]), np.array([0.5 if k == 0 else math.nan, math.nan])
        assert_equal([found], [theirs.update(0.01 * k, wheels, motors, math.nan)])


#: Without their types, for what a type checker would refuse.
SOC: Any = SocEstimator
SLIP: Any = SlipEstimator


@pytest.mark.parametrize(
    ("update", "message"),
    [
        (lambda: SOC(BATTERY).update(0.0, "-3", 13.1), "current_A must be a number, or None .* got '-3'"),
        (lambda: SOC(BATTERY).update("now", -3.0, 13.1), "time_s must be a number"),
        (lambda: SOC(BATTERY).update(0.0, -3.0, [13.1, 13.2]), "voltage_V must be a number"),
        (lambda: SLIP(OBSERVER).update(0.0, [1.0, 2.0, 3.0]), r"must have the shape \(4,\) or \(2,\)"),
        (lambda: SLIP(OBSERVER).update(0.0, [1.0, "2"]), r"wheel_speed_rad_s\[1\] must be a number"),
        (lambda: SLIP(OBSERVER).update(0.0, 1.0), r"one number for each wheel or motor .* got \(\)"),
        (lambda: SLIP("rlmb"), f"robot must be a robot file or one of {', '.join(PACKAGED)}, got 'rlmb'"),
        (lambda: SLIP(7), "the path or name of one, got int"),
        (lambda: SLIP("rlma", terrain="cheese"), "terrain must be one of dry asphalt, .* got 'cheese'"),
        (lambda: SLIP("rlma", filter="pf"), "filter must be one of ekf, aekf, ukf, aukf, got 'pf'"),
        (lambda: SOC("battery.toml"), "must be a Battery or an estimator, got str; load_battery"),
        (lambda: SOC(BATTERY, filter="ekg"), "filter must be one of .*ekf.* got 'ekg'"),
        (lambda: SOC(BATTERY, initial_soc="full"), "initial_soc must be a number"),
        (lambda: SOC(BATTERY, lowering="gpu").update(0.0, 0.0, 13.0), "lowering must be one of"),
    ],
)
def test_what_cannot_be_used_is_refused_by_name(update, message):
    with pytest.raises(InputError, match=message):
        update()


def test_numbers_of_wheels():
    assert_array_equal(numbers("w", [1, 2], 4, 2), [1.0, 2.0, math.nan, math.nan])
    assert_array_equal(numbers("w", None, 4, 2), [math.nan] * 4)
    assert number("x", True) == 1.0


def test_a_packaged_robot_needs_no_log():
    estimator = SlipEstimator("rlma", terrain="gravel", filter="EKF", lowering="python")
    assert repr(estimator) == "SlipEstimator(ekf, RLMA on gravel)"
    now = [estimator.update(0.01 * k, [2.0, 2.0], [0.2, 0.2], yaw_rate_rad_s=0.0) for k in range(50)][-1]
    assert now.speed_m_s == pytest.approx(2.0 * RLMA.wheel.radius_m, rel=0.05)
    assert not now.flags


@dataclass
class Drift:
    """Settings that may change and hold a list, so that they have no hash."""

    rates: list[float]

    def init(self, first, soc=None, soc_std=0.03):
        return (0.5,)

    def step(self, state, sample):
        soc = state[0] + self.rates[0] * sample.dt_s
        return (soc,), SocEstimate._make([soc, 0.1, *[math.nan] * (len(SocEstimate._fields) - 3), 0.0])


def test_settings_without_a_hash_are_compiled_for_themselves():
    slow, fast = (SocEstimator(Drift([rate]), lowering="python") for rate in (0.01, 0.02))
    for estimator, expected in ((slow, 0.51), (fast, 0.52)):
        estimator.update(0.0, 0.0, 3.3)
        assert estimator.update(1.0, 0.0, 3.3).soc == pytest.approx(expected)
