"""Live, from logs, in lanes, and across a restart: the same numbers."""

import json
import math
import time
from dataclasses import replace

import numpy as np
import pytest

from battery.examples import LFP, NMC, drive, row, samples, simulate
from kernels import assert_compiled_is_plain, kernel_of
from ohmward.battery.chemistries import generic_battery
from ohmward.battery.file import load_battery, save_battery
from ohmward.battery.models.noise import BatteryNoise
from ohmward.battery.soc.coulomb import CoulombCounting, RestOcv
from ohmward.battery.soc.estimator import SocEstimator, samples_of
from ohmward.battery.soc.gaussian_sum import GaussianSumFilter
from ohmward.battery.soc.sample import Estimator, SocFlag, SocSample
from ohmward.battery.soc.thevenin_filter import TheveninFilter
from ohmward.errors import InputError
from ohmward.logs.log import Log
from ohmward.trace import snapshot

NOISE = BatteryNoise()
TRUTH = simulate(LFP, drive(np.random.default_rng(1), 900, rest_every=3), 0.8)
COLUMNS = samples(TRUTH, 0.03, NOISE)
LOG = Log("drive", TRUTH.time_s + 100.0, COLUMNS.current_A, COLUMNS.voltage_V)
ESTIMATORS: dict[str, Estimator] = {
    "ekf": TheveninFilter(LFP, NOISE, idle_current_A=0.0),
    "ukf": TheveninFilter(LFP, NOISE, method="ukf"),
    "aekf": TheveninFilter(LFP, NOISE, method="ekf", matching=True),
    "aukf": TheveninFilter(LFP, NOISE, method="ukf", matching=True),
    "gsf": GaussianSumFilter(TheveninFilter(LFP, NOISE, idle_current_A=0.0)),
    "coulomb": CoulombCounting(LFP, NOISE),
    "ocv": RestOcv(LFP, NOISE, settle_s=100.0),
}
each = pytest.mark.parametrize("estimator", ESTIMATORS.values(), ids=ESTIMATORS.keys())


def live(estimator, log):
    """Estimates (T,) of updates one by one."""
    rows = zip(log.time_s, log.current_A, log.voltage_V, strict=True)
    return list(zip(*(estimator.update(*map(float, r)) for r in rows), strict=True))


@each
@pytest.mark.parametrize("lowering", ["python", "machine"])
def test_a_log_at_once_is_its_samples_one_by_one(estimator, lowering):
    one_by_one = live(SocEstimator(estimator, 0.8, lowering=lowering), LOG)
    at_once = SocEstimator(estimator, 0.8, lowering=lowering).run(LOG).estimates
    assert np.array_equal(one_by_one, at_once, True)


DATED = replace(NOISE, capacity_std=0.1, capacity_known_unix_s=1.79e9, capacity_known_std=0.02)


@pytest.mark.parametrize("days", [0, 73, 1000])
@pytest.mark.parametrize("sums", [False, True], ids=["ekf", "gsf"])
def test_a_dated_log_begins_with_the_doubt_of_its_day(sums, days):
    def settings(noise):
        one = TheveninFilter(LFP, noise)
        return GaussianSumFilter(one) if sums else one

    day = replace(LOG, start_unix_s=1.79e9 + 86400.0 * days - LOG.time_s[0])
    first = SocEstimator(settings(DATED), 0.8).run(day).estimates
    expected = SocEstimator(settings(DATED.on(1.79e9 + 86400.0 * days)), 0.8).run(LOG).estimates
    np.testing.assert_allclose(first.soh_capacity_std[:50], expected.soh_capacity_std[:50], rtol=1e-9)
    given = SocEstimator(settings(DATED), 0.8, unix_s=1.79e9 + 86400.0 * days)
    assert given.update(0.0, *map(float, row(COLUMNS, 0)[1:3])).soh_capacity_std == first.soh_capacity_std[0]


def test_a_resumed_estimator_knows_its_day():
    day = 1.79e9 + 86400.0 * 1000
    estimator = SocEstimator(TheveninFilter(LFP, DATED), 0.8, unix_s=day)
    estimator.update(0.0, *map(float, row(COLUMNS, 0)[1:3]))
    resumed = SocEstimator.restore(TheveninFilter(LFP, DATED), json.loads(json.dumps(estimator.snapshot())))
    assert resumed.unix_s == day
    first = SocSample(*map(float, row(COLUMNS, 0)))
    expected, again = (TheveninFilter(LFP, DATED.on(day)).init(first), resumed.init_again(first))
    np.testing.assert_array_equal(again.belief.mean, expected.belief.mean)
    np.testing.assert_array_equal(again.belief.lower, expected.belief.lower)


def test_an_undated_log_begins_with_the_doubt_of_the_file():
    undated, plain = (
        SocEstimator(TheveninFilter(LFP, noise), 0.8).run(LOG).estimates
        for noise in (DATED, replace(NOISE, capacity_std=0.1))
    )
    np.testing.assert_allclose(undated.soh_capacity_std, plain.soh_capacity_std, rtol=1e-9)


