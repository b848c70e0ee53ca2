import pickle
from datetime import UTC, datetime, timedelta, timezone

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.logs import Log, Note
from ohmward.logs.frame import plain_array


def log(**changes):
    arrays = {"time_s": [0.0, 1.0, 3.0], "current_A": [1.0, -1.0, -1.0], "voltage_V": [12.1, 11.9, 11.8]}
    return Log(**{"name": "test", **arrays, **changes})


def test_one_ampere_for_one_hour_is_one_ampere_hour():
    steady = log(time_s=[0.0, 1800.0, 3600.0], current_A=[1.0, 1.0, 1.0])
    np.testing.assert_allclose(steady.charge_Ah(), [0.0, 0.5, 1.0], rtol=1e-15)


def test_charge_is_the_exact_integral_of_a_current_linear_between_samples():
    time_s = np.array([0.0, 1.0, 1.5, 4.0, 4.1])
    ramp = log(time_s=time_s, current_A=2.0 * time_s, voltage_V=np.zeros(5))
    np.testing.assert_allclose(ramp.charge_Ah(), time_s**2 / 3600.0, rtol=1e-14)


def test_charge_bridges_a_missing_current():
    bridged = log(current_A=[2.0, np.nan, 8.0])
    np.testing.assert_allclose(bridged.charge_Ah()[-1], 15.0 / 3600.0)
    assert np.isnan(log(current_A=[np.nan] * 3).charge_Ah()).all()


def test_intervals_and_duration():
    assert log().duration_s == 3.0
    np.testing.assert_array_equal(log().dt_s, [1.0, 2.0])
    assert len(log()) == 3


def test_between_takes_the_start_and_leaves_the_stop():
    part = log(temperature_degC=[20.0, 21.0, 22.0], extra={"soc": [0.3, 0.2, 0.1]}).between(1.0, 3.0)
    np.testing.assert_array_equal(part.time_s, [1.0])
    np.testing.assert_array_equal(part.temperature_degC, [21.0])
    np.testing.assert_array_equal(part.extra["soc"], [0.2])


def test_between_without_samples_raises():
    with pytest.raises(InputError, match=r"no sample in 10 s <= time < 20 s; it spans 0 s to 3 s"):
        log().between(10.0, 20.0)


def test_arrays_are_read_only_and_the_callers_are_not():
    mine = np.array([1.0, 2.0, 3.0])
    made = log(current_A=mine)
    with pytest.raises(ValueError, match="read-only"):
        made.current_A[0] = 5.0
    mine[0] = 7.0


def test_a_log_travels_between_processes():
    copy = pickle.loads(pickle.dumps(log(extra={"a": [1.0, 2.0, 3.0]}, notes=(Note("n"),))))
    np.testing.assert_array_equal(copy.extra["a"], [1.0, 2.0, 3.0])
    assert copy.notes == (Note("n"),)


def test_its_representation_is_one_line():
    assert (
        repr(Log("day", np.arange(7200.0), np.zeros(7200), np.full(7200, 13.0)))
        == "Log('day', 7200 samples in 2 h 00 min)"
    )


def test_describe_names_ranges_missing_values_and_notes():
    text = log(voltage_V=[12.0, np.nan, 11.0]).with_notes(Note("a gap", "warning")).describe()
    assert "test: 3 samples, 3 s, median interval 1.5 s" in text
    assert "voltage: 11 to 12 V, 1 missing" in text
    assert "warning: a gap" in text


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"time_s": [0.0, 1.0, 1.0]}, r"sample 2 \(1 s\) does not come after sample 1 \(1 s\)"),
        ({"time_s": [0.0, np.nan, 1.0]}, "time_s must be finite"),
        ({"current_A": [1.0]}, r"current_A has shape \(1,\), time_s has \(3,\)"),
        ({"extra": {"soc": [1.0, 2.0]}}, r"soc has shape \(2,\)"),
        ({"time_s": []}, "at least one sample"),
        ({"temperature_degC": [1.0]}, "temperature_degC has shape"),
    ],
)
def test_bad_arrays_raise(changes, message):
    with pytest.raises(InputError, match=message):
        log(**changes)


