"""Keys and sticks of an operator, as changes of the set-points."""

from __future__ import annotations

import struct
from collections.abc import Mapping

from ohmward.onboard.control.operator_command import OperatorCommand

#: A press changes a set-point by its limit over this.
_PRESSES = 10
#: Change of a slip by a press.
_SLIP = 0.01
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
_FULL = 32767.0
#: Part of a stick's way that is play.
_PLAY = 0.08


def keys_of(text: str) -> list[str]:
    """Single keys of what a terminal has sent; arrows become letters."""
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
            slip = min(max(command.slip_bound + (_SLIP if key == "+" else -_SLIP), _SMALLEST_SLIP), limits["slip"])
            return command._replace(slip_bound=slip, slip_ratio=slip if command.slip_ratio else 0.0)
        case "m":
            return command._replace(slip_ratio=0.0 if command.slip_ratio else command.slip_bound)
        case "0":
            return command._replace(speed_m_s=0.0, yaw_rate_rad_s=0.0, slip_ratio=0.0)
    return command


def moved_stick(event: bytes, command: OperatorCommand, limits: Mapping[str, float]) -> OperatorCommand:
    """Set-points after an event of a joystick: the first stick drives, button 0 arms, any other one stops."""
    _, value, kind, number = EVENT.unpack(event)
    share = value / _FULL if abs(value) > _PLAY * _FULL else 0.0
    if kind == _AXIS and number == 1:
        return command._replace(speed_m_s=-share * limits["speed_m_s"])
    if kind == _AXIS and number == 0:
        return command._replace(yaw_rate_rad_s=-share * limits["yaw_rate_rad_s"])
    if kind == _BUTTON and value:
        return pressed("a" if number == 0 else " ", command, limits)
    return command


def _moved(value: float, step: float, most: float) -> float:
    """The value one step on, which stays at 0 where it would pass it."""
    found = min(max(value + step, -most), most)
    return 0.0 if abs(found) < 0.5 * abs(step) else found
