"""Binary files, streams and folders."""

from __future__ import annotations

import io
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from logs.formats.known import LOG, Format, lines
from logs.formats.layouts import NAMES, PLAIN

FAMILY = "files of programs"
COLUMNS = dict(zip(NAMES, LOG[:4], strict=True))


def f(name: str, write: Callable[[Path], Path], **about) -> Format:
    return Format(name, FAMILY, write, LOG, **about)


def workbook(folder: Path) -> Path:
    import openpyxl

    book = openpyxl.Workbook()
    sheet = book.active
    sheet.append(NAMES)
    for row in LOG.rows():
        sheet.append(row)
    book.save(folder / "log.xlsx")
    return folder / "log.xlsx"


def dated_workbook(folder: Path) -> Path:
    """Text above, dates, a row of units, and the log on the second sheet."""
    import openpyxl

    book = openpyxl.Workbook()
    book.active.append(["Test report"])
    book.active.append(["Battery", "4S LFP"])
    sheet = book.create_sheet("record")
    for row in (["Test", 4711], [], ["Date", "Current", "Voltage", "T1"], ["", "A", "V", "°C"]):
        sheet.append(row)
    for (_, i, u, c), at in zip(LOG.rows(), LOG.moments, strict=True):
        sheet.append([at.replace(tzinfo=None), i, u, c])
    book.save(folder / "log.xlsx")
    return folder / "log.xlsx"


def split_workbook(folder: Path) -> Path:
    """A log over two sheets, as texts with decimal commas, beside a sheet of remarks."""
    import openpyxl

    book = openpyxl.Workbook()
    book.active.append(["Remarks"])
    for k in range(2):
        sheet = book.create_sheet(f"part {k + 1}")
        for row in (NAMES, *PLAIN[150 * k : 150 * (k + 1)]):
            sheet.append([cell if row is NAMES else cell.replace(".", ",") for cell in row])
    book.save(folder / "log.xlsx")
    return folder / "log.xlsx"


def archive(folder: Path) -> Path:
    with zipfile.ZipFile(folder / "log.zip", "w") as packed:
        packed.writestr("export/log.csv", lines(NAMES, PLAIN))
        packed.writestr("export/readme.txt", "of robot 3")
    return folder / "log.zip"


def _record(kind: int, content: bytes) -> bytes:
    return struct.pack("<HH", kind, len(content)) + content


def old_workbook(folder: Path) -> Path:
    """A workbook of Excel 97: records of BIFF8 as the one stream of a compound file of sectors of 512 bytes."""

    def begin(kind: int) -> bytes:
        return _record(0x809, struct.pack("<HH12x", 0x600, kind))

    end = _record(0x0A, b"")
    cells = [
        _record(0x204, struct.pack("<HHHHB", 0, k, 0, len(name), 0) + name.encode()) for k, name in enumerate(NAMES)
    ]
    cells += [
        _record(0x203, struct.pack("<HHHd", row, k, 0, value))
        for row, values in enumerate(LOG.rows(), 1)
        for k, value in enumerate(values)
    ]
    globals_size = len(begin(5)) + len(_record(0x85, bytes(11))) + len(end)
    sheet = _record(0x85, struct.pack("<IHBB", globals_size, 0, 3, 0) + b"log")
    stream = begin(5) + sheet + end + begin(0x10) + b"".join(cells) + end
    stream += bytes(-len(stream) % 512)
    sectors = len(stream) // 512
    # sector 0: the table of sectors, 1: the directory, from 2 on: the stream
    chain = [0xFFFFFFFD, 0xFFFFFFFE, *range(3, 2 + sectors), 0xFFFFFFFE]
    table = struct.pack(f"<{len(chain)}I", *chain).ljust(512, b"\xff")

    def entry(name: str, kind: int, child: int, start: int, size: int) -> bytes:
        text = name.encode("utf-16-le")
        head = text.ljust(64, b"\0") + struct.pack("<HBBiii", len(text) + 2, kind, 1, -1, -1, child)
        return head + bytes(36) + struct.pack("<IQ", start, size)

    directory = entry("Root Entry", 5, 1, 0xFFFFFFFE, 0) + entry("Workbook", 2, -1, 2, len(stream))
    head = b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(16) + struct.pack("<HHHHH6x", 0x3E, 3, 0xFFFE, 9, 6)
    head += struct.pack("<IIIIIIIII", 0, 1, 1, 0, 4096, 0xFFFFFFFE, 0, 0xFFFFFFFE, 0) + struct.pack("<I", 0)
    content = head.ljust(512, b"\xff") + table + directory.ljust(512, b"\0") + stream
    (folder / "log.xls").write_bytes(content)
    return folder / "log.xls"


