"""Binary files of vehicles, cyclers and loggers, laid out as packages read them, or written by those."""

from __future__ import annotations

import sqlite3
import struct
import zipfile
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import numpy as np

from logs.formats.known import LOG, Format, binary_file

FAMILY = "vehicles, cyclers, loggers"


def f(name: str, write: Callable[[Path], Path], **about) -> Format:
    return Format(name, FAMILY, write, LOG, **about)


#: Messages of DataFlash by their own FMT: type, name, format (Q uint64, B uint8, f float), columns and length.
FORMATS = (
    (128, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns", 89),
    (130, "BAT", "QBfff", "TimeUS,Inst,Volt,Curr,Temp", 24),
)


def fmt_messages(formats: tuple = FORMATS) -> bytes:
    """The messages that define others."""
    content = b""
    for number, name, form, columns, length in formats:
        fields = (name.encode().ljust(4, b"\0"), form.encode().ljust(16, b"\0"), columns.encode().ljust(64, b"\0"))
        content += b"\xa3\x95\x80" + struct.pack("<BB", number, length) + b"".join(fields)
    return content


def dataflash() -> bytes:
    rows = [struct.pack("<BQBfff", 130, round(1e6 * t) + 12_345_678, 0, u, -i, c) for t, i, u, c in LOG.rows()]
    return fmt_messages() + b"".join(b"\xa3\x95" + row for row in rows)


def telemetry(folder: Path) -> Path:
    """Packets of MAVLink 2, each behind its stamp; a current to 10 mA."""
    from pymavlink.dialects.v20 import ardupilotmega

    packets: list[bytes] = []
    sink = type("Sink", (), {"write": staticmethod(lambda packet: packets.append(bytes(packet)))})
    mav = ardupilotmega.MAVLink(sink, srcSystem=1)
    for _, i, u, c in LOG.rows():
        mav.battery_status_send(0, 0, 0, round(100 * c), [round(1000 * u), *[65535] * 9], round(-100 * i), -1, -1, 80)
    stamps = (struct.pack(">Q", round(1e6 * at.timestamp())) for at in LOG.moments)
    (folder / "log.tlog").write_bytes(b"".join(stamp + packet for stamp, packet in zip(stamps, packets, strict=True)))
    return folder / "log.tlog"


#: Numbers of EC-Lab's columns: time/s, Ewe/V, I/mA.
_EC_LAB = (4, 6, 76)


def _module(short: bytes, content: bytes, version: int) -> bytes:
    head = b"MODULE" + short.ljust(10) + short.ljust(25)
    return head + struct.pack("<II", len(content), version) + b"01/02/26" + content


def mpr(folder: Path) -> Path:
    rows = np.zeros(LOG.time_s.size, [("time", "<f8"), ("Ewe", "<f4"), ("I", "<f4")])
    rows["time"], rows["Ewe"], rows["I"] = LOG.time_s, LOG.voltage_V, 1000.0 * LOG.current_A
    head = struct.pack("<IB", rows.size, len(_EC_LAB)) + np.array(_EC_LAB, "<u2").tobytes()
    data = head.ljust(405, b"\0") + rows.tobytes()
    magic = b"BIO-LOGIC MODULAR FILE\x1a".ljust(48) + b"\x00\x00\x00\x00"
    (folder / "log.mpr").write_bytes(magic + _module(b"VMP Set", bytes(8), 0) + _module(b"VMP data", data, 2))
    return folder / "log.mpr"


def mdf(folder: Path) -> Path:
    import asammdf

    file = asammdf.MDF(version="4.10")
    file.header.start_time = LOG.start
    for name, unit, values in (("PackCurrent", "A", LOG.current_A), ("PackVoltage", "V", LOG.voltage_V)):
        file.append([asammdf.Signal(values, LOG.time_s, name=name, unit=unit)])
    file.save(folder / "log.mf4")
    file.close()
    return folder / "log.mf4"


def sqlite(folder: Path) -> Path:
    rows = [(at.timestamp(), i, u, c) for (_, i, u, c), at in zip(LOG.rows(), LOG.moments, strict=True)]
    with closing(sqlite3.connect(folder / "log.db")) as database, database:
        database.execute("CREATE TABLE settings (name TEXT, value TEXT)")
        database.execute("CREATE TABLE battery (timestamp REAL, current REAL, voltage REAL, temperature REAL)")
        database.executemany("INSERT INTO battery VALUES (?, ?, ?, ?)", rows)
    return folder / "log.db"


#: A record of Neware's .nda of version 8, and of .ndax of version 2: their own units are 0.1 mV, 0.1 mA and s or ms.
_NDA = np.dtype(
    [
        ("identifier", "<u1"), ("index", "<u4"), ("cycle", "<u4"), ("step", "<u1"), ("type", "<u1"), ("time", "<u4"),
        ("U", "<i4"), ("I", "<i4"), ("nothing", "V8"), ("Q", "<i8"), ("E", "<i8"), ("unix", "<u8"), ("end", "V4"),
    ]
)  # fmt: skip
_NDC = np.dtype(
    [
        ("nothing", "V8"), ("index", "<u4"), ("cycle", "<u4"), ("step", "<u1"), ("type", "<u1"), ("free", "V5"),
        ("time", "<u8"), ("U", "<i4"), ("I", "<i4"), ("spare", "V4"), ("charge", "<i8", 4),
        ("Y", "<u2"), *((part, "<u1") for part in "MDhms"), ("range", "<i4"), ("end", "V8"),
    ]
)  # fmt: skip
#: Step of Neware whose current has either sign, and a current range of 10 A.
_SIMULATED, _RANGE_MA = 17, 10_000


def _neware(dtype: np.dtype, times_per_s: int) -> np.ndarray:
    rows = np.zeros(LOG.time_s.size, dtype)
    rows["index"], rows["step"], rows["type"] = 1 + np.arange(rows.size), 1, _SIMULATED
    rows["time"] = np.round(times_per_s * LOG.time_s)
    rows["U"], rows["I"] = np.round(1e4 * LOG.voltage_V), np.round(1e4 * LOG.current_A)
    return rows


def nda(folder: Path) -> Path:
    rows, begin, range_at = _neware(_NDA, 1), 256, 80
    rows["unix"] = [round(at.timestamp()) for at in LOG.moments]
    head = bytearray(b"NEWARE".ljust(begin, b"\0"))
    head[14], head[16:20] = 8, range_at.to_bytes(4, "little")
    head[64:72] = struct.pack("<II", begin, rows.nbytes)
    head[range_at + 26 : range_at + 30] = _RANGE_MA.to_bytes(4, "little")
    (folder / "log.nda").write_bytes(bytes(head) + rows.tobytes())
    return folder / "log.nda"


def ndax(folder: Path) -> Path:
    """Blocks of 512 bytes, each with as many records as fit."""
    rows, begin, block = _neware(_NDC, 1000), 5, 512
    rows["range"] = _RANGE_MA
    for name, form in zip(("Y", *"MDhms"), ("%Y", "%m", "%d", "%H", "%M", "%S"), strict=True):
        rows[name] = [int(at.strftime(form)) for at in LOG.moments]
    each = (block - begin - 1) // _NDC.itemsize
    blocks = (bytes(begin) + rows[k : k + each].tobytes() for k in range(0, rows.size, each))
    head = bytes([1, 0, 2]).ljust(block, b"\0")
    with zipfile.ZipFile(folder / "log.ndax", "w") as archive:
        archive.writestr("data.ndc", head + b"".join(content.ljust(block, b"\0") for content in blocks))
    return folder / "log.ndax"


RECORDERS = (
    f("ArduPilot, DataFlash", binary_file("log.bin", dataflash()), package="pymavlink"),
    f("ArduPilot, telemetry", telemetry, package="pymavlink", dated=True),
    f("BioLogic EC-Lab .mpr", mpr, package="galvani", warm=False),
    f("Neware .nda", nda, package="fastnda", warm=False),
    f("Neware .ndax", ndax, package="fastnda", warm=False),
    f("MDF 4, signals", mdf, package="asammdf", dated=True, warm=False),
    f("SQLite of a logger", sqlite, dated=True),
)
