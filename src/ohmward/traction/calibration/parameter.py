"""One calibrated number with its uncertainty, or the reason why the drives do not tell it."""

from __future__ import annotations

from typing import NamedTuple


class Parameter(NamedTuple):
    """name: with its unit; value, std: of it; reason: why it could not be identified, empty where it was."""

    name: str
    value: float
    std: float
    reason: str = ""

    @property
    def identified(self) -> bool:
        """Whether the drives tell it."""
        return not self.reason
