from typing import Any

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.logs.drive_log import DriveLog


def a_log(**changes) -> DriveLog:
    values: dict[str, Any] = {
        "time_s": [0.0, 0.1, 0.3],
        "wheel_speed_rad_s": np.arange(12.0).reshape(3, 4),
        "motor_current_A": np.ones((3, 2)),
        "pitch_rad": [0.0, 0.01, 0.02],
        "extra": {"truth": [1.0, 2.0, 3.0]},
    }
    return DriveLog("a drive", **(values | changes))


def test_selected_samples_keep_their_rows_together():
    part = a_log().select(slice(1, 3))
    np.testing.assert_array_equal(part.time_s, [0.1, 0.3])
    np.testing.assert_array_equal(part.wheel_speed_rad_s[:, 0], [4.0, 8.0])
    np.testing.assert_array_equal(part.extra["truth"], [2.0, 3.0])
    assert part.yaw_rate_rad_s is None


def test_between_keeps_the_clock_and_refuses_an_empty_span():
    np.testing.assert_array_equal(a_log().between(0.05, 0.2).time_s, [0.1])
    with pytest.raises(InputError, match="no sample in 5 s"):
        a_log().between(5.0, 6.0)


def test_a_channel_counts_when_it_was_ever_measured():
    assert a_log(speed_m_s=[np.nan] * 3).channels == ("pitch_rad",)


def test_arrays_cannot_be_changed():
    with pytest.raises(ValueError, match="read-only"):
        a_log().wheel_speed_rad_s[0, 0] = 1.0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"time_s": [0.0, 0.2, 0.1]}, "sample 2 .* does not come after sample 1"),
        ({"time_s": [0.0, np.nan, 0.1]}, "finite"),
        ({"wheel_speed_rad_s": [1.0, 2.0, 3.0]}, r"wheel_speed_rad_s must be \(3, wheels\)"),
        ({"motor_current_A": np.ones((2, 2))}, r"motor_current_A must be \(3, wheels\)"),
        ({"pitch_rad": [0.0]}, "pitch_rad has shape"),
    ],
)
def test_refuses_what_is_no_recording(changes, message):
    with pytest.raises(InputError, match=message):
        a_log(**changes)


def test_dates_become_seconds_since_the_first_sample():
    dates = np.array(["2026-01-31T12:00:00.0", "2026-01-31T12:00:00.1", "2026-01-31T12:00:00.3"], dtype="M8[ms]")
    np.testing.assert_allclose(a_log(time_s=dates).time_s, [0.0, 0.1, 0.3], rtol=1e-12)
