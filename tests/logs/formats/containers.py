"""Binary files, streams and folders."""

from __future__ import annotations

import io
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


def matlab(values: Callable[[], dict]) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        from scipy.io import savemat

        savemat(folder / "log.mat", values())
        return folder / "log.mat"

    return write


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
    f("MATLAB, vectors", matlab(lambda: COLUMNS), package="scipy"),
    f("MATLAB, a structure", matlab(lambda: {"note": "4S", "log": {"meas": COLUMNS}}), package="scipy"),
    f("MATLAB 7.3", hdf5("log.mat", user_block=b"MATLAB 7.3 MAT-file, Platform: GLNXA64"), package="h5py"),
    f("HDF5, a data set for each column", hdf5("log.h5", "battery/"), package="h5py"),
    f("HDF5, a table", compound, package="h5py"),
    f("Parquet", parquet, package="pyarrow"),
    f("Feather", feather, package="pyarrow"),
    f("NumPy .npz", npz),
    f("folder of files, one log", parts),
)
