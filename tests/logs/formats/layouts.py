"""Layouts and encodings of text tables."""

from __future__ import annotations

import codecs
import gzip
from collections.abc import Sequence

from logs.formats.known import LOG, Format, binary_file, lines, rows_of, text_file

FAMILY = "text tables"
NAMES = ("time_s", "current_A", "voltage_V", "temperature_degC")
PLAIN = rows_of(LOG, lambda t, i, u, c, at: (t, i, u, c))
MILLI = rows_of(LOG, lambda t, i, u, c, at: (f"{1000 * t:,.0f}", f"{1000 * i:,.0f}", f"{1000 * u:,.0f}", c))
GERMAN = ("Zeit [s]", "Strom [A]", "Spannung [V]", "Temperatur [°C]")
RUSSIAN = ("Время, с", "Ток, А", "Напряжение, В", "Температура, °C")
JAPANESE = ("時間(s)", "電流(A)", "電圧(V)", "温度(℃)")
CHINESE = ("时间(s)", "电流(A)", "电压(V)", "温度(℃)")
FRENCH = ("Temps (s)", "Courant (A)", "Tension (V)", "Température (°C)")
POLISH = ("Czas [s]", "Prąd [A]", "Napięcie [V]", "Temperatura [°C]")
TURKISH = ("Zaman (s)", "Akım (A)", "Gerilim (V)", "Sıcaklık (°C)")
GROUPS = (("", "Current", "Voltage", "Temperature", "Current", "Temperature"),
          *(("s", "A", "V", "degC", "A", "degC"), *([*row, "17.5", "60"] for row in PLAIN)))  # fmt: skip
SPANISH = ("Tiempo (s)", "Corriente (A)", "Voltaje (V)", "Temperatura (°C)")


def comma(rows: Sequence[Sequence[str]]) -> list[list[str]]:
    return [[cell.replace(".", ",") for cell in row] for row in rows]


def table(mark: str = ",", names: Sequence[str] = NAMES, rows: Sequence[Sequence[str]] = PLAIN, end: str = "\n") -> str:
    return lines(names, rows, mark, end)


def aligned(names: Sequence[str], rows: Sequence[Sequence[str]], width: int) -> str:
    return "".join("".join(cell.rjust(width) for cell in row) + "\n" for row in (names, *rows))


HOLES = [[t, i, u, c if k % 10 == 0 else ""] for k, (t, i, u, c) in enumerate(PLAIN)]
UNITS_IN_CELLS = rows_of(LOG, lambda t, i, u, c, at: (f"{t:g}s", f"{i:.1f}A", f"{u:.3f}V", f"{c}°C"))
MIXED = rows_of(
    LOG, lambda t, i, u, c, at: (t, f"{1000 * i:.0f} mA" if abs(i) < 4 else f"{i:.1f} A", f"{u:.3f} V", f"{c} °C")
)
SWISS = rows_of(LOG, lambda t, i, u, c, at: (t, f"{1000 * i:,.0f}".replace(",", "'"), f"{u:.3f}", c))
POINTS = rows_of(LOG, lambda t, i, u, c, at: (
    f"{t:.0f}", *(f"{1000 * x:,.0f}".replace(",", ".") for x in (i, u))))  # fmt: skip
POINTS_COMMA = [[*row, f"{c:.1f}".replace(".", ",")] for row, (*_, c) in zip(POINTS, LOG.rows(), strict=True)]
IN_MILLI = ("time_s", "current_mA", "voltage_mV", "temp_degC")
SPACED = [
    [f"{1000 * float(t):,.0f}".replace(",", "\u00a0"), *(cell.replace(".", ",") for cell in rest)] for t, *rest in PLAIN
]
PREAMBLE = (
    "Logger: BatLog 3000, serial 4711\nFirmware: 1.2.3\nOperator: N. N.\n"
    "Interval: 1 s, Channels: 3\nBattery: 4S LFP, 12 Ah, new\n\n"
)
FOOTER = "End of measurement\nSamples: 300\n"
TENS = rows_of(LOG, lambda t, i, u, c, at: (t, round(100 * i), f"{100 * u:.1f}", round(10 * c)))
UNIT_ROW = [["[s]", "[A]", "[V]", "[°C]"], *PLAIN]
BARE = ("Time", "Current", "Voltage", "Temperature")
MINUS = [[cell.replace("-", "\u2212") for cell in row] for row in PLAIN]


def f(name: str, text: str, flags: tuple[str, ...] = (), encoding: str = "utf-8", file: str = "log.csv") -> Format:
    return Format(name, FAMILY, text_file(file, text, encoding), LOG, flags)


def raw(name: str, content: bytes, file: str = "log.csv") -> Format:
    return Format(name, FAMILY, binary_file(file, content), LOG)


