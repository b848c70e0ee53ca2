"""Files of named arrays: MATLAB, HDF5, NumPy, Feather, and those of cyclers. Arrays of equal length form a table."""

from __future__ import annotations

import io
import warnings
import zipfile
from collections import defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.frame import plain_array, values_of
from ohmward.logs.hints import FileHints
from ohmward.logs.table import Note, Opener, Table, TableFile, file_of, parsing, row_numbers
from ohmward.optional import require, silenced

HDF5_MAGIC = b"\x89HDF\r\n\x1a\n"
#: Kinds of NumPy types that a column may have.
_KINDS = "biufmM"


def open_matlab(path: Path, hints: FileHints) -> TableFile:
    """The columns of a MATLAB file of version 5 to 7.2: vectors, fields of structures."""
    matlab = require("scipy.io", "a MATLAB file")
    with parsing(path, "no readable MATLAB file", "save it again with save(..., '-v7')"):
        content = matlab.loadmat(str(path), squeeze_me=True, struct_as_record=False)
    named = {name: value for name, value in content.items() if not name.startswith("__")}
    return open_arrays(
        path.name, dict(_fields(named)), hints, "; write a table of MATLAB with writetable(T, 'log.csv')"
    )


def open_hdf5(path: Path, hints: FileHints) -> TableFile:
    """The columns of an HDF5 file, MATLAB 7.3 among them: data sets of one length, or the fields of one."""
    h5py = require("h5py", "an HDF5 file")
    arrays: dict[str, np.ndarray] = {}

    def visit(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and item.dtype.kind in f"{_KINDS}VSO" and not name.startswith("#"):
            values = np.squeeze(item[()])
            fields = {field: values[field] for field in values.dtype.names or () if values[field].ndim == 1}
            found = fields if values.dtype.names else {name.replace("/", "."): values}
            arrays.update({column: _decoded(of_column) for column, of_column in found.items()})

    with parsing(path, "no readable HDF5 file", "write it again"), h5py.File(path, "r") as file:
        file.visititems(visit)
    return open_arrays(path.name, arrays, hints)


def open_npz(path: Path, hints: FileHints) -> TableFile:
    """The columns of a file of `numpy.savez`."""
    with (
        parsing(path, "no readable file of NumPy", "write it again"),
        path.open("rb") as stream,
        np.load(stream, allow_pickle=False) as file,
    ):
        arrays = {name: np.squeeze(file[name]) for name in file.files}
    return open_arrays(path.name, arrays, hints)


def open_feather(path: Path, hints: FileHints) -> TableFile:
    """The columns of a Feather (Arrow IPC) file."""
    pyarrow = require("pyarrow", "a Feather file")
    ipc = require("pyarrow.ipc", "a Feather file")
    with parsing(path, "no readable Feather file", "write it again"), pyarrow.OSFile(str(path), "rb") as stream:
        table = ipc.open_file(stream).read_all()
        columns = {name: values_of(table[name].combine_chunks()) for name in table.column_names}
    return open_arrays(path.name, columns, hints)


def open_arrays(
    source: str, arrays: Mapping[str, Any], hints: FileHints, advice: str = "", notes: tuple[Note, ...] = ()
) -> TableFile:
    """The table of the largest group of arrays of equal length.

    arrays: name -> values of any shape; a name with points is shortened to its last part where that is unique.

    Raises:
        InputError: no two arrays have an equal length above 1.
    """
    lengths: dict[int, dict[str, np.ndarray]] = defaultdict(dict)
    for name, values in arrays.items():
        array = plain_array(values)
        if array.ndim == 1 and array.size > 1:
            lengths[array.size][name] = array
    rows, columns = max(lengths.items(), key=lambda item: (len(item[1]), item[0]), default=(0, {}))
    if len(columns) < 2:
        held = ", ".join(f"{name} {np.shape(value)}" for name, value in list(arrays.items())[:8]) or "nothing"
        raise InputError(f"{source}: no two columns of one length found; it has: {held}{advice}")
    last = [name.rpartition(".")[2] for name in columns]
    short = [one if last.count(one) == 1 else name for one, name in zip(last, columns, strict=True)]
    table = Table(source, dict(zip(short, columns.values(), strict=True)), row_numbers(1, rows), "row", notes)
    return file_of(table, hints)


def _fields(content: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Arrays among the variables and, at any depth, in the fields of structures."""
    for name, value in content.items():
        if hasattr(value, "_fieldnames"):
            yield from _fields({field: getattr(value, field) for field in value._fieldnames}, f"{before}{name}.")
        elif isinstance(value, np.ndarray) and value.dtype.kind in f"{_KINDS}U":
            yield f"{before}{name}", value


def _decoded(values: np.ndarray) -> np.ndarray:
    """Text in place of bytes."""
    if values.dtype.kind not in "SO" or values.ndim != 1:
        return values
    text = [value.decode(errors="replace") if isinstance(value, bytes) else str(value) for value in values.tolist()]
    return np.array(text, dtype=object)


def open_mpr(path: Path, hints: FileHints) -> TableFile:
    """The columns of a file of EC-Lab, of a version that galvani knows."""
    galvani = require("galvani", "a file of EC-Lab (.mpr)")
    with parsing(path, "no .mpr file that galvani reads", "export it in EC-Lab as text"):
        # not the file itself, whose `read` allocates memory for any length that a damaged header gives
        data = galvani.MPRfile(io.BytesIO(path.read_bytes())).data
    return open_arrays(path.name, {name: np.asarray(data[name]) for name in data.dtype.names}, hints)


def open_neware(path: Path, hints: FileHints) -> TableFile:
    """The columns of a file of Neware, of a version that fastnda knows."""
    fastnda = require("fastnda", "a file of Neware (.nda, .ndax)")
    with (
        parsing(path, "no file that fastnda reads", "export it in BTSDA as Excel or CSV"),
        silenced(),
        warnings.catch_warnings(record=True) as warned,
    ):
        warnings.simplefilter("always")
        frame = fastnda.read(path)
    # of a version that its author has not compared with Neware's own program
    notes = tuple(Note(" ".join(str(one.message).split()), "warning") for one in warned)
    return open_arrays(path.name, {name: frame[name].to_numpy() for name in frame.columns}, hints, notes=notes)


def is_ndax(path: Path) -> bool:
    """True for an archive that holds the parts of Neware's .ndax."""
    try:
        with zipfile.ZipFile(path) as archive:
            return any(name.lower().endswith(".ndc") for name in archive.namelist())
    except (zipfile.BadZipFile, NotImplementedError, OSError):  # damaged, or of a version that nobody writes
        return False


#: Opener of each format that is recognised by its first bytes.
OPENERS: dict[bytes, Opener] = {
    b"BIO-LOGIC MODULAR FILE": open_mpr,
    b"NEWARE": open_neware,
    b"ARROW1": open_feather,
    HDF5_MAGIC: open_hdf5,
    b"MATLAB 7.3": open_hdf5,
    b"MATLAB 5.0": open_matlab,
}
