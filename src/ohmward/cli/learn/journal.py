"""Journal of a run of `ohmward learn`: what was learnt so far, so that a run that was interrupted goes on there."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ohmward.errors import OhmwardError

#: Row of the journal: the log as it was named, what each of its lessons says, and the battery files after it.
Row = dict[str, Any]


class Journal:
    """A file beside the output, one line for each log; it goes when the run is done.

    path: None keeps no journal.
    job: what the lessons depend on beside the logs; a journal of another job is begun anew.
    """

    def __init__(self, path: Path | None, job: str):
        self.path = path
        lines = path.read_text(encoding="utf-8").splitlines() if path and path.exists() else []
        rows = [row for row in map(_parsed, lines) if row is not None]
        self.rows: list[Row] = rows[1:] if rows and rows[0].get("job") == job else []
        if path is not None and not self.rows:
            self._write([{"job": job}], "w")

    def add(self, row: Row) -> None:
        """Append a row; it is on the disk before the next log is read."""
        self.rows.append(row)
        if self.path is not None:
            self._write([row], "a")

    def finish(self) -> None:
        """Remove the file."""
        if self.path is not None:
            self.path.unlink(missing_ok=True)

    def _write(self, rows: Sequence[Row], mode: str) -> None:
        assert self.path is not None
        try:
            with self.path.open(mode, encoding="utf-8") as stream:
                stream.write("".join(f"{json.dumps(row)}\n" for row in rows))
        except OSError as error:
            raise OhmwardError(
                f"{self.path}: cannot be written ({error.strerror}); free space, then start again"
            ) from error


def _parsed(line: str) -> Row | None:
    """Object in a line; None for one that was cut off when the run was interrupted."""
    try:
        return json.loads(line)
    except json.JSONDecodeError:
        return None


def journal_path(output: str | None) -> Path | None:
    """Journal of a run with this output: .battery.toml.learning beside the file, or .learning in the folder."""
    if output is None:
        return None
    path = Path(output)
    return path / ".learning" if path.is_dir() else path.with_name(f".{path.name}.learning")
