import numpy as np
import pytest

from needs import measured_file
from ohmward.logs import read_log
from ohmward.logs.doctor import examine
from ohmward.logs.hints import FileHints
from ohmward.logs.log import Log, UnknownSignError
from ohmward.signals.current_sign import change_test, edge_test, sign_evidence, trend_test, turned_sign
from ohmward.signals.survey import resolution


@pytest.mark.parametrize(("sign", "verdict"), [(1.0, "charge"), (-1.0, "discharge")])
def test_pulses_tell_the_sign_and_the_resistance(pulses, sign, verdict):
    time_s, current_A, voltage_V = pulses
    evidence = sign_evidence(time_s, sign * current_A, voltage_V)
    assert evidence.verdict == verdict
    assert evidence.edges.resistance_ohm == pytest.approx(sign * 0.02, rel=0.01)
    assert evidence.edges.edges == np.count_nonzero(np.diff(current_A))


def test_the_resistance_is_the_least_squares_slope_over_the_edges():
    current_A = np.repeat([0.0, -4.0, 1.0, 0.0, 3.0], 20)
    voltage_V = 12.0 + 0.03 * current_A + np.repeat([0.0, 0.01, -0.02, 0.005, 0.0], 20)
    dI, dV = np.diff(current_A), np.diff(voltage_V)
    slope = np.linalg.lstsq(dI[:, None], dV, rcond=None)[0][0]
    assert edge_test(current_A, voltage_V).resistance_ohm == pytest.approx(slope, rel=1e-12)


def test_the_ripple_of_a_steady_current_is_no_edge():
    ripple = np.where(np.arange(400) % 40 == 0, 0.01, 0.0)
    assert edge_test(-3.0 + ripple, 12.0 - np.arange(400) / 4000.0).edges == 0


@pytest.mark.parametrize(("sign", "expected"), [(1.0, 1), (-1.0, -1)])
def test_a_steady_discharge_without_edges_tells_the_sign(sign, expected):
    time_s = np.arange(0.0, 3600.0, 10.0)
    falling = 12.6 - time_s / 3600.0
    assert trend_test(time_s, np.full(time_s.size, -3.0 * sign), falling) == expected
    assert sign_evidence(time_s, np.full(time_s.size, 3.0 * sign), falling[::-1]).trend == expected


def test_relaxation_under_a_small_current_is_not_a_trend():
    """After 10 A, 0.1 A still discharge while the voltage rises and settles."""
    time_s = np.arange(0.0, 1800.0, 10.0)
    relaxing = 12.0 - 0.2 * np.exp(-time_s / 200.0)
    assert trend_test(time_s, np.full(time_s.size, -0.1), relaxing) == 0


def test_a_trend_against_the_edges_is_undecidable(pulses):
    time_s, current_A, voltage_V = pulses
    time_s = np.concatenate([time_s, 600.0 + np.arange(4000.0)])
    current_A = np.concatenate([current_A, np.full(4000, -10.0)])
    voltage_V = np.concatenate([voltage_V, np.linspace(11.8, 13.8, 4000)])
    evidence = sign_evidence(time_s, current_A, voltage_V)
    assert (evidence.edges.sign, evidence.trend, evidence.verdict) == (1, -1, "undecidable")


def test_many_small_edges_tell_the_sign_through_a_coarse_voltmeter():
    """Steps of 0.1 V at a resolution of 0.1 V, as the voltmeters of many robots have it: nine say it, three do not."""
    current_A = np.repeat([0.0, -10.0] * 5, 30)
    voltage_V = np.round(12.0 + 0.01 * current_A, 1)
    assert sign_evidence(np.arange(300.0), current_A, voltage_V).verdict == "charge"
    assert sign_evidence(np.arange(120.0), current_A[:120], voltage_V[:120]).verdict == "undecidable"


@pytest.mark.parametrize("size", [0, 1, 2, 5, 500, 501, 502, 503])
def test_noise_is_undecidable(size):
    rng = np.random.default_rng(size)
    evidence = sign_evidence(np.arange(float(size)), rng.normal(size=size), 12.0 + rng.normal(size=size))
    assert evidence.verdict == "undecidable"
    assert "no clear trend" in str(evidence)


def test_rest_is_undecidable():
    assert sign_evidence(np.arange(100.0), np.zeros(100), np.full(100, 12.0)).verdict == "undecidable"


def test_missing_samples_are_left_out(pulses):
    time_s, current_A, voltage_V = pulses
    current_A, voltage_V = current_A.copy(), voltage_V.copy()
    current_A[::7], voltage_V[::11] = np.nan, np.nan
    assert sign_evidence(time_s, current_A, voltage_V).verdict == "charge"


def test_resolution_is_the_smallest_step_and_ignores_rounding_of_float32():
    assert resolution(np.array([1.0, 1.25, 1.75])) == 0.25
    assert resolution(np.array([3.0, 3.0 + 1e-7, 3.001])) == pytest.approx(0.001, rel=1e-3)
    assert resolution(np.array([2.0, 2.0])) == 0.0


