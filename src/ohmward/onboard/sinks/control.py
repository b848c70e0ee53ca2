"""Slip control: a sink of states whose output goes to the drives, armed by an operator."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field
from typing import ClassVar

from ohmward.checks import require_between
from ohmward.errors import InputError
from ohmward.onboard.control.drive_control import DriveControl
from ohmward.onboard.control.loop import ControlLoop
from ohmward.onboard.control.operator_command import DriveLimits
from ohmward.onboard.control.operator_link import OperatorServer
from ohmward.onboard.control.outputs import CanOutput, MqttOutput, RosOutput, SimulatedOutput
from ohmward.onboard.feed import Feed
from ohmward.onboard.secrets import check_secret_name, host_and_port, is_loopback, secret
from ohmward.traction.robot.packaged import load_robot


@dataclass(frozen=True)
class ControlSink:
    """The controller and its operator."""

    identity: ClassVar[str] = "mqtt"  #: setting by which receivers tell robots apart
    robot: str | None = None  #: path of a robot file or name of a packaged robot; default: that of the setup
    #: output to the drives; give one
    can: CanOutput | None = None
    ros: RosOutput | None = None
    mqtt: MqttOutput | None = None
    simulation: SimulatedOutput | None = None  #: output to the drives of a simulated robot instead
    operator: str = "127.0.0.1:4720"  #: HOST:PORT where the operator connects; any host but this machine needs a token
    token: str | None = None  #: secret of the operator
    limits: DriveLimits = field(default_factory=DriveLimits)  #: limits of speed, torque and slip; timeouts
    interval_s: ClassVar[float] = 0.0  #: takes every state
    step_s: float = 0.01  #: time between two commands, 0.002 to 0.02
    name: str = "control"  #: in diagnostics

    def __post_init__(self) -> None:
        require_between("step_s", self.step_s, 0.002, 0.02)
        if sum(output is not None for output in (self.can, self.ros, self.mqtt, self.simulation)) != 1:
            raise InputError("give one way to the drives: [sink.can], [sink.ros], [sink.mqtt] or [sink.simulation]")
        host, _ = host_and_port("operator", self.operator)
        check_secret_name("token", self.token)
        if self.token is None and not is_loopback(host):
            raise InputError(
                f'operator = "{self.operator}" can be reached from other machines; give a token: token = "DRIVE_TOKEN"'
            )

    async def run(self, feed: Feed) -> None:
        """Control until the feed ends; the last commands stop the robot."""
        control = await asyncio.to_thread(self._control)
        loop = ControlLoop(control, self.step_s)
        server = OperatorServer(loop, control.robot.name, secret("token", self.token))
        # the port first: a second process finds it taken before it has sent anything to the drives
        async with (
            server.listening(*host_and_port("operator", self.operator)),
            self._output.opened(_names(control)) as send,
        ):
            loop.drive(send)
            try:
                while states := await feed.batch():
                    loop.state = states[-1]
                    loop.check()
            finally:
                loop.end()

    async def try_out(self) -> None:
        """Open the connection to the drives without sending anything."""
        secret("token", self.token)
        control = await asyncio.to_thread(self._control)
        async with self._output.opened(_names(control)):
            await asyncio.Event().wait()

    @property
    def _output(self) -> CanOutput | RosOutput | MqttOutput | SimulatedOutput:
        output = self.can or self.ros or self.mqtt or self.simulation
        assert output is not None
        return output

    def _control(self) -> DriveControl:
        """The controller, which is compiled here."""
        if self.robot is None:
            raise InputError('control needs the robot file: robot = "robot.toml"')
        return DriveControl(load_robot(self.robot), self.limits)


def _names(control: DriveControl) -> list[str]:
    return list(control.numbers(control.step(0.0, None, None)))
