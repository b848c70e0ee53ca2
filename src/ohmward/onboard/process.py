"""The process on the robot: sources and sinks beside each other, the estimators between them."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from functools import partial

from ohmward.onboard.clock import SourceClock, SystemClock
from ohmward.onboard.estimation import Estimation
from ohmward.onboard.feed import Feed
from ohmward.onboard.message import Message
from ohmward.onboard.part import EndedError, Sink, Source, keep_running
from ohmward.onboard.robot_state import Diagnostic, RobotState


class Process:
    """Sources -> estimators -> sinks, until the sources end or somebody stops it.

    Args:
        estimation: the estimators.
        sources, sinks: the parts around them.
        clock: of this machine.
    """

    def __init__(
        self,
        estimation: Estimation,
        sources: Sequence[Source],
        sinks: Sequence[Sink],
        clock: SystemClock | None = None,
    ):
        self.estimation, self.sources = estimation, sources
        self.clock = clock or SystemClock()
        self.sinks = [(sink, Feed(sink.interval_s)) for sink in sinks]
        self.diagnostics: dict[str, Diagnostic] = {}
        self._clocks: dict[str, SourceClock] = {source.name: SourceClock() for source in sources}

    async def run(self) -> None:
        """Run until every source has ended; sinks then deliver what waits."""
        async with asyncio.TaskGroup() as group:
            for sink, feed in self.sinks:
                group.create_task(keep_running(f"sink {sink.name}", partial(_deliver, sink, feed), self.tell))
            await self._run_sources()
            for _, feed in self.sinks:
                feed.end()

    async def _run_sources(self) -> None:
        async with asyncio.TaskGroup() as group:
            for source in self.sources:
                group.create_task(keep_running(f"source {source.name}", partial(source.run, self.put), self.tell))

    def put(self, message: Message) -> None:
        """Take a message in: estimate, and pass the states on."""
        time_s = self._clocks[message.source].to_ours(message.stamp_s, message.received_s)
        for state in self.estimation.put(time_s, message.values):
            self._pass_on(state)

    def tell(self, diagnostic: Diagnostic) -> None:
        """Take a condition in; the latest of each name stands in every state."""
        self.diagnostics[diagnostic.name] = diagnostic

    def _pass_on(self, state: RobotState) -> None:
        unix_s = self.clock.unix_s() - (self.clock.now_s() - state.time_s)
        whole = state._replace(unix_s=unix_s, diagnostics=tuple(self.diagnostics.values()))
        for _, feed in self.sinks:
            feed.put(whole)


async def _deliver(sink: Sink, feed: Feed) -> None:
    """Run a sink to the end of its feed."""
    await sink.run(feed)
    if feed.ended:
        raise EndedError("delivered to the end")