MEASURED = [
    ("ornl_nissan_leaf_cell/cell-low-current-hppc-25c-2.parquet", {}, "charge"),
    ("ornl_nissan_leaf_cell/cell-discharge-bitrode-1c.parquet", {}, "charge"),
    ("panasonic_18650pf/25degC_Cycle_1.parquet", {}, "charge"),
    ("panasonic_18650pf/25degC_C20_OCV.parquet", {}, "charge"),
    ("panasonic_18650pf/0degC_HPPC.parquet", {}, "charge"),
    ("plett_a123_lfp/a123_ocv.parquet", {"temp_C": 25, "script": 1}, "charge"),
    ("plett_a123_lfp/a123_ocv.parquet", {"temp_C": -25, "script": 4}, "charge"),
    ("plett_a123_lfp/a123_dyn.parquet", {"temp_C": 5, "script": 1}, "discharge"),
    ("plett_a123_lfp/a123_dyn.parquet", {"temp_C": 45, "script": 2}, "discharge"),
    ("calce_a123_lfp/a1_C20_charge_20C.parquet", {}, "charge"),
    ("calce_inr18650_20r/DST_25C_80SOC.parquet", {}, "discharge"),
    ("bboxx_vrla_12v_17ah/telemetry_2017-03-25_2017-03-29.csv", {}, "discharge"),
]


def raw(path, where):
    """Current and voltage of a file with the file's own sign."""
    from ohmward.logs import read_log

    log = read_log(path, where=where, current_sign="charge", extra=())
    return log.time_s, log.current_A, log.voltage_V


@pytest.mark.parametrize(("name", "where", "verdict"), MEASURED)
def test_measured_recordings_tell_their_sign(name, where, verdict):
    assert sign_evidence(*raw(measured_file(name), where)).verdict == verdict


@pytest.mark.parametrize(("name", "where", "verdict"), MEASURED)
def test_windows_of_measured_recordings_tell_the_right_sign_or_none(name, where, verdict):
    """Windows of 5 to 3000 samples; one in some thousand is wrong (a lone edge just as the cell collapses)."""
    signals = raw(measured_file(name), where)
    rng = np.random.default_rng(3)
    wrong = []
    for size in (5, 10, 30, 100, 300, 1000, 3000):
        for start in rng.integers(0, max(signals[0].size - size, 1), 10):
            window = slice(start, start + size)
            if sign_evidence(*(x[window] for x in signals)).verdict not in (verdict, "undecidable"):
                wrong.append((size, int(start)))
    assert wrong == []


@pytest.mark.parametrize(("sign", "verdict"), [(1.0, "charge"), (-1.0, "discharge")])
@pytest.mark.parametrize(("samples", "cells"), [(300, 1), (4000, 13)])
def test_a_current_that_never_stands_still_tells_the_sign(sign, verdict, samples, cells):
    """No change is an edge, because each is of the usual size."""
    rng = np.random.default_rng(samples)
    current_A = np.convolve(rng.normal(size=samples + 59), np.exp(-np.arange(60) / 20.0), "valid") - 3.0
    voltage_V = cells * (3.7 + 0.02 * current_A + 0.005 * rng.normal(size=samples))
    evidence = sign_evidence(np.arange(float(samples)), sign * current_A, voltage_V)
    assert (evidence.edges.sign, evidence.trend, evidence.verdict) == (0, 0, verdict)
    assert "over all changes" in str(evidence)


def test_a_voltage_that_was_sampled_later_than_a_restless_current_is_undecidable():
    rng = np.random.default_rng(1)
    current_A = rng.normal(size=2001)
    voltage_V = 12.0 + 0.05 * current_A[:-1] + 0.01 * rng.normal(size=2000)
    assert sign_evidence(np.arange(2000.0), current_A[1:], voltage_V).verdict == "undecidable"


def test_windows_of_a_car_never_tell_the_wrong_sign():
    import pandas as pd

    table = pd.read_parquet(measured_file("bmw_i3_trips/trips_odd.parquet"))
    verdicts = []
    for _, trip in table.groupby("trip"):
        current_A, voltage_V = trip["current_A"].to_numpy(float), trip["voltage_V"].to_numpy(float)
        windows = range(0, current_A.size - 600, 600)
        verdicts += [change_test(current_A[k : k + 600], voltage_V[k : k + 600]) for k in windows]
    assert len(verdicts) > 600
    assert verdicts.count(-1) == 0
    assert verdicts.count(0) < 0.04 * len(verdicts)


def _cycled(charge_A, discharge_A, seed=0):
    """Times [s], current [A] and voltage [V] of discharges and charges of steady current between rests."""
    rng = np.random.default_rng(seed)
    current_A = np.concatenate([np.repeat([0.0, -discharge_A, 0.0, charge_A], 60) for _ in range(3)])
    soc = 0.5 + np.cumsum(current_A) / 3600.0
    voltage_V = 3.2 + soc + 0.02 * current_A + 0.0005 * rng.normal(size=current_A.size)
    return np.arange(float(current_A.size)), current_A, voltage_V


def _read(time_s, current_A, voltage_V, sign="auto"):
    import pandas as pd

    frame = pd.DataFrame({"time_s": time_s, "current_A": current_A, "voltage_V": voltage_V})
    return read_log(frame, current_sign=sign)


