"""Files of named arrays: MATLAB, HDF5, NumPy, Feather, and those of cyclers. Arrays of equal length form a table."""

from __future__ import annotations

import io
import re
import struct
import warnings
import zipfile
import zlib
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.csv_layout import UNPACKED_BYTES, UNPACKED_TIMES
from ohmward.logs.frame import flattened, plain_array, values_of
from ohmward.logs.hints import FileHints
from ohmward.logs.table import Note, Opener, Table, TableFile, file_of, parsing, row_numbers
from ohmward.optional import require, silenced

HDF5_MAGIC = b"\x89HDF\r\n\x1a\n"
#: Kinds of NumPy types that a column may have.
_KINDS = "biufmM"


def open_matlab(path: Path, hints: FileHints) -> TableFile:
    """The columns of a MATLAB file of version 5 to 7.2: vectors, fields of structures."""
    with parsing(path, "no readable MATLAB file", "save it again with save(..., '-v7')"):
        content = path.read_bytes()
        order = "<" if content[126:128] == b"IM" else ">"
        arrays = dict(
            one for kind, part in _elements(content[128:], order) for one in _matlab_arrays(kind, part, order)
        )
    return open_arrays(path.name, _stacked(arrays), hints, "; write a table of MATLAB with writetable(T, 'log.csv')")


#: An array in an element of an array of structures, which are counted from 0.
_ELEMENT = re.compile(r"(?P<stem>.+?)\[(?P<number>\d+)\]\.(?P<field>.+)")


