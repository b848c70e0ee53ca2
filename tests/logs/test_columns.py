import pytest

from ohmward.errors import InputError
from ohmward.logs.columns import find_columns
from ohmward.logs.units import UNITS, split_unit


def found(names, **overrides):
    """Quantity -> (column, symbol of its unit)."""
    chosen = find_columns("f.csv", names, **overrides)
    return {quantity: (column.name, column.unit and column.unit.symbol) for quantity, column in chosen.items()}


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        ("time_s current_A voltage_V temp1_C", ["s", "A", "V", "degC"]),
        ("test_time_second current_ampere voltage_volt", ["s", "A", "V"]),
        ("t I U", [None, None, None]),
        ("timestamp_ns I_batt V_batt", ["ns", None, None]),
        ("time_min current_mA voltage_mV temperature_K", ["min", "mA", "mV", "K"]),
        ("time/s <I>/mA Ewe/V", ["s", "mA", "V"]),
        ("Time(h) Current(mA) Voltage(mV) Temperature(C)_1", ["h", "mA", "mV", "degC"]),
        ("%time field.current field.voltage field.temperature", [None] * 4),
        ("__time /battery_state/current /battery_state/voltage /battery_state/temperature", [None] * 4),
        ("header.stamp.sec battery.current battery.voltage", ["s", None, None]),
        ("created_at BatteryCurrentAmps BatteryVolts BatteryTempCelsius", [None, "A", "V", "degC"]),
        ("t_ms current_ma_avg bus_mv_avg", ["ms", "mA", "mV"]),
        ("t_ms I[mA] U[V] Temp1[Deg]", ["ms", "mA", "V", "degC"]),
        ("Timestamp pack_current_milliamps pack_voltage_millivolts battery_temp_degF", [None, "mA", "mV", "degF"]),
    ],
)
def test_names_of_the_field(names, expected):
    names = names.split()
    quantities = ("time", "current", "voltage", "temperature")
    assert found(names) == dict(zip(quantities, zip(names, expected, strict=True), strict=False))


def test_bdf_labels_with_spaces_and_brackets():
    names = ["Test Time / s", "Voltage / V", "Current / A", "Battery Temperature [°C]"]
    assert [unit for _, unit in found(names).values()] == ["s", "A", "V", "degC"]


@pytest.mark.parametrize(
    ("quantity", "winner", "losers"),
    [
        ("current", "current_A", ["motor_current_A", "current_true_A", "current_std_A", "max_current"]),
        ("voltage", "Voltage", ["Cell_Voltage_1", "Cell_Voltage_2", "ocv_V", "voltage_limit_V"]),
        ("voltage", "battery_voltage", ["cell_voltage"]),
        ("voltage", "bus_voltage", ["ch1_V", "Vf"]),
        ("current", "amps", ["I_ch", "Im", "CH2 (A)"]),
        ("time", "Time", ["AT", "received_at"]),
        ("voltage", "voltage", ["v", "u", "voltage_avg"]),
        ("voltage", "cell_voltage", ["bus_voltage"]),
        ("voltage", "avg_voltage", ["v_max", "speed"]),
        ("time", "t", ["timestamp"]),
        ("time", "Test_Time(s)", ["Step_Time(s)", "Date_Time"]),
        ("time", "elapsed_s", ["timestamp"]),
        ("temperature", "temperature", ["ambient_temperature"]),
        ("temperature", "Temperature T1 / degC", ["Ambient Temperature / degC"]),
        ("temperature", "Surface Temperature T1 / degC", ["Ambient Temperature / degC"]),
        ("temperature", "temperature_t1_celsius", ["ambient_temperature_celsius"]),
        ("current", "I (A)", ["soc", "i2c_errors", "capacity_Ah"]),
        ("voltage", "Battery Monitor [279] Voltage", ["Solar Charger [258] Voltage"]),
    ],
)
def test_the_battery_wins_over_its_neighbours(quantity, winner, losers):
    others = {"time": "time_s", "current": "current", "voltage": "voltage"}
    others.pop(quantity, None)
    assert found([*losers, winner, *others.values()])[quantity][0] == winner


def test_t_is_a_time_and_needs_a_unit_to_be_a_temperature():
    assert "temperature" not in found(["t", "I", "U"])
    assert found(["t", "I", "U", "T / K"])["temperature"] == ("T / K", "K")


@pytest.mark.parametrize(
    "name", ["Inverter temperature (°C)", "motor_temperature", "MOSFET temperature", "cpu temperature"]
)
def test_the_temperature_of_another_device_is_not_that_of_the_battery(name):
    assert "temperature" not in found(["t", "I", "U", name])


