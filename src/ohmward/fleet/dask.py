"""A fleet's batches on a Dask cluster, whose workers have ohmward and see the logs under the same paths."""

from __future__ import annotations

import importlib.metadata
from collections.abc import Iterator, Sequence
from itertools import islice
from typing import TYPE_CHECKING, Any

from ohmward.errors import InputError, OhmwardError
from ohmward.fleet.job import Job, failed
from ohmward.optional import require

if TYPE_CHECKING:
    from distributed import Client, Future

#: How long to wait for the scheduler and for its first worker [s].
PATIENCE_S = 60.0


def on_dask(
    job: Job, batches: Sequence[list[str]], address: str, reset_after_s: float = PATIENCE_S
) -> Iterator[list[dict[str, Any]]]:
    """Rows of each batch as it is finished; no more batches are under way than keep the workers busy.

    Dask gives the batch of a worker that died to another one. A batch that fails there too is done once more log by
    log. Dask blames all that a dying worker had before it, so the logs that fail then are done once more at the end,
    each with the cluster to itself; those that fail alone have the reason in `error`.

    Raises:
        InputError: no scheduler at this address, no workers, or workers without this version of ohmward.
        OhmwardError: Dask is not installed, or its scheduler was lost.
    """
    distributed = _distributed()
    with _connect(address, reset_after_s) as client:
        left, suspects = iter(batches), []
        paths_of = {_submit(client, job, batch): batch for batch in islice(left, 2 * sum(client.nthreads().values()))}
        finished = distributed.as_completed(list(paths_of))
        for future in finished:
            paths, error = paths_of.pop(future), _error(future, address)
            again = [[path] for path in paths] if error and len(paths) > 1 else []
            suspects += paths if error and not again else []
            more = {_submit(client, job, batch): batch for batch in again or islice(left, 1)}
            paths_of |= more
            finished.update(list(more))
            if not error:
                yield future.result()
        for path in suspects:
            future = _submit(client, job, [path])
            error = _error(future, address)
            yield [failed(path, f"{path}: {type(error).__name__}: {error}")] if error else future.result()


def _error(future: Future, address: str) -> BaseException | None:
    """What went wrong in a batch; waits for its end."""
    error = future.exception()
    if future.status in ("cancelled", "lost"):
        raise OhmwardError(f"the Dask scheduler at {address} was lost; start again: what is done is kept")
    return error


def _submit(client: Client, job: Job, batch: list[str]) -> Future:
    """pure=False: a file may have changed since Dask saw its path."""
    return client.submit(job.run, batch, pure=False)


def _connect(address: str, reset_after_s: float) -> Client:
    distributed = _distributed()
    try:
        client = distributed.Client(address, timeout=reset_after_s)
    except (OSError, ValueError) as error:
        raise InputError(
            f"there is no Dask scheduler at {address} ({error}); start one with `dask scheduler`"
        ) from error
    try:
        client.wait_for_workers(1, timeout=reset_after_s)
        _check_versions(client)
    except TimeoutError as error:
        client.close()
        raise InputError(f"the scheduler has no workers; start them with `dask worker {address}`") from error
    except OhmwardError:
        client.close()
        raise
    return client


def _check_versions(client: Client) -> None:
    """InputError where a worker would do something else than this process."""
    here = importlib.metadata.version("ohmward")
    for worker, there in client.run(importlib.metadata.version, "ohmward", on_error="return").items():
        if there != here:
            raise InputError(
                f"the Dask worker {worker} has ohmward {there}, but this is {here}; install the same on all workers"
            )


def _distributed() -> Any:
    return require("distributed", "--dask")
