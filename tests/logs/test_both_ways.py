"""A current that stands in two columns, one of charge and one of discharge, or has its sign in a column beside it."""

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.logs import read_log


def two_columns(pulses, charge, discharge, sign=1.0):
    """The pulses with their charging and discharging currents apart, `sign` of the second one."""
    time_s, current_A, voltage_V = pulses
    rows = zip(time_s, voltage_V, np.maximum(current_A, 0.0), sign * np.maximum(-current_A, 0.0), strict=True)
    return "\n".join([f"time_s,voltage_V,{charge},{discharge}", *(",".join(map(str, row)) for row in rows)])


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("charge", "discharge"),
    [
        ("charge_current", "discharge_current"),
        ("Charge Current (A)", "Discharge Current (A)"),
        ("I_chg", "I_dsg"),
        ("charging_A", "discharging_A"),
        ("Ladestrom", "Entladestrom"),
        ("current_in", "current_out"),
        ("IN_A", "OUT_A"),
        ("Amps In", "Amps Out"),
        ("Ichg", "Idis"),
        ("Strom Laden [A]", "Strom Entladen [A]"),
        ("courant de charge (A)", "courant de décharge (A)"),
        ("corriente carga", "corriente descarga"),
        ("corrente di carica [A]", "corrente di scarica [A]"),
        ("prąd ładowania", "prąd rozładowania"),
        ("ток заряда", "ток разряда"),
        ("充电电流(A)", "放电电流(A)"),
        ("充電電流", "放電電流"),
        ("충전 전류", "방전 전류"),
    ],
)
def test_the_current_is_the_charging_less_the_discharging(write_text, pulses, charge, discharge, sign):
    log = read_log(write_text(two_columns(pulses, charge, discharge, sign)), extra=())
    np.testing.assert_allclose(log.current_A, pulses[1], atol=1e-12)
    assert any(f"current: {charge!r} less {discharge!r}" in note.text for note in log.notes)


def test_units_may_differ_and_an_empty_cell_is_no_current_that_way(write_text):
    rows = ["0,13.0,2000,", "1,13.0,,3", "2,13.0,,", "3,12.9,0,4.5"]
    text = "\n".join(["time_s,voltage_V,charge_current_mA,discharge_current_A", *rows])
    log = read_log(write_text(text), current_sign="charge")
    np.testing.assert_array_equal(log.current_A, [2.0, -3.0, np.nan, -4.5])


def test_columns_without_a_unit_may_be_milliamperes(write_text, pulses):
    text = two_columns((pulses[0], 1e3 * pulses[1], pulses[2]), "charge_current", "discharge_current")
    assert any(note.options == ("--unit", "current=mA") for note in read_log(write_text(text)).notes)
    log = read_log(write_text(text), units={"current": "mA"})
    np.testing.assert_allclose(log.current_A, pulses[1], atol=1e-9)


def test_another_current_and_one_that_is_named_come_first(write_text, pulses):
    text = two_columns(pulses, "charge_current", "discharge_current")
    named = read_log(write_text(text), columns={"current": "discharge_current"}, current_sign="discharge")
    np.testing.assert_allclose(named.current_A, np.minimum(pulses[1], 0.0))
    lines = text.splitlines()
    wider = "\n".join([f"{lines[0]},current", *(f"{line},{i}" for line, i in zip(lines[1:], pulses[1], strict=True))])
    assert any("current from 'current'" in note.text for note in read_log(write_text(wider)).notes)


def test_the_input_of_a_converter_is_of_the_battery(write_text, pulses):
    rows = (f"{t},{u},{-i},5.0,{-2.2 * i}" for t, i, u in zip(*pulses, strict=True))
    text = "\n".join(["time_s,input_voltage,input_current,output_voltage,output_current", *rows])
    np.testing.assert_allclose(read_log(write_text(text)).current_A, pulses[1], atol=1e-12)


