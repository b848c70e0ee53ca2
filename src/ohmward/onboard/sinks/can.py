"""CAN sink: numbers of the robot's state in frames of the user's database."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field

from ohmward.onboard.can_bus import NO_FRAMES, CanDatabase, CanEncoder, CanPort, require_wiring
from ohmward.onboard.feed import Feed
from ohmward.onboard.message import ScaledSignal
from ohmward.onboard.robot_state import number_at, require_path


@dataclass(frozen=True)
class CanSink(CanPort):
    """Frames from states."""

    dbc: str = ""  #: path of the database: DBC, KCD, SYM or ARXML
    #: name of a number of the state -> "MESSAGE.SIGNAL", as `"battery.soc" = "State.SoC"`. A message is sent once all
    #: its numbers are known
    signals: dict[str, str | ScaledSignal] = field(default_factory=dict)
    interval_s: float = 0.1  #: least time between two states sent, >= 0
    name: str = "can"  #: in diagnostics

    def __post_init__(self) -> None:
        require_wiring(self.dbc, self.signals, '"battery.soc" = "State.SoC"')
        for path in self.signals:
            require_path(path)

    async def run(self, feed: Feed) -> None:
        """Send the newest states until the feed ends; old ones are of no use on a bus."""
        encoder = CanEncoder(CanDatabase(self.dbc), self.signals)
        with self.open(NO_FRAMES) as bus:
            while states := await feed.batch():
                numbers = {path: number_at(states[-1], path) for path in self.signals}
                await asyncio.to_thread(self.send, bus, encoder.frames(numbers))
