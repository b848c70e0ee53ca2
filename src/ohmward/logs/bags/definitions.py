"""Fields of message types: from the definitions in a recording, else those that come with ROS."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

from ohmward.errors import InputError
from ohmward.logs.bags.recording import ROS1, Topic
from ohmward.optional import require


class Single(NamedTuple):
    """A number, text or message: `float64`, `string`, `std_msgs/msg/Header`."""

    type: str


class Several(NamedTuple):
    """An array: of fixed `size`, or a sequence that says its own where None."""

    item: Single
    size: int | None


#: Name and content of each field of a message, in order.
Fields = Sequence[tuple[str, Single | Several]]
#: Fields of each type.
Definitions = dict[str, Fields]


@lru_cache(maxsize=64)
def definitions_of(topic: Topic) -> Definitions:
    """The type of a topic and all types that it uses.

    Raises:
        InputError: a type that neither the recording nor ROS defines.
        OhmwardError: the package rosbags is not installed.
    """
    typesys = require("rosbags.typesys", "a recording of ROS")
    store = typesys.get_typestore(typesys.Stores.ROS1_NOETIC if topic.encoding == ROS1 else typesys.Stores.LATEST)
    known = dict(store.fielddefs)
    if topic.definition:
        try:
            known |= typesys.get_types_from_msg(topic.definition, topic.type)
        except Exception as error:  # of its parser, many kinds
            raise InputError(f"topic {topic.name}: the definition of {topic.type} cannot be read ({error})") from error
    if topic.type not in known:
        raise InputError(
            f"topic {topic.name}: neither the recording nor ROS defines {topic.type!r}; record it as MCAP, which "
            "carries definitions"
        )
    return {type_: [(name, _content(found)) for name, found in fields] for type_, (_, fields) in known.items()}


def _content(found: Any) -> Single | Several:
    """A field as the package rosbags describes it: kind and detail."""
    kind, detail = found
    if kind.name in ("ARRAY", "SEQUENCE"):
        item, count = detail
        inner = _content(item)
        assert isinstance(inner, Single)
        return Several(inner, count if kind.name == "ARRAY" else None)
    return Single(detail[0] if kind.name == "BASE" else detail)
