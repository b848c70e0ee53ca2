"""Binary files of cyclers: one of EC-Lab laid out as galvani reads it, and the frame that fastnda gives."""

import struct
import sys
import zipfile
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from logs.formats.known import LOG
from ohmward.errors import InputError, OhmwardError
from ohmward.logs import read_log

MAGIC = b"BIO-LOGIC MODULAR FILE\x1a".ljust(48) + b"\x00\x00\x00\x00"
#: Numbers of EC-Lab's columns: time/s, control/V/mA (8), Ewe/V (6), I/mA (76).
COLUMNS = (4, 6, 76)


def module(short: bytes, content: bytes, version: int) -> bytes:
    head = b"MODULE" + short.ljust(10) + short.ljust(25)
    return head + struct.pack("<II", len(content), version) + b"01/02/26" + content


def mpr(folder: Path) -> Path:
    rows = np.zeros(LOG.time_s.size, [("time", "<f8"), ("Ewe", "<f4"), ("I", "<f4")])
    rows["time"], rows["Ewe"], rows["I"] = LOG.time_s, LOG.voltage_V, 1000.0 * LOG.current_A
    head = struct.pack("<IB", rows.size, len(COLUMNS)) + np.array(COLUMNS, "<u2").tobytes()
    data = head.ljust(405, b"\0") + rows.tobytes()
    content = MAGIC + module(b"VMP Set", bytes(8), 0) + module(b"VMP data", data, 2)
    (folder / "test.mpr").write_bytes(content)
    return folder / "test.mpr"


def test_a_file_of_ec_lab(tmp_path):
    pytest.importorskip("galvani")
    log = read_log(mpr(tmp_path))
    np.testing.assert_array_equal(log.time_s, LOG.time_s)
    np.testing.assert_allclose(log.voltage_V, LOG.voltage_V, rtol=1e-6)
    np.testing.assert_allclose(log.current_A, LOG.current_A, rtol=1e-6, atol=1e-9)


def test_a_damaged_file_of_ec_lab_is_refused_with_the_way_out(tmp_path):
    pytest.importorskip("galvani")
    path = mpr(tmp_path)
    path.write_bytes(path.read_bytes()[:700])
    with pytest.raises(
        InputError, match=r"test.mpr: no .mpr file that galvani reads [^;]*; export it in EC-Lab as text"
    ):
        read_log(path)


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
