"""JSON lines on standard output or in a file: one state of the robot a line."""

from __future__ import annotations

import json
import sys
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

from ohmward.checks import require_between
from ohmward.errors import OhmwardError
from ohmward.onboard.feed import Feed
from ohmward.onboard.plain import plain_state


@dataclass(frozen=True)
class JsonLinesSink:
    """States by lines.

    Attributes:
        path: "-" for standard output, else a file that is appended to.
        interval_s: least time between two lines, >= 0.
        name: in diagnostics.
    """

    path: str = "-"
    interval_s: float = 0.0
    name: str = "json-lines"

    def __post_init__(self) -> None:
        require_between("interval_s", self.interval_s, 0.0, 1e9)

    async def run(self, feed: Feed) -> None:
        """Write lines until the feed ends."""
        with nullcontext(sys.stdout) if self.path == "-" else self._opened() as file:
            while states := await feed.batch():
                file.writelines(json.dumps(plain_state(state), allow_nan=False) + "\n" for state in states)
                file.flush()

    def _opened(self) -> TextIO:
        """The file, in a folder that is made where there is none."""
        try:
            Path(self.path).parent.mkdir(parents=True, exist_ok=True)
            return Path(self.path).open("a", encoding="utf-8")
        except OSError as error:
            raise OhmwardError(f"{self.path} cannot be written ({error.strerror or error}); check the path") from error
