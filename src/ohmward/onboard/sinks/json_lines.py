"""JSON lines on standard output or in a file: one state of the robot a line."""

from __future__ import annotations

import json
import sys
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

from ohmward.atomic import open_to_append, require_writable
from ohmward.errors import OhmwardError
from ohmward.onboard.feed import Feed
from ohmward.onboard.robot_state import plain_state


@dataclass(frozen=True)
class JsonLinesSink:
    """States, one a line."""

    path: str = "-"  #: "-" for standard output, else a file to append to
    interval_s: float = 0.0  #: least time between two lines, >= 0
    name: str = "json-lines"  #: in diagnostics

    async def run(self, feed: Feed) -> None:
        """Write lines until the feed ends."""
        try:
            with nullcontext(sys.stdout) if self.path == "-" else self._opened() as file:
                while states := await feed.batch():
                    try:
                        file.writelines(json.dumps(plain_state(state), allow_nan=False) + "\n" for state in states)
                        file.flush()
                    except OSError:
                        feed.put_back(states)  # those that were written are written twice
                        raise
        except OSError as error:  # of a write, or of the close that writes what is left
            fix = "check the path, and that the disk is not full"
            raise OhmwardError(f"{self.path} cannot be written ({error.strerror or error}); {fix}") from error

    async def try_out(self) -> None:
        """Look whether the file can be written."""
        if self.path != "-":
            require_writable(Path(self.path))

    def _opened(self) -> TextIO:
        """The file, in a folder that is created if missing."""
        path = Path(self.path)
        path.parent.mkdir(parents=True, exist_ok=True)
        return open_to_append(path)
