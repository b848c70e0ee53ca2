"""Logs of vehicles: ULog of PX4; DataFlash (.bin, .log) and telemetry (.tlog) of ArduPilot."""

from __future__ import annotations

import contextlib
import io
import re
from array import array
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.hints import FileHints
from ohmward.logs.table import BATTERY, DRIVE, KnownType, Note, Opener, Stream, Streams, TableFile, parsing
from ohmward.optional import require, silenced

#: Topics of PX4 that are found without being named, by the names of their messages.
_PX4 = {
    "battery_status": KnownType(
        BATTERY,
        {"voltage_v": "voltage [V]", "current_a": "current [A]", "temperature": "temperature [degC]"}
        | {"remaining": "remaining"}
        | {f"voltage_cell_v[{k}]": f"cell_voltage[{k}]" for k in range(14)},
    ),
    "wheel_encoders": KnownType(DRIVE, {f"wheel_speed[{k}]": f"wheel_speed_{k} [rad/s]" for k in range(4)}),
}


class _UlogStream(io.BufferedReader):
    """A file whose relative seeks go from where a read that the end cut short should have ended.

    pyulog goes back by the length of a message that it has read, and would never get past one that is cut off.
    """

    _lacking = 0

    def read(self, size: int | None = -1, /) -> bytes:
        data = super().read(size)
        self._lacking = max((size or 0) - len(data), 0)
        return data

    def seek(self, target: int, whence: int = io.SEEK_SET, /) -> int:
        if whence == io.SEEK_CUR:
            target += self._lacking
        self._lacking = 0
        return super().seek(target, whence)


def open_ulog(path: Path, hints: FileHints) -> TableFile:
    """The columns of a ULog file; of a truncated one those before the cut."""
    pyulog = require("pyulog", "a ULog file")
    # our own stream: pyulog leaves its stream open on errors
    with (
        parsing(path, "no readable ULog file", "download it from the vehicle again"),
        silenced(),  # it prints what it cannot read
        _UlogStream(io.FileIO(path)) as stream,
    ):
        log = pyulog.ULog(stream, disable_str_exceptions=True)
    streams = {}
    timed = [data for data in log.data_list if "timestamp" in data.data]
    for data in timed:
        name = f"{data.name}[{data.multi_id}]" if data.multi_id else data.name
        values = {key: _measured(key, v) for key, v in data.data.items() if key != "timestamp"}
        columns = _named(_PX4, name, data.name, values)
        streams[name] = Stream(data.name, 1e-6 * np.asarray(data.data["timestamp"], float), columns)
    damaged = (Note("the file is damaged: what could not be read was left out", "warning"),)
    sign = "discharge" if any(stream.type == "battery_status" for stream in streams.values()) else None
    notes = damaged if log.file_corruption or len(timed) < len(log.data_list) else ()
    return Streams(path.name, streams, "topics of PX4", _PX4, sign, notes, hints).open()


#: Fields in which PX4 writes -1 where nothing is measured.
_PX4_UNMEASURED = ("current_a", "remaining")


def _measured(field: str, values: np.ndarray) -> np.ndarray:
    """The values (n,) of a field of PX4, NaN where nothing was measured."""
    return np.where(values == -1, np.nan, values) if field in _PX4_UNMEASURED else values


#: Messages have room for more cells and wheels than there are: the others stay 0.
_ABSENT = re.compile(r"cell_voltage|wheel_\w+_[23] ")

_DATAFLASH_TEXT = b"FMT, 128,"
#: First byte of packets of MAVLink 1 and 2 after a stamp of eight bytes, and stamps [us] of 2001 to 2100.
_PACKETS, _STAMPS = (0xFE, 0xFD), (10**15, 4 * 10**15)
_YEAR_2001_S = 1e9
#: Numbers of MAVLink that mean a missing value.
_NO_CELL_MV, _NO_CURRENT, _NO_DEGC = 65535, -1, 32767

#: Messages that are found without being named; a positive current discharges, and z points down.
_ARDUPILOT = {
    "BAT": KnownType(
        BATTERY,
        {"Volt": "voltage [V]", "Curr": "current [A]", "Temp": "temperature [degC]", "RemPct": "remaining [%]"},
    ),
    "BATTERY_STATUS": KnownType(
        BATTERY, {name: name for name in ("voltage [V]", "current [A]", "temperature [degC]", "remaining [%]")}
    ),
    "WENC": KnownType(DRIVE, {"Dist0": "wheel_distance_0 [m]", "Dist1": "wheel_distance_1 [m]"}),
    "IMU": KnownType(DRIVE, {"-GyrZ": "angular velocity z [rad/s]", "AccX": "linear acceleration x [m/s2]"}),
    "GPS": KnownType(DRIVE, {"Spd": "speed [m/s]"}),
    "WHEEL_DISTANCE": KnownType(DRIVE, {f"distance[{k}]": f"wheel_distance_{k} [m]" for k in range(4)}),
}


class _LoggedMessage(NamedTuple):
    """A message of a log: its type and instance, time and numbers."""

    type: str
    instance: int
    time_s: float
    values: Mapping[str, Any]


def is_telemetry(head: bytes) -> bool:
    """True for a stamp followed by a packet of MAVLink."""
    stamp = int.from_bytes(head[:8], "big")
    return len(head) > 8 and head[8] in _PACKETS and _STAMPS[0] < stamp < _STAMPS[1]


