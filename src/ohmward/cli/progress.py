"""Progress on standard error, only while somebody watches."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

#: Called with the name of a task and the share of it that is done, from 0 to 1.
Report = Callable[[str, float], None]


def counting(report: Report | None, what: str) -> Callable[[int, int], None] | None:
    """Progress callback (done, total) for one task, which begins now; None where nobody watches."""
    if report is None:
        return None
    report(what, 0.0)
    return lambda done, total: report(what, done / total)


@contextmanager
def progress() -> Iterator[Report | None]:
    """A callback that draws a bar with rich; None where nobody watches or rich is not installed."""
    bars = _bars() if sys.stderr.isatty() else None
    if bars is None:
        yield None
        return
    with bars:
        task = bars.add_task("", total=1.0)
        yield lambda what, share: bars.update(task, description=what, completed=share)


def _bars() -> Any:
    """Bars of rich on standard error; None where rich is not installed."""
    try:
        from rich.console import Console
        from rich.progress import Progress
    except ImportError:
        return None
    return Progress(console=Console(stderr=True), transient=True)
