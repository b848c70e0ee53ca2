"""Lines between robot and operator, each with a code that only those who have the token can make."""

from __future__ import annotations

import hashlib
import hmac
import json
from typing import Any

#: Longest line [bytes].
LONGEST = 4096
_CODE = 32


class Signing:
    """Codes of one direction of one connection.

    Args:
        token: shared secret; empty on a connection that never leaves the machine.
        nonce: of the connection, made by the robot, so that no line of another connection is good in this one.
        sender: "robot" or "operator".
    """

    def __init__(self, token: str, nonce: str, sender: str):
        self._key, self._salt = token.encode(), f"{nonce} {sender} ".encode()
        self._sequence = 0

    def line(self, found: dict[str, Any]) -> bytes:
        """A line with its code; the sequence goes along."""
        self._sequence += 1
        text = json.dumps(found | {"n": self._sequence}, allow_nan=False).encode()
        return self._code(text) + b" " + text + b"\n"

    def read(self, line: bytes) -> dict[str, Any] | None:
        """The object of a line; None where its code is wrong, or it is no newer than one before."""
        code, _, text = line.rstrip(b"\r\n").partition(b" ")
        if not hmac.compare_digest(code, self._code(text)):
            return None
        try:
            found = json.loads(text)
        except (ValueError, RecursionError):
            return None
        if not isinstance(found, dict) or not isinstance(found.get("n"), int) or found["n"] <= self._sequence:
            return None
        self._sequence = found["n"]
        return found

    def _code(self, text: bytes) -> bytes:
        return hmac.new(self._key, self._salt + text, hashlib.sha256).hexdigest()[:_CODE].encode()
