"""`ohmward drive`: the operator's side of slip control."""

from __future__ import annotations

import argparse
import asyncio
import os
import struct
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from typing import Any

from ohmward.cli.outcome import Outcome
from ohmward.errors import InputError, OhmwardError
from ohmward.onboard.control.operator_command import OperatorCommand
from ohmward.onboard.control.operator_link import OperatorLink
from ohmward.onboard.secrets import host_and_port, secret
from ohmward.onboard.sinks.terminal import show

#: Number of beats after which the line is rewritten.
_BEATS_A_LINE = 5
#: Number of beats at the end that are answered with a stop.
_LAST_BEATS = 3
#: Time within which a robot that was asked to stop says that it has [s].
_STOP_S = 5.0


def run(args: argparse.Namespace) -> Outcome:
    """Drive until the operator ends it."""
    host, port = host_and_port("HOST:PORT", args.robot)
    link = OperatorLink(host, port, secret("--token", args.token))
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
        link: connection to the robot.
    """

    def __init__(self, link: OperatorLink):
        self.link, self.ended = link, False
        self._limits: dict[str, float] = {}
        self._inputs: list[tuple[int, Callable[[bytes], None]]] = []
        self._printed = ""

    @contextmanager
    def opened(self, joystick: str | None) -> Iterator[None]:
        """Open the joystick and read keys without waiting for Enter; the terminal is restored afterwards."""
        self._inputs = [(sys.stdin.fileno(), self._keys)]
        with ExitStack() as opened:
            if joystick:
                try:
                    device = os.open(joystick, os.O_RDONLY | os.O_NONBLOCK)
                except OSError as error:
                    fault = f"{joystick} cannot be opened ({error.strerror}); is it there?"
                    raise InputError(f"--joystick: {fault}") from error
                opened.callback(os.close, device)
                self._inputs.append((device, self._sticks))
            opened.enter_context(_single_keys())
            yield

    async def drive(self) -> dict[str, Any]:
        """Answer beats with the set-points of keys and sticks; returns the last beat."""
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
        """Send a stop and wait until the robot reports it; returns the last beat."""
        self.link.stop = True
        with suppress(TimeoutError):
            async with asyncio.timeout(_STOP_S):
                async for beat in self.link.beats():
                    if beat.get("phase") == "stopped":
                        return beat
        raise OhmwardError("the robot does not stop; press its emergency stop")

    def _look(self, beat: dict[str, Any]) -> None:
        """Process a beat before it is answered: keep its limits, and set all set-points to 0 unless armed."""
        self._limits = beat.get("limits") or self._limits
        if beat.get("phase") != "armed":
            self.link.command = self.link.command._replace(speed_m_s=0.0, yaw_rate_rad_s=0.0, slip_ratio=0.0)

    def _read(self, descriptor: int, took: Callable[[bytes], None]) -> None:
        """Read bytes from a device; the robot is stopped when the device ends."""
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
        """Rewrite the line on a terminal; elsewhere print a line for each new phase or reason."""
        if sys.stderr.isatty():
            if number % _BEATS_A_LINE == 0:
                show(line(beat, self.link.command), sys.stderr)
        elif (now := f"{beat.get('phase')}{beat.get('reason')}"[:20]) != self._printed:
            self._printed = now
            show(line(beat, self.link.command), sys.stderr)


@contextmanager
def _single_keys() -> Iterator[None]:
    """Read keys one by one and without echo if standard input is a terminal."""
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


#: Number of key presses from 0 to the limit of a set-point.
_PRESSES = 10
#: Change of the slip bound by one key press.
_SLIP_STEP = 0.01
_SMALLEST_SLIP = 0.01

HELP = """\
a  arm                      space  stop             q  stop and end
up/down or w/s  speed       left/right or j/l  turn   0  speed and turn 0
+/-  slip bound             m  hold this slip instead of a speed, and back
"""

_ARROWS = {"\x1b[A": "w", "\x1b[B": "s", "\x1b[C": "l", "\x1b[D": "j"}

#: Event of a Linux joystick: time, value, kind, number.
EVENT = struct.Struct("IhBB")
_BUTTON, _AXIS = 1, 2
_FULL_AXIS = 32767.0
#: Dead zone of a stick, as a share of its travel.
_PLAY = 0.08


def keys_of(text: str) -> list[str]:
    """Single keys in the input of a terminal; arrows become letters."""
    for sequence, key in _ARROWS.items():
        text = text.replace(sequence, key)
    return list(text)


def pressed(key: str, command: OperatorCommand, limits: Mapping[str, float]) -> OperatorCommand:
    """Set-points after a key."""
    speed, turn = limits["speed_m_s"], limits["yaw_rate_rad_s"]
    match key:
        case "a":
            return command._replace(armed=True, speed_m_s=0.0, yaw_rate_rad_s=0.0, slip_ratio=0.0)
        case " ":
            return command._replace(armed=False, speed_m_s=0.0, yaw_rate_rad_s=0.0, slip_ratio=0.0)
        case "w" | "s":
            step = speed / _PRESSES if key == "w" else -speed / _PRESSES
            return command._replace(speed_m_s=_moved(command.speed_m_s, step, speed))
        case "j" | "l":
            step = turn / _PRESSES if key == "j" else -turn / _PRESSES
            return command._replace(yaw_rate_rad_s=_moved(command.yaw_rate_rad_s, step, turn))
        case "+" | "-":
            wanted = command.slip_bound + (_SLIP_STEP if key == "+" else -_SLIP_STEP)
            slip = min(max(wanted, _SMALLEST_SLIP), limits["slip"])
            return command._replace(slip_bound=slip, slip_ratio=slip if command.slip_ratio else 0.0)
        case "m":
            return command._replace(slip_ratio=0.0 if command.slip_ratio else command.slip_bound)
        case "0":
            return command._replace(speed_m_s=0.0, yaw_rate_rad_s=0.0, slip_ratio=0.0)
    return command


def moved_stick(event: bytes, command: OperatorCommand, limits: Mapping[str, float]) -> OperatorCommand:
    """Set-points after an event of a joystick: the first stick drives, button 0 arms, any other one stops."""
    _, value, kind, number = EVENT.unpack(event)
    share = value / _FULL_AXIS if abs(value) > _PLAY * _FULL_AXIS else 0.0
    if kind == _AXIS and number == 1:
        return command._replace(speed_m_s=-share * limits["speed_m_s"])
    if kind == _AXIS and number == 0:
        return command._replace(yaw_rate_rad_s=-share * limits["yaw_rate_rad_s"])
    if kind == _BUTTON and value:
        return pressed("a" if number == 0 else " ", command, limits)
    return command


def _moved(value: float, step: float, most: float) -> float:
    """The value one step further, within `most` of 0; 0 where it comes within half a step of it."""
    found = min(max(value + step, -most), most)
    return 0.0 if value * found < 0.0 or abs(found) < 0.5 * abs(step) else found


def line(beat: Mapping[str, Any], command: OperatorCommand) -> str:
    """State of the robot and set-points."""
    words = [f"{beat.get('phase', '')!s:8}", _of_speed(beat, command)]
    slips = [f"{100 * slip:.0f}" for slip in beat.get("slip_ratio") or [] if slip is not None]
    goal = f"hold {100 * command.slip_ratio:.0f}" if command.slip_ratio else f"at most {100 * command.slip_bound:.0f}"
    words.append(f"slip {'/'.join(slips) or '-'} % ({goal})")
    if beat.get("soc") is not None:
        words.append(f"battery {100 * beat['soc']:.0f} %")
    if not beat.get("driver", True):
        words.append("somebody else drives")
    if beat.get("reason"):
        words.append(f"{beat['reason']}{'; space, then a' if beat.get('phase') == 'stopped' else ''}")
    return "  ".join(words)


def _of_speed(beat: Mapping[str, Any], command: OperatorCommand) -> str:
    speed, turn = beat.get("speed_m_s"), beat.get("yaw_rate_rad_s")
    now = "-" if speed is None else f"{speed:+.2f}"
    turning = "-" if turn is None else f"{turn:+.2f}"
    return f"speed {now} ({command.speed_m_s:+.2f}) m/s  turn {turning} ({command.yaw_rate_rad_s:+.2f}) rad/s"
