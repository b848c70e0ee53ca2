import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from ohmward.errors import InputError
from ohmward.logs.clean import (
    drop_text,
    drop_untimed,
    gap_notes,
    merge_rates,
    missing_notes,
    to_si,
    without_rows_of_zeros,
    without_silent_spikes,
    without_spikes,
)
from ohmward.logs.columns import Column
from ohmward.logs.log import without_impossible
from ohmward.logs.table import Table
from ohmward.logs.units import UNITS
from ohmward.quantities import QUANTITIES
from ohmward.signals.survey import find_gaps

TEMPERATURE, VOLTAGE = QUANTITIES["battery_temperature_degC"], QUANTITIES["battery_voltage_V"]

CHOSEN = {
    "time": Column("time", UNITS["s"]),
    "current": Column("I", UNITS["ma"]),
    "voltage": Column("U", None),
    "temperature": Column("T", UNITS["k"]),
}
NAN = np.nan


def table(**columns):
    arrays = {name: np.asarray(values) for name, values in columns.items()}
    return Table("f.csv", arrays, np.arange(2, 2 + len(next(iter(arrays.values())))), "line")


def texts(cleaned):
    return [note.text for note in cleaned.notes]


def test_units_become_si_and_are_noted():
    cleaned = to_si(table(I=[1500.0, NAN], U=[12.0, np.inf], T=[298.15, 273.15]), CHOSEN)
    np.testing.assert_allclose(cleaned.columns["I"], [1.5, NAN])
    np.testing.assert_allclose(cleaned.columns["U"], [12.0, NAN])
    np.testing.assert_allclose(cleaned.columns["T"], [25.0, 0.0], atol=1e-12)
    assert "1 infinite value of 'U' treated as missing" in texts(cleaned)
    assert "current from 'I' in mA" in texts(cleaned)
    assert "voltage from 'U', which names no unit: assumed to be V" in texts(cleaned)


def test_text_in_numbers_is_named_with_its_place():
    cells = np.array(["12.0", "", "OVERLOAD", "x"], dtype=object)
    with pytest.raises(InputError, match=r"f.csv, line 4, column 'U': 'OVERLOAD' is not a number; correct the cell"):
        to_si(table(I=[1.0] * 4, U=cells, T=[0.0] * 4), CHOSEN)


@pytest.mark.parametrize("quantity", ["I", "U"])
def test_a_column_without_values_is_refused(quantity):
    columns = {"I": [1.0, 1.0], "U": [12.0, 12.0], "T": [0.0, 0.0], quantity: [NAN, NAN]}
    with pytest.raises(InputError, match=f"column '{quantity}' has no value"):
        to_si(table(**columns), CHOSEN)


def test_rows_without_a_time_are_dropped():
    cleaned = drop_untimed(table(time=[0.0, NAN, 2.0], I=[1.0, 2.0, 3.0]), "time")
    np.testing.assert_array_equal(cleaned.columns["I"], [1.0, 3.0])
    assert texts(cleaned) == ["1 row without a time: dropped"]
    with pytest.raises(InputError, match="column 'time' has no value"):
        drop_untimed(table(time=[NAN, NAN]), "time")


def test_text_and_empty_columns_are_left_out_and_named():
    cleaned = drop_text(table(a=[1, 2], mode=np.array(["x", "y"], dtype=object), e=[NAN, NAN]))
    assert list(cleaned.columns) == ["a"]
    assert cleaned.columns["a"].dtype == float
    assert texts(cleaned) == ["text columns left out: 'mode'", "empty columns left out: 'e'"]