def open_dataflash(path: Path, hints: FileHints) -> TableFile:
    """The columns of a DataFlash log, binary (.bin) or text (.log)."""
    reader = require("pymavlink.DFReader", "a DataFlash log")
    with path.open("rb") as stream:
        is_text = stream.read(len(_DATAFLASH_TEXT)) == _DATAFLASH_TEXT
    open_reader = reader.DFReader_text if is_text else reader.DFReader_binary
    return _open(path, hints, lambda: _of_dataflash(open_reader, path))


def open_telemetry(path: Path, hints: FileHints) -> TableFile:
    """The columns of a telemetry log of MAVLink."""
    mavutil = require("pymavlink.mavutil", "a telemetry log")
    return _open(path, hints, lambda: _of_telemetry(mavutil.mavlogfile(str(path))))


def _open(path: Path, hints: FileHints, messages: Callable[[], Iterator[_LoggedMessage]]) -> TableFile:
    """The columns of the messages of a log, a stream for each type and instance."""
    times: dict[tuple[str, int], array] = defaultdict(lambda: array("d"))
    columns: dict[tuple[str, int], dict[str, array]] = defaultdict(dict)
    try:
        with silenced():
            for message in messages():
                key = message.type, message.instance
                for name, value in message.values.items():
                    if isinstance(value, int | float):
                        columns[key].setdefault(name, array("d", [np.nan] * len(times[key]))).append(value)
                times[key].append(message.time_s)
    except Exception as error:  # its parser raises many kinds
        if not times:
            raise InputError(f"{path.name}: no readable log of ArduPilot ({error}); download it again") from error
    if not times:
        raise InputError(f"{path.name}: the log holds no message; download it again")
    streams = {}
    for (type_, instance), of_type in columns.items():
        instances = [key[1] for key in columns if key[0] == type_]
        name = f"{type_}[{instance}]" if len(instances) > 1 else type_
        # of several sensors of a drive the first one is used; only the user knows which battery is meant
        is_first = instance == min(instances) or (type_ in _ARDUPILOT and _ARDUPILOT[type_].part == BATTERY)
        time_s = np.array(times[type_, instance])
        whole = {field: np.array(values) for field, values in of_type.items() if len(values) == time_s.size}
        streams[name] = Stream(type_ if is_first else name, time_s, _named(_ARDUPILOT, name, type_, whole))
    return Streams(path.name, streams, "messages of ArduPilot", _ARDUPILOT, "discharge", (), hints).open()


def _named(
    known: Mapping[str, KnownType], stream: str, type_: str, arrays: Mapping[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """The columns of a stream: of a known type by quantity, negated if marked by a minus; of others as named."""
    if type_ not in known:
        return {f"{stream}/{name}": values for name, values in arrays.items()}
    found = {}
    for field, column in known[type_].columns.items():
        if (name := field.removeprefix("-")) in arrays:
            found[column] = -arrays[name] if field.startswith("-") else arrays[name]
    return {column: values for column, values in found.items() if not (_ABSENT.match(column) and not np.any(values))}


def _of_dataflash(reader: Any, path: Path) -> Iterator[_LoggedMessage]:
    log = reader.__new__(reader)  # kept in case its constructor fails, which would leave the file open
    try:
        log.__init__(str(path))
        while (message := log.recv_msg()) is not None:
            values = message.to_dict()
            if (time_us := values.pop("TimeUS", None)) is not None:
                type_ = message.get_type()
                fields = (message.fmt.instance_field, "Instance", "Inst", "I" if type_ in _ARDUPILOT else None)
                instance = next((int(values[field]) for field in fields if field in values), 0)
                is_dated = message._timestamp > _YEAR_2001_S
                yield _LoggedMessage(type_, instance, message._timestamp if is_dated else 1e-6 * time_us, values)
    finally:
        for name in vars(log).keys() & {"data_map", "filehandle"}:
            getattr(log, name).close()


def _of_telemetry(log: Any) -> Iterator[_LoggedMessage]:
    """The messages of all vehicles.

    Of a vehicle that is not the first to send a type the instances count from 1000 times the number of its system.
    """
    first: dict[str, int] = {}
    with contextlib.closing(log):
        while (message := log.recv_msg()) is not None:
            type_ = message.get_type()
            if type_ == "BAD_DATA":
                continue
            values = {name: value for name, value in message.to_dict().items() if name != "mavpackettype"}
            lists = {name: value for name, value in values.items() if isinstance(value, list)}
            values |= {f"{name}[{k}]": item for name, items in lists.items() for k, item in enumerate(items)}
            if type_ == "BATTERY_STATUS":
                values = _battery_status(message)
            system = message.get_srcSystem()
            of_other = 0 if first.setdefault(type_, system) == system else 1000 * system
            yield _LoggedMessage(type_, of_other + int(getattr(message, "id", 0)), message._timestamp, values)


def _battery_status(message: Any) -> dict[str, float]:
    """The numbers of BATTERY_STATUS, NaN where it has the mark of a missing one."""
    cells_mV = [mV for mV in (*message.voltages, *getattr(message, "voltages_ext", ())) if 0 < mV < _NO_CELL_MV]
    current, degC = message.current_battery, message.temperature
    return {
        "voltage [V]": 1e-3 * sum(cells_mV) if cells_mV else np.nan,
        "current [A]": np.nan if current == _NO_CURRENT else 1e-2 * current,
        "temperature [degC]": np.nan if degC == _NO_DEGC else 1e-2 * degC,
        "remaining [%]": np.nan if message.battery_remaining < 0 else float(message.battery_remaining),
    }


#: Opener of each format that is recognised by its first bytes.
OPENERS: dict[bytes, Opener] = {
    b"ULog\x01\x12\x35": open_ulog,
    b"\xa3\x95\x80": open_dataflash,
    _DATAFLASH_TEXT: open_dataflash,
}
