"""Input that cannot be read: counted, and said in the log without filling it."""

from __future__ import annotations

import reprlib

from ohmward.onboard.part import LOG


class FaultyInput:
    """Faulty lines, frames or payloads of a source.

    Args:
        name: of the source.
        sentence: about them, "lines are no JSON object".
        kind: of what is named, "source".

    Attributes:
        number: of them so far.
    """

    def __init__(self, name: str, sentence: str, kind: str = "source"):
        self.name, self.sentence, self.kind, self.number = name, sentence, kind, 0

    def count(self, more: int = 1, example: bytes = b"") -> None:
        """Count more of them; every doubling of the number is a line in the log, with the beginning of an example."""
        before, self.number = self.number, self.number + more
        if self.number.bit_length() > before.bit_length():
            quoted = f", such as {reprlib.repr(example.decode(errors='replace'))}" if example else ""
            LOG.warning("%s %s: %s (%d so far%s)", self.kind, self.name, self.sentence, self.number, quoted)
