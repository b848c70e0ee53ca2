"""Recordings of several streams (topics, messages of a bus, tables), each with times of its own, as one table."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.hints import TOPIC, FileHints
from ohmward.logs.table import Note, Progress, Table, TableFile, row_numbers

BATTERY, DRIVE, BOTH = "battery", "drive", "both"


class KnownType(NamedTuple):
    """A type that is found without being named."""

    part: str  #: of what it tells, `battery`, `drive` or `both`
    columns: Mapping[str, str]  #: path of a field -> name of its column
    by_name_only: bool = False  #: it is read where a topic of it is named


def choose_topics(
    source: str,
    kind: str,
    where: Mapping[str, float | str],
    topics: Mapping[str, str],
    known: Mapping[str, KnownType],
) -> list[str]:
    """Names of the topics of a battery or of a drive: those that `where` names, and others by their types.

    source: name of the recording, for messages.
    kind: `battery` or `drive`.
    where: its `topic` names topics, separated by commas.
    topics: name -> type of those in the recording.  known: types that are found.

    Raises:
        InputError: no such topic, none of this kind, or several of one type and none named.
    """
    listed = ", ".join(f"{name} ({type_})" for name, type_ in topics.items()) or "none"
    named = [name.strip() for name in str(where.get(TOPIC, "")).split(",") if name.strip()]
    if unknown := [name for name in named if name not in topics]:
        raise InputError(f"{source}: there is no topic {unknown[0]!r} that can be read; it has: {listed}")
    chosen = [name for name in named if topics[name] not in known or known[topics[name]].part in (kind, BOTH)]
    types = {topics[name] for name in chosen}
    for type_, about in known.items():
        if type_ in types or about.by_name_only or about.part not in (kind, BOTH):
            continue
        found = [name for name in topics if topics[name] == type_]
        if len(found) > 1:
            raise InputError(
                f"{source}: both {found[0]} and {found[1]} are of type {type_}; choose with --topic {found[0]} "
                f"(where={{'topic': {found[0]!r}}})"
            )
        chosen += found
    if not chosen:
        first = next(type_ for type_, about in known.items() if about.part == kind)
        raise InputError(
            f"{source}: no topic of type {first}; name those that tell of the {kind} with --topic /a,/b, and their "
            f"columns with --column where names do not tell; it has: {listed}"
        )
    return chosen


#: Name of the column of the time.
TIME = "time [s]"


class Stream(NamedTuple):
    """Messages of one kind."""

    type: str  #: by which those of a battery or of a drive are found
    time_s: np.ndarray  #: (n,) since 1970, or since the start; or dates
    columns: Mapping[str, np.ndarray]  #: name -> (n,)


class Streams(NamedTuple):
    """The streams of a recording."""

    source: str  #: name of the file, for messages
    streams: Mapping[str, Stream]  #: by name
    what: str  #: of what they are, for the notes: "topics of PX4"
    known: Mapping[str, KnownType] = {}  #: types that are found without being named; {}: names of columns decide
    positive_current: str | None = None  #: as of `TableFile`
    notes: tuple[Note, ...] = ()
    hints: FileHints = FileHints()

    def open(self, chosen: Sequence[str] | None = None) -> TableFile:
        """The columns of the chosen streams, of all without a choice."""
        of_chosen = {name: self.streams[name] for name in (self.streams if chosen is None else chosen)}
        columns = dict.fromkeys([TIME, *(name for stream in of_chosen.values() for name in stream.columns)])

        def load(names: Collection[str], progress: Progress | None = None) -> Table:
            note = Note(f"{self.what}: {', '.join(_with_any(of_chosen, names))}")
            return rows_of(self.source, TIME, of_chosen, names, (note, *self.notes))

        return TableFile(self.source, tuple(columns), load, TIME, self._part, self.positive_current, hints=self.hints)

    def _part(self, kind: str, where: Mapping[str, float | str]) -> TableFile:
        """The columns of a battery or of a drive, or of the streams that `where` names."""
        types = {name: stream.type for name, stream in self.streams.items()}
        if self.known or TOPIC in where:
            return self.open(choose_topics(self.source, kind, where, types, self.known))
        return self.open()


def _with_any(streams: Mapping[str, Stream], wanted: Collection[str]) -> Mapping[str, Stream]:
    """The streams with a column that is wanted; all where none has one."""
    return {name: stream for name, stream in streams.items() if stream.columns.keys() & set(wanted)} or streams


def rows_of(
    source: str, time: str, streams: Mapping[str, Stream], wanted: Collection[str], notes: tuple[Note, ...]
) -> Table:
    """The columns of some streams, a row for each message, in order of time where there are several streams.

    time: name of the column of the time.

    Raises:
        InputError: no message.
    """
    chosen = _with_any(streams, wanted)
    times = [stream.time_s for stream in chosen.values() if stream.time_s.size]
    if not times:
        raise InputError(f"{source}: no message of {', '.join(streams)}; a log needs samples")
    whole = np.concatenate(times)
    table: dict[str, np.ndarray] = {time: whole}
    begin = 0
    for stream in chosen.values():
        end = begin + stream.time_s.size
        for name, values in stream.columns.items():
            if name not in wanted:
                continue
            empty = np.full(whole.size, "", object) if values.dtype == object else np.full(whole.size, np.nan)
            with np.errstate(invalid="ignore"):  # of a float32 whose bits are those of a signalling NaN
                table.setdefault(name, empty)[begin:end] = values
        begin = end
    rows = Table(source, table, row_numbers(1, whole.size), "message", notes)
    return rows if len(chosen) == 1 else rows.pick(np.argsort(whole, kind="stable"))
