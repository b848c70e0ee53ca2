"""Sources and sinks: what they promise, a supervisor that begins them again, and their input that cannot be read."""

from __future__ import annotations

import asyncio
import logging
import reprlib
from collections.abc import Awaitable, Callable, Coroutine
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

from ohmward.errors import OhmwardError
from ohmward.onboard.feed import Feed
from ohmward.onboard.message import Put
from ohmward.onboard.robot_state import Diagnostic, Level

LOG = logging.getLogger("ohmward.onboard")

#: Wait before a source or sink begins again [s]: doubled each time, back to the first once it has run for the longest.
FIRST_WAIT_S, LONGEST_WAIT_S = 0.5, 30.0


class Source(Protocol):
    """Settings of a source of measurements, a frozen dataclass that checks itself; its state lives in `run`."""

    @property
    def name(self) -> str:
        """In diagnostics and logs."""
        ...

    async def run(self, put: Put) -> None:
        """Put messages until the source ends; a connection that is lost raises `OhmwardError` with the fix.

        The supervisor begins it again after a while. A message that cannot be read is counted and left out, it never
        ends the source.
        """
        ...


class Sink(Protocol):
    """Settings of a sink of states, a frozen dataclass that checks itself."""

    @property
    def name(self) -> str:
        """In diagnostics and logs."""
        ...

    @property
    def interval_s(self) -> float:
        """Least time between two states that it takes; 0 takes all."""
        ...

    async def run(self, feed: Feed) -> None:
        """Deliver states until the feed ends; a connection that is lost raises `OhmwardError` with the fix.

        What could not be delivered goes back to the feed (`Feed.put_back`) or stays on the sink's own disk.
        """
        ...


@runtime_checkable
class ActingSink(Protocol):
    """A sink that sends by itself, without any state: commands, its status, what waited on the disk."""

    async def try_out(self) -> None:
        """Open what it sends to, and send nothing, until it is cancelled."""
        ...


def is_live(source: Source) -> bool:
    """False for a source that makes its measurements itself, as a replay and a simulation do: `live = False`."""
    return getattr(source, "live", True)


def feed_interval_s(sink: Sink) -> float:
    """Least time between two states of the feed of a sink; 0 for one that limits its messages itself: `takes_all`."""
    return 0.0 if getattr(sink, "takes_all", False) else sink.interval_s


@dataclass(frozen=True)
class SharingPart:
    """A source or a sink that runs on what it shares with others, a node, a clock or drives; else as it is."""

    part: Any
    run: Callable[[Any], Coroutine[Any, Any, None]]

    @property
    def name(self) -> str:
        """In diagnostics and logs."""
        return self.part.name

    @property
    def live(self) -> bool:
        """As of the source."""
        return is_live(self.part)

    @property
    def interval_s(self) -> float:
        """As of the feed of the sink."""
        return feed_interval_s(self.part)


class EndedError(OhmwardError):
    """A source has come to its end, as a log does: it does not begin again."""


async def keep_running(
    name: str, run: Callable[[], Awaitable[None]], tell: Callable[[Diagnostic], None], wait_s: float = FIRST_WAIT_S
) -> None:
    """Run a source or sink, and begin it again with growing waits whenever it ends; returns where it has `EndedError`.

    name: of the diagnostics.  tell: takes them in.
    """
    loop = asyncio.get_running_loop()
    longest_s, first_s = LONGEST_WAIT_S, wait_s
    while True:
        tell(Diagnostic(name, Level.OK, "running"))
        began_s = loop.time()
        try:
            await run()
            reason = "ended"
        except EndedError as end:
            tell(Diagnostic(name, Level.OK, str(end)))
            return
        except OhmwardError as error:
            reason = str(error)
        except Exception as error:
            LOG.exception("%s: unexpected error", name)
            reason = f"unexpected {type(error).__name__}: {error}"
        wait_s = first_s if loop.time() - began_s > longest_s else wait_s
        tell(Diagnostic(name, Level.ERROR, reason, {"again_in_s": wait_s}))
        await asyncio.sleep(wait_s)
        wait_s = min(2.0 * wait_s, longest_s)


class FaultyInput:
    """Faulty lines, frames or payloads of a source.

    Args:
        name: of the source.
        sentence: about them, "lines are no JSON object".
        kind: of what is named, "source".

    Attributes:
        number: of them so far.
    """

    def __init__(self, name: str, sentence: str, kind: str = "source"):
        self.name, self.sentence, self.kind, self.number = name, sentence, kind, 0

    def count(self, more: int = 1, example: bytes = b"") -> None:
        """Count more of them; every doubling of the number is a line in the log, with the beginning of an example."""
        before, self.number = self.number, self.number + more
        if self.number.bit_length() > before.bit_length():
            quoted = f", such as {reprlib.repr(example.decode(errors='replace'))}" if example else ""
            LOG.warning("%s %s: %s (%d so far%s)", self.kind, self.name, self.sentence, self.number, quoted)