def test_a_temperature_on_rows_of_its_own_is_interpolated():
    cleaned = merge_rates(
        table(
            time=[0.0, 1.0, 2.0, 4.0, 5.0],
            I=[1.0, NAN, 2.0, NAN, 3.0],
            U=[12.0, NAN, 12.1, NAN, 12.2],
            T=[NAN, 20.0, NAN, 26.0, NAN],
        ),
        CHOSEN,
    )
    np.testing.assert_array_equal(cleaned.columns["time"], [0.0, 2.0, 5.0])
    np.testing.assert_allclose(cleaned.columns["T"], [20.0, 22.0, 26.0])
    assert "'T' is interpolated at 3 samples from 2 values" in texts(cleaned)
    assert "2 rows with neither current nor voltage: dropped" in texts(cleaned)


def changes_alone(values):
    """The values (T,) where they differ from the one before."""
    return np.where(np.diff(values, prepend=np.nan) == 0.0, NAN, values)


def test_a_recorder_of_changes_holds_each_value_until_the_next():
    """A load of an hour: between two rows of the current the battery gave no ramp."""
    rng, time_s = np.random.default_rng(1), np.arange(7200.0)
    current_A = np.where(time_s < 3600, 0.0, -5.0)
    voltage_V = np.round(13.2 + 0.03 * current_A + 0.004 * rng.standard_normal(7200), 2)
    sparse = [changes_alone(values) for values in (current_A, voltage_V)]
    rows = np.isfinite(sparse).any(axis=0)
    cleaned = merge_rates(table(time=time_s[rows], I=sparse[0][rows], U=sparse[1][rows], T=[25.0] * rows.sum()), CHOSEN)
    at = np.searchsorted(time_s, cleaned.columns["time"] + 1e-9) - 1
    np.testing.assert_array_equal(cleaned.columns["I"], current_A[at])
    np.testing.assert_array_equal(cleaned.columns["U"], voltage_V[at])
    assert np.diff(cleaned.columns["time"]).max() <= np.median(np.diff(time_s[rows]))  # no silence is left
    assert "'I': only changes are written, each value holds until the next one" in texts(cleaned)


def test_missing_values_of_a_coarse_sensor_are_no_changes():
    rng = np.random.default_rng(2)
    voltage_V = np.round(13.2 + 0.01 * rng.standard_normal(400), 2)
    voltage_V[::7] = NAN
    cleaned = merge_rates(table(time=np.arange(400.0), I=np.full(400, -1.0), U=voltage_V, T=[25.0] * 400), CHOSEN)
    np.testing.assert_array_equal(cleaned.columns["U"], voltage_V)


def test_a_current_on_rows_of_its_own_is_interpolated():
    cleaned = merge_rates(
        table(time=[0.0, 1.0, 2.0, 3.0], I=[1.0, NAN, 3.0, NAN], U=[NAN, 12.0, NAN, 12.1], T=[1.0] * 4), CHOSEN
    )
    np.testing.assert_allclose(cleaned.columns["I"], [1.0, 2.0, 3.0, 3.0])
    np.testing.assert_array_equal(cleaned.columns["U"], [NAN, 12.0, NAN, 12.1])


@pytest.mark.parametrize("missing", [[], [7], [7, 20, 21]])
def test_current_and_voltage_in_turn_are_samples_of_both(missing):
    """Rows of a long table, some of which are missing."""
    k = np.delete(np.arange(60), missing)
    odd = k % 2 == 1
    cleaned = merge_rates(
        table(time=1.0 * k, I=np.where(odd, NAN, 0.1 * k), U=np.where(odd, 12.0, NAN), T=np.full(len(k), 20.0)), CHOSEN
    )
    np.testing.assert_array_equal(cleaned.columns["time"], k[odd])
    np.testing.assert_allclose(cleaned.columns["I"][:-1], 0.1 * k[odd][:-1])
    assert f"{(~odd).sum()} rows of a current alone: joined with the voltages" in texts(cleaned)


