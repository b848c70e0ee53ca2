"""Commands to the drives: frames of the user's database on CAN, arrays for ros2_control, or JSON objects by MQTT."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field

from ohmward.checks import require_one_of
from ohmward.errors import InputError, OhmwardError
from ohmward.onboard.can_bus import NO_FRAMES, CanDatabase, CanEncoder, CanPort, frames_of, require_wiring
from ohmward.onboard.control.loop import Send
from ohmward.onboard.message import ScaledSignal
from ohmward.onboard.mqtt_broker import MqttBroker
from ohmward.onboard.ros import types
from ohmward.onboard.ros.cdr import serialize
from ohmward.onboard.ros.transport import RosNetwork, SharedNode

#: Time to listen to a bus before sending commands to it [s]: other controllers send at least ten times a second.
LISTEN_S = 0.25

#: Quantity of each kind of command.
_OF_COMMAND = {"torque": "torque_Nm", "wheel-speed": "wheel_speed_rad_s"}


@dataclass(frozen=True)
class CanOutput(CanPort):
    """Frames on a bus."""

    dbc: str = ""  #: path of the database
    #: "torque_Nm.WHEEL" or "wheel_speed_rad_s.WHEEL", "enable", "counter" -> "MESSAGE.SIGNAL"
    signals: dict[str, str | ScaledSignal] = field(default_factory=dict)

    @asynccontextmanager
    async def opened(self, names: list[str]) -> AsyncIterator[Send]:
        """The function that sends; names: names of the available numbers."""
        for name in self.signals:
            if name not in names:
                raise InputError(f"can.signals: {name!r} is no number for the drives; there are: {', '.join(names)}")
        encoder = CanEncoder(CanDatabase(self.dbc), self.signals)
        await self._require_alone(encoder)
        with self.open(NO_FRAMES) as bus:
            yield lambda numbers: self.send(bus, encoder.frames(numbers))

    async def _require_alone(self, encoder: CanEncoder) -> None:
        """Raise OhmwardError if somebody else on the bus sends the same frames."""
        ours = encoder.identifiers
        async with frames_of(self, encoder.filters) as frames:
            with suppress(TimeoutError):
                async with asyncio.timeout(LISTEN_S):
                    while True:
                        for frame, _ in await frames.take():
                            if name := ours.get((frame.arbitration_id, frame.is_extended_id)):
                                raise OhmwardError(
                                    f"{self.channel}: somebody else sends {name} already; drives take commands from "
                                    "one process, end the other one"
                                )

    def __post_init__(self) -> None:
        example = 'enable = "Drive.Enable"'
        require_wiring(self.dbc, self.signals, example)
        if "enable" not in self.signals:
            raise InputError(f'signals has no "enable"; wire the signal that lets the drives turn: {example}')


@dataclass(frozen=True)
class MqttOutput(MqttBroker):
    """A JSON object of all numbers at a topic, not retained."""

    topic: str = "ohmward/robot/drives"  #: command topic; by default with the name of the setup instead of "robot"

    @asynccontextmanager
    async def opened(self, names: list[str]) -> AsyncIterator[Send]:
        """The function that sends; names: names of the available numbers."""
        async with self.connected() as (client, _):

            def send(numbers: Mapping[str, float]) -> None:
                if client.publish(self.topic, json.dumps(dict(numbers)), qos=0).rc:
                    raise OhmwardError(f"{self.host}:{self.port} takes no commands")

            yield send


@dataclass(frozen=True)
class SimulatedOutput:
    """The drives of a simulated robot in the same process, for trials."""

    source: str = "simulation"  #: name of the [[source]] of kind "simulation"

    @asynccontextmanager
    async def opened(self, names: list[str]) -> AsyncIterator[Send]:
        """Raise InputError; `connect_simulated_drives` puts the drives in this place."""
        raise InputError(f"simulation: the drives of {self.source!r} are in the process of its setup only")
        yield


@dataclass(frozen=True)
class RosOutput(RosNetwork):
    """`std_msgs/Float64MultiArray` for a forward_command_controller of ros2_control: zeros unless armed."""

    node: str = "ohmward_control"
    topic: str = "/wheel_controller/commands"  #: command topic of the controller
    #: "torque" for a controller with the command interface "effort", "wheel-speed" for "velocity"
    command: str = "torque"
    joints: tuple[str, ...] = ()  #: wheels in the order of the controller's joints; default: that of the robot file

    def __post_init__(self) -> None:
        super().__post_init__()
        require_one_of("command", self.command, _OF_COMMAND)

    @asynccontextmanager
    async def opened(self, names: list[str]) -> AsyncIterator[Send]:
        """The function that sends; names: names of the available numbers."""
        quantity = _OF_COMMAND[self.command]
        wheels = [name for name in names if name.partition(".")[0] == quantity]
        wanted = [f"{quantity}.{joint}" for joint in self.joints] or wheels
        if unknown := set(wanted) - set(wheels):
            raise InputError(f"ros.joints: {min(unknown)!r} is no wheel; there are: {', '.join(wheels)}")
        async with SharedNode(self).opened() as transport:

            def send(numbers: Mapping[str, float]) -> None:
                transport.check()
                layout = {"dim": [], "data_offset": 0}
                message = {"layout": layout, "data": [numbers[name] for name in wanted]}
                transport.publish(self.topic, types.FLOATS, serialize(types.FLOATS, message))

            yield send
