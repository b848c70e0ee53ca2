"""CAN: frames of drives and battery monitors, decoded by the user's database."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from ohmward.onboard.can_bus import CanDatabase, CanDecoder, CanPort, frames_of, require_wiring
from ohmward.onboard.message import Message, Put, Signals, Wiring
from ohmward.onboard.part import FaultyInput


@dataclass(frozen=True)
class CanSource(CanPort):
    """Frames of a bus."""

    dbc: str = ""  #: path of the database: DBC, KCD, SYM or ARXML
    signals: Signals = field(default_factory=dict)  #: quantity -> "MESSAGE.SIGNAL"
    name: str = "can"  #: in diagnostics

    def __post_init__(self) -> None:
        Wiring(self.signals)
        require_wiring(self.dbc, self.signals, 'battery_current_A = "BMS.Current"')

    async def run(self, put: Put) -> None:
        """Read frames until the bus fails."""
        decoder = CanDecoder(CanDatabase(self.dbc), Wiring(self.signals))
        faulty = FaultyInput(self.name, "frames cannot be decoded; is it the right DBC?")
        async with frames_of(self, decoder.filters) as frames:
            while True:
                for frame, received_s in await frames.take():
                    values = decoder.values(frame.arbitration_id, frame.is_extended_id, bytes(frame.data))
                    if values is None:
                        faulty.count()
                    elif values:
                        put(Message(frame.timestamp or math.nan, received_s, self.name, values))