@each
def test_compiled_is_with_floats(estimator):
    assert_compiled_is_plain(estimator, estimator.init(row(COLUMNS, 0), 0.8), (row(COLUMNS, k) for k in range(60)))


@each
def test_lanes_are_logs(estimator):
    part = slice(390, 620)  # the end of a drive, a rest, and the beginning of the next drive
    columns = SocSample(*(column[part] for column in COLUMNS))
    offsets = np.array([0.0, 0.05, -0.05])
    lanes = columns._replace(current_A=columns.current_A[:, None] + offsets)
    state = estimator.init(row(columns, 0), 0.8)
    kernel = kernel_of(estimator, state, row(columns, 0))
    _, together = kernel.scan_lanes(state, lanes)
    for lane, offset in enumerate(offsets):
        _, alone = kernel.scan(state, columns._replace(current_A=columns.current_A + offset))
        for found, expected in zip(together, alone, strict=True):
            np.testing.assert_allclose(np.broadcast_to(found, (230, 3))[:, lane], expected, rtol=1e-7, atol=1e-9)


@each
def test_two_halves_are_the_whole(estimator):
    halves = SocEstimator(estimator, 0.8)
    parts = [halves.run(LOG.select(part)).estimates for part in (slice(0, 400), slice(400, None))]
    whole = SocEstimator(estimator, 0.8).run(LOG).estimates
    for first, second, expected in zip(*parts, whole, strict=True):
        np.testing.assert_array_equal(np.concatenate([first, second]), expected)


@each
@pytest.mark.usefixtures("in_python")
def test_a_restart_from_a_snapshot_goes_on_to_the_bit(estimator):
    before = SocEstimator(estimator, 0.8)
    before.run(LOG.select(slice(0, 400)))
    stored = json.dumps(before.snapshot(), allow_nan=False)
    after = SocEstimator.restore(estimator, json.loads(stored))
    rest = LOG.select(slice(400, None))
    np.testing.assert_array_equal(live(after, rest), live(before, rest))


def test_a_snapshot_tells_what_it_holds():
    estimator = SocEstimator(ESTIMATORS["ekf"], 0.8)
    estimator.run(LOG)
    taken = estimator.snapshot()
    assert taken["version"] == 2
    assert taken["estimator"].startswith("TheveninFilter-")
    assert taken["time_s"] == LOG.time_s[-1]
    assert len(taken["checksum"]) == 16
    assert taken["state"]["belief.mean[0]"] == estimator.state.belief.mean[0]


def test_there_is_no_snapshot_before_the_first_sample():
    with pytest.raises(InputError, match="before the first sample; call update or run first"):
        SocEstimator(ESTIMATORS["ekf"]).snapshot()


def damaged(change):
    """A snapshot after a change."""
    estimator = SocEstimator(ESTIMATORS["ekf"], 0.8)
    estimator.run(LOG.select(slice(0, 10)))
    taken = estimator.snapshot()
    change(taken)
    return taken


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda s: s.update(version=0), "snapshot version must be 2, got 0; start a new estimator"),
        (lambda s: s.clear(), "snapshot version must be 2, got None"),
        (lambda s: s.update(estimator="RcKalman-1"), "the snapshot is of 'RcKalman-1', but the estimator is 'Thevenin"),
        (lambda s: s.update(state=None), r"number 1 of \d+ must be belief\.mean\[0\], it has 'nothing'"),
        (lambda s: s["state"].pop("rest_s"), r"must be rest_s, it has 'rejected_s'"),
        (lambda s: s["state"].update({"rest_s": "3"}), r"snapshot rest_s must be a number, got '3'"),
        (lambda s: s.update(time_s=True), "snapshot time_s must be a number, got True"),
        (lambda s: s.update(version=1), "snapshot version must be 2, got 1; start a new estimator"),
        (lambda s: s["state"].update({"belief.mean[0]": 0.5}), "damaged: its checksum does not fit its content; start"),
        (lambda s: s.update(time_s=0.0), "damaged: its checksum does not fit its content"),
        (lambda s: s.pop("checksum"), "damaged: its checksum does not fit its content"),
    ],
)
def test_a_snapshot_that_does_not_fit_is_refused(change, message):
    with pytest.raises(InputError, match=message):
        SocEstimator.restore(ESTIMATORS["ekf"], damaged(change))


@pytest.mark.parametrize("other", [TheveninFilter(NMC, NOISE), TheveninFilter(LFP, NOISE), ESTIMATORS["coulomb"]])
def test_a_snapshot_of_another_battery_or_setting_is_refused(other):
    with pytest.raises(InputError, match="another kind, model or settings"):
        SocEstimator.restore(other, damaged(lambda s: None))


def test_the_identity_is_that_of_equal_settings():
    again = TheveninFilter(LFP, BatteryNoise(), idle_current_A=0.0)
    assert snapshot.identity(again) == snapshot.identity(ESTIMATORS["ekf"])