@pytest.mark.parametrize("names", ["currentA currentB currentC", "I_A I_B", "Motorstrom", "Ladeendspannung"])
def test_the_current_of_a_phase_or_of_a_motor_is_not_that_of_the_battery(names):
    with pytest.raises(InputError, match="no column for the current found"):
        find_columns("f.csv", ["time", *names.split(), "voltage"])


def test_current_is_also_an_adjective():
    with pytest.raises(InputError, match="no column for the current found"):
        find_columns("f.csv", ["time", "current_speed", "current_time", "current_ms", "voltage"])
    assert found(["time", "current_speed", "motor_current", "voltage"])["current"] == ("motor_current", None)


def test_overrides_win():
    names = ["time_s", "current_A", "I_motor_mA", "voltage_V"]
    assert found(names, columns={"current": "I_motor_mA"})["current"] == ("I_motor_mA", "mA")
    assert found(names, columns={"current": "i_MOTOR_ma"})["current"] == ("I_motor_mA", "mA")
    assert found(names, units={"voltage": "mV"})["voltage"] == ("voltage_V", "mV")


@pytest.mark.parametrize(
    ("names", "overrides", "message"),
    [
        ("time I_1 current voltage", {"columns": {"current": "I_2"}}, r"no column 'I_2' .*did you mean 'I_1'\?"),
        ("time left_current right_current voltage", {}, r"both 'left_current' and 'right_current'.*--column current="),
        (
            "time b_current b_voltage a_voltage a_current",
            {},
            "2 batteries.* --column current=b_current --column voltage=b_voltage or --column current=a_current --col",
        ),
        ("time a_current voltage b_current", {}, r"columns=\{'current': 'NAME'\}"),
        ("time voltage power", {}, r"no column for the current found; it has: 'time', 'voltage', 'power'"),
        ("time voltage consumed_mAh", {}, "charge or energy is counted in 'consumed_mAh': log the current"),
        ("time voltage", {}, r"no column for the current found; it has no more than 'time', 'voltage'; .* record both"),
        ("time current input_mV output_mV", {}, r"both 'input_mV' and 'output_mV' may be the voltage"),
        ("time curLeft voltage", {}, r"choose with --column current=curLeft"),
        ("time Curr(A) RxBt(V)", {}, r"choose with --column 'voltage=RxBt\(V\)'"),
        (
            "a b",
            {},
            "time found; no column for the current found; no column for the voltage found.*time=NAME --column cur",
        ),
        ("time I_1 I_2 spannugn", {}, "both 'I_1' and 'I_2' .*current=NAME --column voltage=spannugn"),
        (
            "time Charge_(Ah) voltage",
            {"columns": {"current": "Charge_(Ah)"}},
            "is in Ah, which is no unit",
        ),
        ("time current voltage", {"units": {"current": "mV"}}, r"unit 'mV' of the current is not known; use .*mA"),
        ("time current voltage", {"units": {"soc": "%"}}, r"unknown quantity 'soc'"),
        ("time current voltage", {"columns": {"amps": "current"}}, r"unknown quantity 'amps'; ohmward knows time, cur"),
    ],
)
def test_refusals_name_the_columns_and_the_fix(names, overrides, message):
    with pytest.raises(InputError, match=message):
        find_columns("f.csv", names.split(), **overrides)


@pytest.mark.parametrize(
    ("symbol", "value", "si"),
    [("mA", 1500.0, 1.5), ("mV", 12600.0, 12.6), ("K", 298.15, 25.0), ("degF", 77.0, 25.0), ("h", 2.0, 7200.0)],
)
def test_units_convert(symbol, value, si):
    unit = next(unit for unit in UNITS.values() if unit.symbol == symbol)
    assert value * unit.scale + unit.offset == pytest.approx(si, rel=1e-12)


@pytest.mark.parametrize(
    ("name", "scale"),
    [
        ("Amps*100", 0.01),
        ("current_x10", 0.1),
        ("I [mA] x 10", 1e-4),
        ("I (10mA)", 0.01),
        ("current_0.1A", 0.1),
        ("Current 10mA", 0.01),
    ],
)
def test_a_factor_in_a_name_is_that_of_its_numbers(name, scale):
    unit = find_columns("f.csv", ["time_s", "voltage_V", name])["current"].unit
    assert unit is not None and unit.scale == pytest.approx(scale, rel=1e-12)


def test_every_notation_of_a_unit_reads_alike():
    for name in (
        "Current [mA]",
        "Current (mA)",
        "Current / mA",
        "Current/mA",
        "Current_mA",
        "Current mA",
        "Current.mA",
    ):
        assert split_unit(name)[0] == ("Current", UNITS["ma"]), name


