"""Status line on the terminal: charge, speed, slip, pose, range and faults."""

from __future__ import annotations

import math
import shutil
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TextIO

from ohmward.filters.consistency import BAND_95
from ohmward.onboard.feed import Feed
from ohmward.onboard.robot_state import Level, RobotState, stale
from ohmward.quantities import SECONDS_PER_HOUR


@dataclass(frozen=True)
class TerminalSink:
    """The newest state: on a terminal in one line that is overwritten, otherwise line by line."""

    interval_s: float = 1.0  #: least time between two lines, >= 0
    name: str = "terminal"  #: in diagnostics

    async def run(self, feed: Feed) -> None:
        """Write lines until the feed ends."""
        out = sys.stdout
        while states := await feed.batch():
            show(line_of(states[-1]), out)
        if out.isatty():
            print(file=out, flush=True)


def show(line: str, out: TextIO) -> None:
    """Write a line; on a terminal, over the previous one."""
    if out.isatty():
        print(f"\r\x1b[2K{within_terminal(line)}", end="", file=out, flush=True)
    else:
        print(line, file=out, flush=True)


def within_terminal(line: str) -> str:
    """The line cut to the width of the terminal: a wrapped line cannot be overwritten."""
    width = shutil.get_terminal_size().columns - 1
    return line if len(line) <= width else f"{line[: width - 1]}…"


def line_of(state: RobotState) -> str:
    """The state in one line, with 95 % bands."""
    return "  ".join(_parts(state))


def _parts(state: RobotState) -> Iterator[str]:
    if text := stale(state):
        yield text
    if state.battery:
        yield f"charge {100 * state.battery.soc:.1f} ± {100 * BAND_95 * state.battery.soc_std:.1f} %"
    if state.range and math.isfinite(state.range.distance_m.p50):
        low, middle, high = (distance_m / 1e3 for distance_m in state.range.distance_m)
        hours, assumed = state.range.duration_s.p50 / SECONDS_PER_HOUR, ", assumed" if state.range.assumed else ""
        yield f"range {middle:.1f} km ({low:.1f} to {high:.1f}{assumed}), {hours:.1f} h"
    if state.slip:
        yield f"speed {state.slip.speed_m_s:z.2f} ± {BAND_95 * state.slip.speed_std_m_s:.2f} m/s"
        yield f"slip {' '.join(f'{100 * slip:.0f}' if slip == slip else '-' for slip in state.slip.slip_ratio)} %"
    if state.pose:
        yield f"x {state.pose.x_m:.2f} y {state.pose.y_m:.2f} ± {BAND_95 * state.pose.position_std_m:.2f} m"
    wrong = [d.name for d in state.diagnostics if d.level != Level.OK]
    if wrong:
        yield f"trouble: {', '.join(wrong)}"
