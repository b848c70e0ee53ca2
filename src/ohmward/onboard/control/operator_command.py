"""Set-points of an operator, received over the network: checked, and limited to what the robot may do."""

from __future__ import annotations

import hashlib
import hmac
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from ohmward.checks import require_between, require_each_positive
from ohmward.onboard.message import as_number, json_value

#: A robot stops within this time [s] of any fault; timeouts are shorter by a step of the loop and a frame on the bus.
SAFE_STOP_S = 0.1


@dataclass(frozen=True)
class DriveLimits:
    """Limits that no operator can exceed."""

    #: largest set-points, > 0
    speed_m_s: float = 0.5
    yaw_rate_rad_s: float = 1.0
    acceleration_m_s2: float = 0.5  #: acceleration of the speed ramps, > 0
    #: torque of each driven wheel and its rate, > 0
    torque_Nm: float = 5.0
    torque_rate_Nm_per_s: float = 500.0
    slip: float = 0.3  #: largest slip ratio, as bound and as set-point, in [0.001, 0.999]
    friction: float = 0.5  #: friction assumed by the control law, which tolerates an error of up to its size, > 0
    #: the robot stops if the last estimate or operator command is older; within 0.1 s for timeouts up to 0.08 s. Longer
    #: ones, for slow sensors and radios, let it drive on for that time
    estimate_timeout_s: float = 0.08
    operator_timeout_s: float = 0.08

    def __post_init__(self) -> None:
        require_each_positive("limits.", self, "speed_m_s", "yaw_rate_rad_s", "acceleration_m_s2", "friction")
        require_each_positive("limits.", self, "torque_Nm", "torque_rate_Nm_per_s")
        require_between("limits.slip", self.slip, 0.001, 0.999)
        require_between("limits.estimate_timeout_s", self.estimate_timeout_s, 0.01, 1.0)
        require_between("limits.operator_timeout_s", self.operator_timeout_s, 0.04, 1.0)


#: Longest line [bytes].
LONGEST_COMMAND = 4096
_CODE = 32

#: Smaller set-points count as zero: a joystick has play, and a robot is armed at rest only.
NOTHING = 1e-3


class OperatorCommand(NamedTuple):
    """An operator's set-points."""

    armed: bool = False  #: the robot may drive
    speed_m_s: float = 0.0  #: forward
    yaw_rate_rad_s: float = 0.0  #: > 0 to the left
    slip_bound: float = 0.12  #: largest slip ratio while the speed is held
    slip_ratio: float = 0.0  #: slip ratio to hold instead of a speed; 0 holds the speed. The speed gives the direction.
    given_s: float = -math.inf  #: time on the robot's clock after which the operator gave this command

    @property
    def at_rest(self) -> bool:
        """True if all set-points are zero."""
        return max(abs(self.speed_m_s), abs(self.yaw_rate_rad_s), abs(self.slip_ratio)) < NOTHING

    def limited(self, limits: DriveLimits) -> OperatorCommand:
        """The nearest set-points within the limits."""
        return self._replace(
            speed_m_s=_within(self.speed_m_s, limits.speed_m_s),
            yaw_rate_rad_s=_within(self.yaw_rate_rad_s, limits.yaw_rate_rad_s),
            slip_bound=min(max(self.slip_bound, 0.001), limits.slip),
            slip_ratio=_within(self.slip_ratio, limits.slip),
        )


def _within(value: float, most: float) -> float:
    return min(max(value, -most), most)


def command_of(found: Mapping[str, object], given_s: float) -> OperatorCommand | None:
    """The set-points of a JSON object; None if one is not a finite number."""
    usual = OperatorCommand()._asdict()
    numbers = {name: as_number(found.get(name, usual[name])) for name in usual.keys() - {"armed", "given_s"}}
    if not all(map(math.isfinite, numbers.values())):
        return None
    return OperatorCommand(armed=found.get("armed") is True, given_s=given_s, **numbers)


class Signing:
    """Authentication codes (HMAC) for one direction of one connection.

    Args:
        token: shared secret; empty on a connection that never leaves the machine.
        nonce: of the connection, made by the robot, so that no line of another connection is valid in this one.
        sender: "robot" or "operator".
    """

    def __init__(self, token: str, nonce: str, sender: str):
        self._key, self._salt = token.encode(), f"{nonce} {sender} ".encode()
        self._sequence = 0

    def line(self, found: dict[str, Any]) -> bytes:
        """A line with its code and its sequence number."""
        self._sequence += 1
        text = json.dumps(found | {"n": self._sequence}, allow_nan=False).encode()
        return self._code(text) + b" " + text + b"\n"

    def read(self, line: bytes) -> dict[str, Any] | None:
        """The object of a line; None if its code is wrong, or it is no newer than the last one."""
        code, _, text = line.rstrip(b"\r\n").partition(b" ")
        if not hmac.compare_digest(code, self._code(text)):
            return None
        found = json_value(text)
        if not isinstance(found, dict) or not isinstance(found.get("n"), int) or found["n"] <= self._sequence:
            return None
        self._sequence = found["n"]
        return found

    def _code(self, text: bytes) -> bytes:
        return hmac.new(self._key, self._salt + text, hashlib.sha256).hexdigest()[:_CODE].encode()
