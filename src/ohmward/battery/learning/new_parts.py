"""Parts of a log that can teach a battery something new: without faults of the sensors, and not learnt before."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from ohmward.battery.battery import Battery
from ohmward.battery.fingerprint import fingerprint, unseen
from ohmward.battery.learning.log_faults import usable_log
from ohmward.logs.log import SECONDS_PER_HOUR, Log

#: A log of which less than this share is new has been seen, where the new part cannot be learnt.
_MOSTLY_SEEN = 0.5


class NewParts(NamedTuple):
    """New parts of a log."""

    parts: tuple[Log, ...]  #: in order of time; () for a log that the battery has learnt from before
    fingerprint: str  #: of the whole log
    hours: float  #: length of the parts together; all_hours: of the log
    all_hours: float
    left_out: tuple[str, ...]  #: sentences on what is not used of it, and why

    @property
    def mostly_seen(self) -> bool:
        """True where most of the log was learnt before."""
        return self.hours < _MOSTLY_SEEN * self.all_hours


def new_parts(battery: Battery, log: Log) -> NewParts:
    """The parts of a log that can teach the battery something new.

    Raises:
        InputError: the log cannot teach anything about this battery; says why.
    """
    usable = usable_log(log, battery)
    parts = unseen(usable, _fingerprints(battery))
    hours, all_hours = _hours(parts), _hours([log])
    left_out = [note.text for note in usable.notes if note not in log.notes]
    if parts != (usable,):
        seen = f"{all_hours - hours:.2g} of {all_hours:.2g} h"
        left_out.append(f"{seen}: the battery has learnt from them before")
    return NewParts(parts, fingerprint(usable), hours, all_hours, tuple(left_out))


def _fingerprints(battery: Battery) -> tuple[str, ...]:
    """Fingerprints of the logs that the battery was identified from, and of those that it has learnt."""
    tested = battery.identification.fingerprints if battery.identification else ()
    learnt = battery.knowledge.logs if battery.knowledge else ()
    return (*tested, *(seen.fingerprint for seen in learnt))


def _hours(logs: Sequence[Log]) -> float:
    """Length of the logs together."""
    return sum(log.duration_s for log in logs) / SECONDS_PER_HOUR
