"""Run of a fleet: its logs in batches, on this machine or a cluster; resumable.

Every finished batch is appended to `progress.jsonl` in the output folder before the next is counted, so a run that was
interrupted goes on where it stopped; logs that failed or have changed are tried again. At the end `summary.csv` has one
row for each log, sorted by path, and `summary.parquet` the same where pyarrow is installed.
"""

from __future__ import annotations

import csv
import hashlib
import json
import logging
import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple, Protocol
from urllib.parse import quote

from ohmward import __version__
from ohmward.atomic import open_to_append, replacing
from ohmward.checks import require_positive
from ohmward.errors import InputError, OhmwardError
from ohmward.logs.frame import import_arrow
from ohmward.logs.selection import split_selection
from ohmward.optional import require

PROGRESS, SUMMARY = "progress.jsonl", "summary.csv"
#: Fingerprint of the log, in the rows of `PROGRESS`.
_FILE = "file"

#: Logs in a batch: enough to fill the vectors, few enough to fit in memory.
LOGS_AT_ONCE = 32


class FleetJob(Protocol):
    """A job over named items: the logs of a fleet by their paths, the cells of a study."""

    @property
    def digest(self) -> str:
        """Digest of the job, different for every job with other results."""
        ...

    @property
    def estimates(self) -> str | None:
        """Folder for estimates, or None."""
        ...

    def run(self, paths: Sequence[str]) -> list[dict[str, Any]]:
        """Rows of the items, in their order; one that failed has its reason in `error`."""
        ...


def digest_of(settings: Any) -> str:
    """Digest of the settings of a job and of the version of ohmward, written as JSON."""
    text = json.dumps([__version__, settings])
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def fingerprint(texts: Sequence[str]) -> str:
    """Digest of logs, which changes when a file does."""
    stats: list[tuple[str, int | None, int | None]] = []
    for text in texts:
        try:
            stat = split_selection(text)[0].stat()
            stats.append((text, stat.st_size, stat.st_mtime_ns))
        except (OSError, ValueError):
            stats.append((text, None, None))
    return digest_of(stats)[:12]


def file_name(name: str) -> str:
    """Name as part of a file name, unique: all but letters, digits, `.`, `_` and `-` are percent-encoded."""
    return "".join(c if c.isalnum() or c in "._-" else quote(c, safe="") for c in name)


#: Rows of each batch of items, as they are finished, in any order.
Executor = Callable[[Any, list[list[str]]], Iterator[list[dict[str, Any]]]]


class Finished(NamedTuple):
    """Result of a fleet."""

    rows: list[dict[str, Any]]  #: one for each log that was asked for, sorted by path
    resumed: int  #: how many of them were done before
    summary: Path  #: the file with the rows

    @property
    def failed(self) -> list[dict[str, Any]]:
        """Rows of logs that could not be used."""
        return [row for row in self.rows if row.get("error")]


def in_processes(job: FleetJob, batches: Sequence[list[str]], processes: int = 1) -> Iterator[list[dict[str, Any]]]:
    """Rows of each batch as it is finished; only as many batches are submitted as keep the processes busy.

    Raises:
        InputError: `processes` is not positive.
        OhmwardError: a process was killed.
    """
    require_positive("processes", processes)
    if min(processes, len(batches)) <= 1:
        yield from (rows_of(job, batch) for batch in batches)
        return
    try:
        yield from _side_by_side(job, batches, processes)
    except BrokenProcessPool as error:
        raise OhmwardError(
            "a process was killed, perhaps for want of memory; start again with fewer (--processes, processes=): "
            "finished logs stay"
        ) from error


def failed(path: str, reason: str) -> dict[str, Any]:
    """Row of a log that could not be used."""
    return {"path": path, "error": reason}


def rows_of(job: FleetJob, batch: list[str]) -> list[dict[str, Any]]:
    """Rows of a batch; after an unexpected error it is run log by log, and those that fail alone are reported."""
    try:
        return job.run(batch)
    except OhmwardError:
        raise
    except Exception as error:  # one log must not end the run of all others
        if len(batch) > 1:
            return [row for path in batch for row in rows_of(job, [path])]
        logging.getLogger("ohmward").exception("%s failed", batch[0])
        return [failed(batch[0], f"{batch[0]}: {type(error).__name__}: {error}")]


def _one_thread() -> None:
    """Keep a process to one thread: the processes share the processors, and threads would only fight each other."""
    os.environ["OHMWARD_THREADS"] = "1"