def open_document(folder: Path) -> Path:
    """A workbook of LibreOffice: its log is one part of XML."""
    rows = [
        [f"<table:table-cell office:value-type='string'><text:p>{name}</text:p></table:table-cell>" for name in NAMES]
    ]
    rows += [
        [f"<table:table-cell office:value-type='float' office:value='{value}'/>" for value in row] for row in LOG.rows()
    ]
    body = "".join(f"<table:table-row>{''.join(row)}</table:table-row>" for row in rows)
    spaces = " ".join(
        f"xmlns:{name}='urn:oasis:names:tc:opendocument:xmlns:{name}:1.0'" for name in ("office", "table", "text")
    )
    text = f"<office:document-content {spaces}><office:body><office:spreadsheet><table:table table:name='log'>{body}"
    text += "</table:table></office:spreadsheet></office:body></office:document-content>"
    kind = "application/vnd.oasis.opendocument.spreadsheet"
    manifest = (
        "<manifest:manifest xmlns:manifest='urn:oasis:names:tc:opendocument:xmlns:manifest:1.0'>"
        f"<manifest:file-entry manifest:full-path='/' manifest:media-type='{kind}'/></manifest:manifest>"
    )
    with zipfile.ZipFile(folder / "log.ods", "w", zipfile.ZIP_DEFLATED) as book:
        book.writestr("mimetype", kind, zipfile.ZIP_STORED)
        book.writestr("META-INF/manifest.xml", manifest)
        book.writestr("content.xml", text)
    return folder / "log.ods"


def matlab(values: Callable[[], dict]) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        from scipy.io import savemat

        savemat(folder / "log.mat", values())
        return folder / "log.mat"

    return write


def structures() -> dict:
    """An array of three structures, each a part of the log with its own date."""
    cycles = np.empty((1, 3), dtype=[("time", "O"), ("data", "O")])
    for k in range(3):
        part = {name: values[100 * k : 100 * (k + 1)] for name, values in COLUMNS.items()}
        cycles[0, k] = np.array([2026.0, 3.0, 28.0, 9.0, 15.0, 0.5]), part
    return {"B0005": {"cycle": cycles}}


def hdf5(name: str, group: str = "", user_block: bytes = b"") -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        import h5py

        with h5py.File(folder / name, "w", userblock_size=512 if user_block else 0) as file:
            for column, values in COLUMNS.items():
                file[f"{group}{column}"] = values[np.newaxis, :] if user_block else values
        if user_block:  # as MATLAB 7.3 does
            with (folder / name).open("r+b") as stream:
                stream.write(user_block.ljust(512, b"\0"))
        return folder / name

    return write


def compound(folder: Path) -> Path:
    import h5py

    table = np.zeros(LOG.time_s.size, [(name, float) for name in COLUMNS])
    for name, values in COLUMNS.items():
        table[name] = values
    with h5py.File(folder / "log.h5", "w") as file:
        file["run/battery"] = table
    return folder / "log.h5"


def parquet(folder: Path) -> Path:
    import pyarrow.parquet

    pyarrow.parquet.write_table(pyarrow.table(COLUMNS), folder / "log.parquet")
    return folder / "log.parquet"


def structured_parquet(folder: Path) -> Path:
    import pyarrow.parquet

    packs = [{"current": i, "voltage": u, "temp": {"battery": c}} for _, i, u, c in LOG.rows()]
    table = pyarrow.table({"ts": [at.replace(tzinfo=None) for at in LOG.moments], "pack": packs})
    pyarrow.parquet.write_table(table, folder / "log.parquet")
    return folder / "log.parquet"


def feather(folder: Path) -> Path:
    import pyarrow.feather

    pyarrow.feather.write_feather(pyarrow.table(COLUMNS), folder / "log.feather")
    return folder / "log.feather"


def npz(folder: Path) -> Path:
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **COLUMNS)
    (folder / "log.npz").write_bytes(buffer.getvalue())
    return folder / "log.npz"


def parts(folder: Path) -> Path:
    """Three files of one log, the clock running on."""
    (folder / "log").mkdir()
    for k in range(3):
        text = lines(NAMES, PLAIN[100 * k : 100 * (k + 1)])
        (folder / "log" / f"part_{k + 9}.csv").write_text(text, encoding="utf-8")
    return folder / "log"


CONTAINERS = (
    f("Excel workbook", workbook, package="openpyxl"),
    f("Excel workbook, second sheet, dates, units", dated_workbook, package="openpyxl", dated=True),
    f("Excel workbook, two sheets, texts", split_workbook, package="openpyxl"),
    f("zip archive of a log", archive),
    f("Excel 97 workbook", old_workbook, package="python_calamine"),
    f("OpenDocument workbook", open_document, package="python_calamine"),
    f("MATLAB, vectors", matlab(lambda: COLUMNS), package="scipy"),
    f("MATLAB, a structure", matlab(lambda: {"note": "4S", "log": {"meas": COLUMNS}}), package="scipy"),
    f("MATLAB, an array of structures", matlab(structures), package="scipy"),
    f("MATLAB 7.3", hdf5("log.mat", user_block=b"MATLAB 7.3 MAT-file, Platform: GLNXA64"), package="h5py"),
    f("HDF5, a data set for each column", hdf5("log.h5", "battery/"), package="h5py"),
    f("HDF5, a table", compound, package="h5py"),
    f("Parquet", parquet, package="pyarrow"),
    f("Parquet, structures", structured_parquet, package="pyarrow", dated=True),
    f("Feather", feather, package="pyarrow"),
    f("NumPy .npz", npz),
    f("folder of files, one log", parts),
)
