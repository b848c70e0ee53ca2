"""Files of named arrays: MATLAB, HDF5, NumPy, Feather. The arrays of one length are a table."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.arrays import plain_array
from ohmward.logs.arrow import table_of
from ohmward.logs.hints import FileHints
from ohmward.logs.table import Progress, Table, TableFile, row_numbers
from ohmward.optional import require

HDF5_MAGIC = b"\x89HDF\r\n\x1a\n"
FEATHER_MAGIC = b"ARROW1"
MATLAB_MAGIC = b"MATLAB 5.0"
MATLAB_HDF5_MAGIC = b"MATLAB 7.3"
ZIP_MAGIC = b"PK\x03\x04"
#: Kinds of NumPy that a column may have.
_KINDS = "biufmM"


def open_matlab(path: Path, hints: FileHints) -> TableFile:
    """The columns of a MATLAB file of version 5 to 7.2: vectors, fields of structures.

    Raises:
        InputError: damaged, or without two vectors of one length.
        OhmwardError: scipy is not installed.
    """
    io = require("scipy.io", "a MATLAB file")
    try:
        content = io.loadmat(str(path), squeeze_me=True, struct_as_record=False)
    except Exception as error:  # of its parser, many kinds
        raise InputError(
            f"{path.name}: no readable MATLAB file ({error}); save it again with save(..., '-v7')"
        ) from error
    named = {name: value for name, value in content.items() if not name.startswith("__")}
    return open_arrays(
        path.name, dict(_fields(named)), hints, "; write a table of MATLAB with writetable(T, 'log.csv')"
    )


def open_hdf5(path: Path, hints: FileHints) -> TableFile:
    """The columns of an HDF5 file, MATLAB 7.3 among them: data sets of one length, or the fields of one.

    Raises:
        InputError: damaged, or without two columns of one length.
        OhmwardError: h5py is not installed.
    """
    h5py = require("h5py", "an HDF5 file")
    arrays: dict[str, np.ndarray] = {}

    def visit(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and item.dtype.kind in f"{_KINDS}VSO" and not name.startswith("#"):
            arrays.update(_columns_of(name.replace("/", "."), np.squeeze(item[()])))

    try:
        with h5py.File(path, "r") as file:
            file.visititems(visit)
    except Exception as error:  # of its parser, many kinds
        raise InputError(f"{path.name}: no readable HDF5 file ({error}); write it again") from error
    return open_arrays(path.name, arrays, hints)


def open_npz(path: Path, hints: FileHints) -> TableFile:
    """The columns of a file of `numpy.savez`.

    Raises:
        InputError: damaged, or without two columns of one length.
    """
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            arrays = {name: np.squeeze(file[name]) for name in file.files}
    except Exception as error:  # of zip, of its parser of headers, many kinds
        raise InputError(f"{path.name}: no readable file of NumPy ({error}); write it again") from error
    return open_arrays(path.name, arrays, hints)


def open_feather(path: Path, hints: FileHints) -> TableFile:
    """The columns of a Feather (Arrow IPC) file.

    Raises:
        InputError: damaged.
        OhmwardError: pyarrow is not installed.
    """
    pyarrow = require("pyarrow", "a Feather file")
    ipc = require("pyarrow.ipc", "a Feather file")
    try:
        with pyarrow.OSFile(str(path), "rb") as stream:
            columns = table_of(ipc.open_file(stream).read_all())
    except (pyarrow.ArrowException, OSError) as error:
        raise InputError(f"{path.name}: no readable Feather file ({error}); write it again") from error
    return open_arrays(path.name, columns, hints)


def open_arrays(source: str, arrays: Mapping[str, Any], hints: FileHints, advice: str = "") -> TableFile:
    """The table of the most arrays of one length.

    arrays: name -> values, those of other shapes among them; of a name with points the last part that is unique.

    Raises:
        InputError: no two arrays have one length above 1.
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
    named = _short_names(columns)

    def load(names: Collection[str], progress: Progress | None = None) -> Table:
        chosen = {name: values for name, values in named.items() if name in names}
        return Table(source, chosen, row_numbers(1, rows), "row")

    return TableFile(source, tuple(named), load, hints=hints)


def _short_names(columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The columns by the last parts of their names, by whole names where those stand twice."""
    last = [name.rpartition(".")[2] for name in columns]
    return {(one if last.count(one) == 1 else name): v for one, (name, v) in zip(last, columns.items(), strict=True)}


def _fields(content: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Arrays among the variables and, at any depth, in the fields of structures."""
    for name, value in content.items():
        if hasattr(value, "_fieldnames"):
            yield from _fields({field: getattr(value, field) for field in value._fieldnames}, f"{before}{name}.")
        elif isinstance(value, np.ndarray) and value.dtype.kind in f"{_KINDS}U":
            yield f"{before}{name}", value


def _columns_of(name: str, values: np.ndarray) -> dict[str, np.ndarray]:
    """A data set, or each of its fields."""
    if values.dtype.names:
        return {field: _decoded(values[field]) for field in values.dtype.names if values[field].ndim == 1}
    return {name: _decoded(values)}


def _decoded(values: np.ndarray) -> np.ndarray:
    """Text in place of bytes."""
    if values.dtype.kind not in "SO" or values.ndim != 1:
        return values
    text = [value.decode(errors="replace") if isinstance(value, bytes) else str(value) for value in values.tolist()]
    return np.array(text, dtype=object)
