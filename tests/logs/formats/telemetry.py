"""Logs of battery managements, robots, vehicles and houses."""

from __future__ import annotations

import json
from collections.abc import Callable
from datetime import timedelta
from zoneinfo import ZoneInfo

from logs.formats.known import LOG, Format, lines, rows_of, text_file

FAMILY = "telemetry"
CELLS = 4


def f(name: str, text: str, file: str = "log.csv", **about) -> Format:
    encoding = about.pop("encoding", "utf-8")
    return Format(name, FAMILY, text_file(file, text, encoding), LOG, **about)


def cells_of(voltage: float, unit: float = 1.0) -> list[float]:
    """Voltages of four cells whose sum is that of the pack."""
    return [round(unit * (voltage / CELLS + off), 4) for off in (0.002, -0.001, 0.0, -0.001)]


def iso(at) -> str:
    return at.strftime("%Y-%m-%dT%H:%M:%SZ")


def us(at) -> int:
    return round(at.timestamp() * 1e6)


JK = ("Date", "Total Voltage(V)", "Current(A)", "Remain Capacity(Ah)", "SOC(%)", "MOS Temp(°C)", "T1(°C)", "T2(°C)",
      *(f"Cell {k + 1:02d}(V)" for k in range(CELLS)))  # fmt: skip
JK_ROWS = rows_of(LOG, lambda t, i, u, c, at: (
    at.strftime("%Y/%m/%d %H:%M:%S"), u, i, 100, 80, c + 5, c, c, *cells_of(u)))  # fmt: skip
DALY = ("Time", "SOC", "Total voltage", "Current", "Max cell voltage", "Min cell voltage", "Temp 1", "Charge MOS",
        "Discharge MOS")  # fmt: skip
DALY_ROWS = rows_of(LOG, lambda t, i, u, c, at: (
    at.strftime("%Y-%m-%d %H:%M:%S"), "80%", f"{u:.3f}V", f"{i:.1f}A", "3.302V", "3.298V", f"{c:.1f}℃", "ON", "ON"
))  # fmt: skip
XIAOXIANG = ("timestamp", "voltage", "current", "capacity", "soc", "temp1", "temp2", "cell1", "cell2", "cell3", "cell4")
XIAOXIANG_ROWS = rows_of(LOG, lambda t, i, u, c, at: (
    at.strftime("%d.%m.%y %H:%M:%S"), u, i, 100, 80, c, c, *cells_of(u)))  # fmt: skip
VICTRON = ("Timestamp", "Battery voltage (V)", "Battery current (A)", "State of charge (%)", "Temperature (°C)")
VICTRON_ROWS = rows_of(LOG, lambda t, i, u, c, at: (iso(at), u, i, 80, c))
BERLIN = ZoneInfo("Europe/Berlin")
VRM = lines((), [
    ["timestamp", "Battery Monitor [258]", "Battery Monitor [258]", "Battery Monitor [258]", "Battery Monitor [258]",
     "Solar Charger [260]"],
    ["Europe/Berlin (+01:00)", "Voltage", "Current", "State of charge", "Battery temperature", "PV power"],
    ["", "V", "A", "%", "°C", "W"],
    *rows_of(LOG, lambda t, i, u, c, at: (at.astimezone(BERLIN).strftime("%Y-%m-%d %H:%M:%S"), u, i, 80, c, 0)),
])  # fmt: skip

ROS2 = rows_of(LOG, lambda t, i, u, c, at: (
    int(at.timestamp()), 0, "base_link", u, c, i, 9.6, 12.0, 12.0, 0.8, 2, 1, 3, "True", *cells_of(u),
    *[c] * CELLS, "slot1", "SN4711"))  # fmt: skip
ROS1 = rows_of(LOG, lambda t, i, u, c, at: (us(at) * 1000, 7, us(at) * 1000, "base", u, i, 9.6, c))
ROS1_NAMES = ("%time", "field.header.seq", "field.header.stamp", "field.header.frame_id", "field.voltage",
              "field.current", "field.charge", "field.temperature")  # fmt: skip
