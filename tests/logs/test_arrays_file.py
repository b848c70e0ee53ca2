"""Logs as arrays: the columns of structured arrays and of matrices."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.logs import FileHints, read_log

NAMES = ("time_s", "current_A", "voltage_V")
MATRIX = np.column_stack([np.arange(20.0), -1.0 * (np.arange(20) % 2), 12.5 + 0.1 * (np.arange(20) % 2)])
TABLE = np.array([tuple(row) for row in MATRIX], [(name, "f8") for name in NAMES])


def saved(folder: Path, name: str, **arrays: np.ndarray) -> Path:
    path = folder / name
    if path.suffix == ".npy":
        np.save(path, arrays["log"])
    elif path.suffix == ".npz":
        np.savez(path, allow_pickle=False, **arrays)
    else:
        with h5py.File(path, "w") as file:
            for key, values in arrays.items():
                file[key] = values
    return path


def assert_read(path: Path, hints: FileHints | None = None) -> None:
    log = read_log(path, current_sign="charge", hints=hints)
    np.testing.assert_array_equal(np.column_stack([log.time_s, log.current_A, log.voltage_V]), MATRIX)


@pytest.mark.parametrize("name", ["log.npy", "log.npz", "log.h5"])
def test_the_fields_of_a_structured_array_are_columns(name, tmp_path):
    assert_read(saved(tmp_path, name, log=TABLE))


@pytest.mark.parametrize("name", ["log.npy", "log.npz", "log.h5"])
def test_the_columns_of_a_matrix_are_named_by_the_user(name, tmp_path):
    path = saved(tmp_path, name, log=MATRIX)
    with pytest.raises(InputError, match=r"it has: \w* \(20, 3\).*--names time_s,current_A,voltage_V"):
        read_log(path)
    assert_read(path, FileHints(names=NAMES))


def test_the_columns_of_a_matrix_are_named_by_texts_beside_it(tmp_path):
    """As pandas' `to_hdf` writes a DataFrame."""
    texts = np.array([name.encode() for name in NAMES])
    frame = {"log/axis0": texts, "log/axis1": np.arange(20), "log/block0_items": texts, "log/block0_values": MATRIX}
    assert_read(saved(tmp_path, "log.h5", **frame))


def test_the_elements_of_an_array_of_structures_follow_each_other(tmp_path):
    """As NASA's ageing data; a field may be absent, and a date of six numbers is no column."""
    io = pytest.importorskip("scipy.io")
    cycles = np.empty((1, 3), dtype=[("type", "O"), ("time", "O"), ("data", "O")])
    for k, (first, last) in enumerate(((0, 5), (5, 12), (12, 20))):
        rows = dict(zip(NAMES, MATRIX[first:last].T, strict=True)) | ({"ohm": 0.1 + MATRIX[first:last, 1]} if k else {})
        cycles[0, k] = "charge", np.array([2008.0, 4.0, 2.0, 13.0, 8.0, 17.9]), rows
    io.savemat(tmp_path / "log.mat", {"B0005": {"cycle": cycles}})
    assert_read(tmp_path / "log.mat")
    log = read_log(tmp_path / "log.mat", current_sign="charge", where={"cycle": 2})
    np.testing.assert_array_equal(log.time_s, MATRIX[5:12, 0])
    assert list(log.extra) == ["ohm"]
