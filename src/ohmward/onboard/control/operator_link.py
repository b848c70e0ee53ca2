"""The link between the robot and its operator, both sides.

The operator begins with a signed line; until then the robot reveals nothing about itself, and it waits no longer than
`FIRST_LINE_S`. Then, fifty times a second, the robot sends a beat with its state and its time; the operator answers
each with set-points and that time. Set-points are as old as the beat that they answer, however the network delayed
either: lines that were held up and arrive in a burst are no heartbeat.
"""

from __future__ import annotations

import asyncio
import math
import secrets as random_secrets
import time
from collections.abc import AsyncGenerator, AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any

from ohmward.errors import OhmwardError
from ohmward.json_values import plain
from ohmward.onboard.control.loop import ControlLoop
from ohmward.onboard.control.operator_command import LONGEST_COMMAND, OperatorCommand, Signing, command_of
from ohmward.onboard.line_reader import BACKLOG, Visitors, cannot_listen
from ohmward.onboard.message import as_number
from ohmward.onboard.part import LOG, FaultyInput

#: Time between two beats [s].
BEAT_S = 0.02

#: Time within which the first signed line of an operator must come [s].
FIRST_LINE_S = 2.0

#: Unread data after which an operator counts as gone [bytes].
_MOST_WAITING_BYTES = 1 << 16


class OperatorServer:
    """Listens for an operator; one at a time drives, anybody with the token may stop.

    Args:
        loop: of the controller.
        name: of the robot.
        token: shared secret; empty where only this machine can connect.
    """

    def __init__(self, loop: ControlLoop, name: str, token: str):
        self.loop, self.name, self.token = loop, name, token
        self._driver: asyncio.StreamWriter | None = None
        self._refused = FaultyInput("control", "operators were refused: wrong token", "sink")
        left_out = FaultyInput("control", "connections were closed that brought no signed line, or too many", "sink")
        self._visitors = Visitors(left_out.count, FIRST_LINE_S)

    @asynccontextmanager
    async def listening(self, host: str, port: int) -> AsyncIterator[None]:
        """Serve until the end."""
        try:
            server = await asyncio.start_server(self._serve, host, port, limit=LONGEST_COMMAND, backlog=BACKLOG)
        except OSError as error:
            raise cannot_listen(f"operator: {host}:{port}", error) from error
        try:
            yield
        finally:
            server.close()
            self._visitors.close()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Listen until the connection ends, and send beats once a signed line has come."""
        nonce = random_secrets.token_hex(16)
        ours, theirs = (Signing(self.token, nonce, sender) for sender in ("robot", "operator"))
        beats: asyncio.Task[None] | None = None
        self._visitors.arrive(writer.transport)
        try:
            writer.write(f"ohmward-drive/1 {nonce}\n".encode())
            while line := await reader.readline():
                if (found := theirs.read(line)) is None:
                    self._refused.count()
                    return
                self._visitors.know(writer.transport)
                beats = beats or asyncio.create_task(self._beat(writer, ours))
                self._take(found, writer)
        except (OSError, ValueError) as error:
            LOG.info("slip control: the operator's connection was lost (%s)", error)
        finally:
            self._visitors.leave(writer.transport)
            if beats:
                beats.cancel()
            if self._driver is writer:
                self._driver, self.loop.operator = None, None
            writer.close()

    def _take(self, found: dict[str, Any], writer: asyncio.StreamWriter) -> None:
        if found.get("stop") is True:
            self.loop.control.request_stop("stopped by an operator")
            return
        given_s = as_number(found.get("t"))
        if not math.isfinite(given_s):  # it answers no beat yet
            return
        command = command_of(found, min(given_s, time.monotonic()))
        if self._driver is None:
            self._driver = writer
        if self._driver is writer and command is not None:
            self.loop.operator = command

    async def _beat(self, writer: asyncio.StreamWriter, ours: Signing) -> None:
        """Send the state every `BEAT_S`."""
        limits = plain(vars(self.loop.control.limits))
        while writer.transport.get_write_buffer_size() < _MOST_WAITING_BYTES:
            driving = self._driver in (None, writer)
            beat = {"t": time.monotonic(), "robot": self.name, "driver": driving, "limits": limits}
            writer.write(ours.line(beat | self._seen()))
            await asyncio.sleep(BEAT_S)
        writer.close()

    def _seen(self) -> dict[str, Any]:
        """State and commands, for the operator to see."""
        output, state = self.loop.output, self.loop.state
        seen: dict[str, Any] = {"phase": "", "reason": ""} if output is None else output._asdict()
        if state and state.slip:
            seen |= {name: getattr(state.slip, name) for name in ("speed_m_s", "yaw_rate_rad_s", "slip_ratio")}
        if state and state.battery:
            seen |= {"soc": state.battery.soc, "soc_std": state.battery.soc_std}
        return plain(seen)


#: Time that the robot has to answer [s].
_ROBOT_ANSWER_S = 3.0


class OperatorLink:
    """A connection to a robot.

    Args:
        host, port: of the robot's `operator`.
        token: shared secret; empty on this machine.

    Attributes:
        command: set-points that answer the next beat.
        stop: request a stop with the next answer.
    """

    def __init__(self, host: str, port: int, token: str = ""):
        self.host, self.port, self.token = host, port, token
        self.command, self.stop = OperatorCommand(), False

    async def beats(
        self, before_answer: Callable[[dict[str, Any]], None] = lambda beat: None
    ) -> AsyncGenerator[dict[str, Any], None]:
        """Beats of the robot, each answered at once.

        before_answer: sees a beat before it is answered, and may change the command.

        Raises:
            OhmwardError: no connection, another token, or the connection is lost.
        """
        place = f"{self.host}:{self.port}"
        try:
            async with asyncio.timeout(_ROBOT_ANSWER_S):
                reader, writer = await asyncio.open_connection(self.host, self.port, limit=LONGEST_COMMAND)
                hello = (await reader.readline()).decode(errors="replace").split()
        except (OSError, TimeoutError, ValueError) as error:
            raise OhmwardError(
                f"no robot at {place} ({error}); does `ohmward run` with a control sink run there?"
            ) from error
        if len(hello) != 2 or hello[0] != "ohmward-drive/1":
            raise OhmwardError(f"{place} is no robot to drive; give the address of the control sink's `operator`")
        ours, theirs = (Signing(self.token, hello[1], sender) for sender in ("operator", "robot"))
        try:
            writer.write(ours.line(self._answer({})))
            if not (line := await reader.readline()):
                raise OhmwardError(f"{place} has another token, or too many operators; give its token with --token")
            while line:
                if (beat := theirs.read(line)) is None:
                    raise OhmwardError(f"{place} has another token; give its token with --token")
                before_answer(beat)
                writer.write(ours.line(self._answer(beat)))
                yield beat
                line = await reader.readline()
            raise OhmwardError(f"{place} has closed the connection; the robot has stopped")
        except OSError as error:
            raise OhmwardError(f"the connection to {place} is lost ({error}); the robot has stopped") from error
        finally:
            writer.close()

    def _answer(self, beat: dict[str, Any]) -> dict[str, Any]:
        if self.stop:
            return {"stop": True}
        found = self.command._asdict()
        del found["given_s"]
        return found | {"t": beat.get("t")}
