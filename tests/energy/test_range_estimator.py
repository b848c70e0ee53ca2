"""Range live: closed forms, what it learns, restarts, and what sensors may do."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from ohmward.battery.chemistries import generic_battery
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.battery.soc.sample import SocEstimate
from ohmward.energy import Consumption, Leg, RangeEstimator, RangeFlag, begin_drive, learn, prior_from_robot, start
from ohmward.energy.consumption import energy_demand, with_terrain
from ohmward.energy.consumption_file import dump_consumption
from ohmward.energy.cut_drive import DriveSample, cut_drive
from ohmward.energy.leg import Stretch, stretch_of, total_distance_m
from ohmward.energy.range import ground_std
from ohmward.energy.range_step import (
    RECENT_S,
    RangeEstimate,
    RangeSample,
    RangeSettings,
    SocNow,
    battery_state,
    last_stretches,
    usual_ground,
)
from ohmward.energy.sag import Sag
from ohmward.energy.usable_energy import discharge_curves
from ohmward.errors import InputError
from ohmward.logs.log import Log
from ohmward.traction import RLMA
from ohmward.traction.robot.packaged import PACKAGED

BATTERY = generic_battery("lfp", 5.0, n_series=8)
NEW = start(prior_from_robot(RLMA))
V = 26.4
T = np.arange(0.0, 1500.0, 2.0)
SPEED = np.where((T > 400) & (T < 500), 0.0, 0.5)
POWER = np.where(SPEED > 0, 30.0, 9.0) + np.random.default_rng(4).normal(0.0, 0.5, len(T))
TERRAIN = np.where(T < 800, "grass", "gravel").tolist()


def new(**options):
    """With a forecast every ten minutes, for they are what takes time."""
    return RangeEstimator(BATTERY, NEW, **({"refresh_s": 600.0} | options))


def driven(estimator, rows=slice(None), soc=0.8, home=None):
    columns = (T[rows].tolist(), SPEED[rows].tolist(), POWER[rows].tolist(), TERRAIN[rows])
    return [
        estimator.update(t, soc, v, -p / V, V, terrain=name, home=home) for t, v, p, name in zip(*columns, strict=True)
    ]


def test_what_it_learns_is_what_the_recorded_drive_teaches():
    estimator, expected = new(terrain="grass"), begin_drive(NEW)
    driven(estimator)
    estimator.update(1e6, 0.8, 0.0, -1.0, V)
    for d in cut_drive(T, SPEED, POWER, TERRAIN):
        expected = learn(expected, d.stretch, d.energy_J)
    for name in ("grass", "gravel"):
        k = expected.force_index(name)
        assert estimator.consumption.mean[estimator.consumption.force_index(name)] == pytest.approx(
            expected.mean[k], rel=0.01
        )
    assert isinstance(estimator.consumption, Consumption)


def test_peaks_that_held_shorten_the_range_to_the_cut_off():
    def after(peak_W: float, of_s: float) -> float:
        """P10 at the end of an hour with such a peak every three minutes, the mean power being the same."""
        estimator = new(terrain="grass", cutoff_V=20.0, reserve_soc=0.0, refresh_s=1e9)
        rest_W = (180.0 * 40.0 - peak_W * of_s) / (180.0 - of_s)
        for t in np.arange(0.0, 3600.0, 1.0):
            estimator.update(t, 0.5, 0.5, -(peak_W if t % 180.0 < of_s else rest_W) / V, V)
        return estimator.settings.forecast(estimator.state, last_sample(estimator)).distance_m.p10

    assert after(300.0, 10.0) < 0.9 * after(41.0, 10.0)  # a climb of ten seconds
    assert after(300.0, 1.0) > after(300.0, 10.0)  # a second opens no protection


def test_the_ground_ahead_is_also_what_the_robot_is_used_to():
    c = begin_drive(NEW)
    for _ in range(30):
        c = learn(c, stretch_of(Leg(50.0, "grass", 0.5)), 3000.0)
        c = learn(c, stretch_of(Leg(50.0, "asphalt", 0.5)), 1000.0)
    late = [stretch_of(Leg(50.0, "asphalt", 0.5))] * 36
    ahead = [*late, *usual_ground(c)]
    lengths = {name: sum(s.distance_m for s in ahead if s.terrain == name) for name in ("grass", "asphalt")}
    assert lengths["grass"] == pytest.approx(sum(lengths.values()) / 6)  # half of the half hour beside the last hour
    assert usual_ground(NEW) == []  # nothing was driven before


def test_the_recent_ground_is_that_of_an_hour_however_often_the_robot_stops():
    leg, stop = stretch_of(Leg(20.0, "grass", 0.5)), Stretch("", 10.0)
    driven = (leg, stop) * 100
    assert last_stretches(driven, RECENT_S) == driven[-144:]  # 72 of 50 s each
    assert last_stretches(driven[:100], RECENT_S) == driven[:100]


def test_the_robot_will_stop_as_often_as_in_the_last_hour():
    settings = new().settings
    c = learn(begin_drive(NEW), stretch_of(Leg(5000.0, "grass", 0.5)), 300000.0)
    recent = (stretch_of(Leg(20.0, "grass", 0.5)), Stretch("", 10.0)) * 10
    ahead = settings.ahead(settings.init(c)._replace(recent=recent))
    standing_s = sum(s.time_s for s in ahead if not s.terrain)
    assert total_distance_m(ahead) == pytest.approx(200.0 + 0.5 * 1800.0)  # and half an hour of usual ground
    assert standing_s == pytest.approx(0.5 * total_distance_m(ahead))


def test_the_way_home_climbs_what_was_descended_and_has_no_stays():
    def forecast(*stay, way_m, grade_rad=0.0):
        settings = new().settings
        recent = (*[stretch_of(Leg(50.0, "grass", 0.5, grade_rad))] * 10, *stay)
        state = settings.init(begin_drive(NEW))._replace(recent=recent, soc=SocNow(0.5))
        return settings.forecast(state, RangeSample(DriveSample(0.0, 0.0, 9.0, 0.0, "grass"), state.soc, way_m))

    level = forecast(way_m=4000.0)
    stays = forecast(*[Stretch("", 180.0)] * 19, way_m=4000.0)
    assert stays.home_probability == level.home_probability > 0.1
    assert stays.distance_m.p50 < level.distance_m.p50
    down, up = (forecast(way_m=4000.0, grade_rad=sign * 0.05).home_probability for sign in (-1, 1))
    assert down < level.home_probability < up


def test_the_ground_ahead_is_another_sample_of_that_of_late():
    c = begin_drive(learn(with_terrain(begin_drive(NEW), "grass"), stretch_of(Leg(50.0, "grass", 0.5)), 1500.0))
    even = [stretch_of(Leg(50.0, "grass", 0.5))] * 20
    hilly = [stretch_of(Leg(50.0, "grass", 0.5, grade_rad=grade)) for grade in [0.06, -0.05] * 10]
    mean_J_per_m = energy_demand(c, even).mean_J / 1000.0
    assert ground_std(c, even) < 0.05 * mean_J_per_m  # twenty stretches, all alike
    assert ground_std(c, hilly) > 3 * ground_std(c, even)
    assert ground_std(c, even[:1]) > 0.3 * mean_J_per_m  # one tells nothing of the others
    assert ground_std(c, []) == 0.0


def test_starts_and_stops_are_no_sample_of_the_ground():
    c = with_terrain(begin_drive(NEW), "grass")
    even = [stretch_of(Leg(50.0, "grass", 0.5))] * 20
    slow = stretch_of(Leg(0.1, "grass", 0.02))  # five seconds, mostly of idle power
    assert ground_std(c, [*even, slow]) == ground_std(c, even)
    short = [stretch_of(Leg(2.5, "grass", 0.5))] * 20
    assert ground_std(c, short) == pytest.approx(ground_std(c, even[:1]))  # all together are one sample


@pytest.mark.parametrize("crawl_m_s", [1e-9, 1e-30, 1e-170])
def test_a_crawl_between_two_gaps_changes_no_range(crawl_m_s):
    def after(speed_m_s: float) -> RangeEstimate:
        estimator = new(terrain="grass", refresh_s=1e9)
        speeds = [0.5] * 100 + [math.nan] * 8 + [speed_m_s] * 2 + [math.nan] * 8 + [0.5] * 100
        for k, speed in enumerate(speeds):
            estimator.update(2.0 * k, 0.8, speed, -1.0, V)
        return estimator.settings.forecast(estimator.state, last_sample(estimator))

    assert after(crawl_m_s).distance_m == pytest.approx(after(0.0).distance_m)


def last_sample(estimator: RangeEstimator) -> RangeSample:
    last = estimator.state.meter.last
    assert last is not None
    return RangeSample(last, estimator.state.soc)


def test_range_times_energy_per_metre_is_the_usable_energy():
    now = driven(new(terrain="grass"))[-1]
    assert now.distance_m.p50 * now.energy_J_per_m.p50 == pytest.approx(now.usable_J.p50, rel=0.05)
    assert now.distance_m.p10 < now.distance_m.p50 < now.distance_m.p90
    assert now.duration_s.p50 == pytest.approx(now.distance_m.p50 / 0.5, rel=0.15)
    assert now.driven_m == pytest.approx(np.trapezoid(SPEED, T))
    assert now.energy_J_per_m.p50 == pytest.approx(np.mean(POWER[SPEED > 0]) / 0.5, rel=0.15)


def test_the_way_home_is_a_length_or_legs():
    near, far = (driven(new(terrain="grass"), home=m)[-1] for m in (50.0, 40_000.0))
    assert near.home_probability > 0.99 and far.home_probability < 0.01
    legs = driven(new(terrain="grass"), slice(0, 10), home=[Leg(50.0, "sand", 0.4)])[-1]
    assert legs.home_probability > 0.99
    assert math.isnan(driven(new(terrain="grass"), slice(0, 3))[-1].home_probability)
    assert driven(new(), slice(0, 3), home=0.0)[-1].home_probability == 1.0


def test_below_the_reserve_nothing_is_left():
    estimator = new(reserve_soc=0.2)
    now = driven(estimator, slice(0, 3), soc=0.2, home=10.0)[-1]
    assert now.distance_m == now.usable_J == (0.0, 0.0, 0.0) and now.home_probability == 0.0
    assert now.flags == RangeFlag.RESERVE


def test_a_restart_goes_on_to_the_bit():
    before = new(terrain="grass", days=2.0)
    driven(before, slice(0, 400), home=80.0)
    taken = json.loads(json.dumps(before.snapshot(), allow_nan=False))
    after = RangeEstimator.restore(BATTERY, taken, terrain="grass", refresh_s=600.0)
    assert driven(after, slice(400, None), home=80.0) == driven(before, slice(400, None), home=80.0)
    assert after.snapshot() == before.snapshot()
    assert dump_consumption(after.consumption) == dump_consumption(before.consumption)
    assert after.time_s == T[-1]


def test_snapshots_that_do_not_fit_are_refused():
    estimator = new()
    assert math.isnan(estimator.time_s)
    with pytest.raises(InputError, match="before the first sample"):
        estimator.snapshot()
    driven(estimator, slice(0, 3))
    taken = estimator.snapshot()
    with pytest.raises(InputError, match="another kind, model or settings"):
        RangeEstimator.restore(BATTERY, taken, reserve_soc=0.3, refresh_s=600.0)
    with pytest.raises(InputError, match="damaged: its checksum does not fit"):
        RangeEstimator.restore(BATTERY, refresh_s=600.0, snapshot=taken | {"time_s": 7.0})
    with pytest.raises(InputError, match="snapshot version must be 2, got 1"):
        RangeEstimator.restore(BATTERY, refresh_s=600.0, snapshot=taken | {"version": 1})


def test_missing_values_and_faults_are_survived_and_flagged():
    estimator = new()
    assert estimator.update(0.0, None, 0.5, -1.0, V).flags == RangeFlag.NO_SOC
    assert math.isnan(estimator.state.forecast.distance_m.p50)
    assert estimator.update(1.0, 0.8, 0.5, None, V).flags == RangeFlag.NO_POWER
    assert estimator.update(2.0, 0.8, math.nan, -1.0, V).flags == RangeFlag.NO_SPEED
    assert estimator.update(1.5, 0.8, 0.5, -1.0, V).flags == RangeFlag.BAD_TIME
    assert estimator.update(math.nan, math.nan, 0.5, -1.0, V).flags == RangeFlag.BAD_TIME | RangeFlag.NO_SOC
    assert estimator.update(3.0, 0.8, 1e30, -1e30, 1e30).flags == RangeFlag.NO_POWER | RangeFlag.NO_SPEED
    assert str(estimator.update(4.0, 0.8, 0.5, -1.0, V).flags) == "0"
    assert all(np.isfinite(q) for q in estimator.state.forecast.distance_m)
    rng = np.random.default_rng(1)
    garbage = [None, math.nan, math.inf, -math.inf, 1e300, -1e300, 0.0, 1.0]
    for k in range(300):
        v, i, u, g, home, degC = rng.choice(np.array(garbage, dtype=object), 6)
        estimator.update(5.0 + k, 0.7, v, i, u, g, home=home, temperature_degC=degC)
    assert np.isfinite(estimator.consumption.mean).all()
    assert all(np.isfinite(q) for q in driven(estimator)[-1].distance_m)


@pytest.mark.parametrize(("given", "flags", "used"), [(1.003, 0, 1.0), (-0.002, RangeFlag.RESERVE, 0.0)])
def test_a_charge_is_rounded_into_its_limits(given, flags, used):
    estimator = new()
    assert estimator.update(0.0, given, 0.5, -1.0, V).flags == flags
    assert estimator.state.soc.soc == used


@pytest.mark.parametrize("given", [80.0, -3.0, math.inf, 1e308])
def test_a_charge_far_outside_its_limits_is_missing(given):
    estimator = new()
    before = estimator.update(0.0, 0.8, 0.5, -1.0, V)
    assert estimator.update(1.0, given, 0.5, -1.0, V) == before._replace(driven_m=0.5, flags=RangeFlag.NO_SOC)


@pytest.mark.parametrize("home", [1e308, math.inf, -5.0])
def test_a_way_home_that_cannot_be_is_not_known(home):
    assert math.isnan(new().update(0.0, 0.8, 0.5, -1.0, V, home=home).home_probability)


def test_a_way_home_of_nearly_nothing_is_reached():
    assert new().update(0.0, 0.8, 0.5, -1.0, V, home=1e-320).home_probability == 1.0


@pytest.mark.parametrize("field", ["soh_capacity", "soh_capacity_std", "resistance_ratio", "resistance_ratio_std"])
@pytest.mark.parametrize("value", [math.inf, -1.0, 1e308])
def test_an_estimate_that_cannot_be_spoils_no_band(field, value):
    estimate = SocEstimate(0.8, 0.01, V, 0.1, 0.0, 0.0, 0.1, 1.0, 0.05, 1.0, 0.05, 0)
    expected = new().update(0.0, estimate, 0.5, -1.0, V).distance_m
    found = new().update(0.0, estimate._replace(**{field: value}), 0.5, -1.0, V).distance_m
    assert 0.1 * expected.p10 < found.p10 < found.p90 < 2.0 * expected.p90


@pytest.mark.parametrize(("soc", "flags"), [(1.2, 0), (-0.2, RangeFlag.RESERVE), (-1e9, RangeFlag.NO_SOC)])
def test_an_estimate_may_overshoot(soc, flags):
    estimate = SocEstimate(soc, 0.01, V, 0.1, 0.0, 0.0, 0.1, 1.0, 0.05, 1.0, 0.05, 0)
    assert new().update(0.0, estimate, 0.5, -1.0, V).flags == flags


@pytest.mark.parametrize("value", [math.nan, math.inf, -1.0])
def test_an_estimate_without_a_standard_deviation_is_missing(value):
    estimate = SocEstimate(0.8, value, V, 0.1, 0.0, 0.0, 0.1, 1.0, 0.05, 1.0, 0.05, 0)
    assert new().update(0.0, estimate, 0.5, -1.0, V).flags == RangeFlag.NO_SOC


def test_without_times_there_is_one_forecast(monkeypatch):
    made = []
    forecast = RangeSettings.forecast

    def counted(*given):
        made.append(1)
        return forecast(*given)

    monkeypatch.setattr(RangeSettings, "forecast", counted)
    estimator = new()
    estimates = [estimator.update(math.nan, 0.8, 0.5, -1.0, V) for _ in range(20)]
    assert len(made) == 1 and all(math.isfinite(e.distance_m.p50) for e in estimates)


def test_a_slope_that_cannot_be_is_no_climb():
    estimator = new(terrain="grass")
    for k in range(100):
        estimator.update(float(k), 0.8, 0.5, -1.0, V, grade_rad=1e9 if k % 3 else 0.0)
    assert estimator.state.meter.moving is not None
    assert estimator.state.meter.moving.stretch.climb_m == estimator.state.meter.moving.stretch.descent_m == 0.0


def test_faults_of_every_kind_spoil_no_range():
    """A tenth of the values garbage, a clock that jumps, restarts from snapshots: as without, within a third."""
    garbage = [None, math.nan, math.inf, -math.inf, 1e308, -1e308, 1e9, -1e4, np.float32("nan"), np.int64(-(10**6))]
    options = {"terrain": "grass", "refresh_s": 300.0}
    clean, faulty = new(**options), new(**options)
    rng, clock_s = np.random.default_rng(7), 0.0
    for k in range(2000):
        speed_m_s = 0.5 if k % 300 < 240 else 0.0
        values = [0.8 - 1e-4 * k, speed_m_s, -1.1 if speed_m_s else -0.4, V, 0.01, None, 300.0, 20.0]
        expected = clean.update(float(k), *values)
        clock_s += 1.0 if rng.random() > 0.005 else float(rng.choice([-1e5, -30.0, 30.0, 1e5]))
        given = [garbage[rng.integers(len(garbage))] if rng.random() < 0.1 else v for v in [clock_s, *values]]
        now = faulty.update(*given[:6], None, *given[7:])
        assert now.distance_m.p10 <= now.distance_m.p50 <= now.distance_m.p90 or math.isnan(now.distance_m.p50)
        assert math.isnan(now.home_probability) or 0.0 <= now.home_probability <= 1.0
        if rng.random() < 0.01:
            faulty = RangeEstimator.restore(BATTERY, json.loads(json.dumps(faulty.snapshot())), **options)
    assert now.distance_m.p10 == pytest.approx(expected.distance_m.p10, rel=0.33)
    assert now.distance_m.p50 == pytest.approx(expected.distance_m.p50, rel=0.33)


def test_a_broken_wire_of_a_thermometer_is_no_temperature():
    without, broken = new(), new()
    at_first = without.update(0.0, 0.8, 0.5, -1.0, V)
    assert broken.update(0.0, 0.8, 0.5, -1.0, V, temperature_degC=-127.0) == at_first


def test_a_way_home_that_is_not_a_number_is_not_known():
    assert math.isnan(new().update(0.0, 0.8, 0.5, -1.0, V, home=math.nan).home_probability)


def test_a_clock_that_was_set_back_is_noticed_after_some_samples():
    estimator = new()
    for k in range(60):
        estimator.update(float(k), 0.8, 0.5, -1.0, V)
    flags = [estimator.update(30.0 + k, 0.8, 0.5, -1.0, V).flags for k in range(10)]
    assert [flag & RangeFlag.BAD_TIME > 0 for flag in flags] == [True] * 4 + [False] * 6


def test_an_estimate_of_the_charge_brings_its_uncertainty():
    tested = replace(BATTERY, noise=replace(BATTERY.noise, capacity_std=0.02))
    unknown = SocEstimate(*[math.nan] * len(SocEstimate._fields))
    sure, unsure = (unknown._replace(soc=0.6, soc_std=std, flags=0) for std in (0.001, 0.1))
    widths = []
    for soc in (sure, unsure):
        left = driven(RangeEstimator(tested, NEW, refresh_s=600.0), slice(0, 3), soc=soc)[-1].usable_J
        widths.append(left.p90 - left.p10)
    assert widths[1] > 3 * widths[0]


def test_a_log_at_once_is_its_samples_one_by_one():
    log = Log("drive", T, -POWER / V, np.full(len(T), V), extra={"speed_m_s": SPEED})
    run = new().run(log, np.full(len(T), 0.8), terrain=TERRAIN, home=80.0)
    expected = driven(new(), home=80.0)
    assert run.distance_m.p10 == pytest.approx([e.distance_m.p10 for e in expected], rel=0.0)
    assert run.home_probability.tolist() == [e.home_probability for e in expected]
    frame = run.to_pandas()
    assert {"distance_m_p10", "duration_s_p90", "home_probability", "flags"} <= set(frame.columns)
    assert run.counts() == {}
    assert run.plot().figures[0].title == "Range left" and len(run.plot().figures) == 2


def test_the_charge_of_a_run_and_columns_of_the_log():
    log = Log("drive", T, -POWER / V, np.full(len(T), V), extra={"v": SPEED, "slope": 0.0 * T})
    soc = SocEstimator(BATTERY, 0.8, lowering="python").run(log)
    steps = []
    run = new().run(log, soc, "v", "slope", progress=lambda done, whole: steps.append(done))
    assert run.distance_m.p10[-1] < run.distance_m.p90[-1] and steps[-1] == len(T)
    with pytest.raises(InputError, match=r"log 'drive' has no column 'speed_m_s' for speed_m_s, but v, slope"):
        new().run(log, soc)
    with pytest.raises(InputError, match="soc must have 750 values, one for each sample of the log, got 3"):
        new().run(log, np.ones(3), SPEED)


def test_a_robot_without_a_table_begins_with_a_broad_guess():
    by_name, by_robot = RangeEstimator(BATTERY, "rlma"), RangeEstimator(BATTERY, RLMA)
    assert driven(by_name, slice(0, 3)) == driven(by_robot, slice(0, 3)) == driven(new(), slice(0, 3))


def test_the_representation_says_what_is_left():
    estimator = new()
    assert repr(estimator) == "RangeEstimator(lfp 5 Ah)"
    driven(estimator, slice(0, 3))
    assert "m left (" in repr(estimator)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: RangeEstimator("battery.toml", NEW), "battery must be a Battery, got str"),  # type: ignore[arg-type]
        (
            lambda: RangeEstimator(BATTERY, "rlmb"),
            f"robot must be a robot file or one of {', '.join(PACKAGED)}, got 'rlmb'",
        ),
        (lambda: RangeEstimator(BATTERY, 7), "a robot must be a Robot, or the path or name of one, got int"),  # type: ignore[arg-type]
        (lambda: new(reserve_soc=20.0), "reserve_soc must be between 0 and 1, got 20"),
        (lambda: new(terrain=""), "terrain must be the name of a ground"),
        (lambda: new(refresh_s=0.0), "refresh_s must be > 0"),
        (
            lambda: new().run(Log("drive", T, -POWER / V, np.full(len(T), V)), np.full(len(T), 80.0), SPEED),
            r"soc must be between 0 and 1 \(0.8 is 80 %\), got 80",
        ),
        (lambda: new().update(0.0, 0.8, "fast"), "speed_m_s must be a number"),
    ],
)
def test_what_cannot_be_used_is_refused_by_name(make, message):
    with pytest.raises(InputError, match=message):
        make()


def test_until_some_metres_are_driven_the_way_ahead_is_assumed():
    """A start from rest would tell of a way at a crawl, and of a range of a few hundred metres."""
    resting, starting = new(refresh_s=1.0), new(refresh_s=1.0)
    for k in range(20):
        at_rest = resting.update(float(k), 0.8, 0.0, -1.0, V)
        at_start = starting.update(float(k), 0.8, 0.1, -1.0, V)
    assert at_rest.assumed and at_start.assumed
    assert at_start.driven_m == pytest.approx(1.9)
    assert at_start.distance_m.p50 == pytest.approx(at_rest.distance_m.p50, rel=0.05)
    assert at_rest.distance_m.p10 < 0.8 * at_rest.distance_m.p50
    for k in range(20, 40):
        driving = starting.update(float(k), 0.8, 0.5, -1.0, V)
    assert not driving.assumed


def test_a_robot_that_has_stood_for_an_hour_says_that_the_way_is_assumed():
    estimator, assumed = new(), []
    for k in range(420):
        now = estimator.update(10.0 * k, 0.8, 0.5 if k < 20 else 0.0, -1.0, V)
        assumed.append(bool(now.assumed))
    assert assumed[0] and assumed[-1] and not any(assumed[10:370])
    assert RangeFlag.STOOD in now.flags


def test_a_current_of_the_wrong_sign_promises_no_endless_range():
    wrong, before = new(terrain="grass"), new(terrain="grass").update(0.0, 0.8, 0.0, -1.0, V)
    for t in np.arange(0.0, 1300.0, 1.0):
        now = wrong.update(t, 0.8, 0.5, 1.0, V)
    assert now.flags == RangeFlag.NO_COST and now.assumed
    assert now.distance_m.p50 == pytest.approx(before.distance_m.p50, rel=0.05)


def test_work_at_standstill_is_expected_ahead_and_changes_no_peaks_under_way():
    estimator, ratios = new(terrain="grass"), []
    for t in np.arange(0.0, 3000.0, 1.0):
        is_working = 1200.0 < t < 1800.0
        now = estimator.update(t, 0.8, 0.0 if is_working else 0.5, -(200.0 if is_working else 30.0) / V, V)
        ratios.append(estimator.state.peak_ratio.expected[0])
    assert ratios[-1] == pytest.approx(ratios[1200], abs=0.2)
    assert now.energy_J_per_m.p50 > 2.0 * 30.0 / 0.5  # 600 s of 200 W beside 2400 s of 30 W


def test_peaks_meet_the_resistance_that_the_loads_have_shown():
    """The file's resistance is of another temperature: the voltage sags four times as much, or a quarter."""
    for times in (0.25, 4.0):
        estimator, file_ohm = new(terrain="grass"), float(discharge_curves(BATTERY, np.array([0.8]), 25.0)[2][0])
        for k, t in enumerate(T):
            current_A = -2.0 - 6.0 * (k // 20 % 2)
            estimator.update(t, 0.8, 0.5, current_A, 26.4 + times * file_ohm * current_A, terrain="grass")
        now = battery_state(BATTERY, estimator.state.soc, estimator.state.sag.ohm)
        assert now.peak_resistance_ratio == pytest.approx(times, rel=0.1)
        assert now.resistance_ratio == 1.0  # to lasting loads it is the estimate's


def test_another_battery_keeps_the_way_and_forgets_the_last_one():
    estimator = new(terrain="grass")
    before = driven(estimator)[-1]
    estimator.change_battery()
    assert estimator.state.sag == Sag() and estimator.state.discharge.start_soc == 0.0
    unknown = estimator.update(T[-1] + 1.0, None, 0.5, -30.0 / V, V, terrain="grass")
    assert math.isnan(unknown.distance_m.p50) and unknown.driven_m >= before.driven_m
    half_empty = estimator.update(T[-1] + 2.0, 0.4, 0.5, -30.0 / V, V, terrain="grass")
    assert half_empty.distance_m.p50 < 0.7 * before.distance_m.p50


def test_a_plan_takes_the_place_of_ground_like_that_of_late():
    as_before = driven(new(terrain="grass"))[-1].distance_m
    for grade, longer in ((0.08, False), (-0.01, True)):
        estimator = new(terrain="grass")
        driven(estimator)
        plan = [Leg(50.0, "grass", 0.5, grade_rad=grade)] * 2000
        now = estimator.update(T[-1] + 700.0, 0.8, 0.5, -30.0 / V, V, terrain="grass", plan=plan)
        assert (now.distance_m.p50 > as_before.p50) == longer


def test_an_option_that_it_does_not_have_is_named_with_those_that_it_has():
    with pytest.raises(InputError, match="RangeEstimator has no option 'reserve'; it has"):
        RangeEstimator(BATTERY, "husky", reserve=0.1)
