"""Exports of battery cyclers and of laboratory software, their headers as in published data sets and loaders."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

from logs.formats.known import LOG, Format, lines, rows_of, text_file
from logs.formats.layouts import comma
from logs.formats.times import clock, serial

FAMILY = "cyclers"
STEP = [int(k // 25) + 1 for k in range(300)]
#: Time of a step, which starts anew with each.
STEP_S = [k % 25 for k in range(300)]
STATES = ["R" if i == 0 else "C" if i > 0 else "D" for i in LOG.current_A]


def f(name: str, text: str, file: str = "log.csv", **about) -> Format:
    encoding = about.pop("encoding", "utf-8")
    return Format(name, FAMILY, text_file(file, text, encoding), LOG, **about)


def hms(seconds: float, point: str = ".") -> str:
    return clock(seconds).replace(".", point)


ARBIN = ("Data_Point", "Test_Time(s)", "Date_Time", "Step_Time(s)", "Step_Index", "Cycle_Index", "Current(A)",
         "Voltage(V)", "Charge_Capacity(Ah)", "Discharge_Capacity(Ah)", "Aux_Temperature(C)_1")  # fmt: skip


def arbin(date) -> list[list[str]]:
    return rows_of(
        LOG, lambda t, i, u, c, at: (int(t) + 1, t, date(at), STEP_S[int(t)], STEP[int(t)], 1, i, u, 0, 0, c)
    )


MACCOR = ("Rec#", "Cyc#", "Step", "TestTime", "StepTime", "Amp-hr", "Watt-hr", "Amps", "Volts", "State", "ES",
          "DPt Time", "Temp 1")  # fmt: skip
MACCOR_ROWS = rows_of(LOG, lambda t, i, u, c, at: (
    int(t) + 1, 0, STEP[int(t)], clock(t, "  0d "), clock(STEP_S[int(t)], "  0d "), 0.0, 0.0, abs(i), u,
    STATES[int(t)], 1, at.strftime("%m/%d/%Y %I:%M:%S %p"), c))  # fmt: skip
MACCOR_TEXT = "Today''s Date\t03/30/2026 12:50:27 PM\n\nDate of Test:\t03/28/2026 9:15:00 AM\n\n"
MACCOR_SECONDS = [[*row[:3], f"{k}.00", f"{STEP_S[k]}.00", *row[5:]] for k, row in enumerate(MACCOR_ROWS)]

NEWARE7 = ("Cycle ID", "Step ID", "Record ID", "Time(h:min:s.ms)", "Voltage(V)", "Current(mA)", "Temperature(C)",
           "Capacity(mAh)", "Realtime")  # fmt: skip
NEWARE_ROWS = rows_of(LOG, lambda t, i, u, c, at: (
    1, STEP[int(t)], int(t) + 1, clock(STEP_S[int(t)]), u, f"{1000 * i:.1f}", c, 0, at.strftime("%Y-%m-%d %H:%M:%S")
))  # fmt: skip
BTS8 = ("DataPoint", "Cycle Index", "Step Index", "Step Type", "Time", "Total Time", "Current(A)", "Voltage(V)",
        "Capacity(Ah)", "Chg. Cap.(Ah)", "DChg. Cap.(Ah)", "Date", "Power(W)", "T1(℃)")  # fmt: skip
BTS8_ROWS = rows_of(LOG, lambda t, i, u, c, at: (
    int(t) + 1, 1, STEP[int(t)], {"R": "Rest", "C": "CC Chg", "D": "CC DChg"}[STATES[int(t)]], hms(STEP_S[int(t)]),
    hms(t), i, u, 0, 0, 0, at.strftime("%Y-%m-%d %H:%M:%S"), round(i * u, 3), c))  # fmt: skip


def layered() -> str:
    """A line for each cycle, step and record, each kind with a header of its own."""
    head = [
        ["Cycle ID", "Cap_Chg(mAh)", "Cap_DChg(mAh)"],
        ["", "Step ID", "Step Name", "Step Time(h:min:s.ms)", "Capacity(mAh)", "Start Voltage(V)"],
        ["", "", *NEWARE7[2:]],
    ]
    rows: list[Sequence[str]] = [["1", "100.0", "200.0"]]
    for step, records in groupby(NEWARE_ROWS, key=lambda row: row[1]):
        rows += [["", step, "CC_DChg", "0:00:25.000", "1.0", "13.2"], *(["", "", *row[2:]] for row in records)]
    return lines((), [*head, *rows])


MPT = ("mode", "ox/red", "error", "control changes", "Ns changes", "counter inc.", "Ns", "time/s", "control/V/mA",
       "Ewe/V", "I/mA", "dQ/mA.h", "Temperature/°C", "half cycle")  # fmt: skip
MPT_ROWS = rows_of(LOG, lambda t, i, u, c, at: (
    1, int(i > 0), 0, 0, 0, 0, STEP[int(t)], f"{t:.15E}", f"{1000 * i:.7E}", f"{u:.7E}", f"{1000 * i:.7E}",
    "0.000000000000000E+000", f"{c:.7E}", 0))  # fmt: skip
MPT_TEXT = (
    "EC-Lab ASCII FILE\nNb header lines : 22                          \n\nModulo Bat\n\nRun on channel : 1 (SN 14990)\n"
    "User : \nElectrode connection : standard\nPotential control : Ewe\nAcquisition started on : 03/28/2026 09:15:00\n"
    "Device : BCS-815 (SN 1111)\nAddress : 172.17.9.42\nElectrode surface area : 0.001 cm²\nVolume (V) : 0.001 cm³\n"
    "Ns                  0                   1                   2                   \n"
    "ctrl_type           CC                  CC                  Rest                \n"
    "ctrl1_val           1.000               -1.000              0.000               \n"
    "ctrl1_val_unit      A                   A                   A                   \n"
    "record              Ewe                 Ewe                 Ewe                 \n\n\n"
)
DIGATRON = ("Time Stamp", "Step", "Status", "Prog Time", "Step Time", "Cycle", "Cycle Level", "Procedure", "Voltage",
            "Current", "Temperature", "Capacity", "WhAccu", "Cnt", "")  # fmt: skip
DIGATRON_UNITS = [*[""] * 8, "[V]", "[A]", "[C]", "[Ah]", "[Wh]", "[Cnt]", ""]
DIGATRON_ROWS = rows_of(LOG, lambda t, i, u, c, at: (
    at.strftime("%-m/%-d/%Y %-I:%M:%S %p"), STEP[int(t)], {"R": "PAU", "C": "CHA", "D": "DCH"}[STATES[int(t)]],
    hms(t), hms(STEP_S[int(t)]), 0, 0, "Pulse", f"{u:.5f}", f"{i:.5f}", f"{c:.5f}", "0.00000", "0.00000", "2.00000", ""
))  # fmt: skip
DIGATRON_TEXT = (
    "\nMeasurement ID,585\nBattery Name,4S LFP\nStart Time,3/28/2026 9:15:00 AM\nEnd Time,3/28/2026 9:20:00 AM\n"
    "Nominal Capacity, 12\nNominal Voltage,12.8\nCircuit,1\nUser,Admin\nTest section,Pulse\n\n"
)
BITRODE = ("Exclude", "Total Time (Seconds)", "Total Time (Hours in hh:mm:ss.xxx)", "Step Time (Seconds)", "Cycle",
           "Loop Counter #1", "Step", "Current (A)", "Voltage (V)", "Power (Watts)", "Amp-Hours (AH )",
           "Watt-Hours (WH )", "Mode", "Temperature A1 (C)")  # fmt: skip
BITRODE_ROWS = rows_of(LOG, lambda t, i, u, c, at: (
    "", f"{t:.3f}", hms(t), STEP_S[int(t)], 1, 0, STEP[int(t)], i, u, 0, 0, 0,
    {"R": "REST", "C": "CHRG", "D": "DCHG"}[STATES[int(t)]], c))  # fmt: skip


def labview(first: str, name: str, mark: str = ".") -> str:
    """A measurement file of LabVIEW; first: X_Columns; name: of the first column."""
    number = lambda value: f"{value:.6f}".replace(".", mark)  # noqa: E731
    time = (lambda t: number(t)) if first != "No" else (lambda t: "")
    rows = rows_of(LOG, lambda t, i, u, c, at: (time(t), number(u), number(i), number(c), ""))
    same = lambda value: "\t".join([value] * 3)  # noqa: E731
    return (
        f"LabVIEW Measurement\t\nWriter_Version\t2\nReader_Version\t2\nSeparator\tTab\nDecimal_Separator\t{mark}\n"
        f"Multi_Headings\tNo\nX_Columns\t{first}\nTime_Pref\tRelative\nOperator\tlab\nDate\t2026/03/28\n"
        f"Time\t09:15:00{mark}0\n***End_of_Header***\t\n\t\nChannels\t3\nSamples\t{same('300')}\n"
        f"Date\t{same('2026/03/28')}\nTime\t{same(f'09:15:00{mark}0')}\nY_Unit_Label\tVolts\tAmps\tDeg C\n"
        f"X_Dimension\t{same('Time')}\nX0\t{same(f'0{mark}0E+0')}\nDelta_X\t{same(f'1{mark}000000')}\n"
        f"***End_of_Header***\t\t\t\n" + lines((name, "Voltage", "Current", "Temperature", "Comment"), rows, "\t")
    )


BASYTEC = ("Time[s]", "DataSet", "Line", "U[V]", "I[A]", "T1[°C]", "Ah[Ah]", "State")
BASYTEC_TEXT = (
    "~Resultfile from Basytec Battery Test System\n~Date and Time of Data Converting: 30.03.2026 12:00:00\n"
    "~Name of Test: Pulse\n~Battery: 4S\n~Start of Test: 28.03.2026 09:15:00\n~\n~"
)
BASYTEC_ROWS = rows_of(LOG, lambda t, i, u, c, at: (t, int(t) + 1, STEP[int(t)], u, i, c, 0, 2))
NOVONIX = ("Date and Time", "Cycle Number", "Step Type", "Run Time (h)", "Step Time (h)", "Current (A)",
           "Potential (V)", "Capacity (Ah)", "Temperature (°C)")  # fmt: skip
NOVONIX_ROWS = rows_of(LOG, lambda t, i, u, c, at: (
    at.strftime("%Y-%m-%d %I:%M:%S %p"), 1, 0, f"{t / 3600:.9f}", f"{STEP_S[int(t)] / 3600:.9f}", i, u, 0, c
))  # fmt: skip
BDF = ("Test Time / s", "Voltage / V", "Current / A", "Temperature T1 / degC", "Unix Time / s")
BDF_ROWS = rows_of(LOG, lambda t, i, u, c, at: (t, u, i, c, at.timestamp()))
PYBAMM = ("Time [s]", "Current [A]", "Terminal voltage [V]", "X-averaged cell temperature [C]")
#: PyBaMM counts discharge as positive.
PYBAMM_ROWS = rows_of(LOG, lambda t, i, u, c, at: (t, -i, u, c))
LANDT = ("Record", "TestTime/Sec", "StepTime/Sec", "Cycle-Index", "Step-Index", "Current/mA", "Voltage/V", "Temp/C")
LANDT_ROWS = rows_of(LOG, lambda t, i, u, c, at: (
    int(t) + 1, t, STEP_S[int(t)], 1, STEP[int(t)], f"{1000 * i:.1f}", u, c
))  # fmt: skip

TOYO = ("Date", "Time", "PassTime[Sec]", "Voltage[V]", "Current[mA]", "", "", "Temp1[Deg]", "", "", "", "Condition",
        "Mode", "Cycle", "TotlCycle", "PassedDate")  # fmt: skip
#: The size of the current, and a number for charge, discharge and rest.
TOYO_ROWS = rows_of(LOG, lambda t, i, u, c, at: (
    f"{at:%Y/%m/%d}", f"{at:%H:%M:%S}", STEP_S[int(t)], u, f"{1000 * abs(i):.1f}", "", "", c, "", "", "",
    {"C": 1, "D": 2, "R": 3}[STATES[int(t)]], 1, 1, 1, 0))  # fmt: skip
GAMRY = ("", "Pt", "T", "Vf", "Im", "Vu", "Sig", "Ach", "IERange", "Over", "Temp")
GAMRY_UNITS = ["", "#", "s", "V vs. Ref.", "A", "V", "V", "V", "#", "bits", "deg C"]
GAMRY_ROWS = rows_of(LOG, lambda t, i, u, c, at: (
    "", int(t), t, f"{u:.5E}", f"{i:.5E}", 0, 0, 0, 20, "..........a", c))  # fmt: skip
GAMRY_TEXT = (
    "EXPLAIN\nTAG\tCHRONOP\nTITLE\tLABEL\tPulse\tTest &Identifier\nDATE\tLABEL\t3/28/2026\tDate\nCURVE\tTABLE\t300\n"
)
NOVA = ("Time (s)", "Corrected time (s)", "WE(1).Potential (V)", "WE(1).Current (A)", "Index")
PEC = ("Test", "Cell", "Step", "Total Time (Seconds)", "Step Time (Seconds)", "Real Time", "Voltage (mV)",
       "Current (mA)", "Charge Capacity (mAh)", "Temperature1 (°C)")  # fmt: skip
PEC_ROWS = rows_of(LOG, lambda t, i, u, c, at: (
    "T12", 3, STEP[int(t)], f"{t:.1f}", STEP_S[int(t)], f"{at:%d-%b-%Y %H:%M:%S}", f"{1000 * u:.1f}",
    f"{1000 * i:.1f}", 0, c))  # fmt: skip

CYCLERS = (
    f("Arbin", lines(ARBIN, arbin(lambda at: at.strftime("%m/%d/%Y %H:%M:%S")))),
    f("Arbin, dates as serial numbers", lines(ARBIN, arbin(serial))),
    f("Arbin, tabs before dates", lines(ARBIN, arbin(lambda at: at.strftime("\t%m/%d/%Y %H:%M:%S.%f")))),
    f("Neware, Chinese names", lines(
        ("数据序号", "工步号", "工步类型", "时间", "总时间", "电流(A)", "电压(V)", "绝对时间"),
        rows_of(LOG, lambda t, i, u, c, at: (
            int(t) + 1, STEP[int(t)], "恒流充电" if i > 0 else "恒流放电" if i < 0 else "静置",
            hms(STEP_S[int(t)]), hms(t), i, u, at.strftime("%Y-%m-%d %H:%M:%S")))), encoding="gb18030", warm=False),
    f("Maccor", MACCOR_TEXT + lines(MACCOR, MACCOR_ROWS, "\t"), "log.txt"),
    f("Maccor, mA", MACCOR_TEXT + lines(
        [{"Amps": "mAmps"}.get(name, name) for name in MACCOR],
        [[*row[:7], f"{1000 * float(row[7]):.1f}", *row[8:]] for row in MACCOR_ROWS], "\t"), "log.txt"),
    f("Maccor, seconds", lines(["Rec#", "Cyc#", "Step", "Test (Sec)", "Step (Sec)", *MACCOR[5:]], MACCOR_SECONDS)),
    f("Neware BTS 7, flat", lines(NEWARE7, NEWARE_ROWS), dated=True),
    f("Neware BTS 7, layered", layered(), dated=True),
    f("Neware BTS 8", lines(BTS8, BTS8_ROWS)),
    f("Neware BTS 8, Chinese code page", lines(BTS8, BTS8_ROWS), encoding="gb18030"),
    f("BioLogic EC-Lab .mpt", MPT_TEXT + lines(MPT, MPT_ROWS, "\t"), "log.mpt", encoding="latin-1"),
    f("BioLogic EC-Lab .mpt, decimal comma", MPT_TEXT + lines(MPT, comma(MPT_ROWS), "\t"), "log.mpt",
      encoding="latin-1"),
    f("Digatron", DIGATRON_TEXT + lines(DIGATRON, [DIGATRON_UNITS, *DIGATRON_ROWS])),
    f("Bitrode", lines(BITRODE, BITRODE_ROWS)),
    f("LabVIEW .lvm, one column of times", labview("One", "X_Value"), "log.lvm"),
    f("LabVIEW .lvm, no column of times", labview("No", "X_Value"), "log.lvm"),
    f("LabVIEW .lvm, decimal comma", labview("One", "X_Value", ","), "log.lvm"),
    f("BaSyTec", BASYTEC_TEXT + lines(BASYTEC, BASYTEC_ROWS, "\t"), "log.txt", encoding="cp1252"),
    f("Novonix", "[Summary]\nNovonix UHPC\nCell: 4S\n[End Summary]\n[Data]\n" + lines(NOVONIX, NOVONIX_ROWS)),
    f("Landt", lines(LANDT, LANDT_ROWS)),
    f("Toyo", "0,0,1,0,0,0,0\n\n\n" + lines(TOYO, TOYO_ROWS), dated=True),
    f("Gamry .DTA", GAMRY_TEXT + lines(GAMRY, [GAMRY_UNITS, *GAMRY_ROWS], "\t"), "log.DTA"),
    f("Metrohm Nova", lines(NOVA, rows_of(LOG, lambda t, i, u, c, at: (t, t, u, i, int(t) + 1)), ";"), warm=False),
    f("PEC", "TestRegime Name,a.xml\nUser,lab\n#RESULTS CHECK\n" + lines(PEC, PEC_ROWS)),
    f("Battery Data Format", lines(BDF, BDF_ROWS), "log.bdf.csv", dated=True),
    f("PyBaMM", lines(PYBAMM, PYBAMM_ROWS)),
)  # fmt: skip
