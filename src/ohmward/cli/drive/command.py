"""`ohmward drive`: the operator's side of slip control."""

from __future__ import annotations

import argparse
import asyncio
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

from ohmward.cli.drive.keys import EVENT, HELP, keys_of, moved_stick, pressed
from ohmward.cli.drive.report import line
from ohmward.cli.outcome import Outcome
from ohmward.errors import InputError, OhmwardError
from ohmward.onboard.control.operator_command import OperatorCommand
from ohmward.onboard.control.operator_link import OperatorLink
from ohmward.onboard.secrets import secret
from ohmward.onboard.sinks.control import host_and_port
from ohmward.onboard.sinks.terminal import within_terminal

#: The line is written anew after so many beats.
_BEATS_A_LINE = 5
#: At the end so many beats are answered with a stop.
_LAST_BEATS = 3


def run(args: argparse.Namespace) -> Outcome:
    """Drive until the operator ends it."""
    host, port = host_and_port("HOST:PORT", args.robot)
    link = OperatorLink(host, port, secret("--token", args.token) if args.token else "")
    desk = OperatorDesk(link)
    if args.stop:
        beat = asyncio.run(desk.stop())
    else:
        with desk.opened(args.joystick):
            beat = asyncio.run(desk.drive())
    figures = {"command": "drive", "robot": args.robot, "phase": beat.get("phase"), "reason": beat.get("reason")}
    return Outcome(figures, f"{args.robot}: {beat.get('phase')}, {beat.get('reason') or 'nothing wrong'}", [])


class OperatorDesk:
    """Keys, joystick and display of an operator.

    Args:
        link: to the robot.
    """

    def __init__(self, link: OperatorLink):
        self.link, self.ended = link, False
        self._limits: dict[str, float] = {}
        self._inputs: list[tuple[int, Callable[[bytes], None]]] = []
        self._shown = ""

    @contextmanager
    def opened(self, joystick: str | None) -> Iterator[None]:
        """Keys without waiting for the line's end, and the joystick; the terminal is as before afterwards."""
        self._inputs = [(sys.stdin.fileno(), self._keys)]
        device = -1
        if joystick:
            try:
                device = os.open(joystick, os.O_RDONLY | os.O_NONBLOCK)
            except OSError as error:
                raise InputError(f"--joystick: {joystick} cannot be opened ({error.strerror}); is it there?") from error
            self._inputs.append((device, self._sticks))
        try:
            with _single_keys():
                yield
        finally:
            if device >= 0:
                os.close(device)

    async def drive(self) -> dict[str, Any]:
        """Answer beats with what keys and sticks say; the last beat."""
        print(HELP, file=sys.stderr)
        loop, beat, left = asyncio.get_running_loop(), {}, _LAST_BEATS
        try:
            number = 0
            async for beat in self.link.beats(self._look):
                if number == 0:
                    for descriptor, took in self._inputs:
                        loop.add_reader(descriptor, self._read, descriptor, took)
                self._show(beat, number)
                number += 1
                if self.ended:
                    self.link.command, left = OperatorCommand(), left - 1
                    if left == 0:
                        break
        finally:
            for descriptor, _ in self._inputs:
                with suppress(OSError, ValueError):
                    loop.remove_reader(descriptor)
            print(file=sys.stderr)
        return beat

    async def stop(self) -> dict[str, Any]:
        """Say stop, and wait until the robot says it has; the last beat."""
        self.link.stop = True
        async with asyncio.timeout(5.0):
            async for beat in self.link.beats():
                if beat.get("phase") == "stopped":
                    return beat
        raise OhmwardError("the robot does not stop; press its emergency stop")

    def _look(self, beat: dict[str, Any]) -> None:
        """See a beat before it is answered: unless the robot is armed there is nothing to set but that."""
        self._limits = beat.get("limits") or self._limits
        if beat.get("phase") != "armed":
            self.link.command = self.link.command._replace(speed_m_s=0.0, yaw_rate_rad_s=0.0, slip_ratio=0.0)

    def _read(self, descriptor: int, took: Callable[[bytes], None]) -> None:
        """Take bytes of a device; at its end the robot is stopped."""
        try:
            data = os.read(descriptor, 64 * EVENT.size)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self.ended = True
            asyncio.get_running_loop().remove_reader(descriptor)
            return
        took(data)

    def _keys(self, data: bytes) -> None:
        for key in keys_of(data.decode(errors="replace")):
            self.ended = self.ended or key in ("q", "\x03", "\x04")
            self.link.command = pressed(key, self.link.command, self._limits)

    def _sticks(self, data: bytes) -> None:
        for at in range(0, len(data) - EVENT.size + 1, EVENT.size):
            self.link.command = moved_stick(data[at : at + EVENT.size], self.link.command, self._limits)

    def _show(self, beat: dict[str, Any], number: int) -> None:
        """Write the line anew on a terminal; elsewhere a line for each new phase."""
        if sys.stderr.isatty():
            if number % _BEATS_A_LINE == 0:
                print(f"\r{within_terminal(line(beat, self.link.command))}\x1b[K", end="", file=sys.stderr, flush=True)
        elif (now := f"{beat.get('phase')}{beat.get('reason')}"[:20]) != self._shown:
            self._shown = now
            print(line(beat, self.link.command), file=sys.stderr, flush=True)


@contextmanager
def _single_keys() -> Iterator[None]:
    """Keys of the terminal one by one and unseen, where it is one."""
    if not sys.stdin.isatty():
        yield
        return
    import termios
    import tty

    descriptor = sys.stdin.fileno()
    before = termios.tcgetattr(descriptor)
    tty.setcbreak(descriptor)
    try:
        yield
    finally:
        termios.tcsetattr(descriptor, termios.TCSADRAIN, before)
