"""A fleet's batches on a Dask cluster, whose workers have ohmward and see the logs under the same paths."""

from __future__ import annotations

import importlib.metadata
from collections.abc import Iterator, Sequence
from itertools import islice
from typing import TYPE_CHECKING, Any

from ohmward.errors import InputError, OhmwardError
from ohmward.fleet.job import Job
from ohmward.fleet.run import failed, rows_of
from ohmward.optional import require

if TYPE_CHECKING:
    from distributed import Client, Future

#: Time-out for the scheduler, and for its first worker [s].
SCHEDULER_TIMEOUT_S = 60.0

#: Batches for each thread of the workers, so that none waits for its next.
_AHEAD = 2


def on_dask(
    job: Job, batches: Sequence[list[str]], address: str, timeout_s: float = SCHEDULER_TIMEOUT_S
) -> Iterator[list[dict[str, Any]]]:
    """Rows of each batch as it is finished; only as many batches are submitted as keep the workers busy.

    Dask gives the batch of a worker that died to another one. A batch that fails there too is run once more log by
    log. Dask blames everything that a dying worker held, so the logs that fail then are run once more at the end, each
    with the cluster to itself; those that fail alone have the reason in `error`.

    Raises:
        InputError: no scheduler at this address, no workers, or workers without this version of ohmward.
        OhmwardError: Dask is not installed, or its scheduler was lost.
    """
    distributed = require("distributed", "--dask")
    with _connect(distributed, address, timeout_s) as client:
        waiting = iter(batches)
        suspects: list[str] = []
        first = islice(waiting, _AHEAD * sum(client.nthreads().values()))
        paths_of = {_submit(client, job, batch): batch for batch in first}
        finished = distributed.as_completed(list(paths_of))
        for future in finished:
            paths = paths_of.pop(future)
            rows = _rows(client, future, address)
            failed_together = isinstance(rows, BaseException) and len(paths) > 1
            following = [[path] for path in paths] if failed_together else list(islice(waiting, 1))
            submitted = {_submit(client, job, batch): batch for batch in following}
            paths_of |= submitted
            finished.update(list(submitted))
            if not isinstance(rows, BaseException):
                yield rows
            elif not failed_together:
                suspects += paths
        for path in suspects:
            rows = _rows(client, _submit(client, job, [path]), address)
            reason = f"{path}: {type(rows).__name__}: {rows}"
            yield [failed(path, reason)] if isinstance(rows, BaseException) else rows


def _rows(client: Client, future: Future, address: str) -> list[dict[str, Any]] | BaseException:
    """Rows of a batch, or its error; waits for its end.

    A scheduler whose workers all die at once may cancel a batch that was finished on one of them, or wait for rows that
    died with it.
    """
    error = future.exception()
    if future.status in ("cancelled", "lost"):
        if client.status != "running":
            raise OhmwardError(f"the Dask scheduler at {address} was lost; start again: finished logs are kept")
        return OhmwardError("Dask has cancelled it, because its workers died")
    if error:
        return error
    try:
        return future.result(timeout=SCHEDULER_TIMEOUT_S)
    except Exception as lost:
        return lost


def _submit(client: Client, job: Job, batch: list[str]) -> Future:
    """Submit a batch; pure=False, because a file may have changed since Dask saw its path."""
    return client.submit(rows_of, job, batch, pure=False)


def _connect(distributed: Any, address: str, timeout_s: float) -> Client:
    """A client of the scheduler, once it has a worker with this version of ohmward."""
    try:
        client = distributed.Client(address, timeout=timeout_s)
    except (OSError, ValueError) as error:
        raise InputError(
            f"there is no Dask scheduler at {address} ({error}); start one with `dask scheduler`"
        ) from error
    try:
        client.wait_for_workers(1, timeout=timeout_s)
        here = importlib.metadata.version("ohmward")
        for worker, there in client.run(importlib.metadata.version, "ohmward", on_error="return").items():
            if there != here:
                raise InputError(
                    f"the Dask worker {worker} has ohmward {there}, but this is {here}; install the same on all workers"
                )
    except TimeoutError as error:
        client.close()
        raise InputError(f"the scheduler has no workers; start them with `dask worker {address}`") from error
    except OhmwardError:
        client.close()
        raise
    return client
