"""`ohmward store`: list, query and export what a robot has stored."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from ohmward.cli.outcome import Outcome, check_output
from ohmward.errors import InputError
from ohmward.logs.write import TABLES, write_table
from ohmward.onboard.store.rows import KINDS
from ohmward.onboard.store.store import Store, joined

#: Number of last conditions that `list` shows.
_CONDITIONS = 10


def run(args: argparse.Namespace) -> Outcome:
    """List, query or export."""
    if (args.action == "export") != (args.output is not None):
        raise InputError("export needs -o FILE, and only export takes it")
    check_output("--output", args.output, TABLES)
    store = Store(Path(args.folder), read_only=True)
    with store.reading():
        if args.action == "list":
            return _list(store)
        columns = _columns(store, args.kind, args.names, (args.since, args.until), args.every)
    if args.action == "export":
        write_table(columns, args.output)
        rows = len(columns["time_s"])
        figures = {"output": args.output, "kind": args.kind, "rows": rows, "columns": list(columns)}
        return Outcome(figures, f"{rows} rows of {args.kind} in {args.output}")
    if args.json:
        return Outcome({name: column.tolist() for name, column in columns.items()}, "")
    texts = [["" if value != value else str(value) for value in column] for column in columns.values()]
    lines = map(",".join, zip(*texts, strict=True))
    return Outcome({}, "\n".join([",".join(columns), *lines]))


def _list(store: Store) -> Outcome:
    spans = {kind: store.span_ns(kind) for kind in KINDS}
    conditions = [condition._asdict() for condition in store.conditions()[-_CONDITIONS:]]
    figures = {
        "folder": store.folder,
        "size_bytes": store.size_bytes(),
        "kinds": {
            kind: {"rows": rows, "first_unix_s": first / 1e9, "last_unix_s": last / 1e9, "columns": store.names(kind)}
            for kind, (rows, first, last) in spans.items()
        },
        "archive": [entry._asdict() for entry in store.archived()],
        "conditions": conditions,
    }
    return Outcome(figures, "\n".join(_lines(figures)))


def _lines(figures: dict[str, Any]) -> Iterator[str]:
    yield f"{figures['folder']}: {figures['size_bytes'] / 1e6:.1f} MB, {len(figures['archive'])} files in the archive"
    for kind, found in figures["kinds"].items():
        if not found["rows"]:
            yield f"{kind}: no rows"
            continue
        yield f"{kind}: {found['rows']} rows, {_date(found['first_unix_s'])} to {_date(found['last_unix_s'])}"
        yield f"  {', '.join(found['columns'])}"
    if figures["conditions"]:
        yield "last conditions:"
    for when_ns, name, level, message in (condition.values() for condition in figures["conditions"]):
        yield f"  {_date(when_ns / 1e9)} {level:5} {name}: {message}"


def _date(unix_s: float) -> str:
    return datetime.fromtimestamp(unix_s).astimezone().isoformat(" ", "seconds")


def _columns(
    store: Store, kind: str, wanted: str | None, span_s: tuple[float | None, float | None], every: int
) -> dict[str, np.ndarray]:
    """The requested rows: `time_s` since the first of them, `unix_time_s`, then the values.

    wanted: names separated by commas; None for all.
    span_s: first and last time [s]; None where it is open.
    every: keep only every N-th row.
    """
    names = [name.strip() for name in wanted.split(",")] if wanted else None
    since_s, until_s = (
        edge if given is None else given for edge, given in zip((-math.inf, math.inf), span_s, strict=True)
    )
    kinds = KINDS if kind == "both" else (kind,)
    found = joined([store.read(one, names, since_s, until_s) for one in kinds], names)
    if missing := [name for name in names or () if name not in found]:
        known = {name for one in kinds for name in store.read(one, None, since_s)} - {"unix_ns"}
        raise InputError(f"there is no column {missing[0]!r}; there are: {', '.join(sorted(known)) or 'none'}")
    order = np.argsort(found["unix_ns"], kind="stable")[::every]
    unix_ns = found.pop("unix_ns")[order]
    if not len(unix_ns):
        raise InputError(f"there are no rows of {kind} in that time; `ohmward store list {store.folder}` says which")
    times = {"time_s": (unix_ns - unix_ns[0]) / 1e9, "unix_time_s": unix_ns / 1e9}
    return times | {name: column[order] for name, column in found.items()}