def test_a_current_that_is_faster_than_the_voltage_keeps_its_rows():
    k = np.arange(60)
    voltage_V = np.where(k % 5 == 1, 12.0, NAN)
    cleaned = merge_rates(
        table(time=1.0 * k, I=np.where(k % 5 == 1, NAN, 0.1 * k), U=voltage_V, T=np.full(60, 20.0)), CHOSEN
    )
    np.testing.assert_allclose(cleaned.columns["I"], 0.1 * k)
    np.testing.assert_array_equal(cleaned.columns["U"], voltage_V)


def test_single_missing_values_stay_missing_and_are_counted():
    cleaned = merge_rates(table(time=[0.0, 1.0, 2.0], I=[1.0, NAN, 3.0], U=[NAN, 12.0, 12.1], T=[1.0] * 3), CHOSEN)
    np.testing.assert_array_equal(cleaned.columns["I"], [1.0, NAN, 3.0])
    assert [note.text for note in missing_notes(cleaned, CHOSEN)] == [
        "current: no number in 1 of 3 values",
        "voltage: no number in 1 of 3 values",
    ]


@pytest.mark.parametrize(
    ("time_s", "gaps"),
    [
        (np.arange(50.0), []),
        (np.concatenate([np.arange(10.0), np.arange(30.0, 40.0)]), [9]),
        (np.concatenate([np.arange(10.0), [600.0]]), [9]),
        (np.concatenate([np.arange(100.0), 100.0 + 60.0 * np.arange(20)]), []),
        ([0.0, 1000.0], []),
        ([0.0], []),
    ],
)
def test_gaps_are_lonely_long_intervals(time_s, gaps):
    np.testing.assert_array_equal(find_gaps(np.asarray(time_s)), gaps)


@given(arrays(float, st.integers(2, 40), elements=st.sampled_from([1.0, 9.0, 10.0, 11.0, 100.0, 101.0, 1500.0])))
def test_gaps_are_what_they_are_defined_as(intervals):
    around = [0.0, *intervals, 0.0]
    limits = [10.0 * max(around[k], around[k + 2], np.median(intervals)) for k in range(intervals.size)]
    time_s = np.concatenate([[0.0], np.cumsum(intervals)])
    np.testing.assert_array_equal(find_gaps(time_s), np.flatnonzero(intervals > limits))


def test_gaps_are_noted_with_count_and_longest():
    time_s = np.concatenate([np.arange(10.0), np.arange(30.0, 40.0), np.arange(100.0, 110.0)])
    assert [note.text for note in gap_notes(time_s)] == ["2 gaps, the longest 61 s after 39 s"]


def voltages():
    """A pack of 28 V under loads of single rows that take a quarter of it away."""
    return 28.0 - 7.0 * (np.arange(400) % 20 == 0)


@pytest.mark.parametrize("value", [65.535, 0.0, -1.0, 14.0])
@pytest.mark.parametrize("rows", [[0], [399], [7, 8, 9], [5, 50, 200, 202]])
def test_single_rows_of_a_voltage_that_no_battery_shows_are_left_out_and_counted(value, rows):
    voltage_V = voltages()
    voltage_V[rows] = value
    found_V, notes = without_spikes(VOLTAGE, voltage_V)
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(found_V)), rows)
    assert [note.level for note in notes] == ["warning"]
    assert f"{len(rows)} voltage" in notes[0].text and f"of {value:g} V left out" in notes[0].text


@pytest.mark.parametrize("stretch", [slice(0, 0), slice(100, 104), slice(380, 400)])
def test_loads_and_a_voltage_that_stays_away_are_measured(stretch):
    """A test may take a cell, or a capacitor, far down."""
    voltage_V = voltages()
    voltage_V[stretch] = 2.0
    assert without_spikes(VOLTAGE, voltage_V) == (voltage_V, ())


@pytest.mark.parametrize("code_V", [0.0, 65.535, 65535 * 1e-3, 99.99, 655.35])
def test_a_voltage_that_stands_for_none_is_no_measurement_however_long_it_lasts(code_V):
    voltage_V = np.where(np.arange(400) < 60, code_V, 13.2)
    found_V, notes = without_spikes(VOLTAGE, voltage_V)
    np.testing.assert_array_equal(np.isnan(found_V), voltage_V == code_V)
    assert f"60 voltages of {code_V:g} V left out" in str(notes)


