"""Input that cannot be read: counted, and said in the log without filling it."""

from __future__ import annotations

from ohmward.onboard.part import LOG


class FaultyInput:
    """Faulty lines, frames or payloads of a source.

    Args:
        name: of the source.
        sentence: after the number of them, "lines are no JSON object".

    Attributes:
        number: of them so far.
    """

    def __init__(self, name: str, sentence: str):
        self.name, self.sentence, self.number = name, sentence, 0

    def count(self, more: int = 1) -> None:
        """Count more of them; every doubling of the number is a line in the log."""
        before, self.number = self.number, self.number + more
        if self.number.bit_length() > before.bit_length():
            LOG.warning("source %s: %d %s", self.name, self.number, self.sentence)
