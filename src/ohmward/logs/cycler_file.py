"""Binary files of cyclers: BioLogic .mpr, Neware .nda and .ndax, by the packages that know them."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.arrays_file import open_arrays
from ohmward.logs.hints import FileHints
from ohmward.logs.table import TableFile
from ohmward.optional import require

MPR_MAGIC = b"BIO-LOGIC MODULAR FILE"
NDA_MAGIC = b"NEWARE"
#: Parts of an archive of Neware, by the endings of their names.
_NDAX_PART = ".ndc"


def open_mpr(path: Path, hints: FileHints) -> TableFile:
    """The columns of a file of EC-Lab.

    Raises:
        InputError: damaged, or of a version that galvani does not know.
        OhmwardError: galvani is not installed.
    """
    galvani = require("galvani", "a file of EC-Lab (.mpr)")
    try:
        with path.open("rb") as stream:
            data = galvani.MPRfile(stream).data
    except Exception as error:  # of its parser, many kinds
        raise InputError(
            f"{path.name}: no .mpr file that galvani reads ({error}); export it in EC-Lab as text"
        ) from error
    return open_arrays(path.name, {name: np.asarray(data[name]) for name in data.dtype.names}, hints)


def open_neware(path: Path, hints: FileHints) -> TableFile:
    """The columns of a file of Neware.

    Raises:
        InputError: damaged, or of a version that fastnda does not know.
        OhmwardError: fastnda is not installed.
    """
    fastnda = require("fastnda", "a file of Neware (.nda, .ndax)")
    try:
        frame = fastnda.read(path)
    except Exception as error:  # of its parser, many kinds
        raise InputError(
            f"{path.name}: no file that fastnda reads ({error}); export it in BTSDA as Excel or CSV"
        ) from error
    return open_arrays(path.name, {name: frame[name].to_numpy() for name in frame.columns}, hints)


def is_ndax(path: Path) -> bool:
    """True for an archive that holds the parts of Neware's .ndax."""
    try:
        with zipfile.ZipFile(path) as archive:
            return any(name.lower().endswith(_NDAX_PART) for name in archive.namelist())
    except (zipfile.BadZipFile, OSError):
        return False
