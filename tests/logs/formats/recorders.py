"""Binary files of vehicles, cyclers and loggers, laid out as packages read them, or written by those."""

from __future__ import annotations

import sqlite3
import struct
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


RECORDERS = (
    f("ArduPilot, DataFlash", binary_file("log.bin", dataflash()), package="pymavlink"),
    f("ArduPilot, telemetry", telemetry, package="pymavlink", dated=True),
    f("BioLogic EC-Lab .mpr", mpr, package="galvani", warm=False),
    f("MDF 4, signals", mdf, package="asammdf", dated=True, warm=False),
    f("SQLite of a logger", sqlite, dated=True),
)
