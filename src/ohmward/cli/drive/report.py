"""The line that an operator sees."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ohmward.onboard.control.operator_command import OperatorCommand


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
