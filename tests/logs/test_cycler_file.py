"""Binary files of cyclers: what is damaged, and the frame that fastnda gives."""

import sys
import tracemalloc
import zipfile
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from logs.formats.known import LOG
from logs.formats.recorders import mpr
from ohmward.errors import InputError, OhmwardError
from ohmward.logs import read_log


def test_a_damaged_file_of_ec_lab_is_refused_with_the_way_out(tmp_path):
    pytest.importorskip("galvani")
    path = mpr(tmp_path)
    path.write_bytes(path.read_bytes()[:700])
    with pytest.raises(
        InputError, match=r"log.mpr: no .mpr file that galvani reads [^;]*; export it in EC-Lab as text"
    ):
        read_log(path)


def test_a_length_that_no_file_has_takes_no_memory(tmp_path):
    pytest.importorskip("galvani")
    content = mpr(tmp_path).read_bytes()
    at = content.index(b"MODULEVMP data") + len(b"MODULE") + 35
    damaged = tmp_path / "long.mpr"
    damaged.write_bytes(content[:at] + (1 << 30).to_bytes(4, "little") + content[at + 4 :])
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match="export it in EC-Lab as text"):
            read_log(damaged)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 64 << 20


def neware(folder: Path, name: str) -> Path:
    path = folder / name
    if name.endswith(".ndax"):
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("data.ndc", bytes(64))
    else:
        path.write_bytes(b"NEWARE" + bytes(64))
    return path


@pytest.mark.parametrize("name", ["test.nda", "test.ndax"])
def test_a_file_of_neware_by_the_frame_of_its_reader(tmp_path, monkeypatch, name):
    """Steps that count their own time beside the whole, and mA, as fastnda calls its columns."""
    pandas = pytest.importorskip("pandas")
    columns = {
        "index": 1 + np.arange(LOG.time_s.size),
        "voltage_V": LOG.voltage_V,
        "current_mA": 1000.0 * LOG.current_A,
        "unix_time_s": LOG.start.timestamp() + LOG.time_s,
        "step_time_s": LOG.time_s % 25,
        "total_time_s": LOG.time_s,
        "step_type": np.where(LOG.current_A > 0, "CC_Chg", np.where(LOG.current_A < 0, "CC_DChg", "Rest")),
    }
    read = SimpleNamespace(read=lambda path: pandas.DataFrame(columns))
    monkeypatch.setitem(sys.modules, "fastnda", read)
    log = read_log(neware(tmp_path, name))
    np.testing.assert_allclose(log.current_A, LOG.current_A, atol=1e-9)
    np.testing.assert_array_equal(log.time_s, LOG.time_s)


@pytest.mark.parametrize("name", ["test.nda", "test.ndax"])
def test_a_damaged_file_of_neware_is_refused_with_the_way_out(tmp_path, name):
    pytest.importorskip("fastnda")
    with pytest.raises(InputError, match=f"{name}: no file that fastnda reads .*; export it in BTSDA as Excel or CSV"):
        read_log(neware(tmp_path, name))


@pytest.mark.parametrize(("package", "make"), [("galvani", mpr), ("fastnda", lambda folder: neware(folder, "a.nda"))])
def test_the_package_that_reads_it_is_named(tmp_path, monkeypatch, package, make):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(OhmwardError, match=f"pip install {package}"):
        read_log(make(tmp_path))
