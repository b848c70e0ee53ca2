import numpy as np
import pytest
from scipy.stats import binom

from ohmward.errors import InputError
from ohmward.traction.speed_observer.estimate import SlipAlarm


@pytest.mark.parametrize("rate", [1e-3, 0.02])
def test_at_the_allowed_slip_it_alarms_as_often_as_stated(rate):
    test = SlipAlarm(false_alarm_rate=rate, allowed_m_s=0.03, allowed_ratio=0.1)
    std, samples = 0.01, 200_000
    slip = 0.03 + 0.1 * 0.5 + std * np.random.default_rng(0).standard_normal(samples)
    alarms = np.count_nonzero(test.slips(slip, std, 0.5))
    assert binom.ppf(1e-4, samples, rate) < alarms < binom.ppf(1 - 1e-4, samples, rate)


def test_a_wheel_that_locks_slips_too_and_none_is_without_doubt():
    test = SlipAlarm()
    assert test.slips(0.3, 0.02, 0.5) and test.slips(-0.3, 0.02, 0.0)
    assert not test.slips(0.3, 0.2, 0.5)


def test_stuck_only_where_the_speed_is_known_to_be_small():
    test = SlipAlarm()
    assert test.stands(0.0, 0.01, 0.5)
    assert not test.stands(0.0, 0.05, 0.5)
    assert not test.stands(0.2, 0.01, 0.5)
    assert not test.stands(0.0, 0.001, 0.05)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"false_alarm_rate": 0.5}, "slip_alarm.false_alarm_rate must be > 0 and < 0.5"),
        ({"stuck_ratio": 1.0}, "slip_alarm.stuck_ratio must be > 0 and < 1"),
        ({"stuck_s": -1.0}, "slip_alarm.stuck_s must be >= 0"),
        ({"stuck_rim_m_s": 0.0}, "slip_alarm.stuck_rim_m_s must be > 0"),
    ],
)
def test_what_is_refused(change, message):
    with pytest.raises(InputError, match=message):
        SlipAlarm(**change)