@pytest.mark.parametrize(
    ("names", "time", "current", "voltage"),
    [
        (["Time(S)", "Cur(A)", "Vol(V)"], ("Time(S)", 1.0), ("Cur(A)", 1.0), ("Vol(V)", 1.0)),
        (
            ["ms_today", "input_voltage", "current_motor", "current_in", "d_axis_current", "q_axis_current"],
            ("ms_today", 1e-3),
            ("current_in", None),
            ("input_voltage", None),
        ),
        (["time", "voltage_now", "current_now"], ("time", None), ("current_now", 1e-6), ("voltage_now", 1e-6)),
        (
            ["ms", "busVoltage", "shuntVoltage_mV", "current_mA"],
            ("ms", 1e-3),
            ("current_mA", 1e-3),
            ("busVoltage", None),
        ),
        (
            ["time (us)", "vbatLatest (V)", "amperageLatest (A)"],
            ("time (us)", 1e-6),
            ("amperageLatest (A)", 1.0),
            ("vbatLatest (V)", 1.0),
        ),
        (["Time", "VFAS(V)", "Curr(A)", "RxBt(V)"], ("Time", None), ("Curr(A)", 1.0), ("VFAS(V)", 1.0)),
        (["ts", "payload.pack.u", "payload.pack.i"], ("ts", None), ("payload.pack.i", None), ("payload.pack.u", None)),
        (
            ["timestamp [UTC]", "Battery voltage [V]", "Battery current [A]"],
            ("timestamp [UTC]", None),
            ("Battery current [A]", 1.0),
            ("Battery voltage [V]", 1.0),
        ),
        (
            ["Zeit [s]", "Batteriespannung [V]", "Batteriestrom [A]"],
            ("Zeit [s]", 1.0),
            ("Batteriestrom [A]", 1.0),
            ("Batteriespannung [V]", 1.0),
        ),
        (["Zeitstempel", "Spannung", "Strom"], ("Zeitstempel", None), ("Strom", None), ("Spannung", None)),
        (["Schrittzeit/s", "Gesamtzeit/s", "U/V", "I/A"], ("Gesamtzeit/s", 1.0), ("I/A", 1.0), ("U/V", 1.0)),
        (
            ["Hora", "Voltaje batería", "Corriente batería"],
            ("Hora", None),
            ("Corriente batería", None),
            ("Voltaje batería", None),
        ),
        (["Temps", "Tension", "Intensité"], ("Temps", None), ("Intensité", None), ("Tension", None)),
        (["uptime", "vbat", "ibat"], ("uptime", None), ("ibat", None), ("vbat", None)),
        (["TS1", "Timestamp", "vbat", "ibat"], ("Timestamp", None), ("ibat", None), ("vbat", None)),
        (["Fecha y hora", "Tension", "corriente"], ("Fecha y hora", None), ("corriente", None), ("Tension", None)),
        (["Tid", "Spänning", "Ström"], ("Tid", None), ("Ström", None), ("Spänning", None)),
        (["Tijd", "Spanning", "Stroom"], ("Tijd", None), ("Stroom", None), ("Spanning", None)),
        (["Zaman", "Gerilim (V)", "Akım (A)"], ("Zaman", None), ("Akım (A)", 1.0), ("Gerilim (V)", 1.0)),
        (["Čas", "Napětí [V]", "Proud [A]"], ("Čas", None), ("Proud [A]", 1.0), ("Napětí [V]", 1.0)),
        (["tempo_ms", "tensao_V", "corrente_A"], ("tempo_ms", 1e-3), ("corrente_A", 1.0), ("tensao_V", 1.0)),
        (["clock", "U", "I"], ("clock", None), ("I", None), ("U", None)),
        (["clock", "time", "U", "I"], ("time", None), ("I", None), ("U", None)),
        (["unix_s", "volt", "amp"], ("unix_s", 1.0), ("amp", None), ("volt", 1.0)),
        (["Time", "BattV", "BattA", "SOC"], ("Time", None), ("BattA", 1.0), ("BattV", 1.0)),
        (["t", "Battery [mV]", "Battery [A]", "Motor [A]"], ("t", None), ("Battery [A]", 1.0), ("Battery [mV]", 1e-3)),
        (
            ["Time", "Chan 101 (VDC)", "Chan 102 (ADC)"],
            ("Time", None),
            ("Chan 102 (ADC)", 1.0),
            ("Chan 101 (VDC)", 1.0),
        ),
        (
            ["Time (s)", "Corrected time (s)", "WE(1).Potential (V)", "WE(1).Current (A)"],
            ("Time (s)", 1.0),
            ("WE(1).Current (A)", 1.0),
            ("WE(1).Potential (V)", 1.0),
        ),
        (["T [s]", "Vf [V vs. Ref.]", "Im [A]"], ("T [s]", 1.0), ("Im [A]", 1.0), ("Vf [V vs. Ref.]", 1.0)),
        (["received_at", "timestamp", "U", "I"], ("timestamp", None), ("I", None), ("U", None)),
        (["EnqueuedTimeUtc", "U", "I"], ("EnqueuedTimeUtc", None), ("I", None), ("U", None)),
        (["received_at", "U", "I"], ("received_at", None), ("I", None), ("U", None)),
        (["Time", "V1", "V2", "Ibat", "Vtot"], ("Time", None), ("Ibat", None), ("Vtot", None)),
        (["ts", "I_pack", "U_pack", "U1", "U2", "U3"], ("ts", None), ("I_pack", None), ("U_pack", None)),
        (
            ["timeMs", "tempC", "busVoltageV", "currentMA"],
            ("timeMs", 1e-3),
            ("currentMA", 1e-3),
            ("busVoltageV", 1.0),
        ),
        (["millis()", "V", "I"], ("millis()", 1e-3), ("I", None), ("V", None)),
        (
            ["timestamp", 'voltage_volts{robot="r1"}', 'current {robot="r1"} [mA]'],
            ("timestamp", None),
            ('current {robot="r1"} [mA]', 1e-3),
            ('voltage_volts{robot="r1"}', 1.0),
        ),
        (
            ["field.header.stamp", "field.voltage", "field.current"],
            ("field.header.stamp", None),
            ("field.current", None),
            ("field.voltage", None),
        ),
        (
            ["日時", "バッテリー電圧(V)", "バッテリー電流(A)"],
            ("日時", None),
            ("バッテリー電流(A)", 1.0),
            ("バッテリー電圧(V)", 1.0),
        ),
        (
            ["记录时间", "电池组总电压", "电池组总电流"],
            ("记录时间", None),
            ("电池组总电流", None),
            ("电池组总电压", None),
        ),
        (["측정시간", "배터리전압", "배터리전류"], ("측정시간", None), ("배터리전류", None), ("배터리전압", None)),
        (["Tijd", "Accuspanning", "Accustroom"], ("Tijd", None), ("Accustroom", None), ("Accuspanning", None)),
        (["Idő", "Feszültség", "Áram"], ("Idő", None), ("Áram", None), ("Feszültség", None)),
        (
            ["Horodatage", "Tension de la batterie", "Courant de la batterie", "Courant moteur"],
            ("Horodatage", None),
            ("Courant de la batterie", None),
            ("Tension de la batterie", None),
        ),
        (
            ["Time", "Cumulative Time", "Current(A)", "Voltage(V)"],
            ("Cumulative Time", None),
            ("Current(A)", 1.0),
            ("Voltage(V)", 1.0),
        ),
        (
            ["time", "POWER_SUPPLY_VOLTAGE_NOW", "POWER_SUPPLY_CURRENT_NOW"],
            ("time", None),
            ("POWER_SUPPLY_CURRENT_NOW", 1e-6),
            ("POWER_SUPPLY_VOLTAGE_NOW", 1e-6),
        ),
    ],
)
def test_loggers_with_names_of_their_own_are_read(names, time, current, voltage):
    found = find_columns("log.csv", names)
    columns = [found[quantity] for quantity in ("time", "current", "voltage")]
    assert [(column.name, column.unit and column.unit.scale) for column in columns] == [time, current, voltage]