def _stacked(arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The arrays, those in the elements of an array of structures one below the other, beside the element's number."""
    stacked = {name: values for name, values in arrays.items() if not _ELEMENT.match(name)}
    elements: dict[str, dict[int, dict[str, np.ndarray]]] = defaultdict(lambda: defaultdict(dict))
    for name, values in arrays.items():
        if (found := _ELEMENT.match(name)) and values.ndim == 1 and values.size > 1 and values.dtype.kind in _KINDS:
            elements[found["stem"]][int(found["number"])][found["field"]] = values
    for stem, of_stem in elements.items():
        rows = {k: Counter(map(np.size, of_one.values())).most_common(1)[0][0] for k, of_one in of_stem.items()}
        for field in dict.fromkeys(field for of_one in of_stem.values() for field in of_one):
            fits = {k: v for k, of_one in of_stem.items() if (v := of_one.get(field)) is not None and v.size == rows[k]}
            if fits:
                parts = [fits.get(k, np.full(count, np.nan)) for k, count in rows.items()]
                stacked[f"{stem}.{field}"] = np.concatenate(parts)
        stacked[stem] = np.repeat(np.array(list(rows)) + 1, list(rows.values()))
    return stacked


def open_hdf5(path: Path, hints: FileHints) -> TableFile:
    """The columns of an HDF5 file, MATLAB 7.3 among them: data sets of one length, or the fields of one."""
    h5py = require("h5py", "an HDF5 file")
    arrays: dict[str, np.ndarray] = {}

    def visit(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and item.dtype.kind in f"{_KINDS}VSO" and not name.startswith("#"):
            arrays[name.replace("/", ".")] = np.squeeze(item[()])

    with parsing(path, "no readable HDF5 file", "write it again"), h5py.File(path, "r") as file:
        file.visititems(visit)
    return open_arrays(path.name, arrays, hints, "; give a table of pandas as pandas.read_hdf(FILE)")


def open_numpy(path: Path, hints: FileHints) -> TableFile:
    """The columns of a file of `numpy.savez` or `numpy.save`."""
    with parsing(path, "no readable file of NumPy", "write it again"), path.open("rb") as stream:
        found = np.load(stream, allow_pickle=False)
        arrays = {"": found} if isinstance(found, np.ndarray) else dict(found)
        arrays = {name.replace("/", "."): np.squeeze(values) for name, values in arrays.items()}
    return open_arrays(path.name, arrays, hints)


def open_feather(path: Path, hints: FileHints) -> TableFile:
    """The columns of a Feather (Arrow IPC) file."""
    pyarrow = require("pyarrow", "a Feather file")
    ipc = require("pyarrow.ipc", "a Feather file")
    with parsing(path, "no readable Feather file", "write it again"), pyarrow.OSFile(str(path), "rb") as stream:
        table = flattened(ipc.open_file(stream).read_all())
        columns = {name: values_of(table[name].combine_chunks()) for name in table.column_names}
    return open_arrays(path.name, columns, hints)


def open_arrays(
    source: str, arrays: Mapping[str, Any], hints: FileHints, advice: str = "", notes: tuple[Note, ...] = ()
) -> TableFile:
    """The table of the largest group of arrays of equal length; InputError where no two have one above 1.

    The fields of a structured array are columns, and those of a matrix where the hints, or as many texts beside it as
    pandas writes them, name them.

    arrays: name -> values of any shape; a name with points is shortened to its last part where that is unique.
    """
    lengths: dict[int, dict[str, np.ndarray]] = defaultdict(dict)
    for name, values in _vectors(arrays, hints):
        array = plain_array(_decoded(values))
        if array.ndim == 1 and array.size > 1:
            lengths[array.size][name] = array
    rows, columns = max(lengths.items(), key=lambda item: (len(item[1]), item[0]), default=(0, {}))
    if len(columns) < 2:
        held = ", ".join(f"{name} {np.shape(value)}" for name, value in list(arrays.items())[:8]) or "nothing"
        if any(np.ndim(values) == 2 for values in arrays.values()):
            advice += "; name the columns of a matrix in their order with --names time_s,current_A,voltage_V,..."
        raise InputError(f"{source}: no two columns of one length found; it has: {held}{advice}")
    last = [name.rpartition(".")[2] for name in columns]
    short = [one if last.count(one) == 1 else name for one, name in zip(last, columns, strict=True)]
    table = Table(source, dict(zip(short, columns.values(), strict=True)), row_numbers(1, rows), "row", notes)
    return file_of(table, hints)


def _vectors(arrays: Mapping[str, Any], hints: FileHints) -> Iterator[tuple[str, Any]]:
    """Each array by its name, a structured one by its fields, and a matrix by the names of its columns."""
    texts = [values for values in arrays.values() if np.ndim(values) == 1 and np.asarray(values).dtype.kind in "SUO"]
    for name, values in arrays.items():
        if fields := getattr(getattr(values, "dtype", None), "names", None):
            yield from ((f"{name}.{field}" if name else field, values[field]) for field in fields)
        elif np.ndim(values) == 2:
            width = np.shape(values)[1]
            beside = [_decoded(np.asarray(text)).tolist() for text in texts if len(text) == width]
            names = next((one for one in (hints.names, *beside) if one and len(one) == width), ())
            yield from ((str(column), values[:, k]) for k, column in enumerate(names))
        else:
            yield name, values


#: Types of the elements of a MATLAB file, and of the numbers of its classes (MAT-File Format, tables 1-1 and 1-3).
_TYPES = {
    **{1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8"},
    **{12: "i8", 13: "u8", 16: "u1", 17: "u2"},
}
_CLASSES = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4", 14: "i8", 15: "u8"}
_MATRIX, _PACKED = 14, 15
_STRUCTURE, _TEXT, _COMPLEX = 2, 4, 0x800


def _elements(content: bytes, order: str) -> Iterator[tuple[int, bytes]]:
    """Type and content of each element; order: of the bytes in a number, `<` or `>`."""
    at = 0
    while at + 8 <= len(content):
        kind, size = struct.unpack_from(f"{order}II", content, at)
        if kind >> 16:  # of up to four bytes, with the size in the upper half of the type
            yield kind & 0xFFFF, content[at + 4 : at + 4 + min(kind >> 16, 4)]
            at += 8
        else:
            yield kind, content[at + 8 : at + 8 + size]
            at += 8 + size + (-size % 8 if kind != _PACKED else 0)


def _matlab_arrays(kind: int, content: bytes, order: str, before: str = "") -> Iterator[tuple[str, np.ndarray]]:
    """Name and values of the arrays in a variable: of numbers, of lines of text, and of fields at any depth."""
    if kind == _PACKED:
        unpacking = zlib.decompressobj()
        unpacked = unpacking.decompress(content, max(UNPACKED_BYTES, UNPACKED_TIMES * len(content)))
        if not unpacking.eof:
            raise ValueError("a variable is cut off, or unpacks to far more than a log")
        for inner_kind, inner in _elements(unpacked, order):
            yield from _matlab_arrays(inner_kind, inner, order, before)
    parts = list(_elements(content, order)) if kind == _MATRIX else []
    if len(parts) < 4:
        return
    flags, shape = (np.frombuffer(part, f"{order}{_TYPES[type_]}") for type_, part in parts[:2])
    class_, name = int(flags[0]) & 0xFF, before + parts[2][1].decode(errors="replace")
    if class_ == _STRUCTURE:
        length = int.from_bytes(parts[3][1], "little" if order == "<" else "big")
        fields = [parts[4][1][k : k + length].partition(b"\0")[0] for k in range(0, len(parts[4][1]), length)]
        for k, (field_kind, part) in enumerate(parts[5:]):
            number, field = divmod(k, len(fields))
            element = f"{name}[{number}]" if shape.prod() > 1 else name
            yield from _matlab_arrays(field_kind, part, order, f"{element}.{fields[field].decode(errors='replace')}")
    elif (class_ in _CLASSES and not flags[0] & _COMPLEX and name) or (class_ == _TEXT and shape[0] > 1):
        type_, part = parts[3]
        data = np.frombuffer(part, f"{order}{_TYPES[type_]}").reshape(shape, order="F")
        lines = ["".join(map(chr, line)) for line in data.tolist()] if class_ == _TEXT else []
        yield name, np.array(lines) if class_ == _TEXT else np.squeeze(data).astype(_CLASSES[class_])


def _decoded(values: Any) -> Any:
    """Text in place of bytes."""
    if not isinstance(values, np.ndarray) or values.dtype.kind not in "SO" or values.ndim != 1:
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
    b"\x93NUMPY": open_numpy,
    HDF5_MAGIC: open_hdf5,
    b"MATLAB 7.3": open_hdf5,
    b"MATLAB 5.0": open_matlab,
}
