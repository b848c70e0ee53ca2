"""CAN buses: opened by python-can, with the fix in every refusal."""

from __future__ import annotations

import time
from collections.abc import AsyncIterator, Iterable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Any, NamedTuple

from ohmward.errors import OhmwardError
from ohmward.onboard.message import Handover, read_in_thread
from ohmward.optional import require

#: Error class "bus off" in the identifier of an error frame, linux/can/error.h.
_BUS_OFF = 0x40


#: A bus that takes no frame for so long has failed [s].
_SEND_S = 0.02

#: Filter that lets nothing through but an identifier that nobody may use, for buses that are only written to.
NO_FRAMES = [{"can_id": 0x1FFFFFFF, "can_mask": 0x1FFFFFFF, "extended": True}]

#: The thread that reads looks so often for its end [s].
_RECEIVE_S = 0.2


@dataclass(frozen=True)
class CanPort:
    """A bus as python-can names it."""

    interface: str = "socketcan"  #: "socketcan", "slcan", "pcan", "virtual", ...
    channel: str = "can0"  #: of the interface, "can0"
    bitrate: int | None = None  #: of adapters that are told; socketcan has it from `ip link`
    fd: bool = False  #: frames of CAN FD as well

    def open(self, filters: list[dict[str, Any]] | None = None) -> Any:
        """The bus.

        Raises:
            OhmwardError: it cannot be opened; says what to do.
            MissingPackageError: python-can is not installed.
        """
        can = require("can", "the CAN bus")

        given: dict[str, Any] = {} if self.bitrate is None else {"bitrate": self.bitrate}
        given |= {"fd": True} if self.fd else {}
        if self.interface == "socketcan":  # in the kernel; python-can's own would keep error frames back
            given |= {"can_filters": filters}
        try:
            return can.Bus(interface=self.interface, channel=self.channel, **given)
        except PermissionError as error:
            raise OhmwardError(
                f"no permission for {self.interface} {self.channel}; add the user to the device's group (dialout)"
            ) from error
        except (can.CanError, OSError, ValueError, ImportError, NotImplementedError) as error:
            fix = "is the adapter plugged in, and do interface and channel name it?"
            if self.interface == "socketcan":
                bitrate = self.bitrate or 500_000
                fix = f"bring it up: ip link set {self.channel} up type can bitrate {bitrate} restart-ms 100"
            raise OhmwardError(f"{self.interface} {self.channel} cannot be opened ({error}); {fix}") from error

    def send(self, bus: Any, frames: Iterable[tuple[int, bool, bytes]]) -> None:
        """Send frames: identifier, extended or not, data.

        Raises:
            OhmwardError: the bus does not take them.
        """
        message = require("can", "the CAN bus").Message
        for identifier, extended, data in frames:
            try:
                bus.send(message(0.0, identifier, extended, data=data, is_fd=self.fd), timeout=_SEND_S)
            except Exception as error:  # drivers raise of every kind
                raise self.failed(error) from error

    def failed(self, error: Exception) -> OhmwardError:
        """The error of a bus that was open."""
        return OhmwardError(f"{self.channel} has failed ({error}); is the adapter plugged in and the link up?")


class Frame(NamedTuple):
    """A frame of a bus, `message` of python-can, and the monotonic time of its receipt."""

    message: Any
    received_s: float


@asynccontextmanager
async def frames_of(port: CanPort, filters: list[dict[str, Any]] | None = None) -> AsyncIterator[Handover[Frame]]:
    """Frames of a bus, read in a thread; it fails where the bus does or goes off."""
    bus = port.open(filters)

    def read() -> Frame | None:
        message = bus.recv(_RECEIVE_S)
        if message is None or message.is_remote_frame:
            return None
        if message.is_error_frame:
            if message.arbitration_id & _BUS_OFF:
                raise bus_off_error(port.channel)
            return None
        return Frame(message, time.monotonic())

    try:
        async with read_in_thread(port.channel, read, port.failed, _RECEIVE_S) as frames:
            yield frames
    finally:
        bus.shutdown()


def bus_off_error(channel: str) -> OhmwardError:
    """The controller has left the bus after too many errors."""
    return OhmwardError(
        f"{channel} is bus-off: check wiring, the two 120 ohm terminators and the bitrate; "
        f"ip link set {channel} type can restart-ms 100 lets it come back by itself"
    )