@pytest.mark.parametrize(("charge_A", "discharge_A"), [(2.0, 2.0), (1.0, 4.0), (4.0, 1.5)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_size_for_charge_and_discharge_has_lost_its_sign(charge_A, discharge_A, sign):
    time_s, current_A, voltage_V = _cycled(charge_A, discharge_A)
    assert _read(time_s, sign * current_A, voltage_V).current_A == pytest.approx(current_A)
    with pytest.raises(UnknownSignError, match="has lost its sign"):
        _read(time_s, sign * np.abs(current_A), voltage_V)
    log = _read(time_s, sign * np.abs(current_A), voltage_V, "charge")
    assert [note.level for note in log.notes if "has lost its sign" in note.text] == ["warning"]


def test_the_doctor_finds_that_no_sign_is_right():
    time_s, current_A, voltage_V = _cycled(2.0, 2.0)
    found = examine(Log("day", time_s, -np.abs(current_A), voltage_V))
    assert ["has lost its sign" in finding.text for finding in found.findings if finding.severity == "error"] == [True]
    assert examine(Log("day", time_s, current_A, voltage_V)).worst != "error"


def test_one_direction_has_not_lost_its_sign():
    time_s, current_A, voltage_V = _cycled(0.0, 2.0)
    assert _read(time_s, -current_A, voltage_V).current_A == pytest.approx(current_A)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("creeps_V", [0.0, 0.02])
def test_a_charger_that_tapers_off_does_not_tell_the_wrong_sign(sign, creeps_V):
    """The current falls while the voltage rises: dV / dI is negative in every sample, and no resistance is."""
    fading = np.exp(-np.arange(700) / 150.0)
    current_A, voltage_V = sign * 4.0 * fading, np.round(4.2 - creeps_V * fading, 4)
    assert change_test(current_A, voltage_V) == 0
    assert sign_evidence(10.0 * np.arange(700), current_A, voltage_V).verdict == "undecidable"


@pytest.mark.parametrize("late", [0, 1, 2, 3])
def test_a_voltage_that_is_some_samples_late_never_tells_the_wrong_sign(late):
    rng = np.random.default_rng(1)
    levels = rng.choice([-2.0, -30.0, -70.0, -100.0, 30.0], 900, p=[0.3, 0.25, 0.2, 0.15, 0.1])
    current_A = np.repeat(levels, 1 + rng.geometric(0.5, levels.size) % 4)
    voltage_V = np.round(13.2 + 1e-3 * np.concatenate([np.full(late, current_A[0]), current_A])[: current_A.size], 2)
    edges = edge_test(current_A, voltage_V)
    assert edges.sign == (1 if late == 0 else 0)


@pytest.fixture
def turned(tmp_path):
    """A log of 1800 s, written with the other sign from 900 s on; the first edge after that is at 930 s."""
    time_s = np.arange(1800.0)
    right_A = np.repeat(np.resize([-4.0, 0.0, -1.0, 2.0], 60), 30)
    voltage_V = 12.0 + 0.05 * right_A + 1e-4 * np.random.default_rng(3).normal(size=time_s.size)
    current_A = np.where(time_s < 900.0, right_A, -right_A)
    path = tmp_path / "day.csv"
    np.savetxt(
        path,
        np.column_stack([time_s, current_A, voltage_V]),
        delimiter=",",
        header="time_s,current_A,voltage_V",
        comments="",
    )
    return path, right_A


def test_a_sign_that_turns_within_a_log_is_named_with_its_moment(turned):
    path, _ = turned
    with pytest.raises(UnknownSignError, match=r"charges the battery up to 870 s .* discharges it from 930 s on"):
        read_log(path)
    notes = "; ".join(map(str, read_log(path, current_sign="charge").notes))
    assert "warning: positive current charges the battery (given), but the sign of the current turns" in notes
    assert "read each part alone, with --to 870 and with --from 930" in notes


@pytest.mark.parametrize("hints", [FileHints(stop="870"), FileHints(start="930")])
def test_each_part_of_a_log_whose_sign_turns_has_its_own(turned, hints):
    path, right_A = turned
    log = read_log(path, hints=hints)
    assert log.current_A == pytest.approx(right_A[log.time_s.astype(int)])


def test_four_clear_edges_before_a_turn_are_enough():
    right_A = np.repeat(np.resize([-4.0, 0.0, -1.0, 2.0], 30), 30)
    current_A = np.where(np.arange(right_A.size) < 160, -right_A, right_A)
    found = turned_sign(np.arange(right_A.size), current_A, 12.0 + 0.05 * right_A)
    assert found is not None
    assert "up to 150 s (4 edges)" in found.text


@pytest.mark.parametrize("share", [0.0, 0.02])
def test_a_sign_that_hardly_ever_turns_is_one(share):
    current_A = np.repeat(np.resize([-4.0, 0.0, -1.0, 2.0], 100), 30)
    voltage_V = 12.0 + 0.05 * current_A
    current_A[: int(share * current_A.size)] *= -1.0
    assert turned_sign(np.arange(current_A.size), current_A, voltage_V) is None