@pytest.mark.usefixtures("in_python")
@pytest.mark.parametrize("chemistry", ["nmc", "lfp", "lead-acid"])
def test_a_snapshot_fits_the_battery_that_was_saved_beside_it(tmp_path, chemistry):
    battery = generic_battery(chemistry, capacity_Ah=10.0 / 3.0, n_series=7)
    estimator = SocEstimator(battery, 0.8)
    before = estimator.update(0.0, -1.0, battery.thevenin.ocv.mean_V(0.8, 25.0))
    save_battery(battery, tmp_path / "battery.toml")
    saved = load_battery(tmp_path / "battery.toml")
    assert saved != battery
    resumed = SocEstimator.restore(saved, json.loads(json.dumps(estimator.snapshot())))
    after = resumed.update(1.0, -1.0, battery.thevenin.ocv.mean_V(0.8, 25.0))
    assert after.soc == pytest.approx(before.soc, abs=1e-3)


def test_a_late_sample_takes_no_time_and_a_clock_that_was_set_goes_on():
    estimator = SocEstimator(ESTIMATORS["coulomb"], 0.8)
    flags = [int(estimator.update(t, -1.0, 3.3).flags) for t in (0.0, 10.0, 4.0, 11.0, 1e9, 12.0, 13.0, math.nan, 14.0)]
    late, clock_set = 2, (4, 5)
    assert flags[late] == SocFlag.BAD_TIME
    assert all(flags[k] & SocFlag.BAD_TIME for k in clock_set)
    assert flags[6] == flags[3] == 0
    assert flags[7] == SocFlag.BAD_TIME
    assert estimator.state.elapsed_s == 10.0 + 1.0 + 1.0 + 1.0


def test_a_clock_that_is_set_back_by_less_than_a_minute_loses_few_samples():
    estimator = SocEstimator(ESTIMATORS["coulomb"], 0.8)
    late = [estimator.update(t, -1.0, 3.3).flags for t in (*range(100), *range(70, 170))]
    assert estimator.state.elapsed_s == 99.0 + 95.0
    assert [k for k, flags in enumerate(late) if flags & SocFlag.BAD_TIME] == [100, 101, 102, 103, 104]


def test_late_samples_out_of_order_set_no_clock():
    estimator = SocEstimator(ESTIMATORS["coulomb"], 0.8)
    for t in (0.0, 10.0, 4.0, 5.0, 6.0, 11.0, 7.0, 8.0, 9.0, 8.5, 9.5, 12.0):
        estimator.update(t, -1.0, 3.3)
    assert estimator.state.elapsed_s == 12.0


def test_the_first_time_may_be_missing():
    estimator = SocEstimator(ESTIMATORS["coulomb"], 0.8)
    estimator.update(math.nan, -1.0, 3.3)
    estimator.update(5.0, -1.0, 3.3)
    assert estimator.update(6.0, -1.0, 3.3).flags == 0


def test_samples_of_a_log_count_from_the_last_time():
    assert samples_of(LOG).dt_s[0] == 0.0
    assert samples_of(LOG, 97.0).dt_s[0] == 3.0
    assert samples_of(LOG, 200.0).dt_s[0] == 0.0
    assert np.isnan(samples_of(LOG).temperature_degC).all()


def test_a_run_counts_its_flags():
    estimates = SocEstimator(ESTIMATORS["ekf"], 0.8).run(LOG)
    flags = estimates.estimates.flags.astype(int)
    assert estimates.counts() == {"rest": int(np.count_nonzero(flags & SocFlag.REST))}
    assert estimates.counts()["rest"] > 100
    assert estimates.seconds > 0.0


def test_per_cent_are_refused():
    with pytest.raises(InputError, match=r"initial_soc must be between 0 and 1 \(0\.8 is 80 %\), got 80"):
        SocEstimator(ESTIMATORS["ekf"], initial_soc=80.0)
    with pytest.raises(InputError, match="initial_soc_std must be > 0, got -1"):
        SocEstimator(ESTIMATORS["ekf"], initial_soc_std=-1.0)
    with pytest.raises(InputError, match=r"initial_soc_std must be at most 0.5 \(0.03 is 3 points\), got 3"):
        SocEstimator(ESTIMATORS["ekf"], initial_soc_std=3.0)


def test_a_step_along_a_log_is_compiled():
    """A hundred and fifty times faster than on NumPy arrays in the same run."""
    estimator, columns = ESTIMATORS["ekf"], samples_of(LOG)
    run = SocEstimator(estimator, 0.8)
    run.run(LOG.select(slice(0, 2)))
    state = estimator.init(row(columns, 0))
    began_s = time.process_time()
    for k in range(1, 21):
        state, _ = estimator.step(state, row(columns, k))
    numpy_s = time.process_time() - began_s
    run.run(LOG.select(slice(2, None)))
    assert (time.process_time() - began_s - numpy_s) / 898 < numpy_s / 20 / 20
