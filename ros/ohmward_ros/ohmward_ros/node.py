"""The node: parameters of ROS around the process of `ohmward run`."""

from __future__ import annotations

import signal
import sys
from types import FrameType


def main() -> None:
    """Run until the node is stopped, at whatever moment that is."""
    end = End()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, end)
    from ohmward_ros.running import run  # takes seconds, in which a signal may come

    sys.exit(run(end))


class End:
    """End without a trace where nothing runs yet, and remember it: the interpreter loses what a callback raises."""

    asked = False

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Take a signal."""
        self.asked = True
        raise SystemExit(0)
