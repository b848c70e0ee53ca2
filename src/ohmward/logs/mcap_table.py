"""Tables as MCAP files for Foxglove, PlotJuggler and Rerun: a message for each row, a field for each column."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ohmward.logs.bags.bag_table import TABLE_TYPE
from ohmward.logs.table import Progress
from ohmward.optional import require

TOPIC = "/ohmward"

#: What a file that loses its end may lose, and what a viewer reads at once [bytes].
_CHUNK_BYTES = 1 << 18
_BLOCK_ROWS = 65536
_HEADER = """\
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
#: Plain CDR, little-endian: the stamp, an empty frame, and zeros up to the first number of eight bytes.
_BEFORE = [("encoding", "<u4"), ("sec", "<i4"), ("nanosec", "<u4"), ("frame_length", "<u4"), ("frame", "<u4")]
_LITTLE_ENDIAN_CDR, _LENGTH_OF_EMPTY = 0x00000100, 1


def write_mcap(path: Path, columns: Mapping[str, np.ndarray], progress: Progress | None = None) -> None:
    """Write the numeric columns (T,) as messages of ROS 2; columns of text are left out.

    The time is that of `unix_time_s`, without it that of `time_s`, without both the number of the row.

    Raises:
        OhmwardError: the package mcap is not installed.
    """
    writing = require("mcap.writer", "MCAP")
    numeric = {name: np.asarray(values) for name, values in columns.items() if np.asarray(values).dtype.kind in "biuf"}
    rows = len(next(iter(numeric.values()), ()))
    time_ns = _times_ns(numeric, rows)
    fields = _field_names(list(numeric))
    definition = "".join(["std_msgs/Header header\n", *(f"float64 {name}\n" for name in fields), _HEADER])
    with path.open("wb") as stream:
        writer = writing.Writer(stream, chunk_size=_CHUNK_BYTES)
        writer.start("ros2", "ohmward")
        schema = writer.register_schema(TABLE_TYPE, "ros2msg", definition.encode())
        channel = writer.register_channel(TOPIC, "cdr", schema)
        for first in range(0, rows, _BLOCK_ROWS):
            block = slice(first, first + _BLOCK_ROWS)
            messages = _messages(time_ns[block], [values[block] for values in numeric.values()])
            for at_ns, message in zip(time_ns[block].tolist(), messages, strict=True):
                writer.add_message(channel, at_ns, message, at_ns)
            if progress:
                progress(min(block.stop, rows), rows)
        writer.finish()


def _times_ns(columns: Mapping[str, np.ndarray], rows: int) -> np.ndarray:
    """(T,) int64 [ns], not before 1970, which MCAP cannot say."""
    name = next((name for name in ("unix_time_s", "time_s") if name in columns), None)
    time_s = np.arange(rows, dtype=float) if name is None else columns[name].astype(float)
    seconds = np.floor(time_s)
    return np.maximum(seconds.astype(np.int64) * 10**9 + np.rint((time_s - seconds) * 1e9).astype(np.int64), 0)


def _field_names(names: list[str]) -> list[str]:
    """Names that a message may have, each once: letters, digits and single underscores, a letter first."""
    fields: list[str] = []
    for name in names:
        plain = re.sub(r"[^0-9A-Za-z]+", "_", name).strip("_") or "column"
        plain = plain if plain[0].isalpha() else f"column_{plain}"
        same = sum(field == plain or field.startswith(f"{plain}_again") for field in fields)
        fields.append(f"{plain}_again{same}" if same else plain)
    return fields


def _messages(time_ns: np.ndarray, columns: list[np.ndarray]) -> list[bytes]:
    """A message of each row."""
    table = np.zeros(time_ns.size, dtype=[*_BEFORE, *((f"f{k}", "<f8") for k in range(len(columns)))])
    table["encoding"], table["frame_length"] = _LITTLE_ENDIAN_CDR, _LENGTH_OF_EMPTY
    table["sec"], table["nanosec"] = np.divmod(time_ns, 10**9)
    for k, values in enumerate(columns):
        table[f"f{k}"] = values
    whole, size = table.tobytes(), table.dtype.itemsize
    return [whole[at : at + size] for at in range(0, len(whole), size)]
