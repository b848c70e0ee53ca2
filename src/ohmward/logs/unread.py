"""Files that are known by their first bytes and not read, each with the program that makes a log of it."""

from __future__ import annotations

import re
from pathlib import Path

from ohmward.errors import InputError

_UNPACK = "a packed file; unpack it first"
_TO_SAVVYCAN = "; open it in SavvyCAN, save it as CSV of SavvyCAN (GVRET), and give that with --dbc"

#: First bytes, what they are of, and the way out.
_KNOWN = tuple(
    (re.compile(beginning, re.DOTALL), about)
    for beginning, about in (
        (
            rb"\x00\x01\x00\x00Standard (?:Jet|ACE) DB",
            "an Access database, as .res of Arbin; make one of SQLite: apt install mdbtools; pip install galvani; "
            "res2sqlite TEST.res TEST.db, and give TEST.db",
        ),
        (
            rb"H Product:Blackbox",
            "a blackbox of Betaflight or INAV; decode it with blackbox_decode (github.com/betaflight/blackbox-tools) "
            "and give the CSV file",
        ),
        (
            rb"TDS[mh]",
            "a TDMS file of LabVIEW; give TdmsFile.read('LOG.tdms').as_dataframe() of the package npTDMS as the log, "
            "or save it as CSV in Excel or DIAdem",
        ),
        (rb"\*\*\*BUSMASTER", f"frames of a CAN bus of BUSMASTER{_TO_SAVVYCAN}"),
        (rb"\d{9,}\.\d+ (?:CXX|C[EV]\w|\d?[RT](?:11|29)) ", f"frames of a CAN bus of OVMS (CRTD){_TO_SAVVYCAN}"),
        (
            rb"\s*(?:\(\d+\.\d+\))?\s*\w*can\d+\s+[0-9A-Fa-f]{3,8}\s+\[\d+\]",
            "frames of a CAN bus as candump shows them; record them with `candump -l can0`, and give that with --dbc",
        ),
        (rb"\x80[\x02-\x05]", "a pickle of Python; load it where it was written, and give the DataFrame or a CSV file"),
        (rb"%PDF-", "a PDF document; export the numbers as CSV"),
        (rb"7z\xbc\xaf|Rar!|\xfd7zXZ|BZh\d|\x28\xb5\x2f\xfd", _UNPACK),
    )
)


def require_readable(path: Path, head: bytes) -> None:
    """Refuse a file that begins like one which is known and not read.

    Raises:
        InputError: says what it is, and what makes a log of it.
    """
    if about := next((about for beginning, about in _KNOWN if beginning.match(head)), None):
        raise InputError(f"{path.name}: {about}")
