"""Recordings of a CAN bus (candump, ASC, BLF, TRC, CSV, MDF), decoded to signals with the database of the bus."""

from __future__ import annotations

import csv
import re
import traceback
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.csv_layout import open_text
from ohmward.logs.hints import HEAD_BYTES, FileHints
from ohmward.logs.table import Note, Opener, Stream, Streams, TableFile, counted, parsing
from ohmward.logs.units import unit_of
from ohmward.optional import require, silenced

T = TypeVar("T")

#: Beginnings of texts, and the reader of python-can for each; "" for tables of SavvyCAN and CANedge.
_CANDUMP = "CanutilsLogReader"
_TEXTS = (
    (re.compile(rb"\(\d+\.\d+\) +\S+ +[0-9A-Fa-f]{3,8}#"), _CANDUMP),
    (re.compile(rb"date [^\n]*\n(?:[^\n]*\n)?base +(?:hex|dec)", re.IGNORECASE), "ASCReader"),
    (re.compile(rb";\$FILEVERSION=|;#{10,}"), "TRCReader"),
    (re.compile(rb"timestamp,arbitration_id,extended,"), "CSVReader"),
    (re.compile(rb"\"?Time Stamp\"?,\"?ID\"?,\"?Extended\"?,|TimestampEpoch;BusChannel;ID;"), ""),
)
#: The reader of python-can for the one binary format.
_BLF, _BLF_MAGIC = "BLFReader", b"LOGG"
_FRAME_BYTES = 8
#: A group of MDF unpacks to this many bytes, or to this many times the file's size, at most.
_GROUP_BYTES, _GROUP_TIMES = 16 << 20, 1000


def can_reader(head: bytes) -> str | None:
    """The reader of python-can for a text with this beginning, "" for a table, None for anything but CAN."""
    return next((reader for beginning, reader in _TEXTS if beginning.match(head.lstrip(b"\xef\xbb\xbf"))), None)


def open_can(path: Path, hints: FileHints, reader: str) -> TableFile:
    """The signals of the frames in a recording of a CAN bus; refused without a database that knows some of them.

    reader: from `can_reader`, or `_BLF`.
    """
    if hints.dbc is None:
        raise _without_database(path)
    database = load_can_database(hints.dbc)
    notes: list[Note] = []
    received = _of_python_can(path, reader, notes) if reader else _of_table(path, hints.encoding, notes)
    return _open_frames(path.name, received, hints, database, notes)


def open_mdf(path: Path, hints: FileHints) -> TableFile:
    """The signals in a file of ASAM MDF, or in the CAN frames that it holds; refused as in `open_can`."""
    asammdf = require("asammdf", "an MDF file")
    with (
        parsing(path, "no readable MDF file", "export it again, as MDF 4 or CSV"),
        silenced(),
        _closing_what_is_half_read(),
    ):
        with asammdf.MDF(str(path), process_bus_logging=False) as file:  # reads no samples yet
            _require_sound(path, file)
            is_4 = str(file.version).startswith("4")
            of_bus = is_4 and any(group.channel_group.flags & _BUS_EVENT for group in file.groups)
            streams = {} if of_bus else _groups(file)
        if of_bus and hints.dbc is None:
            raise _without_database(path)
        if of_bus:
            with asammdf.MDF(str(path)) as file, file.extract_bus_logging({"CAN": [(hints.dbc, 0)]}) as signals:
                streams = _groups(signals)
    if not streams:
        raise InputError(f"{path.name}: no signal has samples{f' by {hints.dbc}' if of_bus else ''}; check the file")
    return Streams(path.name, streams, "groups of MDF", hints=hints).open()


@contextmanager
def _closing_what_is_half_read() -> Iterator[None]:
    """Close a file that asammdf fails to read: its own `close` needs an attribute that is missing then.

    The garbage collector would close it at any later time, with an error on the screen and its copy left on the disk.
    """
    try:
        yield
    except Exception as error:
        for frame, _ in traceback.walk_tb(error.__traceback__):
            file: Any = frame.f_locals.get("self")
            if hasattr(file, "_delete_on_close") and not hasattr(file, "_file"):
                file._file = None
                with suppress(AttributeError):  # parts that were not read yet
                    file.close()
        raise


#: Flag of a group of channels that holds events of a bus.
_BUS_EVENT = 0x2