def test_rows_of_zeros_are_no_rest():
    voltage_V = np.array([13.2, 0.0, 0.0, 13.1, 13.0])
    current_A = np.array([-2.0, 0.0, 0.0, 0.0, np.nan])
    found_A, found_V, (note,) = without_rows_of_zeros(current_A, voltage_V)
    np.testing.assert_array_equal(found_A, [-2.0, np.nan, np.nan, 0.0, np.nan])
    np.testing.assert_array_equal(found_V, [13.2, np.nan, np.nan, 13.1, 13.0])
    assert str(note) == "warning: 2 rows of 0 A and 0 V left out: no measurement"


@pytest.mark.parametrize("value", [-40.0, 0.0, 85.0])
def test_single_temperatures_far_from_those_around_are_left_out_and_counted(value):
    degC = 23.0 + 10.0 * np.linspace(0.0, 1.0, 400)
    degC[[3, 200, 201]] = value
    found_degC, notes = without_spikes(TEMPERATURE, degC)
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(found_degC)), [3, 200, 201])
    assert f"3 temperatures of {value:g} degC left out" in notes[0].text


def test_a_battery_that_is_carried_into_the_cold_keeps_its_temperatures():
    degC = np.repeat([23.0, -5.0, 40.0], 100)
    assert without_spikes(TEMPERATURE, degC) == (degC, ())


def loads():
    """Pulses of 8 A, and a voltage that answers them."""
    current_A = np.where(np.arange(400) // 10 % 3 == 1, -8.0, -0.3)
    return current_A, 28.0 + 0.05 * current_A


@pytest.mark.parametrize("value", [655.35, -32.768, 3276.7])
@pytest.mark.parametrize("voltage", ["stays", "is lost"])
def test_single_currents_that_the_voltage_does_not_answer_are_left_out_and_counted(value, voltage):
    current_A, voltage_V = loads()
    current_A[[0, 57, 399]] = value
    if voltage == "is lost":
        voltage_V[[0, 57, 399]] = np.nan
    found_A, notes = without_silent_spikes(current_A, voltage_V)
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(found_A)), [0, 57, 399])
    assert [(note.level, note.text[:11]) for note in notes] == [("warning", "3 currents ")]


@pytest.mark.parametrize("rows", [slice(100, 160), slice(0, 400, 25)])
@pytest.mark.parametrize("value", [9999.0, -32.768, -32768 * 1e-3, 655.35])
def test_a_current_that_stands_for_none_is_left_out_however_often_it_comes(value, rows):
    current_A, voltage_V = loads()
    current_A[rows] = value
    found_A, (note,) = without_silent_spikes(current_A, voltage_V)
    np.testing.assert_array_equal(np.isnan(found_A), current_A == value)
    assert note.level == "warning" and f"currents of {value:g} A left out" in note.text


@pytest.mark.parametrize("later", [0, 1])
def test_an_inrush_that_the_voltage_answers_is_measured(later):
    current_A, voltage_V = loads()
    current_A[57] = -40.0
    voltage_V[57 + later] -= 0.05 * 39.7
    assert without_silent_spikes(current_A, voltage_V) == (current_A, ())


def test_temperatures_that_no_battery_has_are_left_out_and_counted():
    cut = np.array([21.0, -127.0, 21.5, np.nan, 22.0])
    found_degC, notes = without_impossible(TEMPERATURE, cut)
    np.testing.assert_array_equal(found_degC, [21.0, np.nan, 21.5, np.nan, 22.0])
    assert notes[0].text == "1 temperature of -127 degC left out: no battery has them"
    kelvin = np.array([294.0, 295.0, 21.0])
    assert without_impossible(TEMPERATURE, kelvin) == (kelvin, ())
