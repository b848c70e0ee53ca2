"""A fleet's batches on this machine, over processes."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from itertools import islice
from typing import Any

from ohmward.checks import require_positive
from ohmward.errors import OhmwardError
from ohmward.fleet.job import Job


def in_processes(job: Job, batches: Sequence[list[str]], processes: int = 1) -> Iterator[list[dict[str, Any]]]:
    """Rows of each batch as it is finished; no more batches are under way than keep the processes busy.

    Raises:
        InputError: `processes` is not positive.
        OhmwardError: a process was killed.
    """
    require_positive("processes", processes)
    if min(processes, len(batches)) <= 1:
        yield from map(job.run, batches)
        return
    try:
        yield from _side_by_side(job, batches, processes)
    except BrokenProcessPool as error:
        raise OhmwardError(
            "a process was killed, for want of memory perhaps; start again with fewer --processes: what is done is kept"
        ) from error


def _one_thread() -> None:
    """Keep a process to one thread: the processes share the processors, and threads would only fight each other."""
    os.environ["OHMWARD_THREADS"] = "1"


def _side_by_side(job: Job, batches: Sequence[list[str]], processes: int) -> Iterator[list[dict[str, Any]]]:
    """Rows of each batch from a pool of processes."""
    waiting = iter(batches)
    with ProcessPoolExecutor(processes, multiprocessing.get_context("spawn"), _one_thread) as pool:
        under_way: set[Future] = {pool.submit(job.run, batch) for batch in islice(waiting, 2 * processes)}
        while under_way:
            finished, under_way = wait(under_way, return_when=FIRST_COMPLETED)
            under_way |= {pool.submit(job.run, batch) for batch in islice(waiting, len(finished))}
            yield from (future.result() for future in finished)
