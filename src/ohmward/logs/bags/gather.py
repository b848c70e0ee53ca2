"""Messages of a topic as columns, thousands at a time."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator

import numpy as np

from ohmward.logs.bags.definitions import definitions_of
from ohmward.logs.bags.known import column_names
from ohmward.logs.bags.layout import Layout, layout_of
from ohmward.logs.bags.recording import Topic

#: Messages that are taken apart at a time.
MESSAGES_AT_ONCE = 8192
#: Stamps that differ from the times of receipt by more are of a clock that was never set, or of a simulation [s].
_STAMP_WITHIN_S = 86400.0

_SECONDS, _NANOSECONDS = (
    ("header.stamp.sec", "stamp.sec", "header.stamp.secs"),
    ("header.stamp.nanosec", "stamp.nanosec", "header.stamp.nsecs"),
)


class Gatherer:
    """Columns of one topic, from its messages in order.

    Attributes:
        broken: number of messages that could not be read.
    """

    def __init__(self, topic: Topic, names: Collection[str]):
        self.topic, self.names = topic, names
        self.definitions = definitions_of(topic)
        self.broken = 0
        self._received: list[int] = []
        self._payloads: list[bytes] = []
        self._blocks: list[tuple[np.ndarray, dict[str, np.ndarray]]] = []

    def put(self, received_ns: int, payload: bytes) -> None:
        """Take in a message."""
        self._received.append(received_ns)
        self._payloads.append(payload)
        if len(self._payloads) == MESSAGES_AT_ONCE:
            self._take_apart()

    def columns(self) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Times (n,) [ns] of the messages and their columns (n,), nan where a message lacks one.

        The time is that of the stamp where the messages have one of this clock, else that of the receipt.
        """
        if self._payloads:
            self._take_apart()
        names = dict.fromkeys(name for _, columns in self._blocks for name in columns)
        lacking = dict.fromkeys(names, np.nan)
        whole = {
            name: np.concatenate([columns.get(name, np.full(t.size, lacking[name])) for t, columns in self._blocks])
            for name in names
        }
        times = [t for t, _ in self._blocks]
        return np.concatenate(times) if times else np.empty(0, np.int64), whole

    def _take_apart(self) -> None:
        received = np.array(self._received, dtype=np.int64)
        sizes = np.fromiter(map(len, self._payloads), np.int64, len(self._payloads))
        columns: dict[str, np.ndarray] = {}
        stamp_ns = np.zeros(received.size, dtype=np.int64)
        whole = np.zeros(received.size, dtype=bool)
        for size in np.unique(sizes):
            rows = np.flatnonzero(sizes == size)
            bytes_ = np.frombuffer(b"".join([self._payloads[k] for k in rows]), np.uint8).reshape(rows.size, size)
            for layout, alike in self._layouts(bytes_):
                at = rows[alike]
                whole[at] = True
                stamp_ns[at] = _stamps(layout, bytes_[alike])
                for name, path in column_names(self.topic, layout).items():
                    if name in self.names:
                        values = columns.setdefault(name, np.full(received.size, math.nan))
                        values[at] = _numbers(layout, path, bytes_[alike])
        time_ns = np.where(_of_this_clock(stamp_ns, received), stamp_ns, received)
        self.broken += int((~whole).sum())
        self._blocks.append((time_ns[whole], {name: values[whole] for name, values in columns.items()}))
        self._received, self._payloads = [], []

    def _layouts(self, bytes_: np.ndarray) -> Iterator[tuple[Layout, np.ndarray]]:
        """The layouts of messages (n, size) of one size, and the rows that have each."""
        left = np.arange(len(bytes_))
        while left.size:
            try:
                layout = layout_of(bytes_[left[0]].tobytes(), self.topic.type, self.definitions, self.topic.encoding)
            except ValueError:
                left = left[1:]
                continue
            alike = (bytes_[np.ix_(left, layout.marks)] == bytes_[left[0], layout.marks]).all(axis=1)
            yield layout, left[alike]
            left = left[~alike]


def _numbers(layout: Layout, path: str, bytes_: np.ndarray) -> np.ndarray:
    """(n,) a number of each message."""
    number = layout.numbers[path]
    dtype = np.dtype(number.dtype)
    return np.ascontiguousarray(bytes_[:, number.at : number.at + dtype.itemsize]).view(dtype)[:, 0].astype(float)


def _stamps(layout: Layout, bytes_: np.ndarray) -> np.ndarray:
    """(n,) [ns] time of each message by its own stamp; 0 where it has none."""
    seconds = next((name for name in _SECONDS if name in layout.numbers), None)
    nanoseconds = next((name for name in _NANOSECONDS if name in layout.numbers), None)
    if seconds is None or nanoseconds is None:
        return np.zeros(len(bytes_), dtype=np.int64)
    return _numbers(layout, seconds, bytes_).astype(np.int64) * 1_000_000_000 + _numbers(
        layout, nanoseconds, bytes_
    ).astype(np.int64)


def _of_this_clock(stamp_ns: np.ndarray, received_ns: np.ndarray) -> np.ndarray:
    """(n,) bool, True where the stamp is of the recorder's clock."""
    return np.abs(stamp_ns - received_ns) < _STAMP_WITHIN_S * 1e9
