"""Topics of a battery or of a drive in a recording: found by their types, or named."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from ohmward.errors import InputError

BATTERY, DRIVE, BOTH = "battery", "drive", "both"

#: Name of the choice of topics among the rows that are wanted: `--topic /a` is `--where topic=/a`.
TOPIC = "topic"


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
    named = [name.strip() for name in str(where.get(TOPIC, "")).split(",") if name.strip()]
    if unknown := [name for name in named if name not in topics]:
        raise InputError(f"{source}: there is no topic {unknown[0]!r} that can be read; it has: {_listed(topics)}")
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
            f"columns with --column where names do not tell; it has: {_listed(topics)}"
        )
    return chosen


def _listed(topics: Mapping[str, str]) -> str:
    """The topics and their types."""
    return ", ".join(f"{name} ({type_})" for name, type_ in topics.items()) or "none"