def _side_by_side(job: FleetJob, batches: Sequence[list[str]], processes: int) -> Iterator[list[dict[str, Any]]]:
    waiting, others = iter(batches), set(multiprocessing.active_children())
    with ProcessPoolExecutor(processes, multiprocessing.get_context("spawn"), _one_thread) as pool:
        try:
            with _interrupts_held():
                under_way: set[Future] = {pool.submit(rows_of, job, batch) for batch in islice(waiting, 2 * processes)}
            while under_way:
                finished, under_way = wait(under_way, return_when=FIRST_COMPLETED)
                with _interrupts_held():
                    under_way |= {pool.submit(rows_of, job, batch) for batch in islice(waiting, len(finished))}
                yield from (future.result() for future in finished)
        except (KeyboardInterrupt, GeneratorExit):
            pool.shutdown(wait=False, cancel_futures=True)
            for process in set(multiprocessing.active_children()) - others:
                process.terminate()
            raise


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Keep interrupts from processes started meanwhile, each of which would print a traceback."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def run_fleet(
    paths: Sequence[str],
    job: FleetJob,
    folder: Path,
    work: Executor = in_processes,
    progress: Callable[[int, int], None] | None = None,
    batch: int = LOGS_AT_ONCE,
) -> Finished:
    """Estimate every log and write one row for each.

    work: runs the batches: `partial(in_processes, processes=8)`, `partial(on_dask, address=...)`.
    progress: called with (logs done, all).
    batch: logs that run side by side, one in each lane.

    Raises:
        InputError: no logs, or the folder holds the results of another job.
        OhmwardError: the folder cannot be written, or `work` cannot go on.
    """
    require_positive("batch", batch)
    if not paths:
        raise InputError("there are no logs to estimate; check the pattern")
    wanted = sorted(dict.fromkeys(paths))
    files = {path: fingerprint([path]) for path in wanted}
    done = _begin(folder, job, files)
    left = [path for path in wanted if path not in done]
    resumed = len(wanted) - len(left)
    for rows in work(job, [left[i : i + batch] for i in range(0, len(left), batch)]):
        write_rows(folder / PROGRESS, [row | {_FILE: files[row["path"]]} for row in rows])
        done |= {row["path"]: row for row in rows}
        if progress:
            progress(len(done.keys() & set(wanted)), len(wanted))
    rows = [done[path] for path in wanted]
    _write_summary([log for row in rows for log in row.get("logs", [row])], folder / SUMMARY)
    return Finished(rows, resumed, folder / SUMMARY)


def _begin(folder: Path, job: FleetJob, files: Mapping[str, str]) -> dict[str, dict[str, Any]]:
    """Rows that an earlier run of the same job has left, by path; those of logs that failed or changed are left out.

    files: fingerprint of each log as it is now.
    """
    progress = folder / PROGRESS
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if job.estimates:
            Path(job.estimates).mkdir(parents=True, exist_ok=True)
        lines = read_rows(progress)
    except OSError as error:
        raise OhmwardError(f"{folder}: cannot be used ({error.strerror}); choose another folder") from error
    if not lines:
        write_rows(progress, [{"job": job.digest}])
        return {}
    head, *rows = lines
    if head.get("job") != job.digest:
        raise InputError(
            f"{folder} holds results of another battery file, filter, settings or version of ohmward; choose another "
            f"folder or remove {progress}"
        )
    valid = [row for row in rows if row.pop(_FILE, None) == files.get(row["path"])]
    return {row["path"]: row for row in valid if not row["error"]}


def read_rows(path: Path) -> list[dict[str, Any]]:
    """The objects of a file, one a line, without one that was cut off by an interruption; [] where there is none."""
    rows = []
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else []:
        with suppress(json.JSONDecodeError):
            rows.append(json.loads(line))
    return rows


def write_rows(path: Path, rows: Sequence[dict[str, Any]], mode: str = "a") -> None:
    """Write objects, one a line, to the disk; mode: `a` appends them, `w` begins the file."""
    try:
        with open_to_append(path) if mode == "a" else path.open(mode, encoding="utf-8") as stream:
            stream.write("".join(f"{json.dumps(row)}\n" for row in rows))
            stream.flush()
            os.fsync(stream.fileno())
    except OSError as error:
        raise OhmwardError(f"{path}: cannot be written ({error.strerror}); free space, then start again") from error


def _write_summary(rows: list[dict[str, Any]], path: Path) -> None:
    names = list(dict.fromkeys(name for row in sorted(rows, key=len, reverse=True) for name in row))
    rows = [{name: "; ".join(v) if isinstance(v, list) else v for name, v in row.items()} for row in rows]
    if (arrow := import_arrow()) is not None:
        columns = {name: [row.get(name) for row in rows] for name in names}
        with replacing(path.with_suffix(".parquet")) as temporary:
            require("pyarrow.parquet", "Parquet").write_table(arrow.table(columns), temporary)
    with replacing(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, names)
        writer.writeheader()
        writer.writerows(rows)