@pytest.mark.parametrize(
    ("better", "worse"), [("battery.voltage", "input.voltage"), ("current", "current_now"), ("v_bat", "bus voltage")]
)
def test_a_choice_of_last_resort_stands_back(better, worse):
    quantity = "current" if "current" in better else "voltage"
    names = ["time", "voltage", "current"]
    names = [name for name in names if name != quantity]
    assert find_columns("log.csv", [*names, worse, better])[quantity].name == better


@pytest.mark.parametrize("name", ["Test Time(h:min:s)", "Total Time (Hours in hh:mm:ss.xxx)"])
def test_how_a_time_is_written_is_no_part_of_its_name(name):
    assert found(["Record", name, "I(A)", "U(V)"])["time"] == (name, None)


def test_names_of_a_shunt_and_of_averages_are_those_of_the_battery():
    names = ["time", "Pack voltage Ave. (V)", "Shunt current Ave. (mA)"]
    chosen = find_columns("log", names)
    assert [chosen[q].name for q in ("time", "voltage", "current")] == names


def test_of_two_times_one_is_proposed_not_a_number_of_the_row():
    names = ["Index", "Time", "Relative Time", "current_A", "voltage_V"]
    head = {"Index": ["1", "2", "3"], "Time": ["9:00:01", "9:00:02", "9:00:03"], "Relative Time": ["0", "1", "2"]}
    with pytest.raises(InputError, match="both 'Time' and 'Relative Time' may be the time") as refused:
        find_columns("log", names, head=head)
    assert refused.value.options == ("--column", "time=Relative Time")
    assert find_columns("log", ["Date", *names])["time"].name == "Relative Time"