PLOTJUGGLER = ("__time", "/battery_state/current", "/battery_state/voltage", "/battery_state/temperature")
FOXGLOVE = ("elapsed", "timestamp", "topic", "value", "battery.voltage", "battery.current", "battery.temperature")
PX4 = ("timestamp", "voltage_v", "current_a", "current_average_a", "discharged_mah", "remaining", "temperature")
#: PX4 counts discharge as positive, and time in us since it was switched on.
PX4_ROWS = rows_of(LOG, lambda t, i, u, c, at: (round(1e6 * t) + 12_345_678, u, -i, -i, 0, 0.8, c))
ARDUPILOT = ("TimeUS", "Inst", "Volt", "VoltR", "Curr", "CurrTot", "EnrgTot", "Temp", "Res", "RemPct")
ARDUPILOT_ROWS = rows_of(LOG, lambda t, i, u, c, at: (round(1e6 * t) + 12_345_678, 0, u, u + 0.05, -i, 0, 0, c, 0, 80))
CAN = ("Time[s]", "BMS_PackVoltage[V]", "BMS_PackCurrent[A]", "BMS_CellTempAvg[degC]", "BMS_SoC[%]")
TURNIGY = ("Seconds", "Volts", "Amps", "Watts", "Ah", "Temp C")


def influx(annotated: bool) -> str:
    """One table for each field, as `influx query --raw` and the interface of InfluxDB 2 write them."""
    notes = (
        "#group,false,false,true,true,false,false,true,true,true\n"
        "#datatype,string,long,dateTime:RFC3339,dateTime:RFC3339,dateTime:RFC3339,double,string,string,string\n"
        "#default,_result,,,,,,,,\n"
    )
    head = ",result,table,_start,_stop,_time,_value,_field,_measurement,host"
    begin, end = iso(LOG.start), iso(LOG.start + timedelta(seconds=300))
    text = ""
    for k, name in enumerate(("current", "voltage", "temperature")):
        values = (LOG.current_A, LOG.voltage_V, LOG.temperature_degC)[k]
        rows = [
            f",,{k},{begin},{end},{iso(at)},{v},{name},battery,rpi" for at, v in zip(LOG.moments, values, strict=True)
        ]
        text += (
            (notes if annotated else "") + "\n".join([head, *rows, "", ""])
            if annotated or not k
            else "\n".join([*rows, ""])
        )
    return text


def long_table(head: str, row: Callable[..., str], names: tuple[str, str, str], changes: bool) -> str:
    """A row for each value; with `changes` only those that differ from the one before."""
    columns = (LOG.current_A, LOG.voltage_V, LOG.temperature_degC)
    text = [head]
    for name, values in zip(names, columns, strict=True):
        for k, (at, value) in enumerate(zip(LOG.moments, values, strict=True)):
            if not changes or k == 0 or value != values[k - 1]:
                text.append(row(name, value, at))
    return "\n".join(text) + "\n"


HASS_NAMES = ("sensor.battery_current", "sensor.battery_voltage", "sensor.battery_temperature")
HASS = long_table(
    "entity_id,state,last_changed",
    lambda name, value, at: f"{name},{value},{at.strftime('%Y-%m-%dT%H:%M:%S.000Z')}", HASS_NAMES, True,
).replace("sensor.battery_temperature,21.0,", "sensor.battery_temperature,unavailable,2026-03-28T09:14:59.000Z\n"
          "sensor.battery_temperature,21.0,", 1)  # fmt: skip
METRICS = long_table(
    "time,name,value", lambda name, value, at: f"{iso(at)},{name},{value}", ("current", "voltage", "temperature"), False
)


def objects() -> list[dict]:
    return [
        {"ts": at.timestamp(), "battery": {"voltage": u, "current": i, "temperature": c}, "ok": True}
        for (t, i, u, c), at in zip(LOG.rows(), LOG.moments, strict=True)
    ]


