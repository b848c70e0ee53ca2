"""The operator's side of the link to the robot: a signed line, then an answer with the set-points to each beat."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator, Callable
from typing import Any

from ohmward.errors import OhmwardError
from ohmward.onboard.control.operator_command import LONGEST_COMMAND, OperatorCommand, Signing

#: The robot has so long to answer [s].
_ROBOT_ANSWER_S = 3.0


class OperatorLink:
    """A connection to a robot.

    Args:
        host, port: of the robot's `operator`.
        token: shared secret; empty on this machine.

    Attributes:
        command: set-points that answer the next beat.
        stop: say stop with the next answer.
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