@pytest.mark.parametrize("quantity", ["current", "power"])
def test_what_flows_in_and_out_at_once_is_not_of_a_battery(write_text, quantity):
    """A converter beside it, of an efficiency of 0.9."""
    rows = (f"{k},13.0,{2.0 + k % 7},{0.9 * (2.0 + k % 7)}" for k in range(100))
    text = "\n".join([f"time_s,voltage_V,{quantity}_in,{quantity}_out", *rows])
    match = f"'{quantity}_in' and '{quantity}_out' flow at once in 100% of the rows: .*a converter.*--column"
    with pytest.raises(InputError, match=match):
        read_log(write_text(text))


@pytest.mark.parametrize(
    ("name", "charge", "discharge", "rest"),
    [
        ("Status", "CHG", "DSG", "REST"),
        ("Step Type", "CC Chg", "CC DChg", "Rest"),
        ("Type", "C", "D", "R"),
        ("direction", "charging", "discharging", "idle"),
        ("is_charging", "1", "0", "0"),
        ("charging", "true", "false", "false"),
        ("Modus", "Laden", "Entladen", "Ruhe"),
        ("état", "charge", "décharge", "repos"),
        ("Estado", "Carga", "Descarga", "Reposo"),
        ("Condition", "1", "2", "3"),  # the voltage shows which number is which
        ("charge_status", "3", "1", "0"),
    ],
)
def test_a_current_without_a_sign_has_that_of_the_state(write_text, pulses, name, charge, discharge, rest):
    time_s, current_A, voltage_V = pulses
    current_A = current_A - 0.3  # an idle draw at rest
    state = np.select([current_A > 1.0, current_A < -1.0], [charge, discharge], rest)
    rows = zip(time_s, voltage_V, np.abs(current_A), state, strict=True)
    text = "\n".join([f"time_s,voltage_V,current_A,{name}", *(",".join(map(str, row)) for row in rows)])
    np.testing.assert_allclose(read_log(write_text(text)).current_A, current_A, atol=1e-12)


@pytest.mark.parametrize(
    ("charge", "discharge"),
    [("charge_power_W", "discharge_power_W"), ("P_chg [W]", "P_dis [W]"), ("Ladeleistung", "Entladeleistung"),
     ("power_in", "power_out"), ("wattsIn", "wattsOut")],
)  # fmt: skip
def test_the_power_is_the_charging_less_the_discharging(write_text, pulses, charge, discharge):
    time_s, current_A, voltage_V = pulses
    watts = current_A * voltage_V
    text = two_columns((time_s, watts, voltage_V), charge, discharge)
    log = read_log(write_text(text), extra=())
    np.testing.assert_allclose(log.current_A, current_A, atol=1e-9)
    assert any(f"power: {charge!r} less {discharge!r}" in note.text for note in log.notes)


def test_a_limit_of_a_current_is_none(write_text, pulses):
    with pytest.raises(InputError, match="current"):
        read_log(write_text(two_columns(pulses, "max charge current", "max discharge current")))


@pytest.mark.parametrize(
    ("power", "voltage", "watts"),
    [("power_W", "voltage_V", 1.0), ("Battery Power (kW)", "Battery Voltage (V)", 1e3), ("P [mW]", "U [mV]", 1e-3)],
)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_power_over_the_voltage_is_the_current(write_text, pulses, power, voltage, watts, sign):
    time_s, current_A, voltage_V = pulses
    volts = 1e-3 if "mV" in voltage else 1.0
    rows = zip(time_s, voltage_V / volts, sign * current_A * voltage_V / watts, strict=True)
    log = read_log(write_text("\n".join([f"time_s,{voltage},{power}", *(",".join(map(str, row)) for row in rows)])))
    np.testing.assert_allclose(log.current_A, current_A, atol=1e-12)
    assert any(f"current: {power!r} over {voltage!r}" in note.text for note in log.notes)


@pytest.mark.parametrize("name", ["motor_power_W", "solar power (W)", "p"])
def test_another_power_is_not_the_battery_s(write_text, name):
    with pytest.raises(InputError, match="no column for the current"):
        read_log(write_text(f"time_s,voltage_V,{name}\n0,12,24\n1,12,24\n"))