JSON_COLUMNS = {"time_s": LOG.time_s.tolist(), "current_A": LOG.current_A.tolist(), "voltage_V": LOG.voltage_V.tolist(),
                "temperature_degC": LOG.temperature_degC.tolist()}  # fmt: skip
GRAFANA = ("Time", "battery current", "battery voltage", "battery temperature")
GRAFANA_ROWS = rows_of(LOG, lambda t, i, u, c, at: (
    f'"{at:%Y-%m-%d %H:%M:%S}"', f'"{i} A"', f'"{u} V"', f'"{c} °C"'))  # fmt: skip
SHELLY = rows_of(LOG, lambda t, i, u, c, at: (int(at.timestamp()), u, i, c))

EDGETX = ("Date", "Time", "1RSS(dB)", "RxBt(V)", "VFAS(V)", "Curr(A)", "Capa(mAh)", "GPS", "Thr")
EDGETX_ROWS = rows_of(LOG, lambda t, i, u, c, at: (
    at.strftime("%Y-%m-%d"), at.strftime("%H:%M:%S.000"), -60, 5.1, u, -i, 0, "", 0))  # fmt: skip
BETAFLIGHT = ("loopIteration", " time (us)", " axisP[0]", " vbatLatest (V)", " amperageLatest (A)", " gyroADC[2]")
BETAFLIGHT_ROWS = rows_of(LOG, lambda t, i, u, c, at: (int(t), round(1e6 * t) + 5_000_000, 0, u, -i, 1))
#: Hundredths of a volt and of an ampere; the voltages of the known log have three decimals.
EXPLORER = ("loopIteration", "time", "axisP[0]", "vbatLatest", "amperageLatest")
EXPLORER_ROWS = rows_of(LOG, lambda t, i, u, c, at: (int(t), round(1e6 * t) + 5_000_000, 0, 100 * u, -100 * i))
VESC = ("ms_today", "input_voltage", "temp_mos_max", "temp_motor", "current_motor", "current_in", "d_axis_current",
        "q_axis_current", "erpm", "duty_cycle")  # fmt: skip
VESC_ROWS = rows_of(LOG, lambda t, i, u, c, at: (
    round(1000 * t) + 36_000_000, u, c + 5, c + 3, -2 * i, -i, 0, -2 * i, 1000, 0.3))  # fmt: skip
LEAFSPY = ("Date/Time", "Lat", "Long", "Elv", "Speed", "Gids", "SOC", "AHr", "Pack Volts", "Pack Amps", "Max CP mV",
           "Pack T1 C", "Pack T2 C", "12V Bat Amps", "Hx", "12V Bat Volts", "Odo(km)")  # fmt: skip
LEAFSPY_ROWS = rows_of(LOG, lambda t, i, u, c, at: (
    at.strftime("%m/%d/%Y %H:%M:%S"), "51 2.1", "7 1.1", 20, 10, 200, "80%", 100, u, -i, 3300, c, c, 1.2, 90, 14.1, 1000
))  # fmt: skip
EBC = "EBC-A20\nD-CC 5.20A\n" + lines(
    ("Time(S)", "Cur(A)", "Vol(V)"), rows_of(LOG, lambda t, i, u, c, at: (int(t), i, u))
)
SYSFS = ("time", "status", "voltage_now", "current_now", "temp")
SYSFS_ROWS = rows_of(LOG, lambda t, i, u, c, at: (
    at.timestamp(), "Discharging", round(1e6 * u), round(1e6 * i), round(10 * c)))  # fmt: skip
INA219 = ("ms", "busVoltage", "shuntVoltage_mV", "current_mA", "power_mW")
INA219_ROWS = rows_of(LOG, lambda t, i, u, c, at: (round(1000 * t), u, 0.3, round(-1000 * i, 1), 7000))
PACK_ROWS = rows_of(LOG, lambda t, i, u, c, at: (at.strftime("%Y-%m-%d %H:%M:%S"), u, i, *cells_of(u), c))
DATAFLASH = "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\n" + (
    "FMT, 130, 40, BAT, QBfff, TimeUS,Inst,Volt,Curr,Temp\n"
) + "".join(f"BAT, {round(1e6 * t) + 12_345_678}, 0, {u}, {-i}, {c}\n" for t, i, u, c in LOG.rows())  # fmt: skip


