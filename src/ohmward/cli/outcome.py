"""Result of a command: computed with a progress bar, printed, and written as a report."""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ohmward import __version__
from ohmward.cli.wording import Detail, assumptions, paragraphs, with_assumptions
from ohmward.errors import InputError, OhmwardError
from ohmward.json_values import plain

#: Number of bytes at the start of a table, or at its end in Parquet, that contain the names of its columns.
_ENDS_BYTES = 1 << 16
#: Progress callback, called with the name of a task and the share of it that is done, from 0 to 1.
Report = Callable[[str, float], None]


def counting(report: Report | None, what: str) -> Callable[[int, int], None] | None:
    """Progress callback (done, total) for one task, which begins now; None where progress is not shown."""
    if report is None:
        return None
    report(what, 0.0)
    return lambda done, total: report(what, done / total)


@contextmanager
def progress() -> Iterator[Report | None]:
    """Callback that draws a progress bar with rich; None without a terminal or without rich."""
    if not (sys.stderr.isatty() and find_spec("rich")):
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bars:
        task = bars.add_task("", total=1.0)
        yield lambda what, share: bars.update(task, description=what, completed=share)


if TYPE_CHECKING:
    from ohmward.report import Page


class Outcome(NamedTuple):
    """The result of a command."""

    summary: Mapping[str, Any]  #: the object of --json, see `plain`
    text: str  #: the same for people
    notes: Sequence[str] = ()  #: what was assumed on the way, printed after `text`, on standard error with --json
    page: Callable[[], Page] | None = None  #: makes the report, called only with --report
    status: int = 0  #: exit status
    has_notes: bool = False  #: True where `text` and page contain the notes already


def carry_out(run: Callable[[argparse.Namespace], Outcome], arguments: argparse.Namespace) -> Outcome:
    """Run a command and write its report.

    run: `run` of the command.

    Raises:
        OhmwardError: the command refuses, or the report cannot be written.
    """
    report = getattr(arguments, "report", None)
    check_output("--report", report, (".html", ".htm"))
    outcome = run(arguments)
    if report and outcome.page:
        write_page(outcome.page(), report, () if outcome.has_notes else outcome.notes)
    return outcome


def write_page(page: Page, path: str | os.PathLike[str], notes: Sequence[str]) -> None:
    """Write a page with everything that was assumed, and the version in its last line.

    Raises:
        OhmwardError: the file cannot be written.
    """
    replace(with_assumptions(page, notes), footer=f"ohmward {__version__}").write(path)


def show(outcome: Outcome, *, as_json: bool, detail: Detail = "all") -> None:
    """Print the outcome; as JSON, standard output carries one object and nothing else.

    Raises:
        BrokenPipeError: the reader of standard output has gone.
        OhmwardError: writing to standard output fails for another reason, such as a full disk.
    """
    text = outcome.text  # empty where `run` has written its own lines
    if not outcome.has_notes:
        text = paragraphs(text, assumptions(outcome.notes, detail))
    if as_json:
        for note in outcome.notes:
            print(note, file=sys.stderr)
        text = json.dumps(plain(outcome.summary), indent=2, ensure_ascii=False, allow_nan=False)
    try:
        if text:
            print(text, flush=True)
    except BrokenPipeError:
        raise
    except OSError as error:
        close_output()
        raise OhmwardError(
            f"standard output takes no more ({error.strerror}); free the disk, or send it elsewhere"
        ) from error


def close_output() -> None:
    """Discard the interpreter's last flush of standard output."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def check_output(option: str, path: str | None, suffixes: Sequence[str], inputs: Sequence[str] = ()) -> None:
    """Refuse, before the work begins, an output file that could not be written.

    option: its name in messages.  suffixes: accepted endings.  inputs: files that must not be overwritten.

    Raises:
        InputError: another ending, no such folder, no permission, a folder in its place, or one of the inputs.
    """
    if path is None:
        return
    file = Path(path)
    if not file.name.endswith(tuple(suffixes)):
        endings = " or ".join(", ".join(suffixes).rsplit(", ", 1))
        raise InputError(f"{option} {path}: the name must end in {endings}")
    if not file.parent.is_dir():
        raise InputError(f"{option} {path}: there is no folder {str(file.parent)!r}; make it first")
    if file.is_dir():
        raise InputError(f"{option} {path}: this is a folder; name a file in it")
    if any(Path(other).exists() and file.exists() and file.samefile(other) for other in inputs):
        raise InputError(f"{option} {path}: this file is an input; choose another name")
    try:  # permissions, read-only mounts and full disks show only when one tries
        with tempfile.TemporaryFile(dir=file.parent):
            pass
    except OSError as error:
        raise InputError(
            f"{option} {file}: {str(file.parent)!r} takes no files ({error.strerror}); choose another folder"
        ) from error


def check_results(path: str | None, endings: Sequence[str], inputs: Sequence[str], column: str) -> None:
    """Refuse, before the work begins, a table of results that could not be written or would overwrite another file.

    endings: accepted endings.  column: name of a column by which an older table of results is recognised.

    Raises:
        InputError: see `check_output`; or a file without this column has the name already.
    """
    check_output("--output", path, endings, inputs)
    if not path or not (file := Path(path)).exists() or not file.stat().st_size:
        return
    with file.open("rb") as stream:
        ends = stream.read(_ENDS_BYTES)
        stream.seek(max(file.stat().st_size - _ENDS_BYTES, 0))
        ends += stream.read()
    if column.encode() not in ends:
        raise InputError(
            f"--output {path}: there is another file of this name, without the column {column} that results have; "
            "choose another name, or delete it first"
        )
