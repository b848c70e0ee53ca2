"""Sources and sinks: their protocols, a supervisor that restarts them, and a counter of unreadable input."""

from __future__ import annotations

import asyncio
import logging
import reprlib
from collections.abc import Awaitable, Callable
from copy import copy
from typing import Any, Protocol, TypeVar

from ohmward.errors import OhmwardError
from ohmward.onboard.feed import Feed
from ohmward.onboard.message import Put
from ohmward.onboard.robot_state import Diagnostic, Level

LOG = logging.getLogger("ohmward.onboard")

T = TypeVar("T")

#: Wait before a source or sink restarts, or rows are sent again [s]: doubled each time. It is reset once the source or
#: sink has run for longer than the longest wait, or rows have been sent.
FIRST_WAIT_S, LONGEST_WAIT_S = 0.5, 30.0


class Source(Protocol):
    """Settings of a source of measurements, a frozen dataclass that checks itself; its state lives in `run`."""

    @property
    def name(self) -> str:
        """Name in diagnostics and logs."""
        ...

    async def run(self, put: Put) -> None:
        """Put messages until the source ends; a lost connection raises `OhmwardError` with the fix.

        The supervisor restarts it after a while. A message that cannot be read is counted and left out; it never ends
        the source.
        """
        ...


class Sink(Protocol):
    """Settings of a sink of states, a frozen dataclass that checks itself."""

    @property
    def name(self) -> str:
        """Name in diagnostics and logs."""
        ...

    @property
    def interval_s(self) -> float:
        """Least time between two states that it takes; 0 takes all."""
        ...

    async def run(self, feed: Feed) -> None:
        """Deliver states until the feed ends; a lost connection raises `OhmwardError` with the fix.

        Undelivered states go back to the feed (`Feed.put_back`) or stay on the sink's own disk.
        """
        ...


def is_live(source: Source) -> bool:
    """False for a source that makes its own measurements, such as a replay or a simulation: `live = False`."""
    return getattr(source, "live", True)


def feed_interval_s(sink: Sink) -> float:
    """Least time between two states in a sink's feed; 0 for a sink that limits its own messages: `takes_all`."""
    return 0.0 if getattr(sink, "takes_all", False) else sink.interval_s


def sharing(part: T, run: Callable[[Any], Awaitable[None]]) -> T:
    """A copy of a source or sink with another `run`: on a node, clock or drives shared with others."""
    shared = copy(part)
    object.__setattr__(shared, "run", run)  # its class is frozen
    return shared


class EndedError(OhmwardError):
    """A source or sink has ended for good, as a replay does after its log: it is not restarted."""


async def keep_running(
    name: str, run: Callable[[], Awaitable[None]], report: Callable[[Diagnostic], None], wait_s: float = FIRST_WAIT_S
) -> None:
    """Run a source or sink, and restart it with growing waits whenever it ends; return on `EndedError`.

    name: name of the diagnostics.  report: receives them.
    """
    loop = asyncio.get_running_loop()
    longest_s, first_s = LONGEST_WAIT_S, wait_s
    while True:
        report(Diagnostic(name, Level.OK, "running"))
        began_s = loop.time()
        try:
            await run()
            reason = "ended"
        except EndedError as end:
            report(Diagnostic(name, Level.OK, str(end)))
            return
        except OhmwardError as error:
            reason = str(error)
        except Exception as error:
            LOG.exception("%s: unexpected error", name)
            reason = f"unexpected {type(error).__name__}: {error}"
        wait_s = first_s if loop.time() - began_s > longest_s else wait_s
        report(Diagnostic(name, Level.ERROR, reason, {"again_in_s": wait_s}))
        if (task := asyncio.current_task()) and task.cancelling():  # an error of the cleanup has replaced it
            raise asyncio.CancelledError
        await asyncio.sleep(wait_s)
        wait_s = min(2.0 * wait_s, longest_s)


class FaultyInput:
    """Counter of faulty lines, frames or payloads of a source.

    Args:
        name: of the source.
        sentence: description of the fault, "lines are no JSON object".
        kind: kind of the named part, "source".

    Attributes:
        number: faults so far.
    """

    def __init__(self, name: str, sentence: str, kind: str = "source"):
        self.name, self.sentence, self.kind, self.number = name, sentence, kind, 0

    def count(self, more: int = 1, example: bytes = b"") -> None:
        """Count more faults; every doubling of their number is logged, with the beginning of an example."""
        before, self.number = self.number, self.number + more
        if self.number.bit_length() > before.bit_length():
            quoted = f", such as {reprlib.repr(example.decode(errors='replace'))}" if example else ""
            LOG.warning("%s %s: %s (%d so far%s)", self.kind, self.name, self.sentence, self.number, quoted)