def _require_sound(path: Path, file: Any) -> None:
    """Refuse a file whose groups claim to hold far more than it can, or whose channels are outside their records.

    Groups are counted as records, and as a number of eight bytes of each channel.
    """
    sizes = [
        group.channel_group.cycles_nr * max(_record_bytes(group), 8 * len(group.channels)) for group in file.groups
    ]
    largest = max(sizes, default=0)
    if largest > max(_GROUP_TIMES * path.stat().st_size, _GROUP_BYTES):
        raise InputError(f"{path.name}: the MDF file is damaged: a group says that it holds {largest:.1e} bytes")
    for group in file.groups:
        for channel in group.channels:
            if _end_in_record(channel) > _record_bytes(group):  # asammdf would read any memory, and crash
                raise InputError(f"{path.name}: the MDF file is damaged: {channel.name!r} is outside its record")


def _record_bytes(group: Any) -> int:
    """Size of a record of a group in a file of MDF 3 or 4."""
    of_record: int = group.channel_group.samples_byte_nr + getattr(group.channel_group, "invalidation_bytes_nr", 0)
    return of_record


def _end_in_record(channel: Any) -> int:
    """Number of the first byte of a record after a channel; 0 for a channel without bytes."""
    if not channel.bit_count:
        return 0
    if hasattr(channel, "start_offset"):  # MDF 3
        first, bit = channel.additional_byte_offset, channel.start_offset
    else:
        first, bit = channel.byte_offset, channel.bit_offset
    end: int = first + (bit + channel.bit_count + 7) // 8
    return end


def _groups(file: Any) -> dict[str, Stream]:
    """The groups of channels as streams, by number; the columns are named after the channels."""
    start_s = file.header.start_time.timestamp()
    seen: set[str] = set()
    streams = {}
    for number, group in enumerate(file.groups):
        without_clock = [(None, number, k) for k in range(len(group.channels)) if k != file.masters_db.get(number)]
        columns, time_s = {}, np.empty(0)
        for signal in file.select(without_clock) if without_clock else []:
            if signal.samples.ndim != 1 or signal.samples.dtype.kind not in "iufb" or not signal.timestamps.size:
                continue
            name = signal.name if signal.name not in seen else f"{signal.name} of group {number}"
            name = f"{name} [{signal.unit}]" if signal.unit and unit_of(signal.unit) else name
            seen.add(signal.name)
            columns[name], time_s = signal.samples.astype(float), signal.timestamps
        if columns:
            streams[f"group {number}"] = Stream("group", start_s + time_s, columns)
    return streams


def load_can_database(path: str) -> Any:
    """The database of a bus: DBC, KCD, SYM or ARXML; InputError where it cannot be read."""
    cantools = require("cantools", "decoding CAN")
    try:
        with silenced():  # it prints what it does not like
            return cantools.database.load_file(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}); check the path") from error
    except Exception as error:  # the parsers raise many kinds
        reason = " ".join(str(error).split())[:200]
        raise InputError(f"{path}: is no CAN database that can be read ({reason}); give a DBC file") from error


def _open_frames(
    source: str, received: Iterable[_Received], hints: FileHints, database: Any, notes: list[Note]
) -> TableFile:
    """The signals of frames by a database, a stream for each message; refused if it knows none of the frames.

    A signal whose name occurs in several messages is called `MESSAGE.SIGNAL`. Messages of one name are told apart by
    their buses, or else by their identifiers.
    """
    times: dict[_Sender, list[float]] = defaultdict(list)
    payloads: dict[_Sender, list[bytes]] = defaultdict(list)
    for sender, time_s, payload in received:
        times[sender].append(time_s)
        payloads[sender].append(payload)
    if not payloads:
        raise InputError(f"{source}: the recording holds no frame; record it again")
    decoded: dict[str, dict[_Sender, tuple[np.ndarray, dict[str, np.ndarray]]]] = defaultdict(dict)
    unknown, broken = set(), 0
    for sender in payloads:
        try:
            message = database.get_message_by_frame_id(sender.identifier, force_extended_id=sender.is_extended)
        except KeyError:
            unknown.add(sender.identifier)
            continue
        whole, columns = _decoded(message, payloads[sender])
        broken += int(np.count_nonzero(~whole))
        if whole.any():
            decoded[message.name][sender] = np.array(times[sender])[whole], columns
    if not decoded:
        raise InputError(
            f"{source}: {hints.dbc} knows none of its frames; name the database of this bus with --dbc, or check "
            f"whether identifiers are of 11 or 29 bits ({counted(len(unknown), 'identifier')} not in it, {broken} "
            "frames not decoded)"
        )
    named = {f"{name}{mark}": found for name, of_name in decoded.items() for mark, found in _marked(of_name).items()}
    all_names = [name for _, columns in named.values() for name in columns]
    streams = {
        message: Stream(
            message,
            time_s,
            {name if all_names.count(name) == 1 else f"{message}.{name}": v for name, v in columns.items()},
        )
        for message, (time_s, columns) in named.items()
    }
    left_out = [Note(f"{counted(broken, 'frame')} could not be decoded: left out", "warning")] if broken else []
    left_out += [Note(f"{counted(len(unknown), 'identifier')} not in {hints.dbc}: left out")] if unknown else []
    what = f"messages of CAN by {hints.dbc}"
    return Streams(source, streams, what, notes=(*notes, *left_out), hints=hints).open()


