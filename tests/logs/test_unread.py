"""Files that are known and not read: each is named, with the way out."""

import gzip
import io
import zipfile

import pytest

from ohmward.errors import InputError
from ohmward.logs import read_log


def _zip(*names: str) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as packed:
        for name in names:
            packed.writestr(name, "time_s,current_A,voltage_V\n0,1,3.7\n")
    return buffer.getvalue()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"\x00\x01\x00\x00Standard Jet DB\x00" + bytes(90), r"an Access database, as .res of Arbin.*res2sqlite"),
        (b"\x00\x01\x00\x00Standard ACE DB\x00" + bytes(90), r"an Access database"),
        (b"H Product:Blackbox flight data recorder by Nicholas Sherlock\nH Data version:2\n", "blackbox_decode"),
        (b"TDSm\x0e\x00\x00\x00" + bytes(90), "TDMS file of LabVIEW.*npTDMS"),
        (b"***BUSMASTER Ver 3.2.2***\n***PROTOCOL CAN***\n", "BUSMASTER; open it in SavvyCAN"),
        (b"1320745424.000 CXX OVMS Car log\n1320745424.002 R11 402 FA 01\n", "CRTD.*SavvyCAN"),
        (b"date Mon Nov 30 10:00:00 am 2026\nbase hex  timestamps relative\n", "export it again with absolute ones"),
        (b'VERSION ""\n\nNS_ :\n', "a database of a CAN bus; give the recording, and this file with --dbc"),
        (b"1700000000.002 1R29 18FF5000 FA 01\n", "CRTD.*SavvyCAN"),
        (b"  can0  123   [8]  00 11 22 33 44 55 66 77\n", "candump -l can0"),
        (b" (1700000000.000001)  vcan0  123   [2]  00 11\n", "candump -l can0"),
        (b"Time,CAN ID,DLC,Data\n0.1,0x356,2,0A 1B\n", "CAN bus in a table of its own; open it in SavvyCAN"),
        (b"\x80\x04\x95" + bytes(90), "pickle of Python"),
        (b"log.csv".ljust(257, b"\0") + b"ustar" + bytes(250), "an archive of tar; unpack it"),
        (gzip.compress(b"log.csv".ljust(257, b"\0") + b"ustar" + bytes(250)), "an archive of tar; unpack it"),
        (_zip("a.csv", "b.csv"), r"an archive of 2 logs \('a.csv', 'b.csv'\); unpack it"),
        (b"%PDF-1.7\n" + bytes(90), "PDF document"),
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n", "`git lfs pull`"),
        (b'<?xml version="1.0"?>\n<!-- a mower -->\n<robot name="m">', "a URDF; .*ohmward robot FILE"),
        (b"\n<TABLE border=1><tr><th>Time</th></tr>", "a page of HTML, .*save it as .xlsx or CSV"),
        (b'<?xml version="1.0"?>\n<log><s t="0"/></log>', "XML; export the log as CSV"),
        (b"7z\xbc\xaf\x27\x1c" + bytes(90), "packed file; unpack it"),
        (b"\x28\xb5\x2f\xfd" + bytes(90), "packed file; unpack it"),
        (bytes(range(256)), "no format that ohmward knows"),
    ],
    ids=lambda given: given if isinstance(given, str) else "file",  # a packed file has the time in it
)
def test_a_file_that_is_known_is_named_with_the_way_out(content, message, tmp_path):
    path = tmp_path / "log.dat"
    path.write_bytes(content)
    with pytest.raises(InputError, match=message) as refused:
        read_log(path)
    assert "utf-16" not in str(refused.value)