NOON = datetime(2026, 1, 31, 12, tzinfo=UTC)


@pytest.mark.parametrize(
    "time_s",
    [
        np.array(["2026-01-31T12:00:00", "2026-01-31T12:00:01", "2026-01-31T12:00:03"], dtype="M8[s]"),
        np.array(["2026-01-31T12:00:00", "2026-01-31T12:00:01", "2026-01-31T12:00:03"], dtype="M8[ns]"),
        [NOON + timedelta(seconds=k) for k in (0, 1, 3)],
        [NOON.replace(tzinfo=None) + timedelta(seconds=k) for k in (0, 1, 3)],
        [(NOON + timedelta(seconds=k)).astimezone(timezone(timedelta(hours=-5))) for k in (0, 1, 3)],
    ],
)
def test_dates_become_seconds_since_the_first_sample(time_s):
    dated = log(time_s=time_s)
    np.testing.assert_array_equal(dated.time_s, [0.0, 1.0, 3.0])
    assert dated.start_unix_s == NOON.timestamp()
    assert dated.select(slice(1, 3)).start_unix_s == NOON.timestamp()
    assert log(time_s=time_s, start_unix_s=5.0).start_unix_s == 5.0


@pytest.mark.parametrize(
    "time_s", [np.array([2000, 3000, 5000], dtype="m8[ms]"), [timedelta(seconds=k) for k in (2, 3, 5)]]
)
def test_durations_become_seconds_and_keep_their_zero(time_s):
    np.testing.assert_array_equal(log(time_s=time_s).time_s, [2.0, 3.0, 5.0])


def test_none_is_a_missing_value():
    np.testing.assert_array_equal(log(voltage_V=[12.1, None, 11.8]).voltage_V, [12.1, np.nan, 11.8])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"current_A": ["a", "b", "c"]}, "Log 'test': current_A must be numbers, not text"),
        ({"voltage_V": np.zeros(3, dtype="M8[s]")}, "voltage_V must be numbers, not dates; only time_s may be"),
        ({"extra": {"took": np.zeros(3, dtype="m8[s]")}}, "took must be numbers, not durations"),
        ({"time_s": ["now", "then", "never"]}, "time_s must be numbers, not text"),
        ({"time_s": [NOON, None, NOON]}, "time_s must be finite; drop the samples without a time"),
        ({"current_A": [[1.0], [1.0, 2.0], 3.0]}, "current_A must be an array of numbers"),
    ],
)
def test_what_is_no_number_is_refused(changes, message):
    with pytest.raises(InputError, match=message):
        log(**changes)


def test_what_numpy_masks_is_missing():
    current = np.ma.masked_array([-1.0, 999.0, -1.0], [False, True, False])
    dates = np.ma.masked_array(np.array(["2026-01-01", "2026-01-02"], "M8[ns]"), [False, True])
    np.testing.assert_array_equal(np.isnat(plain_array(dates)), [False, True])
    np.testing.assert_array_equal(Log("m", np.arange(3.0), current, np.full(3, 13.0)).current_A, [-1.0, np.nan, -1.0])


def test_the_temperature_is_a_line_over_broken_samples():
    """A thermometer without contact reports -127 degC."""
    nan = float("nan")
    given = {"time_s": [0, 1, 2, 4, 5, 6], "current_A": [0.0] * 6, "voltage_V": [12.0] * 6}
    found = log(**given, temperature_degC=[nan, 2.0, nan, -127.0, 10.0, nan])
    assert found.temperature_along(25.0) == pytest.approx([2.0, 2.0, 4.0, 8.0, 10.0, 10.0])
    for none in (None, [nan] * 6, [-127.0] * 6):
        assert log(**given, temperature_degC=none).temperature_along(25.0).tolist() == [25.0] * 6
