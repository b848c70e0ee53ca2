import dataclasses
import json
import re

import numpy as np
import pytest

from needs import measured_file
from ohmward.errors import InputError
from ohmward.logs import Log, Note, examine, read_log
from ohmward.signals.survey import noise_std


@pytest.fixture
def healthy(pulses):
    time_s, current_A, voltage_V = pulses
    rng = np.random.default_rng(1)
    return Log("healthy", time_s, current_A, voltage_V + rng.normal(0, 1e-3, 600), np.full(600, 25.0))


def changed(log, **changes):
    return dataclasses.replace(log, **changes)


def said(log):
    return " | ".join(f"{f.severity}: {f.text} -> {f.advice}" for f in examine(log).findings)


def test_a_healthy_log_has_no_findings(healthy):
    assert said(healthy) == ""
    assert examine(healthy).worst == "info"


def test_numbers_of_a_pulse_log(healthy):
    found = examine(healthy).survey
    current = healthy.current_A
    assert (found.samples, found.duration_s) == (600, 599.0)
    assert (found.sampling.median_s, found.sampling.irregularity, found.sampling.gaps) == (1.0, 0.0, 0)
    assert (found.current.minimum, found.current.maximum) == (current.min(), current.max())
    assert found.activity.pulses == 6
    assert found.activity.rests == 7
    assert found.activity.rest_current_A == 0.0
    one_second_trapezoids = (
        np.maximum(s * current, 0.0)[:-1].sum() + np.maximum(s * current, 0.0)[1:].sum() for s in (-1, 1)
    )
    out, charged = (twice / 7200.0 for twice in one_second_trapezoids)
    assert found.activity.charge_out_Ah == pytest.approx(out, rel=1e-12)
    assert found.activity.charge_in_Ah == pytest.approx(charged, rel=1e-12)
    assert found.activity.charge_in_Ah - found.activity.charge_out_Ah == pytest.approx(healthy.charge_Ah()[-1])
    assert found.sign.resistance_ohm == pytest.approx(0.02, rel=0.05)


@pytest.mark.parametrize("drift", [0.0, 3.0])
def test_noise_is_found_under_drift_and_steps(drift):
    rng = np.random.default_rng(0)
    steps = np.repeat(rng.normal(0, 5, 40), 500)
    values = steps + drift * np.linspace(0, 1, 20_000) + rng.normal(0, 0.02, 20_000)
    # the robust spread of 20 000 differences is good to about 1 %
    assert noise_std(values) == pytest.approx(0.02, rel=0.04)


def test_noise_is_that_of_the_known_values():
    rng = np.random.default_rng(1)
    values = np.where(rng.random(20_000) < 0.9, np.nan, rng.normal(0, 0.02, 20_000))
    assert noise_std(values) == pytest.approx(0.02, rel=0.06)


def test_noise_below_the_resolution_is_that_of_rounding():
    assert noise_std(np.repeat([1.0, 1.5, 2.0], 100)) == pytest.approx(0.5 / np.sqrt(12))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda x: {"voltage_V": 1000 * x.voltage_V},
            "error: the voltage reads 11.* to 12.*plausible are 0 to 2000 -> millivolts. use --unit voltage=mV",
        ),
        (
            lambda x: {"voltage_V": -x.voltage_V},
            "error: the voltage reads -12.* plausible are 0 .* -> its wires are exchanged",
        ),
        (lambda x: {"voltage_V": x.voltage_V / 100}, "error: voltages of 0.12.* at most"),
        (lambda x: {"voltage_V": 0 * x.voltage_V + 12}, "error: the voltage never changes"),
        (
            lambda x: {"current_A": 1000 * x.current_A},
            "error: the current reads -10000 to 14000.* -> milliamperes. use --unit current=mA",
        ),
        (lambda x: {"current_A": 0 * x.current_A - 2}, "error: the current never changes .-2 A.: resistances cannot"),
        (lambda x: {"current_A": -x.current_A}, "error: the voltage answers the current with the wrong sign"),
        (
            lambda x: {"current_A": x.current_A - 0.1},
            "warning: the current at rest reads -0.1 A, .* 0.017 Ah over the log",
        ),
        (lambda x: {"time_s": 20 * x.time_s}, "warning: a sample comes 0.05 times a second; at least 0.1 are needed"),
        (lambda x: {"time_s": x.time_s + 500 * (x.time_s > 300)}, "warning: 1 gap without samples, the longest 501 s"),
        (lambda x: {"time_s": x.time_s + 20 * (x.time_s > 300)}, "info: 1 gap without samples, the longest 21 s"),
        (lambda x: {"time_s": x.time_s + 1.7e9 * (x.time_s > 300)}, "error: a gap of 53.9 years -> the clock was set"),
        (lambda x: {"time_s": np.cumsum(1 + 0.3 * np.sin(x.time_s))}, "info: .* of the intervals differ"),
        (
            lambda x: {"voltage_V": np.where(x.time_s % 9 == 0, np.nan, x.voltage_V)},
            "warning: voltage: no number in 67 of 600 values",
        ),
        (lambda x: {"voltage_V": np.round(x.voltage_V, 1)}, "warning: the voltage has steps of 0.2 V"),
        (lambda x: {"current_A": x.current_A + x.time_s % 10}, "warning: the current has steps of 1 A"),
        (lambda x: {"temperature_degC": None}, "info: no temperature"),
        (
            lambda x: {"temperature_degC": x.temperature_degC + 273},
            "error: the temperature reads 298.* -> kelvins. use --unit temperature=K",
        ),
        (lambda x: {"temperature_degC": np.full(600, np.nan)}, "info: no temperature"),
    ],
)
def test_suspicious_logs_are_named_with_advice(healthy, change, message):
    assert re.search(message, said(changed(healthy, **change(healthy))))


def test_short_logs_and_errors_come_first(healthy):
    findings = examine(
        changed(healthy.select(slice(0, 50)), temperature_degC=None, current_A=np.full(50, 1.0))
    ).findings
    assert [finding.severity for finding in findings] == ["error", "warning", "info", "info"]
    assert examine(healthy.select(slice(0, 1))).worst == "error"


def test_findings_are_ready_for_json(healthy):
    found = examine(healthy.with_notes(Note("something")))
    text = json.dumps(dataclasses.asdict(found), allow_nan=False)
    assert json.loads(text)["notes"] == ["info: something"]


def test_a_log_without_any_current_is_refused(healthy):
    with pytest.raises(InputError, match="current_A has no value"):
        examine(changed(healthy, current_A=np.full(600, np.nan)))


def test_measured_pulse_test():
    """ORNL HPPC: ten 30 A discharge pulses; its README says 0.01 A and 1 mV."""
    found = examine(read_log(measured_file("ornl_nissan_leaf_cell/cell-low-current-hppc-25c-2.parquet"))).survey
    assert found.activity.pulses == 10
    assert found.current.resolution == pytest.approx(0.01, rel=1e-3)
    assert found.voltage.resolution == pytest.approx(0.001, rel=1e-3)
    assert found.sign.resistance_ohm == pytest.approx(1.6e-3, rel=0.1)


def test_measured_lead_acid_offset():
    """BBOXX: its README gives a zero offset of +0.01 to +0.07 A, in a file where positive current discharges."""
    log = read_log(measured_file("bboxx_vrla_12v_17ah/telemetry_2017-03-25_2017-03-29.csv"))
    activity = examine(log).survey.activity
    assert activity.rest_current_A is not None
    assert -0.07 < activity.rest_current_A < -0.005
