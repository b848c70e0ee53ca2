"""The node: parameters of ROS around the process of `ohmward run`."""

from __future__ import annotations

import signal
import sys
from types import FrameType


def main() -> None:
    """Run until the node is stopped, at whatever moment that is."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _end)
    from ohmward_ros.running import run  # takes seconds, in which a signal may come

    sys.exit(run())


def _end(number: int, frame: FrameType | None) -> None:
    """End without a trace: nothing runs yet."""
    raise SystemExit(0)
