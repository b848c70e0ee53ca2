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

TELEMETRY = (
    f("JK BMS", lines(JK, JK_ROWS), dated=True),
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
    f("Grafana, units in cells", lines([f'"{name}"' for name in GRAFANA], GRAFANA_ROWS), dated=True),
    f("Unix time, bare names", lines(("unixtime", "v", "i", "temp"), SHELLY), dated=True),
)  # fmt: skip
