"""Recordings of several streams (topics, messages of a bus, tables), each with times of its own, as one table."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.bags.choice import TOPIC, KnownType, choose_topics
from ohmward.logs.note import Note
from ohmward.logs.table import Progress, Table, TableFile, row_numbers

#: Name of the column of the time.
TIME = "time [s]"


class Stream(NamedTuple):
    """Messages of one kind."""

    type: str  #: by which those of a battery or of a drive are found
    time_s: np.ndarray  #: (n,) since 1970, or since the start
    columns: Mapping[str, np.ndarray]  #: name -> (n,)


class Streams(NamedTuple):
    """The streams of a recording."""

    source: str  #: name of the file, for messages
    streams: Mapping[str, Stream]  #: by name
    what: str  #: of what they are, for the notes: "topics of PX4"
    known: Mapping[str, KnownType] = {}  #: types that are found without being named; {}: names of columns decide
    positive_current: str | None = None  #: as of `TableFile`
    notes: tuple[Note, ...] = ()

    def open(self, chosen: Sequence[str] | None = None) -> TableFile:
        """The columns of the chosen streams, of all without a choice."""
        chosen = list(self.streams) if chosen is None else chosen
        names = [name for stream in chosen for name in self.streams[stream].columns]
        of_chosen = {name: self.streams[name] for name in chosen}
        load = partial(_load, self._replace(streams=of_chosen))
        return TableFile(
            self.source, tuple(dict.fromkeys([TIME, *names])), load, TIME, self._part, self.positive_current
        )

    def _part(self, kind: str, where: Mapping[str, float | str]) -> TableFile:
        """The columns of a battery or of a drive, or of the streams that `where` names."""
        types = {name: stream.type for name, stream in self.streams.items()}
        if self.known or TOPIC in where:
            return self.open(choose_topics(self.source, kind, where, types, self.known))
        return self.open()


def _load(recording: Streams, wanted: Collection[str], progress: Progress | None = None) -> Table:
    """The columns of some streams, a row for each message, in order of time where there are several streams."""
    streams = recording.streams
    chosen = {name: stream for name, stream in streams.items() if set(stream.columns) & set(wanted)} or streams
    time_s = np.concatenate([stream.time_s for stream in chosen.values()] or [np.empty(0)])
    if not time_s.size:
        raise InputError(f"{recording.source}: no message of {', '.join(streams)}; a log needs samples")
    table: dict[str, np.ndarray] = {TIME: time_s}
    begin = 0
    for stream in chosen.values():
        end = begin + stream.time_s.size
        for name in stream.columns.keys() & set(wanted):
            values = stream.columns[name]
            is_text = values.dtype == object
            empty = np.full(time_s.size, "", object) if is_text else np.full(time_s.size, np.nan)
            table.setdefault(name, empty)[begin:end] = values
        begin = end
    note = Note(f"{recording.what}: {', '.join(chosen)}")
    whole = Table(recording.source, table, row_numbers(1, time_s.size), "message", (note, *recording.notes))
    return whole if len(chosen) == 1 else whole.pick(np.argsort(time_s, kind="stable"))