LAYOUTS = (
    f("comma", table()),
    f("semicolon, decimal comma, German names", table(";", GERMAN, comma(PLAIN))),
    f("tab", table("\t"), file="log.tsv"),
    f("pipe", table("|")),
    f("spaces, one or several", aligned(NAMES, PLAIN, 18), file="log.txt"),
    f("fixed width with empty cells", aligned(BARE, HOLES, 13), file="log.txt"),
    f("lines that end in CR", table(end="\r")),
    raw("gzip", gzip.compress(table().encode()), "log.csv.gz"),
    f("UTF-8 with a mark", table(), encoding="utf-8-sig"),
    f("UTF-16 with a mark", table(), encoding="utf-16"),
    f("UTF-16 LE without a mark", table(), encoding="utf-16-le"),
    f("UTF-16 BE without a mark", table("\t"), encoding="utf-16-be"),
    raw("UTF-32 with a mark", codecs.BOM_UTF32_LE + table().encode("utf-32-le")),
    f("UTF-32 without a mark", table(), encoding="utf-32-le"),
    f("Windows-1252, German names", table(";", GERMAN, comma(PLAIN)), encoding="cp1252"),
    f("Windows-1251, Russian names", table(";", RUSSIAN, comma(PLAIN)), encoding="cp1251"),
    f("Shift-JIS, Japanese names", table(",", JAPANESE), encoding="cp932"),
    f("GB 18030, Chinese names", table(",", CHINESE), encoding="gb18030"),
    f("UTF-8, French names", table(";", FRENCH, comma(PLAIN))),
    f("Latin-1, Spanish names", table(";", SPANISH, comma(PLAIN)), encoding="latin-1"),
    f("Mac Roman, French names", table(";", FRENCH, comma(PLAIN)), encoding="mac_roman"),
    f("KOI8-R, Russian names", table(";", RUSSIAN, comma(PLAIN)), encoding="koi8_r"),
    f("Windows-1250, Polish names", table(";", POLISH, comma(PLAIN)), encoding="cp1250"),
    f("Windows-1254, Turkish names", table(";", TURKISH, comma(PLAIN)), encoding="cp1254"),
    f("EBCDIC", table(), ("--encoding", "cp037"), "cp037"),
    f("`sep=;` of Excel", "sep=;\n" + table(";", rows=comma(PLAIN))),
    f("lines of text above the header", PREAMBLE + table()),
    f("lines of text with the delimiter above the header", PREAMBLE.replace(": ", ";") + table(";")),
    f("row of units", table(",", BARE, UNIT_ROW)),
    f("row of groups above, row of units", table(",", ("Time", "Battery", "", "", "Motor", ""), GROUPS)),
    f("text above, row of units, text below", PREAMBLE + table(",", BARE, UNIT_ROW) + FOOTER),
    f("no header", table(",", ()), ("--names", "time_s,current_A,voltage_V,temperature_degC")),
    f("every cell in quotes", lines([f'"{n}"' for n in NAMES], [[f'"{c}"' for c in row] for row in PLAIN])),
    f("thousands, quoted", lines(("time_ms", "current_mA", "voltage_mV", "T_degC"), [
        [f'"{cell}"' for cell in row] for row in MILLI])),
    f("thousands by apostrophe", table(";", ("time_s", "current_mA", "voltage_V", "temp_degC"), SWISS)),
    f("thousands by point", table(";", IN_MILLI[:3], POINTS))._replace(warm=False),
    f("thousands by point, decimal comma", table(";", IN_MILLI, POINTS_COMMA)),
    f("thousands by space, decimal comma", table(";", ("time_ms", *NAMES[1:]), SPACED)),
    f("units in the cells, `13.8V`", table(",", BARE, UNITS_IN_CELLS)),
    f("mA and A in one column", table(",", BARE, MIXED)),
    f("minus sign of typographers", table(rows=MINUS)),
    f("header in a comment (numpy.savetxt)", "# " + table(" ")),
    f("comment lines (% of MATLAB)", "% battery 4711\n% " + table("\t")),
    f("index of pandas", table(names=("", *NAMES), rows=[[str(k), *row] for k, row in enumerate(PLAIN)])),
    f("delimiter at the end of rows", table(rows=[[*row, ""] for row in PLAIN])),
    f("empty lines between rows", table().replace("\n", "\n\n")),
    f("header again in the middle", table(rows=[*PLAIN[:100], list(NAMES), *PLAIN[100:]])),
    f("a stray quote", table().replace("\n150.0,", '\n"150.0,')),
    f("short names t, i, u", table(names=("t", "i", "u", "T [°C]"))),
    f("line of dashes below the names", "name: battery\n" + aligned(NAMES, [["---"] * 4, *PLAIN], 18), file="log.txt"),
    f("Markdown", table("|", rows=[["---", "---:", "---:", "---"], *PLAIN]), file="log.md"),
    f("sum and mean below the rows", table() + "Sum,,,\nMean,-1,13.2,21\n"),
    f("multiples of units in the names", table(names=("time_s", "I (10mA)", "U (0.01V)", "T (0.1°C)"), rows=TENS)),
    f("last line cut off", table() + "300.0,1"),
)  # fmt: skip