def each_line(write: Callable[..., str]) -> str:
    return "".join(write(*row, at) + "\n" for row, at in zip(LOG.rows(), LOG.moments, strict=True))


#: Tags, a text and a whole number beside the fields.
PROTOCOL = each_line(lambda t, i, u, c, at: (
    f'battery,robot=r1,pack=a voltage={u},current={i},temperature={c},state="ok",n=5i {us(at) * 1000}'))  # fmt: skip
PROTOCOLS = each_line(lambda t, i, u, c, at: "\n".join(
    f"{name},robot=r\\ 1 value={value} {us(at) * 1000}"
    for name, value in (("voltage", u), ("current", i), ("temperature", c))))  # fmt: skip
MQTT = each_line(lambda t, i, u, c, at: json.dumps(
    {"ts": at.timestamp(), "topic": "robot/bms", "payload": {"pack": {"v": u, "i": i}, "temperatures": [c, c]}}
))  # fmt: skip

#: What Victron's monitors send: two blocks in turn, each with a checksum of any byte.
VE_DIRECT = each_line(lambda t, i, u, c, at: (
    f"PID\t0x203\nV\t{round(1000 * u)}\nT\t{c}\nI\t{round(1000 * i)}\nP\t{round(u * i)}\nSOC\t800\nAlarm\tOFF\n"
    "Checksum\t\xd8\nH1\t-102738\nH7\t11000\nH17\t45\nChecksum\t\x07"))  # fmt: skip
UEVENT = each_line(lambda t, i, u, c, at: (
    f"POWER_SUPPLY_NAME=BAT0\nPOWER_SUPPLY_STATUS=Charging\nPOWER_SUPPLY_VOLTAGE_NOW={round(1e6 * u)}\n"
    f"POWER_SUPPLY_CURRENT_NOW={round(1e6 * i)}\nPOWER_SUPPLY_CAPACITY=80"))  # fmt: skip
TORQUE = ("GPS Time", "Device Time", "Longitude", "HV Battery Voltage(V)", "HV Battery Current(A)", "SOC(%)")
TORQUE_ROWS = rows_of(LOG, lambda t, i, u, c, at: (
    at.strftime("%a %b %d %H:%M:%S GMT+00:00 %Y"), at.strftime("%d-%b-%Y %H:%M:%S.000"), 7.1, u, i, 80))  # fmt: skip