def _marked(found: Mapping[_Sender, T]) -> dict[str, T]:
    """Values of the senders of one message, by their buses or identifiers where there are several."""
    buses = {sender.bus for sender in found}
    on_several = len(buses) > 1
    by_identifier = len(found) > len(buses)
    return {
        f" {sender.identifier:X}" * by_identifier + f" of {sender.bus}" * on_several: value
        for sender, value in found.items()
    }


def _decoded(message: Any, payloads: list[bytes]) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Mask (n,) of the payloads that could be decoded, and their numeric signals, by name and unit.

    Of a message that is always shorter than the database says, the signals that it has room for.
    """
    units = {signal.name: signal.unit for signal in message.signals}
    short = max(map(len, payloads)) < message.length
    known: dict[bytes, Mapping[str, Any]] = {}
    for payload in dict.fromkeys(payloads):
        with suppress(Exception):  # too short, or an unknown multiplexer
            known[payload] = message.decode(payload, decode_choices=False, allow_truncated=short)
    whole = np.array([payload in known for payload in payloads])
    good = [known[payload] for payload in payloads if payload in known]
    names = dict.fromkeys(name for row in good for name in row)
    columns = {}
    for name in names:
        values = [row.get(name) for row in good]
        unit = units.get(name)
        column = f"{name} [{unit}]" if unit and unit_of(unit) else name
        columns[column] = np.array([float(v) if isinstance(v, int | float) else np.nan for v in values])
    return whole, columns


class _Sender(NamedTuple):
    """The identifier of frames, True where it has 29 bits, and the bus on which they were, "" where that is unknown."""

    identifier: int
    is_extended: bool
    bus: str = ""


#: Sender, time [s] and payload of a frame.
_Received = tuple[_Sender, float, bytes]


def is_can(path: Path) -> bool:
    """True for a recording of a CAN bus that `received_frames` reads."""
    return _reader_of(path) is not None


def _reader_of(path: Path) -> str | None:
    with path.open("rb") as stream:
        head = stream.read(HEAD_BYTES)
    return _BLF if head.startswith(_BLF_MAGIC) else can_reader(head)


def received_frames(path: Path) -> Iterator[_Received]:
    """The frames in a recording of a CAN bus of any kind; InputError where it is none, or cannot be read."""
    reader = _reader_of(path)
    if reader is None:
        raise InputError(f"{path.name}: no readable recording of CAN; record it with candump -l")
    yield from _of_python_can(path, reader, []) if reader else _of_table(path, None, [])


def _of_python_can(path: Path, reader: str, notes: list[Note]) -> Iterator[_Received]:
    """The frames of a file, read by python-can; of a truncated file those before the cut, with a note."""
    can = require("can", "a recording of CAN")
    is_text = reader != _BLF
    is_empty = True
    try:
        # our own stream: python-can leaves its stream open on errors, and prints what it cannot read
        with silenced(), path.open("r" if is_text else "rb", errors="replace" if is_text else None) as stream:
            for message in _messages(getattr(can, reader) if is_text else _blf_reader(can), stream, notes):
                if message.is_error_frame or message.is_remote_frame:
                    continue
                bus = "" if message.channel is None else str(message.channel)
                sender = _Sender(message.arbitration_id, message.is_extended_id, bus)
                yield sender, message.timestamp, bytes(message.data)
                is_empty = False
    except Exception as error:  # its parsers raise many kinds
        if is_empty:
            raise InputError(f"{path.name}: no readable recording of CAN ({error}); record it again") from error
        notes.append(Note(f"the file is damaged or cut off ({error}): the frames before that were read", "warning"))


def _messages(reader: Any, stream: Any, notes: list[Note]) -> Iterator[Any]:
    """The messages of a stream; lines of candump, each of which stands alone, that are no frames are left out."""
    broken = 0
    while True:
        try:
            yield from reader(stream)
        except ValueError:
            if reader.__name__ != _CANDUMP:
                raise
            broken += 1
        else:
            notes += _broken_notes(broken)
            return


def _broken_notes(count: int) -> list[Note]:
    return [Note(f"{counted(count, 'row')} without a frame: left out", "warning")] if count else []


#: Beginning of an object in a BLF file, and length of its header, of which bytes 8 to 12 hold the object's length.
_OBJECT, _OBJECT_BYTES = b"LOBJ", 16
#: Furthest that the next object begins behind the one before.
_PADDING = 8


def _blf_reader(can: Any) -> Any:
    """The reader of BLF files, which would read an object without a length again and again, and never end."""

    class Reader(can.BLFReader):
        def _parse_data(self, data: bytes) -> Iterator[Any]:
            at = data.find(_OBJECT, 0, _PADDING)
            while 0 <= at <= len(data) - _OBJECT_BYTES:
                length = int.from_bytes(data[at + 8 : at + 12], "little")
                if length < _OBJECT_BYTES:
                    yield from super()._parse_data(data[:at])
                    raise ValueError(f"an object of {length} bytes")
                at = data.find(_OBJECT, at + length, at + length + _PADDING)
            yield from super()._parse_data(data)

    return Reader


def _of_table(path: Path, encoding: str | None, notes: list[Note]) -> Iterator[_Received]:
    """The frames of a table of SavvyCAN (GVRET) or CANedge (mdf2csv); rows that do not fit are left out and counted."""
    broken = 0
    with open_text(path, encoding) as stream:
        header = stream.readline()
        of_edge = ";" in header
        names = next(csv.reader([header], delimiter=";" if of_edge else ",", skipinitialspace=True))
        for row in csv.DictReader(stream, names, delimiter=";" if of_edge else ",", skipinitialspace=True):
            try:
                yield _of_canedge(row) if of_edge else _of_savvycan(row)
            except (KeyError, TypeError, ValueError, AttributeError):
                broken += 1
    notes += _broken_notes(broken)


def _of_canedge(row: Mapping[str, str]) -> _Received:
    """The frame of a row of CANedge: time [s], identifier and all bytes in hexadecimal."""
    sender = _Sender(int(row["ID"], 16), row["IDE"] == "1", row["BusChannel"])
    return sender, float(row["TimestampEpoch"]), bytes.fromhex(row["DataBytes"])


def _of_savvycan(row: Mapping[str, str]) -> _Received:
    """The frame of a row of SavvyCAN: time [us], identifier and each byte in hexadecimal."""
    count = min(int(row["LEN"]), _FRAME_BYTES)
    payload = bytes(int(row[f"D{k + 1}"], 16) for k in range(count))
    sender = _Sender(int(row["ID"], 16), row["Extended"].strip().lower() == "true", row.get("Bus") or "")
    return sender, 1e-6 * float(row["Time Stamp"]), payload


def _without_database(path: Path) -> InputError:
    """The error for frames without a database, which suggests one in the same folder."""
    beside = sorted(found for found in path.parent.glob("*") if found.suffix.lower() in (".dbc", ".kcd", ".sym"))
    name = str(beside[0]) if beside else "FILE.dbc"
    return InputError(
        f"{path.name}: frames of a CAN bus, not signals; name the database of the bus with --dbc {name} "
        f"(FileHints(dbc={name!r}))",
        ("--dbc", name) if beside else (),
    )


#: Opener of each format that is recognised by its first bytes.
OPENERS: dict[bytes, Opener] = {
    _BLF_MAGIC: partial(open_can, reader=_BLF),
    b"MDF     ": open_mdf,
    b"UnFinMF ": open_mdf,
}
