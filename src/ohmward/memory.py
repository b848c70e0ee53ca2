"""Freed memory: arrays of logs stay at hand for the next ones, compilers give theirs back. Only glibc is asked."""

from __future__ import annotations

import ctypes
from contextlib import suppress

#: Parameters of mallopt, and their values [bytes]: smaller arrays come from the heap, which shrinks from this size on.
#: By default an array of a log goes back with each use, and the system clears its pages again for the next one.
_TRIM_THRESHOLD, _MMAP_THRESHOLD = (-1, 1 << 28), (-3, 1 << 25)


def reuse_freed() -> None:
    """Let freed arrays of up to 4 million samples wait for the next ones, at most 256 MB of them."""
    with suppress(OSError, AttributeError, TypeError):
        for parameter, value in (_TRIM_THRESHOLD, _MMAP_THRESHOLD):
            ctypes.CDLL(None).mallopt(parameter, value)


def return_freed() -> None:
    """Return to the system what traces and compiler have freed, which glibc would keep: 350 MB of a robot's process."""
    with suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).malloc_trim(0)