TELEMETRY = (
    f("EdgeTX", lines(EDGETX, EDGETX_ROWS), warm=False),
    f("Betaflight, blackbox_decode", lines(BETAFLIGHT, BETAFLIGHT_ROWS, ", "), warm=False),
    f("Betaflight, explorer", lines(EXPLORER, EXPLORER_ROWS), warm=False),
    f("VESC Tool", lines(VESC, VESC_ROWS, ";"), warm=False),
    f("LeafSpy", lines(LEAFSPY, LEAFSPY_ROWS)),
    f("EBC tester", EBC, warm=False),
    f("Linux power_supply", lines(SYSFS, SYSFS_ROWS), dated=True),
    f("INA219", lines(INA219, INA219_ROWS), warm=False),
    f("BMS, Pack_V, Cell1_V", lines(("Timestamp", "Pack_V", "Pack_I", *(f"Cell{k}_V" for k in (1, 2, 3, 4)), "T1"),
                                    PACK_ROWS), dated=True),
    f("FarDriver", lines(("Time", "Voltage(V)", "LineCurr(A)", "RPM"), rows_of(
        LOG, lambda t, i, u, c, at: (t, u, -i, 100))), warm=False),
    f("ODrive", lines(("time", "vbus_voltage", "ibus", "pos_estimate"), rows_of(
        LOG, lambda t, i, u, c, at: (t, u, -i, 1))), warm=False),
    f("ArduPilot, text of DataFlash", DATAFLASH, package="pymavlink"),
    f("line protocol of InfluxDB", PROTOCOL, dated=True),
    f("line protocol, a measurement a line", PROTOCOLS, dated=True),
    f("MQTT, nested JSON", MQTT, "log.jsonl", dated=True, warm=False),
    f("lines of a microcontroller, `V:12.3,I:-1.2`", each_line(lambda t, i, u, c, at: f"t:{t} V:{u},I:{i} T:{c}")),
    f("lines of a microcontroller, `voltage=12.3 V`", each_line(
        lambda t, i, u, c, at: f"time={t}, voltage={u} V, current={i} A, temp={c}")),
    f("Arduino monitor, `09:15:00.000 -> V:12.3`", each_line(
        lambda t, i, u, c, at: f"{at:%H:%M:%S}.000 -> V:{u},I:{i},T:{c}")),
    f("Arduino monitor, values alone", each_line(lambda t, i, u, c, at: f"{at:%H:%M:%S}.000 -> {u},{i},{c}"),
      flags=("--names", "time_s,voltage_V,current_A,temperature_degC")),
    f("lines of a microcontroller, a value a line", each_line(lambda t, i, u, c, at: (
        f"Bus Voltage:   {u:.3f} V\nCurrent:       {1000 * i:.1f} mA\nPower:         {1000 * u * i:.0f} mW\n")),
      flags=("--sample-time", "1"), warm=False),
    f("VE.Direct of Victron", VE_DIRECT, "log.txt", flags=("--sample-time", "1"), encoding="latin-1"),
    f("VE.Direct of Victron, times before the lines", each_line(lambda t, i, u, c, at: "\n".join(
        f"{at:%Y-%m-%d %H:%M:%S} {line}" for line in (f"V\t{round(1000 * u)}", f"I\t{round(1000 * i)}", "SOC\t800",
                                                     "Checksum\t+"))), dated=True, warm=False),
    f("uevent of Linux power_supply", UEVENT, flags=("--sample-time", "1"), warm=False),
    f("ESPHome", each_line(lambda t, i, u, c, at: "\n".join(
        f"[{at:%H:%M:%S}][D][sensor:094]: '{name}': Sending state {value:.5f} {unit} with 2 decimals of accuracy"
        for name, value, unit in (("pack voltage", u, "V"), ("pack current", i, "A"))) + (
            "\n[D][wifi:1]: Signal" if t % 5 == 0 else "")), warm=False),
    f("mosquitto_sub -v", each_line(lambda t, i, u, c, at: f"bms/voltage {u}\nbms/current {i}\nbms/temp {c}"),
      flags=("--sample-time", "1")),
    f("mosquitto_sub -F %J", each_line(lambda t, i, u, c, at: json.dumps(
        {"tst": f"{at:%Y-%m-%dT%H:%M:%S}.000000Z+0000", "topic": "bms", "payload": {"voltage": u, "current": i}})),
      "log.jsonl", dated=True, warm=False),
    f("mosquitto_sub -F '%I %t %p'", each_line(lambda t, i, u, c, at: (
        f"{at:%Y-%m-%dT%H:%M:%S}+0000 bms/r3 {json.dumps({'pack': {'voltage': u, 'current': i}})}")),
      dated=True, warm=False),
    f("The Things Network", each_line(lambda t, i, u, c, at: json.dumps({
        "end_device_ids": {"device_id": "r3"}, "received_at": f"{at:%Y-%m-%dT%H:%M:%S}.123456789Z",
        "uplink_message": {"f_cnt": t, "decoded_payload": {"battery_voltage": u, "battery_current": i},
                           "rx_metadata": [{"rssi": -80}]}})), "log.jsonl", dated=True, warm=False),
    f("Azure IoT Hub", each_line(lambda t, i, u, c, at: json.dumps({
        "EnqueuedTimeUtc": f"{at:%Y-%m-%dT%H:%M:%S}.4560000Z", "SystemProperties": {"connectionDeviceId": "r3"},
        "Body": {"packVoltage": u, "packCurrent": i}})), "log.jsonl", dated=True, warm=False),
    f("Keysight BenchLink", "BenchLink Data Logger\nOwner:,lab\n\n" + lines(
        ("Scan", "Time", "Chan 101 (VDC)", "Chan 102 (ADC)"), rows_of(LOG, lambda t, i, u, c, at: (
            int(t) + 1, f"{at:%m/%d/%Y %H:%M:%S}:000", u, i))), dated=True, warm=False),
    f("WheelLog", lines(("date", "time", "gps_speed", "speed", "voltage", "phase_current", "current", "power",
                         "battery_level", "system_temp", "temp2", "mode"), rows_of(LOG, lambda t, i, u, c, at: (
        f"{at:%Y-%m-%d}", f"{at:%H:%M:%S}.000", 0, 0, u, -3 * i, -i, -i * u, 80, c + 9, c, 1))), dated=True,
      warm=False),
    f("AirData of DJI", lines(("time(millisecond)", "datetime(utc)", "speed(mph)", "voltage(v)", "battery_percent",
                               "current(A)", "battery_temperature(f)"), rows_of(LOG, lambda t, i, u, c, at: (
        round(1000 * t), f"{at:%Y-%m-%d %H:%M:%S}", 0, u, 80, i, f"{1.8 * c + 32:.2f}")))),
    f("syslog", each_line(lambda t, i, u, c, at: f"{at:%b %d %H:%M:%S} robot-3 bms[712]: voltage={u} current={i}"),
      warm=False),
    f("Torque", lines(TORQUE, TORQUE_ROWS), dated=True, warm=False),
    f("PicoLog", lines(("", "Last (V)", "Last (A)", "Last (°C)"), rows_of(
        LOG, lambda t, i, u, c, at: (at.isoformat(), u, i, c))), dated=True),
    f("columns called A and V", lines(("t", "V", "A", "temp"), rows_of(LOG, lambda t, i, u, c, at: (t, u, i, c)))),
    f("BMS, V1, Iavg, Iinst, Vtot", lines(("Time", "V1", "V2", "V3", "V4", "Iavg", "Iinst", "Vtot", "SOC"), rows_of(
        LOG, lambda t, i, u, c, at: (t, *cells_of(u), 0.9 * i, i, u, 80))), warm=False),
    f("tester, size and CHG or DSG", lines(("Time(S)", "Cur(A)", "Vol(V)", "Mode"), rows_of(
        LOG, lambda t, i, u, c, at: (t, abs(i), u, "CHG" if i > 0 else "DSG" if i < 0 else "REST"))), warm=False),
    f("tester, size and C-CV or D-CC", lines(("Time(S)", "Cur(A)", "Vol(V)", "Mode"), rows_of(
        LOG, lambda t, i, u, c, at: (t, abs(i), u, "C-CV" if i > 0 else "D-CC" if i < 0 else "Wait"))), warm=False),
    f("`ros2 topic echo`, BatteryState", "---\n".join(
        [f"header:\n  stamp:\n    sec: {int(at.timestamp())}\n    nanosec: 0\n  frame_id: ''\nvoltage: {u}\n"
         f"temperature: .nan\ncurrent: {i}\ncell_voltage:\n- 3.3\n- 3.3\n"
         for (t, i, u, c), at in zip(LOG.rows(), LOG.moments, strict=True)] + [""]), dated=True, warm=False),
    f("power and voltage", lines(("Time", "Battery Voltage (V)", "Battery Power (W)", "Temp (C)"), rows_of(
        LOG, lambda t, i, u, c, at: (t, u, i * u, c)))),
    f("size of the current, signed power", lines(("timestamp", "active_power", "voltage", "current"), rows_of(
        LOG, lambda t, i, u, c, at: (int(at.timestamp()), round(u * i, 1), u, abs(i)))), dated=True, warm=False),
    f("a column for each direction", lines(("t [s]", "U [V]", "I_chg [A]", "I_dsg [A]"), rows_of(
        LOG, lambda t, i, u, c, at: (t, u, max(i, 0), max(-i, 0)))), warm=False),
    f("JK BMS", lines(JK, JK_ROWS), dated=True),
    f("JK BMS, Chinese names", lines(("时间", "总电压(V)", "电流(A)", "剩余电量(%)", "MOS温度(℃)", "电池温度1(℃)"),
        rows_of(LOG, lambda t, i, u, c, at: (at.strftime("%Y-%m-%d %H:%M:%S"), u, i, 80, c + 5, c))), dated=True),
    f("Orion BMS", lines(("Time(s)", "Pack Current", "Pack Inst. Voltage", "Low Cell Voltage"), rows_of(
        LOG, lambda t, i, u, c, at: (t, -i, u, 3.2))), warm=False),
    f("Eagle Tree, multiplied numbers", lines(("Milliseconds", "PackVolt*100", "Amps*100", "Temp*10"), rows_of(
        LOG, lambda t, i, u, c, at: (round(1000 * t), round(100 * u, 1), round(100 * i), round(10 * c))))),
    f("Daly BMS", lines(DALY, DALY_ROWS), dated=True),
    f("Xiaoxiang (JBD) BMS", lines(XIAOXIANG, XIAOXIANG_ROWS, ";"), dated=True),
    f("VictronConnect", lines(VICTRON, VICTRON_ROWS), dated=True),
    f("Victron VRM", VRM, dated=True),
    f("`ros2 topic echo --csv`, BatteryState", lines((), ROS2), dated=True),
    f("`rostopic echo -p`", lines(ROS1_NAMES, ROS1), dated=True),
    f("PlotJuggler", lines(PLOTJUGGLER, rows_of(LOG, lambda t, i, u, c, at: (at.timestamp(), i, u, c))), dated=True),
    f("Foxglove", lines(FOXGLOVE, rows_of(LOG, lambda t, i, u, c, at: (t, us(at) * 1000, "/bat", "", u, i, c)))),
    f("PX4 ulog2csv", lines(PX4, PX4_ROWS)),
    f("ArduPilot", lines(ARDUPILOT, ARDUPILOT_ROWS)),
    f("CAN signals of a DBC", lines(CAN, rows_of(LOG, lambda t, i, u, c, at: (t, u, i, c, 80)))),
    f("power meter", lines(TURNIGY, rows_of(LOG, lambda t, i, u, c, at: (t, u, i, round(u * i, 3), 0, c)))),
    f("InfluxDB, annotated", influx(True), dated=True),
    f("InfluxDB, not annotated", influx(False), dated=True),
    f("Home Assistant history", HASS, dated=True, sparse=True),
    f("time, name, value", METRICS, dated=True),
    f("JSON lines", "".join(json.dumps(one) + "\n" for one in objects()), "log.jsonl", dated=True),
    f("JSON array", json.dumps(objects()), "log.json", dated=True),
    f("JSON object of columns", json.dumps(JSON_COLUMNS, indent=1), "log.json"),
    f("JSON of pandas, columns", json.dumps({
        name: {str(k): value for k, value in enumerate(column)} for name, column in JSON_COLUMNS.items()}), "log.json"),
    f("JSON of pandas, orient='split'", json.dumps({
        "columns": list(JSON_COLUMNS), "index": list(range(len(LOG.time_s))),
        "data": list(zip(*JSON_COLUMNS.values(), strict=True))}), "log.json"),
    f("Grafana, units in cells", lines([f'"{name}"' for name in GRAFANA], GRAFANA_ROWS), dated=True),
    f("Unix time, bare names", lines(("unixtime", "v", "i", "temp"), SHELLY), dated=True),
)  # fmt: skip
