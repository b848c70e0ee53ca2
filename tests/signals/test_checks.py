"""One sentence for each fault, with the fix where the fault is mended."""

import math

import pytest

from ohmward.quantities import QUANTITIES
from ohmward.signals.checks import Finding, beyond_limits, in_order, no_numbers, too_seldom

VOLTAGE, CURRENT = QUANTITIES["battery_voltage_V"], QUANTITIES["battery_current_A"]
TEMPERATURE, WHEEL = QUANTITIES["battery_temperature_degC"], QUANTITIES["wheel_speed_rad_s"]


def sentence(quantity, lowest, highest, place, **about):
    return "".join(map(str, beyond_limits(quantity, lowest, highest, quantity.limits, place, **about)))


@pytest.mark.parametrize(
    ("quantity", "lowest", "highest", "setup", "log"),
    [
        (VOLTAGE, 21e3, 28e3, "millivolts? then scale = 0.001", "millivolts? use --unit voltage=mV"),
        (CURRENT, -3e9, 2e9, "microamperes? then scale = 1e-06", "microamperes? use --unit current=uA"),
        (TEMPERATURE, 290.0, 300.0, "kelvins? then offset = -273.15", "kelvins? use --unit temperature=K"),
        (TEMPERATURE, 181.0, 410.0, "tenths of a degree? then scale = 0.1", "use --unit temperature=0.1degC"),
        (VOLTAGE, -28.0, -21.0, "its wires are exchanged", "its wires are exchanged"),
        (VOLTAGE, -28.0, 1e9, "check its unit, scale and offset", "check its column, its unit and the sensor"),
    ],
)
def test_the_fix_is_that_of_the_place(quantity, lowest, highest, setup, log):
    assert setup in sentence(quantity, lowest, highest, "setup")
    assert log in sentence(quantity, lowest, highest, "log")


def test_units_of_wheels_that_are_alike_in_size_are_all_named():
    text = sentence(WHEEL, -2e4, 3e4, "log", radius_m=0.12)
    assert text.endswith("use --unit wheel_speed=rpm, deg/s or mm/s")


def test_a_value_within_its_limits_is_no_finding():
    assert sentence(VOLTAGE, 0.0, 2000.0, "log") == ""


@pytest.mark.parametrize(
    ("count", "expected"),
    [(0, []), (3, ["warning: no number in 3 of 9 values"]), (9, ["error: no number in any of its values"])],
)
def test_values_that_are_no_numbers_are_counted(count, expected):
    assert [f"{one.severity}: {one.text}" for one in no_numbers(count, 9)] == expected


@pytest.mark.parametrize(("rate_hz", "findings"), [(5.0, 0), (4.9, 1), (math.nan, 0)])
def test_a_signal_that_comes_too_seldom(rate_hz, findings):
    assert len(list(too_seldom(WHEEL, rate_hz, 5.0))) == findings


def test_errors_come_first():
    findings = [Finding(severity, severity, "") for severity in ("info", "error", "warning")]
    assert [finding.text for finding in in_order(findings)] == ["error", "warning", "info"]
