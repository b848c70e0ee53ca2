"""Messages that come at their own rates, late and out of order; live samples against a log of the same."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from ohmward.errors import InputError
from ohmward.logs import DriveLog
from ohmward.traction import RLMA
from ohmward.traction.inbox import SensorInbox
from ohmward.traction.speed_observer.estimate import SlipEstimate
from ohmward.traction.speed_observer.estimator import SlipEstimator

from .speed_observer.test_nothing_diverges import drive

NAN = math.nan


def messages(seed=0, steps=600):
    """(stamp, message) of a drive: wheels and motors at 100 Hz, out of step, a gyro at 60 Hz, a speed at 7 Hz."""
    rng = np.random.default_rng(seed)
    wheels, current_A, x = drive()
    found = []
    for k in range(steps):
        time_s = 0.01 * (k + 1)
        found.append((time_s + 0.0002 * rng.random(), {"wheel_speed_rad_s": wheels[k]}))
        found.append((time_s - 0.004 + 0.001 * rng.random(), {"current_A": current_A[k]}))
    for time_s in np.arange(0.0033, 0.01 * steps, 1 / 60):
        found.append((time_s, {"yaw_rate_rad_s": np.interp(time_s, 0.01 * np.arange(len(x)), x[:, 1])}))
    for time_s in np.arange(0.0057, 0.01 * steps, 1 / 7):
        found.append((time_s, {"speed_m_s": np.interp(time_s, 0.01 * np.arange(len(x)), x[:, 0])}))
    return sorted(found, key=lambda message: message[0])


def samples_of(arriving, **options):
    inbox, samples = SensorInbox(RLMA, **options), []
    for stamp_s, message in arriving:
        inbox.put(stamp_s, **message)
        samples += inbox.take()
    return samples + inbox.flush(), inbox


def arriving_late(sent, most_s, seed=1):
    """The messages in the order in which they arrive."""
    delays_s = np.random.default_rng(seed).uniform(0.0, most_s, len(sent))
    order = np.argsort([stamp_s + delay_s for (stamp_s, _), delay_s in zip(sent, delays_s, strict=True)])
    return [sent[k] for k in order]


def equal(a, b):
    return a.keys() == b.keys() and all(np.array_equal(a[name], b[name], equal_nan=True) for name in a)


def test_messages_that_are_late_within_the_delay_give_the_same_samples():
    sent = messages()
    in_order, _ = samples_of(sent, delay_s=0.0)
    mixed, inbox = samples_of(arriving_late(sent, 0.05), delay_s=0.05)
    assert inbox.left_out == 0
    assert len(mixed) == len(in_order) == 600
    assert all(equal(a, b) for a, b in zip(mixed, in_order, strict=True))


def test_a_message_that_is_later_is_left_out_and_counted():
    inbox = SensorInbox(RLMA, delay_s=0.01)
    inbox.put(0.00, wheel_speed_rad_s=[1.0, 1.0])
    inbox.put(0.10, wheel_speed_rad_s=[1.0, 1.0])
    inbox.take()
    inbox.put(-0.01, current_A=[1.0, 1.0])
    assert inbox.left_out == 1


@pytest.mark.usefixtures("in_python")
def test_live_samples_of_the_inbox_are_a_run_on_the_log_of_the_same_messages():
    samples, _ = samples_of(arriving_late(messages(), 0.03), delay_s=0.03)
    live = SlipEstimator("rlma", terrain="gravel")
    updates = SlipEstimate(*map(np.array, zip(*(live.update(**sample) for sample in samples), strict=True)))

    def column(name, missing):
        return np.array([sample.get(name, missing) for sample in samples], dtype=float)

    log = DriveLog(
        "messages",
        column("time_s", NAN),
        column("wheel_speed_rad_s", np.full(4, NAN)),
        column("current_A", np.full(2, NAN)),
        yaw_rate_rad_s=column("yaw_rate_rad_s", NAN),
        speed_m_s=column("speed_m_s", NAN),
        speed_age_s=column("speed_age_s", 0.0),
    )
    run = SlipEstimator("rlma", terrain="gravel").run(log)
    for name in SlipEstimate._fields:
        assert_allclose(getattr(updates, name), getattr(run.estimates, name), rtol=1e-9, atol=1e-9, err_msg=name)


def test_each_wheel_may_send_its_own_message():
    inbox = SensorInbox(RLMA, delay_s=0.0, gather_s=0.002)
    for time_s in (0.0, 0.01, 0.02):
        inbox.put(time_s, wheel_speed_rad_s=[1.0, NAN])
        inbox.put(time_s + 0.001, wheel_speed_rad_s=[NAN, 2.0])
    samples = [*inbox.take(), *inbox.flush()]
    assert [sample["time_s"] for sample in samples] == pytest.approx([0.001, 0.011, 0.021])
    assert all(sample["wheel_speed_rad_s"][:2].tolist() == [1.0, 2.0] for sample in samples)


def test_currents_are_the_mean_over_the_step_and_a_speed_has_its_age():
    inbox = SensorInbox(RLMA, delay_s=0.0)
    inbox.put(0.000, wheel_speed_rad_s=[0.0, 0.0])
    for time_s, current_A in ((0.003, 1.0), (0.006, 2.0), (0.009, 6.0)):
        inbox.put(time_s, current_A=[current_A, NAN])
    inbox.put(0.004, speed_m_s=0.3, speed_age_s=0.05)
    inbox.put(0.010, wheel_speed_rad_s=[0.1, 0.1])
    _, sample = [*inbox.take(), *inbox.flush()]
    assert sample["current_A"] == pytest.approx([3.0, NAN], nan_ok=True)
    assert sample["speed_age_s"] == pytest.approx(0.056)


def test_a_shake_between_two_reports_of_the_wheels_leaves_no_yaw_rate():
    inbox = SensorInbox(RLMA, delay_s=0.0)
    inbox.put(0.0, wheel_speed_rad_s=[0.0, 0.0])
    for k in range(1, 11):
        inbox.put(0.01 * k, yaw_rate_rad_s=0.2 + 0.5 * (-1) ** k, acceleration_m_s2=1.0 + 3.0 * (-1) ** k)
    inbox.put(0.1, wheel_speed_rad_s=[0.1, 0.1])
    _, sample = [*inbox.take(), *inbox.flush()]
    assert sample["yaw_rate_rad_s"] == pytest.approx(0.2)
    assert sample["acceleration_m_s2"] == pytest.approx(1.0)


def test_counts_are_mean_speeds_through_the_overflow():
    inbox, step = SensorInbox(RLMA, delay_s=0.0, counts_per_turn=4096, bits=16), 100
    for k in range(2000):
        inbox.put(0.01 * k, wheel_counts=[(step * k) % 2**16, (-step * k) % 2**16])
    speeds = np.array([sample["wheel_speed_rad_s"][:2] for sample in [*inbox.take(), *inbox.flush()]])
    true = 2 * math.pi * step / 4096 / 0.01
    assert_allclose(speeds[-1900:], np.tile([true, -true], (1900, 1)), rtol=1e-9)


def test_without_wheels_samples_go_on():
    inbox = SensorInbox(RLMA, delay_s=0.0, silence_s=0.25)
    for k in range(100):
        inbox.put(0.01 * k, yaw_rate_rad_s=0.1)
    samples = [*inbox.take(), *inbox.flush()]
    assert len(samples) == 4
    assert np.diff([sample["time_s"] for sample in samples]) == pytest.approx(0.25, abs=0.02)


def test_bad_messages_are_refused():
    inbox = SensorInbox(RLMA)
    with pytest.raises(InputError, match="a message has no yaw_rate; there are yaw_rate_rad_s"):
        inbox.put(0.0, yaw_rate=0.1)
    with pytest.raises(InputError, match="wheel_counts need counts_per_turn"):
        inbox.put(0.0, wheel_counts=[1, 2])
    with pytest.raises(InputError, match="wheel_speed_rad_s must have the shape"):
        inbox.put(0.0, wheel_speed_rad_s=[1.0])
    with pytest.raises(InputError, match="delay_s"):
        SensorInbox(RLMA, delay_s=-1.0)


ODD = {
    "no time": [math.inf, NAN, -math.inf],
    "a day ahead, once": [86400.0],
    "a day back, once": [-86400.0],
}


@pytest.mark.parametrize("stamps", ODD.values(), ids=ODD)
def test_odd_stamps_are_left_out_and_nothing_else(stamps):
    arriving = messages(steps=100)
    odd = [(stamp_s, {"yaw_rate_rad_s": 0.1}) for stamp_s in stamps]
    inbox, found = SensorInbox(RLMA), []
    for stamp_s, message in [*arriving[:120], *odd, *arriving[120:]]:
        inbox.put(stamp_s, **message)
        found += inbox.take()
    assert inbox.left_out == len(odd)
    assert [s["time_s"] for s in [*found, *inbox.flush()]] == [s["time_s"] for s in samples_of(arriving)[0]]


@pytest.mark.parametrize("step_s", [-3600.0, 3600.0])
def test_a_clock_that_is_set_costs_one_message(step_s):
    arriving = messages(steps=200)
    inbox, found = SensorInbox(RLMA), []
    for k, (stamp_s, message) in enumerate(arriving):
        inbox.put(stamp_s + step_s * (k >= 200), **message)
        found += inbox.take()
    times_s = np.array([s["time_s"] for s in [*found, *inbox.flush()]])
    assert inbox.left_out == 1
    before = np.abs(times_s) < 100.0
    assert before.sum() + 2 >= np.count_nonzero([t < arriving[200][0] for t, m in arriving if "wheel_speed_rad_s" in m])
    assert abs(len(times_s) - 200) <= 2 and before[:50].all() and not before[-50:].any()


def test_a_count_at_the_stamp_of_the_one_before_is_not_lost():
    inbox, found = SensorInbox(RLMA, delay_s=0.0, counts_per_turn=1000), []
    for stamp_s, count in [(0.0, 0), (0.1, 100), (0.1, 150), (0.2, 200), (0.3, 300)]:
        inbox.put(stamp_s, wheel_counts=[count, count])
        found += inbox.take()
    speeds = [s["wheel_speed_rad_s"][0] for s in [*found, *inbox.flush()]]
    assert_allclose([speed for speed in speeds if math.isfinite(speed)], 2 * math.pi, rtol=1e-9)


def test_counts_that_arrive_in_bursts_lose_no_way_and_show_no_spike():
    """Counts are read at 10 Hz and arrive three at a time."""
    inbox = SensorInbox(RLMA, delay_s=0.02, counts_per_turn=1000)
    for k in range(300):
        inbox.put(0.1 * (3 * (k // 3) + 2) + 2e-4 * (k % 3), wheel_counts=[10 * k, 10 * k])
    samples = [*inbox.take(), *inbox.flush()]
    known = [(s["time_s"], s["wheel_speed_rad_s"][0]) for s in samples if math.isfinite(s["wheel_speed_rad_s"][0])]
    times_s, speeds = np.array(known)[40:].T
    assert_allclose(speeds, 2 * math.pi * 0.1, rtol=1e-3)
    assert_allclose(np.diff(times_s), 0.3, rtol=1e-3)


@pytest.mark.parametrize("behind_s", [0.0, 0.004, 0.03])
def test_wheels_behind_the_gyro_make_samples_of_their_own_time_each(behind_s):
    """Wheels at 50 Hz arrive with the gyro at 200 Hz, with stamps that are older."""
    inbox, times = SensorInbox(RLMA, delay_s=0.0, prompt=True), []
    for k in range(400):
        now_s = 10.0 + 0.005 * k
        inbox.put(now_s, yaw_rate_rad_s=0.1)
        if k % 4 == 0:
            inbox.put(now_s - behind_s, wheel_speed_rad_s=[1.0 + 1e-3 * k] * 4)
        times += [sample["time_s"] for sample in inbox.take() if np.isfinite(sample["wheel_speed_rad_s"]).all()]
    assert_allclose(times[-90:], 10.0 - behind_s + 0.02 * np.arange(100)[-90:], atol=1e-9)
    assert inbox.left_out <= (behind_s > 0.0)
